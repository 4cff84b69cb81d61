"""Links made again: forces and energies at the switch, cycles of it (Shilko fig. 1, theory B11)."""

from collections.abc import Iterator

import numpy as np

from .. import packing
from ..criteria import Fracture, Rankine
from ..errors import Array
from ..material import Material
from ..packing import Packing
from ..relinking import Healing
from ..scene import Body, Scene
from ..simulation import Simulation
from .case import Measurement, case
from .core import vanishing

SOFT = Material(1.0, 0.3, 1.0)
BRITTLE = Rankine(2e-3)


def _mechanical(sim: Simulation) -> float:
    """Kinetic, pair, volume and contact energy [J]."""
    ledger = sim.energy()
    return sum(ledger[x] for x in ("kinetic", "pair", "volume", "contact"))


def _pressed(p: Packing, healing: Healing | None, precision: str) -> Simulation:
    """A body of two halves that a cut parts, pressed on each other and sheared."""
    scene = Scene()
    body = scene.add(p, SOFT, healing=healing)
    right = p.position[:, 0] > p.position[:, 0].mean()
    body.linked[right[p.bonds[:, 0]] != right[p.bonds[:, 1]]] = False
    strain = np.zeros((p.dim, p.dim))
    strain[0, 0] = -2e-3
    strain[0, 1] = strain[1, 0] = 5e-4
    scene.strain(body, strain)
    scene.contact(friction=0.3)
    return Simulation(scene, precision=precision)


@case("relink", slow=True)
def links_keep_the_force() -> Iterator[Measurement]:
    """Two pressed and sheared halves weld: forces, torques and energy beside those of a twin that
    does not."""
    shapes = {
        "plane strain": packing.voronoi((6.0, 5.0), 1.0, "strain", seed=2),
        "plane stress": packing.voronoi((6.0, 5.0), 1.0, "stress", seed=2),
        "space": packing.voronoi((3.5, 3.5, 3.5), 1.0, seed=1),
    }
    for precision, limit in (("float64", 1e-12), ("mixed", 1e-5), ("float32", 1e-5)):
        for name, p in shapes.items():
            one = _pressed(p, None, precision)
            two = _pressed(p, Healing(pressure=1e-6), precision)
            one.run(steps=1)
            two.run(steps=1)
            log = two.relinked_bonds()
            where = f"{name}, {precision}"
            yield Measurement(
                f"bonds linked, {where}", 1, "some are", len(log), float(len(log) == 0), 0.0
            )
            jump = np.abs(two.bond_force - one.bond_force).max() / np.abs(one.bond_force).max()
            yield vanishing(f"jump of forces of bonds, {where}", "no jump", float(jump), limit)
            jump = np.abs(two.torque - one.torque).max() / np.abs(one.torque).max()
            # in space a torque about the force itself cannot be a link's: two elements that have
            # turned against each other have some
            bound = 2e-4 if name == "space" else 10.0 * limit
            yield vanishing(f"jump of torques, {where}", "no jump", float(jump), bound)
            lost = _mechanical(one) - _mechanical(two)
            booked = float(log["released_energy"].sum())
            error = abs(lost - booked) / _mechanical(one)
            yield Measurement(
                f"energy that the links released, {where}", lost, "a twin without", booked,
                error, limit,
            )  # fmt: skip


def _couple(fracture: Fracture | None, healing: Healing | None) -> tuple[Scene, Body]:
    """A bar of four elements, whose middle bond may break."""
    p = packing.square((4.0, 1.0), 1.0, "strain")
    scene = Scene()
    body = scene.add(p, SOFT, fracture=fracture, healing=healing)
    if fracture is not None:
        x = p.position[:, 0].mean()
        scene.set_strength(body, np.inf)
        scene.set_strength(body, 1.0, [x, -9.0], [x, 9.0])
    scene.contact(friction=0.2)
    return scene, body


def _driven(
    cycles: int,
    period: float,
    pull: float,
    push: float,
    heals: bool,
    precision: str,
    fracture: Fracture = BRITTLE,
) -> tuple[Simulation, Array]:
    """The bar, pulled and pushed at its right end that many times. Its mechanical energy less the
    work done on it, and what all switches of bonds have released, after every tenth of them."""
    law = Healing(pressure=1e-4) if heals else None
    scene, body = _couple(fracture if heals else None, law)
    if not heals:
        body.linked[1] = False
    mean, half = 0.5 * (pull - push), 0.5 * (pull + push)
    omega = 2.0 * np.pi / period
    last = len(body.packing) - 1
    scene.hold(body, [0])
    peak = half * omega
    scene.hold(body, [last], velocity=[peak, 0.0], history=lambda t: np.sin(omega * t))
    body.displacement[last, 0] = mean - half  # from the pressed end of a cycle
    body.displacement[:, 0] = (mean - half) * np.arange(len(body.packing)) / last
    sim = Simulation(scene, precision=precision)
    rows = []
    for n in range(10):
        sim.run(until=(n + 1) * 0.1 * cycles * period)
        ledger = sim.energy()
        held = _mechanical(sim) - ledger["work"]
        held += ledger["integrator"] + ledger["friction"]
        rows.append((held, ledger["fracture"] + ledger["healing"], ledger["residual"]))
    return sim, np.array(rows)


def _cycles(cycles: int, precision: str, heals: bool) -> Iterator[Measurement]:
    sim, rows = _driven(cycles, 120.0, 0.03, 0.01, heals, precision)
    what = f"{cycles} cycles, {precision}"
    start = sum(sim.initial_energies[x] for x in ("pair", "volume", "contact"))
    size = max(float(np.abs(rows[:, 1]).max()), start)
    if heals:
        made = len(sim.relinked_bonds())
        error = float(made < cycles)
        yield Measurement(
            f"links made again in {what}", cycles, "at least one a cycle", made, error, 0.0
        )
        error = float(abs(len(sim.broken_bonds()) - made) > 1)
        broke = len(sim.broken_bonds())
        yield Measurement(f"breaks in {what}", made, "one a link", broke, error, 0.0)
    gained = max(0.0, float((rows[:, 0] - rows[0, 0]).max())) / size
    limit = 1e-9 if precision == "float64" else 1e-3
    yield vanishing(f"energy gained over work done in {what}", "none", gained, limit)
    left = float(np.abs(rows[:, 2]).max()) / size
    yield vanishing(f"energy missing in {what}", "conserved", left, limit)


@case("relink", slow=True)
def cycles_of_a_bond() -> Iterator[Measurement]:
    """A bar is pulled until it breaks and pushed until it welds, 20 times; and a cut one is opened
    and closed 40 times: no energy is created."""
    for precision in ("float64", "float32"):
        yield from _cycles(20, precision, heals=True)
        yield from _cycles(40, precision, heals=False)


@case("relink", slow=True)
def many_cycles_of_a_bond() -> Iterator[Measurement]:
    """Broken and linked again 1000 times, opened and closed 10 000 times: no energy is created."""
    for precision in ("float64", "float32"):
        yield from _cycles(1000, precision, heals=True)
        yield from _cycles(10_000, precision, heals=False)

"""Pairs that no bond joined weld and break (theory B11)."""

from collections.abc import Iterator

import numpy as np

from .. import packing
from ..errors import Array
from ..relinking import Welding
from ..scene import Scene
from ..simulation import Simulation
from .case import Measurement, case
from .contact import SOFT, ball, momenta
from .core import vanishing


def _pulled(
    dim: int, precision: str, welding: Welding | None, period: float, push: float, pull: float
) -> Simulation:
    """Two elements, one held, the other moved along x from `push` pressed to `pull` apart."""
    scene = Scene()
    one = scene.add(ball(np.zeros(dim), 0.5), SOFT)
    place = np.eye(dim)[0]
    other = scene.add(ball(place, 0.5), SOFT)
    scene.hold(one, [0])
    omega, half = 2.0 * np.pi / period, 0.5 * (pull + push)
    scene.hold(
        other, [0], velocity=half * omega * np.eye(dim)[0], history=lambda t: np.sin(omega * t)
    )
    other.displacement[:] = -push * np.eye(dim)[0]
    scene.contact(friction=0.3, welding=welding)
    return Simulation(scene, precision=precision, dt=0.05)


def _area(dim: int) -> float:
    return 1.0 if dim == 2 else 0.25 * np.pi


def _compliance(sim: Simulation) -> float:
    """R/(lambda + 2 G) of the first element [m/Pa]."""
    assert sim.model.contact_compliance is not None
    return float(sim.model.contact_compliance[0])


@case("weld", slow=True)
def welds_keep_the_force() -> Iterator[Measurement]:
    """Two loose blocks pressed and sheared, beside a twin that does not weld: force, energy."""
    for dim in (2, 3):
        for precision, limit in (("float64", 1e-12), ("float32", 1e-5))[: 4 - dim]:
            sims = []
            for welding in (None, Welding(strength=1e-2, pressure=1e-4, time=4.0)):
                p = (
                    packing.hexagonal((4.0, 3.0), 1.0, "strain")
                    if dim == 2
                    else packing.fcc((2.5,) * 3, 1.0)
                )
                scene = Scene()
                scene.add(p, SOFT)
                other = scene.add(p, SOFT)
                wide = np.ptp(p.position[:, 0]) + 1.0
                other.displacement[:, 0] = wide - 2e-3
                scene.set_velocity(other, 2e-4 * np.array([-1.0, 1.0, 0.5])[:dim])
                scene.contact(friction=0.5, welding=welding)
                sims.append(Simulation(scene, precision=precision))
            two = sims[1]
            while not len(two.welded) and two.time < 1e4:
                for sim in sims:
                    sim.run(steps=1)
            where = f"{dim}D, {precision}"
            force, torque = (x.force for x in sims), (x.torque for x in sims)
            for name, (a, b) in (("forces", force), ("torques", torque)):
                jump = float(np.abs(a - b).max() / np.abs(a).max())
                yield vanishing(f"jump of {name}, {where}", "no jump", jump, limit)
            held = [x.energy()["contact"] for x in sims]
            yield vanishing(
                f"jump of energy, {where}", "no jump", abs(held[1] / held[0] - 1.0), limit
            )
            log = two.welded_pairs()
            early = float((log["time"] < 4.0 - 2.0 * two.dt).sum())
            yield vanishing(f"welds before their time, {where}", "none", early, 0.0)
            low = float((log["normal_stress"] > -1e-4).sum())
            yield vanishing(f"welds below their pressure, {where}", "none", low, 0.0)
            before = momenta(two)
            two.run(steps=400)
            after = momenta(two)
            for at, name in ((0, "momentum"), (1, "angular momentum")):
                worst = float(np.abs(after[at] - before[at]).max() / before[2 + at])
                bound = 1e-12 if precision == "float64" else 1e-5
                yield vanishing(f"{name}, {where}", "Newton", worst, bound)
            broken = float((two.welded_pairs()["kind"] == "broken").sum())
            missing = abs(two.energy()["residual"]) / two.initial_energies["kinetic"]
            yield Measurement(
                f"energy missing, {where}, breaks {broken:g}", 0.0, "conserved", missing, missing,
                1e-4 if precision == "float64" else 1e-3,
            )  # fmt: skip


@case("weld")
def welds_break_at_their_strength() -> Iterator[Measurement]:
    """A welded pair pulled slowly apart, and one twisted across: greatest stress, energy."""
    strength = 5e-3
    for dim in (2, 3):
        sim = _pulled(dim, "float64", Welding(strength), 400.0, 2e-3, 2e-2)
        most, log = 0.0, sim.welded_pairs()
        sim.run(steps=1)
        welded = len(sim.welded)
        while not (log["kind"] == "broken").any() and sim.time < 200.0:
            pull = float(np.abs(sim.force[1]).max()) if sim.position[1, 0] > 1.0 else 0.0
            most = max(most, pull / _area(dim))
            sim.run(steps=1)
            log = sim.welded_pairs()
        where = f"{dim}D, pulled"
        yield Measurement(f"welded, {where}", 1, "pressed", welded, float(welded != 1), 0.0)
        over = max(0.0, most / strength - 1.0)
        yield vanishing(f"stress beyond the strength, {where}", "none", over, 1e-12)
        step = 9e-3 * 2.0 * np.pi / 400.0 * sim.dt / (2.0 * _compliance(sim))
        yield Measurement(
            f"greatest stress, {where}", strength, "as set", most, strength - most, 3.0 * step
        )
        stiffness = _area(dim) / (2.0 * _compliance(sim))
        wanted = (strength * _area(dim)) ** 2 / (2.0 * stiffness)
        found = float(log["released_energy"].sum())
        error = abs(found / wanted - 1.0)
        yield Measurement(f"energy released, {where}", wanted, "F^2/2k", found, error, 1e-2)
        ledger = sim.energy()
        error = abs(ledger["fracture"] / found - 1.0)
        yield Measurement(
            f"fracture in the ledger, {where}", found, "the log", ledger["fracture"], error, 1e-12
        )
        missing = abs(ledger["residual"]) / wanted
        yield vanishing(f"energy missing, {where}", "conserved", missing, 1e-10)


def _weld_cycles(cycles: int) -> Iterator[Measurement]:
    for dim in (2, 3):
        for precision, limit in (("float64", 1e-10), ("float32", 1e-3))[: 4 - dim]:
            sim = _pulled(dim, precision, Welding(5e-3, pressure=1e-3), 40.0, 5e-3, 2e-2)
            rows: list[Array] = []
            for n in range(20):
                sim.run(until=(n + 1) * cycles * 40.0 / 20)
                ledger = sim.energy()
                gained = ledger["kinetic"] + ledger["contact"] - ledger["work"]
                rows.append(np.array([gained, ledger["residual"]]))
            log, where = sim.welded_pairs(), f"{dim}D, {precision}, {cycles} cycles"
            broken = int((log["kind"] == "broken").sum())
            yield Measurement(
                f"breaks, {where}", cycles, "one a cycle", broken, float(abs(broken - cycles) > 1),
                0.0,
            )  # fmt: skip
            least = float(log["released_energy"].min())
            size = float(log["released_energy"].sum())
            yield vanishing(
                f"energy created by breaks, {where}", "none", max(0.0, -least) / size, limit
            )
            table = np.array(rows)
            grown = max(0.0, float((table[:, 0] - table[0, 0]).max())) / size
            yield vanishing(f"energy gained over work, {where}", "none", grown, limit)
            missing = float(np.abs(table[:, 1]).max()) / size
            # what closing leaves over stays owed between elements that are held
            yield vanishing(f"energy missing, {where}", "conserved", missing, max(limit, 1e-4))


@case("weld")
def cycles_of_a_weld() -> Iterator[Measurement]:
    """A pair welds and breaks 30 times: no energy is created."""
    yield from _weld_cycles(30)


@case("weld", slow=True)
def many_cycles_of_a_weld() -> Iterator[Measurement]:
    """A pair welds and breaks 1000 times: no energy is created."""
    yield from _weld_cycles(1000)


@case("weld")
def rubble_welds() -> Iterator[Measurement]:
    """Loose elements that fly into each other, weld, rub and break: momenta, energy, the same bits
    again."""
    for dim in (2, 3):
        ends = []
        for _ in range(2):
            p = packing.voronoi((5.0, 4.0, 3.0)[:dim], 1.0, "strain" if dim == 2 else None, seed=2)
            scene = Scene()
            body = scene.add(p, SOFT)
            body.linked[:] = False
            rng = np.random.default_rng(6)
            centre = p.position.mean(axis=0)
            body.displacement[:] = 0.8 * (p.position - centre)
            v = -0.02 * (p.position - centre) + 5e-3 * rng.normal(size=p.position.shape)
            scene.set_velocity(body, v)
            body.angular_velocity[:] = 0.03 * rng.normal(size=body.angular_velocity.shape)
            scene.contact(friction=0.3, welding=Welding(2e-2, time=0.5, work=1e-7))
            sim = Simulation(scene, dt=0.1)
            before, held = momenta(sim), sim.energy()["kinetic"]
            sim.run(until=120.0)
            after, ledger, log = momenta(sim), sim.energy(), sim.welded_pairs()
            ends.append(sim.position)
        where = f"{dim}D"
        for kind in ("welded", "broken"):
            count = int((log["kind"] == kind).sum())
            yield Measurement(f"pairs {kind}, {where}", 1, "some", count, float(count == 0), 0.0)
        for at, name in ((0, "momentum"), (1, "angular momentum")):
            worst = float(np.abs(after[at] - before[at]).max() / before[2 + at])
            yield vanishing(f"{name}, {where}", "Newton", worst, 1e-12)
        missing = abs(ledger["residual"]) / held
        yield vanishing(f"energy missing, {where}", "conserved", missing, 1e-3)
        differs = int((ends[0] != ends[1]).sum())
        yield vanishing(f"numbers that differ in two runs, {where}", "same bits", differs, 0.0)

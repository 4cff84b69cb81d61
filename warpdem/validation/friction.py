"""Rate-and-state friction against an independent integration (theory B11, C5 row 50)."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from .. import packing
from ..bond import EVMBond
from ..errors import Array
from ..friction import RateAndState
from ..scene import Scene
from ..simulation import Simulation
from .case import Measurement, case
from .contact import SOFT, ball
from .core import vanishing

ROCK = RateAndState(mu0=0.6, a=0.010, b=0.015, V0=1e-6, Dc=2e-3)  # weakens as it slides faster


def slider(
    law: RateAndState,
    stiffness: float,
    drive: Callable[[float], float],
    mu: float,
    theta: float,
    times: Array,
    jumps: Array,
) -> tuple[Array, Array]:
    """Friction and state of a slider without mass pulled through a spring, by SciPy.

    stiffness: of the spring over the normal force [1/m]; drive: speed of the spring's far end.
    """  # fmt: skip

    def change(time: float, y: Array) -> list[float]:
        psi = (law.mu0 + law.b * np.log(law.V0 * y[1] / law.Dc)) / law.a
        v = 2.0 * law.V0 * np.sinh(y[0] / law.a) * np.exp(-psi)
        x = v * y[1] / law.Dc
        aging = 1.0 - x if law.law == "aging" else -x * np.log(x)
        return [stiffness * (drive(time) - v), aging]

    found, y = [], np.array([mu, theta])
    edges = [times[0], *jumps, times[-1]]
    for start, end in pairwise(edges):
        own = times[(times > start) & (times <= end)]
        with np.errstate(over="ignore", invalid="ignore"):  # where it tries too long a step
            solved = solve_ivp(
                change, (start, end), y, "Radau", np.unique(np.append(own, end)),
                rtol=1e-9, atol=1e-12,
            )  # fmt: skip
        y = solved.y[:, -1]
        found.append(solved.y[:, : len(own)])
    both = np.concatenate(found, axis=1)
    return both[0], both[1]


def pressed(
    law: RateAndState, precision: str, dim: int, rate: float, high: float, sag: float
) -> tuple[Simulation, float]:
    """An element pressed into a wall by `sag` and driven along it, first at `rate`, then `high`;
    and its contact's tangential stiffness over the normal force [1/m]."""
    scene = Scene()
    body = scene.add(ball(np.zeros(dim), 0.5), SOFT)
    up, along = np.eye(dim)[1], np.eye(dim)[0]
    dt = 0.05
    until = 8000 * dt
    scene.hold(
        body, [0], velocity=rate * along, history=lambda t: 1.0 if t < until else high / rate
    )
    scene.contact(friction=law)
    scene.wall((sag - 0.5) * up, up)
    sim = Simulation(scene, dt=dt, precision=precision)
    m = sim.model
    assert m.contact_compliance is not None and m.contact_shear is not None
    return sim, float(m.contact_compliance[0] / m.contact_shear[0] / sag)


@case("friction", slow=True)
def velocity_steps() -> Iterator[Measurement]:
    """A pressed element is driven at V0, then at e V0: friction all the way against SciPy's, the
    jump +a at first, (a - b) in the end."""
    for kind, precision, dim in (
        ("aging", "float64", 2),
        ("slip", "float64", 3),
        ("aging", "mixed", 3),
        ("slip", "float32", 2),
    ):
        # slow enough for 1000 steps over Dc, on a contact that is stiff against the law
        law = replace(ROCK, law=kind, V0=4e-5, Dc=2e-3)
        faster = math.e
        sim, stiffness = pressed(law, precision, dim, law.V0, faster * law.V0, 1e-6)
        wall = sim.scene.walls[0]
        steady = law.mu0
        # from rest: friction rises on the contact's spring
        mu: list[float] = []
        time: list[float] = []
        while sim.time < 800.0:
            # each step after the jump, as friction falls from its peak at once
            sim.run(steps=1 if 8000 <= sim.steps < 8050 else 10)
            f = sim.wall_force(wall)
            mu.append(f[0] / -f[1])
            time.append(sim.time)
        found, times = np.array(mu), np.array(time)
        jump = 8000 * sim.dt
        wanted, _ = slider(
            law, stiffness, lambda t: law.V0 if t < jump else faster * law.V0, 1e-9,
            law.Dc / law.V0, np.append(0.0, times), np.array([jump]),
        )  # fmt: skip
        where = f"{kind} law, {precision}, {dim}D"
        error = np.abs(found - wanted)[times > 5.0].max()
        limit = 1e-4 if precision == "float64" else 3e-4
        yield vanishing(f"friction on the way, {where}", "SciPy", float(error), limit)
        before = found[times <= jump][-1]
        yield Measurement(
            f"steady at V0, {where}", steady, "mu0", before, abs(before - steady), limit
        )
        peak = found.max() - before
        yield Measurement(
            f"direct effect, {where}", law.a, "a ln(e)", peak, abs(peak - law.a), 1e-4
        )
        end = found[-1] - before
        yield Measurement(
            f"steady change, {where}", law.a - law.b, "(a - b) ln(e)", end,
            abs(end - law.a + law.b), limit,
        )  # fmt: skip


def pulled(law: RateAndState, share: float, steps: int) -> tuple[Array, Array, float]:
    """Two elements joined by a bond, the second pressed into a wall, the first drawn at V0: times
    and friction over that of steady slip, and the ratio m V0^2/(N a Dc) of inertia.

    share: of the critical stiffness; the contact's own is in series with the bond's.
    """
    sag = 0.05
    give = SOFT.poisson
    pressure = (1.0 - give) / ((1.0 + give) * (1.0 - 2.0 * give)) * SOFT.young
    two_shear = SOFT.young / (1.0 + give)
    normal, tangential = 2.0 * pressure * sag, 2.0 * two_shear
    wanted = share * law.critical_stiffness(normal)
    spring = 1.0 / (1.0 / wanted - 1.0 / tangential)
    scene = Scene()
    p = packing.square((2.0, 1.0), 1.0, "strain")
    body = scene.add(p, SOFT, bond=EVMBond(spring, 0.0, 0.0))
    scene.hold(body, [0], velocity=[-law.V0, 0.0])
    scene.hold(body, [1], axes="y")
    scene.contact(friction=law)
    scene.wall([0.0, p.position[1, 1] - 0.5 + sag], [0.0, 1.0])
    sim = Simulation(scene)
    step, m = sim._step, sim.model
    u = np.zeros((2, 2))
    u[0, 0] = -law.mu0 * normal / spring
    v = np.array([[-law.V0, 0.0], [-law.V0, 0.0]])
    held = np.zeros(step.arrays["wall_spring"].size)
    held.reshape(2, 2)[:, 0] = -law.mu0 * normal / tangential
    step.arrays["wall_spring"].assign(held)
    sim.set_state(displacement=u, velocity=v)
    time, mu = [], []
    while sim.steps < steps:
        sim.run(steps=100)
        # the driver presses on the wall too; the bond tells what the slider bears
        time.append(sim.time)
        mu.append(float(sim.bond_force[0, 0]) / normal)
    return np.array(time), np.array(mu), m.mass[1] * law.V0**2 / (normal * law.a * law.Dc)


def _spring_sliders(kind: str) -> Iterator[Measurement]:
    """How far friction swings in the last of three thirds over that in the first."""
    for share in (0.9, 1.1):
        rate, way = 2e-5, 2e-2
        law = RateAndState(0.6, 0.010, 0.015, rate, way, kind, theta0=1.05 * way / rate)
        _, mu, inertia = pulled(law, share, 100_000)
        first, _, last = (float(np.ptp(part)) for part in np.array_split(mu, 3))
        grew = last / first
        is_right = (grew > 1.2) if share < 1.0 else (grew < 0.8)
        where = f"{kind} law, {share} of the critical stiffness"
        yield Measurement(
            f"growth of swings, {where}", 1.0, "above" if share < 1.0 else "below", grew,
            float(not is_right), 0.0,
        )  # fmt: skip
        yield vanishing(f"inertia m V^2/(N a Dc), {where}", "quasi-static", inertia, 1e-3)


@case("friction")
def spring_sliders() -> Iterator[Measurement]:
    """Steady slip through a spring of 0.9 and 1.1 times sigma (b - a)/Dc, disturbed by 5 % of its
    state, by the aging law."""
    yield from _spring_sliders("aging")


@case("friction", slow=True)
def spring_sliders_of_the_slip_law() -> Iterator[Measurement]:
    """The same by the slip law."""
    yield from _spring_sliders("slip")

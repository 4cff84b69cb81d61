"""Rods of EVM bonds against the theory of beams (theory C1, rows 3-11)."""

from collections.abc import Callable, Iterator
from functools import partial
from math import log2, pi, sqrt

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import brentq

from .. import packing
from ..bond import EVMBond
from ..material import Material
from ..packing import Packing
from ..scene import Body, Scene
from ..section import Circle
from ..simulation import Simulation
from ..statics import tangent, turned
from .case import Measurement, case
from .core import vanishing

ROD = Material(young=1.0, poisson=0.3, density=1.0)
# theory C1 row 6, an ODE solved to 1e-9: PL^2/EI, w/L, u/L, tip angle
ELASTICA = (
    (0.5, 0.162144, 0.015919, 0.244534),
    (1.0, 0.301721, 0.056433, 0.461352),
    (2.0, 0.493457, 0.160642, 0.781750),
    (3.0, 0.603253, 0.254420, 0.986017),
    (5.0, 0.713792, 0.387628, 1.215368),
    (10.0, 0.810609, 0.554996, 1.430286),
)


def straight(bonds: int, section: Circle, dim: int, rod_inertia: bool = False) -> Packing:
    """A rod of length 1 along x."""
    ends = np.zeros((2, dim))
    ends[1, 0] = 1.0
    return packing.filament(ends, bonds, section, rod_inertia=rod_inertia)


def clamped(
    rod: Packing,
    section: Circle,
    law: Callable[..., EVMBond] = EVMBond.bernoulli_euler,
    **more: object,
) -> tuple[Scene, Body]:
    """A scene with a rod held at its start."""
    scene = Scene()
    body = scene.add(rod, ROD, bond=law(ROD, section, rod.bond_length, **more))
    scene.hold(body, rod.side("start"))
    return scene, body


def still(scene: Scene) -> Simulation:
    """A simulation that is not stepped."""
    return Simulation(scene, dt=1.0, force_dt=True)


@case("beam")
def cantilever() -> Iterator[Measurement]:
    """Tip deflection for P L^2/EI = 1e-5, 16 bonds, slenderness L/(2r) from 2 to 100."""
    for name, law in (
        ("Bernoulli-Euler", EVMBond.bernoulli_euler),
        ("Timoshenko", EVMBond.timoshenko),
    ):
        for slenderness in (2, 5, 20, 100):
            section = Circle(0.5 / slenderness)
            worst, exact = 0.0, 0.0
            for dim in (2, 3):
                rod = straight(16, section, dim)
                scene, body = clamped(rod, section, law)
                load = np.zeros(dim)
                load[1] = 1e-5 * section.second_moment
                scene.load(body, rod.side("end"), force=load)
                sim = still(scene)
                sim.equilibrate(tolerance=1e-10)
                exact = 1e-5 / 3.0
                if name == "Timoshenko":
                    k = section.shear_coefficient(ROD.poisson)
                    exact += load[1] / (k * ROD.shear_modulus * section.area)
                measured = float(sim.displacement[-1, 1])
                worst = max(worst, abs(measured / exact - 1.0))
            source = "P L^3/3EI" + (" + P L/kGS" if name == "Timoshenko" else "")
            what = f"tip deflection over L, {name}, slenderness {slenderness}"
            yield Measurement(what, exact, source, measured, worst, 1e-8)


@case("beam")
def cantilever_frequencies() -> Iterator[Measurement]:
    """First three frequencies of a slender cantilever, 8 to 64 bonds."""
    section = Circle(5e-4)
    roots = np.array([1.875104068711961, 4.694091132974174, 7.854757438237613])  # of cos cosh = -1
    exact = roots**2 * sqrt(section.second_moment / section.area)
    errors = []
    for bonds in (8, 16, 32, 64):
        scene, _ = clamped(straight(bonds, section, 2), section)
        errors.append(still(scene).natural_frequencies(3) / exact - 1.0)
    for mode in range(3):
        error = float(errors[-1][mode])
        limit = 2e-4 if mode == 0 else 2e-4 * (roots[mode] / roots[0]) ** 2
        measured = exact[mode] * (1.0 + error)
        what = f"frequency {mode + 1} [rad/s], 64 bonds"
        source = "beta^2 sqrt(EI/rho S)/L^2"
        yield Measurement(what, exact[mode], source, measured, abs(error), limit)
        order = log2(errors[-2][mode] / errors[-1][mode])
        what = f"order of convergence, frequency {mode + 1}, 32 to 64 bonds"
        yield Measurement(what, 2.0, "second order", order, abs(order - 2.0), 0.1)


@case("beam")
def cantilever_vibration() -> Iterator[Measurement]:
    """The first mode in motion: 16 bonds let go from rest, period from its crossings of zero."""
    section = Circle(0.02)
    rod = straight(16, section, 2)
    scene, body = clamped(rod, section)
    x = rod.position[:, 0]
    b = 1.875104068711961
    ratio = (np.cos(b) + np.cosh(b)) / (np.sin(b) + np.sinh(b))
    shape = np.cosh(b * x) - np.cos(b * x) - ratio * (np.sinh(b * x) - np.sin(b * x))
    slope = b * (np.sinh(b * x) + np.sin(b * x) - ratio * (np.cosh(b * x) - np.cos(b * x)))
    size = 1e-4 / shape[-1]
    scene.set_velocity(body, size * np.stack([0.0 * x, shape], axis=1), size * slope[:, None])
    sim = Simulation(scene)
    omega = float(sim.natural_frequencies(1)[0])
    tip, times = [], []
    while sim.time < 4.2 * pi / omega:
        sim.run(steps=max(1, round(0.002 / omega / sim.dt)))
        tip.append(sim.displacement[-1, 1])
        times.append(sim.time)
    w, t = np.array(tip), np.array(times)
    at = np.flatnonzero((w[:-1] > 0.0) != (w[1:] > 0.0))
    zeros = t[at] - w[at] * (t[at + 1] - t[at]) / (w[at + 1] - w[at])
    half = float(np.diff(zeros).mean())
    error = abs(half * omega / pi - 1.0)
    yield Measurement("half period [s]", pi / omega, "eigenvalue", half, error, 1e-3)
    yield vanishing("energy error", "conservation", sim.energy_error, 1e-6)


@case("beam")
def euler_loads() -> Iterator[Measurement]:
    """Load at which the lowest frequency of a straight column vanishes, 8 to 64 bonds."""
    section = Circle(1e-3)
    for name, exact in (("clamped-free", pi**2 / 4.0), ("pinned", pi**2)):
        errors = []
        for bonds in (8, 16, 32, 64):
            critical = brentq(partial(_stability, section, bonds, name), 0.8 * exact,
                              1.2 * exact, xtol=1e-6 * exact)  # fmt: skip
            errors.append(critical / exact - 1.0)
        limit = 1e-4 if name == "clamped-free" else 4e-4
        error = abs(errors[-1])
        what = f"P L^2/EI, {name}, 64 bonds"
        yield Measurement(what, exact, "Euler", exact * (1.0 + errors[-1]), error, limit)
        order = log2(errors[-2] / errors[-1])
        what = f"order of convergence, {name}, 32 to 64 bonds"
        yield Measurement(what, 2.0, "second order", order, abs(order - 2.0), 0.2)


def _stability(section: Circle, bonds: int, name: str, load: float) -> float:
    """Lowest frequency squared of a column under load * EI/L^2, with its sign."""
    rod = straight(bonds, section, 2)
    scene = Scene()
    bond = EVMBond.bernoulli_euler(ROD, section, rod.bond_length)
    body = scene.add(rod, ROD, bond=bond)
    if name == "pinned":
        scene.hold(body, rod.side("start"), rotation=False)
        scene.hold(body, rod.side("end"), axes="y", rotation=False)
    else:
        scene.hold(body, rod.side("start"))
    scene.load(body, rod.side("end"), force=[-load * section.second_moment, 0.0])
    sim = still(scene)
    sim.equilibrate(tolerance=1e-10)
    omega = float(sim.natural_frequencies(1)[0])
    return abs(omega) * omega


@case("beam")
def elastica() -> Iterator[Measurement]:
    """A slender cantilever under a dead load across its tip, far beyond small deflections."""
    section = Circle(5e-3)
    for bonds, limit in ((16, 2e-3), (64, 2e-4)):
        for load, *exact in ELASTICA:
            rod = straight(bonds, section, 2)
            scene, body = clamped(rod, section)
            scene.load(body, rod.side("end"), force=[0.0, load * section.second_moment])
            sim = still(scene)
            sim.equilibrate(load_steps=4)
            tip, half = sim.displacement[-1], sim.orientation[-1]
            angle = 2.0 * np.arctan2(half[0], half[1])
            found = [tip[1], -tip[0], (angle + pi) % (2.0 * pi) - pi]
            error = float(np.abs(np.subtract(found, exact)).max())
            what = f"tip of the elastica, P L^2/EI = {load:g}, {bonds} bonds: w/L"
            source = "ODE; greatest error of w/L, u/L and angle"
            yield Measurement(what, exact[0], source, float(tip[1]), error, limit)


@case("beam")
def roll_up() -> Iterator[Measurement]:
    """A tip moment 2 pi EI/L rolls a rod up into a circle; in the plane and in space."""
    section = Circle(0.02)
    moment = 2.0 * pi * section.second_moment
    for dim, large in ((2, False), (3, False), (2, True)):
        gaps = {}
        for bonds in (8, 16, 32):
            rod = straight(bonds, section, dim)
            scene, body = clamped(rod, section, large_rotation=large)
            torque = [moment] if dim == 2 else [0.0, 0.0, moment]
            scene.load(body, rod.side("end"), torque=torque)
            sim = still(scene)
            sim.equilibrate(load_steps=20)
            gaps[bonds] = float(np.linalg.norm(sim.position[-1] - sim.position[0]))
        where = f"{'plane' if dim == 2 else 'space'}{', large_rotation' if large else ''}"
        # theory C1 row 7; of angles themselves, chords of a circle close exactly
        limit = 1e-6 if large else 8.5e-3
        yield vanishing(f"gap over L, 32 bonds, {where}", "a circle", gaps[32], limit)
        if not large:
            order = log2(gaps[16] / gaps[32])
            what = f"order of convergence of the gap, {where}"
            yield Measurement(what, 2.0, "second order", order, abs(order - 2.0), 0.2)


@case("beam")
def torsion() -> Iterator[Measurement]:
    """Twist of a rod held at one end: at rest, and the period of its free vibration."""
    section = Circle(0.02)
    stiffness = ROD.shear_modulus * section.torsion_constant
    rod = straight(16, section, 3, rod_inertia=True)
    scene, body = clamped(rod, section)
    twist = 1e-5
    scene.load(body, rod.side("end"), torque=[stiffness * twist, 0.0, 0.0])
    sim = still(scene)
    sim.equilibrate(tolerance=1e-12)
    measured = 2.0 * float(np.arctan2(sim.orientation[-1, 0], sim.orientation[-1, 3]))
    error = abs(measured / twist - 1.0)
    yield Measurement("twist [rad]", twist, "T L/(G Jp)", measured, error, 1e-10)
    exact = 4.0 / ROD.shear_speed()
    errors = []
    for bonds in (8, 16, 32):
        rod = straight(bonds, section, 3, rod_inertia=True)
        scene, body = clamped(rod, section)
        scene.hold(body, np.arange(len(rod)), rotation=False)  # it may only turn
        omega = float(still(scene).natural_frequencies(1)[0])
        errors.append(2.0 * pi / omega / exact - 1.0)
    period = exact * (1.0 + errors[-1])
    what = "period of torsion [s], 32 bonds"
    yield Measurement(what, exact, "4 L sqrt(rho/G)", period, abs(errors[-1]), 2e-4)
    order = log2(errors[-2] / errors[-1])
    yield Measurement(
        "order of convergence of the period", 2.0, "second order", order, abs(order - 2.0), 0.1
    )


@case("beam")
def helical_spring() -> Iterator[Measurement]:
    """Stiffness of a close-coiled spring, 8 turns, pulled along its axis."""
    coil, wire, turns = 1.0, 0.05, 8
    section = Circle(wire)
    exact = ROD.shear_modulus * (2.0 * wire) ** 4 / (8.0 * (2.0 * coil) ** 3 * turns)
    for bonds, limit in ((24, 0.03), (48, 0.02)):
        spring = packing.helix(coil, 2.5 * wire, turns, bonds, section)
        scene = Scene()
        bond = EVMBond.timoshenko(ROD, section, spring.bond_length)
        body = scene.add(spring, ROD, bond=bond)
        scene.hold(body, spring.side("start"))
        scene.hold(body, spring.side("end"), axes="xy")
        scene.load(body, spring.side("end"), force=[0.0, 0.0, 1e-4 * exact])
        sim = still(scene)
        sim.equilibrate(tolerance=1e-8)
        stiffness = 1e-4 * exact / float(sim.displacement[-1, 2])
        error = abs(stiffness / exact - 1.0)
        what = f"stiffness [N/m], {bonds} bonds a turn"
        yield Measurement(what, exact, "G d^4/(8 D^3 n)", stiffness, error, limit)


@case("beam")
def twisted_ring() -> Iterator[Measurement]:
    """Twist at which a straight rod bent to a closed ring leaves its plane (Michell, Zajac)."""
    bonds, section = 48, Circle(2e-3)
    ratio = ROD.young * section.second_moment
    ratio /= ROD.shear_modulus * section.torsion_constant
    exact = 2.0 * pi * sqrt(3.0) * ratio
    rod = straight(bonds, section, 3)
    share = rod.position[:, :1]
    angle = 2.0 * pi * share
    ring = np.concatenate([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle], axis=1) / (2.0 * pi)
    rest = np.tile([0.0, 0.0, 0.0, 1.0], (bonds + 1, 1))

    def stability(twist: float) -> float:
        scene, body = clamped(rod, section)
        scene.hold(body, rod.side("end"))
        sim = still(scene)
        zero = np.zeros_like(share)
        along = turned(rest, np.concatenate([twist * share, zero, zero], axis=1))
        around = turned(along, np.concatenate([zero, zero, angle], axis=1))
        sim.set_state(displacement=ring - rod.position, orientation=around)
        sim.equilibrate(tolerance=1e-8)
        omega = float(sim.natural_frequencies(1)[0])
        return abs(omega) * omega

    measured = brentq(stability, 0.8 * exact, 1.2 * exact, xtol=1e-3 * exact)
    error = abs(measured / exact - 1.0)
    source = "2 pi sqrt(3) EI/GJp"
    yield Measurement("critical twist [rad], 48 bonds", exact, source, measured, error, 0.02)


@case("beam")
def twisted_rod() -> Iterator[Measurement]:
    """Moment at which a straight rod under torsion bows out, 48 bonds (Greenhill)."""
    for name, stability, exact, source in (
        ("pinned, dead moments", _bowing_pinned, 2.0 * pi, "Greenhill: 2 pi"),
        ("clamped", _bowing_clamped, 8.986819, "tan(m/2) = m/2"),
    ):
        moment = brentq(stability, 0.8 * exact, 1.2 * exact, xtol=1e-4 * exact)
        error = abs(moment / exact - 1.0)
        what = f"critical moment M L/EI, {name}"
        yield Measurement(what, exact, source, moment, error, 0.02)


def _bowing_pinned(moment: float) -> float:
    """Lowest eigenvalue of the stiffness, that of turning about the axis left out."""
    section = Circle(5e-3)
    rod = straight(48, section, 3)
    torque = np.array([moment * section.second_moment, 0.0, 0.0])
    scene = Scene()
    body = scene.add(rod, ROD, EVMBond.bernoulli_euler(ROD, section, rod.bond_length))
    scene.hold(body, rod.side("start"), rotation=False)
    scene.hold(body, rod.side("end"), axes="yz", rotation=False)
    scene.load(body, rod.side("end"), torque=torque)
    scene.load(body, rod.side("start"), torque=-torque)
    sim = still(scene)
    # the uniform twist; the rod as a whole is free to turn, so it is not searched for
    share = rod.position[:, :1]
    torsion = ROD.shear_modulus * section.torsion_constant * 48
    along = np.arcsin(torque[0] / torsion) * 48 * share
    rest = np.tile([0.0, 0.0, 0.0, 1.0], (49, 1))
    sim.set_state(orientation=turned(rest, along * [1.0, 0.0, 0.0]))
    free = np.ones((49, 6), dtype=bool)
    free[0, :3] = free[-1, 1:3] = False
    chosen = np.flatnonzero(free)
    stiffness = tangent(sim._step, 1.0 / 48)[chosen][:, chosen].toarray()
    spin = np.zeros((49, 6))
    spin[:, 3] = 1.0
    spin = spin.ravel()[chosen]
    rest_of = null_space(spin[None, :])
    inertia = np.tile([1.0] * 3 + [section.second_moment] * 3, 49)[chosen]
    scaled = (stiffness / np.sqrt(inertia)).T / np.sqrt(inertia)
    return float(np.linalg.eigvals(rest_of.T @ scaled.T @ rest_of).real.min())


def _bowing_clamped(moment: float) -> float:
    """Lowest frequency squared, with its sign."""
    section = Circle(5e-3)
    rod = straight(48, section, 3)
    scene, body = clamped(rod, section)
    scene.hold(body, rod.side("end"), axes="yz")
    sim = still(scene)
    torsion = ROD.shear_modulus * section.torsion_constant
    twist = 48 * np.arcsin(moment * section.second_moment / torsion / 48) * rod.position[:, :1]
    rest = np.tile([0.0, 0.0, 0.0, 1.0], (49, 1))
    sim.set_state(orientation=turned(rest, twist * [1.0, 0.0, 0.0]))
    omega = float(sim.natural_frequencies(1)[0])
    return abs(omega) * omega


@case("beam")
def spinning_bar() -> Iterator[Measurement]:
    """A bar that turns about one end stretches by rho w^2 L^3/(3E), and goes on doing so."""
    section, spin, turns = Circle(0.02), 0.02, 20
    exact = spin**2 / 3.0
    errors: dict[int, float] = {}
    for bonds in (8, 16):
        rod = straight(bonds, section, 2)
        scene = Scene()
        bond = EVMBond.bernoulli_euler(ROD, section, rod.bond_length)
        body = scene.add(rod, ROD, bond=bond)
        scene.hold(body, rod.side("start"), angular_velocity=[spin])
        sim = Simulation(scene)
        # from the stretched state of the lumped bar
        mass = rod.volume * ROD.density
        x = rod.position[:, 0]
        pull = np.cumsum((mass * x)[::-1])[::-1][1:] * spin**2
        stretch = np.concatenate([[0.0], np.cumsum(pull / np.asarray(bond.longitudinal))])
        u = np.stack([stretch, 0.0 * x], axis=1)
        v = np.stack([0.0 * x, spin * (x + stretch)], axis=1)
        sim.set_state(displacement=u, velocity=v, angular_velocity=np.full((bonds + 1, 1), spin))
        length: list[float] = []
        while sim.time < turns * 2.0 * pi / spin:
            sim.run(steps=max(1, round(0.05 / spin / sim.dt)))
            length.append(float(np.linalg.norm(sim.position[-1] - sim.position[0])) - 1.0)
        tenth = len(length) // 10
        first, last = np.mean(length[:tenth]), np.mean(length[-tenth:])
        errors[bonds] = float(last / exact - 1.0)
    measured = exact * (1.0 + errors[16])
    source = "rho w^2 L^3/3E"
    yield Measurement(
        f"stretch over L after {turns} turns, 16 bonds", exact, source, measured,
        abs(errors[16]), 4e-3,
    )  # fmt: skip
    order = log2(abs(errors[8] / errors[16]))
    yield Measurement(
        "order of convergence of the stretch", 2.0, "second order", order, abs(order - 2.0), 0.2
    )
    drift = float(last / first - 1.0)
    yield vanishing("change of the stretch, last tenth over first", "no drift", drift, 1e-4)

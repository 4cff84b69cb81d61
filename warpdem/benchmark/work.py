"""Cases whose answer is known, as functions of resolution, time step, precision and model.

Each returns a `Point`: the error, and what it took. Seconds are those of this process on one
thread, so that a busy machine does not change them; building the scene and compiling kernels is not
counted, except where a case says that it is solved as a whole.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import pi, sqrt
from typing import Any

import numpy as np

from .. import packing
from ..bond import EVMBond
from ..errors import Array
from ..experiments import ModeI, mode_i
from ..material import Material
from ..scene import Scene
from ..section import Circle
from ..simulation import Simulation
from ..validation.beam import ELASTICA, clamped, straight
from ..validation.mca import hoop_stress
from ..validation.plastic import hill, widened
from .scenes import BLOCK

PRECISIONS = ("float64", "mixed", "float32")
# of the rods that LAMMPS runs too: spacing, mass 1, inertia 0.1, EA, and EI at a spacing of 1
ROD = {"longitudinal": 1000.0, "shear": 270.0, "bending": 22.5, "torsion": 18.0}
LOAD, DEFLECTION, SHORTENING = ELASTICA[2][:3]  # P L^2/EI = 2
BAR = 4  # elements across the bar of the wave, each way
PERIODS = 2.0  # of the wave that are run
HOT_TIME = 200.0  # of the hot block


@dataclass(frozen=True)
class Point:
    """One run: its error and cost. seconds: of the processor; steps: None where none are made."""

    error: float
    seconds: float
    elements: int
    steps: int | None = None
    more: dict[str, float] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """Element-steps a second."""
        return self.elements * (self.steps or 0) / self.seconds if self.seconds else 0.0


class Clock:
    """Seconds that this process has worked while it ran."""

    seconds = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        """Count while it lasts."""
        began = time.process_time()
        try:
            yield
        finally:
            self.seconds += time.process_time() - began


# -- bodies that LAMMPS runs as well --------------------------------------------------------------


def chain(bonds: int) -> tuple[Array, Array]:
    """Places and bonds of a straight rod with a spacing of 1."""
    x = np.zeros((bonds + 1, 3))
    x[:, 0] = np.arange(bonds + 1.0)
    return x, np.stack([np.arange(bonds), np.arange(1, bonds + 1)], axis=1)


def bar(length: int) -> tuple[Array, Array, Array]:
    """Places, bonds and start velocities of a cubic bar: its first longitudinal mode, small."""
    counts = (length, BAR, BAR)
    x = np.indices(counts).reshape(3, -1).T.astype(float)
    v = np.zeros_like(x)
    v[:, 0] = 1e-5 * np.cos(pi * (x[:, 0] + 0.5) / length)
    return x, grid_bonds(counts), v


def grid_bonds(counts: tuple[int, int, int]) -> Array:
    """Bonds along the axes of a cubic grid."""
    ids = np.arange(np.prod(counts)).reshape(counts)
    return np.concatenate(
        [
            np.stack([ids.take(range(n - 1), a).ravel(), ids.take(range(1, n), a).ravel()], axis=1)
            for a, n in enumerate(counts)
        ]
    )


def hot(n: int = 6, rms: float = 0.1) -> tuple[Array, Array, Array, Array]:
    """Places, bonds, start velocities and spins of a cubic block, normal with `rms`."""
    x = np.indices((n, n, n)).reshape(3, -1).T.astype(float)
    rng = np.random.default_rng(1)
    v, w = rng.normal(0.0, rms, x.shape), rng.normal(0.0, rms, x.shape)
    return x, grid_bonds((n, n, n)), v - v.mean(axis=0), w


def network(x: Array, bonds: Array, stiffness: dict[str, Any]) -> tuple[Scene, Any]:
    """A scene of particles of mass 1, radius 0.5 and these EVM bonds."""
    scene = Scene()
    body = scene.add(
        packing.network(x, bonds, volume=1.0, radius=0.5),
        Material(1.0, 0.0, 1.0),
        bond=EVMBond(**stiffness),
    )
    return scene, body


def elastica(bonds: int, precision: str = "float64", method: str = "relax") -> Point:
    """A clamped rod under a dead load across its tip, P L^2/EI = 2, brought to rest.

    Error: the greater of those of the tip's deflection and shortening over L, against the ODE.
    method: "relax" steers the motion to rest, "newton" solves with a sparse solver on the host.
    """
    x, pairs = chain(bonds)
    scene, body = network(x, pairs, ROD)
    scene.hold(body, [0])
    load = LOAD * ROD["bending"] / bonds**2
    scene.load(body, [bonds], force=[0.0, load, 0.0])
    sim = Simulation(scene, precision=precision)
    clock = Clock()
    with clock.running():
        if method == "newton":
            sim.equilibrate(tolerance=1e-9, load_steps=2)
        else:
            sim.relax(tolerance=1e-5 * (8.0 / bonds) ** 2)
    tip = sim.displacement[-1] / bonds
    return Point(tip_error(tip), clock.seconds, bonds + 1)


def tip_error(tip: Array) -> float:
    """Of the elastica's tip, its displacement over L given."""
    return float(max(abs(tip[1] - DEFLECTION), abs(-tip[0] - SHORTENING)))


def wave(length: int, precision: str = "float64", share: float = 0.4, model: str = "EVM") -> Point:
    """A bar that swings along itself in its first mode, over two periods.

    Error: of the frequency, against pi c/L. share: of the stable time step; model: "EVM" on a cubic
    lattice, or "facet" with Poisson's ratio 0.
    """
    if model == "EVM":
        x, pairs, v = bar(length)
        scene, body = network(x, pairs, BLOCK)
    else:
        p = packing.simple_cubic((length, BAR, BAR), 1.0)
        x = p.position - 0.5
        v = np.zeros_like(x)
        v[:, 0] = 1e-5 * np.cos(pi * (x[:, 0] + 0.5) / length)
        scene = Scene()
        body = scene.add(p, Material(1.0, 0.0, 1.0))
    scene.set_velocity(body, v)
    limit = Simulation(scene).dt_limit
    sim = Simulation(scene, precision=precision, dt=share * limit)
    clock, shape = Clock(), v[:, 0] / np.abs(v).max()
    times, sizes = [0.0], [float((shape * v[:, 0]).sum())]
    omega = pi / length
    every = max(1, round(2.0 * pi / omega / 40.0 / sim.dt))
    while sim.time < PERIODS * 2.0 * pi / omega:
        with clock.running():
            sim.run(steps=every)
        times.append(sim.time)
        sizes.append(float((shape * sim.velocity[:, 0]).sum()))
    error = abs(frequency(np.array(times), np.array(sizes)) / omega - 1.0)
    return Point(error, clock.seconds, len(x), sim.steps)


def frequency(t: Array, size: Array) -> float:
    """Angular frequency of a series that swings as a cosine, by least squares."""
    from scipy.optimize import least_squares

    size = size / size[0]
    crossing = t[:-1][np.diff(np.sign(size)) != 0]
    guess = pi / np.diff(crossing).mean()
    found = least_squares(
        lambda a: a[0] * np.cos(a[1] * guess * t + a[2]) - size, [1.0, 1.0, 0.0],
        xtol=1e-14, ftol=1e-14, gtol=1e-14,
    )  # fmt: skip
    return float(found.x[1] * guess)


def hot_block(dt: float, precision: str = "float64") -> Point:
    """A block of 6 x 6 x 6 with random velocities and spins, undamped, to t = 200.

    Error: greatest change of the energy over its start. more: the mean kinetic energy of the last
    tenth of the time over that of the second tenth, less 1, which a code without an energy has too.
    """
    x, pairs, v, w = hot()
    scene, body = network(x, pairs, BLOCK)
    scene.set_velocity(body, v, w)
    sim = Simulation(scene, precision=precision, dt=dt)
    start = sum(sim.initial_energies[k] for k in ("kinetic", "pair"))
    clock, kinetic, worst = Clock(), [], 0.0
    every = max(1, round(1.0 / dt))
    while sim.time < HOT_TIME - 0.5:
        with clock.running():
            sim.run(steps=every)
        ledger = sim.energy()
        kinetic.append(ledger["kinetic"])
        worst = max(worst, abs((ledger["kinetic"] + ledger["pair"]) / start - 1.0))
    return Point(worst, clock.seconds, len(x), sim.steps, {"kinetic growth": growth(kinetic)})


def growth(kinetic: list[float]) -> float:
    """Mean of the last tenth over that of the second, less 1."""
    tenth = len(kinetic) // 10
    return float(np.mean(kinetic[-tenth:]) / np.mean(kinetic[tenth : 2 * tenth]) - 1.0)


# -- others ---------------------------------------------------------------------------------------


def beam_frequency(bonds: int) -> Point:
    """Lowest frequency of a slender cantilever from the forces' derivatives, against theory."""
    section = Circle(5e-4)
    exact = 1.875104068711961**2 * sqrt(section.second_moment / section.area)
    scene, _ = clamped(straight(bonds, section, 2), section)
    sim = Simulation(scene, dt=1.0, force_dt=True)
    clock = Clock()
    with clock.running():
        omega = float(sim.natural_frequencies(1)[0])
    return Point(abs(omega / exact - 1.0), clock.seconds, bonds + 1)


def spinning_bar(bonds: int, share: float = 0.8, precision: str = "float64") -> Point:
    """A bar that turns about one end stretches by rho w^2 L^3/(3E); mean of five turns."""
    section, spin = Circle(0.02), 0.02
    rod = straight(bonds, section, 2)
    scene = Scene()
    material = Material(1.0, 0.3, 1.0)
    bond = EVMBond.bernoulli_euler(material, section, rod.bond_length)
    body = scene.add(rod, material, bond=bond)
    scene.hold(body, rod.side("start"), angular_velocity=[spin])
    sim = Simulation(scene, precision=precision, dt=share * Simulation(scene).dt_limit)
    x = rod.position[:, 0]
    pull = np.cumsum((rod.volume * x)[::-1])[::-1][1:] * spin**2
    stretch = np.concatenate([[0.0], np.cumsum(pull / np.asarray(bond.longitudinal))])
    still = np.zeros_like(x)
    sim.set_state(
        displacement=np.stack([stretch, still], axis=1),
        velocity=np.stack([still, spin * (x + stretch)], axis=1),
        angular_velocity=np.full((bonds + 1, 1), spin),
    )
    clock, length = Clock(), []
    while sim.time < 5.0 * 2.0 * pi / spin:
        with clock.running():
            sim.run(steps=max(1, round(0.05 / spin / sim.dt)))
        length.append(float(np.linalg.norm(sim.position[-1] - sim.position[0])) - 1.0)
    error = abs(float(np.mean(length)) * 3.0 / spin**2 - 1.0)
    return Point(error, clock.seconds, bonds + 1, sim.steps)


def hole(radius: float) -> Point:
    """Kirsch's hole, its radius in spacings: root mean square error of the hoop stress around its
    edge over the greatest; solved as a whole, the packing of cells included."""
    clock = Clock()
    with clock.running():
        _, hoop, exact = hoop_stress(radius)
    return Point(float(np.sqrt(((hoop - exact) ** 2).mean()) / 3.0), clock.seconds, 0)


def cylinder(radius: float, precision: str = "float64") -> Point:
    """Hill's cylinder, its inner radius in spacings: greatest error of the pressure on the wall
    while the plastic zone spreads; as a whole."""
    clock = Clock()
    widened.cache_clear()
    with clock.running():
        found = widened(radius, precision)
    error = 0.0
    for share in (1.2, 1.4, 1.6, 1.8):
        at = int(np.argmax(found.zone >= share * found.inner))
        exact = hill(found.zone[at], found.inner, found.outer)
        error = max(error, abs(float(found.pressure[at]) / exact - 1.0))
    return Point(error, clock.seconds, 0)


def crack_speed(refine: float, precision: str = "float64") -> Point:
    """The mode I crack, its spacing divided: speed over Rayleigh's. Its error is against the finest
    run, so that it is not known here."""
    given = ModeI()
    spacing = given.distance / refine
    assert given.strength is not None
    coarse = replace(given, spacing=spacing, strength=given.strength * sqrt(refine))
    clock = Clock()
    with clock.running():
        result = mode_i(coarse, precision=precision)
    more = {"speed": result.speed_over_rayleigh, "energy error": result.energy_error}
    return Point(np.nan, clock.seconds, result.elements, result.steps, more)


@dataclass(frozen=True)
class Case:
    """What is drawn in one picture: lines of points along a knob."""

    title: str
    error: str
    run: Callable[..., Point]
    lines: dict[str, list[dict[str, Any]]]


def _lines(knob: str, values: tuple[Any, ...], **kinds: dict[str, Any]) -> dict[str, Any]:
    return {name.replace("_", " "): [{knob: x, **more} for x in values]
            for name, more in kinds.items()}  # fmt: skip


def _precise(knob: str, values: tuple[Any, ...], **more: Any) -> dict[str, Any]:
    kinds = {p: {"precision": p, **more} for p in PRECISIONS}
    return _lines(knob, values, **kinds)


CASES = {
    "elastica": Case(
        "elastica, P L²/EI = 2",
        "error of the tip over L",
        elastica,
        _lines("bonds", (8, 16, 32, 64, 128), float64_Newton={"method": "newton"})
        | _lines("bonds", (8, 16, 32), float64_relaxed={},
                 mixed_relaxed={"precision": "mixed"}),
    ),
    "wave": Case(
        "longitudinal wave in a bar",
        "error of the frequency",
        wave,
        _precise("length", (8, 16, 32, 64))
        | _lines("length", (8, 16, 32, 64), facet={"model": "facet"},
                 twice_the_step={"share": 0.8}),
    ),
    "hot block": Case(
        "undamped hot block to t = 200",
        "greatest change of the energy",
        hot_block,
        _precise("dt", (0.4, 0.2, 0.1, 0.05, 0.025)),
    ),
    "beam frequency": Case(
        "lowest frequency of a cantilever",
        "error of the frequency",
        beam_frequency,
        _lines("bonds", (8, 16, 32, 64, 128), float64={}),
    ),
    "spinning bar": Case(
        "stretch of a bar that spins",
        "error of the stretch",
        spinning_bar,
        _lines("bonds", (4, 8, 16, 32), float64={}, mixed={"precision": "mixed"},
               half_the_step={"share": 0.4}),
    ),
    "Kirsch": Case(
        "hole in a pulled plate",
        "rms error of the hoop stress",
        hole,
        _lines("radius", (3.0, 6.0, 12.0, 24.0), float64={}),
    ),
    "Hill": Case(
        "plastic cylinder (Hill)",
        "greatest error of the pressure",
        cylinder,
        _precise("radius", (5.0, 10.0, 20.0)),
    ),
    "crack speed": Case(
        "mode I crack",
        "change of speed/c_R to the finest run",
        crack_speed,
        _precise("refine", (0.5, 0.75, 1.0)) | _lines("refine", (2.0,), finest={}),
    ),
}  # fmt: skip

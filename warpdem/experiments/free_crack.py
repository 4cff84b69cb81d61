"""What experiments have in common whose cracks find their own way, without a weak plane."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from math import nan
from typing import Annotated, Any, ClassVar, TypeVar, Unpack

import numpy as np
from numpy.typing import NDArray

from .. import packing
from ..errors import Array, InputError, one_of, positive
from ..material import Material
from ..observe import CrackTracker, Snapshot
from ..observe.growth import Branch
from ..packing import Packing
from ..scene import Body, Scene
from ..simulation import Observer, Simulation
from ..write.log import UNITS
from ..write.whole import write_csv
from .shared import (
    Conduct,
    Options,
    Result,
    film,
    guard,
    run_numbers,
)

PACKINGS = ("hexagonal", "voronoi")
AXES = ("x", "y")
WINDOW = 10.0  # spacings of crack length over which a speed is fitted
NEAR = 4.0  # spacings from a notch's tip within which its crack starts
PICTURE = 0.6  # of the duration: when the field is taken
FILES = ("crack.png", "crack.usd", "broken_bonds.csv", "branches.csv", "run.json")
GRIP_LAYERS, GUARD_LAYERS = 2, 2
COLUMNS = (("branch", ""), ("time", "s"), ("distance", "m"), ("speed", "m/s"))


@dataclass(frozen=True)
class FreeCrack(ABC):
    """Material and elements of an experiment, SI units. The run lasts `duration` at most."""

    spacing: Annotated[float, "Distance of elements, m."] = 1e-3
    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "hexagonal"
    rows: Annotated[str, f"Axis of a lattice's close-packed rows: {', '.join(AXES)}."] = "x"
    seed: Annotated[int, "Seed of what is random."] = 0
    young: Annotated[float, "Young's modulus, Pa."] = 72e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.22
    density: Annotated[float, "Density, kg/m^3."] = 2440.0
    fracture_energy: Annotated[float, "G_c, J/m^2."] = 3.8
    duration: Annotated[float, "Time simulated, s."] = 100e-6

    name: ClassVar[str]
    title: ClassVar[str]
    plane: ClassVar[str] = "strain"
    files: ClassVar[tuple[str, ...]] = FILES
    ends: ClassVar[tuple[Observer, ...]] = ()  # that may end the run earlier
    size: ClassVar[tuple[float, float]]

    def __post_init__(self) -> None:
        one_of("packing", self.packing, PACKINGS)
        one_of("rows", self.rows, AXES)
        for name in ("spacing", "fracture_energy", "duration"):
            positive(name, getattr(self, name), ())
        if self.spacing > 0.05 * min(self.size):
            raise InputError(
                f"spacing is {self.spacing:g} m; twenty elements across the plate's "
                f"{min(self.size):g} m take {0.05 * min(self.size):g} m or less."
            )

    @property
    def material(self) -> Material:
        """The plate's material."""
        return Material(self.young, self.poisson, self.density)

    def fill(self) -> Packing:
        """The plate's elements, without notches."""
        if self.packing == "voronoi":
            return packing.voronoi(self.size, self.spacing, self.plane, seed=self.seed)
        return packing.hexagonal(self.size, self.spacing, self.plane, rows=self.rows)

    @property
    @abstractmethod
    def tip(self) -> tuple[float, float]:
        """Tip of the notch [m]."""

    @abstractmethod
    def build(self, plate: Packing) -> tuple[Scene, Body]:
        """The scene of elements."""

    @property
    def expected(self) -> Expected:
        """What a picture shows beside what was found."""
        return Expected()

    def measure(self, run: CrackRun) -> dict[str, Any]:
        """Numbers of the result beside those of `FreeCrackResult`."""
        return {}


@dataclass(frozen=True)
class Expected:
    """Published facts of an experiment that its picture shows: notches (n, 2, 2) [m], lines [m],
    levels of speed over Rayleigh's, times [s] as ranges, each under the words that say what it is.
    """

    notches: tuple[tuple[tuple[float, float], tuple[float, float]], ...] = ()
    lines: dict[str, Array] = field(default_factory=dict)
    levels: dict[str, float] = field(default_factory=dict)
    times: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass
class FreeCrackResult(Result):
    """What came out of a crack that found its own way. Speeds are over Rayleigh's of its plane.

    start_time [s]: of the crack at the notch; crack_length [m]: of its longest branch;
    median_over_rayleigh, fastest_over_rayleigh: of windows of that branch, the latter the speed
    that a tenth of them exceed; branching_time [s]: when a second branch left it, NaN if none did;
    branches: all of them, longest first of every crack: parent, start and end [m], length [m],
    when it began and ended [s], its median speed.
    """

    start_time: float
    crack_length: float
    median_over_rayleigh: float
    fastest_over_rayleigh: float
    branching_time: float
    rayleigh_speed: float
    branches: list[dict[str, Any]]
    speeds: NDArray[np.void] = field(repr=False)
    crack: CrackTracker = field(repr=False)
    field: Snapshot = field(repr=False)

    objects = ("simulation", "crack", "field", "speeds")

    @property
    def told(self) -> list[str]:
        """The result in words, line by line."""
        if not np.isfinite(self.start_time):
            return ["no crack started at the notch"]
        lines = [
            f"crack at the notch: start {self.start_time * 1e6:.4g} µs, length "
            f"{self.crack_length * 1e3:.3g} mm, median speed {self.median_over_rayleigh:.3f} of "
            f"the Rayleigh speed {self.rayleigh_speed:.0f} m/s"
        ]
        if np.isfinite(self.branching_time):
            lines.append(f"branching at {self.branching_time * 1e6:.4g} µs")
        return lines


@dataclass
class CrackRun:
    """An experiment that has run: branches of the crack at the notch, longest first, maybe none;
    the plain numbers of `FreeCrackResult`; all breaks; the simulation."""

    own: list[Branch]
    numbers: dict[str, Any]
    crack: CrackTracker
    sim: Simulation


R = TypeVar("R", bound="FreeCrackResult")


def free_crack(p: FreeCrack, kind: type[R], **options: Unpack[Options]) -> R:
    """Run an experiment.

    kind: of its result; options: `shared.Options`; FILES are written. Raises InputError for
    parameters that cannot be run.
    """
    run = Conduct(**options)
    run.say("building the packing")
    scene, body = p.build(p.fill())
    size = f"plate {p.size[0] * 1e3:g} x {p.size[1] * 1e3:g} mm, plane {p.plane}"
    sim = run.build(scene, size)
    crack = CrackTracker(every=20)
    picture = Snapshot(lambda s: s.time >= PICTURE * p.duration, stress=True)
    likely = round(p.duration / sim.dt)
    run.foresee(sim, likely)
    run.watch(sim, crack, (crack, picture, *p.ends), film("crack.usd", likely // run.frames))
    sim.run(until=p.duration)

    found = crack.branches()
    rayleigh = p.material.rayleigh_speed(p.plane)
    speeds = branch_speeds(found, WINDOW * p.spacing)
    own = crack_at(found, p.tip, NEAR * p.spacing)
    numbers = _numbers(found, own, speeds, rayleigh) | {"rayleigh_speed": rayleigh}
    numbers |= p.measure(CrackRun(own, numbers, crack, sim))
    result = kind(
        **run_numbers(sim), **numbers, speeds=speeds, crack=crack,
        field=picture, branches=[_told(b, found, speeds, rayleigh) for b in found],
    )  # fmt: skip
    if run.where is not None:
        from ..write.picture import draw_free_crack

        draw_free_crack(
            run.where / "crack.png",
            f"{p.title}: {result.elements} elements ({p.packing}), {sim.precision}",
            body.packing.position,
            picture,
            crack.log,
            speeds,
            rayleigh,
            vars(p.expected),
        )
        write_csv(run.where / "broken_bonds.csv", crack.log, UNITS)
        write_csv(run.where / "branches.csv", speeds, {n: u for n, u in COLUMNS if u})
    run.close(p.name, p, result)
    return result


def grip(scene: Scene, body: Body) -> None:
    """Hold a strip's outermost layers, below and above, and keep the bonds beside them."""
    grips = [body.packing.side(side, GRIP_LAYERS) for side in ("bottom", "top")]
    for one in grips:
        scene.hold(body, one)
    guard(body, grips[0] | grips[1], GUARD_LAYERS)


def crack_at(branches: list[Branch], tip: tuple[float, float], near: float) -> list[Branch]:
    """Branches of the crack that passes near a notch's tip [m], longest first; maybe none."""
    away = [float(np.linalg.norm(b.path - np.array(tip), axis=1).min()) for b in branches]
    if not away or min(away) > near:
        return []
    crack = branches[int(np.argmin(away))].crack
    return [b for b in branches if b.crack == crack]


def branch_speeds(branches: list[Branch], window: float) -> NDArray[np.void]:
    """Speeds of all branches in windows of length: COLUMNS, in the order of branches."""
    rows = []
    for number, branch in enumerate(branches):
        for distance, speed in zip(*branch.speeds(window), strict=True):
            near = np.abs(branch.distance - distance) <= 0.5 * window
            rows.append((number, float(np.median(branch.time[near])), distance, speed))
    kinds = [(n, int if n == "branch" else float) for n, _ in COLUMNS]
    return np.array(rows, dtype=kinds)


def _numbers(
    branches: list[Branch], own: list[Branch], speeds: NDArray[np.void], rayleigh: float
) -> dict[str, Any]:
    """The plain numbers of `FreeCrackResult`, NaN where the crack did not run."""
    if not own:
        names = ("start_time", "median_over_rayleigh", "fastest_over_rayleigh", "branching_time")
        return dict.fromkeys(names, nan) | {"crack_length": 0.0}
    main = next(k for k, b in enumerate(branches) if b is own[0])
    speed = speeds["speed"][speeds["branch"] == main] / rayleigh
    later = [float(b.time.min()) for b in own[1:]]
    return {
        "start_time": min(float(b.time.min()) for b in own),
        "crack_length": own[0].length,
        "median_over_rayleigh": float(np.median(speed)) if len(speed) else nan,
        "fastest_over_rayleigh": float(np.quantile(speed, 0.9)) if len(speed) else nan,
        "branching_time": min(later, default=nan),
    }


def _told(
    b: Branch, branches: list[Branch], speeds: NDArray[np.void], rayleigh: float
) -> dict[str, Any]:
    """A branch as run.json keeps it."""
    number = next(k for k, other in enumerate(branches) if other is b)
    speed = speeds["speed"][speeds["branch"] == number] / rayleigh
    return {
        "crack": b.crack,
        "parent": b.parent,
        "start": b.path[0],
        "end": b.tip,
        "length": b.length,
        "began": float(b.time.min()),
        "ended": float(b.time.max()),
        "median_over_rayleigh": float(np.median(speed)) if len(speed) else nan,
    }

"""Virtual tests of rock: what they have in common.

A test builds a scene with two grips that move apart or together so slowly that the specimen stays
near rest, and is over when the force has fallen. Tests are `specimen.py`'s and `brazilian.py`'s.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from math import asin, degrees, inf, isfinite, nan
from pathlib import Path
from typing import Annotated, Any, ClassVar, Unpack

import numpy as np
from numpy.typing import NDArray

from ..criteria import Criterion, DruckerPrager
from ..errors import Array, InputError, ModelWarning, finite, one_of, positive
from ..material import Material
from ..observe import FracturePlane, StressStrain, When, fracture_plane
from ..packing import Mask, Packing
from ..scene import Body, Scene
from ..simulation import Observer, Simulation
from ..write.log import UNITS
from ..write.whole import write_csv
from .material_point import material_strength
from .shared import (
    Conduct,
    Options,
    Result,
    Rolling,
    film,
    guard,
    run_numbers,
)

PLANES = ("stress", "strain", "space")
PACKINGS = ("voronoi", "hexagonal", "fcc")
PAST = 1.25  # times the strain at the peak: then a run is over
LONGEST = 1.25  # times the load's way to the criterion's strength: then the run is over
UNEXPLAINED = 1e-3  # of the energy: more is told
ELASTIC = (0.1, 0.5)  # of the peak: where moduli are read, if no more than
FEW = 1e-3  # of the bonds are broken
TANGENT = 0.05  # of the strength: by which a pressure is varied for its slope
BAND = 4.0  # width of a band of broken bonds, in spacings
FALLEN = 0.85  # of the peak: bonds broken until then make the fracture plane
SANDSTONE = DruckerPrager(compression=50e6, ratio=5.0)
FILES = ("test.png", "scene.usd", "stress_strain.csv", "broken_bonds.csv", "run.json")


@dataclass(frozen=True)
class Rock(ABC):
    """Material, elements and loading of a test. SI units.

    The strengths of bonds are the criterion's times random factors of Weibull's distribution of
    modulus `weibull` (infinite: none), without which a homogeneous specimen breaks everywhere at
    once. The load grows to the strength of the criterion while a pressure wave crosses the specimen
    `crossings` times, with local damping; the run ends when the force has fallen to `stop` of its
    peak, a quarter more strain after it, or when a loose element has rolled over.
    """

    spacing: Annotated[float, "Distance of elements, m."] = 1e-3
    plane: Annotated[str, f"State: {', '.join(PLANES)}."] = "stress"
    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "voronoi"
    seed: Annotated[int, "Seed of the Voronoi packing and of strengths."] = 0
    young: Annotated[float, "Young's modulus, Pa."] = 20e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.2
    density: Annotated[float, "Density, kg/m^3."] = 2300.0
    criterion: Annotated[
        Criterion, "When a bond breaks: a name and numbers, such as drucker-prager:50e6,5."
    ] = SANDSTONE
    weibull: Annotated[float, "Weibull modulus of the strengths of bonds; inf: all alike."] = 20.0
    crossings: Annotated[float, "Crossings of a pressure wave in the time of loading."] = 60.0
    damping: Annotated[float, "Local damping, 0 to below 1."] = 0.4
    stop: Annotated[float, "Share of the peak at which the run ends."] = 0.5

    name: ClassVar[str]
    title: ClassVar[str]
    files: ClassVar[tuple[str, ...]] = FILES
    stress_name: ClassVar[str] = "axial stress"
    sign: ClassVar[float]  # of the stress between the grips

    def __post_init__(self) -> None:
        one_of("plane", self.plane, PLANES)
        allowed = {"voronoi", "fcc" if self.plane == "space" else "hexagonal"}
        one_of(f"packing in plane {self.plane}", self.packing, sorted(allowed, reverse=True))
        for name in ("spacing", "crossings", "weibull"):
            value = getattr(self, name)
            if name != "weibull" or np.isfinite(value):
                positive(name, value, ())
        if not 0.0 < finite("stop", self.stop, ()) < 1.0:
            raise InputError(f"stop is {self.stop:g}; give a share between 0 and 1.")

    @property
    def material(self) -> Material:
        """The rock's material."""
        return Material(self.young, self.poisson, self.density)

    @property
    def state(self) -> str | None:
        """The plane as packings call it."""
        return None if self.plane == "space" else self.plane

    @property
    def dim(self) -> int:
        """Dimension of space."""
        return 3 if self.plane == "space" else 2

    @property
    @abstractmethod
    def axis(self) -> int:
        """Axis of the load."""

    @abstractmethod
    def build_packing(self) -> Packing:
        """The specimen's elements."""

    @abstractmethod
    def rig(self, packing: Packing) -> Rig:
        """The scene of the test."""

    def strength(self, direction: Array, start: Array | None = None) -> float:
        """The criterion's own, in a homogeneous stress."""
        return material_strength(
            self.criterion, self.material, self.state, direction, start, self.spacing
        )

    def along(self, value: float = 1.0) -> Array:
        """A vector along the load."""
        vector: Array = np.zeros(self.dim)
        vector[self.axis] = value
        return vector

    def break_angle(self, pressure: float, strength: float) -> float:
        """Angle of shear planes to the axis of compression, 45 degrees - phi/2.

        phi is that of the criterion's strength against the pressure on the sides, at this pressure
        [Pa], where it bears `strength` [Pa] more.
        """
        more = TANGENT * strength
        further = self.strength(self.along(-1.0), np.full(self.dim, -pressure - more))
        slope = 1.0 + (further - strength) / more
        if not isfinite(slope) or slope <= 0.0:
            return nan
        return 45.0 - 0.5 * degrees(asin((slope - 1.0) / (slope + 1.0)))


@dataclass
class Rig:
    """The scene of a test, and what is read of it.

    low, high: gripped elements; guarded: layers beside them whose bonds do not break; axis of the
    load; area [m^2]: what their force is divided by; core:
    elements whose stress and strain give the moduli; strength [Pa]: the criterion's, as stress of
    the grips, in the direction of the load; loading [s]: until it is reached; strain_rate [1/s];
    size: in words; angle [degrees]: at which the fracture plane is expected; stop: share of the
    peak at which the run ends. `history` reads the grips while the test runs.
    """

    scene: Scene
    body: Body
    low: Mask
    high: Mask
    guarded: int
    axis: int
    area: float
    core: Mask
    strength: float
    loading: float
    strain_rate: float
    size: str
    angle: float
    stop: float
    history: StressStrain = field(init=False)

    def __post_init__(self) -> None:
        axis = "xyz"[self.axis]
        self.history = StressStrain(
            self.body, self.low, self.high, axis, self.area, self.core, stop=self.stop, past=PAST
        )


@dataclass
class RockResult(Result):
    """What came out of a test. Stresses in Pa, positive in the direction of the load.

    strength: greatest stress; criterion_strength: the criterion's own in the homogeneous stress of
    the specimen (in a Brazilian test of its centre), without scatter; first_break_stress: when the
    first bond broke; strain_at_strength: of the grips; young [Pa] and poisson: of the core at
    first; strain_rate [1/s]; tensile_breaks, shear_breaks: of broken bonds, by the greater of
    normal and shear stress; fracture_angle: between the plane of fracture and the axis of the load
    [degrees], by bonds broken until the stress had fallen to 0.85 of the peak, with the share of
    them that lie in that band; expected_angle: in compression 45 degrees - phi/2, phi being that of
    the criterion's strength against the pressure on the sides.
    """

    strength: float
    criterion_strength: float
    first_break_stress: float
    strain_at_strength: float
    young: float
    poisson: float
    strain_rate: float
    tensile_breaks: int
    shear_breaks: int
    fracture_angle: float
    band_share: float
    expected_angle: float
    parameters: Rock = field(repr=False)
    history: StressStrain = field(repr=False)
    log: NDArray[np.void] = field(repr=False)
    plane: FracturePlane | None = field(repr=False)

    objects = ("simulation", "parameters", "history", "log", "plane")

    @property
    def break_strain(self) -> Array:
        """Strain of the grips at which each bond of the log broke, in the direction of the load."""
        h = self.history
        return np.interp(self.log["time"], h.time, self.parameters.sign * h.strain)

    @property
    def volumetric_strain(self) -> Array:
        """Of the core, (t,), tension positive; in plane stress with what Hooke's law gives across
        the plate."""
        total: Array = self.history.gauge_strain.sum(axis=1)
        if self.parameters.plane == "stress":
            across = self.history.core_stress - self.history.core_stress[0]
            total = total - self.parameters.poisson / self.parameters.young * across.sum(axis=1)
        return total


def rock_test(
    p: Rock,
    **options: Unpack[Options],
) -> RockResult:
    """Make a test.

    Writes test.png, scene.usd, stress_strain.csv, broken_bonds.csv and run.json; options:
    `shared.Options`. Raises InputError for parameters that cannot be run.
    """
    run = Conduct(**options)
    run.say("building the packing")
    packing = p.build_packing()
    run.say("finding the strength of the criterion in homogeneous stress")
    rig = p.rig(packing)
    guard(rig.body, rig.low | rig.high, rig.guarded)
    if isfinite(p.weibull):
        rig.scene.scatter_strength(rig.body, p.weibull, p.seed)
    sim = run.build(rig.scene, rig.size, p.damping)
    history = rig.history
    likely = round(rig.loading / sim.dt)
    run.foresee(
        sim,
        likely,
        f"; the criterion breaks at {rig.strength / 1e6:.4g} MPa, reached at a strain rate of "
        f"{rig.strain_rate:.3g} 1/s",
    )

    def frames(where: Path) -> Observer:
        due = _Film(likely, len(packing.bonds), run.frames)
        return When(film("scene.usd", history.every)(where), due, every=history.every)

    run.watch(sim, rig, (history, Rolling()), frames)
    sim.run(until=LONGEST * rig.loading)

    result = _result(p, rig, sim)
    if abs(result.energy_error) > UNEXPLAINED:
        warnings.warn(
            f"the energy ledger leaves {result.energy_error:.2g} of the energy unexplained: the "
            "specimen is in loose pieces, in whose contacts nothing is to be trusted; end the run "
            "earlier, by a greater stop.",
            ModelWarning,
            stacklevel=3,
        )
    if run.where is not None:
        from ..write.specimen import draw_test

        draw_test(
            run.where / "test.png",
            _title(p, result),
            packing,
            history,
            result.volumetric_strain,
            result.log,
            result.break_strain,
            result.plane,
            sim.displacement,
            p.sign,
            p.stress_name,
            rig.strength,
        )
        write_csv(run.where / "stress_strain.csv", _table(result), {k: u for k, u in TABLE if u})
        write_csv(run.where / "broken_bonds.csv", result.log, UNITS)
    run.close(p.name, p, result)
    return result


def check_breaks(strength: float, p: Rock) -> float:
    """The criterion's strength; refuse one that is never reached."""
    if not isfinite(strength):
        raise InputError(
            f"the criterion never breaks under this load in plane {p.plane}: Drucker-Prager's does "
            "not in plane strain or between two pressures where its ratio is high; lower the "
            "ratio, or take plane='stress' or 'space'."
        )
    return strength


class _Film:
    """When the film has a frame: evenly while the load grows, and whenever bonds have broken."""

    has_records = True  # which a checkpoint keeps

    def __init__(self, steps: int, bonds: int, frames: int) -> None:
        self.every, self.many = max(1, 2 * steps // frames), max(1, bonds // (8 * frames))
        self.step, self.broken = -self.every, 0

    def __call__(self, sim: Simulation) -> bool:
        broken = len(sim.broken_bonds())
        due = sim.steps >= self.step + self.every or broken >= self.broken + self.many
        if due:
            self.step, self.broken = sim.steps, broken
        return due


def _result(p: Rock, rig: Rig, sim: Simulation) -> RockResult:
    history = rig.history
    log, peak = sim.broken_bonds(), history.peak
    stress = p.sign * history.stress
    young, poisson = _moduli(p, history)
    # bonds broken until the stress has fallen a little
    low = FALLEN * (stress[peak] - stress[0]) + stress[0]
    fallen = np.flatnonzero(stress[peak:] <= low)
    end = history.time[peak + fallen[0]] if len(fallen) else inf
    early = log[log["time"] <= end]
    place = np.stack([early[c] for c in "xyz"[: p.dim]], axis=1)
    plane = fracture_plane(place, rig.body.packing.position, BAND * p.spacing)
    first = np.interp(log["time"][0], history.time, stress) if len(log) else nan
    return RockResult(
        **run_numbers(sim),
        strength=float(stress[peak]),
        criterion_strength=rig.strength,
        first_break_stress=float(first),
        strain_at_strength=float(p.sign * history.strain[peak]),
        young=young,
        poisson=poisson,
        strain_rate=rig.strain_rate,
        tensile_breaks=int((log["mode"] == "normal").sum()),
        shear_breaks=int((log["mode"] == "shear").sum()),
        fracture_angle=nan if plane is None else plane.angle_to(p.along()),
        band_share=nan if plane is None else plane.share,
        expected_angle=rig.angle,
        parameters=p,
        history=history,
        log=log,
        plane=plane,
    )


def _moduli(p: Rock, history: StressStrain) -> tuple[float, float]:
    """Young's modulus [Pa] and Poisson's ratio of the core while the load is small."""
    change = np.abs(history.stress - history.stress[0])
    share = change[: history.peak + 1] / change[history.peak]
    whole = history.broken[: history.peak + 1] <= FEW * len(history.body.packing.bonds)
    chosen = (share >= ELASTIC[0]) & (share <= ELASTIC[1]) & whole
    if chosen.sum() < 3:
        return nan, nan
    stress, strain = (
        (x[: history.peak + 1][chosen] - x[: history.peak + 1][chosen][0]).ravel()
        for x in (history.core_stress, history.gauge_strain)
    )
    # Hooke's law, strain = stress/E - nu/E (sum of the others)
    both = stress.reshape(-1, p.dim).sum(axis=1).repeat(p.dim)
    compliance, cross = np.linalg.lstsq(np.stack([stress, stress - both], axis=1), strain)[0]
    young, nu = 1.0 / compliance, cross / compliance
    if p.plane == "strain":  # these are E/(1 - nu^2) and nu/(1 - nu)
        nu = nu / (1.0 + nu)
        young *= 1.0 - nu * nu
    return float(young), float(nu)


TABLE = (
    ("time", "s"),
    ("axial_stress", "Pa"),
    ("axial_strain", ""),
    ("gauge_axial_strain", ""),
    ("gauge_lateral_strain", ""),
    ("volumetric_strain", ""),
    ("broken_bonds", ""),
)


def _table(result: RockResult) -> NDArray[np.void]:
    h, p = result.history, result.parameters
    gauge = h.gauge_strain
    others = [k for k in range(p.dim) if k != p.axis]
    columns: tuple[Any, ...] = (
        h.time, h.stress, h.strain, gauge[:, p.axis], gauge[:, others].mean(axis=1),
        result.volumetric_strain, h.broken,
    )  # fmt: skip
    rows = np.zeros(
        len(h.time), dtype=[(n, int if n == "broken_bonds" else float) for n, _ in TABLE]
    )
    for (name, _), column in zip(TABLE, columns, strict=True):
        rows[name] = column
    return rows


def _title(p: Rock, result: RockResult) -> str:
    state = "space" if p.plane == "space" else f"plane {p.plane}"
    return (
        f"{p.title}: {result.strength / 1e6:.3g} MPa; {result.elements} elements, {state}, "
        f"{result.simulation.precision}"
    )

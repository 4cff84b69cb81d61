"""A flyer plate meets a target, which spalls where the waves from both backs meet."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan
from typing import Annotated, ClassVar, Unpack

import numpy as np

from .. import packing
from ..criteria import Rankine
from ..errors import Array, InputError, positive, positive_or_inf
from ..friction import checked_friction
from ..material import Material
from ..moduli import lattice_bond
from ..scene import Scene
from ..write.chart import Chart, Line
from .shared import Options
from .trial import BREAKING, FILES, Run, Stage, Trial, TrialResult, run_trial

DAMPING = 0.2  # of the dashpots beside the bonds: fronts then do not ring
RINGS = 6.0  # crossings of the flyer, to and fro, that are waited for behind the front
SMALLEST_DIP = 0.02  # of the flyer's speed


@dataclass(frozen=True)
class Impact(Trial):
    """A flyer meets a resting target of the same material, in uniaxial strain.

    Both are a hexagonal lattice of EVM bonds in plane strain, cut where they meet; rollers guide
    their sides. Dashpots beside the bonds, a fifth of critical, keep fronts from ringing at the
    scale of elements. Strengths of bonds are scattered by Weibull's distribution.
    """

    flyer: Annotated[float, "Thickness of the flyer, m."] = 2e-3
    target: Annotated[float, "Thickness of the target, m."] = 6e-3
    width: Annotated[float, "Width of both, m."] = 6e-3
    spacing: Annotated[float, "Distance of elements, m."] = 1e-4
    speed: Annotated[float, "Speed of the flyer, m/s."] = 80.0
    young: Annotated[float, "Young's modulus, Pa."] = 70e9
    poisson: Annotated[float, "Poisson's ratio, up to 0.25."] = 0.25
    density: Annotated[float, "Density, kg/m^3."] = 2500.0
    strength: Annotated[float, "Tensile strength, Pa; inf: unbreakable."] = 100e6
    weibull: Annotated[float, "Weibull modulus of the strengths of bonds; inf: all alike."] = 20.0
    friction: Annotated[float, "Coulomb's friction between fragments."] = 0.3
    seed: Annotated[int, "Seed of the strengths."] = 0

    name = "impact"
    title = "Plate impact"
    files: ClassVar[tuple[str, ...]] = FILES + BREAKING

    def __post_init__(self) -> None:
        for name in ("flyer", "target", "width", "spacing", "speed"):
            positive(name, getattr(self, name), ())
        for name in ("strength", "weibull"):
            positive_or_inf(name, getattr(self, name))
        checked_friction(self.friction)
        if self.flyer < 10.0 * self.spacing or self.target < 1.5 * self.flyer:
            raise InputError(
                f"the flyer is {self.flyer / self.spacing:.3g} elements thick and the target "
                f"{self.target / self.flyer:.3g} times as thick; give 10 or more, and 1.5 or more."
            )

    @property
    def material(self) -> Material:
        """Of both plates."""
        return Material(self.young, self.poisson, self.density)

    @property
    def wave_speed(self) -> float:
        """Of pressure waves [m/s]."""
        return self.material.pressure_speed("strain")

    @property
    def peak_stress(self) -> float:
        """rho c v/2 [Pa], which the flyer sends into the target."""
        return 0.5 * self.density * self.wave_speed * self.speed

    def acoustic(self, time: Array) -> Array:
        """Speed of the target's back by acoustics, if nothing breaks [m/s]."""
        late = time - self.target / self.wave_speed
        within = (late > 0.0) & (late < 2.0 * self.flyer / self.wave_speed)
        return np.where(within, self.speed, 0.0)

    def stage(self) -> Stage:
        """The scene."""
        size = (self.flyer + self.target, self.width)
        p = packing.hexagonal(size, self.spacing, "strain")
        scene = Scene()
        strength = Rankine(self.strength) if isfinite(self.strength) else None
        bond = lattice_bond(p, self.material, damping=DAMPING)
        body = scene.add(p, self.material, bond=bond, fracture=strength)
        x, y = p.position.T
        scene.cut(body, [self.flyer, y.min() - 1.0], [self.flyer, y.max() + 1.0])
        if strength is not None and isfinite(self.weibull):
            scene.scatter_strength(body, self.weibull, self.seed)
        scene.contact(friction=self.friction)
        scene.set_velocity(body, [self.speed, 0.0], where=x < self.flyer)
        scene.hold(body, p.side("bottom") | p.side("top"), axes="y", rotation=False)
        back = p.side("right")
        mass = p.volume * self.density
        return Stage(
            scene=scene,
            until=(self.target + RINGS * 2.0 * self.flyer) / self.wave_speed,
            size=f"flyer {1e3 * self.flyer:g} mm at {self.speed:g} m/s, target "
            f"{1e3 * self.target:g} mm",
            columns={
                "back_speed": lambda sim: sim.velocity[back, 0].mean(),
                "momentum": lambda sim: float(mass @ sim.velocity[:, 0]),
                "broken_bonds": lambda sim: len(sim.broken_bonds()),
            },
            units={"back_speed": "m/s", "momentum": "kg m/s"},
            shows="mean_stress",
        )

    def measure(self, run: Run) -> ImpactResult:
        """What came out."""
        from scipy.signal import find_peaks

        series, sim = run.stage.series, run.sim
        time, speed = series["time"], series["back_speed"]
        c, cross = self.wave_speed, 2.0 * self.flyer / self.wave_speed
        # the last layer's centres lie half a spacing within
        arrival = (self.target - 0.5 * self.spacing) / c
        found = float(np.interp(0.5 * self.speed, *_rising(speed, time)))
        flat = (time > arrival + 0.35 * cross) & (time < arrival + 0.65 * cross)
        plateau = float(speed[flat].mean())
        late = time > arrival + 0.5 * cross
        dips = np.flatnonzero(late)[
            find_peaks(-speed[late], prominence=SMALLEST_DIP * self.speed)[0]
        ]
        drop = plateau - speed[dips[0]] if len(dips) else nan
        log = sim.broken_bonds()
        depth = self.flyer + self.target - log["x"] if len(log) else np.array([nan])
        ring = time[dips[1]] - time[dips[0]] if len(dips) > 1 else nan
        momentum = series["momentum"]
        return ImpactResult(
            **run.numbers,
            parameters=self,
            peak_stress=self.peak_stress,
            arrival=found,
            expected_arrival=arrival,
            plateau_over_speed=plateau / self.speed,
            pull_back=float(drop),
            pull_back_strength=0.5 * self.density * c * float(drop),
            spall_depth=float(np.median(depth)),
            spall_depth_over_flyer=float(np.median(depth)) / self.flyer,
            ring_depth_over_flyer=0.5 * c * float(ring) / self.flyer,
            momentum_error=float(np.abs(momentum / momentum[0] - 1.0).max()),
            pieces_at_end=1 if run.pieces is None else len(run.pieces.pieces),
        )


def _rising(speed: Array, time: Array) -> tuple[Array, Array]:
    """Speeds up to the first beyond 0.9 of the highest, each the highest so far, and times."""
    end = int(np.argmax(speed > 0.9 * speed.max())) + 1
    return np.maximum.accumulate(speed[:end]), time[:end]


@dataclass
class ImpactResult(TrialResult):
    """What came out.

    peak_stress: rho c v/2 [Pa]; arrival [s]: of half the flyer's speed at the last layer, beside
    acoustics; plateau_over_speed: of the back, 1 by acoustics; pull_back [m/s]: fall of its speed
    before it rises again, and pull_back_strength rho c pull_back/2 [Pa], which a long unloading
    would make the strength; spall_depth [m]: median of broken bonds from the back, 1 over the
    flyer's thickness by acoustics; ring_depth_over_flyer: the spall plate's thickness by the time
    between two dips; momentum_error: greatest change of momentum along the way.
    """

    peak_stress: float
    arrival: float
    expected_arrival: float
    plateau_over_speed: float
    pull_back: float
    pull_back_strength: float
    spall_depth: float
    spall_depth_over_flyer: float
    ring_depth_over_flyer: float
    momentum_error: float
    pieces_at_end: int

    @property
    def told(self) -> list[str]:
        """The result in words."""
        p = self.parameters
        lines = [
            f"the front arrives after {1e6 * self.arrival:.4g} us (acoustics "
            f"{1e6 * self.expected_arrival:.4g}); the back moves at {self.plateau_over_speed:.4f} "
            f"of the flyer's speed (1); momentum changes by {self.momentum_error:.1e}"
        ]
        if self.broken_bonds == 0:
            return [*lines, "nothing breaks"]
        return [
            *lines,
            f"spall at {self.spall_depth_over_flyer:.3f} of the flyer's thickness from the back "
            f"(1), {self.pieces_at_end} pieces; pull-back {self.pull_back:.3g} m/s, as of a "
            f"strength of {self.pull_back_strength / 1e6:.4g} MPa (given {p.strength / 1e6:g})",
        ]

    @property
    def charts(self) -> list[Chart]:
        """Speed of the back, and where bonds broke."""
        p, s = self.parameters, self.series
        time = 1e6 * s["time"]
        lines = [
            Line(time, s["back_speed"], "measured"),
            Line(time, p.acoustic(s["time"]), "acoustics, if nothing breaks", "--", "k"),
        ]
        if isfinite(p.strength) and p.strength < p.peak_stress:
            low = p.speed - 2.0 * p.strength / (p.density * p.wave_speed)
            lines.append(Line(time[[0, -1]], [low, low], "v - 2 strength/(rho c)", ":", "C3"))
        log = self.simulation.broken_bonds()
        width = np.arange(0.0, p.target + p.flyer, 2.0 * p.spacing)
        count, _ = np.histogram(p.flyer + p.target - log["x"], width)
        most = [0, max(1, count.max(initial=0))]
        return [
            Chart("Speed of the target's back", "time [µs]", "speed [m/s]", lines),
            Chart(
                "Where bonds broke", "distance from the target's back [mm]",
                "broken bonds in two layers", [
                    Line(1e3 * (width[:-1] + p.spacing), count, "measured", color="C3"),
                    Line([1e3 * p.flyer] * 2, most, "thickness of the flyer", "--", "k"),
                ],
            ),
        ]  # fmt: skip


def impact(parameters: Impact | None = None, **options: Unpack[Options]) -> ImpactResult:
    """A flyer plate spalls a target: speed of its back, depth and strength of the spall.

    options: `shared.Options`.
    """
    result: ImpactResult = run_trial(parameters or Impact(), **options)
    return result

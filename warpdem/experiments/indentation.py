"""A rigid cylinder is pressed into a block: by Hertz's law at first, then it crushes and cracks."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan, pi, sqrt
from typing import Annotated, ClassVar, Unpack

import numpy as np

from .. import packing, wall
from ..contact import touching_radius
from ..criteria import Criterion, DruckerPrager
from ..errors import Array, InputError, finite, positive, positive_or_inf
from ..friction import checked_friction
from ..material import Material
from ..observe import Series
from ..scene import Scene
from ..simulation import Simulation
from ..write.chart import Chart, Line
from .shared import Options, Rolling
from .trial import BREAKING, FILES, Run, Stage, Trial, TrialResult, run_trial

FEW = 1e-3  # of the bonds are broken when the block counts as broken
READ = (0.3, 0.9)  # of the force at the first break: where Hertz's law is read
DAMPING = 0.3
STOP = 0.7  # share of the greatest force at which the run ends


BRITTLE = DruckerPrager(compression=250e6, ratio=10.0)


@dataclass(frozen=True)
class Indentation(Trial):
    """A smooth rigid cylinder is pressed into a block in plane strain, held at its bottom.

    The block is a hexagonal lattice, whose surface is even. Strengths of bonds are scattered by
    Weibull's distribution; local damping of 0.3 keeps the block near rest. The run ends at `depth`,
    when the force has fallen to 0.7 of its greatest, or when a loose element has rolled over.
    """

    width: Annotated[float, "Width of the block, m."] = 60e-3
    height: Annotated[float, "Height of the block, m."] = 30e-3
    spacing: Annotated[float, "Distance of elements, m."] = 0.5e-3
    radius: Annotated[float, "Radius of the tool, m."] = 100e-3
    place: Annotated[float, "Of the tool along the block, over its width."] = 0.5
    depth: Annotated[float, "Depth at which the run ends, m."] = 0.15e-3
    speed: Annotated[float, "Speed of the tool, m/s."] = 2.0
    young: Annotated[float, "Young's modulus, Pa."] = 60e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.25
    density: Annotated[float, "Density, kg/m^3."] = 2600.0
    criterion: Annotated[
        Criterion, "When a bond breaks: a name and numbers, such as drucker-prager:50e6,5."
    ] = BRITTLE
    weibull: Annotated[float, "Weibull modulus of the strengths of bonds; inf: all alike."] = 20.0
    friction: Annotated[float, "Coulomb's friction between fragments."] = 0.3
    seed: Annotated[int, "Seed of the strengths."] = 0

    name = "indentation"
    title = "Indentation by a cylinder"
    files: ClassVar[tuple[str, ...]] = FILES + BREAKING

    def __post_init__(self) -> None:
        for name in ("width", "height", "spacing", "radius", "depth", "speed"):
            positive(name, getattr(self, name), ())
        positive_or_inf("weibull", self.weibull)
        checked_friction(self.friction)
        if not 0.0 < finite("place", self.place, ()) < 1.0:
            raise InputError(f"place is {self.place:g}; give it between 0 and 1.")
        if min(self.width, 2.0 * self.height) < 40.0 * self.spacing:
            raise InputError(
                f"the block is {self.width:g} x {self.height:g} m; at this spacing give at least "
                f"{40.0 * self.spacing:g} x {20.0 * self.spacing:g} m."
            )

    @property
    def material(self) -> Material:
        """Of the block."""
        return Material(self.young, self.poisson, self.density)

    @property
    def modulus(self) -> float:
        """E/(1 - nu^2) [Pa]."""
        return self.material.plane_modulus()

    def half_width(self, force: Array) -> Array:
        """Hertz's sqrt(4 P R/(pi E*)) under forces per thickness [N/m], [m]."""
        return np.sqrt(4.0 * np.maximum(force, 0.0) * self.radius / (pi * self.modulus))

    def hertz_depth(self, force: Array) -> Array:
        """Way of the tool towards a point `height` below it, in a half-space [m]
        (Johnson 1985, 5.57)."""
        half = np.maximum(self.half_width(force), 1e-12)
        nu = self.poisson
        depth: Array = force / (pi * self.modulus)
        return depth * (2.0 * np.log(2.0 * self.height / half) - nu / (1.0 - nu))

    def stage(self) -> Stage:
        """The scene."""
        size = (self.width, self.height)
        p = packing.hexagonal(size, self.spacing, "strain")
        scene = Scene()
        body = scene.add(p, self.material, fracture=self.criterion)
        if isfinite(self.weibull):
            scene.scatter_strength(body, self.weibull, self.seed)
        scene.hold(body, p.side("bottom"))
        scene.contact(friction=self.friction)
        # as low as no element is touched
        x, r = p.position, touching_radius(p)
        middle = float(x[:, 0].min() + self.place * np.ptp(x[:, 0]))
        reach = (self.radius + r) ** 2 - (x[:, 0] - middle) ** 2
        height = float((x[:, 1] + np.sqrt(np.maximum(reach, 0.0)))[reach > 0.0].max())
        tool = scene.wall(
            wall.Sphere([middle, height], self.radius), friction=0.0, velocity=[0.0, -self.speed]
        )

        def half_width(sim: Simulation) -> float:
            # the mean square of a semi-ellipse is a quarter of its half-width's
            force = np.maximum(sim.wall_forces(tool)[:, 1], 0.0)
            total = force.sum()
            away = sim.position[:, 0] - middle
            return 2.0 * sqrt(force @ away**2 / total) if total > 0.0 else 0.0

        stage = Stage(
            scene=scene,
            until=self.depth / self.speed,
            size=f"radius {1e3 * self.radius:g} mm, block {1e3 * self.width:g} x "
            f"{1e3 * self.height:g} mm",
            columns={
                "depth": lambda sim: self.speed * sim.time,
                "force": lambda sim: sim.wall_force(tool)[1],
                "half_width": half_width,
                "broken_bonds": lambda sim: len(sim.broken_bonds()),
            },
            units={"depth": "m", "force": "N", "half_width": "m"},
            damping=DAMPING,
        )
        stage.ends = (Rolling(), _Fallen(stage.series))
        return stage

    def measure(self, run: Run) -> IndentationResult:
        """What came out."""
        series = run.stage.series
        depth, force, half = (series[n] for n in ("depth", "force", "half_width"))
        whole = series["broken_bonds"] <= FEW * run.sim.model.bonds
        first = float(force[whole][-1]) if whole.any() else nan
        read = whole & (force > READ[0] * first) & (force < READ[1] * first)
        width_ratio = depth_ratio = nan
        if read.any():
            width_ratio = float((half[read] / self.half_width(force[read])).mean())
            depth_ratio = float((depth[read] / self.hertz_depth(force[read])).mean())
        a = float(self.half_width(np.array(first)))
        log = run.sim.broken_bonds()
        early = log["y"][: max(1, int(FEW * run.sim.model.bonds))]
        under = float(np.median(self.height - early)) if len(log) else nan
        return IndentationResult(
            **run.numbers,
            parameters=self,
            first_break_force=first,
            first_break_pressure=2.0 * first / (pi * a) if a > 0.0 else nan,
            first_break_depth=under / a,
            greatest_force=float(force.max()),
            half_width_over_hertz=width_ratio,
            depth_over_hertz=depth_ratio,
            elements_in_contact=2.0 * a / self.spacing,
            pieces_at_end=1 if run.pieces is None else len(run.pieces.pieces),
        )


class _Fallen:
    """Ends a run when the force has fallen for good: by the mean of the last looks."""

    every = 20

    def __init__(self, series: Series) -> None:
        self.series = series

    def observe(self, sim: Simulation) -> None:
        force = self.series["force"]
        if len(force) > 40 and force[-10:].mean() < STOP * force.max():
            sim.stop()

    def finish(self, sim: Simulation) -> None:
        pass


@dataclass
class IndentationResult(TrialResult):
    """What came out, forces for a metre of thickness.

    first_break_force [N] and first_break_pressure, Hertz's greatest under it [Pa]: when a
    thousandth of the bonds are broken; first_break_depth: median of these bonds below the surface,
    over Hertz's half-width; half_width_over_hertz, depth_over_hertz: measured over Hertz's at 0.3
    to 0.9 of that force; elements_in_contact: across it then; greatest_force [N].
    """

    first_break_force: float
    first_break_pressure: float
    first_break_depth: float
    greatest_force: float
    half_width_over_hertz: float
    depth_over_hertz: float
    elements_in_contact: float
    pieces_at_end: int

    @property
    def told(self) -> list[str]:
        """The result in words."""
        pieces = "in one piece" if self.pieces_at_end == 1 else f"{self.pieces_at_end} pieces"
        told = [
            f"elastic: half-width {self.half_width_over_hertz:.3f} of Hertz's, depth "
            f"{self.depth_over_hertz:.3f} of that of a half-space",
            f"greatest force {self.greatest_force / 1e6:.4g} MN/m; {pieces}",
        ]
        if np.isfinite(self.first_break_depth):  # else nothing broke
            told.insert(
                1,
                f"a thousandth of the bonds broke by {self.first_break_force / 1e6:.4g} MN/m, a "
                f"pressure of {self.first_break_pressure / 1e6:.4g} MPa, "
                f"{self.first_break_depth:.2f} half-widths deep",
            )
        return told

    @property
    def charts(self) -> list[Chart]:
        """Force against depth, and half-width against force."""
        p, s = self.parameters, self.series
        most = np.linspace(0.0, max(s["force"].max(), 1.0), 200)
        whole = s["broken_bonds"] <= FEW * self.bonds
        mega = 1e-6 * s["force"]
        return [
            Chart("Force on the tool", "depth [µm]", "force per metre of thickness [MN/m]", [
                Line(1e6 * s["depth"], mega, "measured"),
                Line(1e6 * p.hertz_depth(most), 1e-6 * most, "elastic half-space (Johnson)",
                     "--", "k"),
                Line([1e6 * s["depth"][whole][-1]], [mega[whole][-1]], "0.001 of the bonds broken",
                     "o", "C3"),
            ]),
            Chart("Half-width of contact, while all is whole", "force [MN/m]", "half-width [mm]", [
                Line(mega[whole], 1e3 * s["half_width"][whole], "measured"),
                Line(mega[whole], 1e3 * p.half_width(s["force"][whole]), "Hertz", "--", "k"),
            ]),
        ]  # fmt: skip


def indentation(
    parameters: Indentation | None = None, **options: Unpack[Options]
) -> IndentationResult:
    """Press a cylinder into a block: Hertz's contact, then crushing and cracks.

    options: `shared.Options`.
    """
    result: IndentationResult = run_trial(parameters or Indentation(), **options)
    return result

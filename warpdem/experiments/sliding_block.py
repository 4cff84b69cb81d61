"""A block slides on a plane and stops, or stays where it is."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, cos, degrees, nan, radians, sin
from typing import Annotated, Unpack

import numpy as np

from .. import packing
from ..contact import touching_radius
from ..errors import Array, InputError, finite, not_negative, positive
from ..friction import checked_friction
from ..material import Material
from ..moduli import lattice_bond
from ..scene import Scene
from ..write.chart import Chart, Line
from .shared import Options
from .trial import Run, Stage, Trial, TrialResult, run_trial


@dataclass(frozen=True)
class SlidingBlock(Trial):
    """A block slides down a plane, at first with `speed`, under gravity.

    It is a square lattice of Poisson's ratio 0. Dashpots beside its bonds, half of critical, calm
    what friction rouses in it; they take no momentum. The run lasts until the block should have
    stopped, and as long again; where it cannot stop, until it should have gone four of its lengths.
    """

    length: Annotated[float, "Length of the block, m."] = 0.1
    height: Annotated[float, "Height of the block, m."] = 0.05
    spacing: Annotated[float, "Distance of elements, m."] = 0.01
    speed: Annotated[float, "Speed at first, down the slope, m/s."] = 0.5
    friction: Annotated[float, "Coulomb's friction between block and plane."] = 0.4
    angle: Annotated[float, "Slope of the plane, degrees."] = 0.0
    gravity: Annotated[float, "Gravity, m/s^2."] = 9.81
    young: Annotated[float, "Young's modulus, Pa."] = 1e8
    density: Annotated[float, "Density, kg/m^3."] = 1000.0

    name = "sliding-block"
    title = "Sliding block"

    def __post_init__(self) -> None:
        for name in ("length", "height", "spacing", "gravity"):
            positive(name, getattr(self, name), ())
        not_negative("speed", self.speed)
        checked_friction(self.friction)
        if not 0.0 <= finite("angle", self.angle, ()) < 90.0:
            raise InputError(f"angle is {self.angle:g} degrees; give 0 to below 90.")
        if self.speed == 0.0 and self.angle == 0.0:
            raise InputError("the block has neither speed nor slope; give one of them.")

    @property
    def deceleration(self) -> float:
        """g (mu cos - sin) while it slides [m/s^2]; negative where it gets faster."""
        slope = radians(self.angle)
        return self.gravity * (self.friction * cos(slope) - sin(slope))

    @property
    def sliding_time(self) -> float:
        """Until it should stop, or should have gone four lengths [s]."""
        a = self.deceleration
        if a > 0.0:
            # from rest: the time in which it would fall its height
            return self.speed / a or (2.0 * self.height / self.gravity) ** 0.5
        if a == 0.0:
            return 4.0 * self.length / self.speed
        return ((self.speed**2 - 8.0 * a * self.length) ** 0.5 - self.speed) / -a

    def way(self, time: Array) -> Array:
        """Where the block should be at times [m]."""
        a = self.deceleration
        t = np.minimum(time, self.speed / a) if a > 0.0 else time
        way: Array = self.speed * t - 0.5 * a * t**2
        return way

    def stage(self) -> Stage:
        """The scene."""
        p = packing.square((self.length, self.height), self.spacing, "strain")
        material = Material(self.young, 0.0, self.density)
        scene = Scene()
        body = scene.add(p, material, bond=lattice_bond(p, material, damping=0.5))
        scene.contact(friction=self.friction)
        floor = (p.position[:, 1] - touching_radius(p)).min()
        plane = scene.wall([0.0, floor], [0.0, 1.0])
        slope = radians(self.angle)
        scene.set_gravity([self.gravity * sin(slope), -self.gravity * cos(slope)])
        scene.set_velocity(body, [self.speed, 0.0])
        mass = p.volume / p.volume.sum()
        start = float(mass @ p.position[:, 0])
        many = 2.0 if self.deceleration > 0.0 else 1.0
        return Stage(
            scene=scene,
            until=many * self.sliding_time,
            size=f"{self.length:g} x {self.height:g} m, {self.speed:g} m/s, "
            f"slope {self.angle:g} degrees, friction {self.friction:g}",
            columns={
                "way": lambda sim: mass @ sim.position[:, 0] - start,
                "speed": lambda sim: mass @ sim.velocity[:, 0],
                "pressing_force": lambda sim: -sim.wall_force(plane)[1],
                "friction_force": lambda sim: sim.wall_force(plane)[0],
            },
            units={"way": "m", "speed": "m/s", "pressing_force": "N", "friction_force": "N"},
            shows="velocity",
        )

    def measure(self, run: Run) -> SlidingBlockResult:
        """What came out."""
        time, way, speed = (run.stage.series[n] for n in ("time", "way", "speed"))
        stops = self.deceleration > 0.0
        slides = (time > 0.1 * self.sliding_time) & (time < 0.9 * self.sliding_time)
        found = expected = creep = nan
        if stops:
            expected = 0.5 * self.speed**2 / self.deceleration
            late = time > 1.1 * self.sliding_time
            found = float(way[late].mean())
            early, last = np.array_split(way[late], 2)
            creep = abs(float(last.mean() - early.mean()))
        pull = nan
        if self.speed > 0.0 or not stops:
            pull = -float(np.polyfit(time[slides], speed[slides], 1)[0])
        return SlidingBlockResult(
            **run.numbers,
            parameters=self,
            stopping_distance=found,
            expected_distance=expected,
            distance_error=found / expected - 1.0 if expected > 0.0 else nan,
            deceleration=pull,
            expected_deceleration=self.deceleration,
            creep=creep,
            friction_angle=degrees(atan(self.friction)),
        )


@dataclass
class SlidingBlockResult(TrialResult):
    """What came out.

    stopping_distance, expected_distance [m]: v^2/(2 g (mu cos - sin)), NaN where it cannot stop;
    deceleration [m/s^2]: of a straight line through the speed, beside g (mu cos - sin), which
    after a start from rest below the angle of friction is a bound; creep [m]: between the halves of
    its rest; friction_angle [degrees].
    """

    stopping_distance: float
    expected_distance: float
    distance_error: float
    deceleration: float
    expected_deceleration: float
    creep: float
    friction_angle: float

    @property
    def told(self) -> list[str]:
        """The result in words."""
        if np.isfinite(self.distance_error):
            first = (
                f"it stops after {1e3 * self.stopping_distance:.6g} mm; v^2/(2 g (mu cos - sin)) "
                f"is {1e3 * self.expected_distance:.6g} mm: {self.distance_error:+.1e}"
            )
        elif self.expected_deceleration > 0.0:
            first = f"it sticks, {1e3 * self.stopping_distance:.3g} mm from where it was set down"
        else:
            first = (
                f"it gets faster by {-self.deceleration:.6g} m/s^2; g (sin - mu cos) is "
                f"{-self.expected_deceleration:.6g}"
            )
        if np.isfinite(self.creep):
            first += f"; at rest it creeps by {self.creep:.1e} m"
        return [first]

    @property
    def charts(self) -> list[Chart]:
        """Way and speed, and forces."""
        p, s = self.parameters, self.series
        time = 1e3 * s["time"]
        forces = [
            Line(time, s["friction_force"], "friction force", color="C3"),
            Line(time, p.friction * s["pressing_force"], "friction number x pressing force", "--"),
        ]
        return [
            Chart("Way of the block", "time [ms]", "way down the plane [mm]", [
                Line(time, 1e3 * s["way"], "measured"),
                Line(time, 1e3 * p.way(s["time"]), "v t - g (mu cos - sin) t²/2", "--", "k"),
            ]),
            Chart("Forces on the plane", "time [ms]", "force per metre of width [N/m]", forces),
        ]  # fmt: skip


def sliding_block(
    parameters: SlidingBlock | None = None, **options: Unpack[Options]
) -> SlidingBlockResult:
    """A block slides on a plane: v^2/(2 mu g), and rest below the angle of friction.

    options: `shared.Options`.
    """
    result: SlidingBlockResult = run_trial(parameters or SlidingBlock(), **options)
    return result

"""The Brazilian test: a disc pressed across, so that its middle is pulled apart."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians, sin
from typing import Annotated, Unpack

import numpy as np

from .. import packing
from ..errors import InputError, finite, one_of, positive
from ..packing import Packing
from ..scene import Scene
from ..write.whole import unit_of
from .material_point import principal_strain
from .rock import Rig, Rock, RockResult, check_breaks, rock_test
from .shared import Options

GUARD_LAYERS = 3  # next to a jaw, whose pressure is no part of the test
CORE = 0.2  # of the radius: where stress and strain are read


@dataclass(frozen=True)
class Brazilian(Rock):
    """A disc between two jaws that press on arcs of it, a cylinder along z in space.

    The stress reported is 2P/(pi D t), that of point loads at the centre (Hertz 1883), where the
    compression across it is three times as large. arc: half the angle under a jaw; elements there
    move along y together, free along x and free to turn.
    """

    diameter: Annotated[float, "Diameter of the disc, m."] = 50e-3
    thickness: Annotated[float, "Thickness of the disc, m, in space."] = 10e-3
    arc: Annotated[float, "Half the angle of the arc under a jaw, degrees."] = 10.0

    name = "brazilian"
    title = "Brazilian test"
    stress_name = "2P/(pi D t)"
    sign = -1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("packing of a disc", self.packing, ("voronoi",))
        positive("diameter", self.diameter, ())
        positive("thickness", self.thickness, ())
        if not 2.0 <= finite("arc", self.arc, ()) <= 30.0:
            raise InputError(f"arc is {self.arc:g} degrees; give 2 to 30.")
        if self.diameter < 15.0 * self.spacing:
            raise InputError(
                f"the disc is {self.diameter / self.spacing:.3g} elements across; give 15 or more."
            )

    @property
    def axis(self) -> int:
        """Axis of the load, y."""
        return 1

    def build_packing(self) -> Packing:
        """The disc's elements."""
        radius = 0.5 * self.diameter
        if self.plane == "space":
            body = packing.Cylinder(radius, self.thickness)
            return packing.voronoi(body, self.spacing, None, seed=self.seed)
        return packing.voronoi(packing.Disc(radius), self.spacing, self.state, seed=self.seed)

    def rig(self, packing: Packing) -> Rig:
        """The scene of the test."""
        p, radius = packing, 0.5 * self.diameter
        centre = np.zeros(self.dim)
        centre[0], centre[1] = 1.0, -3.0  # stress of the centre over 2P/(pi D t)
        strength = check_breaks(self.strength(centre), self)
        loading = self.crossings * self.diameter / self.material.pressure_speed(self.state)
        # the disc gives about as much as its centre would along the whole of its diameter
        closing = abs(principal_strain(self.material, self.state, strength * centre)[1])

        scene = Scene()
        body = scene.add(p, self.material, fracture=self.criterion)
        x, y = p.position.T[:2]
        outer = p.side("outer" if self.dim == 2 else "side")
        under = outer & (np.abs(x) < np.abs(y) * np.tan(radians(self.arc)))
        low, high = under & (y < 0.0), under & (y > 0.0)
        if min(low.sum(), high.sum()) < 2:
            raise InputError("no two elements lie under a jaw; widen arc or reduce spacing.")
        for jaw, way in ((low, 1.0), (high, -1.0)):
            velocity = np.zeros(self.dim)
            velocity[1] = way * closing * radius / loading
            scene.hold(body, jaw, velocity, axes="y", rotation=False)
        smooth = np.zeros_like(p.position)
        smooth[:, 1] = -closing / loading * y
        scene.set_velocity(body, smooth)
        thickness = p.thickness if self.dim == 2 else self.thickness
        scale, unit = unit_of(self.diameter)
        return Rig(
            scene=scene, body=body, low=low, high=high, guarded=GUARD_LAYERS, axis=1,
            area=0.5 * pi * self.diameter * thickness,
            core=np.hypot(x, y) < CORE * radius, strength=strength, loading=loading,
            strain_rate=closing / loading, size=f"disc of {self.diameter * scale:g} {unit}",
            angle=0.0, stop=self.stop,
        )  # fmt: skip

    @property
    def arc_factor(self) -> float:
        """Tension at the centre over 2P/(pi D t) under even pressure on the arcs (Hondros 1959)."""
        half = radians(self.arc)
        return (sin(2.0 * half) - half) / half


def brazilian(parameters: Brazilian | None = None, **options: Unpack[Options]) -> RockResult:
    """Press a disc across until it splits: 2P/(pi D t), beside the tensile strength.

    options: `shared.Options`.
    """
    return rock_test(parameters or Brazilian(), **options)

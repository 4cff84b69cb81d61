"""Tests of a box or a cylinder between two grips: tension, compression, confined compression."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Unpack

import numpy as np

from .. import packing
from ..errors import Array, InputError, one_of, positive
from ..packing import Mask, Packing
from ..scene import Body, Scene
from ..write.whole import unit_of
from .material_point import principal_strain, side_factors
from .rock import Rig, Rock, RockResult, check_breaks, rock_test
from .shared import Options

SHAPES = ("box", "cylinder")
JACKETS = ("pressure", "servo")
GRIP_LAYERS, GUARD_LAYERS = 2, 1  # of fewer the stress beside them is too uneven
SERVO_SPEED = 20.0  # a jacket's greatest speed over that of the side while nothing breaks


@dataclass(frozen=True)
class Specimen(Rock):
    """A specimen, its axis y in the plane and z in space, between frictionless affine grips.

    Two layers of elements on either side move along the axis as a uniform strain would, free across
    it and free to turn. Where a pressure or a lattice's missing faces make the criterion see a
    wrong stress at the sides, bonds there are given the strength that makes up for it
    (`side_factors`). strain_rate: by default that of `crossings`.
    """

    width: Annotated[float, "Width or diameter, m."] = 40e-3
    height: Annotated[float, "Height along the load, m."] = 80e-3
    shape: Annotated[str, f"Of the cross-section: {', '.join(SHAPES)} (in space)."] = "box"
    strain_rate: Annotated[float | None, "Axial strain rate, 1/s, in place of crossings."] = None

    pressure: ClassVar[float] = 0.0  # on the sides [Pa]
    jacket: ClassVar[str] = "pressure"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("shape", self.shape, SHAPES)
        for name in ("width", "height"):
            positive(name, getattr(self, name), ())
        if self.strain_rate is not None:
            positive("strain_rate", self.strain_rate, ())
        if self.shape == "cylinder" and (self.plane != "space" or self.packing != "voronoi"):
            raise InputError("cylinders are Voronoi packings in space: say plane='space'.")
        least = 4 * (GRIP_LAYERS + GUARD_LAYERS) * self.spacing
        if self.height < least or self.width < 0.5 * least:
            raise InputError(
                f"the specimen is {self.width:g} x {self.height:g} m; at this spacing it must be "
                f"at least {0.5 * least:g} x {least:g} m, for grips and what lies between them."
            )

    @property
    def common(self) -> dict[str, Any]:
        """The parameters that all tests of a specimen have."""
        return {f.name: getattr(self, f.name) for f in fields(Specimen)}

    @property
    def axis(self) -> int:
        """Axis of the load, the last."""
        return self.dim - 1

    def build_packing(self) -> Packing:
        """The specimen's elements."""
        if self.shape == "cylinder":
            body = packing.Cylinder(0.5 * self.width, self.height)
            return packing.voronoi(body, self.spacing, None, seed=self.seed)
        size = (self.width,) * (self.dim - 1) + (self.height,)
        if self.packing == "voronoi":
            return packing.voronoi(size, self.spacing, self.state, seed=self.seed)
        if self.packing == "fcc":
            return packing.fcc(size, self.spacing)
        return packing.hexagonal(size, self.spacing, self.state or "stress")

    def rig(self, packing: Packing) -> Rig:
        """The scene of the test."""
        p, axis = packing, self.axis
        start = np.full(self.dim, -self.pressure)
        strength = check_breaks(self.strength(self.along(self.sign), start), self)
        strain = principal_strain(self.material, self.state, self.along(self.sign * strength))
        crossing = self.height / self.material.pressure_speed(self.state)
        loading = self.crossings * crossing
        if self.strain_rate is not None:
            loading = abs(strain[axis]) / self.strain_rate

        scene = Scene()
        body = scene.add(p, self.material, fracture=self.criterion)
        low, high, sides = _ends(p)
        ends = [p.side(name, GRIP_LAYERS) for name in (low, high)]
        grips = ends[0] | ends[1]
        # in motion from the start as it will be under the load, so that no wave is sent
        velocity = (p.position - _middle(p)) * strain / loading
        scene.strain(body, np.diag(principal_strain(self.material, self.state, start)))
        scene.set_velocity(body, velocity)
        along = np.zeros_like(velocity)
        along[:, axis] = velocity[:, axis]
        scene.hold(body, grips, along[grips], axes="xyz"[axis], rotation=False)
        lateral = np.any([p.side(name) for name in sides], axis=0)
        if self.pressure > 0.0 or self.packing != "voronoi":
            stress = start + self.along(self.sign * strength)
            body.strength_factor *= side_factors(p, self.material, self.criterion, stress, lateral)
        if self.pressure > 0.0:
            self._confine(scene, body, sides, grips, np.abs(velocity).max(axis=0))
        inner = np.abs(p.position - _middle(p))[:, axis] < 0.25 * self.height
        core = inner & ~lateral
        if core.sum() < 4 * self.dim:
            core = inner
        angle = 90.0 if self.sign > 0.0 else self.break_angle(self.pressure, strength)
        scale, unit = unit_of(self.height)
        edges = [self.width, self.height] if self.dim == 2 else [self.width] * 2 + [self.height]
        size = " x ".join(f"{e * scale:g}" for e in edges)
        return Rig(
            scene=scene, body=body, low=ends[0], high=ends[1], guarded=GUARD_LAYERS, axis=axis,
            area=float(p.volume.sum()) / self._length(p), core=core,
            strength=strength + self.pressure, loading=loading,
            strain_rate=float(abs(strain[axis]) / loading), size=f"specimen {size} {unit}",
            angle=angle, stop=self.stop,
        )  # fmt: skip

    def _length(self, p: Packing) -> float:
        """Length along the axis that the cells fill [m]; lattices are whole layers of them."""
        if self.packing == "voronoi":
            return self.height
        at = p.position[:, self.axis]
        layers = len(np.unique(np.rint(at / (0.1 * self.spacing))))
        return float(np.ptp(at)) * layers / (layers - 1)

    def _confine(
        self, scene: Scene, body: Body, sides: list[str], grips: Mask, speed: Array
    ) -> None:
        p = body.packing
        if self.jacket == "pressure":
            where = np.any([p.side(name) for name in sides], axis=0)
            across = "xyz"[: p.dim].replace("xyz"[self.axis], "")
            scene.press(body, where, self.pressure, axes=across)
            return
        for name in sides:
            axis = {"left": 0, "right": 0, "bottom": 1, "top": 1}[name]
            taken = grips | (body.held.any(axis=1))
            scene.servo(
                body, p.side(name) & ~taken, -self.pressure, "xyz"[axis], SERVO_SPEED * speed[axis]
            )


@dataclass(frozen=True)
class Tension(Specimen):
    """Direct tension."""

    name = "tension"
    title = "Direct tension"
    sign = 1.0


@dataclass(frozen=True)
class Compression(Specimen):
    """Uniaxial compression between frictionless platens."""

    name = "compression"
    title = "Uniaxial compression"
    sign = -1.0


@dataclass(frozen=True)
class Confined(Specimen):
    """Compression under a pressure on all sides, from the state of that pressure on.

    jacket: "pressure" keeps its direction and moves with nothing; "servo" is a rigid wall on each
    side of a box that moves so that its mean pressure is kept.
    """

    pressure: Annotated[float, "Confining pressure, Pa."] = 5e6  # type: ignore[misc]
    jacket: Annotated[str, f"What presses: {', '.join(JACKETS)}."] = "pressure"  # type: ignore[misc]

    name = "confined"
    title = "Confined compression"
    sign = -1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        positive("pressure", self.pressure, ())
        one_of("jacket", self.jacket, JACKETS)
        if self.jacket == "servo" and self.shape == "cylinder":
            raise InputError("a servo presses on flat sides; take jacket='pressure' or a box.")


def tension(parameters: Tension | None = None, **options: Unpack[Options]) -> RockResult:
    """Pull a specimen apart: tensile strength, moduli, plane of fracture.

    options: `shared.Options`.
    """
    return rock_test(parameters or Tension(), **options)


def compression(parameters: Compression | None = None, **options: Unpack[Options]) -> RockResult:
    """Press a specimen uniaxially: its unconfined compressive strength (UCS), moduli, shear bands.

    options: `shared.Options`.
    """
    return rock_test(parameters or Compression(), **options)


def confined(parameters: Confined | None = None, **options: Unpack[Options]) -> RockResult:
    """Press a specimen under a lateral pressure: the greatest axial stress, shear bands.

    options: `shared.Options`.
    """
    return rock_test(parameters or Confined(), **options)


def _ends(p: Packing) -> tuple[str, str, list[str]]:
    """Names of the sides at both ends of the axis, and of the others."""
    low, high = ("back", "front") if "front" in p.sides else ("bottom", "top")
    return low, high, [name for name in p.sides if name not in (low, high)]


def _middle(p: Packing) -> Array:
    middle: Array = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
    return middle

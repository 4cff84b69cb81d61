"""What experiments with a crack along a weak plane of a plate share."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from .. import packing
from ..errors import InputError, one_of, positive
from ..material import Material
from ..observe import CrackTracker, Snapshot
from ..observe.growth import Front
from ..packing import Packing
from ..scene import Body, Scene
from ..simulation import Simulation
from ..write.whole import unit_of, write_csv
from .shared import Conduct, film

FILES = ("crack.png", "crack.usd", "broken_bonds.csv", "run.json")
PACKINGS = ("hexagonal", "voronoi", "fcc")
SIDES = ("periodic", "free")
RATIO = 3.0  # compressive over tensile strength of the Drucker-Prager criterion
GRIP_LAYERS = 2
PLANE_SPACING, SPACE_SPACING = 1e-5, 2e-5  # m, by default
LAYERS = 4  # cubes of fcc through the thickness, by default
SLICE, INSTANTS = sqrt(2.0), 24  # distances of elements in a slice of the front; its pictures
THICKNESS = "Thickness, m, of a plate in space; none: plane strain. By default 4 cubes of fcc."
SIDES_HELP = f"Of a plate in space, across its thickness: {', '.join(SIDES)}."
SPACING = "Distance of elements, m; by default 1e-5, in space 2e-5."


class WeakPlane:
    """A plate with a weak plane in its middle; fields of the experiment's parameters are read.

    It lies in the plane, or in space if it has a thickness or is fcc. Its sides across the third
    axis then repeat, which is plane strain, or are free. The weak plane of fcc is (010), between
    two flat layers: the one that tip stresses are tabulated for (`Toughness`).
    """

    length: float
    height: float
    spacing: float | None
    thickness: float | None
    sides: str
    young: float
    poisson: float
    density: float
    packing: str
    seed: int

    def check_plate(self) -> None:
        """Refuse what makes no plate."""
        one_of("packing", self.packing, PACKINGS)
        one_of("sides", self.sides, SIDES)
        for name in ("length", "height", "spacing", "thickness"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), ())
        if self.packing == "hexagonal" and self.in_space:
            raise InputError(
                "hexagonal packings are of the plane; leave thickness out, or take fcc or voronoi."
            )
        object.__setattr__(self, "spacing", self.distance)
        if self.in_space:
            object.__setattr__(self, "thickness", self.size[2])

    @property
    def in_space(self) -> bool:
        """Whether the plate is in space."""
        return self.packing == "fcc" or self.thickness is not None

    @property
    def distance(self) -> float:
        """Distance of elements [m], given or by default."""
        return self.spacing or (SPACE_SPACING if self.in_space else PLANE_SPACING)

    @property
    def size(self) -> tuple[float, ...]:
        """Edges of the plate [m]."""
        plane = (self.length, self.height)
        return (
            (*plane, self.thickness or LAYERS * sqrt(2.0) * self.distance)
            if self.in_space
            else plane
        )

    @property
    def files(self) -> tuple[str, ...]:
        """Names of what is written."""
        return FILES + (("front.csv",) if self.in_space else ())

    @property
    def told_size(self) -> str:
        """The plate's size in words."""
        scale, unit = unit_of(self.length)
        return f"plate {' x '.join(f'{edge * scale:.4g}' for edge in self.size)} {unit}"

    @property
    def told_space(self) -> str:
        """What a title says of a plate in space."""
        return f", in space on {self.packing}, sides {self.sides}" if self.in_space else ""

    @property
    def layer(self) -> float:
        """Thickness of a layer of elements along the weak plane over their distance."""
        if not self.in_space:
            return 0.5 * sqrt(3.0)
        return sqrt(0.5) if self.packing == "fcc" else 2.0 ** (-1.0 / 6.0)

    @property
    def material(self) -> Material:
        """The plate's material."""
        return Material(self.young, self.poisson, self.density)

    def fill(self, spacing: float) -> Packing:
        """The plate's elements at a spacing [m]."""
        repeats = "z" if self.in_space and self.sides == "periodic" else False
        if self.packing == "voronoi":
            return packing.voronoi(self.size, spacing, seed=self.seed, periodic=repeats)
        if self.packing == "fcc":
            return packing.fcc(self.size, spacing, periodic=repeats)
        return packing.hexagonal(self.size, spacing)

    @property
    def plane_height(self) -> float:
        """Height of the weak plane [m]: between two rows, next to the middle."""
        pitch = self.layer * self.distance
        return (round(self.height / pitch) // 2) * pitch

    def weaken(self, scene: Scene, body: Body, elsewhere: float) -> None:
        """Multiply the strength of all bonds but the weak plane's."""
        weak = body.packing.crossing(self.at(-self.distance), self.at(self.length + self.distance))
        strength = body.strength_factor[weak]
        scene.set_strength(body, elsewhere)
        body.strength_factor[weak] = strength

    def at(self, x: float) -> tuple[float, ...]:
        """A place of the weak plane [m]."""
        return (x, self.plane_height, 0.0) if self.in_space else (x, self.plane_height)

    def strained(self, scene: Scene, body: Body, strain: Any) -> None:
        """Strain the plate, strain (2, 2) in its plane, and grip it above and below."""
        whole = np.zeros((body.packing.dim,) * 2)
        whole[:2, :2] = strain
        scene.strain(body, whole)
        for side in ("top", "bottom"):
            scene.hold(body, body.packing.side(side, GRIP_LAYERS))

    def front(self, crack: CrackTracker) -> Front | None:
        """The crack's front through the thickness of a plate in space."""
        if not self.in_space:
            return None
        slices = max(1, round(self.size[2] / (SLICE * self.distance)))
        return crack.front_at((0.0, 0.0, 1.0), slices, INSTANTS)


def write_front(where: Path, front: Front) -> None:
    """front.csv: where the front is in every slice at every instant."""
    rows = np.zeros(front.ahead.shape, dtype=[(name, float) for name in ("time", "z", "x")])
    rows["time"], rows["z"], rows["x"] = front.time[:, None], front.across, front.ahead
    write_csv(where / "front.csv", rows.ravel(), {"time": "s", "z": "m", "x": "m"})


def griffith_strain(material: Material, energy: float, height: float) -> float:
    """Strain across a strip of this height between its grips [m], in plane strain, at which the
    energy ahead of a long crack is `energy` [J/m^2] (Griffith)."""
    modulus = material.lame("strain") + 2.0 * material.shear_modulus
    return sqrt(2.0 * energy / (modulus * height))


def follow(
    run: Conduct,
    sim: Simulation,
    crack: CrackTracker,
    way: tuple[float, float],
    speed: float,
    note: str = "",
) -> tuple[Snapshot, float]:
    """Run until the crack has gone its way, from x to x [m]: the velocity field when its tip has
    made 0.6 of it, of a plate in space that of its middle plane, and where the tip was then [m].

    speed: about that of the crack [m/s], for what is told and for the frames of the USD scene.
    """
    start, end = way
    tip = start + 0.6 * (end - start)
    picture = Snapshot(lambda _: crack.tip >= tip)
    likely = round((end - start) / (speed * sim.dt))
    run.foresee(sim, likely, note)
    run.watch(sim, crack, (crack, picture), film("crack.usd", likely // run.frames))
    # the slowest crack that is waited for has less than half of Rayleigh's speed
    sim.run(until=2.5 * (end - start) / sim.scene.bodies[0].materials[0].rayleigh_speed("strain"))
    if picture.taken:  # the tip went on between two looks
        tip = float(crack.log["x"][crack.log["time"] <= picture.time].max())
    plate = sim.scene.bodies[0].packing
    if plate.dim == 3:
        z = plate.position[:, 2]
        picture = picture.slice(0.5 * float(z.min() + z.max()), 0.5 * plate.spacing)
    return picture, tip

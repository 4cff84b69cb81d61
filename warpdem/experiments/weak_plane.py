"""What experiments with a crack along a weak plane of a plate share."""

from __future__ import annotations

from math import sqrt

from .. import packing
from ..material import Material
from ..observe import CrackTracker, Snapshot
from ..packing import Packing
from ..simulation import Simulation
from .shared import Conduct, film

PACKINGS = ("hexagonal", "voronoi")
RATIO = 3.0  # compressive over tensile strength of the Drucker-Prager criterion
GRIP_LAYERS = 2


class WeakPlane:
    """A plate with a weak plane in its middle; fields of the experiment's parameters are read."""

    length: float
    height: float
    spacing: float
    young: float
    poisson: float
    density: float
    packing: str
    seed: int

    @property
    def material(self) -> Material:
        """The plate's material."""
        return Material(self.young, self.poisson, self.density)

    def fill(self, spacing: float) -> Packing:
        """The plate's elements at a spacing [m]."""
        size = (self.length, self.height)
        if self.packing == "voronoi":
            return packing.voronoi(size, spacing, seed=self.seed)
        return packing.hexagonal(size, spacing)

    @property
    def plane_height(self) -> float:
        """Height of the weak plane [m]: between two rows, next to the middle."""
        pitch = sqrt(3.0) / 2.0 * self.spacing
        return (round(self.height / pitch) // 2) * pitch


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
    made 0.6 of it, and where the tip was at that instant [m].

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
    return picture, tip

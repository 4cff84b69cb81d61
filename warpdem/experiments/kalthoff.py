"""The edge-cracked plate of Kalthoff and Winkler, hit between its notches (theory C3 row 36)."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, nan, radians, sin
from typing import Annotated, Any, Unpack

import numpy as np

from ..criteria import LinearSoftening, Rankine
from ..errors import positive
from ..observe.growth import path_angle
from ..packing import Packing
from ..scene import Body, Scene
from .free_crack import PACKINGS, CrackRun, Expected, FreeCrack, FreeCrackResult, free_crack
from .shared import Options, guard

SIZE, NOTCH, HALF = 0.1, 0.05, 0.025  # m: half plate, notch, its distance from the middle
RISE = 1e-6  # s, of the projectile's velocity (Borden et al. 2012)


@dataclass(frozen=True)
class Kalthoff(FreeCrack):
    """What is simulated. SI units.

    The upper half of a plate of maraging steel 200 mm high with two slots 50 mm long and 50 mm
    apart, in plane strain, its middle line held across; the edge between the slots moves at the
    projectile's velocity. A bond's stress falls linearly once its greatest principal stress
    exceeds the tensile strength, and it takes the fracture energy, as in the cohesive models of
    Belytschko, Chen, Xu and Zi (2003), whose material this is. Slots do not close: they have a
    width in the test.
    """

    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "voronoi"
    young: Annotated[float, "Young's modulus, Pa."] = 190e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.3
    density: Annotated[float, "Density, kg/m^3."] = 8000.0
    fracture_energy: Annotated[float, "G_c, J/m^2."] = 2.213e4
    strength: Annotated[float, "Tensile strength, Pa."] = 844e6
    speed: Annotated[float, "Of the hit edge, m/s."] = 16.5

    name = "kalthoff"
    title = "Kalthoff and Winkler's plate"
    size = (SIZE, SIZE)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("strength", "speed"):
            positive(name, getattr(self, name), ())

    @property
    def tip(self) -> tuple[float, float]:
        """Tip of the notch [m]."""
        return NOTCH, HALF

    def build(self, plate: Packing) -> tuple[Scene, Body]:
        """The plate with its slot, hit below it."""
        law = LinearSoftening(Rankine(self.strength), self.fracture_energy)
        plate = plate.slit((-SIZE, HALF), self.tip)
        scene = Scene()
        body = scene.add(plate, self.material, fracture=law)
        below = plate.position[:, 1] < HALF
        # neither projectile nor symmetry is a test of the bonds there
        hit, middle = plate.left & below, plate.bottom
        guard(body, hit | middle, 0)
        scene.hold(body, middle, axes="y")
        history = ([0.0, RISE], [0.0, 1.0])
        scene.hold(body, hit, (self.speed, 0.0), axes="x", rotation=False, history=history)
        return scene, body

    @property
    def expected(self) -> Expected:
        """Angle, start and speed that are published."""
        reach = SIZE - HALF
        ends = [
            np.array([[NOTCH, HALF], [NOTCH + reach * cos(a) / sin(a), SIZE]])
            for a in (radians(65.0), radians(70.0))
        ]
        notches = (((0.0, HALF), self.tip),)
        given = Kalthoff(self.spacing, self.packing, self.rows, self.seed, duration=self.duration)
        if self != given:  # of another plate or load
            return Expected(notches)
        return Expected(
            notches,
            lines={"published, 65 to 70 degrees": np.concatenate([ends[0], ends[1][::-1]])},
            levels={"published speeds lie below": 0.6},
            times={"published start": (20e-6, 29e-6)},
        )

    def measure(self, run: CrackRun) -> dict[str, Any]:
        """The crack's angle."""
        return {"angle_degrees": path_angle(run.own[0].path) if run.own else nan}


@dataclass
class KalthoffResult(FreeCrackResult):
    """What came out; angle_degrees: of the crack at the notch to the notch, by a robust fit to the
    whole of its path."""

    angle_degrees: float

    @property
    def told(self) -> list[str]:
        """The result in words."""
        return [*super().told, f"angle to the notch {self.angle_degrees:.1f} degrees"]


def kalthoff(parameters: Kalthoff | None = None, **options: Unpack[Options]) -> KalthoffResult:
    """Hit a plate between two notches and measure the angle at which cracks leave them.

    options: `shared.Options`.
    """
    return free_crack(parameters or Kalthoff(), KalthoffResult, **options)

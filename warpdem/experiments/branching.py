"""A crack in a glass plate that splits into branches (theory C3 rows 33 and 34)."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Annotated, Any, Unpack

import numpy as np

from ..criteria import Rankine
from ..errors import positive
from ..packing import Packing
from ..scene import Body, Scene
from ..toughness import Toughness
from .free_crack import PACKINGS, CrackRun, Expected, FreeCrack, FreeCrackResult, free_crack
from .shared import Options

SIZE, NOTCH = (0.1, 0.04), 0.05  # m


@dataclass(frozen=True)
class Branching(FreeCrack):
    """What is simulated. SI units.

    A plate of 100 x 40 mm in plane strain with a notch of 50 mm, both long edges pulled by a
    traction from time zero on: the benchmark of Borden et al. (2012), glass by its stiffness.
    Strength follows from G_c and the spacing (`Toughness`); a bond breaks by its greatest principal
    stress.
    """

    spacing: Annotated[float, "Distance of elements, m."] = 5e-4
    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "voronoi"
    young: Annotated[float, "Young's modulus, Pa."] = 32e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.2
    density: Annotated[float, "Density, kg/m^3."] = 2450.0
    fracture_energy: Annotated[float, "G_c, J/m^2."] = 3.0
    duration: Annotated[float, "Time simulated, s."] = 60e-6
    traction: Annotated[float, "On the long edges, Pa."] = 1e6

    name = "branching"
    title = "Branching crack"
    size = SIZE

    def __post_init__(self) -> None:
        super().__post_init__()
        positive("traction", self.traction, ())

    @classmethod
    def soda_lime(cls, **given: Any) -> Branching:
        """The same plate of soda-lime glass under 12 MPa (Ha and Bobaru 2010)."""
        glass = {
            "young": 72e9, "poisson": 0.22, "density": 2440.0, "fracture_energy": 135.0,
            "traction": 12e6, "duration": 40e-6,
        }  # fmt: skip
        return cls(**(glass | given))

    @property
    def tip(self) -> tuple[float, float]:
        """Tip of the notch [m]."""
        return NOTCH, 0.5 * SIZE[1]

    def build(self, plate: Packing) -> tuple[Scene, Body]:
        """The notched plate, pulled apart."""
        law = Toughness(Rankine(1.0), energy=self.fracture_energy)
        plate = plate.slit((-NOTCH, self.tip[1]), self.tip)
        scene = Scene()
        body = scene.add(plate, self.material, fracture=law)
        scene.pull(body, plate.top, (0.0, self.traction))
        scene.pull(body, plate.bottom, (0.0, -self.traction))
        return scene, body

    @property
    def expected(self) -> Expected:
        """Onset, and speed before it, that are published for the defaults."""
        given = Branching(self.spacing, self.packing, self.rows, self.seed, duration=self.duration)
        notches = (((0.0, self.tip[1]), self.tip),)
        if self != given:
            return Expected(notches)
        return Expected(
            notches,
            levels={"published speeds before lie below": 0.65},
            times={"published branching": (32e-6, 37e-6)},
        )

    def measure(self, run: CrackRun) -> dict[str, Any]:
        """Length over time up to the first branching: windows would see single steps."""
        own, numbers = run.own, run.numbers
        if len(own) < 2:
            return {"before_over_rayleigh": nan, "branch_count": len(own)}
        early = own[0].time < numbers["branching_time"]
        spent = numbers["branching_time"] - numbers["start_time"]
        grown = float(own[0].distance[early].max())
        return {
            "before_over_rayleigh": grown / spent / numbers["rayleigh_speed"],
            "branch_count": len(own),
        }


@dataclass
class BranchingResult(FreeCrackResult):
    """What came out; before_over_rayleigh: speed of the crack between its start and its first
    branching; branch_count: of the crack at the notch, the first included."""

    before_over_rayleigh: float
    branch_count: int

    @property
    def told(self) -> list[str]:
        """The result in words."""
        lines = super().told
        if np.isfinite(self.before_over_rayleigh):
            lines[-1] += f", at {self.before_over_rayleigh:.3f} of the Rayleigh speed before"
        return lines


def branching(parameters: Branching | None = None, **options: Unpack[Options]) -> BranchingResult:
    """Pull a notched glass plate apart until its crack branches: when, and how fast it was.

    options: `shared.Options`.
    """
    return free_crack(parameters or Branching(), BranchingResult, **options)

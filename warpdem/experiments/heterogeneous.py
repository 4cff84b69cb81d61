"""A tensile crack through a strip of uneven strength: its path roughens and it slows down."""

from __future__ import annotations

from dataclasses import dataclass
from math import gamma, isfinite, nan, pi, sqrt
from typing import Annotated, Any, Unpack

import numpy as np

from ..criteria import Rankine
from ..errors import Array, InputError, finite, positive, positive_or_inf
from ..observe.growth import path_angle
from ..packing import Packing
from ..scene import Body, Scene
from ..toughness import Toughness
from .free_crack import (
    GRIP_LAYERS,
    CrackRun,
    Expected,
    FreeCrack,
    FreeCrackResult,
    free_crack,
    grip,
)
from .shared import Options
from .weak_plane import griffith_strain

SIZE, NOTCH = (2e-3, 1.05e-3), 0.25e-3  # m


@dataclass(frozen=True)
class Heterogeneous(FreeCrack):
    """What is simulated. SI units.

    A strip of glass of 2 x 1.05 mm in plane strain, strained across a notch and gripped above and
    below, without a weak plane. The strain is `overload` times the strip's Griffith load, at which
    the energy ahead of the crack is G_c. Strengths of bonds, which G_c gives (`Toughness`), are
    multiplied by random factors of Weibull's distribution of modulus `weibull` and mean 1, and
    within round inclusions by `inclusion_strength`.
    """

    spacing: Annotated[float, "Distance of elements, m."] = 1e-5
    young: Annotated[float, "Young's modulus, Pa."] = 75e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.25
    density: Annotated[float, "Density, kg/m^3."] = 2500.0
    fracture_energy: Annotated[float, "G_c, J/m^2."] = 6.0
    duration: Annotated[float, "Time simulated, s."] = 1e-6
    overload: Annotated[float, "Load over Griffith's."] = 1.2
    weibull: Annotated[float, "Weibull modulus of bonds' strengths; inf: all alike."] = 5.0
    inclusions: Annotated[float, "Share of the area that inclusions take."] = 0.0
    inclusion_size: Annotated[float, "Diameter of the inclusions, m."] = 8e-5
    inclusion_strength: Annotated[float, "Their strength over that of the rest."] = 1.5

    name = "heterogeneous"
    title = "Crack in a strip of uneven strength"
    size = SIZE

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("overload", "inclusion_size", "inclusion_strength"):
            positive(name, getattr(self, name), ())
        positive_or_inf("weibull", self.weibull)
        if not 0.0 <= finite("inclusions", self.inclusions, ()) <= 0.5:
            raise InputError(f"inclusions take {self.inclusions:g} of the area; give 0 to 0.5.")
        if self.inclusions > 0.0:
            self.centres()

    @property
    def tip(self) -> tuple[float, float]:
        """Tip of the notch [m]."""
        return NOTCH, 0.5 * SIZE[1]

    @property
    def load(self) -> float:
        """Strain across the strip."""
        free = SIZE[1] - GRIP_LAYERS * sqrt(3.0) * self.spacing
        return self.overload * griffith_strain(self.material, self.fracture_energy, free)

    def centres(self) -> Array:
        """Centres of the inclusions [m], (m, 2), apart from each other."""
        rng = np.random.default_rng(self.seed)
        count = round(self.inclusions * SIZE[0] * SIZE[1] / (0.25 * pi * self.inclusion_size**2))
        found: list[Array] = []
        for place in rng.random((1000 * count, 2)) * SIZE:
            if len(found) == count:
                break
            if not found or np.linalg.norm(found - place, axis=1).min() > self.inclusion_size:
                found.append(place)
        if self.inclusions > 0.0 and not 0 < len(found) == count:
            raise InputError(
                f"{len(found)} inclusions of {self.inclusion_size:g} m find room for "
                f"{self.inclusions:g} of the area, not {count}; give smaller ones, or less of them."
            )
        return np.array(found).reshape(-1, 2)

    def build(self, plate: Packing) -> tuple[Scene, Body]:
        """The notched strip under its strain."""
        plate = plate.slit((-NOTCH, self.tip[1]), self.tip)
        scene = Scene()
        law = Toughness(Rankine(1.0), energy=self.fracture_energy)
        body = scene.add(plate, self.material, fracture=law)
        if isfinite(self.weibull):
            scene.scatter_strength(body, self.weibull, self.seed)
            body.strength_factor /= gamma(1.0 + 1.0 / self.weibull)
        middle = plate.position[plate.bonds].mean(axis=1)
        for centre in self.centres():
            inside = np.linalg.norm(middle - centre, axis=1) < 0.5 * self.inclusion_size
            body.strength_factor[inside] *= self.inclusion_strength
        scene.strain(body, [[0.0, 0.0], [0.0, self.load]])
        grip(scene, body)
        return scene, body

    @property
    def expected(self) -> Expected:
        """The notch, and outlines of inclusions."""
        turn = np.linspace(0.0, 2.0 * pi, 24)
        ring = 0.5 * self.inclusion_size * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        # names that begin so stay out of a legend
        lines = {f"_{k}": centre + ring for k, centre in enumerate(self.centres())}
        return Expected((((0.0, self.tip[1]), self.tip),), lines)

    def measure(self, run: CrackRun) -> dict[str, Any]:
        """Speed along the strip, and how rough the path is."""
        speed = run.crack.speed / run.numbers["rayleigh_speed"]
        if not run.own:
            return {"speed_over_rayleigh": speed, "roughness_spacings": nan, "tortuosity": nan}
        path = run.own[0].path
        angle = np.radians(path_angle(path))
        across = path @ np.array([-np.sin(angle), np.cos(angle)])
        span = float(np.linalg.norm(path[-1] - path[0]))
        return {
            "speed_over_rayleigh": speed,
            "roughness_spacings": float(across.std()) / self.spacing,
            "tortuosity": run.own[0].length / span,
        }


@dataclass
class HeterogeneousResult(FreeCrackResult):
    """What came out; speed_over_rayleigh: along the strip, by all breaks of the last half of the
    path; roughness_spacings: root of the mean square distance of the crack's path from a straight
    line fitted to it, in spacings; tortuosity: its length over that of the line."""

    speed_over_rayleigh: float
    roughness_spacings: float
    tortuosity: float

    @property
    def told(self) -> list[str]:
        """The result in words."""
        return [
            *super().told,
            f"speed along the strip {self.speed_over_rayleigh:.3f} of the Rayleigh speed; "
            f"roughness {self.roughness_spacings:.2f} spacings, tortuosity {self.tortuosity:.3f}",
        ]


def heterogeneous(
    parameters: Heterogeneous | None = None, **options: Unpack[Options]
) -> HeterogeneousResult:
    """Run a tensile crack through a strip of uneven strength: how rough and how fast it is.

    options: `shared.Options`.
    """
    return free_crack(parameters or Heterogeneous(), HeterogeneousResult, **options)

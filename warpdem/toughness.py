"""Strength from toughness: what the pair ahead of a crack's tip sees at K_Ic (theory B10).

A criterion of stress sees t K/sqrt(d) at a tip, d being the spacing. The tensors t are tabulated
for hexagonal, fcc and Voronoi packings in `tip_stress.json`, by benchmarks/tip_stress.py.
"""

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from math import sqrt
from typing import Any

import numpy as np

from .criteria import Tensile, equivalent_stress, with_tension
from .errors import Array, InputError, checked, one_of, positive
from .material import Material
from .packing import Packing


@checked
@dataclass(frozen=True)
class Toughness:
    """A criterion whose strength follows from the material's toughness and the size of elements.

    criterion: its form, whose strength is replaced (HuberMisesHencky, DruckerPrager, Rankine,
    MohrCoulomb or MixedMode); stress_intensity: K_c [Pa m^0.5], or energy: G_c [J/m^2], of which
    one is given; mode: "I" for cracks that open, "II" for cracks that slide along a weak plane.
    The strength goes with 1/sqrt(spacing), so that cracks of one toughness run in fine and coarse
    packings; bodies without cracks have that strength too, which is then one of the packing.
    """

    criterion: Tensile
    stress_intensity: float | None = None
    energy: float | None = None
    mode: str = "I"

    def __post_init__(self) -> None:
        if not isinstance(self.criterion, Tensile):
            raise InputError(
                f"criterion is {self.criterion!r}; give HuberMisesHencky, DruckerPrager, Rankine, "
                "MohrCoulomb or MixedMode."
            )
        one_of("mode", self.mode, ("I", "II"))
        if (self.stress_intensity is None) == (self.energy is None):
            raise InputError("give either stress_intensity, K_c, or energy, G_c.")
        for name in ("stress_intensity", "energy"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), ())

    def intensity(self, packing: Packing, *materials: Material) -> float:
        """K_c [Pa m^0.5]; from G_c by K^2 = G_c E', in space that of plane strain.

        Between two materials 1/E' is the mean of both, and K^2 = G_c E'/(1 - beta^2) with Dundurs'
        beta (Hutchinson and Suo 1992, eq. 2.29).
        """
        if self.stress_intensity is not None:
            return self.stress_intensity
        assert self.energy is not None
        plane = packing.plane or "strain"
        modulus = 1.0 / np.mean([1.0 / m.plane_modulus(plane) for m in materials])
        beta = dundurs(materials[0], materials[-1], plane)[1]
        return sqrt(self.energy * float(modulus) / (1.0 - beta**2))

    def at(self, packing: Packing, *materials: Material) -> Tensile:
        """The criterion with the strength that a packing's spacing and a material, or both at an
        interface, give it; there each counts half of what the pair sees in either alone."""
        unit = with_tension(self.criterion, 1.0)
        seen = np.mean([tip_ratio(unit, packing, m.poisson, self.mode) for m in materials])
        strength = float(seen) * self.intensity(packing, *materials) / sqrt(packing.spacing)
        return with_tension(self.criterion, strength)


def dundurs(one: Material, other: Material, plane: str = "strain") -> tuple[float, float]:
    """Dundurs' alpha and beta of two materials, 0 for like ones (Hutchinson and Suo 1992, 2.7)."""
    kappa = [
        3.0 - 4.0 * m.poisson if plane == "strain" else (3.0 - m.poisson) / (1.0 + m.poisson)
        for m in (one, other)
    ]
    upper = np.array([one.shear_modulus * (kappa[1] + s) for s in (1.0, -1.0)])
    lower = np.array([other.shear_modulus * (kappa[0] + s) for s in (1.0, -1.0)])
    alpha, beta = (upper - lower) / (upper[0] + lower[0])
    return float(alpha), float(beta)


def tip_ratio(criterion: Tensile, packing: Packing, poisson: float, mode: str = "I") -> float:
    """Ratio of equivalent stress to strength of the pair ahead of a tip at K/sqrt(spacing) = 1 Pa.

    Of the pairs that the crack must break next the one that breaks first counts; of several places
    of the tip, on lattices the one that holds longest, on Voronoi packings their median.
    Raises InputError for packings and Poisson's ratios that are not tabulated.
    """
    places = tip_stress(packing, poisson, mode)
    scale = criterion.strength
    normal = np.array([1.0, 0.0, 0.0])
    ratios = [
        max(equivalent_stress(criterion, tensor, normal) / scale for tensor in place)
        for place in places
    ]
    found = np.median(ratios) if packing.arrangement == "voronoi" else min(ratios)
    return float(found)


def tip_stress(packing: Packing, poisson: float, mode: str) -> list[Array]:
    """Tensors over K/sqrt(d) of the pairs just ahead of a tip, for several places of the tip.

    Each (pairs, 3, 3) in axes of which the first is the face's normal.
    """
    name = " ".join([packing.arrangement, packing.plane or "space", mode])
    table = _table()
    if not packing.arrangement or name not in table:
        kinds = ", ".join(sorted({key.rsplit(" ", 1)[0] for key in table}))
        raise InputError(
            f"stresses at tips are tabulated for these packings: {kinds}; for another one give a "
            "strength, or add it to benchmarks/tip_stress.py."
        )
    nu, rows = np.array(table[name]["poisson"]), table[name]["tensors"]
    if not nu[0] <= poisson <= nu[-1]:
        raise InputError(
            f"poisson is {poisson:g}; stresses at tips are tabulated from {nu[0]:g} to {nu[-1]:g}."
        )
    at = min(int(np.searchsorted(nu, poisson, side="right")) - 1, len(nu) - 2)
    share = (poisson - nu[at]) / (nu[at + 1] - nu[at])
    return [
        _tensors((1.0 - share) * np.array(low) + share * np.array(high))
        for low, high in zip(rows[at], rows[at + 1], strict=True)
    ]


def _tensors(columns: Array) -> Array:
    xx, yy, zz, xy, yz, xz = columns.T
    return np.stack([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)


@cache
def _table() -> dict[str, Any]:
    return json.loads(files(__package__).joinpath("tip_stress.json").read_text())


def local_spacing(packing: Packing) -> Array:
    """Spacing [m] of a hexagonal or fcc packing with cells as large as each bond's two, (b,)."""
    v = (packing.volume / packing.thickness)[packing.bonds].mean(axis=1)
    return np.sqrt(v * 2.0 / sqrt(3.0)) if packing.dim == 2 else np.cbrt(v * sqrt(2.0))

"""Stiffness of EVM bonds (Kuzkin 11-16)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .errors import Array, InputError, checked, finite, first_ids, positive
from .material import Material
from .section import Section, check_section


@checked
@dataclass(frozen=True)
class EVMBond:
    """The enhanced vector-based bond of Kuzkin and Krivtsov.

    longitudinal c_A [N/m], shear c_D [N/m], bending c_B [N m] and torsion c_T [N m] are the bond's
    stiffnesses, each a number or one value a bond; any that are not negative can be had (eq. 11).
    `offset` is the distance R [m] from an element's centre to the end of the bond, one number or
    one value for each of the two ends (shape (2,) or (bonds, 2)). Torsion has no effect in the
    plane. damping: dashpots beside the springs, as a share of each bond's own critical damping
    (theory A8). large_rotation: energies of the angles themselves instead of their sines, for bonds
    that twist or bend by more than about 45 degrees; beyond the paper (theory A5).
    plane_only: bends differently across the plane, so only bodies of the plane may have it.

    Raises InputError unless c_A > 0, c_D, c_B, c_T >= 0, R >= 0, damping >= 0.
    """

    longitudinal: ArrayLike
    shear: ArrayLike
    bending: ArrayLike
    torsion: ArrayLike = 0.0
    offset: ArrayLike = 0.0
    damping: float = 0.0
    large_rotation: bool = False
    plane_only: bool = False

    def __post_init__(self) -> None:
        positive("longitudinal", self.longitudinal)
        finite("damping", self.damping, ())
        for name in ("shear", "bending", "torsion", "offset", "damping"):
            value = np.atleast_1d(finite(name, getattr(self, name)))
            if (value < 0.0).any():
                at = first_ids(value.reshape(len(value), -1).min(axis=1) < 0.0)
                raise InputError(
                    f"{name} must not be negative; it is at {at}. An EVM bond takes any "
                    "longitudinal > 0 and any shear, bending, torsion, offset and damping >= 0."
                )

    @classmethod
    def bernoulli_euler(
        cls, material: Material, section: Section, length: ArrayLike, **more: Any
    ) -> "EVMBond":
        """A slender beam, stiff in shear (Kuzkin 14).

        length [m]: of the bond itself, between its ends, a number or one a bond; more: offset,
        damping, large_rotation.
        """
        return cls._beam(material, section, length, 0.0, more)

    @classmethod
    def timoshenko(
        cls,
        material: Material,
        section: Section,
        length: ArrayLike,
        shear_coefficient: float | None = None,
        **more: Any,
    ) -> "EVMBond":
        """A beam that yields in shear (Kuzkin 13), from about one thickness in length.

        shear_coefficient: k, by default the section's own.
        """
        check_section(section)
        k = shear_coefficient
        k = section.shear_coefficient(material.poisson) if k is None else k
        if not 0.0 < finite("shear_coefficient", k, ()) <= 1.0:
            raise InputError(
                f"the shear coefficient is {k:g}; it must lie above 0 and not above 1. For a "
                "beam that is stiff in shear use EVMBond.bernoulli_euler."
            )
        return cls._beam(material, section, length, 24.0 * (1.0 + material.poisson) / k, more)

    @classmethod
    def _beam(
        cls,
        material: Material,
        section: Section,
        length: ArrayLike,
        compliance: float,
        more: dict[str, Any],
    ) -> "EVMBond":
        a = positive("length", length)
        check_section(section)
        e_j = material.young * section.second_moment
        phi = compliance * section.second_moment / (section.area * a**2)
        return cls(
            longitudinal=material.young * section.area / a,
            shear=12.0 * e_j / (a**3 * (1.0 + phi)),
            bending=e_j / a,
            torsion=material.shear_modulus * section.torsion_constant / a,
            plane_only=not section.bends_alike,
            **more,
        )

    @classmethod
    def short_cylinder(
        cls, material: Material, section: Section, length: ArrayLike, **more: Any
    ) -> "EVMBond":
        """A glue disc shorter than it is thick, held from shrinking sideways (Kuzkin 16)."""
        a = positive("length", length)
        check_section(section)
        nu = material.poisson
        if nu > 0.499:
            raise InputError(
                f"a short cylinder of Poisson's ratio {nu:g} is rigid along its axis: the modulus "
                "grows without bound towards 1/2; take at most 0.499, or EVMBond.timoshenko."
            )
        modulus = material.young * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
        return cls(
            longitudinal=modulus * section.area / a,
            shear=material.shear_modulus * section.area / a,
            bending=modulus * section.second_moment / a,
            torsion=material.shear_modulus * section.torsion_constant / a,
            plane_only=not section.bends_alike,
            **more,
        )

    @classmethod
    def parallel_bond(
        cls, normal: ArrayLike, shear: ArrayLike, section: Section, **more: Any
    ) -> "EVMBond":
        """The parallel bond of Potyondy and Cundall 2004, of normal and shear stiffness k_n and
        k_s [Pa/m] an area (theory A6)."""
        check_section(section)
        k_n, k_s = positive("normal", normal), finite("shear", shear)
        return cls(
            longitudinal=k_n * section.area,
            shear=k_s * section.area,
            bending=k_n * section.second_moment,
            torsion=k_s * section.torsion_constant,
            plane_only=not section.bends_alike,
            **more,
        )

    def ends(self, bonds: int) -> Array:
        """R_i, R_j [m] of every bond, shape (bonds, 2)."""
        offset = np.asarray(self.offset, dtype=np.float64)
        try:
            return np.broadcast_to(offset, (bonds, 2)).copy()
        except ValueError:
            raise InputError(
                f"offset has shape {offset.shape}; give one number, two, or shape ({bonds}, 2)."
            ) from None

    def stiffnesses(self, bonds: int) -> Array:
        """c_A, c_D [N/m], c_B, c_T [N m] of every bond, shape (bonds, 4)."""
        columns = []
        for name in ("longitudinal", "shear", "bending", "torsion"):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.ndim > 1 or (value.ndim == 1 and value.shape != (bonds,)):
                raise InputError(
                    f"{name} has shape {value.shape}; give one number or one a bond ({bonds},)."
                )
            columns.append(np.broadcast_to(value, (bonds,)))
        return np.stack(columns, axis=1)

    def parameters(self, length: Array) -> Array:
        """B1, B2 [N/m, N m], B3, B4 [N m] for bonds of length a [m], shape (n, 4) (Kuzkin 11)."""
        c_a, c_d, c_b, c_t = self.stiffnesses(len(length)).T
        b2 = c_d * length**2
        return np.stack([c_a, b2, c_b - b2 / 4.0 - c_t / 2.0, c_t], axis=1)

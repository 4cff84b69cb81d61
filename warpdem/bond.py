"""Stiffness of EVM bonds (Kuzkin 11)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .errors import Array, InputError, finite, first_ids, positive


@dataclass(frozen=True)
class EVMBond:
    """The enhanced vector-based bond of Kuzkin and Krivtsov.

    longitudinal c_A [N/m], shear c_D [N/m], bending c_B [N m] and torsion c_T [N m] are the bond's
    stiffnesses, each a number or one value a bond. `offset` is the distance R [m] from an
    element's centre to the end of the bond, one number or one value for each of the two ends
    (shape (2,) or (bonds, 2)). Torsion has no effect in the plane.

    Raises InputError unless c_A > 0, c_D, c_B, c_T >= 0, R >= 0.
    """

    longitudinal: ArrayLike
    shear: ArrayLike
    bending: ArrayLike
    torsion: ArrayLike = 0.0
    offset: ArrayLike = 0.0

    def __post_init__(self) -> None:
        positive("longitudinal", self.longitudinal)
        for name in ("shear", "bending", "torsion", "offset"):
            value = np.atleast_1d(finite(name, getattr(self, name)))
            if (value < 0.0).any():
                at = first_ids(value.reshape(len(value), -1).min(axis=1) < 0.0)
                raise InputError(f"{name} must not be negative; it is at {at}.")

    def ends(self, bonds: int) -> Array:
        """R_i, R_j [m] of every bond, shape (bonds, 2)."""
        offset = np.asarray(self.offset, dtype=np.float64)
        try:
            return np.broadcast_to(offset, (bonds, 2)).copy()
        except ValueError:
            raise InputError(
                f"offset has shape {offset.shape}; give one number, two, or shape ({bonds}, 2)."
            ) from None

    def parameters(self, length: Array) -> Array:
        """B1, B2 [N/m, N m], B3, B4 [N m] for bonds of length a [m], shape (n, 4) (Kuzkin 11)."""
        columns = []
        for name in ("longitudinal", "shear", "bending", "torsion"):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.ndim > 1 or (value.ndim == 1 and value.shape != length.shape):
                raise InputError(
                    f"{name} has shape {value.shape}; give one number or one a bond {length.shape}."
                )
            columns.append(np.broadcast_to(value, length.shape))
        c_a, c_d, c_b, c_t = columns
        b2 = c_d * length**2
        return np.stack([c_a, b2, c_b - b2 / 4.0 - c_t / 2.0, c_t], axis=1)

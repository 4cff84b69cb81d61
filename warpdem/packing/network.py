"""Networks of bonds without faces: rods, rings, frames, sheets, imported particles."""

import numpy as np
from numpy.typing import ArrayLike

from ..errors import finite
from .packing import Packing


def network(
    position: ArrayLike,
    bonds: ArrayLike,
    volume: ArrayLike,
    radius: ArrayLike | None = None,
    plane: str | None = None,
    thickness: float = 1.0,
) -> Packing:
    """Elements joined by given bonds without faces, for EVM bonds.

    position [m] (n, dim); bonds: pairs of ids (b, 2); volume [m^3]: a number or (n,), gives the
    mass; radius [m]: a number or (n,), gives the inertia, by default that of equal volume.
    """
    x = finite("position", position, (None, None))
    n = len(x)
    return Packing(
        position=x,
        volume=np.broadcast_to(finite("volume", volume), (n,)).copy(),
        bonds=np.asarray(bonds),
        radius=None if radius is None else np.broadcast_to(finite("radius", radius), (n,)).copy(),
        plane=plane,
        thickness=thickness,
    )

"""What touches what without a bond: contact among elements, and radii (theory B11)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import Array
from .friction import Friction
from .packing import Mask, Packing
from .relinking import Welding


@dataclass(frozen=True)
class Contact:
    """How elements touch that no bond joins. Made by `Scene.contact`."""

    friction: Friction
    restitution: float
    skin: float  # of the list of neighbours, over the median radius
    law: str = "linear"  # or "hertz"
    welding: Welding | None = None

    @property
    def is_hertz(self) -> bool:
        """Whether elements touch as Hertz's spheres."""
        return self.law == "hertz"


def touching_radius(packing: Packing) -> Array:
    """Radius [m] at which each element touches others that no bond joins it to, (n,).

    The distance to its nearest face, so that spheres never overlap at first; without faces the
    packing's radius, but not beyond the middle of its shortest bond.
    """
    n, bonds = len(packing), packing.bonds
    reach = np.full(n, np.inf)
    if packing.arms is not None:
        along = np.einsum("bsk,bk->bs", packing.arms, packing.bond_vector)
        distance = along * [1.0, -1.0] / packing.bond_length[:, None]
    else:
        distance = np.repeat(0.5 * packing.bond_length[:, None], 2, axis=1)
    np.minimum.at(reach, bonds.ravel(), distance.ravel())
    assert packing.radius is not None
    faced = np.isfinite(reach) & (packing.arms is not None)
    return np.where(faced, reach, np.minimum(reach, packing.radius))


def has_free_surface(packing: Packing) -> Mask:
    """Elements whose faces do not enclose them, (n,): all without faces."""
    if packing.area is None or packing.arms is None:
        return np.ones(len(packing), dtype=bool)
    along = np.einsum("bsk,bk->bs", packing.arms, packing.bond_vector) * [1.0, -1.0]
    share = along * (packing.area / packing.bond_length)[:, None]
    filled = np.bincount(packing.bonds.ravel(), share.ravel(), minlength=len(packing))
    size = packing.volume ** (1.0 - 1.0 / packing.dim)
    if packing.dim == 2:
        size = np.sqrt(packing.volume * packing.thickness)
    bare = np.linalg.norm(packing.exposed_area, axis=1) > 1e-6 * size
    return bare | (filled < (1.0 - 1e-6) * packing.dim * packing.volume)


def bonded_rows(
    pairs: NDArray[np.int64], elements: NDArray[np.int64], n: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Elements that bonds join to each of `elements`: starts of rows (m + 1,), the rows, and which
    of the pairs each entry is."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    order = np.lexsort((both[:, 1], both[:, 0]))
    both = both[order]
    degree = np.bincount(both[:, 0], minlength=n)
    first = np.concatenate([[0], np.cumsum(degree)])
    start = np.concatenate([[0], np.cumsum(degree[elements])])
    rows = np.repeat(first[elements] - start[:-1], degree[elements])
    entries = rows + np.arange(start[-1])
    which = order[entries] % max(len(pairs), 1)
    return start.astype(np.int32), both[entries, 1].astype(np.int32), which.astype(np.int32)

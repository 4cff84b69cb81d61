"""What touches what without a bond: contact among elements, and radii (theory B11)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .errors import Array
from .friction import Friction, rubs
from .material import Material
from .packing import Mask, Packing
from .relinking import Welding


@dataclass(frozen=True)
class Contact:
    """How elements touch that no bond joins. Made by `Scene.contact`."""

    friction: Friction
    restitution: float
    skin: float  # of the list of neighbours, over the median radius
    law: str = "linear"  # or "hertz"
    restitution_by: str = "opening"  # or "dashpot"
    rolling_friction: float = 0.0  # moment over that of the normal force about the rolling radius
    twisting_friction: float = 0.0  # likewise about the normal
    pairs: Mapping[frozenset[Material], Friction] = field(default_factory=dict)
    welding: Welding | None = None

    @property
    def is_hertz(self) -> bool:
        """Whether elements touch as Hertz's spheres."""
        return self.law == "hertz"

    @property
    def rubs(self) -> bool:
        """Whether some elements rub on each other."""
        return any(rubs(law) for law in (self.friction, *self.pairs.values()))

    @property
    def bounces(self) -> bool:
        """Whether restitution takes its share where contacts open."""
        return self.restitution < 1.0 and self.restitution_by == "opening"

    @property
    def damping_ratio(self) -> float:
        """Of dashpots that give the restitution, to the critical one; 0 without dashpots."""
        if self.restitution_by != "dashpot":
            return 0.0
        return damping_ratio(self.restitution)


def damping_ratio(restitution: float) -> float:
    """Ratio beta of a contact's dashpot to the critical one that gives a restitution in (0, 1].

    Of an impact that ends when the force has fallen to zero, so that it never pulls,
    e = exp(-2 beta arccos(beta)/sqrt(1 - beta^2)), which is Schwager and Poschel's (2007, eq. 21)
    written shortly; beyond 1 with the hyperbolic functions. It is the same by Hertz's law.
    """

    def lack(beta: float) -> float:
        root = np.sqrt(abs(1.0 - beta * beta))
        # of either kind, and 1 where they meet
        angle = np.arctan2(root, beta) if beta < 1.0 else np.arcsinh(root)
        return 2.0 * beta * (angle / root if root > 0.0 else 1.0) + np.log(restitution)

    if restitution == 1.0:
        return 0.0
    from scipy.optimize import brentq

    return float(brentq(lack, 0.0, 1.0 / restitution, xtol=1e-15, rtol=1e-14))


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

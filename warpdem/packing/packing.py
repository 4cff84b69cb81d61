"""What a packing is, and the checks on it (theory B1)."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import (
    Array,
    InputError,
    ModelWarning,
    checked,
    entries,
    finite,
    first_ids,
    one_of,
    positive,
)

Mask = NDArray[np.bool_]
SIDES = ("left", "right", "bottom", "top", "back", "front")  # along x, y, z


@checked
@dataclass(frozen=True)
class Packing:
    """Elements and the bonds between them, in the reference state.

    position [m], shape (n, dim), dim 2 or 3; volume [m^3] (n,); radius [m] (n,): of the sphere or
    disc whose inertia the element has, by default that of equal volume.
    bonds: element ids i, j of each bond (b, 2). Bonds of a tessellation have faces: area [m^2] (b,)
    and arms [m] (b, 2, dim), from the centres of i and of j to the face's centroid.
    gyration [m] (n, 3): principal radii of gyration of elements that are not spheres, so that the
    principal moments of inertia are mass * gyration^2; axes (n, 4): unit quaternions (x, y, z, w)
    from the principal axes to the world's, by default none turned. ids (n,): the user's own numbers
    of the elements, by default their order.
    period [m] (dim,): edges of the box that a periodic cell repeats with, inf along axes along
    which it does not.
    plane: "strain" or "stress" of a plane packing of the given thickness [m], None in space.
    arrangement: "hexagonal", "fcc", "voronoi" or "": what tables of tip stresses go by.
    sides: named boundary layers as masks of elements.

    Raises InputError naming the first ids that are non-finite, duplicate, out of range, not
    positive, or not closed.
    """

    position: Array
    volume: Array
    bonds: NDArray[np.int64]
    area: Array | None = None
    arms: Array | None = None
    radius: Array | None = None
    gyration: Array | None = None
    axes: Array | None = None
    ids: NDArray[np.int64] | None = None
    period: Array | None = None
    plane: str | None = None
    thickness: float = 1.0
    spacing: float = 0.0
    sides: Mapping[str, Mask] = field(default_factory=dict)
    arrangement: str = ""

    def __post_init__(self) -> None:
        position = finite("position", self.position, (None, None))
        n, dim = position.shape
        if dim not in (2, 3):
            raise InputError(f"position has {dim} columns; give 2 in the plane, 3 in space.")
        if n == 0:
            raise InputError("the packing has no elements; enlarge it or reduce the spacing.")
        one_of("plane", self.plane, ("strain", "stress") if dim == 2 else (None,))
        set_ = object.__setattr__
        set_(self, "position", position)
        set_(self, "volume", positive("volume", self.volume, (n,)))
        positive("thickness", self.thickness, ())
        v = self.volume / self.thickness
        equal = np.sqrt(v / pi) if dim == 2 else np.cbrt(0.75 * v / pi)
        radius = equal if self.radius is None else self.radius
        set_(self, "radius", positive("radius", radius, (n,)))
        if self.period is not None:
            set_(self, "period", _period(self.period, dim))
        self._check_bonds()
        self._check_inertia()
        ids = np.arange(n) if self.ids is None else entries("ids", self.ids)
        if ids.shape != (n,) or ids.dtype.kind not in "iu" or len(np.unique(ids)) < n:
            raise InputError(f"ids must be {n} different integers.")
        set_(self, "ids", ids.astype(np.int64))
        set_(self, "sides", {name: self._checked(name, mask) for name, mask in self.sides.items()})
        if self.spacing != 0.0:
            positive("spacing", self.spacing, ())
        else:
            length = self.bond_length
            apart = np.mean(length if len(length) else 2.0 * np.asarray(self.radius))
            set_(self, "spacing", float(apart))

    def _checked(self, name: str, mask: ArrayLike) -> Mask:
        side = entries(f"side {name!r}", mask)
        if side.shape != (len(self),) or side.dtype != bool:
            raise InputError(f"side {name!r} must be a mask: {len(self)} truth values.")
        return side

    def _check_bonds(self) -> None:
        n, dim = self.position.shape
        bonds = entries("bonds", self.bonds)
        if bonds.size == 0:
            bonds = np.zeros((0, 2), dtype=np.int64)
        if bonds.ndim != 2 or bonds.shape[1] != 2 or bonds.dtype.kind not in "iu":
            raise InputError("bonds must be pairs of element ids, integers of shape (b, 2).")
        object.__setattr__(self, "bonds", bonds.astype(np.int64))
        bad = ((bonds < 0) | (bonds >= n)).any(axis=1)
        if bad.any():
            raise InputError(f"bonds {first_ids(bad)} name elements outside 0..{n - 1}.")
        bad = bonds[:, 0] == bonds[:, 1]
        if bad.any():
            raise InputError(f"bonds {first_ids(bad)} join an element to itself.")
        ordered = np.sort(bonds, axis=1)
        _, first, inverse = np.unique(ordered, axis=0, return_index=True, return_inverse=True)
        bad = first[inverse.ravel()] != np.arange(len(bonds))
        if bad.any():
            more = "" if self.period is None else "; of a small periodic cell: take a larger one"
            raise InputError(
                f"bonds {first_ids(bad)} join pairs that earlier bonds join already{more}."
            )
        _, first, inverse = np.unique(self.position, axis=0, return_index=True, return_inverse=True)
        bad = first[inverse.ravel()] != np.arange(n)
        if bad.any():
            raise InputError(f"elements {first_ids(bad)} lie on the same place as others.")
        if (self.area is None) != (self.arms is None):
            raise InputError("give both area and arms of the faces, or neither.")
        if self.period is not None:
            bad = (np.abs(self.bond_vector) > 0.45 * self.period).any(axis=1)
            if bad.any():
                raise InputError(
                    f"bonds {first_ids(bad)} are half as long as the period; take a larger cell."
                )
        if self.area is not None and self.arms is not None:
            object.__setattr__(self, "area", positive("area", self.area, (len(bonds),)))
            arms = finite("arms", self.arms, (len(bonds), 2, dim))
            object.__setattr__(self, "arms", arms)
            self._check_faces()

    def _check_inertia(self) -> None:
        n, dim = self.position.shape
        if self.gyration is None:
            if self.axes is not None:
                raise InputError("axes need the radii of gyration about them; give gyration.")
            return
        if dim == 2:
            raise InputError("elements of the plane turn about one axis; give radius instead.")
        square = positive("gyration", self.gyration, (n, 3)) ** 2
        bad = 2.0 * square.max(axis=1) > (1.0 + 1e-9) * square.sum(axis=1)
        if bad.any():
            raise InputError(
                f"elements {first_ids(bad)}: no body has a principal moment above the sum of the "
                "other two; check gyration."
            )
        axes = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)) if self.axes is None else self.axes
        axes = finite("axes", axes, (n, 4))
        bad = np.abs(np.linalg.norm(axes, axis=1) - 1.0) > 1e-6
        if bad.any():
            raise InputError(f"axes are not unit quaternions at {first_ids(bad)}.")
        object.__setattr__(self, "gyration", np.sqrt(square))
        object.__setattr__(self, "axes", axes)

    def _check_faces(self) -> None:
        """Faces meet (c_i - c_j = x_j - x_i), lie between the centres, and close (theory B1, G)."""
        assert self.area is not None and self.arms is not None
        x = self.bond_vector
        gap = np.linalg.norm(self.arms[:, 0] - self.arms[:, 1] - x, axis=1)
        bad = gap > 1e-9 * self.bond_length
        if bad.any():
            raise InputError(f"bonds {first_ids(bad)}: the two arms do not meet at one point.")
        q = np.einsum("bsk,bk->bs", self.arms, x) * [1.0, -1.0]
        bad = (q <= 0.0).any(axis=1)
        if bad.any():
            raise InputError(f"bonds {first_ids(bad)}: the face is not between the two centres.")
        n, dim = self.position.shape
        normal = x / self.bond_length[:, None]
        closure = self.exposed_area
        size = (
            self.volume ** (1.0 - 1.0 / dim) if dim == 3 else np.sqrt(self.volume * self.thickness)
        )
        inner = np.linalg.norm(closure, axis=1) < 1e-9 * size
        moment = np.zeros((n, dim, dim))
        for side in (0, 1):
            sn = (1 - 2 * side) * self.area[:, None] * normal
            np.add.at(moment, self.bonds[:, side], self.arms[:, side, :, None] * sn[:, None, :])
        error = np.abs(moment - self.volume[:, None, None] * np.eye(dim)).max(axis=(1, 2))
        # a chain or a sheet one element thick is closed in no other sense: its faces fill less
        filled = np.trace(moment, axis1=1, axis2=2) / (dim * self.volume)
        bad = inner & (filled > 0.9) & (error > 1e-8 * self.volume)
        if bad.any():
            raise InputError(
                f"the faces of elements {first_ids(bad)} do not enclose their volume: "
                "sum S c (x) n must be V times the unit tensor."
            )
        full = ~inner & (filled > 1.0 + 1e-8)
        if full.any():
            warnings.warn(
                f"the faces of elements {first_ids(full)} enclose more than their volume, which is "
                "right only where the free surface turns inwards, as at the tip of a notch.",
                ModelWarning,
                stacklevel=6,
            )

    def index(self, ids: ArrayLike) -> NDArray[np.int64]:
        """Places in the order of elements of the user's own ids, as scene.hold takes them."""
        assert self.ids is not None
        wanted = np.atleast_1d(entries("ids", ids))
        order = np.argsort(self.ids)
        found = order[np.minimum(np.searchsorted(self.ids, wanted, sorter=order), len(self) - 1)]
        if (self.ids[found] != wanted).any():
            raise InputError(f"no element has the ids {wanted[self.ids[found] != wanted][:5]}.")
        return found

    def without(self, where: ArrayLike) -> "Packing":
        """The packing with some elements left out, by mask or places: pores, cavities.

        Faces that met them become free surface, a side named "pores"; ids are kept.
        """
        gone = np.zeros(len(self), dtype=bool)
        gone[entries("where", where)] = True
        if gone.all():
            raise InputError("nothing is left of the packing; leave out fewer elements.")
        place = np.cumsum(~gone) - 1
        kept = np.asarray(~gone[self.bonds].any(axis=1))
        beside = np.zeros(len(self), dtype=bool)
        beside[self.bonds[~kept].ravel()] = True
        sides = {**self.sides, "pores": beside | self.sides.get("pores", np.zeros(len(self), bool))}

        def own(array: Array | None, mask: Mask) -> Array | None:
            return None if array is None else array[mask]

        return replace(
            self,
            position=self.position[~gone],
            volume=self.volume[~gone],
            radius=own(self.radius, ~gone),
            gyration=own(self.gyration, ~gone),
            axes=own(self.axes, ~gone),
            ids=None if self.ids is None else self.ids[~gone],
            bonds=place[self.bonds[kept]],
            area=own(self.area, kept),
            arms=own(self.arms, kept),
            sides={name: mask[~gone] for name, mask in sides.items()},
        )

    def slit(self, start: ArrayLike, end: ArrayLike, depth: ArrayLike | None = None) -> "Packing":
        """The packing without the bonds across a segment [m] (see `crossing`): a machined slot.

        Its faces are free surface that slides and closes without resistance, where those of
        `Scene.cut` resist closing.
        """
        kept = np.ones(len(self.bonds), dtype=bool)
        kept[self.crossing(start, end, depth)] = False
        if kept.all():
            raise InputError(f"no bond crosses the segment from {start!r} to {end!r}.")
        return replace(
            self,
            bonds=self.bonds[kept],
            area=None if self.area is None else self.area[kept],
            arms=None if self.arms is None else self.arms[kept],
        )

    def save(self, path: str | Path) -> None:
        """Write everything into an NPZ file, whole or not at all; wd.packing.load reads it."""
        from .file import save

        save(self, Path(path))

    @property
    def dim(self) -> int:
        """Dimension of space, 2 or 3."""
        return int(self.position.shape[1])

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def bond_vector(self) -> Array:
        """x_j - x_i [m], shape (b, dim); of a periodic cell to the nearest image of j."""
        x = self.position[self.bonds[:, 1]] - self.position[self.bonds[:, 0]]
        if self.period is None:
            return x
        edges = np.where(np.isfinite(self.period), self.period, 0.0)
        return x - edges * np.rint(x / self.period)

    @cached_property
    def bond_length(self) -> Array:
        """r0 [m], shape (b,)."""
        return np.linalg.norm(self.bond_vector, axis=1)

    @cached_property
    def piece(self) -> NDArray[np.int64]:
        """The piece that each element belongs to (n,), from 0: pieces that no bond joins."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        graph = coo_array((np.ones(len(self.bonds)), self.bonds.T), shape=(len(self),) * 2)
        return connected_components(graph, directed=False)[1].astype(np.int64)

    @property
    def pieces(self) -> int:
        """Number of pieces that no bond joins; elements without bonds count as pieces."""
        return int(self.piece.max()) + 1

    @cached_property
    def has_gears(self) -> bool:
        """Whether neighbours can turn in opposite senses all over, as meshed gears.

        That is so if elements fall into two classes without bonds inside either (square, simple
        cubic, bcc lattices, chains) and every face is in the middle of its bond.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import breadth_first_order, connected_components

        if self.arms is not None:
            uneven = np.abs(self.arms.sum(axis=1)).max(initial=0.0)
            if uneven > 1e-9 * np.abs(self.arms).max(initial=0.0):
                return False
        n = len(self)
        graph = coo_array((np.ones(len(self.bonds)), self.bonds.T), shape=(n, n)).tocsr()
        graph = graph + graph.T
        label = connected_components(graph, directed=False)[1]
        odd = np.zeros(n, dtype=bool)
        for start in np.unique(label, return_index=True)[1]:
            order, parent = breadth_first_order(graph, start, directed=False)
            for i in order[1:]:
                odd[i] = not odd[parent[i]]
        return len(self.bonds) > 0 and bool((odd[self.bonds[:, 0]] != odd[self.bonds[:, 1]]).all())

    @cached_property
    def exposed_area(self) -> Array:
        """Vector area of each element's free surface [m^2], shape (n, dim): - sum S n."""
        if self.area is None:
            raise InputError("this packing has no faces; give area and arms of its bonds.")
        total = np.zeros_like(self.position)
        sn = (self.area / self.bond_length)[:, None] * self.bond_vector
        np.add.at(total, self.bonds[:, 0], -sn)
        np.add.at(total, self.bonds[:, 1], sn)
        return total

    @cached_property
    def exposed_moment(self) -> Array:
        """Sum of S c x n over each element's free surface [m^3], (n, 1) in the plane or (n, 3): the
        torque of a unit tension there. The cell being closed, minus that over its other faces."""
        if self.area is None or self.arms is None:
            raise InputError("this packing has no faces; give area and arms of its bonds.")
        lift = ((0, 0), (0, 3 - self.dim))
        normal = np.pad(self.bond_vector / self.bond_length[:, None], lift)
        total = np.zeros((len(self), 3))
        for side, sign in ((0, -1.0), (1, 1.0)):
            arm = np.pad(self.arms[:, side], lift)
            np.add.at(total, self.bonds[:, side], sign * self.area[:, None] * np.cross(arm, normal))
        return total[:, 2:] if self.dim == 2 else total

    @cached_property
    def flatness(self) -> float:
        """Mean cosine between a plane's normal and the bonds through it, weighted with the area
        that their faces have along the plane; of the plane of flattest faces.

        It is sqrt(3)/2 for rows of a hexagonal packing, about pi/4 for random cells of the plane.
        """
        if self.area is None:
            raise InputError("this packing has no faces; give area and arms of its bonds.")
        n = self.bond_vector / self.bond_length[:, None]
        if self.dim == 2:
            angle = np.linspace(0.0, pi, 180, endpoint=False)
            planes = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        else:  # directions of a cube's edges, faces and corners, and between them
            steps = np.stack(np.meshgrid(*[[-2, -1, 0, 1, 2]] * 3), axis=-1).reshape(-1, 3)
            planes = steps[np.any(steps, axis=1)].astype(float)
            planes /= np.linalg.norm(planes, axis=1)[:, None]
        cosines = (np.abs(n @ plane) for plane in planes)
        return float(max((self.area @ c**2) / (self.area @ c) for c in cosines))

    def side(self, name: str, layers: int = 1) -> Mask:
        """Elements within `layers` layers of a named side, as a mask of shape (n,)."""
        one_of("side", name, self.sides)
        mask = self.sides[name].copy()
        for _ in range(layers - 1):
            touched = mask[self.bonds].any(axis=1)
            mask[self.bonds[touched]] = True
        return mask

    def boundary(self, layers: int = 1) -> Mask:
        """Elements within `layers` layers of any side."""
        if not self.sides:
            return np.zeros(len(self), dtype=bool)
        return np.any([self.side(name, layers) for name in self.sides], axis=0)

    top = property(lambda self: self.side("top"), doc="Elements of the upper side.")
    bottom = property(lambda self: self.side("bottom"), doc="Elements of the lower side.")
    left = property(lambda self: self.side("left"), doc="Elements of the left side.")
    right = property(lambda self: self.side("right"), doc="Elements of the right side.")

    def crossing(
        self, start: ArrayLike, end: ArrayLike, depth: ArrayLike | None = None
    ) -> NDArray[np.int64]:
        """Ids of the bonds whose centre line crosses a segment from `start` to `end` [m].

        In space the segment is swept along the vector `depth` [m] into a parallelogram; by default
        through the whole body along the third axis.
        """
        a = finite("start", start, (self.dim,))
        edge = finite("end", end, (self.dim,)) - a
        xi = self.position[self.bonds[:, 0]] - a
        xj = self.position[self.bonds[:, 1]] - a
        if self.dim == 2:
            edges, normal = [edge], np.array([-edge[1], edge[0]])
        else:
            if depth is None:
                low, high = self.position[:, 2].min(), self.position[:, 2].max()
                reach = high - low + 2.0 * self.spacing
                edge = edge * [1.0, 1.0, 0.0]
                lift = np.array([0.0, 0.0, low - self.spacing - a[2]])
                xi, xj = xi - lift, xj - lift
                depth = [0.0, 0.0, reach]
            sweep = finite("depth", depth, (3,))
            edges, normal = [edge, sweep], np.cross(edge, sweep)
        if not np.linalg.norm(normal) > 0.0:
            raise InputError("start and end of the cut coincide; give a segment of some length.")
        # a centre on the line itself counts as above it, up to rounding
        tiny = 1e-9 * self.spacing * np.linalg.norm(normal)
        hi, hj = xi @ normal + tiny, xj @ normal + tiny
        across = (hi < 0.0) != (hj < 0.0)
        t = np.divide(hi, hi - hj, out=np.zeros_like(hi), where=across)
        point = xi + t[:, None] * (xj - xi)
        basis = np.stack([*edges, normal], axis=1)
        share = np.linalg.solve(basis, point.T)[: len(edges)]
        return np.flatnonzero(
            across & (share >= -1e-9).all(axis=0) & (share <= 1 + 1e-9).all(axis=0)
        )


def _period(given: ArrayLike, dim: int) -> Array:
    """Edges of the box that repeats, inf along axes along which none does."""
    try:
        edges = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"period must be {dim} numbers, inf where nothing repeats.") from None
    repeats = edges != np.inf
    positive("period", np.where(repeats, edges, 1.0), (dim,))
    if not repeats.any():
        raise InputError("period is infinite along all axes; leave it out.")
    return edges


def repeated(periodic: bool | str, dim: int) -> Mask:
    """Along which axes a body repeats, (dim,): all, none, or those that are named."""
    axes = "xyz"[:dim]
    if not isinstance(periodic, str):
        return np.full(dim, periodic)
    if not periodic or not set(periodic) <= set(axes):
        raise InputError(f"periodic is {periodic!r}; give True, False or some of {axes!r}.")
    return np.array([axis in periodic for axis in axes])


def check_box(size: Sequence[float], spacing: float, dim: int) -> None:
    """Refuse a box or a spacing that is not positive."""
    positive("size", size, (dim,))
    positive("spacing", spacing, ())

"""Packings: where the elements are, and the faces between them (theory B1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import pi, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import Array, InputError, finite, first_ids, one_of, positive

Mask = NDArray[np.bool_]
SIDES = ("left", "right", "bottom", "top", "back", "front")  # along x, y, z


@dataclass(frozen=True)
class Packing:
    """Elements and the bonds between them, in the reference state.

    position [m], shape (n, dim), dim 2 or 3; volume [m^3] (n,); radius [m] (n,): of the sphere or
    disc whose inertia the element has, by default that of equal volume.
    bonds: element ids i, j of each bond (b, 2). Bonds of a tessellation have faces: area [m^2] (b,)
    and arms [m] (b, 2, dim), from the centres of i and of j to the face's centroid.
    plane: "strain" or "stress" of a plane packing of the given thickness [m], None in space.
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
    plane: str | None = None
    thickness: float = 1.0
    spacing: float = 0.0
    sides: Mapping[str, Mask] = field(default_factory=dict)

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
        self._check_bonds()
        if self.spacing == 0.0:
            length = self.bond_length
            set_(self, "spacing", float(length.mean()) if len(length) else 0.0)

    def _check_bonds(self) -> None:
        n, dim = self.position.shape
        bonds = np.asarray(self.bonds)
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
            raise InputError(f"bonds {first_ids(bad)} join pairs that earlier bonds join already.")
        _, first, inverse = np.unique(self.position, axis=0, return_index=True, return_inverse=True)
        bad = first[inverse.ravel()] != np.arange(n)
        if bad.any():
            raise InputError(f"elements {first_ids(bad)} lie on the same place as others.")
        if (self.area is None) != (self.arms is None):
            raise InputError("give both area and arms of the faces, or neither.")
        if self.area is not None and self.arms is not None:
            object.__setattr__(self, "area", positive("area", self.area, (len(bonds),)))
            arms = finite("arms", self.arms, (len(bonds), 2, dim))
            object.__setattr__(self, "arms", arms)
            self._check_faces()

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
        inner &= filled > 0.9
        bad = (inner & (error > 1e-8 * self.volume)) | (filled > 1.0 + 1e-8)
        if bad.any():
            raise InputError(
                f"the faces of elements {first_ids(bad)} do not enclose their volume: "
                "sum S c (x) n must be V times the unit tensor."
            )

    @property
    def dim(self) -> int:
        """Dimension of space, 2 or 3."""
        return int(self.position.shape[1])

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def bond_vector(self) -> Array:
        """x_j - x_i [m], shape (b, dim)."""
        return self.position[self.bonds[:, 1]] - self.position[self.bonds[:, 0]]

    @cached_property
    def bond_length(self) -> Array:
        """r0 [m], shape (b,)."""
        return np.linalg.norm(self.bond_vector, axis=1)

    @cached_property
    def pieces(self) -> int:
        """Number of pieces that no bond joins; elements without bonds count as pieces."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        graph = coo_array((np.ones(len(self.bonds)), self.bonds.T), shape=(len(self),) * 2)
        return int(connected_components(graph, directed=False)[0])

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


def hexagonal(
    size: Sequence[float], spacing: float, plane: str = "strain", thickness: float = 1.0
) -> Packing:
    """Close-packed rows along x in a box from (0, 0), cells of area sqrt(3)/2 spacing^2.

    size: width and height [m] of the box; spacing: distance d of neighbours [m]; plane: "strain"
    or "stress"; thickness [m].
    """
    _box(size, spacing, 2)
    pitch = sqrt(3.0) / 2.0 * spacing
    columns, rows = round(size[0] / spacing), round(size[1] / pitch)
    _filled(columns, rows)
    row, column = np.divmod(np.arange(rows * columns), columns)
    x = (column + 0.25 + 0.5 * (row % 2)) * spacing
    y = (row + 0.5) * pitch
    sides = {
        "left": column == 0,
        "right": column == columns - 1,
        "bottom": row == 0,
        "top": row == rows - 1,
    }
    return _lattice(
        np.stack([x, y], axis=1),
        spacing,
        volume=pitch * spacing * thickness,
        area=spacing / sqrt(3.0) * thickness,
        sides=sides,
        plane=plane,
        thickness=thickness,
    )


def square(
    size: Sequence[float], spacing: float, plane: str = "strain", thickness: float = 1.0
) -> Packing:
    """Square cells in a box from (0, 0). Facet bonds leave it with gear modes (theory B8).

    size: width and height [m]; spacing: distance d of neighbours [m].
    """
    _box(size, spacing, 2)
    sites = _sites(size, spacing)
    return _lattice(
        (sites + 0.5) * spacing,
        spacing,
        volume=spacing**2 * thickness,
        area=spacing * thickness,
        sides=_sides(sites),
        plane=plane,
        thickness=thickness,
    )


def simple_cubic(size: Sequence[float], spacing: float) -> Packing:
    """Cubic cells in a box from (0, 0, 0). Facet bonds leave it with gear modes (theory B8).

    size: the three edges of the box [m]; spacing: distance d of neighbours [m].
    """
    _box(size, spacing, 3)
    sites = _sites(size, spacing)
    return _lattice(
        (sites + 0.5) * spacing,
        spacing,
        volume=spacing**3,
        area=spacing**2,
        sides=_sides(sites),
    )


def bcc(size: Sequence[float], spacing: float) -> Packing:
    """Body-centred cubic packing, eight neighbours, in a box from (0, 0, 0).

    The area of its bonds is not that of Voronoi faces, which would need fourteen neighbours, but
    satisfies the divergence theorem, so that the packing is exactly isotropic (theory B1).
    size: the three edges of the box [m]; spacing: distance d of neighbours [m].
    """
    _box(size, spacing, 3)
    half = spacing / sqrt(3.0)
    sites = _sites(size, half)
    sites = sites[np.ptp(sites % 2, axis=1) == 0]
    volume = 4.0 * spacing**3 / (3.0 * sqrt(3.0))
    return _lattice(
        (sites + 0.5) * half,
        spacing,
        volume=volume,
        area=3.0 * volume / (4.0 * spacing),
        sides=_sides(sites, layers=2),
    )


def fcc(size: Sequence[float], spacing: float) -> Packing:
    """Face-centred cubic packing, cube edges along the axes, in a box from (0, 0, 0).

    size: the three edges of the box [m]; spacing: distance d of neighbours [m].
    """
    _box(size, spacing, 3)
    half = spacing / sqrt(2.0)
    sites = _sites(size, half)
    sites = sites[sites.sum(axis=1) % 2 == 0]
    return _lattice(
        (sites + 0.5) * half,
        spacing,
        volume=spacing**3 / sqrt(2.0),
        area=spacing**2 / (2.0 * sqrt(2.0)),
        sides=_sides(sites),
    )


def voronoi(
    size: Sequence[float],
    spacing: float,
    plane: str | None = "strain",
    thickness: float = 1.0,
    seed: int = 0,
    relaxations: int = 20,
) -> Packing:
    """Random Voronoi cells filling a box from the origin, relaxed towards their centroids.

    size: two edges [m] of a plane box, or three of one in space, where plane and thickness have no
    meaning; spacing [m]: of a hexagonal (fcc) packing with as many elements; seed: of the random
    centres; relaxations: Lloyd sweeps, 0 for raw random cells, which cost a several times smaller
    time step (theory B8). Cells are clipped at the box.
    """
    from scipy.spatial import cKDTree

    dim = len(size)
    if dim not in (2, 3):
        raise InputError(f"size has {dim} entries; give two for the plane, three for space.")
    _box(size, spacing, dim)
    box = np.asarray(size, dtype=np.float64)
    cell = sqrt(3.0) / 2.0 * spacing**2 if dim == 2 else spacing**3 / sqrt(2.0)
    count = round(box.prod() / cell)
    if count < dim + 2:
        raise InputError("the box holds too few elements; enlarge size or reduce spacing.")
    points = np.random.default_rng(seed).random((count, dim)) * box
    points = points[cKDTree(points).indices]  # neighbours in space are neighbours in memory
    for _ in range(relaxations):
        points = _Cells(points, box, spacing).centroid
    cells = _Cells(points, box, spacing)
    inside = cells.wall < 0
    i, j = cells.pair[inside].T
    order = np.lexsort((j, i))
    bonds = np.stack([i, j], axis=1)[order]
    thickness = thickness if dim == 2 else 1.0
    return Packing(
        position=points,
        volume=cells.volume * thickness,
        bonds=bonds,
        area=cells.area[inside][order] * thickness,
        arms=cells.middle[inside][order][:, None, :] - points[bonds],
        plane=plane if dim == 2 else None,
        thickness=thickness,
        spacing=spacing,
        sides=cells.sides(),
    )


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


def _lattice(
    position: NDArray[np.floating],
    spacing: float,
    volume: float,
    area: float,
    sides: Mapping[str, Mask],
    plane: str | None = None,
    thickness: float = 1.0,
) -> Packing:
    from scipy.spatial import cKDTree

    bonds = cKDTree(position).query_pairs(1.01 * spacing, output_type="ndarray").astype(np.int64)
    bonds = bonds[np.lexsort((bonds[:, 1], bonds[:, 0]))]
    half = 0.5 * (position[bonds[:, 1]] - position[bonds[:, 0]])
    return Packing(
        position=position.astype(np.float64),
        volume=np.full(len(position), volume),
        bonds=bonds,
        area=np.full(len(bonds), area),
        arms=np.stack([half, -half], axis=1),
        plane=plane,
        thickness=thickness,
        spacing=spacing,
        sides=sides,
    )


class _Cells:
    """Voronoi cells clipped at a box by mirror images of the centres near its sides.

    Faces: pair (f, 2) of centres, or centre and image; wall (f,) the side of the box that the face
    lies on, or -1; area and middle (centroid) of the face. Cells: volume and centroid.
    """

    def __init__(self, points: Array, box: Array, spacing: float) -> None:
        from scipy.spatial import Voronoi

        n, dim = points.shape
        band = 8.0 * spacing
        images, origin, walls = [points], [np.arange(n)], [np.full(n, -1)]
        for axis in range(dim):
            for end, at in enumerate((0.0, box[axis])):
                near = np.flatnonzero(np.abs(points[:, axis] - at) < band)
                image = points[near].copy()
                image[:, axis] = 2.0 * at - image[:, axis]
                images.append(image)
                origin.append(near)
                walls.append(np.full(len(near), 2 * axis + end))
        cells = Voronoi(np.concatenate(images))
        pair = np.sort(cells.ridge_points, axis=1)
        # outer faces are those between a centre and its own image
        own = np.concatenate(origin)[pair[:, 1]] == pair[:, 0]
        wall = np.concatenate(walls)[pair[:, 1]]
        keep = (pair[:, 0] < n) & ((wall < 0) | own)
        self.pair, self.wall = pair[keep], wall[keep]
        vertices = [cells.ridge_vertices[f] for f in np.flatnonzero(keep)]
        self.area, self.middle = _faces(cells.vertices, vertices)
        true = self.area > 1e-12 * spacing ** (dim - 1)
        self.pair, self.wall = self.pair[true], self.wall[true]
        self.area, self.middle = self.area[true], self.middle[true]
        self.volume, moment = np.zeros(n), np.zeros((n, dim))
        for side in (0, 1):
            owner = self.pair[:, side] < n
            centre = points[self.pair[owner, side]]
            other = np.concatenate(images)[self.pair[owner, 1 - side]]
            # a cell is the cones from its centre to its faces
            cone = self.area[owner] * np.linalg.norm(other - centre, axis=1) / (2 * dim)
            np.add.at(self.volume, self.pair[owner, side], cone)
            middle = (dim * self.middle[owner] + centre) / (dim + 1)
            np.add.at(moment, self.pair[owner, side], cone[:, None] * middle)
        self.centroid = moment / self.volume[:, None]

    def sides(self) -> dict[str, Mask]:
        masks = {}
        for wall, name in enumerate(SIDES[: 2 * self.middle.shape[1]]):
            mask = np.zeros(len(self.volume), dtype=bool)
            mask[self.pair[self.wall == wall, 0]] = True
            masks[name] = mask
        return masks


def _faces(vertices: Array, faces: list[list[int]]) -> tuple[Array, Array]:
    """Area (in the plane: length) and centroid of convex faces given by their vertices in order."""
    count = np.array([len(f) for f in faces])
    first = np.cumsum(count) - count
    v = vertices[np.concatenate(faces)]
    if vertices.shape[1] == 2:
        a, b = v[first], v[first + 1]
        return np.linalg.norm(b - a, axis=1), 0.5 * (a + b)
    # a fan of triangles from each face's first vertex
    face = np.repeat(np.arange(len(faces)), count - 2)
    step = np.arange(len(face)) - np.repeat(np.cumsum(count - 2) - (count - 2), count - 2)
    a, b, c = v[first[face]], v[first[face] + step + 1], v[first[face] + step + 2]
    triangle = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    area = np.bincount(face, triangle, len(faces)).astype(np.float64)
    moment = np.zeros((len(faces), 3))
    np.add.at(moment, face, triangle[:, None] * (a + b + c) / 3.0)
    return area, moment / np.maximum(area, 1e-300)[:, None]


def _box(size: Sequence[float], spacing: float, dim: int) -> None:
    positive("size", size, (dim,))
    positive("spacing", spacing, ())


def _sites(size: Sequence[float], pitch: float) -> NDArray[np.int64]:
    """Integer places of a grid that fills a box, (n, dim)."""
    counts = [round(edge / pitch) for edge in size]
    _filled(*counts)
    return np.indices(counts).reshape(len(counts), -1).T


def _sides(sites: NDArray[np.int64], layers: int = 1) -> dict[str, Mask]:
    """The outermost `layers` planes of sites on each side."""
    sides = {}
    for axis, (low, high) in enumerate(zip(SIDES[::2], SIDES[1::2], strict=True)):
        if axis < sites.shape[1]:
            sides[low] = sites[:, axis] < layers
            sides[high] = sites[:, axis] > sites[:, axis].max() - layers
    return sides


def _filled(*counts: int) -> None:
    if min(counts) < 1:
        raise InputError("the box holds no element; enlarge size or reduce spacing.")

"""Voronoi and radical (Laguerre) cells, computed from the triangulation they are dual to."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import Array
from .packing import Mask

Ids = NDArray[np.int64]


@dataclass
class Cells:
    """Cells of n generators in a body, and the faces between them.

    volume [m^3, in the plane m^2] (n,), 0 of a generator without a cell; centroid (n, dim): of a
    cell in several pieces that of the largest; orphans (k, dim): centroids of the other pieces, and
    torn (k,) the cells they belong to. pair (b, 2), area (b,), arms (b, 2, dim): the faces as in
    Packing, with no thickness. sides: cells that touch the named sides of the body.
    """

    volume: Array
    centroid: Array
    orphans: Array
    torn: Ids
    pair: Ids = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    area: Array = field(default_factory=lambda: np.zeros(0))
    arms: Array = field(default_factory=lambda: np.zeros((0, 2, 0)))
    sides: dict[str, Mask] = field(default_factory=dict)


@dataclass
class Faces:
    """Whole faces: pair (f, 2), area (f,), centroid (f, dim); face (p,) of each part."""

    pair: Ids
    area: Array
    centroid: Array
    face: Ids


class Tessellation:
    """Cells of generators among images that bound them.

    x (m, dim): generators, the first n of which are real, then images; weight (m,): squares of the
    radii of a radical tessellation, or None. Faces come in parts, one for each edge of a face (in
    the plane there is one part): pair (p, 2) of generators, the first real; area, signed, and
    centroid of the triangle (segment) that the part is; ends (p, 2): rows of `vertex` that the edge
    joins, counterclockwise about the line from the first generator to the second.
    """

    def __init__(self, x: Array, n: int, weight: Array | None = None) -> None:
        self.x, self.n, self.weight = x, n, weight
        simplices, neighbours = _delaunay(x, weight)
        self.vertex = _centres(x, weight, simplices, neighbours)
        # the facet between two simplices is dual to the edge between their centres
        here, opposite = np.nonzero(neighbours > np.arange(len(simplices))[:, None])
        real = simplices.min(axis=1) < n
        keep = real[here]
        here, opposite = here[keep], opposite[keep]
        there = neighbours[here, opposite]
        apex = simplices[here, opposite]
        dim = x.shape[1]
        rest = np.array([[k for k in range(dim + 1) if k != o] for o in range(dim + 1)])
        facet = np.sort(np.take_along_axis(simplices[here], rest[opposite], axis=1), axis=1)
        if x.shape[1] == 2:
            keep = facet[:, 0] < n
            self.pair, self.ends = facet[keep], np.stack([here, there], axis=1)[keep]
            a, b = self.vertex[self.ends.T]
            self.area, self.centroid = np.linalg.norm(b - a, axis=1), 0.5 * (a + b)
        else:
            other = simplices[there].sum(axis=1) - facet.sum(axis=1)
            self._triangles(facet, np.stack([here, there], axis=1), x[other] - x[apex])

    def _triangles(self, facet: Ids, ends: Ids, across: Array) -> None:
        """Triangles from the foot of a face, on its generators' line, to the edges of the face.

        facet (e, 3): the generators round each edge; across (e, 3): from behind the facet to beyond
        it. Lengths of edges are never negative, so that rounding cannot turn a face over.
        """
        a, b = self.vertex[ends.T]
        length, edge = np.linalg.norm(b - a, axis=1), 0.5 * (a + b)
        pairs, parts, areas, centroids = [], [], [], []
        for i, j, k in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            use = facet[:, i] < self.n
            f, middle = facet[use], edge[use]
            xi = self.x[f[:, i]]
            axis = self.x[f[:, j]] - xi
            axis /= np.linalg.norm(axis, axis=1)[:, None]
            foot = xi + dot(middle - xi, axis)[:, None] * axis
            out = self.x[f[:, k]] - xi  # the edge is the third generator's bound
            out -= dot(out, axis)[:, None] * axis
            out /= np.linalg.norm(out, axis=1)[:, None]
            back = dot(across[use], np.cross(axis, out)) < 0.0
            pairs.append(f[:, [i, j]])
            parts.append(np.where(back[:, None], ends[use][:, ::-1], ends[use]))
            areas.append(0.5 * length[use] * dot(middle - foot, out))
            centroids.append((foot + 2.0 * middle) / 3.0)
        self.pair, self.ends = np.concatenate(pairs), np.concatenate(parts)
        self.area, self.centroid = np.concatenate(areas), np.concatenate(centroids)

    def measures(self) -> tuple[Array, Array]:
        """Volume (n,) and centroid (n, dim) of the cells, as cones from generators to faces."""
        n, dim = self.n, self.x.shape[1]
        volume, moment = np.zeros(n), np.zeros((n, dim))
        xi, xj = self.x[self.pair[:, 0]], self.x[self.pair[:, 1]]
        length = np.linalg.norm(xj - xi, axis=1)
        height = 0.5 * length
        if self.weight is not None:
            w = self.weight[self.pair]
            height += 0.5 * (w[:, 0] - w[:, 1]) / length
        for side, centre, h in ((0, xi, height), (1, xj, length - height)):
            real = self.pair[:, side] < n
            own = self.pair[real, side]
            cone = self.area[real] * h[real] / dim
            volume += np.bincount(own, cone, minlength=n)
            at = (dim * self.centroid[real] + centre[real]) / (dim + 1)
            for k in range(dim):
                moment[:, k] += np.bincount(own, cone * at[:, k], minlength=n)
        return volume, moment / np.where(volume > 0.0, volume, 1.0)[:, None]

    def faces(self) -> Faces:
        """The parts put together."""
        key = self.pair[:, 0] * len(self.x) + self.pair[:, 1]
        unique, face = np.unique(key, return_inverse=True)
        area: Array = np.bincount(face, self.area, len(unique)).astype(np.float64)
        moment = [np.bincount(face, self.area * c, len(unique)) for c in self.centroid.T]
        centroid = np.stack(moment, axis=1) / np.where(area == 0.0, 1.0, area)[:, None]
        pair = np.stack(np.divmod(unique, len(self.x)), axis=1)
        return Faces(pair, area, centroid, face)

    def reach(self) -> Array:
        """Distance (n,) from each generator to the farthest vertex of its cell."""
        far = np.zeros(self.n)
        for side in (0, 1):
            real = self.pair[:, side] < self.n
            own = self.pair[real, side]
            for end in (0, 1):
                way = self.vertex[self.ends[real, end]] - self.x[own]
                np.maximum.at(far, own, np.linalg.norm(way, axis=1))
        return far


def dot(a: Array, b: Array) -> Array:
    """Scalar products of rows."""
    return np.einsum("ij,ij->i", a, b)


def _delaunay(x: Array, weight: Array | None) -> tuple[Ids, Ids]:
    """Simplices of the (weighted) Delaunay triangulation and their neighbours, -1 for none."""
    from scipy.spatial import ConvexHull, Delaunay

    if weight is None:
        mesh = Delaunay(x)
        return mesh.simplices.astype(np.int64), mesh.neighbors
    # the lower hull of the generators lifted onto a paraboloid
    y = x - x.mean(axis=0)
    hull = ConvexHull(np.concatenate([y, (dot(y, y) - weight)[:, None]], axis=1))
    lower = hull.equations[:, -2] < 0.0
    number = np.full(len(lower), -1)
    number[lower] = np.arange(lower.sum())
    return hull.simplices[lower].astype(np.int64), number[hull.neighbors[lower]]


def _centres(x: Array, weight: Array | None, simplices: Ids, neighbours: Ids) -> Array:
    """The point of equal distance (power) from the corners of each simplex."""
    base = x[simplices[:, 0]]
    edge = x[simplices[:, 1:]] - base[:, None]
    square = (edge**2).sum(axis=2)
    right = 0.5 * square
    if weight is not None:
        right -= 0.5 * (weight[simplices[:, 1:]] - weight[simplices[:, :1]])
    flat = np.abs(np.linalg.det(edge)) < 1e-11 * np.sqrt(square.prod(axis=1))
    edge[flat] = np.eye(x.shape[1])
    centre = base + np.linalg.solve(edge, right[..., None])[..., 0]
    while flat.any():
        # a flat simplex lies between neighbours whose centres may be taken for its own
        good = (neighbours >= 0) & ~flat[neighbours]
        at = np.flatnonzero(flat & good.any(axis=1))
        if not len(at):
            break
        centre[at] = centre[neighbours[at, good[at].argmax(axis=1)]]
        flat[at] = False
    return centre

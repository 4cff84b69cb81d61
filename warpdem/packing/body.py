"""Bodies that generators are put into: which points they hold, and the cells clipped to them."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Array, InputError, library
from .packing import SIDES, Mask, repeated
from .shapes import Box, Outline, Shape, Surface, enclosed, place
from .tessellation import Cells, Faces, Ids, Tessellation, dot


def body_of(shape: Shape, step: float, periodic: bool | str) -> "Body":
    """The body of a shape, curves divided into steps [m]."""
    if isinstance(shape, Box):
        return Walls(shape, repeated(periodic, len(shape.size)))
    if periodic:
        raise InputError("only boxes are periodic; give a box or leave periodic out.")
    if hasattr(shape, "outline"):
        return Plane(shape.outline(step))
    if hasattr(shape, "surface"):
        return Solid(shape.surface(step), step)
    raise InputError(f"{shape!r} is no shape; give edges of a box or one of wd.packing's shapes.")


class Body(ABC):
    """What a shape is to generators: low and high corners (dim,), volume [m^3 or m^2].

    period (dim,): of one that repeats, inf along axes along which it does not.
    """

    low: Array
    high: Array
    volume: float
    period: Array | None = None

    @property
    def dim(self) -> int:
        """Dimension of space, 2 or 3."""
        return len(self.low)

    def wrapped(self, x: Array) -> Array:
        """Points of a periodic body where they are inside it."""
        return x

    @abstractmethod
    def contains(self, x: Array) -> Mask:
        """Which points lie inside."""

    @abstractmethod
    def cells(self, x: Array, weight: Array | None, faces: bool) -> Cells:
        """The cells of generators, with faces and sides if asked for."""


class Walls(Body):
    """A box. Images bound the cells: mirrored beyond its walls, shifted where it repeats."""

    def __init__(self, box: Box, repeats: Mask) -> None:
        assert box.corner is not None
        self.low = np.asarray(box.corner, dtype=np.float64)
        self.high = self.low + np.asarray(box.size)
        self.volume = float(np.prod(self.high - self.low))
        self.repeats, self._band = repeats, 0.0
        if repeats.any():
            self.period = np.where(repeats, self.high - self.low, inf)

    def wrapped(self, x: Array) -> Array:
        """Points where they are inside the box."""
        return np.where(self.repeats, self.low + (x - self.low) % (self.high - self.low), x)

    def contains(self, x: Array) -> Mask:
        """Which points lie inside."""
        return np.asarray(((x > self.low) & (x < self.high)).all(axis=1))

    def cells(self, x: Array, weight: Array | None, faces: bool) -> Cells:
        """The cells of generators, with faces and sides if asked for."""
        n, spacing = len(x), _spacing(self, len(x))
        band, blur = max(1.5 * spacing, self._band), 0.0 if faces else 1e-3
        while True:
            image, origin, wall = self._images(x, band, blur)
            w = None if weight is None else weight[origin]
            tessellation = Tessellation(image, n, w)
            if self._bounded(tessellation, band, 1e-6 + 10.0 * blur):
                break
            band *= 2.0
        if self.repeats.any():  # cells shrink from sweep to sweep: the next needs no wider one
            self._band = 2.05 * float(tessellation.reach().max())
        volume, centroid = tessellation.measures()
        cells = Cells(volume, centroid, np.zeros((0, self.dim)), np.zeros(0, dtype=np.int64))
        if not faces:
            return cells
        f = _whole(tessellation.faces(), spacing)
        i, j = f.pair.T
        arms = f.centroid[:, None] - image[f.pair]
        own = (origin[j] == i) & (wall[j] >= 0)
        # a face through a side of a periodic box is met from both sides of it
        joins = (wall[j] < 0) & ((j < n) | (i < origin[j]))
        cells.pair = np.stack([i, origin[j]], axis=1)[joins]
        cells.area, cells.arms = f.area[joins], arms[joins]
        for k, name in enumerate(SIDES[: 2 * self.dim]):
            if self.repeats[k // 2]:
                continue
            cells.sides[name] = np.zeros(n, dtype=bool)
            cells.sides[name][i[own & (wall[j] == k)]] = True
        return cells

    def _images(self, x: Array, band: float, blur: float) -> tuple[Array, Ids, Ids]:
        """Generators and images of those near a side; whose they are; the wall of a mirror, or -1.

        Mirrored ones are blurred, by a part of their distance, where cells need not be exact: equal
        distances are a triangulation's slow case.
        """
        rng = np.random.default_rng(0)
        images, origin, walls = [x], [np.arange(len(x))], [np.full(len(x), -1)]
        for axis in np.flatnonzero(~self.repeats):
            for end, at in enumerate((self.low[axis], self.high[axis])):
                near = np.flatnonzero(np.abs(x[:, axis] - at) < band)
                image = x[near].copy()
                way = at - image[:, axis]
                image[:, axis] += 2.0 * way * (1.0 + blur * rng.random(len(near)))
                images.append(image)
                origin.append(near)
                walls.append(np.full(len(near), 2 * axis + end))
        image, whose, wall = (np.concatenate(each) for each in (images, origin, walls))
        for axis in np.flatnonzero(self.repeats):
            at = image[:, axis]
            below = np.flatnonzero(at < self.low[axis] + band)
            above = np.flatnonzero(at > self.high[axis] - band)
            shift = np.zeros(self.dim)
            shift[axis] = self.high[axis] - self.low[axis]
            image = np.concatenate([image, image[below] + shift, image[above] - shift])
            whose = np.concatenate([whose, whose[below], whose[above]])
            wall = np.concatenate([wall, wall[below], wall[above]])
        return image, whose, wall

    def _bounded(self, tessellation: Tessellation, band: float, tiny: float) -> bool:
        """Whether the images that there are bound every cell at the sides."""
        if band > 2.0 * (self.high - self.low).max():
            return True
        if self.repeats.any() and 2.0 * tessellation.reach().max() >= band:
            return False
        v = tessellation.vertex[tessellation.ends.ravel()]
        inside = (v > self.low - tiny * band) & (v < self.high + tiny * band)
        return bool(inside[:, ~self.repeats].all())


class Plane(Body):
    """A plane body with an outline of straight edges."""

    def __init__(self, outline: Outline) -> None:
        self.shapely = shapely = library("shapely", "geometry")
        self.polygon = shapely.Polygon(outline.rings[0], outline.rings[1:])
        if not shapely.is_valid(self.polygon):
            raise InputError(
                f"the outline crosses or touches itself: {shapely.is_valid_reason(self.polygon)}; "
                "give simple rings, holes inside the outer and apart from each other."
            )
        shapely.prepare(self.polygon)
        self.low, self.high = np.reshape(self.polygon.bounds, (2, 2))
        self.volume = self.polygon.area
        edges: dict[str, list[Array]] = {}
        for ring, names in zip(outline.rings, outline.sides, strict=True):
            for a, b, name in zip(ring, np.roll(ring, -1, axis=0), names, strict=True):
                edges.setdefault(name, []).append(np.stack([a, b]))
        self.lines = {name: shapely.MultiLineString(parts) for name, parts in edges.items()}

    def contains(self, x: Array) -> Mask:
        """Which points lie inside."""
        return self.shapely.contains_xy(self.polygon, x)

    def cells(self, x: Array, weight: Array | None, faces: bool) -> Cells:
        """The cells of generators, with faces and sides if asked for."""
        shapely = self.shapely
        n, spacing = len(x), _spacing(self, len(x))
        tessellation = _among_far(self, x, weight)
        volume, centroid = tessellation.measures()
        cell, polygon = self._polygons(tessellation)
        crossing = ~shapely.contains_properly(self.polygon, polygon)
        cut = cell[crossing]
        clipped = shapely.intersection(polygon[crossing], self.polygon)
        volume[cut] = shapely.area(clipped)
        part, owner = shapely.get_parts(clipped, return_index=True)
        part, owner = part[shapely.area(part) > 0.0], cut[owner][shapely.area(part) > 0.0]
        area = shapely.area(part)
        main, orphan = _largest(owner, area, spacing**2)
        middle = self._centroid(part)
        centroid[owner[main]] = middle[main]
        cells = Cells(volume, centroid, middle[orphan], owner[orphan])
        if not faces:
            return cells
        f = tessellation.faces()
        i, j = f.pair.T
        both = np.zeros(len(tessellation.x), dtype=bool)
        both[cut] = True
        at = np.flatnonzero(both[i] & both[j])
        line = shapely.linestrings(tessellation.vertex[tessellation.ends[_first(f.face)[at]]])
        line = shapely.intersection(line, self.polygon)
        f.area[at] = shapely.length(line)
        at, line = at[f.area[at] > 0.0], line[f.area[at] > 0.0]
        f.centroid[at] = self._centroid(line)
        f.area[j >= n] = 0.0
        f = _whole(f, spacing)
        cells.pair, cells.area = f.pair, f.area
        cells.arms = f.centroid[:, None] - x[f.pair]
        cells.sides = self._sides(n, part, owner, spacing)
        return cells

    def _centroid(self, parts: NDArray) -> Array:
        return self.shapely.get_coordinates(self.shapely.centroid(parts))

    def _polygons(self, tessellation: Tessellation) -> tuple[Ids, NDArray]:
        """Generators that have a cell, and these cells before clipping."""
        cells, vertices = [], []
        for side in (0, 1):
            real = tessellation.pair[:, side] < tessellation.n
            for end in (0, 1):
                cells.append(tessellation.pair[real, side])
                vertices.append(tessellation.ends[real, end])
        corners = np.unique([np.concatenate(cells), np.concatenate(vertices)], axis=1)
        cell, number, count = np.unique(corners[0], return_inverse=True, return_counts=True)
        at = tessellation.vertex[corners[1]]
        middle = np.stack([np.bincount(number, a) / count for a in at.T], axis=1)
        x, y = (at - middle[number]).T
        order = np.lexsort((np.arctan2(y, x), number))
        rings = self.shapely.linearrings(at[order], indices=number[order])
        return cell, self.shapely.polygons(rings)

    def _sides(self, n: int, part: Array, owner: Ids, spacing: float) -> dict[str, Mask]:
        shapely = self.shapely
        ring, of = shapely.get_rings(part, return_index=True)
        point, of_ring = shapely.get_coordinates(ring, return_index=True)
        same = of_ring[1:] == of_ring[:-1]
        middle = shapely.points(0.5 * (point[1:] + point[:-1])[same])
        cell = owner[of[of_ring[1:][same]]]
        sides = {}
        for name, line in self.lines.items():
            shapely.prepare(line)
            sides[name] = np.zeros(n, dtype=bool)
            sides[name][cell[shapely.dwithin(middle, line, 1e-7 * spacing)]] = True
        holes = [mask for name, mask in sides.items() if name.startswith("hole ")]
        if holes:
            sides["hole"] = np.any(holes, axis=0)
        return sides


@dataclass
class _Clipped:
    """Corners of triangles (t, 3, 3) that bound clipped cells, and of each the piece (t,), the side
    of the body (t,) or -1, and the face between cells (t,) or -1; the cell of each piece (p,)."""

    triangles: Array
    piece: Ids
    cell: Ids
    side: Ids
    face: Ids


class Solid(Body):
    """A body of space in a closed triangle mesh."""

    def __init__(self, surface: Surface, step: float) -> None:
        self.manifold = library("manifold3d", "geometry")
        self.surface = surface
        self.low, self.high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
        self.volume = enclosed(surface.vertices, surface.triangles)
        self.mesh, self.number = self._made(surface.vertices, surface.triangles)
        once = (self.mesh + self.mesh).volume()
        if abs(once - self.volume) > 1e-9 * self.volume:
            raise InputError(
                f"the mesh passes through itself: it encloses {self.volume:.10g} m^3, but parts of "
                "that twice or inside out; repair it or give the union of its parts."
            )
        self.step = step

    @cached_property
    def samples(self) -> tuple[Array, float]:
        """Points of the surface, (m, 3), and how far a point of it may be from the nearest."""
        mesh = self.mesh.refine_to_length(self.step).to_mesh64()
        x = mesh.vert_properties[:, :3]
        corner = x[mesh.tri_verts.astype(np.int64)]
        edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
        return x, float(edge.max()) / sqrt(3.0)

    def contains(self, x: Array) -> Mask:
        """Which points lie inside."""
        inside = np.asarray(((x > self.low) & (x < self.high)).all(axis=1))
        beyond = self.high + 0.137 * (self.high - self.low)
        for k in np.flatnonzero(inside):
            inside[k] = len(self.mesh.ray_cast(x[k], [x[k, 0], x[k, 1], beyond[2]])) % 2
        return inside

    def cells(self, x: Array, weight: Array | None, faces: bool) -> Cells:
        """The cells of generators, with faces and sides if asked for."""
        from scipy.spatial import cKDTree

        n, spacing = len(x), _spacing(self, len(x))
        tessellation = _among_far(self, x, weight)
        volume, centroid = tessellation.measures()
        f = tessellation.faces()
        points, gap = self.samples
        cut = cKDTree(points).query(x)[0] - gap < tessellation.reach()
        c = self._clipped(tessellation, f, cut)
        # a piece is cones from its cell's centre
        corner = c.triangles - x[c.cell[c.piece]][:, None]
        cone = dot(corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6.0
        share: Array = np.bincount(c.piece, cone).astype(np.float64)
        moment = [np.bincount(c.piece, cone * m) for m in corner.sum(axis=1).T / 4.0]
        middle = x[c.cell] + np.stack(moment, axis=1) / np.where(share == 0.0, 1.0, share)[:, None]
        volume[cut] = 0.0
        volume += np.bincount(c.cell, share, n)
        main, orphan = _largest(c.cell, share, spacing**3)
        centroid[c.cell[main]] = middle[main]
        cells = Cells(volume, centroid, middle[orphan], c.cell[orphan])
        if not faces:
            return cells
        f.area[f.pair[:, 1] >= n] = 0.0
        self._clip(f, c, cut)
        f = _whole(f, spacing)
        cells.pair, cells.area = f.pair, f.area
        cells.arms = f.centroid[:, None] - x[f.pair]
        for k, name in enumerate(self.surface.sides):
            cells.sides[name] = np.zeros(n, dtype=bool)
            cells.sides[name][c.cell[c.piece[c.side == k]]] = True
        return cells

    def _clipped(self, tessellation: Tessellation, f: Faces, cut: Mask) -> "_Clipped":
        """What the body leaves of the cells to be cut."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        vertices, triangles, cell, face = self._polyhedra(tessellation, f, cut)
        result = (self._made(vertices, triangles)[0] ^ self.mesh).to_mesh64()
        at, tri = result.vert_properties[:, :3], result.tri_verts.astype(np.int64)
        source = np.asarray(result.face_id, dtype=np.int64)
        start, mesh = np.asarray(result.run_index), np.asarray(result.run_original_id)
        free = np.repeat(mesh, np.diff(start).astype(np.int64) // 3) == self.number
        # triangles that hang together bound a piece of the cell whose faces are among them
        ends = (tri[:, [0, 0]].ravel(), tri[:, 1:].ravel())
        graph = coo_array((np.ones(2 * len(tri)), ends), shape=(len(at),) * 2)
        pieces, label = connected_components(graph, directed=False)
        piece = label[tri[:, 0]]
        owner = np.full(pieces, -1)
        owner[piece[~free]] = cell[source[~free]]
        lost = owner[piece] < 0
        if lost.any():
            raise InputError(
                f"a part of the surface, near {place(at[tri[lost][0, 0]])}, lies inside one cell; "
                "reduce spacing or leave that part out."
            )
        side, on = np.full((2, len(tri)), -1)
        side[free], on[~free] = self.surface.side[source[free]], face[source[~free]]
        return _Clipped(at[tri], piece, owner, side, on)

    def _clip(self, f: Faces, c: "_Clipped", cut: Mask) -> None:
        """Give faces between two cut cells, found on the first of them, what is left of them."""
        i, j = f.pair.T
        both = np.append(cut, np.zeros(j.max() + 1, dtype=bool))
        both = both[i] & both[j] & (j < len(cut))
        part = np.flatnonzero(c.face >= 0)
        part = part[both[c.face[part]] & (i[c.face[part]] == c.cell[c.piece[part]])]
        a, b, d = np.moveaxis(c.triangles[part], 1, 0)
        area, face = 0.5 * np.linalg.norm(np.cross(b - a, d - a), axis=1), c.face[part]
        f.area[both] = np.bincount(face, area, len(both))[both]
        unit = np.where(f.area == 0.0, 1.0, f.area)
        for k in range(3):
            moment = np.bincount(face, area * (a + b + d)[:, k] / 3.0, len(both))
            f.centroid[both, k] = (moment / unit)[both]

    def _polyhedra(
        self, tessellation: Tessellation, f: Faces, cut: Mask
    ) -> tuple[Array, Ids, Ids, Ids]:
        """One mesh of the cells to be cut: vertices, triangles, and the cell and face of each.

        Cells share no vertices. Every part of a face is a triangle with the face's middle.
        """
        m = len(tessellation.vertex)
        real = np.append(cut, np.zeros(len(tessellation.x) - len(cut), dtype=bool))
        count = 2 * np.bincount(f.face)
        hub = np.stack(
            [np.bincount(f.face, tessellation.vertex[tessellation.ends, k].sum(axis=1)) / count
             for k in range(3)], axis=1)  # fmt: skip
        corner, cell, face = [], [], []
        for side in (0, 1):
            use = np.flatnonzero(real[tessellation.pair[:, side]])
            ends = tessellation.ends[use]
            ends = ends if side == 0 else ends[:, ::-1]
            corner.append(np.concatenate([m + f.face[use, None], ends], axis=1))
            cell.append(tessellation.pair[use, side])
            face.append(f.face[use])
        corners, cells = np.concatenate(corner), np.concatenate(cell)
        key = cells[:, None] * (m + len(hub)) + corners
        unique, triangles = np.unique(key, return_inverse=True)
        vertices = np.concatenate([tessellation.vertex, hub])[unique % (m + len(hub))]
        return vertices, triangles.reshape(-1, 3), cells, np.concatenate(face)

    def _made(self, vertices: Array, triangles: Ids) -> tuple[Any, int]:
        """A mesh whose triangles keep their numbers when it is cut, and the number of the mesh."""
        m = self.manifold
        number = m.Manifold.reserve_ids(1)
        mesh = m.Manifold(
            m.Mesh64(
                np.ascontiguousarray(vertices),
                triangles.astype(np.uint64),
                run_index=np.array([0, 3 * len(triangles)], dtype=np.uint64),
                run_original_id=np.array([number], dtype=np.uint32),
                face_id=np.arange(len(triangles), dtype=np.uint64),
            )
        )
        if mesh.status() != m.Error.NoError:
            raise InputError(f"the mesh is not closed and manifold: {mesh.status()}; repair it.")
        return mesh, number


def _spacing(body: Body, count: int) -> float:
    """A length of the order of the distance of neighbours [m]."""
    return float((body.volume / count) ** (1.0 / body.dim))


def _among_far(body: Body, x: Array, weight: Array | None) -> Tessellation:
    """Cells bounded by a few far generators, so that a body lies well inside the bounds."""
    dim = body.dim
    signs = np.indices((2,) * dim).reshape(dim, -1).T * 2.0 - 1.0
    # no two at one distance: equal distances are a triangulation's hard case
    signs *= 1.0 + 0.01 * np.random.default_rng(0).random(signs.shape)
    size = np.linalg.norm(body.high - body.low)
    far = 0.5 * (body.low + body.high) + 4.0 * size * signs
    w = None if weight is None else np.append(weight, np.full(len(far), weight.mean()))
    return Tessellation(np.concatenate([x, far]), len(x), w)


def _whole(f: Faces, spacing: float) -> Faces:
    """Faces without those that rounding makes of corners and edges at which cells touch."""
    dim = f.centroid.shape[1]
    keep = f.area > 1e-11 * spacing ** (dim - 1)
    return Faces(f.pair[keep], f.area[keep], f.centroid[keep], f.face)


def _largest(owner: Ids, size: Array, unit: float) -> tuple[Mask, Mask]:
    """Which pieces are the largest of their owners, and which others are not mere rounding."""
    main = np.zeros(len(owner), dtype=bool)
    order = np.lexsort((-size, owner))
    main[order[np.append(True, np.diff(owner[order]) != 0)[: len(order)]]] = True
    return main, ~main & (size > 1e-9 * unit)


def _first(face: Ids) -> Ids:
    """The first part of each face."""
    return np.unique(face, return_index=True)[1]

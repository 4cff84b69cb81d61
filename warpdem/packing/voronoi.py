"""Voronoi packings."""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import Array, InputError
from .packing import SIDES, Mask, Packing, check_box


def voronoi(
    size: Sequence[float],
    spacing: float,
    plane: str | None = "strain",
    thickness: float = 1.0,
    seed: int = 0,
    relaxations: int = 20,
    periodic: bool = False,
) -> Packing:
    """Random Voronoi cells filling a box from the origin, relaxed towards their centroids.

    size: two edges [m] of a plane box, or three of one in space, where plane and thickness have no
    meaning; spacing [m]: of a hexagonal (fcc) packing with as many elements; seed: of the random
    centres; relaxations: Lloyd sweeps, 0 for raw random cells, which cost a several times smaller
    time step (theory B8). Cells are clipped at the box, or, if periodic, repeat with it.
    """
    from scipy.spatial import cKDTree

    dim = len(size)
    if dim not in (2, 3):
        raise InputError(f"size has {dim} entries; give two for the plane, three for space.")
    check_box(size, spacing, dim)
    box = np.asarray(size, dtype=np.float64)
    cell = sqrt(3.0) / 2.0 * spacing**2 if dim == 2 else spacing**3 / sqrt(2.0)
    count = round(box.prod() / cell)
    if count < dim + 2:
        raise InputError("the box holds too few elements; enlarge size or reduce spacing.")
    points = np.random.default_rng(seed).random((count, dim)) * box
    points = points[cKDTree(points).indices]  # neighbours in space are neighbours in memory
    for _ in range(relaxations):
        points = _Cells(points, box, spacing, periodic).centroid % box
    cells = _Cells(points, box, spacing, periodic)
    i, j = cells.joined.T
    order = np.lexsort((j, i))
    thickness = thickness if dim == 2 else 1.0
    return Packing(
        position=points,
        volume=cells.volume * thickness,
        bonds=cells.joined[order],
        area=cells.area[cells.joins][order] * thickness,
        arms=cells.arms[cells.joins][order],
        period=box if periodic else None,
        plane=plane if dim == 2 else None,
        thickness=thickness,
        spacing=spacing,
        sides={} if periodic else cells.sides(),
    )


class _Cells:
    """Voronoi cells of centres in a box, clipped by mirror images of those near its sides, or
    repeated with it.

    Faces: pair (f, 2) of centres, or centre and image; wall (f,) the side of the box that the face
    lies on, or -1; area; arms (f, 2, dim) from both to the face's centroid; joins (f,): whether it
    is a bond, and joined: the centres of those. Cells: volume and centroid.
    """

    def __init__(self, points: Array, box: Array, spacing: float, periodic: bool) -> None:
        from scipy.spatial import Voronoi

        n, dim = points.shape
        images, origin, walls = (_repeated if periodic else _mirrored)(points, box, 8.0 * spacing)
        cells = Voronoi(images)
        pair = np.sort(cells.ridge_points, axis=1)
        # outer faces are those between a centre and its own image
        own = origin[pair[:, 1]] == pair[:, 0]
        keep = (pair[:, 0] < n) & ((walls[pair[:, 1]] < 0) | own)
        pair = pair[keep]
        vertices = [cells.ridge_vertices[f] for f in np.flatnonzero(keep)]
        area, middle = _faces(cells.vertices, vertices)
        true = area > 1e-12 * spacing ** (dim - 1)
        pair, area, middle = pair[true], area[true], middle[true]
        self.pair, self.area, self.wall = pair, area, walls[pair[:, 1]]
        self.arms = middle[:, None, :] - images[pair]
        both = origin[pair]
        # a face through a side of a periodic box is met from both sides of it
        self.joins = (self.wall < 0) & ((pair[:, 1] < n) | (both[:, 0] < both[:, 1]))
        self.joined = both[self.joins]
        self.volume, moment = np.zeros(n), np.zeros((n, dim))
        for side in (0, 1):
            owner = self.pair[:, side] < n
            centre = points[pair[owner, side]]
            other = images[pair[owner, 1 - side]]
            # a cell is the cones from its centre to its faces
            cone = area[owner] * np.linalg.norm(other - centre, axis=1) / (2 * dim)
            np.add.at(self.volume, pair[owner, side], cone)
            at = (dim * middle[owner] + centre) / (dim + 1)
            np.add.at(moment, pair[owner, side], cone[:, None] * at)
        self.centroid = moment / self.volume[:, None]

    def sides(self) -> dict[str, Mask]:
        masks = {}
        for wall, name in enumerate(SIDES[: 2 * self.arms.shape[2]]):
            mask = np.zeros(len(self.volume), dtype=bool)
            mask[self.pair[self.wall == wall, 0]] = True
            masks[name] = mask
        return masks


def _mirrored(
    points: Array, box: Array, band: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Centres and mirror images of those near a side; whose they are; the side, or -1."""
    n, dim = points.shape
    images, origin, walls = [points], [np.arange(n)], [np.full(n, -1)]
    for axis in range(dim):
        for end, at in enumerate((0.0, box[axis])):
            near = np.flatnonzero(np.abs(points[:, axis] - at) < band)
            image = points[near].copy()
            image[:, axis] = 2.0 * at - image[:, axis]
            images.append(image)
            origin.append(near)
            walls.append(np.full(len(near), 2 * axis + end))
    return np.concatenate(images), np.concatenate(origin), np.concatenate(walls)


def _repeated(
    points: Array, box: Array, band: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Centres and those of neighbouring boxes near a side; whose they are; -1 for no side."""
    images, origin = points, np.arange(len(points))
    for axis, edge in enumerate(box):
        x = images[:, axis]
        below, above = np.flatnonzero(x < band), np.flatnonzero(x > edge - band)
        shift = np.zeros(len(box))
        shift[axis] = edge
        images = np.concatenate([images, images[below] + shift, images[above] - shift])
        origin = np.concatenate([origin, origin[below], origin[above]])
    return images, origin, np.full(len(images), -1)


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

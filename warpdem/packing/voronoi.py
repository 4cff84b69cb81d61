"""Voronoi packings."""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from ..errors import Array, InputError
from .packing import SIDES, Mask, Packing, check_box


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
    check_box(size, spacing, dim)
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

"""Shapes that packings fill."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, pi, sin, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Array, InputError, checked, entries, finite, first_ids, positive

Point = Sequence[float]


@dataclass(frozen=True)
class Outline:
    """Closed rings of a plane body: the outer, then its holes; the side that each edge lies on."""

    rings: list[Array]
    sides: list[list[str]]


@dataclass(frozen=True)
class Surface:
    """Closed mesh: vertices (v, 3), triangles (t, 3) and the side that each lies on (t,), a place
    in `sides`."""

    vertices: Array
    triangles: NDArray[np.int64]
    side: NDArray[np.int64]
    sides: list[str]


@checked
@dataclass(frozen=True)
class Box:
    """A box of the plane or of space: its edges [m]; corner [m]: the lower one.

    Sides: left, right, bottom, top, back, front.
    """

    size: Point
    corner: Point | None = None

    def __post_init__(self) -> None:
        size = positive("size", self.size, (None,))
        if len(size) not in (2, 3):
            raise InputError(
                f"size has {len(size)} entries; give two for the plane, three for space."
            )
        corner = (0.0,) * len(size) if self.corner is None else self.corner
        finite("corner", corner, (len(size),))
        object.__setattr__(self, "corner", corner)


@checked
@dataclass(frozen=True)
class Disc:
    """A disc: radius and centre [m]. Side: outer."""

    radius: float
    centre: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        positive("radius", self.radius, ())
        finite("centre", self.centre, (2,))

    def outline(self, step: float) -> Outline:
        """A polygon of the circle's area, edges about `step` [m]."""
        ring = _circle(self.radius, self.centre, step)
        return Outline([ring], [["outer"] * len(ring)])


@checked
@dataclass(frozen=True)
class Ring:
    """A ring: inner and outer radius, centre [m]. Sides: inner, outer."""

    inner: float
    outer: float
    centre: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        positive("inner", self.inner, ())
        if not positive("outer", self.outer, ()) > self.inner:
            raise InputError(f"outer is {self.outer:g}; it must exceed inner, {self.inner:g}.")
        finite("centre", self.centre, (2,))

    def outline(self, step: float) -> Outline:
        """Polygons of the circles' areas, edges about `step` [m]."""
        rings = [_circle(r, self.centre, step) for r in (self.outer, self.inner)]
        return Outline(rings, [["outer"] * len(rings[0]), ["inner"] * len(rings[1])])


@checked
@dataclass(frozen=True)
class Polygon:
    """A polygon: corners [m] (m, 2) of its outline and of each hole, in either sense.

    Sides: outer and hole; of several holes also "hole 0", "hole 1" and so on.
    """

    corners: ArrayLike
    holes: Sequence[ArrayLike] = ()

    def outline(self, step: float) -> Outline:
        """The rings as they are."""
        rings = [finite("corners", self.corners, (None, 2))]
        rings += [finite(f"hole {k}", hole, (None, 2)) for k, hole in enumerate(self.holes)]
        for ring in rings:
            if len(ring) < 3:
                raise InputError(f"a ring of the polygon has {len(ring)} corners; give at least 3.")
        names = ["outer", *_hole_names(len(self.holes))]
        return Outline(rings, [[name] * len(ring) for name, ring in zip(names, rings, strict=True)])


@checked
@dataclass(frozen=True)
class Plate:
    """A plane box with holes, discs or corners [m] (m, 2) of polygons; corner [m]: the lower one.

    Sides: left, right, bottom, top and hole; of several holes also "hole 0", "hole 1" and so on.
    """

    size: Point
    holes: Sequence[Disc | ArrayLike] = ()
    corner: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        positive("size", self.size, (2,))
        finite("corner", self.corner, (2,))

    def outline(self, step: float) -> Outline:
        """The box and its holes, discs as polygons of their area with edges about `step` [m]."""
        holes = [h.outline(step).rings[0] if isinstance(h, Disc) else h for h in self.holes]
        unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        box = np.asarray(self.corner) + unit * np.asarray(self.size)
        outline = Polygon(box, holes).outline(step)
        outline.sides[0] = ["bottom", "right", "top", "left"]
        return outline


@checked
@dataclass(frozen=True)
class Sphere:
    """A sphere: radius and centre [m]. Side: outer."""

    radius: float
    centre: Point = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        positive("radius", self.radius, ())
        finite("centre", self.centre, (3,))

    def surface(self, step: float) -> Surface:
        """A polyhedron of the sphere's volume, edges about `step` [m]."""
        # an octahedron's triangles, each divided into count^2, blown up
        count = max(8, ceil(0.5 * pi * self.radius / step))
        row = np.concatenate([np.full(count + 1 - i, i) for i in range(count + 1)])
        column = np.concatenate([np.arange(count + 1 - i) for i in range(count + 1)])
        grid = np.stack([row, column, count - row - column], axis=1)
        place = {(i, j): k for k, (i, j, _) in enumerate(grid)}
        up = [[place[i, j], place[i + 1, j], place[i, j + 1]] for i, j, k in grid if k > 0]
        down = [
            [place[i + 1, j], place[i + 1, j + 1], place[i, j + 1]] for i, j, k in grid if k > 1
        ]
        patch = np.array(up + down)
        # angles instead of lengths along the edges: triangles of nearly one size
        point = np.sin(0.5 * pi * grid / count)
        point /= np.linalg.norm(point, axis=1)[:, None]
        vertices, triangles = [], []
        for n, signs in enumerate(np.indices((2, 2, 2)).reshape(3, -1).T * 2 - 1):
            vertices.append(point * signs)
            triangles.append((patch if signs.prod() > 0 else patch[:, ::-1]) + n * len(point))
        x, t = merged(np.concatenate(vertices), np.concatenate(triangles))
        x *= np.cbrt(4.0 / 3.0 * pi / enclosed(x, t))
        x = np.asarray(self.centre) + self.radius * x
        return Surface(x, t, np.zeros(len(t), dtype=np.int64), ["outer"])


@checked
@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z: radius, height and centre of its bottom [m]. Sides: bottom, top, side."""

    radius: float
    height: float
    centre: Point = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        positive("radius", self.radius, ())
        positive("height", self.height, ())
        finite("centre", self.centre, (3,))

    def surface(self, step: float) -> Surface:
        """A prism of the cylinder's volume, edges of its base about `step` [m]."""
        ring = _circle(self.radius, self.centre[:2], step)
        n, z = len(ring), self.centre[2]
        base = np.concatenate([ring, [self.centre[:2]]])
        x = np.concatenate([np.c_[base, np.full(n + 1, h)] for h in (z, z + self.height)])
        i, j = np.arange(n), (np.arange(n) + 1) % n
        m = np.full(n, n)
        t = np.concatenate([
            np.stack([j, i, m], axis=1), np.stack([i, j, m], axis=1) + n + 1,
            np.stack([i, j, j + n + 1], axis=1), np.stack([i, j + n + 1, i + n + 1], axis=1),
        ])  # fmt: skip
        return Surface(x, t, np.repeat([0, 1, 2, 2], n), ["bottom", "top", "side"])


@checked
@dataclass(frozen=True)
class Mesh:
    """A closed triangle mesh: vertices [m] (v, 3) and triangles (t, 3), rows of vertices.

    Side: outer. Raises InputError where the mesh is open, not manifold or not oriented.
    """

    vertices: ArrayLike
    triangles: ArrayLike

    @classmethod
    def from_file(cls, path: str | Path) -> "Mesh":
        """Mesh of an STL file, in metres; equal corners of triangles are one vertex."""
        return cls(*read_stl(Path(path)))

    def surface(self, step: float) -> Surface:
        """The mesh as it is."""
        x = finite("vertices", self.vertices, (None, 3))
        t = entries("triangles", self.triangles)
        if t.ndim != 2 or t.shape[1] != 3 or t.dtype.kind not in "iu":
            raise InputError("triangles must be rows of vertices, integers of shape (t, 3).")
        bad = ((t < 0) | (t >= len(x))).any(axis=1)
        if bad.any():
            raise InputError(f"triangles {first_ids(bad)} name vertices outside 0..{len(x) - 1}.")
        x, t = merged(x, t.astype(np.int64))
        check_closed(x, t)
        if enclosed(x, t) < 0.0:
            t = t[:, ::-1].copy()
        return Surface(x, t, np.zeros(len(t), dtype=np.int64), ["outer"])


Shape = Box | Disc | Ring | Polygon | Plate | Sphere | Cylinder | Mesh


def check_closed(x: Array, t: NDArray[np.int64]) -> None:
    """Refuse a mesh in which an edge has not one triangle on either side."""
    bad = (t == np.roll(t, 1, axis=1)).any(axis=1)
    if bad.any():
        raise InputError(f"triangles {first_ids(bad)} of the mesh have two corners in one place.")
    edge = np.stack([t, np.roll(t, -1, axis=1)], axis=2).reshape(-1, 2)
    key, back = edge @ [len(x), 1], edge @ [1, len(x)]
    _, first, number = np.unique(key, return_inverse=True, return_counts=True)
    bad = (number[first] > 1) | ~np.isin(key, back)
    if bad.any():
        (a, b), triangle = edge[bad][0], np.flatnonzero(bad)[0] // 3
        raise InputError(
            f"the mesh is not closed, manifold and oriented: {bad.sum()} edges have not exactly "
            f"one triangle on either side, the first from {place(x[a])} to {place(x[b])} of "
            f"triangle {triangle}; repair the mesh."
        )


def enclosed(x: Array, t: NDArray[np.int64]) -> float:
    """Volume that an oriented closed mesh encloses [m^3]."""
    a, b, c = x[t.T] - x.mean(axis=0)
    return float((a * np.cross(b, c)).sum() / 6.0)


def merged(x: Array, t: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """The mesh with vertices in one place made one."""
    scale = np.abs(x).max(initial=1e-300)
    _, first, place = np.unique(
        np.rint(x / scale * 1e9), axis=0, return_index=True, return_inverse=True
    )
    return x[first], place.ravel()[t]


def read_stl(path: Path) -> tuple[Array, NDArray[np.int64]]:
    """Corners (3 t, 3) and triangles (t, 3) of an STL file, binary or text."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + 50 * count and count > 0:
        row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(data, row, count, 84)["corners"].reshape(-1, 3)
    else:
        words = [line.split()[1:] for line in data.decode(errors="replace").splitlines()
                 if line.split()[:1] == ["vertex"]]  # fmt: skip
        try:
            corners = np.array(words, dtype=np.float64).reshape(-1, 3)
        except ValueError:
            corners = np.zeros((0, 3))
        if not len(corners) or len(corners) % 3:
            raise InputError(f"{path.name} is not an STL file of whole triangles.")
    return corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3)


def _circle(radius: float, centre: Point, step: float) -> Array:
    """Corners of the regular polygon of the circle's area, counterclockwise."""
    n = max(64, ceil(2.0 * pi * radius / step))
    angle = 2.0 * pi * np.arange(n) / n
    out = radius * sqrt(2.0 * pi / (n * sin(2.0 * pi / n)))
    return np.asarray(centre) + out * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _hole_names(count: int) -> list[str]:
    return ["hole"] if count == 1 else [f"hole {k}" for k in range(count)]


def place(x: Array) -> str:
    """A point, for a message."""
    return "(" + ", ".join(f"{c:g}" for c in x) + ") m"

"""Walls: rigid shapes that elements touch, and how they move (theory B11)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import Array, InputError, checked, entries, finite, first_ids, positive
from .friction import Friction, rubs
from .material import Material

Path = Callable[[float], Array]  # displacement (dim,) and turn (1,) or (3,) at a time [s]


class Plane:
    """A plane through `point` [m]; elements are on the side its normal points to."""

    @checked
    def __init__(self, point: ArrayLike, normal: ArrayLike) -> None:
        self.place = finite("point", point, (None,))
        self.normal = _direction("the wall's normal", normal, len(self.place))

    def normals(self, arm: Array) -> Array | None:
        """Of the surface along which it may move without crossing what is at its place + arm."""
        return np.broadcast_to(self.normal, arm.shape)


class Sphere:
    """A sphere, in the plane a disc, of a radius [m] about its centre [m].

    hollow: elements are inside it.
    """

    @checked
    def __init__(self, centre: ArrayLike, radius: float, hollow: bool = False) -> None:
        self.place = finite("centre", centre, (None,))
        self.radius, self.hollow = float(positive("radius", radius, ())), hollow

    def normals(self, arm: Array) -> Array | None:
        """As of a plane."""
        return arm / np.maximum(np.linalg.norm(arm, axis=1), 1e-300)[:, None]


class Cylinder:
    """A cylinder in space about an axis through its centre [m]; in the plane take a Sphere.

    length [m]: by default infinite; hollow: elements are inside an infinite one.
    """

    @checked
    def __init__(
        self,
        centre: ArrayLike,
        axis: ArrayLike,
        radius: float,
        length: float | None = None,
        hollow: bool = False,
    ) -> None:
        self.place = finite("centre", centre, (3,))
        self.axis = _direction("the cylinder's axis", axis, 3)
        self.radius, self.hollow = float(positive("radius", radius, ())), hollow
        if hollow and length is not None:
            raise InputError(
                "a hollow cylinder is infinite; leave length out, or close it by walls."
            )
        self.length = np.inf if length is None else float(positive("length", length, ()))

    def normals(self, arm: Array) -> Array | None:
        """As of a plane; its ends are no surface to move along."""
        if np.isfinite(self.length):
            return None
        across = arm - (arm @ self.axis)[:, None] * self.axis
        return across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]


class Box:
    """A box of a size [m] along the world's axes, edges rounded by a radius [m].

    A box in another attitude starts turned: see `angle` of `Scene.wall`.
    """

    @checked
    def __init__(self, centre: ArrayLike, size: ArrayLike, rounding: float = 0.0) -> None:
        self.place = finite("centre", centre, (None,))
        self.size = positive("size", finite("size", size, (len(self.place),)))
        self.rounding = float(finite("rounding", rounding, ()))
        if not 0.0 <= self.rounding <= 0.5 * self.size.min():
            raise InputError(
                f"rounding is {self.rounding:g} m; give 0 to half the least side, "
                f"{0.5 * self.size.min():g} m."
            )

    def normals(self, arm: Array) -> Array | None:
        """None: all of its motion counts."""
        return None


class Mesh:
    """A surface of triangles in space, whose corners run against the clock as seen from outside.

    vertices (v, 3) [m]; faces (f, 3): the vertices of each triangle. It need not be closed. It is
    felt from its nearest triangle, at up to two radii of an element.
    """

    @checked
    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        self.vertices = finite("vertices", vertices, (None, 3))
        given = entries("faces", faces)
        if (
            given.ndim != 2
            or given.shape[1:] != (3,)
            or given.dtype.kind not in "iu"
            or not len(given)
        ):
            raise InputError(
                f"faces has shape {given.shape}; give (f, 3) whole numbers, three vertices each."
            )
        self.faces: NDArray[np.int64] = given.astype(np.int64)
        outside = ((self.faces < 0) | (self.faces >= len(self.vertices))).any(axis=1)
        if outside.any():
            raise InputError(
                f"faces {first_ids(outside)} name vertices outside 0..{len(self.vertices) - 1}."
            )
        a, b, c = np.swapaxes(self.vertices[self.faces], 0, 1)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        longest = np.max([((x - y) ** 2).sum(axis=1) for x, y in ((a, b), (b, c), (c, a))], axis=0)
        flat = area <= 1e-9 * longest
        if flat.any():
            raise InputError(
                f"faces {first_ids(flat)} have no area; remove them, or merge their vertices."
            )
        used = self.vertices[np.unique(self.faces)]
        self.place = 0.5 * (used.min(axis=0) + used.max(axis=0))

    def normals(self, arm: Array) -> Array | None:
        """None: all of its motion counts."""
        return None


Shape = Plane | Sphere | Cylinder | Box | Mesh


@dataclass(eq=False)
class Steering:
    """A wall is moved along a direction so that the force on it is kept."""

    direction: Array
    force: float
    speed: float
    history: Callable[[float], float]


@dataclass(eq=False)
class Wall:
    """A rigid shape that elements touch. Made by `Scene.wall`."""

    shape: Shape
    friction: Friction
    velocity: Array  # [m/s]
    spin: Array  # [rad/s]
    pivot: Array  # the point that `spin`, `angle` and a path turn the shape about [m]
    angle: Array  # turn at the start
    rolling_friction: float = 0.0
    twisting_friction: float = 0.0
    pairs: Mapping[Material, Friction] = field(default_factory=dict)  # friction on some materials
    path: Path | None = None
    steering: Steering | None = field(default=None, repr=False)

    @property
    def rubs(self) -> bool:
        """Whether some elements rub on it."""
        return any(rubs(law) for law in (self.friction, *self.pairs.values()))

    @property
    def stands(self) -> bool:
        """Whether it never moves."""
        moves = self.velocity.any() or self.spin.any()
        return not moves and self.path is None and self.steering is None

    def pose(self, time: float, way: float = 0.0) -> tuple[Array, Array]:
        """Place [m] and orientation, as `Simulation.orientation`, at a time [s].

        way [m]: that a steered wall has gone by then.
        """
        dim = len(self.velocity)
        moved, turn = time * self.velocity, rotation(time * self.spin)
        if self.path is not None:
            given = np.atleast_1d(finite("path", self.path(time)))
            if given.shape != (dim + len(self.spin),):
                raise InputError(
                    f"the wall's path gives {given.shape} numbers; give ({dim + len(self.spin)},): "
                    "displacement, then turn [rad]."
                )
            moved, turn = moved + given[:dim], compose(rotation(given[dim:]), turn)
        if self.steering is not None:
            moved = moved + way * self.steering.direction
        turn = compose(turn, rotation(self.angle))
        return self.pivot + moved + rotated(turn, self.shape.place - self.pivot), turn

    def motion(self, position: Array, time: float, dt: float, way: float = 0.0) -> Array:
        """How far it moves in a step [m], (n, dim), towards these places [m], (n, dim).

        The motion of a plane, a sphere or a cylinder along its own surface is left out. way: as of
        `pose`; what a steered wall goes in the step is left out.
        """
        (before, turn), (after, turned) = (self.pose(t, way) for t in (time, time + dt))
        back = np.append(-turn[:-1], turn[-1])
        arm = np.asarray(position) - before
        own = rotated(back, arm)
        moved = after + rotated(turned, own) - before - arm
        normals = self.shape.normals(own)
        if normals is None:
            return moved
        n = rotated(turn, normals)
        return (moved * n).sum(axis=1)[:, None] * n


def rotation(vector: Array) -> Array:
    """Rotation by a vector [rad]: quaternion (x, y, z, w), in the plane (sin, cos) of the half."""
    angle = float(np.linalg.norm(vector))
    share = 0.5 * np.sinc(0.5 * angle / np.pi)
    return np.append(share * vector, np.cos(0.5 * angle))


def compose(a: Array, b: Array) -> Array:
    """Rotation b, then a."""
    if len(a) == 2:
        return np.array([a[0] * b[1] + a[1] * b[0], a[1] * b[1] - a[0] * b[0]])
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def turn_between(before: Array, after: Array) -> Array:
    """Rotation vector [rad] from one orientation to another."""
    q = compose(after, np.append(-before[:-1], before[-1]))
    q = -q if q[-1] < 0.0 else q
    half = float(np.linalg.norm(q[:-1]))
    return (2.0 * np.arctan2(half, q[-1]) / half if half > 0.0 else 2.0) * q[:-1]


def rotated(q: Array, v: Array) -> Array:
    """A vector (dim,), or rows of them, turned; in space by one quaternion, or one a row."""
    v = np.asarray(v, dtype=np.float64)
    if q.shape[-1] == 2:
        sine, cosine = 2.0 * q[0] * q[1], q[1] ** 2 - q[0] ** 2
        return v @ np.array([[cosine, sine], [-sine, cosine]])
    axis, real = q[..., :3], q[..., 3:]
    return v + 2.0 * np.cross(axis, real * v + np.cross(axis, v))


def _direction(name: str, given: ArrayLike, dim: int) -> Array:
    n = finite("normal" if "normal" in name else "axis", given, (dim,))
    size = np.linalg.norm(n)
    if not size > 0.0:
        raise InputError(f"{name} is zero; give the direction that it faces.")
    return n / size

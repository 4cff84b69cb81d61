"""Vectors and rotations of the plane and of space in one precision.

The only place that knows the dimension: laws are written once over the names collected by `space`.
An orientation is the turn since the reference state, a unit quaternion (x, y, z, w) in space and
(sin, cos) of half the angle in the plane, so that no bond needs trigonometry.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .memory import get, nn, put


class Laws(SimpleNamespace):
    """Functions that belong together; hashable, so that factories can be cached on it."""

    __hash__ = object.__hash__


@cache
def space(dim: int, real: type) -> Laws:
    """Algebra of the plane (dim 2) or of space (dim 3) over `real`."""
    laws = _plane(real) if dim == 2 else _solid(real)
    vec3, rot = laws.vec3, laws.rot
    tiny = real(1.0e-30)
    # ratios of the series' neighbouring terms, from the seventh to the first
    seven = wp.types.vector(7, real)
    sinc_ratio = seven(*(1.0 / (2 * n * (2 * n + 1)) for n in range(7, 0, -1)))
    cosine_ratio = seven(*(1.0 / (2 * n * (2 * n - 1)) for n in range(7, 0, -1)))

    @wp.func
    def rotate_by(q: rot, w: laws.spin, dt: real) -> rot:
        """Exponential map exp(dt w / 2) q (theory A10), kept at unit length.

        Series of sin and cos keep the loop vectorisable; they are exact to rounding up to 1 rad a
        step. A faster turn, far above any stable step, is slowed down so that it stays finite.
        """
        h = real(0.5) * dt
        x = h * h * laws.spin_squared(w)
        slowed = wp.min(real(1.0), real(0.25) / wp.max(x, real(1.0e-30)))
        x = x * slowed * slowed
        sinc = real(1.0)
        cosine = real(1.0)
        for n in range(6):
            sinc = real(1.0) - x * sinc * sinc_ratio[n]
            cosine = real(1.0) - x * cosine * cosine_ratio[n]
        # sin(y)/y - 1 and cos(y) - 1 are never added to 1, whose rounding would bias float32
        sinc = h * slowed * (real(1.0) - x * sinc * sinc_ratio[6])
        less = -x * cosine * cosine_ratio[6]
        return laws.turned(q, sinc * w, less)

    @wp.func
    def store_ends(
        bond_place: wp.array(dtype=int),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        b: int,
        f: laws.vec,
        ti: laws.spin,
        tj: laws.spin,
    ):
        """Store force f on i, -f on j and the torques of bond b in slots of the two elements."""
        at_i = nn(get(bond_place, 2 * b))
        at_j = nn(get(bond_place, 2 * b + 1))
        laws.store(end_force, at_i, f)
        laws.store(end_force, at_j, -f)
        laws.store_spin(end_torque, at_i, ti)
        laws.store_spin(end_torque, at_j, tj)

    @wp.func
    def unit(v: laws.vec) -> laws.vec:
        """Direction of v, 0 of a vanishing one. The branch of `wp.normalize` leaves pairs of
        float32 in one register, which keeps the loop around it from being vectorised."""
        return (real(1.0) / wp.max(wp.length(v), tiny)) * v

    @wp.func
    def split(v: vec3, n: vec3) -> vec3:
        """Part of v across the unit vector n."""
        return v - wp.dot(v, n) * n

    return Laws(**vars(laws), rotate_by=rotate_by, store_ends=store_ends, unit=unit, split=split)


@cache
def narrow(s: Laws, k: Laws):
    """Cast a vector from the precision of k to that of s."""
    vec, real = s.vec, s.real

    if s is k:

        @wp.func
        def same(v: vec) -> vec:
            return v

        return same

    if s.dim == 2:

        @wp.func
        def cast_plane(v: k.vec) -> vec:
            return s.vec_of(real(v[0]), real(v[1]))

        return cast_plane

    @wp.func
    def cast_solid(v: k.vec) -> vec:
        return vec(real(v[0]), real(v[1]), real(v[2]))

    return cast_solid


@cache
def narrow_spin(s: Laws, k: Laws):
    """Cast an axial vector (a number in the plane) from the precision of k to that of s."""
    if s.dim == 3:
        return narrow(s, k)
    real = s.real

    @wp.func
    def cast_spin(v: k.real) -> real:
        return real(v)

    return cast_spin


def _plane(real: type) -> Laws:
    vec = wp.types.vector(2, real)
    rot = wp.types.vector(2, real)
    vec3 = wp.types.vector(3, real)
    mat3 = wp.types.matrix((3, 3), real)
    spin = real
    made = f"return wp::vec_t<2, wp::{real.__name__}>(x, y);"

    # constructed in Warp's code a vector of two float32 is copied as one integer of eight bytes,
    # which keeps the loop around it from being vectorised
    @wp.func_native(made)
    def vec_of(x: real, y: real) -> vec: ...

    @wp.func
    def turn(q: rot, c: vec) -> vec:
        """(Q - 1) c without cancellation."""
        k = real(2.0) * q[0]
        return vec_of(-k * (q[0] * c[0] + q[1] * c[1]), k * (q[1] * c[0] - q[0] * c[1]))

    @wp.func
    def turn_back(q: rot, c: vec) -> vec:
        """(Q^T - 1) c."""
        return turn(vec_of(-q[0], q[1]), c)

    @wp.func
    def no_spin() -> spin:
        return real(0.0)

    @wp.func
    def cross(a: vec, b: vec) -> spin:
        return a[0] * b[1] - a[1] * b[0]

    @wp.func
    def rotate(w: spin, b: vec) -> vec:
        """w x b."""
        return vec_of(-w * b[1], w * b[0])

    @wp.func
    def relative(qi: rot, qj: rot) -> rot:
        """Rotation from i to j in the world frame, q_j conj(q_i)."""
        return vec_of(qj[0] * qi[1] - qj[1] * qi[0], qj[1] * qi[1] + qj[0] * qi[0])

    @wp.func
    def axial(q: rot) -> spin:
        """Vector part of a rotation, sin(angle/2) times the axis."""
        return q[0]

    @wp.func
    def scalar(q: rot) -> real:
        return q[1]

    @wp.func
    def spin_squared(w: spin) -> real:
        return w * w

    @wp.func
    def spin_dot(a: spin, b: spin) -> real:
        return a * b

    @wp.func
    def turned(q: rot, p: spin, less: real) -> rot:
        """(p, 1 + less) q; a Newton step keeps the length at 1 without a root or a division."""
        d = vec_of(p * q[1] + less * q[0], less * q[1] - p * q[0])
        excess = (wp.dot(q, q) - real(1.0)) + (real(2.0) * wp.dot(q, d) + wp.dot(d, d))
        return q + (d - real(0.5) * excess * q)

    @wp.func
    def embed(v: vec) -> vec3:
        return vec3(v[0], v[1], real(0.0))

    @wp.func
    def load(a: wp.array(dtype=real), i: int) -> vec:
        return vec_of(get(a, 2 * i), get(a, 2 * i + 1))

    @wp.func
    def store(a: wp.array(dtype=real), i: int, v: vec):
        put(a, 2 * i, v[0])
        put(a, 2 * i + 1, v[1])

    @wp.func
    def load_spin(a: wp.array(dtype=real), i: int) -> spin:
        return get(a, i)

    @wp.func
    def store_spin(a: wp.array(dtype=real), i: int, w: spin):
        put(a, i, w)

    @wp.func
    def load_rot(a: wp.array(dtype=real), i: int) -> rot:
        return vec_of(get(a, 2 * i), get(a, 2 * i + 1))

    @wp.func
    def store_rot(a: wp.array(dtype=real), i: int, q: rot):
        put(a, 2 * i, q[0])
        put(a, 2 * i + 1, q[1])

    @wp.func
    def load_tensor(a: wp.array(dtype=real), i: int) -> mat3:
        """Symmetric tensor kept as xx, yy, xy, zz."""
        o = real(0.0)
        xy = get(a, 4 * i + 2)
        return mat3(get(a, 4 * i), xy, o, xy, get(a, 4 * i + 1), o, o, o, get(a, 4 * i + 3))

    @wp.func
    def store_tensor(a: wp.array(dtype=real), i: int, t: mat3):
        put(a, 4 * i, t[0, 0])
        put(a, 4 * i + 1, t[1, 1])
        put(a, 4 * i + 2, t[0, 1])
        put(a, 4 * i + 3, t[2, 2])

    return Laws(
        dim=2,
        real=real,
        vec=vec,
        rot=rot,
        spin=spin,
        vec3=vec3,
        mat3=mat3,
        vec_of=vec_of,
        turn=turn,
        turn_back=turn_back,
        no_spin=no_spin,
        cross=cross,
        rotate=rotate,
        relative=relative,
        axial=axial,
        scalar=scalar,
        spin_squared=spin_squared,
        spin_dot=spin_dot,
        turned=turned,
        embed=embed,
        load=load,
        store=store,
        load_spin=load_spin,
        store_spin=store_spin,
        load_rot=load_rot,
        store_rot=store_rot,
        load_tensor=load_tensor,
        store_tensor=store_tensor,
    )


def _solid(real: type) -> Laws:
    vec = wp.types.vector(3, real)
    rot = wp.types.quaternion(real)
    mat3 = wp.types.matrix((3, 3), real)
    spin = vec

    @wp.func
    def turn(q: rot, c: vec) -> vec:
        """(Q - 1) c without cancellation."""
        p = vec(q[0], q[1], q[2])
        return real(2.0) * wp.cross(p, q[3] * c + wp.cross(p, c))

    @wp.func
    def turn_back(q: rot, c: vec) -> vec:
        """(Q^T - 1) c."""
        return turn(rot(-q[0], -q[1], -q[2], q[3]), c)

    @wp.func
    def no_spin() -> spin:
        return vec()

    @wp.func
    def cross(a: vec, b: vec) -> spin:
        return wp.cross(a, b)

    @wp.func
    def rotate(w: spin, b: vec) -> vec:
        """w x b."""
        return wp.cross(w, b)

    @wp.func
    def relative(qi: rot, qj: rot) -> rot:
        """Rotation from i to j in the world frame, q_j conj(q_i)."""
        return qj * wp.quat_inverse(qi)

    @wp.func
    def axial(q: rot) -> spin:
        """Vector part of a rotation, sin(angle/2) times the axis."""
        return vec(q[0], q[1], q[2])

    @wp.func
    def scalar(q: rot) -> real:
        return q[3]

    @wp.func
    def spin_squared(w: spin) -> real:
        return wp.dot(w, w)

    @wp.func
    def spin_dot(a: spin, b: spin) -> real:
        return wp.dot(a, b)

    @wp.func
    def turned(q: rot, p: spin, less: real) -> rot:
        """(p, 1 + less) q; a Newton step keeps the length at 1 without a root or a division."""
        d = rot(p[0], p[1], p[2], less) * q
        excess = (wp.dot(q, q) - real(1.0)) + (real(2.0) * wp.dot(q, d) + wp.dot(d, d))
        return q + (d - real(0.5) * excess * q)

    @wp.func
    def embed(v: vec) -> vec:
        return v

    @wp.func
    def load(a: wp.array(dtype=real), i: int) -> vec:
        return vec(get(a, 3 * i), get(a, 3 * i + 1), get(a, 3 * i + 2))

    @wp.func
    def store(a: wp.array(dtype=real), i: int, v: vec):
        put(a, 3 * i, v[0])
        put(a, 3 * i + 1, v[1])
        put(a, 3 * i + 2, v[2])

    @wp.func
    def load_rot(a: wp.array(dtype=real), i: int) -> rot:
        return rot(get(a, 4 * i), get(a, 4 * i + 1), get(a, 4 * i + 2), get(a, 4 * i + 3))

    @wp.func
    def store_rot(a: wp.array(dtype=real), i: int, q: rot):
        put(a, 4 * i, q[0])
        put(a, 4 * i + 1, q[1])
        put(a, 4 * i + 2, q[2])
        put(a, 4 * i + 3, q[3])

    @wp.func
    def load_tensor(a: wp.array(dtype=real), i: int) -> mat3:
        """Symmetric tensor kept as xx, yy, zz, xy, yz, xz."""
        xy = get(a, 6 * i + 3)
        yz = get(a, 6 * i + 4)
        xz = get(a, 6 * i + 5)
        return mat3(get(a, 6 * i), xy, xz, xy, get(a, 6 * i + 1), yz, xz, yz, get(a, 6 * i + 2))

    @wp.func
    def store_tensor(a: wp.array(dtype=real), i: int, t: mat3):
        put(a, 6 * i, t[0, 0])
        put(a, 6 * i + 1, t[1, 1])
        put(a, 6 * i + 2, t[2, 2])
        put(a, 6 * i + 3, t[0, 1])
        put(a, 6 * i + 4, t[1, 2])
        put(a, 6 * i + 5, t[0, 2])

    return Laws(
        dim=3,
        real=real,
        vec=vec,
        rot=rot,
        spin=spin,
        vec3=vec,
        mat3=mat3,
        turn=turn,
        turn_back=turn_back,
        no_spin=no_spin,
        cross=cross,
        rotate=rotate,
        relative=relative,
        axial=axial,
        scalar=scalar,
        spin_squared=spin_squared,
        spin_dot=spin_dot,
        turned=turned,
        embed=embed,
        load=load,
        store=store,
        load_spin=load,
        store_spin=store,
        load_rot=load_rot,
        store_rot=store_rot,
        load_tensor=load_tensor,
        store_tensor=store_tensor,
    )

"""Stress tensor of a pair, fracture criteria, and the switch linked -> unlinked (Shilko 13-14)."""

from functools import cache

import warp as wp

from .algebra import Laws, narrow
from .face import Faces, face
from .memory import kernel, nn


@cache
def pair_tensor(s: Laws) -> Laws:
    """Tensor on a face, and the invariants that criteria use."""
    real, vec3, mat3 = s.real, s.vec3, s.mat3

    @wp.func
    def tensor(mean: mat3, traction: vec3, n: vec3) -> mat3:
        """Normal and shear parts from the bond, the tangential ones interpolated (Shilko eq. 13).

        All of s_t1t1, s_t2t2 and, in space, s_t1t2 are kept: without the last, homogeneous
        shear comes out wrong (theory B10). With P = 1 - nn no tangential frame is needed.
        """
        across = traction - wp.dot(traction, n) * n
        p = wp.identity(n=3, dtype=real) - wp.outer(n, n)
        return p * mean * p + wp.outer(traction, n) + wp.outer(n, across)

    @wp.func
    def mean_stress(t: mat3) -> real:
        return wp.trace(t) / real(3.0)

    @wp.func
    def von_mises(t: mat3) -> real:
        """Stress intensity sqrt(3/2 dev:dev)."""
        dev = t - mean_stress(t) * wp.identity(n=3, dtype=real)
        return wp.sqrt(real(1.5) * wp.ddot(dev, dev))

    @wp.func
    def first_principal(t: mat3) -> real:
        """Greatest principal stress, by the angle of the deviator's third invariant."""
        m = mean_stress(t)
        q = von_mises(t)
        if q == real(0.0):
            return m
        x = real(13.5) * wp.determinant(t - m * wp.identity(n=3, dtype=real)) / (q * q * q)
        angle = wp.acos(wp.clamp(x, real(-1.0), real(1.0))) / real(3.0)
        return m + real(2.0 / 3.0) * q * wp.cos(angle)

    return Laws(
        tensor=tensor, mean_stress=mean_stress, von_mises=von_mises, first_principal=first_principal
    )


@cache
def criterion(s: Laws, kind: str):
    """Equivalent stress of a pair tensor, to be compared with a strength [Pa]."""
    real, mat3, law = s.real, s.mat3, pair_tensor(s)

    if kind == "huber_mises_hencky":

        @wp.func
        def huber_mises_hencky(t: mat3, ratio: real) -> real:
            """Shilko eq. 14, first line."""
            return law.von_mises(t)

        return huber_mises_hencky

    if kind == "drucker_prager":

        @wp.func
        def drucker_prager(t: mat3, ratio: real) -> real:
            """Shilko eq. 14, second line: compared with the compressive strength."""
            one = real(1.0)
            return real(0.5) * (ratio + one) * law.von_mises(t) + real(1.5) * (
                ratio - one
            ) * law.mean_stress(t)

        return drucker_prager

    @wp.func
    def rankine(t: mat3, ratio: real) -> real:
        """Greatest principal stress."""
        return law.first_principal(t)

    return rankine


@cache
def break_bonds(s: Laws, k: Laws, faces: Faces, kind: str, simd: bool = True):
    """Pass over listed bonds: those whose equivalent stress exceeds their strength unlink."""
    geometry, law, equivalent = face(s, k, faces), pair_tensor(s), criterion(s, kind)
    real, narrowed = s.real, narrow(s, k)

    def break_bonds(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_area: wp.array(dtype=real),
        bond_strength: wp.array(dtype=real),
        # state read
        orientation: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        stress: wp.array(dtype=real),
        # written
        bond_linked: wp.array(dtype=real),
        break_normal: wp.array(dtype=real),
        break_shear: wp.array(dtype=real),
        any_broken: wp.array(dtype=int),
        ratio: real,
        first: int,
    ):
        l = wp.tid() + first
        b = nn(listed[l])
        if bond_linked[b] == real(0.0):
            return
        p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
        n = s.embed(wp.normalize(p + m))
        traction = s.embed(s.load(end_force, nn(bond_place[nn(2 * b)]))) / bond_area[b]
        # linear interpolation to the face: the nearer centre weighs more (Shilko eq. 13)
        ci = narrowed(geometry.load_arm(bond_arm, nn(2 * b)))
        cj = narrowed(geometry.load_arm(bond_arm, nn(2 * b + 1)))
        qi = wp.dot(ci, ci - cj)
        qj = -wp.dot(cj, ci - cj)
        mean = (
            qj * s.load_tensor(stress, nn(bond_i[b])) + qi * s.load_tensor(stress, nn(bond_j[b]))
        ) / (qi + qj)
        if equivalent(law.tensor(mean, traction, n), ratio) > bond_strength[l]:
            bond_linked[b] = real(0.0)
            break_normal[l] = wp.dot(traction, n)
            break_shear[l] = wp.length(s.split(traction, n))
            any_broken[0] = 1

    return kernel(break_bonds, simd)


@cache
def log_breaks(s: Laws, has_volume: bool, simd: bool = True):
    """Pass over listed bonds: stamp those broken just now with the step and the energy released."""
    real = s.real

    def log_breaks(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        # state read
        bond_linked: wp.array(dtype=real),
        linked_energy: wp.array(dtype=real),
        closing_energy: wp.array(dtype=real),
        element_release: wp.array(dtype=real),
        # written
        break_step: wp.array(dtype=int),
        break_energy: wp.array(dtype=real),
        step: int,
    ):
        l = wp.tid()
        b = listed[l]
        if bond_linked[b] == real(0.0) and break_step[b] == -1:
            released = linked_energy[l] - closing_energy[l]
            if wp.static(has_volume):
                released += element_release[bond_i[b]] + element_release[bond_j[b]]
            break_step[b] = step
            break_energy[l] = released

    return kernel(log_breaks, simd)

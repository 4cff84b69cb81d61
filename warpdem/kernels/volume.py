"""The many-body part: an energy of each element's volume change (Shilko 2-4, 7; theory B4).

E_i is the divergence summed over the element's linked faces, g_i = A_i E_i = D_i m_i its volumetric
stress in closed form, with A_i = 2 G D / (3 - D s*). Nothing is lagged, so forces are the
derivative of U = sum V_i A_i E_i^2 / 2.
"""

from functools import cache

import warp as wp

from .algebra import Laws
from .face import Faces, face
from .memory import get, kernel, nn, put


@cache
def volume(s: Laws) -> Laws:
    """Laws of the volume term."""
    real, vec = s.real, s.vec

    @wp.func
    def stiffness(two_shear: real, coupling: real, faces: real, plane_strain: real) -> real:
        """A = 2 G D / (3 - D s*) [Pa]; s* = s, in plane strain s + 1 (theory B4)."""
        return two_shear * coupling / (real(3.0) - coupling * (faces + plane_strain))

    @wp.func
    def mean_stiffness(two_shear: real, coupling: real, faces: real, plane_strain: real) -> real:
        """m/(E - P) = 2 G / (3 - D s*) [Pa] (theory B4)."""
        return two_shear / (real(3.0) - coupling * (faces + plane_strain))

    @wp.func
    def energy(v: real, a: real, dilation: real) -> real:
        """U = V A E^2 / 2 [J]."""
        return real(0.5) * v * a * dilation * dilation

    @wp.func
    def force(w: real, gi: real, gj: real, ci: vec, cj: vec):
        """The two forces on i of one face, derivatives of the energies of i and of j.

        f_I = g_i w c_i acts at y_j, f_J = -g_j w c_j at y_i, on both bodies (theory B2a): beside
        the torques c x f of forces at each body's own facet point, delta x f_I and delta x f_J.
        """
        return (gi * w) * ci, -(gj * w) * cj

    return Laws(stiffness=stiffness, mean_stiffness=mean_stiffness, energy=energy, force=force)


@cache
def face_dilation(s: Laws, k: Laws, faces: Faces, is_listed: bool, simd: bool = True):
    """Pass over bonds: each face's share of V E of its two elements (theory B4)."""
    geometry, real = face(s, k, faces), s.real

    def face_dilation(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        # state read
        bond_weight: wp.array(dtype=real),
        bond_slip: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        rest_dilation: wp.array(dtype=real),
        # written
        end_dilation: wp.array(dtype=real),
        first: int,
    ):
        b = nn(wp.tid() + first)
        if wp.static(is_listed):
            b = nn(get(listed, b))
        delta, ci, cj = geometry.load_opening(
            b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
        )
        if wp.static(faces.has_creep):
            si, sj = geometry.load_slips(b, bond_i, bond_j, bond_slip, orientation)
            delta += sj - si
        w = get(bond_weight, b)
        rest_i = real(0.0)
        rest_j = real(0.0)
        if wp.static(faces.has_rest):
            rest_i = get(rest_dilation, 2 * b)
            rest_j = get(rest_dilation, 2 * b + 1)
        put(end_dilation, get(bond_place, 2 * b), w * wp.dot(ci, delta) - rest_i)
        put(end_dilation, get(bond_place, 2 * b + 1), -w * wp.dot(cj, delta) - rest_j)

    return kernel(face_dilation, simd)


@cache
def volume_stresses(
    s: Laws, slots: int, keeps_mean: bool, has_dilation: bool, is_listed: bool, simd: bool = True
):
    """Pass over elements: g_i = A_i (E_i - P_i), P_i a plastic change of volume (theory B6).

    Where slips ask for it, the mean stress m_i is kept beside it.
    """
    real = s.real

    def volume_stresses(
        # model
        listed: wp.array(dtype=int),
        element_volume: wp.array(dtype=real),
        # state read
        volume_stiffness: wp.array(dtype=real),
        end_dilation: wp.array(dtype=real),
        mean_stiffness: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        # written
        volume_stress: wp.array(dtype=real),
        mean_stress: wp.array(dtype=real),
        elements: int,
        first: int,
    ):
        i = nn(wp.tid() + first)
        if wp.static(is_listed):
            i = nn(get(listed, i))
        e = real(0.0)
        for slot in range(wp.static(slots)):
            e += get(end_dilation, slot * elements + i)
        e = e / get(element_volume, i)
        if wp.static(has_dilation):
            e = e - get(plastic_dilation, i)
        put(volume_stress, i, get(volume_stiffness, i) * e)
        if wp.static(keeps_mean):
            put(mean_stress, i, get(mean_stiffness, i) * e)

    return kernel(volume_stresses, simd)


@cache
def volume_release(
    s: Laws, slots: int, keeps_mean: bool, has_dilation: bool, softens: bool, simd: bool = True
):
    """After a break, per element: the new A_i, and the energy released to each broken face.

    The element's drop V (A E^2 - A' E'^2) / 2 is shared evenly among the faces broken, or softened,
    just now.
    """
    law, real = volume(s), s.real

    def volume_release(
        # model
        listed: wp.array(dtype=int),
        incidence: wp.array(dtype=int),
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        element_coupling: wp.array(dtype=real),
        bond_face: wp.array(dtype=real),
        # state read
        bond_linked: wp.array(dtype=real),
        bond_keep: wp.array(dtype=real),
        break_step: wp.array(dtype=int),
        end_dilation: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        # written
        volume_stiffness: wp.array(dtype=real),
        mean_stiffness: wp.array(dtype=real),
        element_release: wp.array(dtype=real),
        plane_strain: real,
        elements: int,
    ):
        i = listed[wp.tid()]
        before = real(0.0)
        after = real(0.0)
        faces = real(0.0)
        broken = real(0.0)
        for slot in range(wp.static(slots)):
            at = nn(slot * elements + i)
            entry = nn(get(incidence, at))
            b = nn(entry >> 1)
            before += get(end_dilation, at)
            keep = get(bond_linked, b)
            if wp.static(softens):
                keep = get(bond_keep, b)
            after += keep * get(end_dilation, at)
            faces += get(bond_linked, b) * get(bond_face, entry)
            if keep < real(1.0) and get(break_step, b) == -1:
                broken += real(1.0)
        v = get(element_volume, i)
        a = get(volume_stiffness, i)
        a_after = law.stiffness(
            get(element_two_shear, i), get(element_coupling, i), faces / v, plane_strain
        )
        p = real(0.0)
        if wp.static(has_dilation):
            p = get(plastic_dilation, i)
        drop = law.energy(v, a, before / v - p) - law.energy(v, a_after, after / v - p)
        put(element_release, i, drop / wp.max(broken, real(1.0)))
        put(volume_stiffness, i, a_after)
        if wp.static(keeps_mean):
            put(
                mean_stiffness,
                i,
                law.mean_stiffness(
                    get(element_two_shear, i), get(element_coupling, i), faces / v, plane_strain
                ),
            )

    return kernel(volume_release, simd)

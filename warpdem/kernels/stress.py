"""Average stress of an element from the forces on its faces (Shilko eq. 5 as theory 5')."""

from functools import cache

import warp as wp

from .algebra import Laws, narrow
from .face import Faces, face
from .memory import get, kernel, nn


@cache
def average_stress(s: Laws, k: Laws, faces: Faces, slots: int):
    """sigma_i = sym (1/V_i) sum c (x) F [Pa] of an element; what acts out of plane is not in it."""
    real, geometry, narrowed = s.real, face(s, k, faces), narrow(s, k)

    @wp.func
    def average(
        i: int,
        incidence: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        orientation: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        elements: int,
    ) -> s.mat3:
        q = k.load_rot(orientation, i)
        t = s.mat3()
        for slot in range(wp.static(slots)):
            at = nn(slot * elements + i)
            entry = nn(get(incidence, at))
            c0 = geometry.load_arm(bond_arm, entry)
            c = s.embed(narrowed(c0 + k.turn(q, c0)))
            t += wp.outer(c, s.embed(s.load(end_force, at)))
        return (real(0.5) / get(element_volume, i)) * (t + wp.transpose(t))

    return average


@cache
def element_stress(
    s: Laws,
    k: Laws,
    faces: Faces,
    slots: int,
    has_volume: bool,
    plane_strain: bool,
    touches: bool,
    simd: bool = True,
):
    """Pass over listed elements: their average stress [Pa], tension positive.

    touches: forces of contacts count as those of bonds. Plane strain adds sigma_zz = D m - 2 G
    eps_zz, plastic; in plane stress it is zero.
    """
    real, average = s.real, average_stress(s, k, faces, slots)

    def element_stress(
        # model
        listed: wp.array(dtype=int),
        incidence: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        # state read
        orientation: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        plastic_strain_zz: wp.array(dtype=real),
        contact_moment: wp.array(dtype=real),
        # written
        stress: wp.array(dtype=real),
        elements: int,
    ):
        i = listed[wp.tid()]
        t = average(i, incidence, bond_arm, element_volume, orientation, end_force, elements)
        if wp.static(touches):
            t += s.load_tensor(contact_moment, i) / get(element_volume, i)
        if wp.static(plane_strain and has_volume):
            t[2, 2] = get(volume_stress, i)
            if wp.static(faces.has_slip and not faces.has_rest):
                t[2, 2] -= get(element_two_shear, i) * get(plastic_strain_zz, i)
        s.store_tensor(stress, i, t)

    return kernel(element_stress, simd)

"""An unlinked facet bond is linked again with the force that its contact has (theory B11).

Linked, a face carries a spring and its share of both elements' volume terms. The share starts from
a dilation at which no g_i changes, and the spring's anchors are moved so that all forces together
are those of the contact. A break takes off what the link put on.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow
from .closing import UNKNOWN
from .face import Faces, face
from .memory import get, kernel, nn
from .volume import volume

WAITS, LINKS = 1, 2  # states of a bond that meets its law: it lacks the energy, or has it


@cache
def rest(s: Laws, k: Laws, faces: Faces, has_volume: bool):
    """The rest state at which a bond linked now carries the force of its contact."""
    geometry, many, real, vec = face(s, k, faces), volume(s), s.real, s.vec

    @wp.func
    def released(g: real, bond_face: real, two_shear: real) -> real:
        """Energy [J] that an element gives back as its s_i grows by a face while g_i stays:
        V g^2/2 (1/A - 1/A') = g^2 S q/(4 G), as 1/A = (3 - D s*)/(2 G D)."""
        return real(0.5) * g * g * bond_face / two_shear

    @wp.func
    def load_rest(
        b: int,
        stiffness: real,
        w: real,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        bond_face: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        volume_stress: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
    ):
        """Slips of both anchors, dilations of both sides at rest [m^3], the energy [J] of the
        spring less that which the volume terms release."""
        delta, ci, cj = geometry.load_opening(
            b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
        )
        at = nn(get(bond_place, 2 * b))
        f = s.load(end_force, at)
        torque = s.load_spin(end_torque, at)
        rest_i = real(0.0)
        rest_j = real(0.0)
        energy = real(0.0)
        if wp.static(has_volume):
            i = nn(bond_i[b])
            j = nn(bond_j[b])
            gi = volume_stress[i]
            gj = volume_stress[j]
            fi, fj = many.force(w, gi, gj, ci, cj)
            f -= fi + fj
            torque -= s.cross(ci, fi + fj) + s.cross(delta, fi)
            rest_i = w * wp.dot(ci, delta) + gi * get(bond_face, 2 * b) / element_two_shear[i]
            rest_j = -w * wp.dot(cj, delta) + gj * get(bond_face, 2 * b + 1) / element_two_shear[j]
            energy -= released(gi, get(bond_face, 2 * b), element_two_shear[i])
            energy -= released(gj, get(bond_face, 2 * b + 1), element_two_shear[j])
        square = wp.dot(f, f)
        energy += real(0.5) * square / stiffness
        # in the middle of the facet points, and moved across f to where the contact's torque asks
        left = torque - s.cross(ci + real(0.5) * delta, f)
        aside = vec()
        if square > real(0.0):
            aside = -s.rotate(left, f) / square
        reach = wp.length(ci - cj)
        if wp.dot(aside, aside) > real(0.25) * reach * reach:
            aside = vec()
        half = real(0.5) * (delta - f / stiffness)
        return aside + half, aside - half, rest_i, rest_j, energy

    return load_rest


@cache
def heal_bonds(s: Laws, k: Laws, faces: Faces, has_volume: bool, rubs: bool, can_break: bool):
    """Pass over listed facet bonds of a body that heals: which meet its law, and may link."""
    geometry, load_rest, real = face(s, k, faces), rest(s, k, faces, has_volume), s.real
    rounding = real(1e-6 if s.real is wp.float32 else 1e-14)

    def heal_bonds(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        bond_area: wp.array(dtype=real),
        bond_face: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        healing_stiffness: wp.array(dtype=real),
        healing_weight: wp.array(dtype=real),
        closing_stiffness: wp.array(dtype=real),
        closing_shear: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        break_energy: wp.array(dtype=real),
        relink_energy: wp.array(dtype=wp.float64),
        closing_slip_energy: wp.array(dtype=wp.float64),
        # written
        healing_time: wp.array(dtype=real),
        healing_start: wp.array(dtype=wp.float64),
        healing_state: wp.array(dtype=int),
        relink_normal: wp.array(dtype=real),
        relink_shear: wp.array(dtype=real),
        relink_released: wp.array(dtype=real),
        any_healed: wp.array(dtype=int),
        pressure: real,
        time: real,
        work: real,
        dt: real,
        first: int,
    ):
        l = wp.tid() + first
        b = nn(listed[l])
        healing_state[l] = 0
        # a pair that has parted has lost its face, and with it its closing stiffness
        if bond_linked[b] != real(0.0) or closing_stiffness[l] == real(0.0):
            healing_time[l] = real(0.0)
            return
        p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
        n = wp.normalize(p + m)
        f = s.load(end_force, nn(get(bond_place, 2 * b)))
        along = wp.dot(f, n)
        across = f - along * n
        pressed = -along / bond_area[b]
        slipped = wp.float64(0.0)
        if wp.static(rubs):
            slipped = closing_slip_energy[l]
        if pressed <= real(0.0) or pressed < pressure:
            healing_time[l] = real(0.0)
            healing_start[l] = slipped
            return
        healing_time[l] = healing_time[l] + dt
        done = real(slipped - healing_start[l]) / bond_area[b]
        if healing_time[l] < time or done < work:
            return
        w = real(0.0)
        if wp.static(has_volume):
            w = healing_weight[l]
        _si, _sj, _ri, _rj, energy = load_rest(
            b, healing_stiffness[l], w, bond_i, bond_j, bond_place, bond_arm, bond_jump, bond_face,
            element_two_shear, displacement, orientation, volume_stress, end_force, end_torque,
        )  # fmt: skip
        held = real(0.5) * along * along / closing_stiffness[l]
        if wp.static(rubs):
            held += real(0.5) * wp.dot(across, across) / closing_shear[l]
        account = real(relink_energy[l])
        if wp.static(can_break):
            account += break_energy[l]
        if energy - held > account + rounding * held:
            healing_state[l] = WAITS
            return
        healing_state[l] = LINKS
        relink_normal[l] = pressed
        relink_shear[l] = wp.length(across) / bond_area[b]
        relink_released[l] = held - energy
        any_healed[0] = 1

    return kernel(heal_bonds, simd=False)


@cache
def link_bonds(
    s: Laws, k: Laws, faces: Faces, has_volume: bool, rubs: bool, can_break: bool, damages: bool
):
    """Pass over listed facet bonds: those found to link do so, from the rest state of now.

    damages: some criterion has a damage that grows, which starts anew.
    """
    load_rest, real = rest(s, k, faces, has_volume), s.real
    widened = narrow(k, s)

    def link_bonds(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        bond_face: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        healing_stiffness: wp.array(dtype=real),
        healing_weight: wp.array(dtype=real),
        healing_strength: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        volume_stress: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        healing_state: wp.array(dtype=int),
        relink_released: wp.array(dtype=real),
        # written
        healing_time: wp.array(dtype=real),
        relink_energy: wp.array(dtype=wp.float64),
        bond_linked: wp.array(dtype=real),
        bond_slip: wp.array(dtype=k.real),
        rest_dilation: wp.array(dtype=real),
        facet_stiffness: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        closing_gap: wp.array(dtype=real),
        closing_spring: wp.array(dtype=real),
        bond_strength: wp.array(dtype=real),
        break_step: wp.array(dtype=int),
        break_damage: wp.array(dtype=real),
    ):
        l = wp.tid()
        if healing_state[l] != LINKS:
            return
        b = nn(listed[l])
        w = real(0.0)
        if wp.static(has_volume):
            w = healing_weight[l]
        si, sj, rest_i, rest_j, _energy = load_rest(
            b, healing_stiffness[l], w, bond_i, bond_j, bond_place, bond_arm, bond_jump, bond_face,
            element_two_shear, displacement, orientation, volume_stress, end_force, end_torque,
        )  # fmt: skip
        wide_i = widened(si)
        wide_j = widened(sj)
        qi = k.load_rot(orientation, nn(bond_i[b]))
        qj = k.load_rot(orientation, nn(bond_j[b]))
        k.store(bond_slip, nn(2 * b), wide_i + k.turn_back(qi, wide_i))
        k.store(bond_slip, nn(2 * b + 1), wide_j + k.turn_back(qj, wide_j))
        facet_stiffness[b] = healing_stiffness[l]
        bond_linked[b] = real(1.0)
        if wp.static(has_volume):
            bond_weight[b] = w
            rest_dilation[2 * b] = rest_i
            rest_dilation[2 * b + 1] = rest_j
        if wp.static(rubs):
            s.store(closing_spring, l, s.vec())
        closing_gap[l] = real(UNKNOWN)
        healing_time[l] = real(0.0)
        relink_energy[l] = relink_energy[l] + wp.float64(relink_released[l])
        if wp.static(can_break):
            break_step[b] = -1
            bond_strength[l] = healing_strength[l]
        if wp.static(damages):
            break_damage[l] = real(0.0)

    return kernel(link_bonds, simd=False)


@cache
def drop_rest(s: Laws, k: Laws, has_volume: bool):
    """Pass over listed facet bonds: an unlinked bond's rest state is that of its first links."""
    real = s.real

    def drop_rest(
        # model
        listed: wp.array(dtype=int),
        # state read
        bond_linked: wp.array(dtype=real),
        # written
        bond_slip: wp.array(dtype=k.real),
        rest_dilation: wp.array(dtype=real),
    ):
        b = nn(listed[wp.tid()])
        if bond_linked[b] == real(0.0):
            for side in range(2):
                k.store(bond_slip, nn(2 * b + side), k.vec())
                if wp.static(has_volume):
                    rest_dilation[2 * b + side] = real(0.0)

    return kernel(drop_rest, simd=False)


@cache
def join_faces(s: Laws, slots: int):
    """Pass over listed elements: A_i for the faces linked now (theory B4)."""
    law, real = volume(s), s.real

    def join_faces(
        # model
        listed: wp.array(dtype=int),
        incidence: wp.array(dtype=int),
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        element_coupling: wp.array(dtype=real),
        bond_face: wp.array(dtype=real),
        # state read
        bond_linked: wp.array(dtype=real),
        # written
        volume_stiffness: wp.array(dtype=real),
        plane_strain: real,
        elements: int,
    ):
        i = listed[wp.tid()]
        faces = real(0.0)
        for slot in range(wp.static(slots)):
            entry = nn(get(incidence, slot * elements + i))
            faces += get(bond_linked, entry >> 1) * bond_face[entry]
        volume_stiffness[i] = law.stiffness(
            element_two_shear[i], element_coupling[i], faces / element_volume[i], plane_strain
        )

    return kernel(join_faces, simd=False)

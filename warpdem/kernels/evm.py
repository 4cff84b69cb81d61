"""The EVM bond (Kuzkin 2-3; theory A1-A2): any longitudinal, shear, bending, torsional stiffness.

Vectors n_2 and n_3 of the paper are never formed: n_i2.n_j2 + n_i3.n_j3 depends on the relative
rotation alone, so the choice of transverse vectors does not matter. Its n_j1 is -m here, which
keeps both frames right-handed.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow, narrow_spin
from .closing import closing
from .face import face
from .memory import kernel, nn
from .volume import volume


@cache
def measures(s: Laws):
    """Deformation measures of an EVM bond, those of its reference state being zero or fixed."""
    real, vec, spin = s.real, s.vec, s.spin

    @wp.struct
    class Measures:
        elongation: real  # g = D - a [m]
        length: real  # D [m]
        p: vec  # Q_i e0
        m: vec  # Q_j e0
        bend_i: vec  # p - d
        bend_j: vec  # m - d
        half: spin  # sin(angle/2) times axis of the rotation from i to j
        cosine: real  # cos(angle/2)

    return Measures


@cache
def evm(s: Laws) -> Laws:
    """Laws of the EVM bond: linked, and unlinked where it only resists closing."""
    real, vec4, measure = s.real, wp.types.vector(4, s.real), measures(s)

    @wp.func
    def energy(b: vec4, x: measure) -> real:
        """U [J]: Kuzkin eq. 2 + B2 + B3 + B4, so that it is zero at rest (theory A1)."""
        bend = x.bend_i - x.bend_j
        return (
            real(0.5) * b[0] * x.elongation * x.elongation
            + real(0.25) * b[1] * (wp.dot(x.bend_i, x.bend_i) + wp.dot(x.bend_j, x.bend_j))
            + real(0.5) * (b[2] - real(0.5) * b[3]) * wp.dot(bend, bend)
            + real(2.0) * b[3] * s.spin_squared(x.half)
        )

    @wp.func
    def force(b: vec4, ri: real, rj: real, x: measure):
        """Force on i [N] and torques on i and j [N m]: Kuzkin eq. 3 (theory A2)."""
        d = x.p - x.bend_i
        y = x.bend_i + x.bend_j
        f = b[0] * x.elongation * d - (real(0.5) * b[1] / x.length) * (y - wp.dot(y, d) * d)
        both = (b[2] - real(0.5) * b[3]) * s.cross(x.p, x.bend_j - x.bend_i)
        both += (real(2.0) * b[3] * x.cosine) * x.half
        ti = ri * s.cross(x.p, f) - real(0.5) * b[1] * s.cross(x.p, x.bend_i) + both
        tj = rj * s.cross(x.m, f) - real(0.5) * b[1] * s.cross(x.m, x.bend_j) - both
        return f, ti, tj

    @wp.func
    def closing_force(pull: real, ri: real, rj: real, x: measure):
        """Force on i and torques of a pull along the bond."""
        f = pull * (x.p - x.bend_i)
        return f, ri * s.cross(x.p, f), rj * s.cross(x.m, f)

    @wp.func
    def load_stiffness(evm_stiffness: wp.array(dtype=real), c: int) -> vec4:
        """B1..B4 of the c-th EVM bond."""
        return vec4(
            evm_stiffness[nn(4 * c)],
            evm_stiffness[nn(4 * c + 1)],
            evm_stiffness[nn(4 * c + 2)],
            evm_stiffness[nn(4 * c + 3)],
        )

    return Laws(
        energy=energy,
        force=force,
        closing_force=closing_force,
        load_stiffness=load_stiffness,
    )


@cache
def evm_kinematics(s: Laws, k: Laws) -> Laws:
    """Deformation measures of a bond, differenced in the precision of k, returned in that of s."""
    real, narrowed, narrowed_spin = s.real, narrow(s, k), narrow_spin(s, k)
    measure = measures(s)

    @wp.func
    def load_measures(
        b: int,
        c: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ) -> measure:
        """Measures of bond b, the c-th EVM bond.

        D - a is taken as (2 X + Delta).Delta / (D + a), free of cancellation (theory A4).
        """
        i = nn(bond_i[b])
        j = nn(bond_j[b])
        qi = k.load_rot(orientation, i)
        qj = k.load_rot(orientation, j)
        e0 = k.load(evm_direction, c)
        a = evm_length[c]
        xi = k.turn(qi, e0)
        xj = k.turn(qj, e0)
        du = k.load(displacement, j) - k.load(displacement, i)
        delta = du - evm_offset[nn(2 * c)] * xi - evm_offset[nn(2 * c + 1)] * xj
        # a bond shorter than a millionth of a has lost its direction: kept finite
        length = wp.max(wp.length(a * e0 + delta), k.real(1.0e-6) * a)
        g = wp.dot(k.real(2.0) * a * e0 + delta, delta) / (length + a)
        dd = (delta - g * e0) / length
        turned = k.relative(qi, qj)
        x = measure()
        x.elongation = real(g)
        x.length = real(length)
        x.p = narrowed(e0 + xi)
        x.m = narrowed(e0 + xj)
        x.bend_i = narrowed(xi - dd)
        x.bend_j = narrowed(xj - dd)
        x.half = narrowed_spin(k.axial(turned))
        x.cosine = real(k.scalar(turned))
        return x

    return Laws(load_measures=load_measures)


@cache
def evm_forces(
    s: Laws, k: Laws, central: bool, has_volume: bool, is_listed: bool, simd: bool = True
):
    """Pass over EVM bonds: force on i and the torques on both elements."""
    kinematics, law, real = evm_kinematics(s, k), evm(s), s.real
    geometry, many = face(s, k, central), volume(s)

    def evm_forces(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        bond_arm: wp.array(dtype=k.real),
        # state read
        evm_stiffness: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        volume_stress: wp.array(dtype=real),
        # written
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        b = nn(wp.tid() + first)
        if wp.static(is_listed):
            b = nn(listed[b])
        c = nn(b - first_evm)
        x = kinematics.load_measures(
            b,
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            displacement,
            orientation,
        )
        f, ti, tj = law.force(
            law.load_stiffness(evm_stiffness, c),
            real(evm_offset[nn(2 * c)]),
            real(evm_offset[nn(2 * c + 1)]),
            x,
        )
        if wp.static(has_volume):
            delta, ci, cj = geometry.load_opening(
                b, bond_i, bond_j, bond_arm, displacement, orientation
            )
            gi = volume_stress[nn(bond_i[b])]
            gj = volume_stress[nn(bond_j[b])]
            fi, fj = many.force(bond_weight[b], gi, gj, ci, cj)
            f += fi + fj
            ti += s.cross(ci, fi + fj) + s.cross(delta, fi)
            tj += s.cross(delta, fj) - s.cross(cj, fi + fj)
        s.store_ends(bond_place, end_force, end_torque, b, f, ti, tj)

    return kernel(evm_forces, simd)


@cache
def evm_closing(s: Laws, k: Laws, simd: bool = True):
    """Pass over listed EVM bonds: unlinked ones resist closing (theory B11)."""
    kinematics, law, contact, real = evm_kinematics(s, k), evm(s), closing(s), s.real

    def evm_closing(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        closing_stiffness: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        # written
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        closing_gap: wp.array(dtype=real),
        closing_debt: wp.array(dtype=real),
        any_crossed: wp.array(dtype=int),
        slack: real,
        first: int,
        first_evm: int,
    ):
        t = wp.tid() + first
        b = nn(listed[t])
        c = nn(b - first_evm)
        if bond_linked[b] == real(0.0):
            x = kinematics.load_measures(
                b,
                c,
                bond_i,
                bond_j,
                evm_direction,
                evm_length,
                evm_offset,
                displacement,
                orientation,
            )
            gap = x.elongation
            f, ti, tj = law.closing_force(
                contact.pull(closing_stiffness[t], gap, slack),
                real(evm_offset[nn(2 * c)]),
                real(evm_offset[nn(2 * c + 1)]),
                x,
            )
            s.store_ends(bond_place, end_force, end_torque, b, f, ti, tj)
            owed = contact.left_over(closing_stiffness[t], closing_gap[t], gap)
            closing_gap[t] = gap
            if owed != real(0.0):
                closing_debt[t] = closing_debt[t] + owed
                any_crossed[0] = 1

    return kernel(evm_closing, simd)


@cache
def evm_settle(s: Laws, k: Laws, simd: bool = True):
    """Pass over listed EVM bonds: pay what their closing or opening left over."""
    kinematics, contact, real = evm_kinematics(s, k), closing(s), s.real

    def evm_settle(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        # written
        closing_debt: wp.array(dtype=real),
        closing_impulse: wp.array(dtype=real),
        closing_twist: wp.array(dtype=real),
        share: real,
        first: int,
        first_evm: int,
    ):
        t = wp.tid() + first
        b = nn(listed[t])
        c = nn(b - first_evm)
        x = kinematics.load_measures(
            b,
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            displacement,
            orientation,
        )
        contact.settle(
            t,
            b,
            nn(bond_i[b]),
            nn(bond_j[b]),
            x.p - x.bend_i,
            real(evm_offset[nn(2 * c)]) * x.p,
            -real(evm_offset[nn(2 * c + 1)]) * x.m,
            inverse_mass,
            inverse_inertia,
            velocity,
            angular_velocity,
            bond_place,
            closing_debt,
            closing_impulse,
            closing_twist,
            share,
        )

    return kernel(evm_settle, simd)


@cache
def evm_energies(s: Laws, k: Laws, is_listed: bool, simd: bool = True):
    """Per EVM bond: the energy it holds linked [J]."""
    kinematics, law, real = evm_kinematics(s, k), evm(s), s.real

    def evm_energies(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        # state read
        evm_stiffness: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        linked_energy: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        t = wp.tid() + first
        b = nn(t)
        if wp.static(is_listed):
            b = nn(listed[t])
        c = nn(b - first_evm)
        x = kinematics.load_measures(
            b,
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            displacement,
            orientation,
        )
        linked_energy[t] = law.energy(law.load_stiffness(evm_stiffness, c), x)

    return kernel(evm_energies, simd)


@cache
def evm_closing_energies(s: Laws, k: Laws, simd: bool = True):
    """Per listed EVM bond: the energy it holds, or would hold, unlinked [J]."""
    kinematics, contact, real = evm_kinematics(s, k), closing(s), s.real

    def evm_closing_energies(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        closing_stiffness: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        closing_energy: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        t = wp.tid() + first
        b = nn(listed[t])
        x = kinematics.load_measures(
            b,
            nn(b - first_evm),
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            displacement,
            orientation,
        )
        closing_energy[t] = contact.energy(closing_stiffness[t], x.elongation)

    return kernel(evm_closing_energies, simd)


@cache
def evm_unlink(s: Laws, has_volume: bool, simd: bool = True):
    """Pass over listed EVM bonds: an unlinked bond has no stiffness."""
    real = s.real

    def evm_unlink(
        listed: wp.array(dtype=int),
        # state read
        bond_linked: wp.array(dtype=real),
        # written
        evm_stiffness: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        b = nn(listed[wp.tid() + first])
        c = nn(b - first_evm)
        for n in range(4):
            evm_stiffness[4 * c + n] = bond_linked[b] * evm_stiffness[4 * c + n]
        if wp.static(has_volume):
            bond_weight[b] = bond_linked[b] * bond_weight[b]

    return kernel(evm_unlink, simd)

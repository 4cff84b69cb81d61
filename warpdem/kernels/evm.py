"""The EVM bond (Kuzkin 2-3; theory A1-A2): any longitudinal, shear, bending, torsional stiffness.

Vectors n_2 and n_3 of the paper are never formed: n_i2.n_j2 + n_i3.n_j3 depends on the relative
rotation alone, so the choice of transverse vectors does not matter. Its n_j1 is -m here, which
keeps both frames right-handed.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow, narrow_spin
from .face import face
from .memory import index, kernel, nn
from .volume import volume


@cache
def evm(s: Laws) -> Laws:
    """Laws of the EVM bond in its deformation measures, all zero in the reference state.

    g = D - a [m] elongation, length D [m], p = Q_i e0, m = Q_j e0, bi = p - d, bj = m - d,
    and the half-rotation from i to j, (sin u, cos) of half the relative angle.
    """
    real, vec, spin = s.real, s.vec, s.spin

    @wp.func
    def energy(b1: real, b2: real, b3: real, b4: real, g: real, bi: vec, bj: vec, half: spin):
        """U [J], Kuzkin eq. 2 + B2 + B3 + B4, so that it is zero at rest (theory A1)."""
        return (
            real(0.5) * b1 * g * g
            + real(0.25) * b2 * (wp.dot(bi, bi) + wp.dot(bj, bj))
            + real(0.5) * (b3 - real(0.5) * b4) * wp.dot(bi - bj, bi - bj)
            + real(2.0) * b4 * s.spin_squared(half)
        )

    @wp.func
    def force(
        b1: real,
        b2: real,
        b3: real,
        b4: real,
        ri: real,
        rj: real,
        g: real,
        length: real,
        p: vec,
        m: vec,
        bi: vec,
        bj: vec,
        half: spin,
        cosine: real,
    ):
        """Force on i [N] and torques on i and j [N m], Kuzkin eq. 3 (theory A2)."""
        d = p - bi
        y = bi + bj
        f = b1 * g * d - (real(0.5) * b2 / length) * (y - wp.dot(y, d) * d)
        both = (b3 - real(0.5) * b4) * s.cross(p, bj - bi) + (real(2.0) * b4 * cosine) * half
        ti = ri * s.cross(p, f) - real(0.5) * b2 * s.cross(p, bi) + both
        tj = rj * s.cross(m, f) - real(0.5) * b2 * s.cross(m, bj) - both
        return f, ti, tj

    @wp.func
    def closing_energy(b1: real, g: real) -> real:
        """U = B1/2 <D - a>^2 [J] of an unlinked bond, only if shorter than at rest (theory B11)."""
        h = wp.min(g, real(0.0))
        return real(0.5) * b1 * h * h

    @wp.func
    def closing_force(b1: real, ri: real, rj: real, g: real, p: vec, m: vec, bi: vec):
        """Force on i and torques of the closing energy."""
        f = b1 * wp.min(g, real(0.0)) * (p - bi)
        return f, ri * s.cross(p, f), rj * s.cross(m, f)

    return Laws(
        energy=energy, force=force, closing_energy=closing_energy, closing_force=closing_force
    )


@cache
def evm_kinematics(s: Laws, k: Laws) -> Laws:
    """Deformation measures of a bond, differenced in the precision of k, returned in that of s."""
    real, narrowed, narrowed_spin = s.real, narrow(s, k), narrow_spin(s, k)

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
    ):
        """Measures of bond b, the c-th EVM bond: g, D, p, m, bi, bj, half-rotation, its cosine.

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
        return (
            real(g),
            real(length),
            narrowed(e0 + xi),
            narrowed(e0 + xj),
            narrowed(xi - dd),
            narrowed(xj - dd),
            narrowed_spin(k.axial(turned)),
            real(k.scalar(turned)),
        )

    return Laws(load_measures=load_measures)


@cache
def evm_forces(
    s: Laws, k: Laws, has_volume: bool, has_unlinked: bool, is_listed: bool, simd: bool = True
):
    """Pass over EVM bonds: force on i and the torques on both elements."""
    kinematics, law, real, at = evm_kinematics(s, k), evm(s), s.real, index(is_listed)
    geometry, many = face(s, k), volume(s)

    def evm_forces(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        evm_stiffness: wp.array(dtype=real),
        bond_arm: wp.array(dtype=k.real),
        bond_weight: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        # written
        bond_force: wp.array(dtype=real),
        bond_torque: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        b = at(listed, wp.tid() + first)
        c = nn(b - first_evm)
        g, length, p, m, bi, bj, half, cosine = kinematics.load_measures(
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
            evm_stiffness[nn(4 * c)],
            evm_stiffness[nn(4 * c + 1)],
            evm_stiffness[nn(4 * c + 2)],
            evm_stiffness[nn(4 * c + 3)],
            real(evm_offset[nn(2 * c)]),
            real(evm_offset[nn(2 * c + 1)]),
            g,
            length,
            p,
            m,
            bi,
            bj,
            half,
            cosine,
        )
        if wp.static(has_volume):
            delta, ci, cj = geometry.load_opening(
                b, bond_i, bond_j, bond_arm, displacement, orientation
            )
            gi = volume_stress[nn(bond_i[b])]
            gj = volume_stress[nn(bond_j[b])]
            fv, tiv, tjv = many.force(bond_weight[b], gi, gj, ci, cj, delta)
            f += fv
            ti += tiv
            tj += tjv
        if wp.static(has_unlinked):
            f *= bond_linked[b]
            ti *= bond_linked[b]
            tj *= bond_linked[b]
        s.store(bond_force, b, f)
        s.store_spin(bond_torque, nn(2 * b), ti)
        s.store_spin(bond_torque, nn(2 * b + 1), tj)

    return kernel(evm_forces, simd)


@cache
def evm_closing(s: Laws, k: Laws, simd: bool = True):
    """Pass over listed EVM bonds: unlinked ones resist closing (theory B11)."""
    kinematics, law, real = evm_kinematics(s, k), evm(s), s.real

    def evm_closing(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        evm_stiffness: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        # written
        bond_force: wp.array(dtype=real),
        bond_torque: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        b = nn(listed[wp.tid() + first])
        c = nn(b - first_evm)
        if bond_linked[b] == real(0.0):
            g, length, p, m, bi, bj, half, cosine = kinematics.load_measures(
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
            f, ti, tj = law.closing_force(
                evm_stiffness[nn(4 * c)],
                real(evm_offset[nn(2 * c)]),
                real(evm_offset[nn(2 * c + 1)]),
                g,
                p,
                m,
                bi,
            )
            s.store(bond_force, b, f)
            s.store_spin(bond_torque, nn(2 * b), ti)
            s.store_spin(bond_torque, nn(2 * b + 1), tj)

    return kernel(evm_closing, simd)


@cache
def evm_energies(s: Laws, k: Laws, has_unlinked: bool, is_listed: bool, simd: bool = True):
    """Per EVM bond: the energy it holds linked, and the one it holds unlinked [J]."""
    kinematics, law, real, at = evm_kinematics(s, k), evm(s), s.real, index(is_listed)

    def evm_energies(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        evm_stiffness: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        linked_energy: wp.array(dtype=real),
        unlinked_energy: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        t = nn(wp.tid() + first)
        b = at(listed, t)
        c = nn(b - first_evm)
        g, length, p, m, bi, bj, half, cosine = kinematics.load_measures(
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
        b1 = evm_stiffness[nn(4 * c)]
        linked_energy[t] = law.energy(
            b1,
            evm_stiffness[nn(4 * c + 1)],
            evm_stiffness[nn(4 * c + 2)],
            evm_stiffness[nn(4 * c + 3)],
            g,
            bi,
            bj,
            half,
        )
        if wp.static(has_unlinked):
            unlinked_energy[t] = law.closing_energy(b1, g)

    return kernel(evm_energies, simd)

"""The EVM bond (Kuzkin 2-3; theory A1-A2): any longitudinal, shear, bending, torsional stiffness.

Vectors n_2 and n_3 of the paper are never formed: n_i2.n_j2 + n_i3.n_j3 depends on the relative
rotation alone, so the choice of transverse vectors does not matter. Its n_j1 is -m here, which
keeps both frames right-handed.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow, narrow_spin
from .closing import PARTED, UNKNOWN, closing
from .face import Faces, carrying, face
from .friction import face_friction
from .memory import get, kernel, nn, put
from .volume import volume

CRUSHED = 0.1  # share of its length below which a bond has lost its direction (theory A5)


@cache
def measures(s: Laws):
    """Deformation measures of an EVM bond, those of its reference state being zero or fixed."""
    real, vec, spin = s.real, s.vec, s.spin

    @wp.struct
    class Measures:
        elongation: real  # g = D - a [m]
        length: real  # D [m], not below CRUSHED a
        whole: real  # 1, or 0 if the bond is crushed: D < CRUSHED a
        p: vec  # Q_i e0
        m: vec  # Q_j e0
        d: vec  # direction of the bond
        bend: vec  # m - p
        bend_i: vec  # p - d, or, after plastic flow, from the tilted axis
        bend_j: vec  # m - d, likewise
        half: spin  # sin(angle/2) times axis of the rotation from i to j
        cosine: real  # cos(angle/2)

    return Measures


@cache
def angles(s: Laws) -> Laws:
    """Angles of two unit vectors, and of a rotation, from 0 to pi (theory A5)."""
    real, measure = s.real, measures(s)
    steep = real(1.0e-4)  # how close to antiparallel a force still grows

    @wp.func
    def squared(chord: s.vec) -> real:
        """phi^2, for the difference of two unit vectors."""
        half = wp.min(real(0.5) * wp.length(chord), real(1.0))
        return real(4.0) * wp.asin(half) * wp.asin(half)

    @wp.func
    def growth(chord: s.vec) -> real:
        """d(phi^2)/d(chord^2) = phi/sin(phi)."""
        half = wp.min(real(0.5) * wp.length(chord), real(1.0))
        other = wp.max(wp.sqrt(wp.max(real(1.0) - half * half, real(0.0))), steep)
        return wp.where(
            half < steep, real(1.0), wp.asin(half) / wp.max(half * other, steep * steep)
        )

    @wp.func
    def turned(half: s.spin, cosine: real) -> real:
        """Angle of a rotation."""
        return real(2.0) * wp.atan2(wp.sqrt(s.spin_squared(half)), wp.abs(cosine))

    @wp.func
    def rotation(half: s.spin, cosine: real) -> s.spin:
        """Rotation vector, the short way round."""
        size = wp.sqrt(s.spin_squared(half))
        share = wp.where(
            size < steep, real(2.0), turned(half, cosine) / wp.max(size, steep * steep)
        )
        return wp.where(cosine < real(0.0), -share, share) * half

    @wp.func
    def bend(x: measure) -> real:
        """The greater of the angles between a bond and the axes of its ends."""
        return wp.sqrt(wp.max(squared(x.bend_i), squared(x.bend_j)))

    @wp.func
    def twist(x: measure) -> real:
        """Turn about the mean of both axes (swing and twist)."""
        axis = x.p + x.m
        along = wp.dot(x.half, axis) / wp.max(wp.length(axis), real(1.0e-6))
        return real(2.0) * wp.atan2(wp.abs(along), wp.abs(x.cosine))

    return Laws(
        squared=squared, growth=growth, turned=turned, rotation=rotation, bend=bend, twist=twist
    )


@cache
def beam_loads(s: Laws):
    """What a bond carries as a beam between its ends."""
    real, vec, spin = s.real, s.vec, s.spin

    if s.dim == 2:

        @wp.func
        def moments(torque: spin, axis: vec):
            """Bending and twisting moment of a torque."""
            return wp.abs(torque), real(0.0)
    else:

        @wp.func
        def moments(torque: spin, axis: vec):
            """Bending and twisting moment of a torque."""
            twist = wp.dot(torque, axis)
            return wp.length(torque - twist * axis), wp.abs(twist)

    @wp.func
    def loads(force: vec, ti: spin, tj: spin, axis: vec):
        """Force along [N], tension positive, and across, the greater bending and the greater
        twisting moment of both ends [N m]; ti, tj: torques about the ends."""
        along = wp.dot(force, axis)
        bend_i, twist_i = moments(ti, axis)
        bend_j, twist_j = moments(tj, axis)
        across = wp.length(force - along * axis)
        return along, across, wp.max(bend_i, bend_j), wp.max(twist_i, twist_j)

    return loads


@cache
def evm(s: Laws, large_rotation: bool = False) -> Laws:
    """Laws of the EVM bond: linked, and unlinked where it only resists closing.

    With `large_rotation` the squares of chords become squares of angles (theory A5): the same bond
    while rotations are small, linear in its angles up to pi.
    """
    real, vec4, measure = s.real, wp.types.vector(4, s.real), measures(s)
    angle, shortest = angles(s), s.real(CRUSHED)

    @wp.func
    def stretch(stiffness: real, x: measure) -> real:
        """c g^2/2 [J]. A crushed bond pulls by c g D/(CRUSHED a), which is zero where D is."""
        rest = x.length / shortest
        d = rest + x.elongation
        crushed = (d * d * d - x.length * x.length * x.length) / (real(3.0) * x.length)
        crushed -= real(0.5) * rest * (d * d - x.length * x.length) / x.length
        crushed += real(0.5) * (rest - x.length) * (rest - x.length)
        return stiffness * wp.where(
            x.whole > real(0.0), real(0.5) * x.elongation * x.elongation, crushed
        )

    @wp.func
    def energy(b: vec4, x: measure) -> real:
        """U [J]: Kuzkin eq. 2 + B2 + B3 + B4, so that it is zero at rest (theory A1)."""
        bend = x.bend
        ends = wp.dot(x.bend_i, x.bend_i) + wp.dot(x.bend_j, x.bend_j)
        bending = wp.dot(bend, bend)
        turning = real(4.0) * s.spin_squared(x.half)
        if wp.static(large_rotation):
            ends = angle.squared(x.bend_i) + angle.squared(x.bend_j)
            bending = angle.squared(bend)
            turning = angle.turned(x.half, x.cosine) * angle.turned(x.half, x.cosine)
        return (
            stretch(b[0], x)
            + real(0.25) * b[1] * ends
            + real(0.5) * (b[2] - real(0.5) * b[3]) * bending
            + real(0.5) * b[3] * turning
        )

    @wp.func
    def force(b: vec4, ri: real, rj: real, x: measure):
        """Force on i [N] and torques on i and j [N m]: Kuzkin eq. 3 (theory A2)."""
        d = x.d
        bend = x.bend
        bend_i = x.bend_i
        bend_j = x.bend_j
        turn = (real(2.0) * x.cosine) * x.half
        if wp.static(large_rotation):
            bend_i = angle.growth(bend_i) * bend_i
            bend_j = angle.growth(bend_j) * bend_j
            bend = angle.growth(bend) * bend
            turn = angle.rotation(x.half, x.cosine)
        y = bend_i + bend_j
        f = b[0] * x.elongation * d
        f -= (real(0.5) * b[1] / x.length) * (y - x.whole * wp.dot(y, d) * d)
        both = (b[2] - real(0.5) * b[3]) * s.cross(x.p, bend) + b[3] * turn
        ti = ri * s.cross(x.p, f) - real(0.5) * b[1] * s.cross(d, bend_i) + both
        tj = rj * s.cross(x.m, f) - real(0.5) * b[1] * s.cross(d, bend_j) - both
        return f, ti, tj

    @wp.func
    def closing_force(pull: real, ri: real, rj: real, x: measure):
        """Force on i and torques of a pull along the bond."""
        f = pull * x.d
        return f, ri * s.cross(x.p, f), rj * s.cross(x.m, f)

    @wp.func
    def load_stiffness(evm_stiffness: wp.array(dtype=real), c: int) -> vec4:
        """B1..B4 of the c-th EVM bond."""
        return vec4(
            get(evm_stiffness, 4 * c),
            get(evm_stiffness, 4 * c + 1),
            get(evm_stiffness, 4 * c + 2),
            get(evm_stiffness, 4 * c + 3),
        )

    return Laws(
        stretch=stretch,
        energy=energy,
        force=force,
        closing_force=closing_force,
        load_stiffness=load_stiffness,
    )


@cache
def evm_kinematics(s: Laws, k: Laws, has_slip: bool = False) -> Laws:
    """Deformation measures of a bond, differenced in the precision of k, returned in that of s."""
    real, vec, narrowed, narrowed_spin = s.real, s.vec, narrow(s, k), narrow_spin(s, k)
    measure, loss, carried = measures(s), k.real(CRUSHED - 1.0), carrying(s, k)

    @wp.func
    def measured(
        du: k.vec, qi: k.rot, qj: k.rot, e0: k.vec, a: k.real, ri: k.real, rj: k.real
    ) -> measure:
        """Measures of a bond whose ends have parted by du and turned by qi and qj.

        D - a is taken as (2 X + Delta).Delta / (D + a), free of cancellation (theory A4). Where
        the bond is crushed, d = D/(CRUSHED a) is shorter than 1, so that all stays finite.
        """
        xi = k.turn(qi, e0)
        xj = k.turn(qj, e0)
        delta = du - ri * xi - rj * xj
        g = wp.dot(k.real(2.0) * a * e0 + delta, delta) / (wp.length(a * e0 + delta) + a)
        shortening = wp.max(g, loss * a)
        length = a + shortening
        dd = (delta - shortening * e0) / length
        turned = k.relative(qi, qj)
        x = measure()
        x.elongation = real(g)
        x.length = real(length)
        x.whole = wp.where(g < loss * a, real(0.0), real(1.0))
        x.p = narrowed(e0 + xi)
        x.m = narrowed(e0 + xj)
        x.d = narrowed(e0 + dd)
        x.bend = narrowed(xj - xi)
        x.bend_i = narrowed(xi - dd)
        x.bend_j = narrowed(xj - dd)
        x.half = narrowed_spin(k.axial(turned))
        x.cosine = real(k.scalar(turned))
        return x

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
        """Measures of bond b, the c-th EVM bond."""
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        return measured(
            k.load(displacement, j) - k.load(displacement, i),
            k.load_rot(orientation, i),
            k.load_rot(orientation, j),
            k.load(evm_direction, c),
            get(evm_length, c),
            get(evm_offset, 2 * c),
            get(evm_offset, 2 * c + 1),
        )

    @wp.func
    def load_middle(
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
        """The middle of the bond as each element carries it: how far both have parted, and the
        arms to them."""
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        e0 = k.load(evm_direction, c)
        half = k.real(0.5) * get(evm_length, c)
        ci = (get(evm_offset, 2 * c) + half) * e0
        cj = -(get(evm_offset, 2 * c + 1) + half) * e0
        qi = k.load_rot(orientation, i)
        qj = k.load_rot(orientation, j)
        return carried(k.load(displacement, j) - k.load(displacement, i), qi, qj, ci, cj)

    @wp.func
    def load_tilt(
        at: int, i: int, evm_tilt: wp.array(dtype=k.real), orientation: wp.array(dtype=k.real)
    ) -> vec:
        """How far plastic flow has tilted an end's axis, in the world frame."""
        tilt = k.load(evm_tilt, at)
        return narrowed(tilt + k.turn(k.load_rot(orientation, i), tilt))

    @wp.func
    def load_flowed(
        b: int,
        c: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        evm_slip: wp.array(dtype=real),
        evm_tilt: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ) -> measure:
        """Elastic measures: where the bond has flowed, its length at rest is longer by `evm_slip`
        and the ends' axes are tilted by `evm_tilt` (theory B6)."""
        x = load_measures(
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
        if wp.static(has_slip):
            x.elongation = x.elongation - get(evm_slip, c)
            x.bend_i = x.bend_i + load_tilt(nn(2 * c), nn(get(bond_i, b)), evm_tilt, orientation)
            x.bend_j = x.bend_j + load_tilt(
                nn(2 * c + 1), nn(get(bond_j, b)), evm_tilt, orientation
            )
        return x

    return Laws(
        measured=measured,
        load_middle=load_middle,
        load_measures=load_measures,
        load_flowed=load_flowed,
    )


@cache
def evm_forces(
    s: Laws,
    k: Laws,
    faces: Faces,
    has_volume: bool,
    large_rotation: bool,
    has_beams: bool,
    is_listed: bool,
    simd: bool = True,
):
    """Pass over EVM bonds: force on i and the torques on both elements.

    has_beams: some bonds break by what they carry as beams, which is kept as well.
    """
    law, real, beam = evm(s, large_rotation), s.real, beam_loads(s)
    kinematics = evm_kinematics(s, k, faces.has_slip)
    geometry, many = face(s, k, faces), volume(s)

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
        bond_jump: wp.array(dtype=k.real),
        # state read
        evm_stiffness: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        evm_slip: wp.array(dtype=real),
        evm_tilt: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        volume_stress: wp.array(dtype=real),
        # written
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        beam_load: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        b = nn(wp.tid() + first)
        if wp.static(is_listed):
            b = nn(get(listed, b))
        c = nn(b - first_evm)
        x = kinematics.load_flowed(
            b,
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            evm_slip,
            evm_tilt,
            displacement,
            orientation,
        )
        ri = real(get(evm_offset, 2 * c))
        rj = real(get(evm_offset, 2 * c + 1))
        f, ti, tj = law.force(law.load_stiffness(evm_stiffness, c), ri, rj, x)
        if wp.static(has_volume):
            delta, ci, cj = geometry.load_opening(
                b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
            )
            gi = get(volume_stress, get(bond_i, b))
            gj = get(volume_stress, get(bond_j, b))
            fi, fj = many.force(get(bond_weight, b), gi, gj, ci, cj)
            f += fi + fj
            ti += s.cross(ci, fi + fj) + s.cross(delta, fi)
            tj += s.cross(delta, fj) - s.cross(cj, fi + fj)
        s.store_ends(bond_place, end_force, end_torque, b, f, ti, tj)
        if wp.static(has_beams):
            ti -= ri * s.cross(x.p, f)
            tj -= rj * s.cross(x.m, f)
            along, across, bending, twisting = beam(f, ti, tj, s.unit(x.p + x.m))
            put(beam_load, 4 * c, along)
            put(beam_load, 4 * c + 1, across)
            put(beam_load, 4 * c + 2, bending)
            put(beam_load, 4 * c + 3, twisting)

    return kernel(evm_forces, simd)


@cache
def evm_closing(s: Laws, k: Laws, has_slip: bool, rubs: bool, ages: bool, by_kind: bool):
    """Pass over listed EVM bonds: unlinked ones resist closing (theory B11).

    rubs: closed ones also resist sliding, as `friction.face_friction` has it, across the bond and
    where its middle was. ages: as of `contact.Touch`.
    """
    kinematics, law, contact, real = evm_kinematics(s, k, has_slip), evm(s), closing(s), s.real
    rubbing = face_friction(s, k, ages)

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
        closing_shear: wp.array(dtype=real),
        contact_kind: wp.array(dtype=int),
        friction_table: wp.array(dtype=real),
        friction_numbers: wp.array(dtype=wp.float64),
        # state read
        evm_slip: wp.array(dtype=real),
        evm_tilt: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        # written
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        closing_gap: wp.array(dtype=real),
        closing_debt: wp.array(dtype=real),
        any_crossed: wp.array(dtype=int),
        closing_slip: wp.array(dtype=k.real),
        closing_spring: wp.array(dtype=real),
        closing_theta: wp.array(dtype=wp.float64),
        closing_slip_energy: wp.array(dtype=wp.float64),
        slack: real,
        friction: real,
        dt: real,
        kinds: int,
        first: int,
        first_evm: int,
    ):
        t = wp.tid() + first
        b = nn(listed[t])
        c = nn(b - first_evm)
        if get(bond_linked, b) == real(0.0):
            x = kinematics.load_flowed(
                b,
                c,
                bond_i,
                bond_j,
                evm_direction,
                evm_length,
                evm_offset,
                evm_slip,
                evm_tilt,
                displacement,
                orientation,
            )
            gap = x.elongation
            pull = contact.pull(closing_stiffness[t], gap, slack)
            f, ti, tj = law.closing_force(
                pull, real(get(evm_offset, 2 * c)), real(get(evm_offset, 2 * c + 1)), x
            )
            if wp.static(rubs):
                delta, ci, cj = kinematics.load_middle(
                    b, c, bond_i, bond_j, evm_direction, evm_length, evm_offset, displacement,
                    orientation,
                )  # fmt: skip
                row = int(0)  # noqa: UP018, RUF046
                mu = friction
                if wp.static(by_kind):
                    row = kinds * contact_kind[get(bond_i, b)] + contact_kind[get(bond_j, b)]
                    mu = friction_table[row]
                is_new = closing_gap[t] >= real(UNKNOWN)
                hold = rubbing.rub(
                    t, delta, x.d, pull, is_new, nn(get(bond_i, b)), orientation, mu, row,
                    friction_numbers, closing_shear, closing_slip, closing_spring, closing_theta,
                    closing_slip_energy, dt,
                )  # fmt: skip
                f += hold
                ti += s.cross(ci + delta, hold)
                tj -= s.cross(cj, hold)
            s.store_ends(bond_place, end_force, end_torque, b, f, ti, tj)
            if closing_gap[t] == real(PARTED):
                closing_debt[t] = real(0.0)  # the list of neighbours has taken it over
            owed = contact.left_over(closing_stiffness[t], closing_gap[t], gap)
            closing_gap[t] = gap
            if owed != real(0.0):
                closing_debt[t] = closing_debt[t] + owed
                any_crossed[0] = 1

    # plain code: nearly all listed bonds are linked, and a vector would work them out all the same
    return kernel(evm_closing, simd=False)


@cache
def evm_settle(s: Laws, k: Laws, has_slip: bool):
    """Pass over listed EVM bonds: pay what their closing or opening left over."""
    kinematics, contact, real = evm_kinematics(s, k, has_slip), closing(s), s.real

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
        evm_slip: wp.array(dtype=real),
        evm_tilt: wp.array(dtype=k.real),
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
        if not contact.owes(t, b, bond_place, closing_debt, closing_impulse):
            return
        c = nn(b - first_evm)
        x = kinematics.load_flowed(
            b,
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            evm_slip,
            evm_tilt,
            displacement,
            orientation,
        )
        contact.settle(
            t,
            b,
            nn(get(bond_i, b)),
            nn(get(bond_j, b)),
            x.d,
            real(get(evm_offset, 2 * c)) * x.p,
            -real(get(evm_offset, 2 * c + 1)) * x.m,
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

    # plain code, as `evm_closing`: few owe anything
    return kernel(evm_settle, simd=False)


@cache
def evm_energies(
    s: Laws, k: Laws, has_slip: bool, large_rotation: bool, is_listed: bool, simd: bool = True
):
    """Per EVM bond: the energy it holds linked [J]."""
    kinematics, law, real = evm_kinematics(s, k, has_slip), evm(s, large_rotation), s.real

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
        evm_slip: wp.array(dtype=real),
        evm_tilt: wp.array(dtype=k.real),
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
        x = kinematics.load_flowed(
            b,
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            evm_slip,
            evm_tilt,
            displacement,
            orientation,
        )
        linked_energy[t] = law.energy(law.load_stiffness(evm_stiffness, c), x)

    return kernel(evm_energies, simd)


@cache
def evm_closing_energies(
    s: Laws, k: Laws, has_slip: bool, rubs: bool, has_rows: bool, simd: bool = True
):
    """Per listed EVM bond: the energy it holds, or would hold, unlinked [J].

    has_rows: of those in `rows` of the list alone.
    """
    kinematics, law, real = evm_kinematics(s, k, has_slip), evm(s), s.real

    def evm_closing_energies(
        # model
        rows: wp.array(dtype=int),
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        closing_stiffness: wp.array(dtype=real),
        closing_shear: wp.array(dtype=real),
        # state read
        evm_slip: wp.array(dtype=real),
        evm_tilt: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        closing_spring: wp.array(dtype=real),
        # written
        closing_energy: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        t = nn(wp.tid() + first)
        if wp.static(has_rows):
            t = nn(get(rows, t))
        b = nn(get(listed, t))
        x = kinematics.load_flowed(
            b,
            nn(b - first_evm),
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            evm_slip,
            evm_tilt,
            displacement,
            orientation,
        )
        held = law.stretch(get(closing_stiffness, t), x)
        energy = wp.where(x.elongation < real(0.0), held, real(0.0))
        if wp.static(rubs):
            spring = s.load(closing_spring, t)
            energy += real(0.5) * get(closing_shear, t) * wp.dot(spring, spring)
        put(closing_energy, t, energy)

    return kernel(evm_closing_energies, simd)


@cache
def evm_angles(s: Laws, k: Laws, simd: bool = True):
    """Per EVM bond: how far it is twisted and bent [rad] and shortened, D/a - 1."""
    kinematics, angle, real = evm_kinematics(s, k), angles(s), s.real

    def evm_angles(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        evm_twist: wp.array(dtype=real),
        evm_bend: wp.array(dtype=real),
        evm_elongation: wp.array(dtype=real),
        first_evm: int,
    ):
        c = nn(wp.tid())
        x = kinematics.load_measures(
            nn(c + first_evm),
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            displacement,
            orientation,
        )
        put(evm_bend, c, angle.bend(x))
        put(evm_elongation, c, x.elongation / real(get(evm_length, c)))
        if wp.static(s.dim == 3):
            put(evm_twist, c, angle.twist(x))

    return kernel(evm_angles, simd)


@cache
def evm_unlink(s: Laws, has_volume: bool, has_dashpots: bool, softens: bool, simd: bool = True):
    """Pass over listed EVM bonds: an unlinked bond has neither stiffness nor dashpots, a softened
    one less of both."""
    real = s.real

    def evm_unlink(
        listed: wp.array(dtype=int),
        # state read
        bond_linked: wp.array(dtype=real),
        # written
        bond_keep: wp.array(dtype=real),
        evm_stiffness: wp.array(dtype=real),
        evm_dashpot: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        first: int,
        first_evm: int,
    ):
        b = nn(listed[wp.tid() + first])
        c = nn(b - first_evm)
        keep = get(bond_linked, b)
        if wp.static(softens):
            keep = get(bond_keep, b)
            put(bond_keep, b, real(1.0))
        for n in range(4):
            evm_stiffness[4 * c + n] = keep * evm_stiffness[4 * c + n]
            if wp.static(has_dashpots):
                evm_dashpot[4 * c + n] = keep * evm_dashpot[4 * c + n]
        if wp.static(has_volume):
            put(bond_weight, b, keep * get(bond_weight, b))

    return kernel(evm_unlink, simd)

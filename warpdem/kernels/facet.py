"""The facet bond: an isotropic spring between the two points of a face (theory B2a).

The pair part of Shilko eq. 7 in exact, finite-rotation form: c_A = c_D = 2 G S / r0, so its energy
needs no split into normal and tangential parts.
"""

from functools import cache

import warp as wp

from .algebra import Laws
from .closing import PARTED, TURNED, UNKNOWN, closing
from .contact import pair, pressing
from .face import Faces, face
from .friction import face_friction
from .memory import get, kernel, nn, put
from .volume import volume

# cosines of the turn of two faces against each other up to which they resist closing wholly, and
# from which on they do not at all (30 and 75 degrees)
MEET, MISS = 0.8660254, 0.2588190


@cache
def facet(s: Laws) -> Laws:
    """Laws of the facet bond: linked, and unlinked where it only resists closing."""
    real, vec, spin = s.real, s.vec, s.spin

    @wp.func
    def energy(stiffness: real, delta: vec) -> real:
        """U = k/2 |delta|^2 [J]."""
        return real(0.5) * stiffness * wp.dot(delta, delta)

    @wp.func
    def bending_energy(bending: real, torsion: real, p: vec, m: vec, half: spin) -> real:
        """(c_B - c_T)/2 |p - m|^2 + 2 c_T |v_r|^2 [J] (theory B9), as of an EVM bond."""
        bend = p - m
        return real(0.5) * (bending - torsion) * wp.dot(bend, bend) + real(
            2.0
        ) * torsion * s.spin_squared(half)

    @wp.func
    def bending_torque(
        bending: real, torsion: real, p: vec, m: vec, half: spin, cosine: real
    ) -> spin:
        """Torque on i [N m], opposite on j."""
        return (bending - torsion) * s.cross(p, m) + (real(2.0) * torsion * cosine) * half

    @wp.func
    def force(stiffness: real, delta: vec) -> vec:
        """Force on i [N], -dU/dx_i; it acts at the facet points."""
        return stiffness * delta

    @wp.func
    def gap(delta: vec, p: vec, m: vec) -> real:
        """Opening along the mean of the normals that both elements carry [m]."""
        return wp.dot(delta, wp.normalize(p + m))

    @wp.func
    def meeting(p: vec, m: vec):
        """Share of two faces that meet, in c = p.m, and its derivative: 1 until they have turned
        away from each other, then falling smoothly to 0."""
        x = (wp.dot(p, m) - real(MISS)) / real(wp.static(MEET - MISS))
        x = wp.clamp(x, real(0.0), real(1.0))
        slope = real(wp.static(6.0 / (MEET - MISS))) * x * (real(1.0) - x)
        return x * x * (real(3.0) - real(2.0) * x), slope

    @wp.func
    def closing_force(
        pull: real, held: real, slope: real, delta: vec, ci: vec, cj: vec, p: vec, m: vec
    ):
        """Force on i and torques of a pull along n, the turning of n included.

        held: energy of faces that meet wholly [J], slope: of the share that does.
        """
        n = wp.normalize(p + m)
        # of elements that have turned over against each other there is no normal, and no pull
        both = wp.max(wp.length(p + m), real(1.0e-6))
        slip = (delta - wp.dot(delta, n) * n) / both
        f = pull * n
        away = (held * slope) * s.cross(p, m)
        ti = s.cross(ci, f) - pull * s.cross(p, slip) - away
        tj = -s.cross(cj, f) - pull * s.cross(m, slip) + away
        return f, ti, tj

    return Laws(
        energy=energy,
        bending_energy=bending_energy,
        bending_torque=bending_torque,
        force=force,
        gap=gap,
        meeting=meeting,
        closing_force=closing_force,
    )


@cache
def facet_forces(
    s: Laws,
    k: Laws,
    faces: Faces,
    has_volume: bool,
    has_bending: bool,
    is_listed: bool,
    simd: bool = True,
):
    """Pass over facet bonds: force on i and the torques on both elements."""
    geometry, law, many, real = face(s, k, faces), facet(s), volume(s), s.real

    def facet_forces(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        # state read
        facet_stiffness: wp.array(dtype=real),
        facet_bending: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        bond_slip: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        volume_stress: wp.array(dtype=real),
        # written
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        first: int,
    ):
        b = nn(wp.tid() + first)
        if wp.static(is_listed):
            b = nn(get(listed, b))
        delta, ci, cj = geometry.load_opening(
            b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
        )
        spring = delta
        if wp.static(faces.has_slip):
            si, sj = geometry.load_slips(b, bond_i, bond_j, bond_slip, orientation)
            spring = delta + sj - si
        f = law.force(get(facet_stiffness, b), spring)
        pull = f
        if wp.static(has_volume):
            gi = get(volume_stress, get(bond_i, b))
            gj = get(volume_stress, get(bond_j, b))
            fi, fj = many.force(get(bond_weight, b), gi, gj, ci, cj)
            f = f + fi + fj
            if wp.static(faces.has_creep):  # of the opening of the anchors, and acting there
                delta = spring
                pull = f
            ti = s.cross(ci, f) + s.cross(delta, fi)
            tj = s.cross(delta, fj) - s.cross(cj, f)
        else:
            ti = s.cross(ci, f)
            tj = -s.cross(cj, f)
        if wp.static(faces.has_slip):
            ti += s.cross(si, pull)
            tj -= s.cross(sj, pull)
        if wp.static(has_bending):
            p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
            half, cosine = geometry.load_turn(b, bond_i, bond_j, orientation)
            t = law.bending_torque(
                get(facet_bending, 2 * b), get(facet_bending, 2 * b + 1), p, m, half, cosine
            )
            ti += t
            tj -= t
        s.store_ends(bond_place, end_force, end_torque, b, f, ti, tj)

    return kernel(facet_forces, simd)


@cache
def turning(s: Laws, k: Laws, touch_law: str | None) -> Laws:
    """What two elements whose faces turn away from each other become: spheres, or nothing where
    elements do not touch. touch_law: by which law they do, or None."""
    real = s.real
    geometry, law = pair(s, k, touch_law == "hertz"), pressing(s, touch_law == "hertz")

    @wp.func
    def load_sphere(
        i: int,
        j: int,
        d: s.vec,
        contact_radius: wp.array(dtype=k.real),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
    ):
        """Force on i of both as spheres [N], d = x_j - x_i, and their energy [J]."""
        force = s.vec()
        held = real(0.0)
        if wp.static(touch_law is not None):
            r = wp.length(d)
            gap = r - real(get(contact_radius, i) + get(contact_radius, j))
            stiffness = geometry.load_normal_stiffness(
                wp.min(i, j), wp.max(i, j), contact_radius, contact_width, contact_compliance
            )
            held = law.energy(stiffness, gap)
            force = law.pull(stiffness, gap, real(0.0)) * wp.normalize(d)
        return force, held

    return Laws(load_sphere=load_sphere)


@cache
def facet_closing(
    s: Laws, k: Laws, faces: Faces, rubs: bool, ages: bool, by_kind: bool, touch_law: str | None
):
    """Pass over listed facet bonds: unlinked ones resist closing (theory B11).

    rubs: closed ones also resist sliding, as `friction.face_friction` has it. ages: as of
    `contact.Touch`; touch_law: as in `turning`.
    """
    turned_law = turning(s, k, touch_law)
    geometry, law, contact, real = face(s, k, faces), facet(s), closing(s), s.real
    rubbing = face_friction(s, k, ages)

    def facet_closing(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        closing_stiffness: wp.array(dtype=real),
        contact_kind: wp.array(dtype=int),
        friction_table: wp.array(dtype=real),
        friction_numbers: wp.array(dtype=wp.float64),
        contact_radius: wp.array(dtype=k.real),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        # state read
        bond_slip: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        # written
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        closing_gap: wp.array(dtype=real),
        closing_debt: wp.array(dtype=real),
        any_crossed: wp.array(dtype=int),
        any_moved: wp.array(dtype=int),
        closing_shear: wp.array(dtype=real),
        closing_slip: wp.array(dtype=k.real),
        closing_spring: wp.array(dtype=real),
        closing_theta: wp.array(dtype=wp.float64),
        closing_slip_energy: wp.array(dtype=wp.float64),
        slack: real,
        friction: real,
        dt: real,
        kinds: int,
    ):
        t = wp.tid()
        b = nn(listed[t])
        if get(bond_linked, b) == real(0.0):
            delta, ci, cj = geometry.load_anchors(
                b, bond_i, bond_j, bond_arm, bond_jump, bond_slip, displacement, orientation
            )
            p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
            gap = law.gap(delta, p, m)
            meets, slope = law.meeting(p, m)
            stiffness = meets * closing_stiffness[t]
            held = contact.energy(closing_stiffness[t], gap)
            pull = contact.pull(stiffness, gap, slack)
            aside = s.vec()
            if meets < real(1.0) and closing_stiffness[t] != real(0.0):
                push, other = turned_law.load_sphere(
                    get(bond_i, b), get(bond_j, b), ci + delta - cj,
                    contact_radius, contact_width, contact_compliance,
                )  # fmt: skip
                aside = (real(1.0) - meets) * push
                held -= other
            f, ti, tj = law.closing_force(pull, held, slope, delta, ci, cj, p, m)
            f += aside
            if wp.static(rubs):
                row = int(0)  # noqa: UP018, RUF046
                mu = friction
                if wp.static(by_kind):
                    row = kinds * contact_kind[get(bond_i, b)] + contact_kind[get(bond_j, b)]
                    mu = friction_table[row]
                is_new = closing_gap[t] >= real(UNKNOWN)
                hold = rubbing.rub(
                    t, delta, wp.normalize(p + m), pull, is_new, nn(get(bond_i, b)), orientation,
                    mu, row, friction_numbers, closing_shear, closing_slip, closing_spring,
                    closing_theta, closing_slip_energy, dt,
                )  # fmt: skip
                f += hold
                ti += s.cross(ci + delta, hold)
                tj -= s.cross(cj, hold)
            s.store_ends(bond_place, end_force, end_torque, b, f, ti, tj)
            if closing_gap[t] == real(PARTED):
                closing_debt[t] = real(0.0)  # the list of neighbours has taken it over
            owed = contact.left_over(stiffness, closing_gap[t], gap)
            if meets == real(0.0) and closing_stiffness[t] != real(0.0):
                gap = real(TURNED)
                any_moved[0] = 1  # where there is a list, the pair belongs to it now
            closing_gap[t] = gap
            if owed != real(0.0):
                closing_debt[t] = closing_debt[t] + owed
                any_crossed[0] = 1

    # plain code: nearly all listed bonds are linked, and a vector would work them out all the same
    return kernel(facet_closing, simd=False)


@cache
def facet_settle(s: Laws, k: Laws, faces: Faces):
    """Pass over listed facet bonds: pay what their closing or opening left over."""
    geometry, contact, real = face(s, k, faces), closing(s), s.real

    def facet_settle(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        # state read
        bond_slip: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        # written
        closing_debt: wp.array(dtype=real),
        closing_impulse: wp.array(dtype=real),
        closing_twist: wp.array(dtype=real),
        share: real,
    ):
        t = wp.tid()
        b = nn(listed[t])
        if not contact.owes(t, b, bond_place, closing_debt, closing_impulse):
            return
        delta, ci, cj = geometry.load_anchors(
            b, bond_i, bond_j, bond_arm, bond_jump, bond_slip, displacement, orientation
        )
        p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
        contact.settle(
            t,
            b,
            nn(get(bond_i, b)),
            nn(get(bond_j, b)),
            wp.normalize(p + m),
            ci + real(0.5) * delta,
            cj - real(0.5) * delta,
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

    # plain code, as `facet_closing`: few owe anything
    return kernel(facet_settle, simd=False)


@cache
def facet_energies(
    s: Laws, k: Laws, faces: Faces, has_bending: bool, is_listed: bool, simd: bool = True
):
    """Per facet bond: the energy it holds linked [J]."""
    geometry, law, real = face(s, k, faces), facet(s), s.real

    def facet_energies(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        # state read
        facet_stiffness: wp.array(dtype=real),
        facet_bending: wp.array(dtype=real),
        bond_slip: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        linked_energy: wp.array(dtype=real),
    ):
        t = wp.tid()
        b = nn(t)
        if wp.static(is_listed):
            b = nn(listed[t])
        delta, _ci, _cj = geometry.load_anchors(
            b, bond_i, bond_j, bond_arm, bond_jump, bond_slip, displacement, orientation
        )
        energy = law.energy(get(facet_stiffness, b), delta)
        if wp.static(has_bending):
            p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
            half, _cosine = geometry.load_turn(b, bond_i, bond_j, orientation)
            energy += law.bending_energy(
                get(facet_bending, 2 * b), get(facet_bending, 2 * b + 1), p, m, half
            )
        linked_energy[t] = energy

    return kernel(facet_energies, simd)


@cache
def facet_closing_energies(
    s: Laws,
    k: Laws,
    faces: Faces,
    rubs: bool,
    touch_law: str | None,
    has_rows: bool,
    simd: bool = True,
):
    """Per listed facet bond: the energy it holds, or would hold, unlinked [J].

    has_rows: of those in `rows` of the list alone.
    """
    turned_law = turning(s, k, touch_law)
    geometry, law, contact, real = face(s, k, faces), facet(s), closing(s), s.real

    def facet_closing_energies(
        # model
        rows: wp.array(dtype=int),
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        closing_stiffness: wp.array(dtype=real),
        closing_shear: wp.array(dtype=real),
        contact_radius: wp.array(dtype=k.real),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        # state read
        bond_slip: wp.array(dtype=k.real),
        closing_spring: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        closing_energy: wp.array(dtype=real),
    ):
        t = nn(wp.tid())
        if wp.static(has_rows):
            t = nn(get(rows, t))
        b = nn(get(listed, t))
        delta, ci, cj = geometry.load_anchors(
            b, bond_i, bond_j, bond_arm, bond_jump, bond_slip, displacement, orientation
        )
        p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
        meets, _slope = law.meeting(p, m)
        energy = meets * contact.energy(get(closing_stiffness, t), law.gap(delta, p, m))
        if meets < real(1.0) and get(closing_stiffness, t) != real(0.0):
            _push, other = turned_law.load_sphere(
                get(bond_i, b), get(bond_j, b), ci + delta - cj,
                contact_radius, contact_width, contact_compliance,
            )  # fmt: skip
            energy += (real(1.0) - meets) * other
        if wp.static(rubs):
            energy += law.energy(get(closing_shear, t), s.load(closing_spring, t))
        put(closing_energy, t, energy)

    return kernel(facet_closing_energies, simd)


@cache
def facet_unlink(s: Laws, has_volume: bool, has_bending: bool, softens: bool, simd: bool = True):
    """Pass over listed facet bonds: an unlinked bond has no stiffness, a softened one less."""
    real = s.real

    def facet_unlink(
        listed: wp.array(dtype=int),
        # state read
        bond_linked: wp.array(dtype=real),
        # written
        bond_keep: wp.array(dtype=real),
        facet_stiffness: wp.array(dtype=real),
        facet_bending: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
    ):
        b = nn(listed[wp.tid()])
        keep = get(bond_linked, b)
        if wp.static(softens):
            keep = get(bond_keep, b)
            put(bond_keep, b, real(1.0))
        put(facet_stiffness, b, keep * get(facet_stiffness, b))
        if wp.static(has_bending):
            for n in range(2):
                facet_bending[2 * b + n] = keep * facet_bending[2 * b + n]
        if wp.static(has_volume):
            put(bond_weight, b, keep * get(bond_weight, b))

    return kernel(facet_unlink, simd)

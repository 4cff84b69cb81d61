"""Viscoelasticity of the deviator: branches that creep, and dashpots beside springs (theory B12).

A branch is a spring and a dashpot in series. What its dashpot has flowed, p_k, is a slip of the
bond, and the one spring of all branches slips by P = sum g_k p_k. All that is elastic depends on
the opening less that slip, delta - P, so forces remain the derivative of an energy. Branches follow
the deviatoric opening, which is the derivative of the deviator's own energy over k:

    e = delta - (w/k) (1 - D) (m_i c_i - m_j c_j)

Half of a step's change of e comes first, then branches relax exactly, then comes the other half:

    p_k <- p_k + (1 - exp(-dt/T_k)) ((e_n + e_n+1)/2 - p_k)

With the forces of velocity Verlet such a step can only take energy, whatever dt/T_k is.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow, space
from .face import Faces, face
from .memory import get, kernel, nn, put
from .motion import Ends, gather, inertia


@cache
def carrier(s: Laws, k: Laws, faces: Faces) -> Laws:
    """The frame in which a bond keeps its branches, and the slip that they are on its anchors."""
    d = space(s.dim, wp.float64)
    geometry = face(s, k, faces)
    placed, exact, narrowed, placed_exact = narrow(k, s), narrow(d, k), narrow(s, k), narrow(k, d)

    @wp.func
    def load_share(b: int, bond_arm: wp.array(dtype=k.real)) -> k.real:
        """Share of i in what both elements of a bond carry; a node, which does not turn, has
        none."""
        share = k.real(0.5)
        if wp.static(not faces.central):
            ci = geometry.load_arm(bond_arm, nn(2 * b))
            cj = geometry.load_arm(bond_arm, nn(2 * b + 1))
            share = wp.where(wp.dot(ci, ci) == k.real(0.0), k.real(0.0), share)
            share = wp.where(wp.dot(cj, cj) == k.real(0.0), k.real(1.0), share)
        return share

    @wp.func
    def load_frame(
        b: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ):
        """Mean rotation of both elements, and the share of i in it."""
        share = load_share(b, bond_arm)
        qi = k.load_rot(orientation, nn(get(bond_i, b)))
        qj = k.load_rot(orientation, nn(get(bond_j, b)))
        return wp.normalize(share * qi + (k.real(1.0) - share) * qj), share

    @wp.func
    def carried(q: k.rot, v: s.vec) -> d.vec:
        """A vector of the world in the frame."""
        x = placed(v)
        return exact(x + k.turn_back(q, x))

    @wp.func
    def in_world(q: k.rot, v: d.vec) -> k.vec:
        """A vector of the frame in the world."""
        x = placed_exact(v)
        return x + k.turn(q, x)

    @wp.func
    def store_slip(
        b: int,
        share: k.real,
        p: k.vec,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        orientation: wp.array(dtype=k.real),
        bond_slip: wp.array(dtype=k.real),
    ):
        """Anchors of a slip p: each element carries its share of it."""
        own = share * p
        other = (share - k.real(1.0)) * p
        qi = k.load_rot(orientation, nn(get(bond_i, b)))
        qj = k.load_rot(orientation, nn(get(bond_j, b)))
        k.store(bond_slip, nn(2 * b), own + k.turn_back(qi, own))
        k.store(bond_slip, nn(2 * b + 1), other + k.turn_back(qj, other))

    return Laws(
        load_share=load_share,
        load_frame=load_frame,
        carried=carried,
        in_world=in_world,
        store_slip=store_slip,
        narrowed=narrowed,
    )


@cache
def mean_creep(s: Laws, slots: int, plane: str | None, branches: int, simd: bool = True):
    """Pass over elements: (1 - D) m in the middle of a step, what the deviator leaves out of g.

    In the plane the strain across it creeps as well: its deviator is (sigma_zz - m)/2G + z, with
    sigma_zz = D m - 2G z, or 0 in plane stress. There z changes m, and is solved for.
    """
    real, d = s.real, wp.float64

    def mean_creep(
        # model
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        element_spherical: wp.array(dtype=real),
        element_law: wp.array(dtype=int),
        branch_share: wp.array(dtype=d),
        # state read
        branch_lost: wp.array(dtype=d),
        end_dilation: wp.array(dtype=real),
        mean_stiffness: wp.array(dtype=real),
        mean_stress: wp.array(dtype=real),
        # written
        branch_zz: wp.array(dtype=d),
        plastic_strain_zz: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        viscous_mean: wp.array(dtype=real),
        element_dissipation: wp.array(dtype=d),
        elements: int,
    ):
        i = nn(wp.tid())
        e = real(0.0)
        for slot in range(wp.static(slots)):
            e += get(end_dilation, slot * elements + i)
        e = e / get(element_volume, i)
        if wp.static(plane == "strain"):
            e = e - get(plastic_dilation, i)
        mean = real(0.5) * (get(mean_stress, i) + get(mean_stiffness, i) * e)
        kept = get(element_spherical, i)
        if wp.static(plane is not None):
            law = nn(wp.static(branches) * get(element_law, i))
            # of nodes, which have no stiffness, nothing creeps
            two_shear = d(
                wp.where(get(element_two_shear, i) > real(0.0), get(element_two_shear, i), real(1))
            )
            z = d(0.0)
            pull = d(0.0)
            back = d(0.0)
            held = d(0.0)
            for n in range(wp.static(branches)):
                own = branch_zz[nn(n * elements + i)]
                share = branch_share[nn(law + n)]
                z += share * own
                pull += share * branch_lost[nn(law + n)]
                back += share * branch_lost[nn(law + n)] * own
                held -= share * own * own
            across = -d(kept * mean) / two_shear
            if wp.static(plane == "stress"):
                held += z * z
                softer = d(0.5) * (d(1.0) - d(get(mean_stiffness, i)) / two_shear)
                across = (z - d(mean) / two_shear - softer * back) / (d(1.0) - softer * pull)
                mean += real(0.5) * get(mean_stiffness, i) * real(pull * across - back)
            z = d(0.0)
            for n in range(wp.static(branches)):
                own = branch_zz[nn(n * elements + i)]
                own += branch_lost[nn(law + n)] * (across - own)
                branch_zz[nn(n * elements + i)] = own
                z += branch_share[nn(law + n)] * own
                held += branch_share[nn(law + n)] * own * own
            if wp.static(plane == "stress"):
                held -= z * z
            else:
                put(plastic_strain_zz, i, real(z))
                put(plastic_dilation, i, real(z))
            g = d(0.5) * two_shear
            element_dissipation[i] = element_dissipation[i] - d(get(element_volume, i)) * g * held
        put(viscous_mean, i, kept * mean)

    return kernel(mean_creep, simd)


@cache
def facet_creep(s: Laws, k: Laws, faces: Faces, branches: int, simd: bool = True):
    """Pass over facet bonds: their branches relax, their anchors follow, and so does V E.

    Branches are kept in float64: what they gain in a step may be below the rounding of float32.
    What a step adds to the energy that branches hold, over that of the one spring, is no loss.
    """
    d = space(s.dim, wp.float64)
    geometry, own, real = face(s, k, faces), carrier(s, k, faces), s.real

    def facet_creep(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        bond_law: wp.array(dtype=int),
        branch_share: wp.array(dtype=d.real),
        # state read
        branch_lost: wp.array(dtype=d.real),
        facet_stiffness: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        viscous_mean: wp.array(dtype=real),
        # written
        branch_slip: wp.array(dtype=d.real),
        last_opening: wp.array(dtype=d.real),
        bond_slip: wp.array(dtype=k.real),
        slip_step: wp.array(dtype=real),
        end_dilation: wp.array(dtype=real),
        bond_dissipation: wp.array(dtype=wp.float64),
        facets: int,
    ):
        b = nn(wp.tid())
        stiffness = get(facet_stiffness, b)
        slipped = s.vec()
        if stiffness > real(0.0):
            delta, ci, cj = geometry.load_opening(
                b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
            )
            q, share = own.load_frame(b, bond_i, bond_j, bond_arm, orientation)
            w = get(bond_weight, b)
            mean_i = get(viscous_mean, get(bond_i, b))
            mean_j = get(viscous_mean, get(bond_j, b))
            spherical = (w / stiffness) * (mean_i * ci - mean_j * cj)
            opening = own.carried(q, delta)
            deviator = d.real(0.5) * (opening + d.load(last_opening, b))
            deviator -= own.carried(q, spherical)
            d.store(last_opening, b, opening)
            law = nn(wp.static(branches) * get(bond_law, b))
            total = d.vec()
            step = d.vec()
            held = d.real(0.0)
            for n in range(wp.static(branches)):
                at = nn(n * facets + b)
                part = branch_share[nn(law + n)]
                p = d.load(branch_slip, at)
                dp = branch_lost[nn(law + n)] * (deviator - p)
                p += dp
                d.store(branch_slip, at, p)
                total += part * p
                step += part * dp
                held += part * wp.dot(dp, d.real(2.0) * p - dp)
            held -= wp.dot(step, d.real(2.0) * total - step)
            put(
                bond_dissipation,
                b,
                get(bond_dissipation, b) - d.real(0.5) * d.real(stiffness) * held,
            )
            slip = own.in_world(q, total)
            own.store_slip(b, share, slip, bond_i, bond_j, orientation, bond_slip)
            slipped = own.narrowed(own.in_world(q, step))
            spring = delta - own.narrowed(slip)
            put(end_dilation, get(bond_place, 2 * b), w * wp.dot(ci, spring))
            put(end_dilation, get(bond_place, 2 * b + 1), -w * wp.dot(cj, spring))
        s.store(slip_step, b, slipped)

    return kernel(facet_creep, simd)


@cache
def remember_openings(s: Laws, k: Laws, faces: Faces, simd: bool = True):
    """Pass over facet bonds: openings that the next step's change starts from."""
    d = space(s.dim, wp.float64)
    geometry, own = face(s, k, faces), carrier(s, k, faces)

    def remember_openings(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        last_opening: wp.array(dtype=d.real),
    ):
        b = nn(wp.tid())
        delta, _ci, _cj = geometry.load_opening(
            b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
        )
        q, _share = own.load_frame(b, bond_i, bond_j, bond_arm, orientation)
        d.store(last_opening, b, own.carried(q, delta))

    return kernel(remember_openings, simd)


@cache
def creep_books(s: Laws, simd: bool = True):
    """Pass over facet bonds: energy that a step's slips took, dp.(F_n + F_n-1)/2 [J].

    F is the whole force of the bond after slips, as the volume term depends on them too; velocity
    Verlet loses exactly that much. share: 1, or 0 where the forces alone have changed.
    """
    real = s.real

    def creep_books(
        # model
        bond_place: wp.array(dtype=int),
        # state read
        end_force: wp.array(dtype=real),
        slip_step: wp.array(dtype=real),
        # written
        last_force: wp.array(dtype=real),
        bond_dissipation: wp.array(dtype=wp.float64),
        share: real,
    ):
        b = nn(wp.tid())
        f = s.load(end_force, nn(get(bond_place, 2 * b)))
        taken = real(0.5) * share * wp.dot(s.load(slip_step, b), f + s.load(last_force, b))
        put(bond_dissipation, b, get(bond_dissipation, b) + wp.float64(taken))
        s.store(last_force, b, f)

    return kernel(creep_books, simd)


@cache
def branch_energies(s: Laws, branches: int, is_listed: bool, simd: bool = True):
    """Per facet bond: added to its energy, what its branches hold over that of the one spring.

    sum g_k k/2 |delta - p_k|^2 in all, of which k/2 |delta - P|^2 is the spring's.
    """
    real, d = s.real, space(s.dim, wp.float64)

    def branch_energies(
        # model
        listed: wp.array(dtype=int),
        bond_law: wp.array(dtype=int),
        branch_share: wp.array(dtype=d.real),
        # state read
        facet_stiffness: wp.array(dtype=real),
        branch_slip: wp.array(dtype=d.real),
        # written
        linked_energy: wp.array(dtype=real),
        facets: int,
    ):
        t = nn(wp.tid())
        b = t
        if wp.static(is_listed):
            b = nn(get(listed, t))
        law = nn(wp.static(branches) * get(bond_law, b))
        total = d.vec()
        held = d.real(0.0)
        for n in range(wp.static(branches)):
            p = d.load(branch_slip, nn(n * facets + b))
            total += branch_share[nn(law + n)] * p
            held += branch_share[nn(law + n)] * wp.dot(p, p)
        held -= wp.dot(total, total)
        put(
            linked_energy,
            t,
            get(linked_energy, t) + real(0.5) * get(facet_stiffness, b) * real(held),
        )

    return kernel(branch_energies, simd)


@cache
def branch_zz_energies(s: Laws, plane: str | None, branches: int, simd: bool = True):
    """Per element of the plane: added to its energy, what branches hold across the plane."""
    real, d = s.real, wp.float64

    def branch_zz_energies(
        # model
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        element_law: wp.array(dtype=int),
        branch_share: wp.array(dtype=d),
        # state read
        branch_zz: wp.array(dtype=d),
        # written
        volume_energy: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        law = nn(wp.static(branches) * get(element_law, i))
        z = d(0.0)
        held = d(0.0)
        for n in range(wp.static(branches)):
            own = branch_zz[nn(n * elements + i)]
            z += branch_share[nn(law + n)] * own
            held += branch_share[nn(law + n)] * own * own
        if wp.static(plane == "stress"):
            held -= z * z  # the rest is in the elastic energy of plane stress
        half = real(0.5) * get(element_volume, i) * get(element_two_shear, i)
        put(volume_energy, i, get(volume_energy, i) + half * real(held))

    return kernel(branch_zz_energies, simd)


# -- Kelvin and Voigt's dashpots ------------------------------------------------------------------


@cache
def opening_rates(s: Laws, k: Laws, faces: Faces, has_box: bool, simd: bool = True):
    """Pass over facet bonds: how fast they open, and each face's share of V dE/dt.

    It is the relative speed of the two bodies at one point, midway between the facet points or at
    a node, so that a rigid motion has none.
    """
    geometry, own, real = face(s, k, faces), carrier(s, k, faces), s.real

    def opening_rates(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        # state read
        bond_weight: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        jump_rate: wp.array(dtype=real),
        # written
        opening_rate: wp.array(dtype=real),
        end_rate: wp.array(dtype=real),
    ):
        b = nn(wp.tid())
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        delta, ci, cj = geometry.load_opening(
            b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
        )
        ahead = real(own.load_share(b, bond_arm)) * delta
        back = ahead - delta
        rate = s.load(velocity, j) + s.rotate(s.load_spin(angular_velocity, j), cj + back)
        rate -= s.load(velocity, i) + s.rotate(s.load_spin(angular_velocity, i), ci + ahead)
        if wp.static(has_box):
            rate += s.load(jump_rate, b)
        w = get(bond_weight, b)
        s.store(opening_rate, b, rate)
        put(end_rate, get(bond_place, 2 * b), w * wp.dot(ci, rate))
        put(end_rate, get(bond_place, 2 * b + 1), -w * wp.dot(cj, rate))

    return kernel(opening_rates, simd)


@cache
def mean_rates(s: Laws, slots: int, simd: bool = True):
    """Pass over elements: what the deviator leaves out of the rate of opening, (2G T/s*) dE/dt."""
    real = s.real

    def mean_rates(
        # model
        element_volume: wp.array(dtype=real),
        # state read
        rate_viscosity: wp.array(dtype=real),
        end_rate: wp.array(dtype=real),
        # written
        mean_rate: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        e = real(0.0)
        for slot in range(wp.static(slots)):
            e += get(end_rate, slot * elements + i)
        put(mean_rate, i, get(rate_viscosity, i) * e / get(element_volume, i))

    return kernel(mean_rates, simd)


@cache
def facet_dashpots(
    s: Laws, k: Laws, faces: Faces, has_box: bool, is_second: bool, simd: bool = True
):
    """Pass over facet bonds: forces of their dashpots, the derivative of a dissipation potential.

    F = T k d' - w (h_i c_i - h_j c_j), T the time of retardation, h of `mean_rates`. The second
    time, at velocities that the first forces alone would give, their mean is taken (Heun).
    """
    geometry, own, real = face(s, k, faces), carrier(s, k, faces), s.real

    def facet_dashpots(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        bond_law: wp.array(dtype=int),
        retardation: wp.array(dtype=real),
        # state read
        facet_stiffness: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        opening_rate: wp.array(dtype=real),
        mean_rate: wp.array(dtype=real),
        jump_rate: wp.array(dtype=real),
        # written
        damping_force: wp.array(dtype=real),
        damping_torque: wp.array(dtype=real),
        dashpot_work: wp.array(dtype=wp.float64),
        dt: real,
    ):
        b = nn(wp.tid())
        delta, ci, cj = geometry.load_opening(
            b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
        )
        ahead = real(own.load_share(b, bond_arm)) * delta
        eta = get(retardation, get(bond_law, b)) * get(facet_stiffness, b)
        spherical = get(mean_rate, get(bond_i, b)) * ci - get(mean_rate, get(bond_j, b)) * cj
        f = eta * s.load(opening_rate, b) - get(bond_weight, b) * spherical
        if wp.static(is_second):
            f = real(0.5) * (f + s.load(damping_force, nn(get(bond_place, 2 * b))))
        ti = s.cross(ci + ahead, f)
        tj = -s.cross(cj + (ahead - delta), f)
        s.store_ends(bond_place, damping_force, damping_torque, b, f, ti, tj)
        if wp.static(has_box and is_second):
            done = dt * wp.dot(f, s.load(jump_rate, b))
            put(dashpot_work, b, get(dashpot_work, b) + wp.float64(done))

    return kernel(facet_dashpots, simd)


@cache
def trial_kick(s: Laws, k: Laws, ends: Ends, has_moments: bool, simd: bool = True):
    """Pass over elements: velocity and spin after a step of the dashpots' forces alone.

    Euler's rule would make dashpots too strong by half a step's share of their rate, as springs
    kick half a step apart; Heun's does not, and is stable to the same step.
    """
    real, load_force, rotor = s.real, gather(s, ends), inertia(s, k, has_moments)

    def trial_kick(
        # model
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        principal_moment: wp.array(dtype=real),
        principal_axes: wp.array(dtype=k.real),
        lattice_before: wp.array(dtype=int),
        # state read
        orientation: wp.array(dtype=k.real),
        damping_force: wp.array(dtype=real),
        damping_torque: wp.array(dtype=real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        # written
        trial_velocity: wp.array(dtype=real),
        trial_spin: wp.array(dtype=real),
        dt: real,
        elements: int,
    ):
        i = nn(wp.tid())
        f, t = load_force(i, lattice_before, damping_force, damping_torque, elements)
        change = dt * wp.cw_mul(s.load(inverse_mass, i), f)
        spin = rotor.spun(
            i,
            s.load_spin(angular_velocity, i),
            dt * t,
            inverse_inertia,
            principal_moment,
            principal_axes,
            orientation,
        )
        s.store(trial_velocity, i, s.load(velocity, i) + change)
        s.store_spin(trial_spin, i, spin)

    return kernel(trial_kick, simd)


@cache
def retarded_volume(s: Laws, slots: int, is_at_rest: bool, simd: bool = True):
    """Pass over Kelvin and Voigt's elements: the branch of E that missing faces bring.

    Their mean stress follows from forces on the faces that are there (theory B4), which dashpots
    have a part in: with G (1 + T d/dt) for G the stiffness of E is A, plus a branch. Its elastic
    part is g = (A + A') (E - P), P = A'/(A + A') of what its dashpot has flowed. is_at_rest: it has
    flowed all of E.
    """
    real = s.real

    def retarded_volume(
        # model
        retarded_elements: wp.array(dtype=int),
        element_volume: wp.array(dtype=real),
        # state read
        retarded_stiffness: wp.array(dtype=real),
        retarded_lost: wp.array(dtype=wp.float64),
        volume_stiffness: wp.array(dtype=real),
        end_dilation: wp.array(dtype=real),
        # written
        retarded_dilation: wp.array(dtype=wp.float64),
        last_element_dilation: wp.array(dtype=wp.float64),
        plastic_dilation: wp.array(dtype=real),
        element_dissipation: wp.array(dtype=wp.float64),
        elements: int,
    ):
        i = retarded_elements[wp.tid()]
        total = real(0.0)
        for slot in range(wp.static(slots)):
            total += get(end_dilation, slot * elements + i)
        e = wp.float64(total / get(element_volume, i))
        before = get(retarded_dilation, i)
        after = e
        if wp.static(not is_at_rest):
            mean = wp.float64(0.5) * (e + get(last_element_dilation, i))
            after = before + get(retarded_lost, i) * (mean - before)
        put(last_element_dilation, i, e)
        put(retarded_dilation, i, after)
        a = get(volume_stiffness, i)
        branch = get(retarded_stiffness, i)
        share = wp.where(a == real(0.0), real(0.0), branch / a)
        put(plastic_dilation, i, share * real(after))
        if wp.static(not is_at_rest):
            held = wp.float64(real(0.5) * get(element_volume, i) * (real(1.0) - share) * branch)
            change = held * (after - before) * (after + before)
            put(element_dissipation, i, get(element_dissipation, i) - change)

    return kernel(retarded_volume, simd)


@cache
def retarded_energies(s: Laws, simd: bool = True):
    """Per element of Kelvin and Voigt: added to its energy, what its branch of E holds beside."""
    real = s.real

    def retarded_energies(
        # model
        retarded_elements: wp.array(dtype=int),
        element_volume: wp.array(dtype=real),
        # state read
        retarded_stiffness: wp.array(dtype=real),
        volume_stiffness: wp.array(dtype=real),
        retarded_dilation: wp.array(dtype=wp.float64),
        # written
        volume_energy: wp.array(dtype=real),
    ):
        i = retarded_elements[wp.tid()]
        a = get(volume_stiffness, i)
        branch = get(retarded_stiffness, i)
        z = real(get(retarded_dilation, i))
        held = branch * (real(1.0) - wp.where(a == real(0.0), real(0.0), branch / a))
        put(
            volume_energy,
            i,
            get(volume_energy, i) + real(0.5) * get(element_volume, i) * held * z * z,
        )

    return kernel(retarded_energies, simd)


@cache
def retarded_release(s: Laws, slots: int, is_after: bool, simd: bool = True):
    """Round `volume_release`, per listed element: its branch of E is left out of what is released.

    The branch keeps its strain, so that it follows where E jumps.
    """
    real = s.real

    def retarded_release(
        # model
        listed: wp.array(dtype=int),
        incidence: wp.array(dtype=int),
        element_volume: wp.array(dtype=real),
        # state read
        bond_linked: wp.array(dtype=real),
        end_dilation: wp.array(dtype=real),
        retarded_stiffness: wp.array(dtype=real),
        # written
        volume_stiffness: wp.array(dtype=real),
        retarded_dilation: wp.array(dtype=wp.float64),
        last_element_dilation: wp.array(dtype=wp.float64),
        plastic_dilation: wp.array(dtype=real),
        last_dilation: wp.array(dtype=real),
        elements: int,
    ):
        i = listed[wp.tid()]
        branch = get(retarded_stiffness, i)
        if branch > real(0.0):
            if wp.static(is_after):
                jump = real(0.0)
                for slot in range(wp.static(slots)):
                    at = nn(slot * elements + i)
                    b = nn(get(incidence, at) >> 1)
                    jump -= (real(1.0) - get(bond_linked, b)) * get(end_dilation, at)
                jump = jump / get(element_volume, i)
                z = get(retarded_dilation, i) + wp.float64(jump)
                a = get(volume_stiffness, i) + branch
                put(volume_stiffness, i, a)
                put(retarded_dilation, i, z)
                put(last_element_dilation, i, get(last_element_dilation, i) + wp.float64(jump))
                put(plastic_dilation, i, real(z) * branch / a)
                put(last_dilation, i, get(plastic_dilation, i))
            else:
                put(volume_stiffness, i, get(volume_stiffness, i) - branch)
                put(plastic_dilation, i, real(0.0))

    return kernel(retarded_release, simd)


@cache
def box_rates(s: Laws, k: Laws, simd: bool = True):
    """Pass over bonds through the sides of a periodic box: how fast the images beyond move.

    At the start of a step: the mean of the last motion and of the next.
    """
    real, narrowed = s.real, narrow(s, k)
    square = wp.types.matrix((s.dim, s.dim), k.real)

    def box_rates(
        # model
        box_bonds: wp.array(dtype=int),
        box_shift: wp.array(dtype=k.real),
        # state read
        box_strain: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        box_motion: wp.array(dtype=real),
        # written
        jump_rate: wp.array(dtype=real),
        dt: real,
    ):
        t = wp.tid()
        b = nn(box_bonds[t])
        e = square()
        for row in range(wp.static(s.dim)):
            for column in range(wp.static(s.dim)):
                e[row, column] = get(box_strain, wp.static(s.dim) * row + column)
        ahead = narrowed(e * k.load(box_shift, t) - k.load(bond_jump, b))
        s.store(jump_rate, b, (real(0.5) / dt) * (ahead + s.load(box_motion, t)))

    return kernel(box_rates, simd)

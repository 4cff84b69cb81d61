"""Damping: dashpots beside EVM bonds (theory A8), Cundall's local damping, absorbing sides.

It acts at once at the start of a step, on velocities of the time of the places. There it can only
take energy away: velocity Verlet keeps a form in which kinetic energy stands alone, so a step is
stable wherever the undamped one is and dt is below 2 over the greatest damping rate. What it takes
is booked exactly.
"""

from functools import cache

import warp as wp

from .algebra import Laws
from .evm import evm_kinematics
from .memory import get, kernel, nn, put
from .motion import Ends, Loads, gather, inertia, net


@cache
def dashpot(s: Laws) -> Laws:
    """Law of a bond's dashpots."""
    vec4 = wp.types.vector(4, s.real)

    @wp.func
    def force(eta: vec4, n: s.vec, slip: s.vec):
        """Force on i [N], eta_n along and eta_t across the bond, of the slip speed at one point."""
        along = wp.dot(n, slip)
        return eta[1] * slip + (eta[0] - eta[1]) * along * n

    if s.dim == 2:

        @wp.func
        def torque_plane(eta: vec4, n: s.vec, w: s.spin) -> s.spin:
            """Torque on i [N m] of the relative spin: of bending alone."""
            return eta[2] * w

        return Laws(force=force, torque=torque_plane)

    @wp.func
    def torque(eta: vec4, n: s.vec, w: s.spin) -> s.spin:
        """Torque on i [N m] of the relative spin, eta_b across and eta_t along the bond."""
        return eta[2] * w + (eta[3] - eta[2]) * wp.dot(n, w) * n

    return Laws(force=force, torque=torque)


@cache
def evm_dashpots(s: Laws, k: Laws, simd: bool = True):
    """Pass over EVM bonds: force and torques of their dashpots.

    Both act at one point, the middle of the bond, so that a rigid motion is not damped and angular
    momentum is kept.
    """
    kinematics, law, real = evm_kinematics(s, k), dashpot(s), s.real
    vec4 = wp.types.vector(4, s.real)

    def evm_dashpots(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        # state read
        evm_dashpot: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        # written
        damping_force: wp.array(dtype=real),
        damping_torque: wp.array(dtype=real),
        first_evm: int,
    ):
        c = nn(wp.tid())
        b = nn(c + first_evm)
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
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        n = x.d
        half = real(0.5) * x.length * n
        arm_i = real(get(evm_offset, 2 * c)) * x.p + half
        arm_j = -real(get(evm_offset, 2 * c + 1)) * x.m - half
        wi = s.load_spin(angular_velocity, i)
        wj = s.load_spin(angular_velocity, j)
        slip = s.load(velocity, j) + s.rotate(wj, arm_j)
        slip -= s.load(velocity, i) + s.rotate(wi, arm_i)
        eta = vec4(
            get(evm_dashpot, 4 * c),
            get(evm_dashpot, 4 * c + 1),
            get(evm_dashpot, 4 * c + 2),
            get(evm_dashpot, 4 * c + 3),
        )
        f = law.force(eta, n, slip)
        t = law.torque(eta, n, wj - wi)
        ti = s.cross(arm_i, f) + t
        tj = -s.cross(arm_j, f) - t
        s.store_ends(bond_place, damping_force, damping_torque, b, f, ti, tj)

    return kernel(evm_dashpots, simd)


@cache
def damp(
    s: Laws,
    k: Laws,
    ends: Ends,
    external: Loads,
    has_moments: bool,
    has_work: bool,
    has_dashpots: bool,
    is_local: bool,
    absorbs: bool,
    simd: bool = True,
):
    """Pass over elements: kick by damping alone, and the energy it takes [J].

    Absorbing sides press back as the solid beyond would, by rho c times the speed (Lysmer and
    Kuhlemeyer 1969). Local damping opposes each component of velocity and spin by a share of the
    net force or torque there (Cundall 1987); it never turns a motion round.
    """
    real, rotor = s.real, inertia(s, k, has_moments)
    load_force, load_net = gather(s, ends), net(s, ends, external)
    square = wp.types.matrix((s.dim, s.dim), real)

    @wp.func
    def opposed(share: real, force: real, yielding: real, speed: real, dt: real) -> real:
        """Impulse against the speed, at most what stops it."""
        size = wp.min(share * wp.abs(force) * dt * yielding, wp.abs(speed))
        safe = wp.where(yielding == real(0.0), real(1.0), yielding)
        return wp.where(yielding == real(0.0), real(0.0), -wp.sign(speed) * size / safe)

    def damp(
        # model
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        principal_moment: wp.array(dtype=real),
        principal_axes: wp.array(dtype=k.real),
        external_force: wp.array(dtype=real),
        external_torque: wp.array(dtype=real),
        timed_force: wp.array(dtype=real),
        timed_torque: wp.array(dtype=real),
        load_factor: wp.array(dtype=real),
        lattice_before: wp.array(dtype=int),
        # state read
        orientation: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        damping_force: wp.array(dtype=real),
        damping_torque: wp.array(dtype=real),
        absorbing_damping: wp.array(dtype=real),
        # written
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        damped_energy: wp.array(dtype=wp.float64),
        element_work: wp.array(dtype=wp.float64),
        local_damping: real,
        dt: real,
        elements: int,
    ):
        i = nn(wp.tid())
        v = s.load(velocity, i)
        w = s.load_spin(angular_velocity, i)
        inv_m = s.load(inverse_mass, i)
        inv_j = get(inverse_inertia, i)
        impulse = s.vec()
        twist = s.no_spin()
        if wp.static(has_dashpots):
            f, t = load_force(i, lattice_before, damping_force, damping_torque, elements)
            impulse = dt * f
            twist = dt * t
        if wp.static(absorbs):
            # implicit midpoint: in all, the central difference scheme of a damped mass
            rate = square()
            for row in range(wp.static(s.dim)):
                for column in range(wp.static(s.dim)):
                    at = nn(wp.static(s.dim) * (wp.static(s.dim) * i + row) + column)
                    rate[row, column] = dt * inv_m[row] * get(absorbing_damping, at)
            unit = wp.identity(n=wp.static(s.dim), dtype=real)
            change = wp.inverse(unit + real(0.5) * rate) * (rate * v)
            for axis in range(wp.static(s.dim)):
                if inv_m[axis] != real(0.0):
                    impulse[axis] = impulse[axis] - change[axis] / inv_m[axis]
        after = v + wp.cw_mul(inv_m, impulse)
        spin = rotor.spun(
            i, w, twist, inverse_inertia, principal_moment, principal_axes, orientation
        )
        if wp.static(is_local):
            # against what the dashpots leave: together they could turn a motion round
            f, t = load_net(
                i,
                external_force,
                external_torque,
                timed_force,
                timed_torque,
                load_factor,
                lattice_before,
                end_force,
                end_torque,
                elements,
            )
            local = s.vec()
            for axis in range(wp.static(s.dim)):
                local[axis] = opposed(local_damping, f[axis], inv_m[axis], after[axis], dt)
            brake = s.no_spin()
            if wp.static(s.dim == 2):
                brake = opposed(local_damping, t, inv_j, spin, dt)
            else:
                yielding = inv_j
                if wp.static(has_moments):
                    least = wp.min(s.load(principal_moment, i))
                    yielding = wp.where(inv_j == real(0.0), real(0.0), real(1.0) / least)
                for axis in range(3):
                    brake[axis] = opposed(local_damping, t[axis], yielding, spin[axis], dt)
            impulse = impulse + local
            twist = twist + brake
            after = after + wp.cw_mul(inv_m, local)
            spin = rotor.spun(
                i, spin, brake, inverse_inertia, principal_moment, principal_axes, orientation
            )
        taken = -real(0.5) * (wp.dot(impulse, v + after) + s.spin_dot(twist, w + spin))
        put(damped_energy, i, get(damped_energy, i) + wp.float64(taken))
        if wp.static(has_work):
            # a grip takes the dashpots' reaction
            grip = real(0.0)
            for axis in range(wp.static(s.dim)):
                grip += wp.where(inv_m[axis] == real(0.0), impulse[axis] * v[axis], real(0.0))
            grip += wp.where(inv_j == real(0.0), s.spin_dot(twist, w), real(0.0))
            put(element_work, i, get(element_work, i) - wp.float64(grip))
        s.store(velocity, i, after)
        s.store_spin(angular_velocity, i, spin)

    return kernel(damp, simd)

"""Motion of the elements (Shilko eq. 1): gather, kick, drift, rotate (theory A10, velocity Verlet).

An inverse mass or inertia of zero holds an element, or moves it with its own constant velocity.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from .algebra import Laws, narrow, narrow_spin
from .memory import get, kernel, nn, put

# whether forces, whether torques act from outside, and how many loads change with time
Loads = tuple[bool, bool, int]
NO_LOADS: Loads = (False, False, 0)


class Ends(NamedTuple):
    """Where elements find what their bonds do to them: in so many slots of their own, or, on a
    lattice of so many kinds of bonds, as `kernels.lattice` leaves it."""

    slots: int
    kinds: int = 0


@cache
def outer_load(s: Laws, external: Loads):
    """Force and torque on an element from outside: constant loads and those that change."""
    real = s.real

    @wp.func
    def load_outer(
        i: int,
        external_force: wp.array(dtype=real),
        external_torque: wp.array(dtype=real),
        timed_force: wp.array(dtype=real),
        timed_torque: wp.array(dtype=real),
        load_factor: wp.array(dtype=real),
        elements: int,
    ):
        f = s.vec()
        t = s.no_spin()
        if wp.static(external[0]):
            f += s.load(external_force, i)
        if wp.static(external[1]):
            t += s.load_spin(external_torque, i)
        for n in range(wp.static(external[2])):
            f += load_factor[n] * s.load(timed_force, nn(n * elements + i))
            t += load_factor[n] * s.load_spin(timed_torque, nn(n * elements + i))
        return f, t

    return load_outer


@cache
def gather(s: Laws, ends: Ends):
    """Force and torque of an element's bonds: the sum over its slots in a fixed order, never an
    atomic."""
    real = s.real

    if ends.kinds:

        @wp.func
        def load_ends(
            i: int,
            lattice_before: wp.array(dtype=int),
            end_force: wp.array(dtype=real),
            end_torque: wp.array(dtype=real),
            elements: int,
        ):
            f = s.vec()
            t = s.load_spin(end_torque, nn(wp.static(ends.kinds) * elements + i))
            for kind in range(wp.static(ends.kinds)):
                f += s.load(end_force, nn(kind * elements + i))
            for kind in range(wp.static(ends.kinds)):
                before = nn(get(lattice_before, kind * elements + i))
                f -= s.load(end_force, before)
                t += s.load_spin(end_torque, before)
            return f, t

        return load_ends

    @wp.func
    def load_force(
        i: int,
        lattice_before: wp.array(dtype=int),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        elements: int,
    ):
        f = s.vec()
        t = s.no_spin()
        for slot in range(wp.static(ends.slots)):
            f += s.load(end_force, nn(slot * elements + i))
            t += s.load_spin(end_torque, nn(slot * elements + i))
        return f, t

    return load_force


@cache
def net(s: Laws, ends: Ends, external: Loads):
    """Force and torque on an element in all: of its bonds and from outside."""
    real, load_bonds, load_outer = s.real, gather(s, ends), outer_load(s, external)

    @wp.func
    def load_net(
        i: int,
        external_force: wp.array(dtype=real),
        external_torque: wp.array(dtype=real),
        timed_force: wp.array(dtype=real),
        timed_torque: wp.array(dtype=real),
        load_factor: wp.array(dtype=real),
        lattice_before: wp.array(dtype=int),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        elements: int,
    ):
        f, t = load_bonds(i, lattice_before, end_force, end_torque, elements)
        outer_f, outer_t = load_outer(
            i,
            external_force,
            external_torque,
            timed_force,
            timed_torque,
            load_factor,
            elements,
        )
        return f + outer_f, t + outer_t

    return load_net


@cache
def inertia(s: Laws, k: Laws, has_moments: bool) -> Laws:
    """How torques change spins, and how free bodies turn.

    Elements are spheres, or, with `has_moments`, have three principal moments about their own axes,
    and turn freely by five exact rotations about these (theory A10): symplectic, reversible in
    time, and of constant angular momentum.
    """
    real, place = s.real, k.real
    widened_spin = narrow_spin(k, s)

    if not has_moments:

        @wp.func
        def spun(
            i: int,
            w: s.spin,
            twist: s.spin,
            inverse_inertia: wp.array(dtype=real),
            principal_moment: wp.array(dtype=real),
            principal_axes: wp.array(dtype=place),
            orientation: wp.array(dtype=place),
        ) -> s.spin:
            """Spin after an angular impulse [N m s]."""
            return w + get(inverse_inertia, i) * twist

        @wp.func
        def energy(
            i: int,
            w: s.spin,
            inertia: wp.array(dtype=real),
            principal_moment: wp.array(dtype=real),
            principal_axes: wp.array(dtype=place),
            orientation: wp.array(dtype=place),
        ) -> real:
            """Kinetic energy of a spin [J]."""
            return real(0.5) * get(inertia, i) * s.spin_squared(w)

        return Laws(spun=spun, energy=energy)

    vec, rot = k.vec, k.rot
    narrowed = narrow(s, k)

    @wp.func
    def axes_of(
        i: int, principal_axes: wp.array(dtype=place), orientation: wp.array(dtype=place)
    ) -> rot:
        """Rotation from the principal axes to the world."""
        return wp.normalize(k.load_rot(orientation, i) * k.load_rot(principal_axes, i))

    @wp.func
    def spun_about(
        i: int,
        w: s.spin,
        twist: s.spin,
        inverse_inertia: wp.array(dtype=real),
        principal_moment: wp.array(dtype=real),
        principal_axes: wp.array(dtype=place),
        orientation: wp.array(dtype=place),
    ) -> s.spin:
        q = axes_of(i, principal_axes, orientation)
        moment = k.vec(widened_spin(s.load(principal_moment, i)))
        change = wp.quat_rotate(q, wp.cw_div(wp.quat_rotate_inv(q, widened_spin(twist)), moment))
        return w + wp.where(get(inverse_inertia, i) == real(0.0), real(0.0), real(1.0)) * narrowed(
            change
        )

    @wp.func
    def energy_about(
        i: int,
        w: s.spin,
        inertia: wp.array(dtype=real),
        principal_moment: wp.array(dtype=real),
        principal_axes: wp.array(dtype=place),
        orientation: wp.array(dtype=place),
    ) -> real:
        q = axes_of(i, principal_axes, orientation)
        body = narrowed(wp.quat_rotate_inv(q, widened_spin(w)))
        return real(0.5) * wp.dot(body, wp.cw_mul(s.load(principal_moment, i), body))

    @wp.func
    def turn_about(axis: vec, q: rot, momentum: vec, moment: place, dt: place):
        """Body frame turned about one of its axes by the spin there; momentum [N m s] with it."""
        angle = dt * wp.dot(axis, momentum) / moment
        turn = wp.quat_from_axis_angle(axis, angle)
        return q * turn, wp.quat_rotate_inv(turn, momentum)

    @wp.func
    def tumble(
        i: int,
        w: s.spin,
        inverse_inertia: wp.array(dtype=real),
        principal_moment: wp.array(dtype=real),
        principal_axes: wp.array(dtype=place),
        orientation: wp.array(dtype=place),
        dt: place,
    ) -> s.spin:
        """Turn an element freely for dt; its spin then."""
        own = k.load_rot(principal_axes, i)
        moment = widened_spin(s.load(principal_moment, i))
        q = axes_of(i, principal_axes, orientation)
        start = widened_spin(w)
        momentum = wp.cw_mul(moment, wp.quat_rotate_inv(q, start))
        size = wp.dot(momentum, momentum)
        x = vec(place(1.0), place(0.0), place(0.0))
        y = vec(place(0.0), place(1.0), place(0.0))
        z = vec(place(0.0), place(0.0), place(1.0))
        half = place(0.5) * dt
        q, momentum = turn_about(x, q, momentum, moment[0], half)
        q, momentum = turn_about(y, q, momentum, moment[1], half)
        q, momentum = turn_about(z, q, momentum, moment[2], dt)
        q, momentum = turn_about(y, q, momentum, moment[1], half)
        q, momentum = turn_about(x, q, momentum, moment[0], half)
        turned = wp.normalize(q * wp.quat_inverse(own))
        q = wp.normalize(turned * own)
        after = wp.quat_rotate(q, wp.cw_div(momentum, moment))
        # as the next step will find it: else one rounding a step, always the same way, adds up
        momentum = wp.cw_mul(moment, wp.quat_rotate_inv(q, after))
        lost = (size - wp.dot(momentum, momentum)) / wp.max(size, place(1.0e-30))
        after = after + place(0.5) * lost * after
        if get(inverse_inertia, i) == real(0.0):  # a grip turns at its own constant rate
            turned = k.rotate_by(k.load_rot(orientation, i), start, dt)
            after = start
        k.store_rot(orientation, i, turned)
        return narrowed(after)

    return Laws(spun=spun_about, energy=energy_about, tumble=tumble)


@cache
def move(
    s: Laws,
    k: Laws,
    ends: Ends,
    external: Loads,
    has_moments: bool,
    has_work: bool,
    has_grips: bool,
    drifts: bool,
    is_listed: bool,
    simd: bool = True,
):
    """Pass over elements: finish one half kick, start the next, then drift.

    The halves are added one after the other, so that a run that stops between them to be observed
    has the same bits as one that does not. `has_work` adds up the work of grips and of outer
    loads [J]; `has_grips`: some grips change their velocity with time.
    """
    real, load_force, load_outer = s.real, gather(s, ends), outer_load(s, external)
    rotor = inertia(s, k, has_moments)
    widened, widened_spin = narrow(k, s), narrow_spin(k, s)

    @wp.func
    def power(
        i: int,
        v: s.vec,
        w: s.spin,
        f: s.vec,
        t: s.spin,
        outer_f: s.vec,
        outer_t: s.spin,
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
    ) -> real:
        """Power of loads, and of the grip, that takes the reaction -F of a held axis [W]."""
        free = s.load(inverse_mass, i)
        p = wp.dot(outer_f, v) + s.spin_dot(outer_t, w)
        for axis in range(wp.static(s.dim)):
            p -= wp.where(free[axis] == real(0.0), f[axis] * v[axis], real(0.0))
        return p - wp.where(get(inverse_inertia, i) == real(0.0), s.spin_dot(t, w), real(0.0))

    @wp.func
    def accelerated(
        i: int,
        v: s.vec,
        v_before: s.vec,
        w: s.spin,
        w_before: s.spin,
        mass: wp.array(dtype=real),
        inertia: wp.array(dtype=real),
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
    ) -> real:
        """Kinetic energy that a grip gives its element [J] by changing its velocity."""
        free = s.load(inverse_mass, i)
        gain = real(0.0)
        for axis in range(wp.static(s.dim)):
            gain += wp.where(
                free[axis] == real(0.0),
                get(mass, i) * (v[axis] * v[axis] - v_before[axis] * v_before[axis]),
                real(0.0),
            )
        gain += wp.where(
            get(inverse_inertia, i) == real(0.0),
            get(inertia, i) * (s.spin_squared(w) - s.spin_squared(w_before)),
            real(0.0),
        )
        return real(0.5) * gain

    @wp.func
    def held_motion(
        i: int,
        v: s.vec,
        w: s.spin,
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        grip_velocity: wp.array(dtype=real),
        grip_spin: wp.array(dtype=real),
        grip: wp.array(dtype=int),
        grip_factor: wp.array(dtype=real),
    ):
        """Velocity and spin, those of held axes as their grip has them now."""
        free = s.load(inverse_mass, i)
        given = s.load(grip_velocity, i)
        factor = get(grip_factor, get(grip, i))
        for axis in range(wp.static(s.dim)):
            v[axis] = wp.where(free[axis] == real(0.0), factor * given[axis], v[axis])
        turned = factor * s.load_spin(grip_spin, i)
        return v, wp.where(get(inverse_inertia, i) == real(0.0), turned, w)

    def move(
        # model
        listed: wp.array(dtype=int),
        mass: wp.array(dtype=real),
        inertia: wp.array(dtype=real),
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
        grip: wp.array(dtype=int),
        grip_velocity: wp.array(dtype=real),
        grip_spin: wp.array(dtype=real),
        grip_factor: wp.array(dtype=real),
        # state read
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        # written
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        element_work: wp.array(dtype=wp.float64),
        finish: real,
        start: real,
        dt: k.real,
        elements: int,
        first: int,
    ):
        i = nn(wp.tid() + first)
        if wp.static(is_listed):
            i = nn(get(listed, i))
        f, t = load_force(i, lattice_before, end_force, end_torque, elements)
        outer_f, outer_t = load_outer(
            i,
            external_force,
            external_torque,
            timed_force,
            timed_torque,
            load_factor,
            elements,
        )
        f += outer_f
        t += outer_t
        v = s.load(velocity, i)
        w = s.load_spin(angular_velocity, i)
        v_before = v
        w_before = w
        a = wp.cw_mul(s.load(inverse_mass, i), f)
        v = v + finish * a
        v = v + start * a
        w = rotor.spun(
            i, w, finish * t, inverse_inertia, principal_moment, principal_axes, orientation
        )
        w = rotor.spun(
            i, w, start * t, inverse_inertia, principal_moment, principal_axes, orientation
        )
        v_free = v
        w_free = w
        if wp.static(drifts and has_grips):
            v, w = held_motion(
                i, v, w, inverse_mass, inverse_inertia, grip_velocity, grip_spin, grip, grip_factor
            )
        s.store(velocity, i, v)
        if wp.static(has_work):
            # the speed of the drift before this half kick, or, to unmake one, of that after it
            v_finish = wp.where(finish < real(0.0), v, v_before)
            w_finish = wp.where(finish < real(0.0), w, w_before)
            finished = finish * power(
                i, v_finish, w_finish, f, t, outer_f, outer_t, inverse_mass, inverse_inertia
            )
            done = start * power(i, v, w, f, t, outer_f, outer_t, inverse_mass, inverse_inertia)
            if wp.static(drifts and has_grips):
                done += accelerated(
                    i, v, v_free, w, w_free, mass, inertia, inverse_mass, inverse_inertia
                )
            # one after the other, as the kicks
            work = get(element_work, i) + wp.float64(finished)
            put(element_work, i, work + wp.float64(done))
        if wp.static(drifts):
            k.store(displacement, i, k.load(displacement, i) + dt * widened(v))
            if wp.static(has_moments):
                w = rotor.tumble(
                    i, w, inverse_inertia, principal_moment, principal_axes, orientation, dt
                )
            else:
                q = k.load_rot(orientation, i)
                k.store_rot(orientation, i, k.rotate_by(q, widened_spin(w), dt))
        s.store_spin(angular_velocity, i, w)

    return kernel(move, simd)


@cache
def integrator_energies(
    s: Laws,
    k: Laws,
    ends: Ends,
    external: Loads,
    has_moments: bool,
    is_listed: bool,
    simd: bool = True,
):
    """Per element: the integrator's own term [J] (theory B13).

    Velocity Verlet conserves H - (dt^2/8) sum(|F|^2/m + |M|^2/J) exactly in a linear system.
    """
    real, load_net = s.real, net(s, ends, external)
    rotor = inertia(s, k, has_moments)

    def integrator_energies(
        # model
        listed: wp.array(dtype=int),
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
        # written
        integrator_energy: wp.array(dtype=real),
        dt: real,
        elements: int,
    ):
        t = wp.tid()
        i = nn(t)
        if wp.static(is_listed):
            i = nn(listed[t])
        f, m = load_net(
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
        spin = rotor.spun(
            i, s.no_spin(), m, inverse_inertia, principal_moment, principal_axes, orientation
        )
        integrator_energy[t] = (-real(0.125) * dt * dt) * (
            wp.dot(f, wp.cw_mul(s.load(inverse_mass, i), f)) + s.spin_dot(m, spin)
        )

    return kernel(integrator_energies, simd)


@cache
def element_energies(
    s: Laws, k: Laws, has_moments: bool, has_volume: bool, has_plastic_zz: bool, simd: bool = True
):
    """Per element: kinetic and volume energy [J]."""
    real, rotor = s.real, inertia(s, k, has_moments)

    def element_energies(
        # model
        mass: wp.array(dtype=real),
        inertia: wp.array(dtype=real),
        principal_moment: wp.array(dtype=real),
        principal_axes: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        # state read
        orientation: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        volume_stiffness: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        plastic_strain_zz: wp.array(dtype=real),
        # written
        kinetic_energy: wp.array(dtype=real),
        volume_energy: wp.array(dtype=real),
        locked_energy: wp.array(dtype=real),
    ):
        i = wp.tid()
        v = s.load(velocity, i)
        w = s.load_spin(angular_velocity, i)
        turning = rotor.energy(i, w, inertia, principal_moment, principal_axes, orientation)
        put(kinetic_energy, i, real(0.5) * get(mass, i) * wp.dot(v, v) + turning)
        if wp.static(has_volume):
            # g = A E; where A = 0 there is no volume energy
            a = get(volume_stiffness, i)
            g = get(volume_stress, i)
            safe = wp.where(a == real(0.0), real(1.0), a)
            put(volume_energy, i, real(0.5) * get(element_volume, i) * g * g / safe)
            if wp.static(has_plastic_zz):  # plane strain: elastic eps_zz is -zz
                zz = get(plastic_strain_zz, i)
                put(
                    locked_energy,
                    i,
                    real(0.5) * get(element_volume, i) * get(element_two_shear, i) * zz * zz,
                )

    return kernel(element_energies, simd)

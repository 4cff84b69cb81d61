"""Relaxation to rest: FIRE (Bitzek et al. 2006) in the metric of the masses, at a constant dt."""

from functools import cache

import warp as wp

from .algebra import Laws
from .memory import get, kernel, nn, put
from .motion import Ends, Loads, inertia, net

# as if masses were 1/LIGHT times as large, since steering adds to the push of the forces
STEER, STEER_DECAY, PATIENCE, LIGHT = 0.1, 0.99, 5.0, 0.25
PIECE = 512  # elements that are summed one after the other


@cache
def fire_power(s: Laws, k: Laws, ends: Ends, external: Loads, has_moments: bool, simd: bool = True):
    """Per element: power F.v [W], v.M v and F.M^-1 F, that decide how velocities are steered."""
    real, load_net, rotor = s.real, net(s, ends, external), inertia(s, k, has_moments)

    def fire_power(
        # model
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
        # state read
        orientation: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        # written
        relaxing_power: wp.array(dtype=real),
        relaxing_kinetic: wp.array(dtype=real),
        relaxing_force: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
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
        v = s.load(velocity, i)
        w = s.load_spin(angular_velocity, i)
        spin = rotor.spun(
            i, s.no_spin(), t, inverse_inertia, principal_moment, principal_axes, orientation
        )
        turning = rotor.energy(i, w, inertia, principal_moment, principal_axes, orientation)
        put(relaxing_power, i, wp.dot(f, v) + s.spin_dot(t, w))
        put(relaxing_kinetic, i, get(mass, i) * wp.dot(v, v) + real(2.0) * turning)
        put(
            relaxing_force,
            i,
            wp.dot(f, wp.cw_mul(s.load(inverse_mass, i), f)) + s.spin_dot(t, spin),
        )

    return kernel(fire_power, simd)


@cache
def fire(s: Laws, k: Laws, ends: Ends, external: Loads, has_moments: bool, simd: bool = True):
    """Pass over elements: v <- keep v + push M^-1 F."""
    real, load_net, rotor = s.real, net(s, ends, external), inertia(s, k, has_moments)

    def fire(
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
        relaxing_mix: wp.array(dtype=real),
        orientation: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        # written
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        keep = relaxing_mix[0]
        push = relaxing_mix[1]
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
        a = wp.cw_mul(s.load(inverse_mass, i), f)
        s.store(velocity, i, keep * s.load(velocity, i) + push * a)
        w = keep * s.load_spin(angular_velocity, i)
        w = rotor.spun(
            i, w, push * t, inverse_inertia, principal_moment, principal_axes, orientation
        )
        s.store_spin(angular_velocity, i, w)

    return kernel(fire, simd)


@cache
def fire_sums(s: Laws):
    """Per piece of the elements: the sums of what `fire_power` worked out."""
    real = s.real

    def fire_sums(
        relaxing_power: wp.array(dtype=real),
        relaxing_kinetic: wp.array(dtype=real),
        relaxing_force: wp.array(dtype=real),
        # written
        relaxing_sums: wp.array(dtype=wp.float64),
        elements: int,
    ):
        piece = wp.tid()
        power = wp.float64(0.0)
        kinetic = wp.float64(0.0)
        force = wp.float64(0.0)
        for i in range(piece * PIECE, wp.min((piece + 1) * PIECE, elements)):
            power += wp.float64(relaxing_power[i])
            kinetic += wp.float64(relaxing_kinetic[i])
            force += wp.float64(relaxing_force[i])
        relaxing_sums[3 * piece] = power
        relaxing_sums[3 * piece + 1] = kinetic
        relaxing_sums[3 * piece + 2] = force

    return kernel(fire_sums, simd=False)


@cache
def fire_steer(s: Laws):
    """How velocities are steered in the next step: along the forces while these do work, more and
    more freely; else they stop."""
    real = s.real

    def fire_steer(
        relaxing_sums: wp.array(dtype=wp.float64),
        # written
        relaxing_state: wp.array(dtype=wp.float64),
        relaxing_mix: wp.array(dtype=real),
        pieces: int,
        dt: wp.float64,
    ):
        power = wp.float64(0.0)
        kinetic = wp.float64(0.0)
        force = wp.float64(0.0)
        for piece in range(pieces):
            power += relaxing_sums[3 * piece]
            kinetic += relaxing_sums[3 * piece + 1]
            force += relaxing_sums[3 * piece + 2]
        steer = relaxing_state[0]
        downhill = relaxing_state[1]
        keep = wp.float64(0.0)
        push = wp.float64(LIGHT) * dt
        if power > wp.float64(0.0):
            downhill += wp.float64(1.0)
            keep = wp.float64(1.0) - steer
            if force > wp.float64(0.0):
                push += steer * wp.sqrt(kinetic / force)
            if downhill > wp.float64(PATIENCE):
                steer *= wp.float64(STEER_DECAY)
        else:
            downhill = wp.float64(0.0)
            steer = wp.float64(STEER)
        relaxing_state[0] = steer
        relaxing_state[1] = downhill
        relaxing_mix[0] = real(keep)
        relaxing_mix[1] = real(push)

    return kernel(fire_steer, simd=False)

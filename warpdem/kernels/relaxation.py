"""Relaxation to rest: FIRE (Bitzek et al. 2006) in the metric of the masses, at a constant dt."""

from functools import cache

import warp as wp

from .algebra import Laws
from .memory import get, kernel, nn, put
from .motion import Ends, Loads, inertia, net


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

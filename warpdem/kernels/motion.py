"""Motion of the elements (Shilko eq. 1): gather, kick, drift, rotate (theory A10, velocity Verlet).

An inverse mass or inertia of zero holds an element, or moves it with its own constant velocity.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow, narrow_spin
from .memory import kernel, nn


@cache
def gather(s: Laws, slots: int, has_external: bool):
    """Force and torque on an element: the sum over its slots in a fixed order, never an atomic."""
    real = s.real

    @wp.func
    def load_force(
        i: int,
        external_force: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        elements: int,
    ):
        f = s.vec()
        t = s.no_spin()
        for slot in range(wp.static(slots)):
            f += s.load(end_force, nn(slot * elements + i))
            t += s.load_spin(end_torque, nn(slot * elements + i))
        if wp.static(has_external):
            f += s.load(external_force, i)
        return f, t

    return load_force


@cache
def move(
    s: Laws,
    k: Laws,
    slots: int,
    has_external: bool,
    has_work: bool,
    drifts: bool,
    is_listed: bool,
    simd: bool = True,
):
    """Pass over elements: finish one half kick, start the next, then drift.

    The halves are added one after the other, so that a run that stops between them to be observed
    has the same bits as one that does not. `has_work` adds up the work of forced motion [J].
    """
    real, load_force = s.real, gather(s, slots, has_external)
    widened, widened_spin = narrow(k, s), narrow_spin(k, s)

    def move(
        # model
        listed: wp.array(dtype=int),
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        external_force: wp.array(dtype=real),
        # state read
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        # written
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        element_work: wp.array(dtype=real),
        finish: real,
        start: real,
        dt: k.real,
        elements: int,
        first: int,
    ):
        i = nn(wp.tid() + first)
        if wp.static(is_listed):
            i = nn(listed[i])
        f, t = load_force(i, external_force, end_force, end_torque, elements)
        v = s.load(velocity, i)
        if wp.static(has_work):
            held = s.load(inverse_mass, i)
            for axis in range(wp.static(s.dim)):
                # a held axis takes the reaction -F; its motion does work on the body
                element_work[i] = element_work[i] - wp.where(
                    held[axis] == real(0.0), (finish + start) * f[axis] * v[axis], real(0.0)
                )
        a = wp.cw_mul(s.load(inverse_mass, i), f)
        v = v + finish * a
        v = v + start * a
        s.store(velocity, i, v)
        w = s.load_spin(angular_velocity, i)
        w = w + finish * inverse_inertia[i] * t
        w = w + start * inverse_inertia[i] * t
        s.store_spin(angular_velocity, i, w)
        if wp.static(drifts):
            k.store(displacement, i, k.load(displacement, i) + dt * widened(v))
            q = k.load_rot(orientation, i)
            k.store_rot(orientation, i, k.rotate_by(q, widened_spin(w), dt))

    return kernel(move, simd)


@cache
def integrator_energies(
    s: Laws, slots: int, has_external: bool, is_listed: bool, simd: bool = True
):
    """Per element: the integrator's own term [J] (theory B13).

    Velocity Verlet conserves H - (dt^2/8) sum(|F|^2/m + |M|^2/J) exactly in a linear system.
    """
    real, load_force = s.real, gather(s, slots, has_external)

    def integrator_energies(
        # model
        listed: wp.array(dtype=int),
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        external_force: wp.array(dtype=real),
        # state read
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
        f, m = load_force(i, external_force, end_force, end_torque, elements)
        integrator_energy[t] = (-real(0.125) * dt * dt) * (
            wp.dot(f, wp.cw_mul(s.load(inverse_mass, i), f))
            + inverse_inertia[i] * s.spin_squared(m)
        )

    return kernel(integrator_energies, simd)


@cache
def element_energies(s: Laws, has_volume: bool, simd: bool = True):
    """Per element: kinetic and volume energy [J]."""
    real = s.real

    def element_energies(
        # model
        mass: wp.array(dtype=real),
        inertia: wp.array(dtype=real),
        element_volume: wp.array(dtype=real),
        # state read
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        volume_stiffness: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        # written
        kinetic_energy: wp.array(dtype=real),
        volume_energy: wp.array(dtype=real),
    ):
        i = wp.tid()
        v = s.load(velocity, i)
        w = s.load_spin(angular_velocity, i)
        kinetic_energy[i] = real(0.5) * (mass[i] * wp.dot(v, v) + inertia[i] * s.spin_squared(w))
        if wp.static(has_volume):
            # g = A E; where A = 0 there is no volume energy
            a = volume_stiffness[i]
            g = volume_stress[i]
            safe = wp.where(a == real(0.0), real(1.0), a)
            volume_energy[i] = real(0.5) * element_volume[i] * g * g / safe

    return kernel(element_energies, simd)

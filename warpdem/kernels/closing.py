"""Unlinked pairs resist closing: a one-sided energy, and exact books when it switches (theory B11).

Velocity Verlet leaves over, in a step in which a gap changes sign, an energy that is known exactly:
the change of the closing energy plus the trapezoid of its force. Left alone these amounts make the
energy of chattering faces diffuse upwards. They are owed by the pair and paid back at once by an
impulse along its normal, equal and opposite on both elements along one line.
"""

from functools import cache

import warp as wp

from .algebra import Laws
from .memory import get, nn

UNKNOWN = 1.0e30  # gap of a pair that was not unlinked before, or whose state was overwritten
TURNED = 2.0e30  # of one whose faces have turned away from each other
PARTED = 3.0e30  # of one that is any pair from now on


@cache
def closing(s: Laws) -> Laws:
    """Laws of a closing pair in its gap [m], the tension-positive pull, and its debt [J]."""
    real, vec = s.real, s.vec

    @wp.func
    def energy(stiffness: real, gap: real) -> real:
        """U = k_c/2 <gap>^2, zero if the gap is open."""
        h = wp.min(gap, real(0.0))
        return real(0.5) * stiffness * h * h

    @wp.func
    def pull(stiffness: real, gap: real, slack: real) -> real:
        """Pull on i along n, -dU/d(gap) of j: negative, if the gap is below `slack` (0)."""
        return wp.where(gap < slack, stiffness * gap, real(0.0))

    @wp.func
    def left_over(stiffness: real, before: real, gap: real) -> real:
        """What a step from gap `before` to `gap` leaves over; zero unless it changes sign."""
        crossed = before < real(UNKNOWN) and (before < real(0.0)) != (gap < real(0.0))
        mean = real(0.5) * (wp.min(before, real(0.0)) + wp.min(gap, real(0.0)))
        owed = energy(stiffness, gap) - energy(stiffness, before)
        owed -= stiffness * mean * (gap - before)
        return wp.where(crossed, owed, real(0.0))

    @wp.func
    def approach(
        i: int,
        n: vec,
        arm: vec,
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
    ) -> real:
        """Speed along n of a material point of element i [m/s]."""
        turning = s.spin_dot(s.load_spin(angular_velocity, i), s.cross(arm, n))
        return wp.dot(n, s.load(velocity, i)) + turning

    @wp.func
    def yielding(
        i: int,
        n: vec,
        arm: vec,
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
    ) -> real:
        """Speed along n that a unit impulse there gives element i [1/kg]."""
        lever = s.cross(arm, n)
        return wp.dot(n, wp.cw_mul(s.load(inverse_mass, i), n)) + get(
            inverse_inertia, i
        ) * s.spin_squared(lever)

    @wp.func
    def impulse(debt: real, speed: real, yield_both: real) -> real:
        """Least impulse J [N s] on j along n with J v + w J^2/2 = -debt, or what comes nearest."""
        if yield_both == real(0.0):
            return real(0.0)
        left = speed * speed - real(2.0) * yield_both * debt
        after = wp.sqrt(wp.max(left, real(0.0)))
        return (wp.where(speed < real(0.0), -after, after) - speed) / yield_both

    @wp.func
    def owes(
        t: int,
        b: int,
        bond_place: wp.array(dtype=int),
        closing_debt: wp.array(dtype=real),
        closing_impulse: wp.array(dtype=real),
    ) -> bool:
        """Whether pair t, bond b, has a debt, or an impulse that is not yet booked."""
        last = s.load(closing_impulse, nn(get(bond_place, 2 * b)))
        return closing_debt[t] != real(0.0) or wp.dot(last, last) != real(0.0)

    @wp.func
    def settle(
        t: int,
        b: int,
        i: int,
        j: int,
        n: vec,
        arm_i: vec,
        arm_j: vec,
        inverse_mass: wp.array(dtype=real),
        inverse_inertia: wp.array(dtype=real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        bond_place: wp.array(dtype=int),
        closing_debt: wp.array(dtype=real),
        closing_impulse: wp.array(dtype=real),
        closing_twist: wp.array(dtype=real),
        share: real,
    ):
        """Book the last impulse of pair t, bond b, and give it a `share` of one that pays its debt.

        The energy of all impulses together is the sum of J (v_before + v_after)/2 over pairs, so
        half is booked before they act and half, by the next call, after. Impulses are kept as
        forces and torques are: on i, and on both.
        """
        speed = approach(j, n, arm_j, velocity, angular_velocity) - approach(
            i, n, arm_i, velocity, angular_velocity
        )
        yield_both = yielding(i, n, arm_i, inverse_mass, inverse_inertia) + yielding(
            j, n, arm_j, inverse_mass, inverse_inertia
        )
        last = -wp.dot(s.load(closing_impulse, nn(get(bond_place, 2 * b))), n)
        debt = closing_debt[t] + real(0.5) * last * speed
        size = real(0.0)
        if debt != real(0.0):
            size = share * impulse(debt, speed, yield_both)
        closing_debt[t] = debt + real(0.5) * size * speed
        twist_i = -size * s.cross(arm_i, n)
        twist_j = size * s.cross(arm_j, n)
        s.store_ends(bond_place, closing_impulse, closing_twist, b, -size * n, twist_i, twist_j)

    return Laws(
        energy=energy, pull=pull, left_over=left_over, impulse=impulse, owes=owes, settle=settle
    )

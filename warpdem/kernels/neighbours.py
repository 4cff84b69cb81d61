"""Search for elements that are near each other, on the device (theory B11).

A list holds all pairs nearer than their radii and a skin. It is right until something has moved by
half the skin, and is built again before that is used. Each element has a row of the list, sorted,
so that sums over it do not depend on when it was built.
"""

from functools import cache

import warp as wp

from .algebra import Laws
from .closing import UNKNOWN
from .memory import kernel, nn


@cache
def watch_motion(k: Laws):
    """Pass over elements that may touch: raise a flag if one has moved too far for the list.

    One that is not finite raises it as well.
    """

    def watch_motion(
        contact_elements: wp.array(dtype=int),
        displacement: wp.array(dtype=k.real),
        listed_displacement: wp.array(dtype=k.real),
        any_moved: wp.array(dtype=int),
        limit: k.real,
    ):
        t = nn(wp.tid())
        moved = k.load(displacement, nn(contact_elements[t])) - k.load(listed_displacement, t)
        if not (wp.dot(moved, moved) <= limit * limit):
            any_moved[0] = 1

    return kernel(watch_motion, simd=False)


@cache
def place_elements(k: Laws):
    """Pass over elements that may touch: where they are, and a flag if that is nowhere."""

    def place_elements(
        contact_elements: wp.array(dtype=int),
        contact_position: wp.array(dtype=wp.float64),
        displacement: wp.array(dtype=k.real),
        # written
        contact_place: wp.array(dtype=wp.vec3d),
        listed_displacement: wp.array(dtype=k.real),
        any_lost: wp.array(dtype=int),
        limit: wp.float64,
    ):
        t = nn(wp.tid())
        i = nn(contact_elements[t])
        x = wp.vec3d()
        for axis in range(wp.static(k.dim)):
            at = nn(wp.static(k.dim) * i + axis)
            x[axis] = contact_position[at] + wp.float64(displacement[at])
            if not (wp.abs(x[axis]) <= limit):
                any_lost[0] = 1
        contact_place[t] = x
        k.store(listed_displacement, t, k.load(displacement, i))

    return kernel(place_elements, simd=False)


@cache
def part_pairs(s: Laws, k: Laws):
    """Pass over listed bonds: unlinked pairs that are out of each other's reach part for good.

    Their faces have lost each other, so they have no closing stiffness any more, and touch as any
    two elements do. Neither law holds energy then.
    """
    real = s.real

    def part_pairs(
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        contact_position: wp.array(dtype=wp.float64),
        contact_radius: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        closing_gap: wp.array(dtype=real),
        closing_stiffness: wp.array(dtype=real),
        skin: wp.float64,
    ):
        t = wp.tid()
        b = listed[t]
        i = bond_i[b]
        j = bond_j[b]
        square = wp.float64(0.0)
        for axis in range(wp.static(k.dim)):
            at = wp.static(k.dim) * i + axis
            to = wp.static(k.dim) * j + axis
            d = contact_position[to] - contact_position[at]
            d += wp.float64(displacement[to]) - wp.float64(displacement[at])
            square += d * d
        reach = wp.float64(contact_radius[i]) + wp.float64(contact_radius[j]) + skin
        gap = closing_gap[t]
        is_open = gap > real(0.0) and gap < real(UNKNOWN)
        if bond_linked[b] == real(0.0) and is_open and square > reach * reach:
            closing_stiffness[t] = real(0.0)

    return kernel(part_pairs, simd=False)


@cache
def list_neighbours(s: Laws, k: Laws, has_parting: bool, fills: bool):
    """Pass over elements that may touch: count their neighbours, or write them down.

    has_parting: pairs that bonds joined may have parted, and are listed then.
    """
    real = s.real

    @wp.func
    def are_bonded(
        t: int,
        j: int,
        bonded_start: wp.array(dtype=int),
        bonded: wp.array(dtype=int),
        bonded_listed: wp.array(dtype=int),
        closing_stiffness: wp.array(dtype=real),
    ):
        """Whether a bond joins, or joined, element j to that of row t."""
        for e in range(bonded_start[t], bonded_start[t + 1]):
            if bonded[e] == j:
                if wp.static(has_parting):
                    at = bonded_listed[e]
                    return at < 0 or closing_stiffness[wp.max(at, 0)] != real(0.0)
                return True
        return False

    def list_neighbours(
        grid: wp.uint64,
        contact_elements: wp.array(dtype=int),
        contact_place: wp.array(dtype=wp.vec3d),
        contact_position: wp.array(dtype=wp.float64),
        contact_radius: wp.array(dtype=k.real),
        bonded_start: wp.array(dtype=int),
        bonded: wp.array(dtype=int),
        bonded_listed: wp.array(dtype=int),
        closing_stiffness: wp.array(dtype=real),
        greatest: wp.float64,
        skin: wp.float64,
        # written
        neighbour_count: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=k.real),
    ):
        t = wp.tid()
        i = contact_elements[t]
        x = contact_place[t]
        radius = wp.float64(contact_radius[i])
        first = contact_start[t]
        count = int(0)  # noqa: UP018, RUF046  a literal could not be added to in a loop
        for row in wp.hash_grid_query(grid, x, radius + greatest + skin):
            d = contact_place[row] - x
            j = contact_elements[row]
            reach = radius + wp.float64(contact_radius[j]) + skin
            is_near = row != t and wp.dot(d, d) <= reach * reach
            if is_near and not are_bonded(
                t, j, bonded_start, bonded, bonded_listed, closing_stiffness
            ):
                if wp.static(fills):
                    at = first + count
                    while at > first and contact_neighbour[wp.max(at - 1, 0)] > j:
                        contact_neighbour[at] = contact_neighbour[at - 1]
                        at -= 1
                    contact_neighbour[at] = j
                count += 1
        neighbour_count[t] = count
        if wp.static(fills):
            for e in range(first, first + count):
                j = contact_neighbour[e]
                for axis in range(wp.static(k.dim)):
                    to = contact_position[wp.static(k.dim) * j + axis]
                    gone = to - contact_position[wp.static(k.dim) * i + axis]
                    contact_reference[wp.static(k.dim) * e + axis] = k.real(gone)

    return kernel(list_neighbours, simd=False)


@cache
def carry_over(s: Laws, has_friction: bool, has_restitution: bool, ages: bool):
    """Pass over elements that may touch: what the old list knew of their pairs (debts, tangential
    springs, ages) goes over to the new one."""
    real = s.real

    def carry_over(
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        old_start: wp.array(dtype=int),
        old_neighbour: wp.array(dtype=int),
        old_debt: wp.array(dtype=real),
        old_spring: wp.array(dtype=real),
        old_theta: wp.array(dtype=wp.float64),
        # written
        contact_debt: wp.array(dtype=real),
        contact_impulse: wp.array(dtype=real),
        contact_opened: wp.array(dtype=int),
        contact_spring: wp.array(dtype=real),
        contact_theta: wp.array(dtype=wp.float64),
    ):
        t = wp.tid()
        at = old_start[t]
        end = old_start[t + 1]
        last = wp.max(end - 1, 0)
        for e in range(contact_start[t], contact_start[t + 1]):
            j = contact_neighbour[e]
            # both sides of `and` are evaluated: no index may leave the array
            while at < end and old_neighbour[wp.min(at, last)] < j:
                at += 1
            known = at < end and old_neighbour[wp.min(at, last)] == j
            debt = real(0.0)
            spring = s.vec()
            theta = wp.float64(0.0)
            if known:
                debt = old_debt[at]
                if wp.static(has_friction):
                    spring = s.load(old_spring, at)
                if wp.static(ages):
                    theta = old_theta[at]
            contact_debt[e] = debt
            contact_impulse[e] = real(0.0)
            if wp.static(has_restitution):
                contact_opened[e] = 0
            if wp.static(has_friction):
                s.store(contact_spring, e, spring)
            if wp.static(ages):
                contact_theta[e] = theta

    return kernel(carry_over, simd=False)

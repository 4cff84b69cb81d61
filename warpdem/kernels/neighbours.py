"""Search for elements that are near each other, on the device (theory B11).

A list holds all pairs nearer than their radii and a skin. It is right until something has moved by
half the skin, and is built again before that is used. Elements are sorted by cells, so that those
of a cell lie side by side; each looks through the cells around its own once. Cells have at least
the size of the greatest reach and wrap round, those of a periodic box with the box. Each element
has a row of the list, sorted, so that sums over it do not depend on when it was built.
"""

from functools import cache

import warp as wp

from .algebra import Laws
from .closing import PARTED, TURNED, UNKNOWN
from .contact import Touch
from .memory import kernel, nn


@cache
def images() -> Laws:
    """Periodic images, in float64; a box has the columns of `edges` as its edges."""

    @wp.func
    def nearest(d: wp.vec3d, to_shares: wp.mat33d) -> wp.vec3d:
        """By how many edges to move the end of d so that it is the nearest of all its images.

        Right where that is nearer than half the least height of the box. to_shares: edges^-1.
        """
        shares = to_shares * d
        return -wp.vec3d(wp.rint(shares[0]), wp.rint(shares[1]), wp.rint(shares[2]))

    return Laws(nearest=nearest)


@cache
def watch_motion(k: Laws, is_strained: bool):
    """Pass over elements that may touch: raise a flag if one has moved too far for the list.

    One that is not finite raises it as well. is_strained: motion is against that of a box whose
    strain has changed by `strain` since the list was built.
    """

    def watch_motion(
        contact_elements: wp.array(dtype=int),
        contact_place: wp.array(dtype=wp.vec3d),
        displacement: wp.array(dtype=k.real),
        listed_displacement: wp.array(dtype=k.real),
        any_moved: wp.array(dtype=int),
        limit: k.real,
        strain: wp.mat33d,
    ):
        t = nn(wp.tid())
        moved = k.load(displacement, nn(contact_elements[t])) - k.load(listed_displacement, t)
        if wp.static(is_strained):
            along = strain * contact_place[t]
            for axis in range(wp.static(k.dim)):
                moved[axis] -= k.real(along[axis])
        if not (wp.dot(moved, moved) <= limit * limit):
            any_moved[0] = 1

    return kernel(watch_motion, simd=False)


@cache
def place_elements(k: Laws):
    """Pass over elements that may touch: where they are and in which cell, and a flag if that is
    nowhere."""

    @wp.func
    def wrapped(at: wp.float64, cells: int) -> int:
        """The cell along an axis of a place in units of cells."""
        cell = int(wp.floor(at)) % cells
        return wp.where(cell < 0, cell + cells, cell)

    def place_elements(
        contact_elements: wp.array(dtype=int),
        contact_position: wp.array(dtype=wp.float64),
        displacement: wp.array(dtype=k.real),
        # written
        contact_place: wp.array(dtype=wp.vec3d),
        listed_displacement: wp.array(dtype=k.real),
        cell_of: wp.array(dtype=int),
        cell_row: wp.array(dtype=int),
        any_lost: wp.array(dtype=int),
        limit: wp.float64,
        to_cells: wp.mat33d,
        cells: wp.vec3i,
    ):
        t = nn(wp.tid())
        i = nn(contact_elements[t])
        x = wp.vec3d()
        is_lost = bool(False)  # noqa: UP018  a literal could not be set in a loop
        for axis in range(wp.static(k.dim)):
            at = nn(wp.static(k.dim) * i + axis)
            x[axis] = contact_position[at] + wp.float64(displacement[at])
            if not (wp.abs(x[axis]) <= limit):
                is_lost = True
        contact_place[t] = x
        k.store(listed_displacement, t, k.load(displacement, i))
        cell = int(0)  # noqa: UP018, RUF046
        if is_lost:
            any_lost[0] = 1
        else:
            c = to_cells * x
            for axis in range(wp.static(k.dim)):
                last = wp.static(k.dim - 1) - axis  # the first axis runs fastest
                cell = cell * cells[last] + wrapped(c[last], cells[last])
        cell_of[t] = cell
        cell_row[t] = t

    return kernel(place_elements, simd=False)


@cache
def sort_places():
    """Pass over rows in order of their cells: where each cell starts, and places in that order."""

    def sort_places(
        cell_of: wp.array(dtype=int),
        cell_row: wp.array(dtype=int),
        contact_place: wp.array(dtype=wp.vec3d),
        # written
        cell_place: wp.array(dtype=wp.vec3d),
        cell_start: wp.array(dtype=int),
        rows: int,
        cells: int,
    ):
        at = wp.tid()
        cell_place[at] = contact_place[cell_row[at]]
        before = int(-1)  # noqa: UP018, RUF046
        if at > 0:
            before = cell_of[at - 1]
        for cell in range(before + 1, cell_of[at] + 1):
            cell_start[cell] = at
        if at == rows - 1:
            for cell in range(cell_of[at] + 1, cells + 1):
                cell_start[cell] = rows

    return kernel(sort_places, simd=False)


@cache
def part_pairs(s: Laws, k: Laws, is_periodic: bool):
    """Pass over listed bonds: unlinked pairs that are out of each other's reach, or have turned
    away from each other, part for good.

    Their faces have lost each other, so they have no closing stiffness any more, and touch as any
    two elements do. Their own law holds no energy then.
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
        listed_image: wp.array(dtype=int),
        # written
        closing_gap: wp.array(dtype=real),
        closing_stiffness: wp.array(dtype=real),
        skin: wp.float64,
        edges: wp.mat33d,
    ):
        t = wp.tid()
        b = listed[t]
        i = bond_i[b]
        j = bond_j[b]
        d = wp.vec3d()
        for axis in range(wp.static(k.dim)):
            at = wp.static(k.dim) * i + axis
            to = wp.static(k.dim) * j + axis
            d[axis] = contact_position[to] - contact_position[at]
            d[axis] += wp.float64(displacement[to]) - wp.float64(displacement[at])
        if wp.static(is_periodic):
            image = wp.vec3d()
            for axis in range(wp.static(k.dim)):
                image[axis] = wp.float64(listed_image[wp.static(k.dim) * t + axis])
            d += edges * image
        square = wp.dot(d, d)
        reach = wp.float64(contact_radius[i]) + wp.float64(contact_radius[j]) + skin
        gap = closing_gap[t]
        lost = gap > real(0.0) and gap < real(UNKNOWN) and square > reach * reach
        lost = lost or gap == real(TURNED)
        if lost and bond_linked[b] == real(0.0) and closing_stiffness[t] != real(0.0):
            closing_stiffness[t] = real(0.0)
            closing_gap[t] = real(PARTED)

    return kernel(part_pairs, simd=False)


@cache
def find_neighbours(s: Laws, k: Laws, has_parting: bool, is_periodic: bool):
    """Pass over rows in order of their cells: count their neighbours, and note as many as there is
    room for.

    has_parting: pairs that bonds joined may have parted, and are listed then.
    """
    real, image = s.real, images()

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

    @wp.func
    def around(cell: int, offset: int, cells: int) -> int:
        """The cell before, at or after one; of one or two cells along an axis each is met once."""
        c = cell + offset
        if cells > 2:
            c -= 1
        return wp.where(c < 0, c + cells, wp.where(c >= cells, c - cells, c))

    def find_neighbours(
        cell_of: wp.array(dtype=int),
        cell_row: wp.array(dtype=int),
        cell_place: wp.array(dtype=wp.vec3d),
        cell_start: wp.array(dtype=int),
        contact_elements: wp.array(dtype=int),
        contact_radius: wp.array(dtype=k.real),
        bonded_start: wp.array(dtype=int),
        bonded: wp.array(dtype=int),
        bonded_listed: wp.array(dtype=int),
        closing_stiffness: wp.array(dtype=real),
        found_start: wp.array(dtype=int),
        # written
        found: wp.array(dtype=int),
        neighbour_count: wp.array(dtype=int),
        any_over: wp.array(dtype=int),
        greatest: wp.float64,
        skin: wp.float64,
        cells: wp.vec3i,
        edges: wp.mat33d,
        to_shares: wp.mat33d,
    ):
        own = wp.tid()
        t = cell_row[own]
        x = cell_place[own]
        radius = wp.float64(contact_radius[contact_elements[t]])
        farthest = (radius + greatest + skin) * (radius + greatest + skin)
        first = found_start[t]
        room = found_start[t + 1] - first
        count = int(0)  # noqa: UP018, RUF046  a literal could not be added to in a loop
        cx = cell_of[own] % cells[0]
        cy = (cell_of[own] // cells[0]) % cells[1]
        cz = cell_of[own] // (cells[0] * cells[1])
        # cells side by side along the first axis are one run, but where they wrap round
        is_inner = cx > 0 and cx < cells[0] - 1
        runs = wp.where(is_inner, 1, wp.min(cells[0], 3))
        length = wp.where(is_inner, 3, 1)
        for oz in range(wp.min(cells[2], 3)):
            z = around(cz, oz, cells[2])
            for oy in range(wp.min(cells[1], 3)):
                line = cells[0] * (z * cells[1] + around(cy, oy, cells[1]))
                for ox in range(runs):
                    cell = line + around(cx, ox, cells[0])
                    for at in range(cell_start[cell], cell_start[cell + length]):
                        d = cell_place[at] - x
                        if wp.static(is_periodic):
                            d += edges * image.nearest(d, to_shares)
                        square = wp.dot(d, d)
                        if square <= farthest and at != own:
                            j = contact_elements[cell_row[at]]
                            reach = radius + wp.float64(contact_radius[j]) + skin
                            if square <= reach * reach and not are_bonded(
                                t, j, bonded_start, bonded, bonded_listed, closing_stiffness
                            ):
                                if count < room:
                                    found[first + count] = j
                                count += 1
        neighbour_count[t] = count
        if count > room:
            any_over[0] = 1

    return kernel(find_neighbours, simd=False)


@cache
def list_neighbours(k: Laws, is_periodic: bool):
    """Pass over elements that may touch: write their neighbours down in order of their ids, and the
    ways to them in the reference state."""
    image = images()

    def list_neighbours(
        contact_elements: wp.array(dtype=int),
        contact_position: wp.array(dtype=wp.float64),
        displacement: wp.array(dtype=k.real),
        found_start: wp.array(dtype=int),
        found: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        # written
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=k.real),
        contact_image: wp.array(dtype=int),
        period: wp.vec3d,
        to_shares: wp.mat33d,
    ):
        t = wp.tid()
        i = contact_elements[t]
        first = contact_start[t]
        count = contact_start[t + 1] - first
        for n in range(count):
            j = found[found_start[t] + n]
            at = first + n
            while at > first and contact_neighbour[wp.max(at - 1, 0)] > j:
                contact_neighbour[at] = contact_neighbour[at - 1]
                at -= 1
            contact_neighbour[at] = j
        for e in range(first, first + count):
            j = contact_neighbour[e]
            gone = wp.vec3d()
            moved = wp.vec3d()
            for axis in range(wp.static(k.dim)):
                own = wp.static(k.dim) * i + axis
                to = wp.static(k.dim) * j + axis
                gone[axis] = contact_position[to] - contact_position[own]
                moved[axis] = wp.float64(displacement[to]) - wp.float64(displacement[own])
            if wp.static(is_periodic):
                shift = image.nearest(gone + moved, to_shares)
                gone += wp.cw_mul(period, shift)
                for axis in range(wp.static(k.dim)):
                    contact_image[wp.static(k.dim) * e + axis] = int(shift[axis])
            for axis in range(wp.static(k.dim)):
                contact_reference[wp.static(k.dim) * e + axis] = k.real(gone[axis])

    return kernel(list_neighbours, simd=False)


@cache
def carry_over(s: Laws, touch: Touch):
    """Pass over elements that may touch: what the old list knew of their pairs (debts, springs,
    ages, pulls of dashpots, welds) goes over to the new one."""
    real = s.real

    def carry_over(
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        old_start: wp.array(dtype=int),
        old_neighbour: wp.array(dtype=int),
        old_debt: wp.array(dtype=real),
        old_spring: wp.array(dtype=real),
        old_theta: wp.array(dtype=wp.float64),
        old_dashpot: wp.array(dtype=real),
        old_roll: wp.array(dtype=real),
        old_welded: wp.array(dtype=int),
        old_pressed: wp.array(dtype=real),
        old_worked: wp.array(dtype=real),
        # written
        contact_impulse: wp.array(dtype=real),
        contact_opened: wp.array(dtype=int),
        contact_debt: wp.array(dtype=real),
        contact_spring: wp.array(dtype=real),
        contact_theta: wp.array(dtype=wp.float64),
        contact_dashpot: wp.array(dtype=real),
        contact_roll: wp.array(dtype=real),
        contact_welded: wp.array(dtype=int),
        contact_pressed: wp.array(dtype=real),
        contact_worked: wp.array(dtype=real),
        weld_event: wp.array(dtype=int),
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
            dashpot = real(0.0)
            roll = s.no_spin()
            if known:
                debt = old_debt[at]
                if wp.static(touch.rubs):
                    spring = s.load(old_spring, at)
                if wp.static(touch.ages):
                    theta = old_theta[at]
                if wp.static(touch.damps):
                    dashpot = old_dashpot[at]
                if wp.static(touch.rolls):
                    roll = s.load_spin(old_roll, at)
            contact_debt[e] = debt
            contact_impulse[e] = real(0.0)
            if wp.static(touch.bounces):
                contact_opened[e] = 0
            if wp.static(touch.rubs):
                s.store(contact_spring, e, spring)
            if wp.static(touch.ages):
                contact_theta[e] = theta
            if wp.static(touch.damps):
                contact_dashpot[e] = dashpot
            if wp.static(touch.rolls):
                s.store_spin(contact_roll, e, roll)
            if wp.static(touch.welds):
                weld_event[e] = 0
                contact_welded[e] = 0
                contact_pressed[e] = real(0.0)
                contact_worked[e] = real(0.0)
                if known:
                    contact_welded[e] = old_welded[at]
                    contact_pressed[e] = old_pressed[at]
                    contact_worked[e] = old_worked[at]

    return kernel(carry_over, simd=False)


@cache
def hand_over(s: Laws):
    """Pass over elements that may touch: pairs that have just parted owe what they owed as faces.

    Nothing else changes: turned faces are spheres already, and those out of reach do not touch.
    """
    real = s.real

    def hand_over(
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        bonded_start: wp.array(dtype=int),
        bonded: wp.array(dtype=int),
        bonded_listed: wp.array(dtype=int),
        closing_gap: wp.array(dtype=real),
        closing_debt: wp.array(dtype=real),
        # written
        contact_debt: wp.array(dtype=real),
    ):
        t = wp.tid()
        for n in range(bonded_start[t], bonded_start[t + 1]):
            listed = wp.max(bonded_listed[n], 0)
            if bonded_listed[n] >= 0 and closing_gap[listed] == real(PARTED):
                for e in range(contact_start[t], contact_start[t + 1]):
                    if contact_neighbour[e] == bonded[n]:
                        contact_debt[e] = closing_debt[listed]

    return kernel(hand_over, simd=False)

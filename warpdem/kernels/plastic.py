"""Plastic flow: radial return of element stresses, and the slips it leaves in bonds (Shilko 9-12).

A slip moves the anchors of a bond's spring (theory B6): what flows is the reference state, so the
forces remain the derivative of an energy. The whole traction is returned, f' = f - k dp, by the
factor M = 1 - 3 G dp/q of both elements and towards their shared mean stress.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from .algebra import Laws, narrow
from .evm import evm, evm_kinematics
from .face import Faces, face
from .facet import facet
from .fracture import pair_tensor
from .memory import get, kernel, nn, put
from .stress import average_stress


class Flow(NamedTuple):
    """The form of a yield law; its numbers are arguments."""

    hardening: str  # "linear", "voce", "power" or "table"
    rate: str  # "", "perzyna" or "johnson_cook"
    has_friction: bool


@cache
def numbers_type(s: Laws):
    """Numbers of a law: yield stress, three of hardening, two of rate, friction, dilatancy."""
    return wp.types.vector(8, s.real)


@cache
def hardening(s: Laws, kind: str):
    """Flow stress at no rate, and its slope, at a plastic strain [Pa]."""
    real, law = s.real, numbers_type(s)

    if kind == "linear":

        @wp.func
        def linear(x: law, p: real, strains: wp.array(dtype=real), stresses: wp.array(dtype=real)):
            return x[0] + x[1] * p, x[1]

        return linear

    if kind == "voce":

        @wp.func
        def voce(x: law, p: real, strains: wp.array(dtype=real), stresses: wp.array(dtype=real)):
            left = wp.exp(-x[2] * p)
            return x[0] + x[1] * (real(1.0) - left) + x[3] * p, x[1] * x[2] * left + x[3]

        return voce

    if kind == "power":
        least = real(1.0e-30)

        @wp.func
        def power(x: law, p: real, strains: wp.array(dtype=real), stresses: wp.array(dtype=real)):
            q = p + x[3]
            grown = wp.pow(q, x[2])
            slope = x[1] * x[2] * grown / wp.max(q, least)
            return x[0] + x[1] * (grown - wp.pow(x[3], x[2])), slope

        return power

    @wp.func
    def table(x: law, p: real, strains: wp.array(dtype=real), stresses: wp.array(dtype=real)):
        first = int(x[1])
        last = first + int(x[2]) - 1
        if p >= strains[last]:
            return x[0] + stresses[last], real(0.0)
        at = first
        while at + 2 <= last and strains[at + 1] <= p:
            at += 1
        slope = (stresses[at + 1] - stresses[at]) / (strains[at + 1] - strains[at])
        return x[0] + stresses[at] + slope * (p - strains[at]), slope

    return table


@cache
def flow_stress(s: Laws, flow: Flow):
    """Flow stress after a growth of the plastic strain in dt, and its slope in that growth."""
    real, law, slow = s.real, numbers_type(s), hardening(s, flow.hardening)
    least = real(1.0e-30)

    @wp.func
    def flowing(
        x: law,
        p: real,
        grown: real,
        dt: real,
        strains: wp.array(dtype=real),
        stresses: wp.array(dtype=real),
    ):
        stress, slope = slow(x, p + grown, strains, stresses)
        if wp.static(flow.rate == "perzyna"):
            over = wp.pow(x[4] * grown / dt, real(1.0) / x[5])
            steep = over / (x[5] * wp.max(grown, least))
            return stress * (real(1.0) + over), slope * (real(1.0) + over) + stress * steep
        if wp.static(flow.rate == "johnson_cook"):
            ratio = grown / (dt * x[5])
            over = wp.where(ratio > real(1.0), x[4] * wp.log(wp.max(ratio, least)), real(0.0))
            steep = wp.where(ratio > real(1.0), x[4] / wp.max(grown, least), real(0.0))
            return stress * (real(1.0) + over), slope * (real(1.0) + over) + stress * steep
        return stress, slope

    return flowing


@cache
def returns(s: Laws, flow: Flow) -> Laws:
    """How far a stress beyond the flow stress returns: implicit in hardening and rate."""
    real, law, flowing = s.real, numbers_type(s), flow_stress(s, flow)
    close = real(1e-15 if s.real is wp.float64 else 1e-7)
    two_thirds = real(2.0 / 3.0)
    far = real(1e3)  # softening to a thousandth of the flow stress is within bounds

    @wp.func
    def growth(
        x: law,
        trial: real,
        stiffness: real,
        greatest: real,
        p: real,
        dt: real,
        strains: wp.array(dtype=real),
        stresses: wp.array(dtype=real),
    ) -> real:
        """Growth of the plastic strain: trial - stiffness growth = flow stress, by Newton's method
        kept between bounds."""
        start, slope = flowing(x, p, real(0.0), dt, strains, stresses)
        if trial <= start:
            return real(0.0)
        low = real(0.0)
        high = greatest
        at = real(0.0)
        excess = trial - start
        for _n in range(200):
            last = excess
            better = at + excess / (stiffness + slope)
            if not (better > low and better < high):
                better = real(0.5) * (low + high)
            stress, slope = flowing(x, p, better, dt, strains, stresses)
            excess = trial - stiffness * better - stress
            if wp.abs(excess) > real(0.5) * wp.abs(last):  # Newton's method gains too little
                at = real(0.5) * (low + high)
                stress, slope = flowing(x, p, at, dt, strains, stresses)
                excess = trial - stiffness * at - stress
            else:
                at = better
            if excess > real(0.0):
                low = at
            else:
                high = at
            if wp.abs(excess) <= close * trial or high - low <= close * high:
                break
        return at

    if not flow.has_friction:

        @wp.func
        def solid_growth(
            x: law,
            q: real,
            m: real,
            stiffness: real,
            bulk: real,
            p: real,
            dt: real,
            strains: wp.array(dtype=real),
            stresses: wp.array(dtype=real),
        ) -> real:
            """Growth of the plastic strain in space and in plane strain: q falls by 3 G of it."""
            return growth(x, q, stiffness, q / stiffness, p, dt, strains, stresses)
    else:

        @wp.func
        def solid_growth(
            x: law,
            q: real,
            m: real,
            stiffness: real,
            bulk: real,
            p: real,
            dt: real,
            strains: wp.array(dtype=real),
            stresses: wp.array(dtype=real),
        ) -> real:
            """As of von Mises, with q + alpha m in place of q: m falls by K dilatancy."""
            friction = x[6]
            dilating = friction * x[7] * bulk
            both = stiffness + dilating
            greatest = wp.max(q + friction * m, real(0.0)) / both
            grown = growth(x, q + friction * m, both, greatest, p, dt, strains, stresses)
            if stiffness * grown <= q:
                return grown
            # the cone's tip, where no deviator is left
            if dilating == real(0.0):
                return q / stiffness
            greatest = wp.max(friction * m, real(0.0)) / dilating
            return growth(x, friction * m, dilating, greatest, p, dt, strains, stresses)

    @wp.func
    def kept(p2: real, d2: real, two_shear: real, area_modulus: real, at: real) -> real:
        """Q(L), the stress intensity left in plane stress."""
        mh = real(1.0) / (real(1.0) + area_modulus * at)
        md = real(1.0) / (real(1.0) + two_shear * at)
        return wp.sqrt(p2 * p2 * mh * mh + real(3.0) * d2 * d2 * md * md)

    @wp.func
    def fall(
        p2: real, d2: real, two_shear: real, area_modulus: real, at: real, q: real, slope: real
    ) -> real:
        """-d(Q - flow stress)/dL."""
        mh = real(1.0) / (real(1.0) + area_modulus * at)
        md = real(1.0) / (real(1.0) + two_shear * at)
        squares = p2 * p2 * area_modulus * mh * mh * mh
        squares += real(3.0) * d2 * d2 * two_shear * md * md * md
        return squares / q + slope * two_thirds * (q - at * squares / q)

    @wp.func
    def plane_growth(
        x: law,
        p2: real,
        d2: real,
        two_shear: real,
        area_modulus: real,
        p: real,
        dt: real,
        strains: wp.array(dtype=real),
        stresses: wp.array(dtype=real),
    ) -> real:
        """L of the return in plane stress (theory B7): Q(L) is the flow stress.

        Q^2 = (p2 Mh)^2 + 3 (d2 Md)^2 with Mh = 1/(1 + A1 L), Md = 1/(1 + 2G L); p grows by
        2/3 L Q.
        """
        start, slope = flowing(x, p, real(0.0), dt, strains, stresses)
        excess = wp.sqrt(p2 * p2 + real(3.0) * d2 * d2) - start
        if excess <= real(0.0):
            return real(0.0)
        trial = excess + start
        low = real(0.0)
        high = far * trial / (start * wp.min(two_shear, area_modulus))
        at = real(0.0)
        q = trial
        for _n in range(200):
            last = excess
            better = at + excess / fall(p2, d2, two_shear, area_modulus, at, q, slope)
            if not (better > low and better < high):
                better = real(0.5) * (low + high)
            q = kept(p2, d2, two_shear, area_modulus, better)
            stress, slope = flowing(x, p, two_thirds * better * q, dt, strains, stresses)
            excess = q - stress
            at = better
            if wp.abs(excess) > real(0.5) * wp.abs(last):  # Newton's method gains too little
                at = real(0.5) * (low + high)
                q = kept(p2, d2, two_shear, area_modulus, at)
                stress, slope = flowing(x, p, two_thirds * at * q, dt, strains, stresses)
                excess = q - stress
            if excess > real(0.0):
                low = at
            else:
                high = at
            if wp.abs(excess) <= close * trial or high - low <= close * high:
                break
        return at

    return Laws(solid_growth=solid_growth, kept=kept, plane_growth=plane_growth)


@cache
def radial_return(
    s: Laws,
    k: Laws,
    faces: Faces,
    slots: int,
    plane: str | None,
    flow: Flow,
    simd: bool = True,
):
    """Pass over elements of one yield law: their growth of plastic strain, and what bonds need.

    return_loss 1 - M, the share of the deviator that is lost, kept as such so that its rounding is
    its own; return_growth, the strain by which all directions of the plane or of space grow;
    return_mean, in plane stress, the mean (sigma_xx + sigma_yy)/2 beside which the deviator is.
    """
    real, law, back = s.real, numbers_type(s), returns(s, flow)
    two_thirds = real(2.0 / 3.0)
    average, measure = average_stress(s, k, faces, slots), pair_tensor(s)

    def radial_return(
        # model
        flow_elements: wp.array(dtype=int),
        incidence: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        element_coupling: wp.array(dtype=real),
        hardening_strain: wp.array(dtype=real),
        hardening_stress: wp.array(dtype=real),
        # state read
        orientation: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        # written
        plastic_strain: wp.array(dtype=real),
        plastic_strain_zz: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        return_loss: wp.array(dtype=real),
        return_mean: wp.array(dtype=real),
        return_growth: wp.array(dtype=real),
        numbers: law,
        dt: real,
        first: int,
        elements: int,
    ):
        i = flow_elements[wp.tid() + first]
        t = average(i, incidence, bond_arm, element_volume, orientation, end_force, elements)
        two_shear = get(element_two_shear, i)
        p = get(plastic_strain, i)
        if wp.static(plane == "stress"):
            p2 = real(0.5) * (t[0, 0] + t[1, 1])
            half = real(0.5) * (t[0, 0] - t[1, 1])
            d2 = wp.sqrt(half * half + t[0, 1] * t[0, 1])
            a1 = two_shear / (real(3.0) - real(2.0) * get(element_coupling, i))
            x = back.plane_growth(
                numbers, p2, d2, two_shear, a1, p, dt, hardening_strain, hardening_stress
            )
            mh = real(1.0) / (real(1.0) + a1 * x)
            grown = x * p2 * mh / real(3.0)
            put(plastic_strain, i, p + two_thirds * x * back.kept(p2, d2, two_shear, a1, x))
            put(plastic_dilation, i, get(plastic_dilation, i) + real(2.0) * grown)
            put(return_loss, i, two_shear * x / (real(1.0) + two_shear * x))
            put(return_mean, i, p2)
            put(return_growth, i, grown)
        else:
            if wp.static(plane == "strain"):
                t[2, 2] = get(volume_stress, i) - two_shear * get(plastic_strain_zz, i)
            m = measure.mean_stress(t)
            q = measure.von_mises(t)
            stiffness = real(1.5) * two_shear
            bulk = two_shear / (real(3.0) * (real(1.0) - get(element_coupling, i)))
            x = back.solid_growth(
                numbers, q, m, stiffness, bulk, p, dt, hardening_strain, hardening_stress
            )
            loss = real(0.0)
            if x > real(0.0):
                loss = wp.min(stiffness * x / q, real(1.0))
            put(plastic_strain, i, p + x)
            put(return_loss, i, loss)
            grown = real(0.0)
            if wp.static(flow.has_friction):
                grown = numbers[7] * x / real(3.0)
                put(plastic_dilation, i, get(plastic_dilation, i) + numbers[7] * x)
                put(return_growth, i, grown)
            if wp.static(plane == "strain"):
                zz = loss * (t[2, 2] - m) / two_shear + grown
                put(plastic_strain_zz, i, get(plastic_strain_zz, i) + zz)

    return kernel(radial_return, simd)


@cache
def slip(s: Laws, k: Laws) -> Laws:
    """How a slip moves a bond's anchors, what it takes, what it does to forces (theory B2a, B6)."""
    real, widened, narrowed = s.real, narrow(k, s), narrow(s, k)

    @wp.func
    def carried(element: int, x: s.vec, orientation: wp.array(dtype=k.real)) -> k.vec:
        """A vector in the frame that an element carries."""
        y = widened(x)
        return y + k.turn_back(k.load_rot(orientation, element), y)

    @wp.func
    def books(
        b: int,
        element: int,
        p: s.vec,
        after: s.vec,
        orientation: wp.array(dtype=k.real),
        spring_force: wp.array(dtype=real),
    ) -> wp.float64:
        """What slip p takes: p.(f'_n + f'_{n-1})/2, the last step's force turned as the element has
        turned since, or a dilating body that turns would show an error of first order in dt."""
        last = widened(s.load(spring_force, b))
        before = narrowed(last + k.turn(k.load_rot(orientation, element), last))
        return wp.float64(real(0.5) * wp.dot(p, after + before))

    @wp.func
    def store(
        end: int,
        element: int,
        own: s.vec,
        orientation: wp.array(dtype=k.real),
        slips: wp.array(dtype=k.real),
    ):
        """Add `own` to the slip, or tilt, of one end, kept in the frame of its element."""
        k.store(slips, end, k.load(slips, end) + carried(element, own, orientation))

    @wp.func
    def change_ends(
        b: int,
        pi: s.vec,
        pj: s.vec,
        lost: s.vec,
        after: s.vec,
        yi: s.vec,
        yj: s.vec,
        bond_place: wp.array(dtype=int),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
    ):
        """Forces and torques of bond b after its anchors, before at yi and yj from the centres,
        moved by pi and pj, which took `lost` of the force."""
        at_i = nn(get(bond_place, 2 * b))
        at_j = nn(get(bond_place, 2 * b + 1))
        s.store(end_force, at_i, s.load(end_force, at_i) - lost)
        s.store(end_force, at_j, s.load(end_force, at_j) + lost)
        ti = s.load_spin(end_torque, at_i) - s.cross(yi, lost) + s.cross(pi, after)
        tj = s.load_spin(end_torque, at_j) + s.cross(yj, lost) - s.cross(pj, after)
        s.store_spin(end_torque, at_i, ti)
        s.store_spin(end_torque, at_j, tj)

    return Laws(carried=carried, books=books, store=store, change_ends=change_ends)


@cache
def facet_slip(
    s: Laws,
    k: Laws,
    faces: Faces,
    has_dilation: bool,
    evaluates_anew: bool,
    simd: bool = True,
):
    """Pass over facet bonds: slips of this step, the forces after them, the energy they take.

    Velocity Verlet loses in a step exactly dp.(f'_n + f'_{n-1})/2, f' the spring's force after the
    slip (theory B6). Forces are changed here unless all are evaluated anew.
    """
    geometry, law, moved, real = face(s, k, faces), facet(s), slip(s, k), s.real
    narrowed = narrow(s, k)

    def facet_slip(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        bond_area: wp.array(dtype=real),
        # state read
        facet_stiffness: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        return_mean: wp.array(dtype=real),
        return_loss: wp.array(dtype=real),
        return_growth: wp.array(dtype=real),
        # written
        bond_slip: wp.array(dtype=k.real),
        spring_force: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        bond_dissipation: wp.array(dtype=wp.float64),
    ):
        b = nn(wp.tid())
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        delta, yi, yj = geometry.load_anchors(
            b, bond_i, bond_j, bond_arm, bond_jump, bond_slip, displacement, orientation
        )
        stiffness = get(facet_stiffness, b)
        after = law.force(stiffness, delta)
        wi, wj = geometry.load_weights(b, bond_arm)
        own = wp.where(wi > real(0.0), i, j)  # not a node, which does not turn
        loss = wi * get(return_loss, i) + wj * get(return_loss, j)
        grown = real(0.0)
        if wp.static(has_dilation):
            grown = wi * get(return_growth, i) + wj * get(return_growth, j)
        if stiffness > real(0.0) and (loss > real(0.0) or grown != real(0.0)):
            ni, nj = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
            n = wp.normalize(wi * ni + wj * nj)
            mean = wi * get(return_mean, i) + wj * get(return_mean, j)
            whole = s.load(end_force, nn(get(bond_place, 2 * b))) - (get(bond_area, b) * mean) * n
            lost = loss * whole
            if wp.static(has_dilation):
                lost += (stiffness * geometry.load_distance(b, bond_arm) * grown) * n
            p = lost / stiffness
            after = after - lost
            put(
                bond_dissipation,
                b,
                get(bond_dissipation, b) + moved.books(b, own, p, after, orientation, spring_force),
            )
            # each anchor by its weight, opposite ways: of a face with a node the element's alone,
            # as a node does not turn
            moved.store(nn(2 * b), i, wi * p, orientation, bond_slip)
            moved.store(nn(2 * b + 1), j, -wj * p, orientation, bond_slip)
            if wp.static(not evaluates_anew):
                moved.change_ends(
                    b, wi * p, -wj * p, lost, after, yi, yj, bond_place, end_force, end_torque
                )
        s.store(spring_force, b, narrowed(moved.carried(own, after, orientation)))

    return kernel(facet_slip, simd)


@cache
def evm_slips(s: Laws, k: Laws, faces: Faces, has_dilation: bool, simd: bool = True):
    """Pass over EVM bonds: as of facet bonds; what slips is their rest state (theory B6, hybrid).

    The length at rest grows by up, the ends' axes tilt by lp/a; the factor D/a of the transverse
    part belongs to the moment arm of a strained bond. The books take force and slip along the bond
    and across it each for itself, as these turn against the elements that carry the tilts.
    """
    kinematics, law, real = evm_kinematics(s, k, True), evm(s), s.real
    geometry, moved, narrowed = face(s, k, faces), slip(s, k), narrow(s, k)

    def evm_slips(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_area: wp.array(dtype=real),
        evm_direction: wp.array(dtype=k.real),
        evm_length: wp.array(dtype=k.real),
        evm_offset: wp.array(dtype=k.real),
        # state read
        evm_stiffness: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        return_mean: wp.array(dtype=real),
        return_loss: wp.array(dtype=real),
        return_growth: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        # written
        evm_slip: wp.array(dtype=real),
        evm_tilt: wp.array(dtype=k.real),
        spring_force: wp.array(dtype=real),
        spring_pull: wp.array(dtype=real),
        bond_dissipation: wp.array(dtype=wp.float64),
        first_evm: int,
    ):
        c = nn(wp.tid())
        b = nn(c + first_evm)
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        x = kinematics.load_flowed(
            b,
            c,
            bond_i,
            bond_j,
            evm_direction,
            evm_length,
            evm_offset,
            evm_slip,
            evm_tilt,
            displacement,
            orientation,
        )
        stiffness = law.load_stiffness(evm_stiffness, c)
        a = real(get(evm_length, c))
        # forces against slips along the bond and, of the tilts of both ends, across it
        pull = stiffness[0] * x.elongation
        shear = (-real(0.5) * stiffness[1] / a) * (x.bend_i + x.bend_j)
        wi, wj = geometry.load_weights(b, bond_arm)
        loss = wi * get(return_loss, i) + wj * get(return_loss, j)
        grown = real(0.0)
        if wp.static(has_dilation):
            grown = wi * get(return_growth, i) + wj * get(return_growth, j)
        if stiffness[0] > real(0.0) and (loss > real(0.0) or grown != real(0.0)):
            n = x.d
            mean = wi * get(return_mean, i) + wj * get(return_mean, j)
            whole = s.load(end_force, nn(get(bond_place, 2 * b))) - (get(bond_area, b) * mean) * n
            lost = loss * whole
            if wp.static(has_dilation):
                lost += (stiffness[0] * geometry.load_distance(b, bond_arm) * grown) * n
            along = wp.dot(lost, n)
            longer = along / stiffness[0]
            pull = pull - along
            put(evm_slip, c, get(evm_slip, c) + longer)
            taken = wp.float64(real(0.5) * longer * (pull + get(spring_pull, c)))
            if stiffness[1] > real(0.0):  # B2 = c_D a^2
                across = (x.length * a / stiffness[1]) * (lost - along * n)
                shear = shear - (stiffness[1] / (a * a)) * across
                taken += moved.books(b, i, across, shear, orientation, spring_force)
                moved.store(nn(2 * c), i, across / a, orientation, evm_tilt)
                moved.store(nn(2 * c + 1), j, across / a, orientation, evm_tilt)
            put(bond_dissipation, b, get(bond_dissipation, b) + taken)
        put(spring_pull, c, pull)
        s.store(spring_force, b, narrowed(moved.carried(i, shear, orientation)))

    return kernel(evm_slips, simd)


@cache
def dilation_books(s: Laws, simd: bool = True):
    """Pass over elements that flow: the energy that plastic change of volume took (theory B7)."""
    real = s.real

    def dilation_books(
        # model
        flow_elements: wp.array(dtype=int),
        element_volume: wp.array(dtype=real),
        # state read
        volume_stress: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        # written
        last_volume_stress: wp.array(dtype=real),
        last_dilation: wp.array(dtype=real),
        element_dissipation: wp.array(dtype=wp.float64),
    ):
        i = flow_elements[wp.tid()]
        g = get(volume_stress, i)
        p = get(plastic_dilation, i)
        mean = real(0.5) * (g + get(last_volume_stress, i))
        put(
            element_dissipation,
            i,
            get(element_dissipation, i)
            + wp.float64(get(element_volume, i) * (p - get(last_dilation, i)) * mean),
        )
        put(last_volume_stress, i, g)
        put(last_dilation, i, p)

    return kernel(dilation_books, simd)

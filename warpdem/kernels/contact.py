"""Elements that touch without a bond: normal spring, friction, books (theory B11).

Elements touch as spheres (discs in the plane). Each sums its own row of the list of neighbours;
what belongs to a pair is worked out in the same order from either side, so that both sides get the
same bits and momentum is exact. Velocity Verlet's work on a pair is the mean of the forces before
and after a step times its motion; what that leaves over, the pair owes, and pays when it closes or
opens (as in `closing`).
"""

from functools import cache
from math import pi, sqrt
from typing import NamedTuple

import warp as wp

from .algebra import Laws, narrow
from .closing import closing
from .friction import HOLDS
from .friction import friction as friction_law
from .memory import get, kernel, nn
from .weld import weld

OPPOSITE = 1e-8  # |n + n_before|^2 below which two normals are taken to oppose each other


class Touch(NamedTuple):
    """What contacts of a scene have, those of walls included."""

    is_hertz: bool = False
    rubs: bool = False
    ages: bool = False  # some friction has a state, that of rate and state
    bounces: bool = False  # restitution takes its share where they open
    damps: bool = False  # dashpots act while they last
    rolls: bool = False  # rolling, or twisting in space, is resisted
    by_kind: bool = False  # friction is that of what the elements are made of
    welds: bool = False  # pairs that are pressed weld
    is_periodic: bool = False


@cache
def contact(s: Laws, ages: bool = False) -> Laws:
    """Laws of two elements that touch, or of an element and a wall; ages: see `friction`."""
    real, vec, spin, holding = s.real, s.vec, s.spin, friction_law(s, ages)

    if s.dim == 2:

        @wp.func
        def area(radius: real, width: real) -> real:
            """S = 2 R b."""
            return real(2.0) * radius * width
    else:

        @wp.func
        def area(radius: real, width: real) -> real:
            """S = pi R^2."""
            return real(wp.static(pi)) * radius * radius

    @wp.func
    def half_turn(w: spin, dt: real) -> spin:
        """tan(|w| dt/2) along w: by it, c' - c is h x (c' + c) for a vector c that turns."""
        x = wp.min(real(0.5) * dt * wp.sqrt(s.spin_squared(w)), real(1.0))
        stretch = wp.where(x > real(1.0e-4), wp.tan(x) / wp.max(x, real(1.0e-4)), real(1.0))
        return (real(0.5) * dt * stretch) * w

    if s.dim == 2:

        @wp.func
        def twisted(spring: vec, n: vec, half: spin) -> vec:
            """In the plane nothing turns about n."""
            return spring
    else:

        @wp.func
        def twisted(spring: vec, n: vec, half: spin) -> vec:
            """Turned about n by the part of a turn that is along it."""
            t = wp.dot(n, half)
            return ((real(1.0) - t * t) * spring + real(2.0) * t * wp.cross(n, spring)) / (
                real(1.0) + t * t
            )

    @wp.func
    def carried(spring: vec, before: vec, n: vec, half: spin) -> vec:
        """A tangential vector as the pair turns: by the least rotation of the normal, then about
        it by the mean turn of both (theory B5). Exact in a rigid rotation.

        Across `before`, the least rotation is a reflection across before + n: it keeps the length
        of the spring however far the normal turns. Of opposite normals, of elements that have
        passed through each other's centre, there is no least one, and the spring stays.
        """
        mean = before + n
        square = wp.max(wp.dot(mean, mean), real(wp.static(OPPOSITE)))
        turned = spring - (real(2.0) * wp.dot(spring, mean) / square) * mean
        return twisted(turned - wp.dot(turned, n) * n, n, half)

    @wp.func
    def rub(
        spring: vec,
        before: vec,
        n: vec,
        arm_a: real,
        arm_b: real,
        motion: vec,
        wa: spin,
        wb: spin,
        stiffness: real,
        pull: real,
        mu: real,
        row: int,
        friction_numbers: wp.array(dtype=wp.float64),
        theta: wp.float64,
        dt: real,
    ):
        """Tangential spring after a step, the pair's state, and what its slip took [J].

        motion: of b's centre against a's; that of the two points that touch is less by the turns
        of their arms. mu: Coulomb's; row: of `friction_numbers`, the pairs' or a wall's.
        """
        ha = half_turn(wa, dt)
        hb = half_turn(wb, dt)
        turned = carried(spring, before, n, real(0.5) * (ha + hb))
        motion -= s.rotate(arm_a * ha + arm_b * hb, before + n)
        trial = turned + motion - wp.dot(motion, n) * n
        after, aged = holding.held(trial, pull, stiffness, mu, row, friction_numbers, theta, dt)
        taken = real(0.5) * stiffness * wp.dot(turned + after, trial - after)
        return after, aged, taken

    @wp.func
    def rolled(
        spring: spin,
        before: vec,
        n: vec,
        wa: spin,
        wb: spin,
        radius: real,
        stiffness: real,
        pull: real,
        rolling: real,
        twisting: real,
        dt: real,
    ):
        """Spring of rolling, across n, and twisting, along it, after a step [m], and what was
        taken [J]: an elastic and plastic one each (Ai et al. 2011, model C).

        It grows by the turn of b against a times the radius of rolling, 1/R = 1/R_a + 1/R_b; times
        k_t R it is the moment on a, held to `rolling` R N and `twisting` R N. In the plane nothing
        twists.
        """
        growth = radius * dt * (wb - wa)
        held = -rolling * pull / stiffness
        if wp.static(s.dim == 2):
            trial = spring + growth
            after = wp.clamp(trial, -held, held)
            taken = (spring + after) * (trial - after)
        else:
            mean = real(0.5) * (half_turn(wa, dt) + half_turn(wb, dt))
            along = wp.dot(spring, before)
            across = carried(spring - along * before, before, n, mean)
            more = wp.dot(growth, n)
            trial = across + growth - more * n
            rolls = holding.slid(trial, held)
            limit = -twisting * pull / stiffness
            twist = wp.clamp(along + more, -limit, limit)
            taken = wp.dot(across + rolls, trial - rolls)
            taken += (along + twist) * (along + more - twist)
            after = rolls + twist * n
        return after, real(0.5) * stiffness * taken

    return Laws(area=area, half_turn=half_turn, rub=rub, rolled=rolled)


@cache
def pressing(s: Laws, is_hertz: bool) -> Laws:
    """Normal law of a contact in its stiffness and its gap [m]: linear, or Hertz's of spheres."""
    real, linear = s.real, closing(s)

    if not is_hertz:

        @wp.func
        def against_wall(radius: real, area: real, compliance: real) -> real:
            """k = M S/R [N/m]."""
            return area / compliance

        @wp.func
        def viscosity(stiffness: real, gap: real, give: real, ratio: real) -> real:
            """c = 2 beta sqrt(k m) [N s/m], 1/m the give of both: a ratio of the critical one."""
            return real(2.0) * ratio * wp.sqrt(stiffness / give)

        return Laws(
            energy=linear.energy,
            pull=linear.pull,
            against_wall=against_wall,
            resisted=resisting(s, viscosity),
        )

    @wp.func
    def energy(stiffness: real, gap: real) -> real:
        """U = 2/5 k <-g>^(5/2), that is 8/15 E* sqrt(R) <-g>^(5/2)."""
        h = wp.max(-gap, real(0.0))
        return real(0.4) * stiffness * h * h * wp.sqrt(h)

    @wp.func
    def pull(stiffness: real, gap: real, slack: real) -> real:
        """-k <-g>^(3/2), k = 4/3 E* sqrt(R) [N/m^(3/2)]."""
        h = wp.max(slack - gap, real(0.0))
        return -stiffness * h * wp.sqrt(h)

    @wp.func
    def against_wall_hertz(radius: real, area: real, compliance: real) -> real:
        """k = 4/3 E* sqrt(R), 1/E* being the compliance."""
        return real(wp.static(4.0 / 3.0)) * wp.sqrt(radius) / compliance

    @wp.func
    def viscosity_hertz(stiffness: real, gap: real, give: real, ratio: real) -> real:
        """c = sqrt(5) beta sqrt(k m) h^(1/4) [N s/m]: in y = h^(5/4) and the time dt h^(1/4) the
        motion is that of the linear law, with its beta (Antypov and Elliott 2011)."""
        root = wp.sqrt(wp.max(-gap, real(0.0)))
        return real(wp.static(sqrt(5.0))) * ratio * wp.sqrt(stiffness * root / give)

    return Laws(
        energy=energy,
        pull=pull,
        against_wall=against_wall_hertz,
        resisted=resisting(s, viscosity_hertz),
    )


def resisting(s: Laws, viscosity):
    """Pull of the dashpot beside a contact's spring, of this viscosity."""
    real = s.real

    @wp.func
    def resisted(
        pull: real,
        stiffness: real,
        before: real,
        gap: real,
        speed: real,
        give: real,
        ratio: real,
        dt: real,
    ) -> real:
        """Pull [N] at the end of a step, which with the spring's never becomes a tension.

        speed: of the gap in the middle of the step [m/s]; what it is at the end both pulls on the
        pair alone decide, half a step being theirs. Where the pair came to touch within the step
        the dashpot has acted for less than one.
        """
        if gap >= real(0.0) or ratio == real(0.0) or give == real(0.0):
            return real(0.0)
        share = real(1.0)
        if before >= real(0.0):
            share = real(0.5) + gap / (gap - before)
        c = share * viscosity(stiffness, gap, give, ratio)
        half = real(0.5) * dt * give
        own = c * (speed - half * pull) / (real(1.0) + half * c)
        return wp.min(own, -pull)

    return resisted


@cache
def box(k: Laws, is_periodic: bool) -> Laws:
    """How a strained periodic box moves the image that an element touches.

    The columns of its array are how far its edges have moved [m]; a pair's image counts edges.
    """
    place = k.real

    if not is_periodic:

        @wp.func
        def no_shift(e: int, contact_image: wp.array(dtype=int), box: wp.array(dtype=place)):
            """Nothing has images."""
            return k.vec()

        return Laws(load_shift=no_shift)

    @wp.func
    def load_shift(e: int, contact_image: wp.array(dtype=int), box: wp.array(dtype=place)):
        """Of the image of the neighbour of entry e [m], from element to neighbour."""
        x = k.vec()
        for row in range(wp.static(k.dim)):
            for column in range(wp.static(k.dim)):
                edges = place(get(contact_image, wp.static(k.dim) * e + column))
                x[row] += get(box, wp.static(k.dim) * row + column) * edges
        return x

    return Laws(load_shift=load_shift)


@cache
def pair(s: Laws, k: Laws, is_hertz: bool = False, is_periodic: bool = False) -> Laws:
    """Geometry and stiffness of a listed pair, in the order of its ids whichever side asks."""
    sides = box(k, is_periodic)
    real, place, narrowed, law = s.real, k.real, narrow(s, k), contact(s)
    unit = k.vec(*[1.0 if axis == 0 else 0.0 for axis in range(k.dim)])

    @wp.func
    def load_distance(
        e: int,
        i: int,
        j: int,
        contact_reference: wp.array(dtype=place),
        contact_image: wp.array(dtype=int),
        contact_box: wp.array(dtype=place),
        displacement: wp.array(dtype=place),
    ) -> k.vec:
        """From the lower id to the higher [m]."""
        x = k.load(contact_reference, nn(e))
        if wp.static(is_periodic):
            x += sides.load_shift(e, contact_image, contact_box)
        if i > j:
            x = -x
        return x + (k.load(displacement, nn(wp.max(i, j))) - k.load(displacement, nn(wp.min(i, j))))

    @wp.func
    def load_box_motion(
        e: int,
        i: int,
        j: int,
        contact_image: wp.array(dtype=int),
        contact_box: wp.array(dtype=place),
        contact_box_before: wp.array(dtype=place),
    ) -> k.vec:
        """How far the box moves in a step what the pair touches of the higher id [m]."""
        x = sides.load_shift(e, contact_image, contact_box)
        x -= sides.load_shift(e, contact_image, contact_box_before)
        return wp.where(i > j, -x, x)

    @wp.func
    def normal(d: k.vec):
        """Unit normal and distance; of two elements at one place some direction."""
        r = wp.length(d)
        tiny = place(1.0e-30)
        return wp.where(r > tiny, d / wp.max(r, tiny), unit), r

    @wp.func
    def load_stiffness(
        a: int,
        b: int,
        contact_radius: wp.array(dtype=place),
        contact_width: wp.array(dtype=real),
        compliance: wp.array(dtype=real),
    ) -> real:
        """k = M S/r: the moduli in series, S of the harmonic mean of both radii."""
        ra = real(get(contact_radius, a))
        rb = real(get(contact_radius, b))
        width = wp.min(get(contact_width, a), get(contact_width, b))
        s_ab = law.area(real(2.0) * ra * rb / (ra + rb), width)
        return s_ab / (get(compliance, a) + get(compliance, b))

    load_normal_stiffness = load_stiffness
    if is_hertz:

        @wp.func
        def load_hertz(
            a: int,
            b: int,
            contact_radius: wp.array(dtype=place),
            contact_width: wp.array(dtype=real),
            compliance: wp.array(dtype=real),
        ) -> real:
            """k = 4/3 E* sqrt(R): compliances (1 - nu^2)/E in series, 1/R = 1/R_a + 1/R_b."""
            ra = real(get(contact_radius, a))
            rb = real(get(contact_radius, b))
            series = get(compliance, a) + get(compliance, b)
            return real(wp.static(4.0 / 3.0)) * wp.sqrt(ra * rb / (ra + rb)) / series

        load_normal_stiffness = load_hertz

    return Laws(
        load_distance=load_distance,
        load_box_motion=load_box_motion,
        normal=normal,
        load_stiffness=load_stiffness,
        load_normal_stiffness=load_normal_stiffness,
        narrowed=narrowed,
        widened=narrow(k, s),
    )


@cache
def contact_forces(s: Laws, k: Laws, touch: Touch, has_walls: bool = False):
    """Pass over elements that may touch: force and torque of all their contacts, into one slot.

    has_walls: walls add to the slot. It is cleared when the list is built, so that without walls
    rows that list nothing need no work.
    """
    real, place, law = s.real, k.real, contact(s, touch.ages)
    geometry = pair(s, k, touch.is_hertz, touch.is_periodic)
    own_law = pressing(s, touch.is_hertz)
    spring_law = weld(s, own_law)
    narrowed, widened = geometry.narrowed, geometry.widened

    def contact_forces(
        # model
        contact_elements: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=place),
        contact_image: wp.array(dtype=int),
        contact_radius: wp.array(dtype=place),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        contact_shear: wp.array(dtype=real),
        inverse_mass: wp.array(dtype=real),
        contact_kind: wp.array(dtype=int),
        friction_table: wp.array(dtype=real),
        friction_numbers: wp.array(dtype=wp.float64),
        # state read
        contact_box: wp.array(dtype=place),
        contact_box_before: wp.array(dtype=place),
        displacement: wp.array(dtype=place),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        # written
        contact_debt: wp.array(dtype=real),
        contact_opened: wp.array(dtype=int),
        contact_dashpot: wp.array(dtype=real),
        contact_roll: wp.array(dtype=real),
        contact_spring: wp.array(dtype=real),
        contact_theta: wp.array(dtype=wp.float64),
        slip_energy: wp.array(dtype=wp.float64),
        restitution_energy: wp.array(dtype=wp.float64),
        any_touched: wp.array(dtype=int),
        contact_moment: wp.array(dtype=real),
        contact_box_work: wp.array(dtype=wp.float64),
        contact_welded: wp.array(dtype=int),
        contact_pressed: wp.array(dtype=real),
        contact_worked: wp.array(dtype=real),
        weld_event: wp.array(dtype=int),
        weld_normal: wp.array(dtype=real),
        weld_shear: wp.array(dtype=real),
        weld_released: wp.array(dtype=real),
        weld_energy: wp.array(dtype=wp.float64),
        any_welded: wp.array(dtype=int),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        weld_pressure: real,
        weld_time: real,
        weld_work: real,
        weld_strength: real,
        friction: real,
        damping: real,
        rolling: real,
        twisting: real,
        dt: place,
        first_place: int,
        kinds: int,
    ):
        t = wp.tid()
        lists_nothing = contact_start[t] == contact_start[t + 1]
        if wp.static(not has_walls) and lists_nothing:
            return
        i = contact_elements[t]
        force = s.vec()
        torque = s.no_spin()
        moment = s.mat3()
        for e in range(contact_start[t], contact_start[t + 1]):
            j = contact_neighbour[e]
            a = wp.min(i, j)
            b = wp.max(i, j)
            d = geometry.load_distance(
                e, i, j, contact_reference, contact_image, contact_box, displacement
            )
            reach = contact_radius[a] + contact_radius[b]
            va = s.load(velocity, a)
            vb = s.load(velocity, b)
            motion = dt * (widened(vb) - widened(va))
            by_box = k.vec()
            if wp.static(touch.is_periodic):
                by_box = geometry.load_box_motion(
                    e, i, j, contact_image, contact_box, contact_box_before
                )
                motion += by_box
            d_before = d - motion
            near = wp.dot(d, d) < reach * reach
            was_near = wp.dot(d_before, d_before) < reach * reach
            was_welded = bool(False)  # noqa: UP018
            if wp.static(touch.welds):
                was_welded = contact_welded[e] != 0
            if near or was_near or was_welded:
                n_now, r = geometry.normal(d)
                n_then, r_before = geometry.normal(d_before)
                gap = real(r - reach)
                before = real(r_before - reach)
                n = narrowed(n_now)
                nb = narrowed(n_then)
                stiffness = geometry.load_normal_stiffness(
                    a, b, contact_radius, contact_width, contact_compliance
                )
                welded = was_welded
                pull = spring_law.pull(stiffness, gap, welded)
                resisted = real(0.0)  # by a dashpot, which a welded pair has none of
                resisted_before = real(0.0)
                if wp.static(touch.damps):
                    resisted_before = contact_dashpot[e]
                    if not was_welded:
                        give = wp.dot(n, wp.cw_mul(s.load(inverse_mass, a), n))
                        give += wp.dot(n, wp.cw_mul(s.load(inverse_mass, b), n))
                        speed = wp.dot(n, narrowed(motion)) / wp.max(real(dt), real(1.0e-30))
                        resisted = own_law.resisted(
                            pull, stiffness, before, gap, speed, give, damping, real(dt)
                        )
                    contact_dashpot[e] = resisted
                # the points that touch lie where the spheres' surfaces would, by their radii
                share = real(contact_radius[a] / reach)
                arm_a = share * real(r)
                arm_b = (real(1.0) - share) * real(r)
                arm = arm_b
                if i == a:
                    arm = arm_a
                shear = real(0.0)
                spring = s.vec()
                spring_before = s.vec()
                taken = real(0.0)
                if wp.static(touch.rubs or touch.rolls):
                    shear = geometry.load_stiffness(
                        a, b, contact_radius, contact_width, contact_shear
                    )
                    wa = s.load_spin(angular_velocity, a)
                    wb = s.load_spin(angular_velocity, b)
                if wp.static(touch.rubs):
                    theta = wp.float64(0.0)
                    if wp.static(touch.ages):
                        theta = contact_theta[e]
                    row = int(0)  # noqa: UP018, RUF046
                    mu = friction
                    if wp.static(touch.by_kind):
                        row = kinds * contact_kind[a] + contact_kind[b]
                        mu = friction_table[row]
                    spring_before = s.load(contact_spring, e)
                    if wp.static(touch.welds):
                        spring, theta, taken = law.rub(
                            spring_before, nb, n, arm_a, arm_b, narrowed(motion), wa, wb, shear,
                            real(-1.0), real(HOLDS), row, friction_numbers, theta, real(dt),
                        )  # fmt: skip
                        area = stiffness * (contact_compliance[a] + contact_compliance[b])
                        if was_welded and dt > place(0.0):
                            welded = not spring_law.breaks(
                                pull, shear * spring, area, weld_strength
                            )
                    if not welded:
                        pull = spring_law.pull(stiffness, gap, welded)
                        spring, theta, taken = law.rub(
                            spring_before, nb, n, arm_a, arm_b, narrowed(motion), wa, wb, shear,
                            pull + resisted, mu, row, friction_numbers, theta, real(dt),
                        )  # fmt: skip
                    if wp.static(touch.ages):
                        contact_theta[e] = theta
                    s.store(contact_spring, e, spring)
                if wp.static(touch.rolls):
                    radius = share * real(contact_radius[b])
                    roll, worn = law.rolled(
                        s.load_spin(contact_roll, e), nb, n, wa, wb, radius, shear,
                        wp.min(pull + resisted, real(0.0)), rolling, twisting, real(dt),
                    )  # fmt: skip
                    s.store_spin(contact_roll, e, roll)
                    slip_energy[t] = slip_energy[t] + wp.float64(0.5) * wp.float64(worn)
                    couple = (shear * radius) * roll
                    if i != a:
                        couple = -couple
                    torque += couple
                was = spring_law.pull(stiffness, before, was_welded)
                f = pull * n
                both = f + was * nb
                owed = spring_law.energy(stiffness, gap, welded)
                owed -= spring_law.energy(stiffness, before, was_welded)
                owed -= real(0.5) * wp.dot(both, narrowed(motion))
                if wp.static(touch.welds):
                    if was_welded and not welded:  # what both springs held goes
                        released = taken - owed
                        weld_energy[t] = weld_energy[t] + wp.float64(0.5) * wp.float64(released)
                        weld_event[e] = -1
                        weld_normal[e] = was / area
                        weld_shear[e] = shear * wp.length(spring_before) / area
                        weld_released[e] = released
                        any_welded[0] = 1
                        contact_welded[e] = 0
                        owed = real(0.0)
                        taken = real(0.0)
                    elif not was_welded and dt > place(0.0):
                        is_pressed = gap < real(0.0) and -pull >= weld_pressure * area
                        time = wp.where(is_pressed, contact_pressed[e] + real(dt), real(0.0))
                        worked = wp.where(is_pressed, contact_worked[e] + taken / area, real(0.0))
                        if is_pressed and time >= weld_time and worked >= weld_work:
                            contact_welded[e] = 1
                            weld_event[e] = 1
                            weld_normal[e] = pull / area
                            weld_shear[e] = shear * wp.length(spring) / area
                            weld_released[e] = real(0.0)
                            any_welded[0] = 1
                            time = real(0.0)
                            worked = real(0.0)
                        contact_pressed[e] = time
                        contact_worked[e] = worked
                contact_debt[e] = contact_debt[e] + owed
                if not was_welded and (gap < real(0.0)) != (before < real(0.0)):
                    any_touched[0] = 1
                    if wp.static(touch.bounces) and gap >= real(0.0):
                        contact_opened[e] = 1
                if wp.static(touch.damps):
                    across = resisted * n + resisted_before * nb
                    lost = real(0.25) * wp.dot(across, narrowed(motion))
                    restitution_energy[t] = restitution_energy[t] + wp.float64(lost)
                    f += resisted * n
                    both += across
                if wp.static(touch.rubs):
                    f += shear * spring
                    both += shear * (spring_before + spring)
                    slip_energy[t] = slip_energy[t] + wp.float64(0.5) * wp.float64(taken)
                    torque += arm * s.cross(n, shear * spring)
                if wp.static(touch.is_periodic):
                    done = real(0.25) * wp.dot(both, narrowed(by_box))
                    contact_box_work[t] = contact_box_work[t] + wp.float64(done)
                moment += arm * wp.outer(s.embed(n), s.embed(f))
                if i == a:
                    force += f
                else:
                    force -= f
        s.store_tensor(contact_moment, i, real(0.5) * (moment + wp.transpose(moment)))
        s.store(end_force, first_place + i, force)
        s.store_spin(end_torque, first_place + i, torque)

    return kernel(contact_forces, simd=False)


@cache
def contact_energies(s: Laws, k: Laws, touch: Touch):
    """Per element that may touch: half the energy of its pairs [J]."""
    real, place = s.real, k.real
    geometry = pair(s, k, touch.is_hertz, touch.is_periodic)
    spring_law = weld(s, pressing(s, touch.is_hertz))

    def contact_energies(
        # model
        contact_elements: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=place),
        contact_image: wp.array(dtype=int),
        contact_radius: wp.array(dtype=place),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        contact_shear: wp.array(dtype=real),
        # state read
        contact_box: wp.array(dtype=place),
        displacement: wp.array(dtype=place),
        contact_spring: wp.array(dtype=real),
        contact_roll: wp.array(dtype=real),
        contact_welded: wp.array(dtype=int),
        # written
        contact_energy: wp.array(dtype=real),
    ):
        t = wp.tid()
        i = contact_elements[t]
        energy = real(0.0)
        for e in range(contact_start[t], contact_start[t + 1]):
            j = contact_neighbour[e]
            d = geometry.load_distance(
                e, i, j, contact_reference, contact_image, contact_box, displacement
            )
            _n, r = geometry.normal(d)
            gap = real(r - (contact_radius[wp.min(i, j)] + contact_radius[wp.max(i, j)]))
            welded = bool(False)  # noqa: UP018
            if wp.static(touch.welds):
                welded = contact_welded[e] != 0
            if gap < real(0.0) or welded:
                stiffness = geometry.load_normal_stiffness(
                    i, j, contact_radius, contact_width, contact_compliance
                )
                energy += real(0.5) * spring_law.energy(stiffness, gap, welded)
                if wp.static(touch.rubs or touch.rolls):
                    shear = geometry.load_stiffness(
                        i, j, contact_radius, contact_width, contact_shear
                    )
                if wp.static(touch.rolls):
                    roll = s.load_spin(contact_roll, e)
                    energy += real(0.25) * shear * s.spin_squared(roll)
                if wp.static(touch.rubs):
                    spring = s.load(contact_spring, e)
                    energy += real(0.25) * shear * wp.dot(spring, spring)
        contact_energy[t] = energy

    return kernel(contact_energies, simd=False)


@cache
def opening(s: Laws, has_restitution: bool) -> Laws:
    """What restitution takes where a contact has opened."""
    real = s.real

    if has_restitution:

        @wp.func
        def has_opened(flags: wp.array(dtype=int), e: int) -> bool:
            """Whether the pair of entry e has opened just now."""
            return flags[e] != 0
    else:

        @wp.func
        def has_opened(flags: wp.array(dtype=int), e: int) -> bool:
            """Nobody asks."""
            return False

    @wp.func
    def bounced(speed: real, yield_both: real, debt: real, restitution: real) -> real:
        """What restitution takes of the motion along n [J], once the debt is paid."""
        has = real(0.0)
        if speed > real(0.0) and yield_both > real(0.0):
            has = wp.max(real(0.5) * speed * speed / yield_both - debt, real(0.0))
        return (real(1.0) - restitution * restitution) * has

    return Laws(has_opened=has_opened, bounced=bounced)


@cache
def contact_settle(s: Laws, k: Laws, touch: Touch):
    """Pass over elements that may touch: what their pairs owe is paid by impulses along n.

    Where a pair has opened, restitution takes the share 1 - e^2 of what its motion apart has.
    """
    real, place, spring_law = s.real, k.real, closing(s)
    geometry = pair(s, k, is_periodic=touch.is_periodic)
    narrowed, ends = geometry.narrowed, opening(s, touch.bounces)

    def contact_settle(
        # model
        contact_elements: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=place),
        contact_image: wp.array(dtype=int),
        inverse_mass: wp.array(dtype=real),
        # state read
        contact_box: wp.array(dtype=place),
        contact_box_after: wp.array(dtype=place),
        displacement: wp.array(dtype=place),
        velocity: wp.array(dtype=real),
        # written
        contact_debt: wp.array(dtype=real),
        contact_impulse: wp.array(dtype=real),
        contact_opened: wp.array(dtype=int),
        restitution_energy: wp.array(dtype=wp.float64),
        contact_box_work: wp.array(dtype=wp.float64),
        settling_impulse: wp.array(dtype=real),
        restitution: real,
        share: real,
        dt: place,
    ):
        t = wp.tid()
        i = contact_elements[t]
        total = s.vec()
        for e in range(contact_start[t], contact_start[t + 1]):
            last = contact_impulse[e]
            debt = contact_debt[e]
            opened = ends.has_opened(contact_opened, e)
            if last != real(0.0) or debt != real(0.0) or opened:
                j = contact_neighbour[e]
                a = wp.min(i, j)
                b = wp.max(i, j)
                d = geometry.load_distance(
                    e, i, j, contact_reference, contact_image, contact_box, displacement
                )
                n_now, _r = geometry.normal(d)
                n = narrowed(n_now)
                speed = wp.dot(n, s.load(velocity, b) - s.load(velocity, a))
                by_box = real(0.0)
                if wp.static(touch.is_periodic):
                    by_box = real(
                        wp.dot(
                            n_now,
                            geometry.load_box_motion(
                                e, i, j, contact_image, contact_box_after, contact_box
                            ),
                        )
                        / dt
                    )
                    speed += by_box
                yield_both = wp.dot(n, wp.cw_mul(s.load(inverse_mass, a), n))
                yield_both += wp.dot(n, wp.cw_mul(s.load(inverse_mass, b), n))
                debt += real(0.5) * last * speed
                if opened:
                    loss = ends.bounced(speed, yield_both, debt, restitution)
                    debt += loss
                    half = wp.float64(real(0.5) * loss)
                    restitution_energy[t] = restitution_energy[t] + half
                    contact_opened[e] = 0
                size = real(0.0)
                if debt != real(0.0):
                    size = share * spring_law.impulse(debt, speed, yield_both)
                contact_debt[e] = debt + real(0.5) * size * speed
                contact_impulse[e] = size
                if wp.static(touch.is_periodic):
                    done = -real(0.5) * size * by_box
                    contact_box_work[t] = contact_box_work[t] + wp.float64(done)
                if i == a:
                    total -= size * n
                else:
                    total += size * n
        s.store(settling_impulse, i, total)

    return kernel(contact_settle, simd=False)

"""Elements that touch without a bond, and walls: normal spring, friction, books (theory B11).

Elements touch as spheres (discs in the plane). Each sums its own row of the list of neighbours;
what belongs to a pair is worked out in the same order from either side, so that both sides get the
same bits and momentum is exact. Velocity Verlet's work on a pair is the mean of the forces before
and after a step times its motion; what that leaves over, the pair owes, and pays when it closes or
opens (as in `closing`).
"""

from functools import cache
from math import pi

import warp as wp

from .algebra import Laws, narrow
from .closing import closing
from .memory import kernel, nn


@cache
def contact(s: Laws) -> Laws:
    """Laws of two elements that touch, or of an element and a wall."""
    real, vec, spin = s.real, s.vec, s.spin

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
    def slid(spring: vec, limit: real) -> vec:
        """Tangential spring no longer than friction holds: |k_t s| <= mu N."""
        size = wp.length(spring)
        return wp.where(size > limit, (limit / wp.max(size, real(1.0e-30))) * spring, spring)

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
        it by the mean turn of both (theory B5). Exact in a rigid rotation."""
        turned = spring - (wp.dot(spring, n) / (real(1.0) + wp.dot(before, n))) * (before + n)
        return twisted(turned - wp.dot(turned, n) * n, n, half)

    return Laws(area=area, slid=slid, half_turn=half_turn, carried=carried)


@cache
def pair(s: Laws, k: Laws) -> Laws:
    """Geometry and stiffness of a listed pair, in the order of its ids whichever side asks."""
    real, place, narrowed, law = s.real, k.real, narrow(s, k), contact(s)
    unit = k.vec(*[1.0 if axis == 0 else 0.0 for axis in range(k.dim)])

    @wp.func
    def load_distance(
        e: int,
        i: int,
        j: int,
        contact_reference: wp.array(dtype=place),
        displacement: wp.array(dtype=place),
    ) -> k.vec:
        """From the lower id to the higher [m]."""
        x = k.load(contact_reference, nn(e))
        if i > j:
            x = -x
        return x + (k.load(displacement, nn(wp.max(i, j))) - k.load(displacement, nn(wp.min(i, j))))

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
        ra = real(contact_radius[nn(a)])
        rb = real(contact_radius[nn(b)])
        width = wp.min(contact_width[nn(a)], contact_width[nn(b)])
        s_ab = law.area(real(2.0) * ra * rb / (ra + rb), width)
        return s_ab / (compliance[nn(a)] + compliance[nn(b)])

    return Laws(
        load_distance=load_distance,
        normal=normal,
        load_stiffness=load_stiffness,
        narrowed=narrowed,
        widened=narrow(k, s),
    )


@cache
def contact_forces(s: Laws, k: Laws, has_friction: bool, has_restitution: bool, has_walls: bool):
    """Pass over elements that may touch: force and torque of all their contacts, into one slot."""
    real, place, geometry, law, spring_law = s.real, k.real, pair(s, k), contact(s), closing(s)
    narrowed, widened = geometry.narrowed, geometry.widened

    @wp.func
    def rub(
        spring: s.vec,
        before: s.vec,
        n: s.vec,
        arm_a: real,
        arm_b: real,
        motion: s.vec,
        wa: s.spin,
        wb: s.spin,
        stiffness: real,
        limit: real,
        dt: real,
    ):
        """Tangential spring after a step, and what its slip took [J].

        motion: of b's centre against a's; that of the two points that touch is less by the turns
        of their arms.
        """
        ha = law.half_turn(wa, dt)
        hb = law.half_turn(wb, dt)
        turned = law.carried(spring, before, n, real(0.5) * (ha + hb))
        motion -= s.rotate(arm_a * ha + arm_b * hb, before + n)
        trial = turned + motion - wp.dot(motion, n) * n
        after = law.slid(trial, limit / stiffness)
        taken = real(0.5) * stiffness * wp.dot(turned + after, trial - after)
        return after, taken

    def contact_forces(
        # model
        contact_elements: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=place),
        contact_radius: wp.array(dtype=place),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        contact_shear: wp.array(dtype=real),
        wall_normal: wp.array(dtype=real),
        wall_velocity: wp.array(dtype=real),
        wall_distance: wp.array(dtype=place),
        wall_friction: wp.array(dtype=real),
        # state read
        wall_shift: wp.array(dtype=place),
        displacement: wp.array(dtype=place),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        # written
        contact_debt: wp.array(dtype=real),
        contact_opened: wp.array(dtype=int),
        contact_spring: wp.array(dtype=real),
        slip_energy: wp.array(dtype=wp.float64),
        wall_debt: wp.array(dtype=real),
        wall_opened: wp.array(dtype=int),
        wall_spring: wp.array(dtype=real),
        wall_reaction: wp.array(dtype=real),
        wall_work: wp.array(dtype=wp.float64),
        any_touched: wp.array(dtype=int),
        contact_moment: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        friction: real,
        dt: place,
        first_place: int,
        rows: int,
        walls: int,
    ):
        t = wp.tid()
        i = contact_elements[t]
        force = s.vec()
        torque = s.no_spin()
        moment = s.mat3()
        vi = s.load(velocity, i)
        wi = s.load_spin(angular_velocity, i)
        for e in range(contact_start[t], contact_start[t + 1]):
            j = contact_neighbour[e]
            a = wp.min(i, j)
            b = wp.max(i, j)
            d = geometry.load_distance(e, i, j, contact_reference, displacement)
            reach = contact_radius[a] + contact_radius[b]
            va = s.load(velocity, a)
            vb = s.load(velocity, b)
            motion = dt * (widened(vb) - widened(va))
            d_before = d - motion
            near = wp.dot(d, d) < reach * reach
            was_near = wp.dot(d_before, d_before) < reach * reach
            if near or was_near:
                n_now, r = geometry.normal(d)
                n_then, r_before = geometry.normal(d_before)
                gap = real(r - reach)
                before = real(r_before - reach)
                n = narrowed(n_now)
                nb = narrowed(n_then)
                stiffness = geometry.load_stiffness(
                    a, b, contact_radius, contact_width, contact_compliance
                )
                pull = spring_law.pull(stiffness, gap, real(0.0))
                was = spring_law.pull(stiffness, before, real(0.0))
                f = pull * n
                owed = spring_law.energy(stiffness, gap) - spring_law.energy(stiffness, before)
                owed -= real(0.5) * wp.dot(pull * n + was * nb, narrowed(motion))
                contact_debt[e] = contact_debt[e] + owed
                if (gap < real(0.0)) != (before < real(0.0)):
                    any_touched[0] = 1
                    if wp.static(has_restitution) and gap >= real(0.0):
                        contact_opened[e] = 1
                # the points that touch lie where the spheres' surfaces would, by their radii
                share = real(contact_radius[a] / reach)
                arm_a = share * real(r)
                arm_b = (real(1.0) - share) * real(r)
                arm = arm_b
                if i == a:
                    arm = arm_a
                if wp.static(has_friction):
                    shear = geometry.load_stiffness(
                        a, b, contact_radius, contact_width, contact_shear
                    )
                    wa = s.load_spin(angular_velocity, a)
                    wb = s.load_spin(angular_velocity, b)
                    spring, taken = rub(
                        s.load(contact_spring, e), nb, n, arm_a, arm_b, narrowed(motion), wa, wb,
                        shear, -friction * pull, real(dt),
                    )  # fmt: skip
                    s.store(contact_spring, e, spring)
                    f += shear * spring
                    slip_energy[t] = slip_energy[t] + wp.float64(0.5) * wp.float64(taken)
                    torque += arm * s.cross(n, shear * spring)
                moment += arm * wp.outer(s.embed(n), s.embed(f))
                if i == a:
                    force += f
                else:
                    force -= f
        if wp.static(has_walls):
            for w in range(walls):
                e = w * rows + t
                n = s.load(wall_normal, w)
                vw = s.load(wall_velocity, w)
                dn = place(0.0)
                u = k.load(displacement, i)
                for axis in range(wp.static(k.dim)):
                    dn += place(n[axis]) * u[axis]
                gap = real(wall_distance[e] + dn - wall_shift[w])
                past = real(dt) * (vi - vw)
                before = gap - wp.dot(n, past)
                f = s.vec()
                if gap < real(0.0) or before < real(0.0):
                    radius = real(contact_radius[i])
                    wide = law.area(radius, contact_width[i])
                    stiffness = wide / contact_compliance[i]
                    pull = spring_law.pull(stiffness, gap, real(0.0))
                    was = spring_law.pull(stiffness, before, real(0.0))
                    owed = spring_law.energy(stiffness, gap)
                    owed -= spring_law.energy(stiffness, before)
                    owed -= real(0.5) * (pull + was) * wp.dot(n, past)
                    wall_debt[e] = wall_debt[e] + owed
                    if (gap < real(0.0)) != (before < real(0.0)):
                        any_touched[0] = 1
                        if wp.static(has_restitution) and gap >= real(0.0):
                            wall_opened[e] = 1
                    f = -pull * n
                    f_before = -was * n
                    if wp.static(has_friction):
                        shear = wide / contact_shear[i]
                        old = s.load(wall_spring, e)
                        # from the wall, a, to the element, b
                        spring, taken = rub(
                            old, n, n, real(0.0), radius + gap, past, s.no_spin(), wi,
                            shear, -wall_friction[w] * pull, real(dt),
                        )  # fmt: skip
                        s.store(wall_spring, e, spring)
                        f -= shear * spring
                        f_before -= shear * old
                        slip_energy[t] = slip_energy[t] + wp.float64(taken)
                        torque += (radius + gap) * s.cross(n, shear * spring)
                    force += f
                    moment -= (radius + gap) * wp.outer(s.embed(n), s.embed(f))
                    done = real(0.5) * real(dt) * wp.dot(f + f_before, vw)
                    wall_work[t] = wall_work[t] + wp.float64(done)
                s.store(wall_reaction, e, -f)
        s.store_tensor(contact_moment, i, real(0.5) * (moment + wp.transpose(moment)))
        s.store(end_force, first_place + i, force)
        s.store_spin(end_torque, first_place + i, torque)

    return kernel(contact_forces, simd=False)


@cache
def contact_energies(s: Laws, k: Laws, has_friction: bool, has_walls: bool):
    """Per element that may touch: half the energy of its pairs, and that of walls [J]."""
    real, place, geometry, law, spring_law = s.real, k.real, pair(s, k), contact(s), closing(s)

    def contact_energies(
        # model
        contact_elements: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=place),
        contact_radius: wp.array(dtype=place),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        contact_shear: wp.array(dtype=real),
        wall_normal: wp.array(dtype=real),
        wall_distance: wp.array(dtype=place),
        # state read
        wall_shift: wp.array(dtype=place),
        displacement: wp.array(dtype=place),
        contact_spring: wp.array(dtype=real),
        wall_spring: wp.array(dtype=real),
        # written
        contact_energy: wp.array(dtype=real),
        rows: int,
        walls: int,
    ):
        t = wp.tid()
        i = contact_elements[t]
        energy = real(0.0)
        for e in range(contact_start[t], contact_start[t + 1]):
            j = contact_neighbour[e]
            d = geometry.load_distance(e, i, j, contact_reference, displacement)
            _n, r = geometry.normal(d)
            gap = real(r - (contact_radius[wp.min(i, j)] + contact_radius[wp.max(i, j)]))
            if gap < real(0.0):
                stiffness = geometry.load_stiffness(
                    i, j, contact_radius, contact_width, contact_compliance
                )
                energy += real(0.5) * spring_law.energy(stiffness, gap)
                if wp.static(has_friction):
                    shear = geometry.load_stiffness(
                        i, j, contact_radius, contact_width, contact_shear
                    )
                    spring = s.load(contact_spring, e)
                    energy += real(0.25) * shear * wp.dot(spring, spring)
        if wp.static(has_walls):
            for w in range(walls):
                e = w * rows + t
                n = s.load(wall_normal, w)
                dn = place(0.0)
                u = k.load(displacement, i)
                for axis in range(wp.static(k.dim)):
                    dn += place(n[axis]) * u[axis]
                gap = real(wall_distance[e] + dn - wall_shift[w])
                wide = law.area(real(contact_radius[i]), contact_width[i])
                energy += spring_law.energy(wide / contact_compliance[i], gap)
                if wp.static(has_friction):
                    spring = s.load(wall_spring, e)
                    energy += real(0.5) * wide / contact_shear[i] * wp.dot(spring, spring)
        contact_energy[t] = energy

    return kernel(contact_energies, simd=False)


@cache
def contact_settle(s: Laws, k: Laws, has_restitution: bool, has_walls: bool):
    """Pass over elements that may touch: what their pairs owe is paid by impulses along n.

    Where a pair has opened, restitution takes the share 1 - e^2 of what its motion apart has.
    """
    real, place, geometry, spring_law = s.real, k.real, pair(s, k), closing(s)
    narrowed = geometry.narrowed

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

    def contact_settle(
        # model
        contact_elements: wp.array(dtype=int),
        contact_start: wp.array(dtype=int),
        contact_neighbour: wp.array(dtype=int),
        contact_reference: wp.array(dtype=place),
        inverse_mass: wp.array(dtype=real),
        wall_normal: wp.array(dtype=real),
        wall_velocity: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=place),
        velocity: wp.array(dtype=real),
        # written
        contact_debt: wp.array(dtype=real),
        contact_impulse: wp.array(dtype=real),
        contact_opened: wp.array(dtype=int),
        restitution_energy: wp.array(dtype=wp.float64),
        wall_debt: wp.array(dtype=real),
        wall_impulse: wp.array(dtype=real),
        wall_opened: wp.array(dtype=int),
        wall_work: wp.array(dtype=wp.float64),
        settling_impulse: wp.array(dtype=real),
        restitution: real,
        share: real,
        rows: int,
        walls: int,
    ):
        t = wp.tid()
        i = contact_elements[t]
        total = s.vec()
        for e in range(contact_start[t], contact_start[t + 1]):
            last = contact_impulse[e]
            debt = contact_debt[e]
            opened = has_opened(contact_opened, e)
            if last != real(0.0) or debt != real(0.0) or opened:
                j = contact_neighbour[e]
                a = wp.min(i, j)
                b = wp.max(i, j)
                d = geometry.load_distance(e, i, j, contact_reference, displacement)
                n_now, _r = geometry.normal(d)
                n = narrowed(n_now)
                speed = wp.dot(n, s.load(velocity, b) - s.load(velocity, a))
                yield_both = wp.dot(n, wp.cw_mul(s.load(inverse_mass, a), n))
                yield_both += wp.dot(n, wp.cw_mul(s.load(inverse_mass, b), n))
                debt += real(0.5) * last * speed
                if opened:
                    loss = bounced(speed, yield_both, debt, restitution)
                    debt += loss
                    half = wp.float64(real(0.5) * loss)
                    restitution_energy[t] = restitution_energy[t] + half
                    contact_opened[e] = 0
                size = real(0.0)
                if debt != real(0.0):
                    size = share * spring_law.impulse(debt, speed, yield_both)
                contact_debt[e] = debt + real(0.5) * size * speed
                contact_impulse[e] = size
                if i == a:
                    total -= size * n
                else:
                    total += size * n
        if wp.static(has_walls):
            for w in range(walls):
                e = w * rows + t
                last = wall_impulse[e]
                debt = wall_debt[e]
                opened = has_opened(wall_opened, e)
                n = s.load(wall_normal, w)
                vw = s.load(wall_velocity, w)
                speed = wp.dot(n, s.load(velocity, i) - vw)
                yielding = wp.dot(n, wp.cw_mul(s.load(inverse_mass, i), n))
                debt += real(0.5) * last * speed
                if opened:
                    loss = bounced(speed, yielding, debt, restitution)
                    debt += loss
                    restitution_energy[t] = restitution_energy[t] + wp.float64(loss)
                    wall_opened[e] = 0
                size = real(0.0)
                if debt != real(0.0):
                    size = share * spring_law.impulse(debt, speed, yielding)
                wall_debt[e] = debt + real(0.5) * size * speed
                wall_impulse[e] = size
                wall_work[t] = wall_work[t] + wp.float64(size * wp.dot(n, vw))
                total += size * n
        s.store(settling_impulse, i, total)

    return kernel(contact_settle, simd=False)

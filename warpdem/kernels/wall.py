"""Walls that elements touch: signed distances of their shapes, forces, books (theory B11).

A wall is a rigid shape with a pose: its place, from the middle of the scene, and its turn.
Distances are measured in float64 whatever the precision, as overlaps are small against places. What
the wall's motion does to an element is told by one relative motion, of the element's centre against
the wall's material there, which vanishes when both move as one rigid body.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow, space
from .closing import closing
from .contact import Touch, contact, opening, pressing
from .memory import kernel

PLANE, SPHERE, CYLINDER, BOX, MESH = range(5)
NUMBERS = 8  # of a shape
FAR = 1.0e30


@cache
def shapes(dim: int, used: frozenset[int]) -> Laws:
    """Signed distance [m], positive outside, and outward normal of the shapes that are used.

    Places are in the axes of the shape and from its place, in float64.
    """
    k, real = space(dim, wp.float64), wp.float64
    vec = k.vec
    tiny = wp.constant(wp.float64(1.0e-30))

    @wp.func
    def load_axis(numbers: wp.array(dtype=real), w: int) -> vec:
        n = vec()
        for axis in range(wp.static(dim)):
            n[axis] = numbers[wp.static(NUMBERS) * w + axis]
        return n

    @wp.func
    def sphere(y: vec, radius: real, sense: real):
        """Solid (sense 1) or hollow (-1)."""
        r = wp.length(y)
        return sense * (r - radius), (sense / wp.max(r, tiny)) * y

    @wp.func
    def cylinder(y: vec, axis: vec, radius: real, half: real, sense: real):
        """Solid of half its length (which may be infinite), or hollow and infinite."""
        h = wp.dot(y, axis)
        across = y - h * axis
        r = wp.length(across)
        out = across / wp.max(r, tiny)
        side = r - radius
        cap = wp.abs(h) - half
        end = wp.where(h < real(0.0), -axis, axis)
        d = sense * side
        n = sense * out
        if cap > wp.min(side, real(0.0)):
            d = cap
            n = end
            if side > real(0.0):
                d = wp.sqrt(side * side + cap * cap)
                n = (side * out + cap * end) / d
        return d, n

    @wp.func
    def box(y: vec, half: vec, rounding: real):
        """Edges rounded by a radius."""
        deepest = real(-FAR)
        n = vec()
        outside = vec()
        for axis in range(wp.static(dim)):
            q = wp.abs(y[axis]) - (half[axis] - rounding)
            sign = wp.where(y[axis] < real(0.0), real(-1.0), real(1.0))
            outside[axis] = wp.max(q, real(0.0)) * sign
            if q > deepest:
                deepest = q
                n = vec()
                n[axis] = sign
        size = wp.length(outside)
        d = deepest
        if size > tiny:
            d = size
            n = outside / size
        return d - rounding, n

    if MESH in used:
        single = wp.vec3f

        @wp.func
        def mesh(
            y: vec,
            w: int,
            far: real,
            wall_mesh: wp.array(dtype=wp.uint64),
            wall_first_face: wp.array(dtype=int),
            face_place: wp.array(dtype=real),
        ):
            """Of the nearest triangle: Warp finds it in float32, its distance is of float64.

            Over edges and corners the normal points from the nearest point.
            """
            found = wp.mesh_query_point_sign_normal(
                wall_mesh[w], single(wp.float32(y[0]), wp.float32(y[1]), wp.float32(y[2])),
                wp.float32(far),
            )  # fmt: skip
            d = real(FAR)
            n = vec()
            if found.result:
                first = 3 * (wall_first_face[w] + found.face)
                a = k.load(face_place, first)
                b = k.load(face_place, first + 1)
                c = k.load(face_place, first + 2)
                face = wp.normalize(wp.cross(b - a, c - a))
                near, inside = on_triangle(y, a, b, c)
                away = y - near
                size = wp.length(away)
                d = wp.dot(y - a, face)
                n = face
                if not inside and size > tiny:
                    sign = wp.where(found.sign < wp.float32(0.0), real(-1.0), real(1.0))
                    d = sign * size
                    n = (sign / size) * away
            return d, n

        @wp.func
        def on_triangle(p: vec, a: vec, b: vec, c: vec):
            """Nearest point of a triangle, and whether it is within (Ericson 2005, 5.1.5)."""
            ab = b - a
            ac = c - a
            d1 = wp.dot(ab, p - a)
            d2 = wp.dot(ac, p - a)
            d3 = wp.dot(ab, p - b)
            d4 = wp.dot(ac, p - b)
            d5 = wp.dot(ab, p - c)
            d6 = wp.dot(ac, p - c)
            va = d3 * d6 - d5 * d4
            vb = d5 * d2 - d1 * d6
            vc = d1 * d4 - d3 * d2
            zero = real(0.0)
            near = a
            inside = False
            if d1 <= zero and d2 <= zero:
                near = a
            elif d3 >= zero and d4 <= d3:
                near = b
            elif d6 >= zero and d5 <= d6:
                near = c
            elif vc <= zero and d1 >= zero and d3 <= zero:
                near = a + (d1 / (d1 - d3)) * ab
            elif vb <= zero and d2 >= zero and d6 <= zero:
                near = a + (d2 / (d2 - d6)) * ac
            elif va <= zero and d4 - d3 >= zero and d5 - d6 >= zero:
                near = b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b)
            else:
                inside = True
                near = a + (vb / (va + vb + vc)) * ab + (vc / (va + vb + vc)) * ac
            return near, inside

    @wp.func
    def distance(
        y: vec,
        w: int,
        far: real,
        wall_kind: wp.array(dtype=int),
        wall_shape: wp.array(dtype=real),
        wall_mesh: wp.array(dtype=wp.uint64),
        wall_first_face: wp.array(dtype=int),
        face_place: wp.array(dtype=real),
    ):
        """Of wall w; only a mesh's may be missing beyond `far`."""
        kind = wall_kind[w]
        row = wp.static(NUMBERS) * w
        d = real(FAR)
        n = vec()
        if wp.static(PLANE in used):  # noqa: SIM102
            if kind == wp.static(PLANE):
                n = load_axis(wall_shape, w)
                d = wp.dot(n, y)
        if wp.static(SPHERE in used):  # noqa: SIM102
            if kind == wp.static(SPHERE):
                d, n = sphere(y, wall_shape[row + 3], wall_shape[row + 5])
        if wp.static(CYLINDER in used):  # noqa: SIM102
            if kind == wp.static(CYLINDER):
                d, n = cylinder(
                    y, load_axis(wall_shape, w), wall_shape[row + 3], wall_shape[row + 4],
                    wall_shape[row + 5],
                )  # fmt: skip
        if wp.static(BOX in used):  # noqa: SIM102
            if kind == wp.static(BOX):
                d, n = box(y, load_axis(wall_shape, w), wall_shape[row + 3])
        if wp.static(MESH in used):  # noqa: SIM102
            if kind == wp.static(MESH):
                d, n = mesh(y, w, far, wall_mesh, wall_first_face, face_place)
        return d, n

    @wp.func
    def posed(
        r: vec,
        w: int,
        far: real,
        wall_turn: wp.array(dtype=real),
        wall_kind: wp.array(dtype=int),
        wall_shape: wp.array(dtype=real),
        wall_mesh: wp.array(dtype=wp.uint64),
        wall_first_face: wp.array(dtype=int),
        face_place: wp.array(dtype=real),
    ):
        """Distance and normal in the world's axes, of a place from the wall's."""
        q = k.load_rot(wall_turn, w)
        d, n = distance(
            r + k.turn_back(q, r), w, far, wall_kind, wall_shape, wall_mesh, wall_first_face,
            face_place,
        )  # fmt: skip
        return d, n + k.turn(q, n)

    return Laws(posed=posed, vec=vec, load=k.load)


@cache
def placing(s: Laws, k: Laws) -> Laws:
    """Where an element is, in float64, and casts to it and back."""
    f = space(s.dim, wp.float64)
    widened = narrow(f, k)

    @wp.func
    def load_place(
        i: int,
        contact_position: wp.array(dtype=wp.float64),
        displacement: wp.array(dtype=k.real),
    ) -> f.vec:
        """From the middle of the scene [m]."""
        return f.load(contact_position, i) + widened(k.load(displacement, i))

    return Laws(load_place=load_place, narrowed=narrow(s, f), widened=narrow(f, s))


@cache
def wall_forces(s: Laws, k: Laws, used: frozenset[int], touch: Touch):
    """Pass over elements that may touch: what walls add to the forces of contacts."""
    real, law, spring_law = s.real, contact(s, touch.ages), pressing(s, touch.is_hertz)
    shape, where, double = shapes(s.dim, used), placing(s, k), wp.float64
    narrowed, widened = where.narrowed, where.widened

    def wall_forces(
        # model
        contact_elements: wp.array(dtype=int),
        contact_position: wp.array(dtype=wp.float64),
        contact_radius: wp.array(dtype=k.real),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        contact_shear: wp.array(dtype=real),
        inverse_mass: wp.array(dtype=real),
        wall_kind: wp.array(dtype=int),
        wall_shape: wp.array(dtype=wp.float64),
        wall_mesh: wp.array(dtype=wp.uint64),
        wall_first_face: wp.array(dtype=int),
        face_place: wp.array(dtype=wp.float64),
        wall_friction: wp.array(dtype=real),
        wall_rolling: wp.array(dtype=real),
        wall_twisting: wp.array(dtype=real),
        contact_kind: wp.array(dtype=int),
        friction_table: wp.array(dtype=real),
        friction_numbers: wp.array(dtype=wp.float64),
        # state read
        wall_place: wp.array(dtype=wp.float64),
        wall_place_before: wp.array(dtype=wp.float64),
        wall_turn: wp.array(dtype=wp.float64),
        wall_turn_before: wp.array(dtype=wp.float64),
        wall_velocity: wp.array(dtype=real),
        wall_spin: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        angular_velocity: wp.array(dtype=real),
        # written
        slip_energy: wp.array(dtype=wp.float64),
        restitution_energy: wp.array(dtype=wp.float64),
        wall_debt: wp.array(dtype=real),
        wall_opened: wp.array(dtype=int),
        wall_dashpot: wp.array(dtype=real),
        wall_roll: wp.array(dtype=real),
        wall_spring: wp.array(dtype=real),
        wall_theta: wp.array(dtype=wp.float64),
        wall_reaction: wp.array(dtype=real),
        wall_torque: wp.array(dtype=real),
        wall_work: wp.array(dtype=wp.float64),
        any_touched: wp.array(dtype=int),
        contact_moment: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        damping: real,
        dt: real,
        first_place: int,
        kinds: int,
        rows: int,
        walls: int,
    ):
        t = wp.tid()
        i = contact_elements[t]
        force = s.load(end_force, first_place + i)
        torque = s.load_spin(end_torque, first_place + i)
        moment = s.mat3()
        vi = s.load(velocity, i)
        wi = s.load_spin(angular_velocity, i)
        x = where.load_place(i, contact_position, displacement)
        x_before = x - double(dt) * widened(vi)
        radius = double(contact_radius[i])
        for w in range(walls):
            e = w * rows + t
            r_now = x - shape.load(wall_place, w)
            r_before = x_before - shape.load(wall_place_before, w)
            # of the element's centre against the wall's material there
            vw = s.load(wall_velocity, w)
            ww = s.load_spin(wall_spin, w)
            half = law.half_turn(ww, dt)
            r = narrowed(r_now)
            carried = dt * vw + s.rotate(half, r + narrowed(r_before))
            motion = dt * vi - carried
            f = s.vec()
            twist = s.no_spin()
            turning = s.no_spin()
            far = radius + double(wp.length(motion))
            d, n_now = shape.posed(
                r_now, w, far, wall_turn, wall_kind, wall_shape, wall_mesh, wall_first_face,
                face_place,
            )  # fmt: skip
            if d < far:  # no distance grows faster than what moves
                d_before, n_before = shape.posed(
                    r_before, w, far + far, wall_turn_before, wall_kind, wall_shape, wall_mesh,
                    wall_first_face, face_place,
                )  # fmt: skip
                gap = real(d - radius)
                before = real(d_before - radius)
                n = narrowed(n_now)
                nb = narrowed(n_before)
                wide = law.area(real(radius), contact_width[i])
                stiffness = spring_law.against_wall(real(radius), wide, contact_compliance[i])
                pull = spring_law.pull(stiffness, gap, real(0.0))
                was = spring_law.pull(stiffness, before, real(0.0))
                f = -pull * n
                f_before = -was * nb
                owed = spring_law.energy(stiffness, gap) - spring_law.energy(stiffness, before)
                wall_debt[e] = wall_debt[e] + owed + real(0.5) * wp.dot(f + f_before, motion)
                if (gap < real(0.0)) != (before < real(0.0)):
                    any_touched[0] = 1
                    if wp.static(touch.bounces) and gap >= real(0.0):
                        wall_opened[e] = 1
                if wp.static(touch.damps):
                    give = wp.dot(n, wp.cw_mul(s.load(inverse_mass, i), n))
                    speed = wp.dot(n, motion) / wp.max(dt, real(1.0e-30))
                    last = wall_dashpot[e]
                    own = spring_law.resisted(
                        pull, stiffness, before, gap, speed, give, damping, dt
                    )
                    wall_dashpot[e] = own
                    lost = real(0.5) * wp.dot(own * n + last * nb, motion)
                    restitution_energy[t] = restitution_energy[t] + double(lost)
                    pull += own
                    f = -pull * n
                    f_before -= last * nb
                arm = real(d)
                if wp.static(touch.rubs or touch.rolls):
                    shear = wide / contact_shear[i]
                if wp.static(touch.rolls):
                    old_roll = s.load_spin(wall_roll, e)
                    roll, worn = law.rolled(
                        old_roll, nb, n, ww, wi, real(radius), shear, pull, wall_rolling[w],
                        wall_twisting[w], dt,
                    )  # fmt: skip
                    s.store_spin(wall_roll, e, roll)
                    slip_energy[t] = slip_energy[t] + double(worn)
                    twist = (-shear * real(radius)) * roll
                    turning = twist - (shear * real(radius)) * old_roll
                    torque += twist
                if wp.static(touch.rubs):
                    row = 1 + w
                    mu = wall_friction[w]
                    if wp.static(touch.by_kind):
                        row = kinds * (kinds + w) + contact_kind[i]
                        mu = friction_table[row]
                    old = s.load(wall_spring, e)
                    # from the wall, a, to the element, b, whose arms end where they touch
                    theta = double(0.0)
                    if wp.static(touch.ages):
                        theta = wall_theta[e]
                    spring, theta, taken = law.rub(
                        old, nb, n, -arm, arm, motion, ww, wi, shear, pull, mu, row,
                        friction_numbers, theta, dt,
                    )  # fmt: skip
                    if wp.static(touch.ages):
                        wall_theta[e] = theta
                    s.store(wall_spring, e, spring)
                    f -= shear * spring
                    f_before -= shear * old
                    slip_energy[t] = slip_energy[t] + double(taken)
                    rubbed = arm * s.cross(n, shear * spring)
                    twist += rubbed
                    turning += rubbed + real(d_before) * s.cross(nb, shear * old)
                    torque += rubbed
                force += f
                moment -= arm * wp.outer(s.embed(n), s.embed(f))
                done = real(0.5) * wp.dot(f + f_before, carried) + s.spin_dot(turning, half)
                wall_work[t] = wall_work[t] + double(done)
            s.store(wall_reaction, e, -f)
            s.store_spin(wall_torque, e, -(s.cross(r, f) + twist))
        moment = s.load_tensor(contact_moment, i) + real(0.5) * (moment + wp.transpose(moment))
        s.store_tensor(contact_moment, i, moment)
        s.store(end_force, first_place + i, force)
        s.store_spin(end_torque, first_place + i, torque)

    return kernel(wall_forces, simd=False)


@cache
def wall_energies(s: Laws, k: Laws, used: frozenset[int], touch: Touch):
    """Per element that may touch: what walls add to the energy of contacts [J]."""
    real, law, spring_law = s.real, contact(s), pressing(s, touch.is_hertz)
    shape, where = shapes(s.dim, used), placing(s, k)

    def wall_energies(
        # model
        contact_elements: wp.array(dtype=int),
        contact_position: wp.array(dtype=wp.float64),
        contact_radius: wp.array(dtype=k.real),
        contact_width: wp.array(dtype=real),
        contact_compliance: wp.array(dtype=real),
        contact_shear: wp.array(dtype=real),
        wall_kind: wp.array(dtype=int),
        wall_shape: wp.array(dtype=wp.float64),
        wall_mesh: wp.array(dtype=wp.uint64),
        wall_first_face: wp.array(dtype=int),
        face_place: wp.array(dtype=wp.float64),
        # state read
        wall_place: wp.array(dtype=wp.float64),
        wall_turn: wp.array(dtype=wp.float64),
        displacement: wp.array(dtype=k.real),
        wall_spring: wp.array(dtype=real),
        wall_roll: wp.array(dtype=real),
        # written
        contact_energy: wp.array(dtype=real),
        rows: int,
        walls: int,
    ):
        t = wp.tid()
        i = contact_elements[t]
        radius = wp.float64(contact_radius[i])
        x = where.load_place(i, contact_position, displacement)
        energy = contact_energy[t]
        wide = law.area(real(radius), contact_width[i])
        for w in range(walls):
            d, _n = shape.posed(
                x - shape.load(wall_place, w), w, radius, wall_turn, wall_kind, wall_shape,
                wall_mesh, wall_first_face, face_place,
            )  # fmt: skip
            if d < radius:
                stiffness = spring_law.against_wall(real(radius), wide, contact_compliance[i])
                energy += spring_law.energy(stiffness, real(d - radius))
                if wp.static(touch.rolls):
                    roll = s.load_spin(wall_roll, w * rows + t)
                    energy += real(0.5) * wide / contact_shear[i] * s.spin_squared(roll)
                if wp.static(touch.rubs):
                    spring = s.load(wall_spring, w * rows + t)
                    energy += real(0.5) * wide / contact_shear[i] * wp.dot(spring, spring)
        contact_energy[t] = energy

    return kernel(wall_energies, simd=False)


@cache
def wall_settle(s: Laws, k: Laws, used: frozenset[int], touch: Touch):
    """Pass over elements that may touch: what is owed to walls is paid by impulses along n."""
    real, spring_law, ends = s.real, closing(s), opening(s, touch.bounces)
    shape, where = shapes(s.dim, used), placing(s, k)
    double = wp.float64

    def wall_settle(
        # model
        contact_elements: wp.array(dtype=int),
        contact_position: wp.array(dtype=wp.float64),
        contact_radius: wp.array(dtype=k.real),
        inverse_mass: wp.array(dtype=real),
        wall_kind: wp.array(dtype=int),
        wall_shape: wp.array(dtype=wp.float64),
        wall_mesh: wp.array(dtype=wp.uint64),
        wall_first_face: wp.array(dtype=int),
        face_place: wp.array(dtype=wp.float64),
        # state read
        wall_place: wp.array(dtype=wp.float64),
        wall_turn: wp.array(dtype=wp.float64),
        wall_velocity: wp.array(dtype=real),
        wall_spin: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        velocity: wp.array(dtype=real),
        # written
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
        total = s.load(settling_impulse, i)
        x = where.load_place(i, contact_position, displacement)
        radius = double(contact_radius[i])
        for w in range(walls):
            e = w * rows + t
            last = wall_impulse[e]
            debt = wall_debt[e]
            opened = ends.has_opened(wall_opened, e)
            if last != real(0.0) or debt != real(0.0) or opened:
                r = x - shape.load(wall_place, w)
                _d, n_now = shape.posed(
                    r, w, radius + radius, wall_turn, wall_kind, wall_shape, wall_mesh,
                    wall_first_face, face_place,
                )  # fmt: skip
                n = where.narrowed(n_now)
                vw = s.load(wall_velocity, w)
                vw += s.rotate(s.load_spin(wall_spin, w), where.narrowed(r))
                speed = wp.dot(n, s.load(velocity, i) - vw)
                yielding = wp.dot(n, wp.cw_mul(s.load(inverse_mass, i), n))
                debt += real(0.5) * last * speed
                if opened:
                    loss = ends.bounced(speed, yielding, debt, restitution)
                    debt += loss
                    restitution_energy[t] = restitution_energy[t] + double(loss)
                    wall_opened[e] = 0
                size = real(0.0)
                if debt != real(0.0):
                    size = share * spring_law.impulse(debt, speed, yielding)
                wall_debt[e] = debt + real(0.5) * size * speed
                wall_impulse[e] = size
                wall_work[t] = wall_work[t] + double(size * wp.dot(n, vw))
                total += size * n
        s.store(settling_impulse, i, total)

    return kernel(wall_settle, simd=False)

"""What friction holds: Coulomb's law, and rate and state (theory B11)."""

from functools import cache

import warp as wp

from .algebra import Laws, narrow

HOLDS = 1.0e20  # a friction that lets nothing slide
NUMBERS = 7  # of a law: mu0, a, b, V0, Dc, theta0, whether the slip law holds
ROUNDS = 16  # of Newton's method at most; from its bound it needs about ln(ln(V/V0)) and five


@cache
def rate_and_state() -> Laws:
    """Laws of a slider in float64, whose state flows by little in a step."""
    real = wp.float64

    @wp.func
    def strength(mu0: real, b: real, v0: real, dc: real, theta: real) -> real:
        """mu0 + b ln(V0 theta/Dc)."""
        return mu0 + b * wp.log(v0 * theta / dc)

    @wp.func
    def friction(a: real, v0: real, psi: real, v: real) -> real:
        """mu = a asinh(V/(2 V0) exp(psi)), psi = (mu0 + b ln(V0 theta/Dc))/a."""
        # beyond exp's range asinh(x) is ln(2 x)
        big = wp.log(wp.max(v, real(1.0e-300)) / v0) + psi
        x = real(0.5) * wp.exp(wp.min(big, real(40.0)))
        return a * wp.where(big > real(40.0), big, wp.log(x + wp.sqrt(x * x + real(1.0))))

    @wp.func
    def rate(give: real, stretch: real, a: real, v0: real, psi: real, dt: real):
        """Root of stretch - V dt = give mu(V): V [m/s], and mu give [m], what is left stretched.

        give: N/k_t [m]. In z = mu/a it is a give z + 2 V0 dt exp(-psi) sinh(z) = stretch, convex
        and rising, so that Newton's method falls to the root from any bound above it; each of both
        terms alone gives one.
        """
        linear = a * give
        slow = v0 * dt
        big = wp.log(stretch / slow) + psi
        x = real(0.5) * wp.exp(wp.min(big, real(40.0)))
        bound = wp.where(big > real(40.0), big, wp.log(x + wp.sqrt(x * x + real(1.0))))
        z = wp.min(bound, stretch / linear)
        for _ in range(ROUNDS):
            up = slow * wp.exp(z - psi)
            down = slow * wp.exp(-z - psi)
            step = (linear * z + up - down - stretch) / (linear + up + down)
            z = wp.max(z - step, real(0.0))
            if wp.abs(step) <= real(1.0e-14) * z:
                break
        return v0 * (wp.exp(z - psi) - wp.exp(-z - psi)), linear * z

    @wp.func
    def aged(theta: real, v: real, dc: real, dt: real, slips: real) -> real:
        """theta after dt at a constant rate V, exactly: aging or slip law."""
        x = v * dt / dc
        left = wp.exp(-x)
        if slips > real(0.0):  # ln(V theta/Dc) decays
            if v == real(0.0):
                return theta
            return theta * wp.exp((left - real(1.0)) * wp.log(v * theta / dc))
        series = real(1.0) - real(0.5) * x + x * x / real(6.0)
        mean = wp.where(x > real(1.0e-5), (real(1.0) - left) / wp.max(x, real(1.0e-5)), series)
        return theta * left + dt * mean

    return Laws(strength=strength, friction=friction, rate=rate, aged=aged)


@cache
def friction(s: Laws, ages: bool) -> Laws:
    """Law of the tangential spring of a pair.

    ages: the pair's state theta [s] is kept, 0 of one that does not touch; a step of length 0
    lets nothing slide then.
    """
    real, vec, law = s.real, s.vec, rate_and_state()

    @wp.func
    def slid(spring: vec, limit: real) -> vec:
        """Tangential spring no longer than friction holds: |k_t s| <= mu N."""
        size = wp.length(spring)
        return wp.where(size > limit, (limit / wp.max(size, real(1.0e-30))) * spring, spring)

    if ages:

        @wp.func
        def held(
            trial: vec,
            pull: real,
            stiffness: real,
            mu: real,
            row: int,
            friction_numbers: wp.array(dtype=wp.float64),
            theta: wp.float64,
            dt: real,
        ):
            """Tangential spring that is left of a trial under the pull (< 0 presses), and theta."""
            at = wp.static(NUMBERS) * row
            a = friction_numbers[at + 1]
            if pull >= real(0.0):  # an open pair forgets
                return s.vec(), wp.float64(0.0)
            if a == wp.float64(0.0):
                return slid(trial, -real(friction_numbers[at]) * pull / stiffness), theta
            age = wp.where(theta > wp.float64(0.0), theta, friction_numbers[at + 5])
            size = wp.length(trial)
            if dt == real(0.0):
                return trial, age
            if size == real(0.0):
                still = law.aged(
                    age, wp.float64(0.0), friction_numbers[at + 4], wp.float64(dt),
                    friction_numbers[at + 6],
                )  # fmt: skip
                return trial, still
            v0 = friction_numbers[at + 3]
            dc = friction_numbers[at + 4]
            b = friction_numbers[at + 2]
            slips = friction_numbers[at + 6]
            half = wp.float64(0.5) * wp.float64(dt)
            give = -wp.float64(pull) / wp.float64(stiffness)
            # the rate of the step is that of the state in its middle
            psi = law.strength(friction_numbers[at], b, v0, dc, age) / a
            v, left = law.rate(give, wp.float64(size), a, v0, psi, wp.float64(dt))
            middle = law.aged(age, v, dc, half, slips)
            psi = law.strength(friction_numbers[at], b, v0, dc, middle) / a
            v, left = law.rate(give, wp.float64(size), a, v0, psi, wp.float64(dt))
            aged = law.aged(middle, v, dc, half, slips)
            return real(left / wp.float64(size)) * trial, aged
    else:

        @wp.func
        def held(
            trial: vec,
            pull: real,
            stiffness: real,
            mu: real,
            row: int,
            friction_numbers: wp.array(dtype=wp.float64),
            theta: wp.float64,
            dt: real,
        ):
            """Tangential spring that is left of a trial under the pull (< 0 presses)."""
            return slid(trial, -mu * pull / stiffness), theta

    return Laws(slid=slid, held=held)


@cache
def face_friction(s: Laws, k: Laws, ages: bool) -> Laws:
    """Friction on the closed face of an unlinked pair: a spring along it from an anchor that slips.

    How far the anchor has slipped is kept in the frame of i. By the motion of j's point of the face
    in that frame the spring grows, so its force acts there: at any other it would make energy.
    """
    real, vec, holding = s.real, s.vec, friction(s, ages)
    widened, narrowed = narrow(k, s), narrow(s, k)

    @wp.func
    def rub(
        t: int,
        delta: vec,
        n: vec,
        pull: real,
        is_new: bool,
        i: int,
        orientation: wp.array(dtype=k.real),
        mu: real,
        row: int,
        friction_numbers: wp.array(dtype=wp.float64),
        closing_shear: wp.array(dtype=real),
        closing_slip: wp.array(dtype=k.real),
        closing_spring: wp.array(dtype=real),
        closing_theta: wp.array(dtype=wp.float64),
        closing_slip_energy: wp.array(dtype=wp.float64),
        dt: real,
    ) -> vec:
        """Force along the face on i [N] of listed pair t, whose history goes on by a step.

        pull: along n; a tension, which a frequency is found with, holds as a pressure; is_new:
        unlinked just now, so that nothing holds it yet.
        """
        frame = k.load_rot(orientation, i)
        shear = closing_shear[t]
        slip = k.load(closing_slip, t)
        before = s.load(closing_spring, t)
        gone = delta - narrowed(slip + k.turn(frame, slip))
        trial = gone - wp.dot(gone, n) * n
        theta = wp.float64(0.0)
        if wp.static(ages):
            theta = closing_theta[t]
        spring, theta = holding.held(
            trial, -wp.abs(pull), shear, mu, row, friction_numbers, theta, dt
        )
        taken = real(0.5) * shear * wp.dot(before + spring, trial - spring)
        if is_new:
            spring = vec()
            taken = real(0.0)
        if wp.static(ages):
            closing_theta[t] = theta
        closing_slip_energy[t] = closing_slip_energy[t] + wp.float64(taken)
        anchor = widened(delta - spring)
        k.store(closing_slip, t, anchor + k.turn_back(frame, anchor))
        s.store(closing_spring, t, spring)
        return shear * spring

    return Laws(rub=rub)

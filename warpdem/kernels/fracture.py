"""Stress tensor of a pair, fracture criteria, and the switch linked -> unlinked (Shilko 13-14)."""

from functools import cache
from math import pi
from typing import NamedTuple

import warp as wp

from .algebra import Laws
from .face import Faces, face
from .memory import get, kernel, nn, put


@cache
def pair_tensor(s: Laws) -> Laws:
    """Tensor on a face, and the invariants that criteria use."""
    real, vec3, mat3 = s.real, s.vec3, s.mat3
    # not within a function, where Warp would divide in float32
    third, two_thirds, root_27, third_turn = (
        real(1.0 / 3.0),
        real(2.0 / 3.0),
        real(27.0**0.5),
        real(2.0 * pi / 3.0),
    )

    @wp.func
    def minor(a: real, b: real, c: real, d: real) -> real:
        """(a d - b c)^2."""
        return (a * d - b * c) * (a * d - b * c)

    @wp.func
    def tensor(mean: mat3, traction: vec3, n: vec3) -> mat3:
        """Normal and shear parts from the bond, the tangential ones interpolated (Shilko eq. 13).

        All of s_t1t1, s_t2t2 and, in space, s_t1t2 are kept: without the last, homogeneous
        shear comes out wrong (theory B10). With P = 1 - nn no tangential frame is needed.
        """
        across = traction - wp.dot(traction, n) * n
        p = wp.identity(n=3, dtype=real) - wp.outer(n, n)
        return p * mean * p + wp.outer(traction, n) + wp.outer(n, across)

    @wp.func
    def mean_stress(t: mat3) -> real:
        return third * wp.trace(t)

    @wp.func
    def von_mises(t: mat3) -> real:
        """Stress intensity sqrt(3/2 dev:dev)."""
        dev = t - mean_stress(t) * wp.identity(n=3, dtype=real)
        return wp.sqrt(real(1.5) * wp.ddot(dev, dev))

    if s.dim == 2:

        @wp.func
        def principal(t: mat3):
            """Greatest and least principal stress; in the plane zz is one of the three."""
            mean = real(0.5) * (t[0, 0] + t[1, 1])
            half = real(0.5) * (t[0, 0] - t[1, 1])
            radius = wp.sqrt(half * half + t[0, 1] * t[0, 1])
            return wp.max(mean + radius, t[2, 2]), wp.min(mean - radius, t[2, 2])

        return Laws(
            tensor=tensor, mean_stress=mean_stress, von_mises=von_mises, principal=principal
        )

    @wp.func
    def principal_of_three(t: mat3):
        """Greatest and least principal stress.

        The angle of the deviator's invariants comes from the discriminant as a sum of squares
        (the Gram determinant of 1, T, T^2 by Lagrange's identity), which does not cancel where two
        values meet.
        """
        m = mean_stress(t)
        d = t - m * wp.identity(n=3, dtype=real)
        square = wp.ddot(d, d)
        e = d * d - (third * square) * wp.identity(n=3, dtype=real)
        # products of tensors as of vectors of six, whose shears count twice; written out, as a loop
        # would not be unrolled, and the pass not vectorised
        normal = minor(d[0, 0], d[1, 1], e[0, 0], e[1, 1])
        normal += minor(d[1, 1], d[2, 2], e[1, 1], e[2, 2])
        normal += minor(d[2, 2], d[0, 0], e[2, 2], e[0, 0])
        shear = minor(d[0, 1], d[1, 2], e[0, 1], e[1, 2])
        shear += minor(d[1, 2], d[0, 2], e[1, 2], e[0, 2])
        shear += minor(d[0, 2], d[0, 1], e[0, 2], e[0, 1])
        mixed = real(0.0)
        for axis in range(3):
            mixed += minor(d[axis, axis], d[0, 1], e[axis, axis], e[0, 1])
            mixed += minor(d[axis, axis], d[1, 2], e[axis, axis], e[1, 2])
            mixed += minor(d[axis, axis], d[0, 2], e[axis, axis], e[0, 2])
        gram = normal + real(4.0) * shear + real(2.0) * mixed
        # (2 J2^1.5)^2 = (3 sqrt3 J3)^2 + discriminant, which is 3 times that sum
        angle = wp.atan2(wp.sqrt(real(3.0) * gram), root_27 * wp.determinant(d)) / real(3.0)
        size = wp.sqrt(two_thirds * square)
        return m + size * wp.cos(angle), m + size * wp.cos(angle + third_turn)

    return Laws(
        tensor=tensor,
        mean_stress=mean_stress,
        von_mises=von_mises,
        principal=principal_of_three,
    )


class Test(NamedTuple):
    """The form of a fracture criterion; its numbers are arguments."""

    kind: str
    function: wp.Function | None = None  # a user's own equivalent stress
    damage: str = ""  # "incubation" or "power": what grows with time
    softens: bool = False
    is_interface: bool = False  # of bonds between unlike elements, whose faces are nodes

    @property
    def needs_stress(self) -> bool:
        """Whether it looks at the average stress of elements."""
        return self.kind != "beam"


@cache
def criterion_numbers(s: Laws):
    """Four numbers of a criterion."""
    return wp.types.vector(4, s.real)


@cache
def criterion(s: Laws, test: Test):
    """Equivalent stress of a pair tensor on a face of normal n, to be compared with a strength."""
    real, vec3, mat3, law, four = s.real, s.vec3, s.mat3, pair_tensor(s), criterion_numbers(s)

    if test.kind == "huber_mises_hencky":

        @wp.func
        def huber_mises_hencky(t: mat3, n: vec3, x: four) -> real:
            """Shilko eq. 14, first line."""
            return law.von_mises(t)

        return huber_mises_hencky

    if test.kind == "drucker_prager":

        @wp.func
        def drucker_prager(t: mat3, n: vec3, x: four) -> real:
            """Shilko eq. 14, second line: compared with the compressive strength; x[0] = a."""
            one = real(1.0)
            return real(0.5) * (x[0] + one) * law.von_mises(t) + real(1.5) * (
                x[0] - one
            ) * law.mean_stress(t)

        return drucker_prager

    if test.kind == "rankine":

        @wp.func
        def rankine(t: mat3, n: vec3, x: four) -> real:
            """Greatest principal stress."""
            first, _third = law.principal(t)
            return first

        return rankine

    if test.kind == "mohr_coulomb":

        @wp.func
        def mohr_coulomb(t: mat3, n: vec3, x: four) -> real:
            """s1 - s3 + (s1 + s3) sin(phi), or s1 times the strength over the cut-off."""
            first, third = law.principal(t)
            return wp.max(first - third + (first + third) * x[0], first * x[1])

        return mohr_coulomb

    if test.kind == "mixed_mode":

        @wp.func
        def mixed_mode(t: mat3, n: vec3, x: four) -> real:
            """sqrt(<s>^2 + (tau s_t/t_t)^2) on the face; x[0] = s_t/t_t."""
            traction = t * n
            normal = wp.max(wp.dot(traction, n), real(0.0))
            shear = x[0] * wp.length(s.split(traction, n))
            return wp.sqrt(normal * normal + shear * shear)

        return mixed_mode

    if test.kind == "custom":
        own = test.function

        @wp.func
        def custom(t: mat3, n: vec3, x: four) -> real:
            """The user's."""
            return own(t, n, x)

        return custom

    raise ValueError(f"no criterion {test.kind}")


@cache
def exceeding(s: Laws, test: Test):
    """Whether a pair breaks at a criterion's ratio, and what grows towards it with time."""
    real = s.real

    @wp.func
    def grown(ratio: real, damage: real, time: real, exponent: real, dt: real) -> real:
        """Damage after a step: of incubation dy/dt = (R - y)/T, of a power dD/dt = R^n/T."""
        if wp.static(test.damage == "incubation"):
            return damage + (real(1.0) - wp.exp(-dt / time)) * (ratio - damage)
        return damage + dt / time * wp.pow(wp.max(ratio, real(0.0)), exponent)

    @wp.func
    def judged(
        l: int,
        ratio: real,
        linked: real,
        criterion_ratio: wp.array(dtype=real),
        break_damage: wp.array(dtype=real),
        time: real,
        exponent: real,
        dt: real,
    ) -> real:
        """What is compared with 1: the ratio, of which the greatest is kept, or what it has grown
        to with time; 0 of an unlinked pair."""
        before = get(criterion_ratio, l)
        put(criterion_ratio, l, wp.where(linked == real(0.0), before, wp.max(before, ratio)))
        worst = ratio
        if wp.static(test.damage != ""):
            worst = grown(ratio, get(break_damage, l), time, exponent, dt)
            put(break_damage, l, wp.where(linked == real(0.0), get(break_damage, l), worst))
        return wp.where(linked == real(0.0), real(0.0), worst)

    @wp.func
    def unlink(
        l: int,
        b: int,
        breaks: bool,
        normal: real,
        shear: real,
        bond_linked: wp.array(dtype=real),
        break_normal: wp.array(dtype=real),
        break_shear: wp.array(dtype=real),
        any_broken: wp.array(dtype=real),
    ):
        """Part a pair where it `breaks`, and keep what it carried. Without branches but the last:
        what they guard would be done lane by lane."""
        put(bond_linked, b, wp.where(breaks, real(0.0), get(bond_linked, b)))
        put(break_normal, l, wp.where(breaks, normal, get(break_normal, l)))
        put(break_shear, l, wp.where(breaks, shear, get(break_shear, l)))
        if breaks:
            any_broken[0] = real(1.0)

    @wp.func
    def left(worst: real, last: real) -> real:
        """Share of its stiffness that a softening bond keeps at its greatest ratio: secant to the
        line from the strength (1) to no stress at the ratio `last`."""
        return wp.max(last - worst, real(0.0)) / (worst * (last - real(1.0)))

    return Laws(judged=judged, unlink=unlink, left=left)


@cache
def break_bonds(s: Laws, k: Laws, faces: Faces, test: Test, is_contiguous: bool, simd: bool = True):
    """Pass over listed bonds: those whose equivalent stress exceeds their strength unlink.

    The greatest ratio of both is kept. Where bonds soften, what they carry counts as if they were
    whole, and `bond_keep` says which share of its stiffness a bond keeps in this step.
    is_contiguous: these bonds follow each other from `first_bond` on.
    """
    geometry, law, real = face(s, k, faces), pair_tensor(s), s.real
    rule, four = exceeding(s, test), criterion_numbers(s)
    is_strain = test.kind == "plastic_strain"
    equivalent = None if is_strain else criterion(s, test)

    def break_bonds(
        # model
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_area: wp.array(dtype=real),
        bond_strength: wp.array(dtype=real),
        softening_end: wp.array(dtype=real),
        interface_place: wp.array(dtype=int),
        # state read
        orientation: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        stress: wp.array(dtype=real),
        plastic_strain: wp.array(dtype=real),
        # written
        bond_linked: wp.array(dtype=real),
        bond_keep: wp.array(dtype=real),
        criterion_ratio: wp.array(dtype=real),
        break_damage: wp.array(dtype=real),
        break_normal: wp.array(dtype=real),
        break_shear: wp.array(dtype=real),
        any_broken: wp.array(dtype=real),
        number_1: real,
        number_2: real,
        number_3: real,
        number_4: real,
        time: real,
        exponent: real,
        dt: real,
        first: int,
        first_bond: int,
    ):
        l = nn(wp.tid() + first)
        b = nn(get(listed, l))
        if wp.static(is_contiguous):
            b = nn(wp.tid() + first_bond)
        linked = get(bond_linked, b)
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        n = s.embed(geometry.load_normal(b, bond_i, bond_j, bond_arm, orientation))
        over = real(1.0) / get(bond_area, b)
        if wp.static(test.is_interface):
            # the mean of both sides of the node: they differ by its mass times acceleration
            force = s.load(end_force, nn(get(interface_place, 2 * l)))
            force += s.load(end_force, nn(get(interface_place, 2 * l + 1)))
            traction = s.embed((real(0.5) * over) * force)
        else:
            traction = s.embed(over * s.load(end_force, nn(get(bond_place, 2 * b))))
        # linear interpolation to the face: the nearer centre weighs more (Shilko eq. 13)
        wi, wj = geometry.load_weights(b, bond_arm)
        if wp.static(is_strain):
            ratio = (wi * get(plastic_strain, i) + wj * get(plastic_strain, j)) / get(
                bond_strength, l
            )
        else:
            mean = wi * s.load_tensor(stress, i) + wj * s.load_tensor(stress, j)
            whole = traction
            if wp.static(test.softens):
                whole = (real(1.0) / wp.where(linked == real(0.0), real(1.0), linked)) * traction
            # a vector as an argument would stay one, and keep the loop from being vectorised
            numbers = four(number_1, number_2, number_3, number_4)
            ratio = equivalent(law.tensor(mean, whole, n), n, numbers) / get(bond_strength, l)
        ratio = rule.judged(l, ratio, linked, criterion_ratio, break_damage, time, exponent, dt)
        normal = wp.dot(traction, n)
        shear = wp.length(s.split(traction, n))
        if wp.static(test.softens):
            before = get(break_damage, l)
            softens = ratio > before
            kept = rule.left(wp.max(ratio, real(1.0)), get(softening_end, l))
            share = kept / wp.where(linked == real(0.0), real(1.0), linked)
            is_first = softens and linked == real(1.0)  # where it first failed
            put(break_damage, l, wp.where(softens, ratio, before))
            put(break_normal, l, wp.where(is_first, normal, get(break_normal, l)))
            put(break_shear, l, wp.where(is_first, shear, get(break_shear, l)))
            put(bond_keep, b, wp.where(softens, share, get(bond_keep, b)))
            put(bond_linked, b, wp.where(softens, kept, linked))
            if softens:
                any_broken[0] = real(1.0)
        else:
            rule.unlink(
                l, b, ratio > real(1.0), normal, shear, bond_linked, break_normal, break_shear,
                any_broken,
            )  # fmt: skip

    return kernel(break_bonds, simd)


@cache
def break_beams(s: Laws, test: Test, is_contiguous: bool, simd: bool = True):
    """Pass over listed EVM bonds: those whose stresses as beams exceed their strength unlink
    (Potyondy and Cundall 2004). What they carry is known from their forces; is_contiguous: see
    `break_bonds`."""
    real, rule = s.real, exceeding(s, test)

    def break_beams(
        # model
        listed: wp.array(dtype=int),
        bond_strength: wp.array(dtype=real),
        # state read
        beam_load: wp.array(dtype=real),
        # written
        bond_linked: wp.array(dtype=real),
        criterion_ratio: wp.array(dtype=real),
        break_damage: wp.array(dtype=real),
        break_normal: wp.array(dtype=real),
        break_shear: wp.array(dtype=real),
        any_broken: wp.array(dtype=real),
        number_1: real,
        number_2: real,
        number_3: real,
        number_4: real,
        time: real,
        exponent: real,
        dt: real,
        first: int,
        first_bond: int,
        first_evm: int,
    ):
        l = nn(wp.tid() + first)
        b = nn(get(listed, l))
        if wp.static(is_contiguous):
            b = nn(wp.tid() + first_bond)
        linked = get(bond_linked, b)
        c = nn(b - first_evm)
        # F_n/S + |M_b|/W and |F_s|/S + |M_t|/W_t; numbers: 1/S, 1/W, 1/W_t
        normal = get(beam_load, 4 * c) * number_1 + get(beam_load, 4 * c + 2) * number_2
        shear = get(beam_load, 4 * c + 1) * number_1 + get(beam_load, 4 * c + 3) * number_3
        ratio = wp.max(normal, shear * number_4) / get(bond_strength, l)
        ratio = rule.judged(l, ratio, linked, criterion_ratio, break_damage, time, exponent, dt)
        rule.unlink(
            l, b, ratio > real(1.0), normal, shear, bond_linked, break_normal, break_shear,
            any_broken,
        )  # fmt: skip

    return kernel(break_beams, simd)


@cache
def log_breaks(s: Laws, has_volume: bool, softens: bool, simd: bool = True):
    """Pass over bonds that broke just now, rows of the listed ones: stamp them with the step and
    the energy released.

    Bonds that soften release some in every step in which they do.
    """
    real = s.real

    def log_breaks(
        # model
        rows: wp.array(dtype=int),
        listed: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        # state read
        bond_linked: wp.array(dtype=real),
        bond_keep: wp.array(dtype=real),
        linked_energy: wp.array(dtype=real),
        closing_energy: wp.array(dtype=real),
        element_release: wp.array(dtype=real),
        # written
        break_step: wp.array(dtype=int),
        break_energy: wp.array(dtype=real),
        step: int,
    ):
        t = wp.tid()
        l = rows[t]
        b = get(listed, l)
        lost = real(1.0)
        if wp.static(softens):
            lost = real(1.0) - get(bond_keep, b)
        released = lost * linked_energy[t]
        if get(bond_linked, b) == real(0.0):
            released -= get(closing_energy, l)
            put(break_step, b, step)
        if wp.static(has_volume):
            released += element_release[get(bond_i, b)] + element_release[get(bond_j, b)]
        put(break_energy, l, get(break_energy, l) + released)

    return kernel(log_breaks, simd)


@cache
def part_interfaces(s: Laws, softens: bool, simd: bool = True):
    """Pass over bonds that may break between unlike elements: both halves part as the face does,
    and keep the share that it keeps."""
    real = s.real

    def part_interfaces(
        # model
        interface_bonds: wp.array(dtype=int),
        interface_halves: wp.array(dtype=int),
        # written
        bond_linked: wp.array(dtype=real),
        bond_keep: wp.array(dtype=real),
    ):
        t = wp.tid()
        b = interface_bonds[t]
        for side in range(2):
            half = interface_halves[2 * t + side]
            bond_linked[half] = get(bond_linked, b)
            if wp.static(softens):
                bond_keep[half] = get(bond_keep, b)

    return kernel(part_interfaces, simd)


@cache
def keep_nodes(s: Laws, k: Laws, faces: Faces, simd: bool = True):
    """Pass over bonds that may break between unlike elements: the node of a face that parted just
    now goes on with its first element, as a mass on a spring at its facet point.

    So mass and momentum stay where they are; the spring starts without force.
    """
    real, geometry = s.real, face(s, k, faces)

    def keep_nodes(
        # model
        interface_bonds: wp.array(dtype=int),
        interface_halves: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        point_stiffness: wp.array(dtype=real),
        # state read
        orientation: wp.array(dtype=k.real),
        bond_linked: wp.array(dtype=real),
        # written
        displacement: wp.array(dtype=k.real),
        facet_stiffness: wp.array(dtype=real),
    ):
        t = wp.tid()
        half = interface_halves[2 * t]
        if bond_linked[interface_bonds[t]] == real(0.0) and facet_stiffness[half] == real(0.0):
            i = bond_i[half]
            arm = geometry.load_arm(bond_arm, 2 * half)
            place = k.load(displacement, i) + k.turn(k.load_rot(orientation, i), arm)
            if wp.static(faces.has_jump):
                place -= k.load(bond_jump, half)
            k.store(displacement, bond_j[half], place)
            facet_stiffness[half] = point_stiffness[t]

    return kernel(keep_nodes, simd)

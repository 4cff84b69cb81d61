"""Fracture criteria: when a linked pair becomes unlinked (Shilko eq. 14, theory B10).

A criterion is an equivalent stress of the pair, of first degree in the stress, over a strength:
the pair breaks where their ratio exceeds 1. Wrappers change what happens with that ratio over time.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, isfinite, sin
from typing import Any, ClassVar

import numpy as np

from .errors import Array, InputError, checked, finite, positive
from .fields import von_mises
from .section import Section, check_section

NUMBERS = 4  # that a criterion's device form takes


@checked
@dataclass(frozen=True)
class HuberMisesHencky:
    """Breaks where the stress intensity of the pair exceeds `strength` [Pa] (Shilko eq. 14)."""

    strength: float

    kind: ClassVar[str] = "huber_mises_hencky"
    numbers: ClassVar[tuple[float, ...]] = ()

    def __post_init__(self) -> None:
        positive("strength", self.strength, ())

    @property
    def tension(self) -> float:
        """Strength in uniaxial tension [Pa]."""
        return self.strength


@checked
@dataclass(frozen=True)
class DruckerPrager:
    """Breaks where (a+1)/2 q + 3(a-1)/2 m exceeds the compressive strength (Shilko eq. 14).

    compression: strength in uniaxial compression [Pa]; ratio: a = compressive over tensile
    strength, at least 1. Uniaxial tension breaks at compression/ratio (theory B10).
    """

    compression: float
    ratio: float

    kind: ClassVar[str] = "drucker_prager"

    def __post_init__(self) -> None:
        positive("compression", self.compression, ())
        if finite("ratio", self.ratio, ()) < 1.0:
            raise InputError(f"ratio is {self.ratio:g}; compressive over tensile strength is >= 1.")

    @property
    def strength(self) -> float:
        """The threshold of eq. 14 [Pa]."""
        return self.compression

    @property
    def tension(self) -> float:
        """Strength in uniaxial tension [Pa]."""
        return self.compression / self.ratio

    @property
    def numbers(self) -> tuple[float, ...]:
        """a."""
        return (self.ratio,)


@checked
@dataclass(frozen=True)
class Rankine:
    """Breaks where the greatest principal stress of the pair exceeds `tension` [Pa]."""

    tension: float

    kind: ClassVar[str] = "rankine"
    numbers: ClassVar[tuple[float, ...]] = ()

    def __post_init__(self) -> None:
        positive("tension", self.tension, ())

    @property
    def strength(self) -> float:
        """The threshold [Pa]."""
        return self.tension


@checked
@dataclass(frozen=True)
class MohrCoulomb:
    """Breaks where s1 - s3 + (s1 + s3) sin(phi) exceeds 2 c cos(phi), or s1 the cut-off.

    s1, s3: greatest and least principal stress of the pair; cohesion: c [Pa]; friction_angle: phi
    [rad], from 0 to below pi/2; cutoff: tensile strength [Pa], by default none but the cone's own
    2 c cos(phi)/(1 + sin(phi)), which it may not exceed. Compression breaks at
    2 c cos(phi)/(1 - sin(phi)) (theory B10).
    """

    cohesion: float
    friction_angle: float
    cutoff: float | None = None

    kind: ClassVar[str] = "mohr_coulomb"

    def __post_init__(self) -> None:
        positive("cohesion", self.cohesion, ())
        if not 0.0 <= finite("friction_angle", self.friction_angle, ()) < 1.5:
            raise InputError(
                f"friction_angle is {self.friction_angle:g} rad; it must lie between 0 and 1.5 "
                "(85 degrees)."
            )
        if self.cutoff is not None:
            positive("cutoff", self.cutoff, ())
            if self.cutoff > self._apex * (1.0 + 1e-12):
                raise InputError(
                    f"the cut-off {self.cutoff:g} Pa is above {self._apex:g} Pa, at which the "
                    "criterion breaks in tension anyway; give a smaller one or leave it out."
                )

    @property
    def _apex(self) -> float:
        return self.strength / (1.0 + sin(self.friction_angle))

    @property
    def strength(self) -> float:
        """2 c cos(phi) [Pa]."""
        return 2.0 * self.cohesion * cos(self.friction_angle)

    @property
    def tension(self) -> float:
        """Strength in uniaxial tension [Pa]."""
        return self._apex if self.cutoff is None else self.cutoff

    @property
    def compression(self) -> float:
        """Strength in uniaxial compression [Pa]."""
        return self.strength / (1.0 - sin(self.friction_angle))

    @property
    def numbers(self) -> tuple[float, ...]:
        """sin(phi), and the strength over the cut-off."""
        return sin(self.friction_angle), self.strength / self.tension


@checked
@dataclass(frozen=True)
class MixedMode:
    """Breaks where (<s>/tension)^2 + (tau/shear)^2 exceeds 1, on the face itself (theory B10).

    s: normal stress on the pair's face, of which only tension counts; tau: shear stress there;
    both strengths in Pa. Looks at one plane only, so it knows directions of the packing.
    """

    tension: float
    shear: float

    kind: ClassVar[str] = "mixed_mode"

    def __post_init__(self) -> None:
        positive("tension", self.tension, ())
        positive("shear", self.shear, ())

    @property
    def strength(self) -> float:
        """The threshold [Pa]."""
        return self.tension

    @property
    def numbers(self) -> tuple[float, ...]:
        """Tensile over shear strength."""
        return (self.tension / self.shear,)


@checked
@dataclass(frozen=True)
class PlasticStrainLimit:
    """Breaks where the equivalent plastic strain of the pair exceeds `strain`.

    That of its two elements, interpolated to the face (Shilko eq. 11). Needs a yield law.
    """

    strain: float

    kind: ClassVar[str] = "plastic_strain"
    numbers: ClassVar[tuple[float, ...]] = ()

    def __post_init__(self) -> None:
        positive("strain", self.strain, ())

    @property
    def strength(self) -> float:
        """The greatest strain."""
        return self.strain


@checked
@dataclass(frozen=True)
class CustomCriterion:
    """Breaks where a Warp function of the pair's stress exceeds `strength` [Pa].

    function: a `wp.func` of the stress tensor (3, 3) [Pa], the face's unit normal (3,) and a vector
    of the four `numbers`, in the precision of forces: annotate them with `Any`, or with
    `wp.mat33d`, `wp.vec3d`, `wp.vec4d` for float64 alone. It returns an equivalent stress. numbers:
    up to four, arguments of the kernel, so that changing one compiles nothing.
    """

    function: Callable[..., Any]
    strength: float
    numbers: tuple[float, ...] = ()

    kind: ClassVar[str] = "custom"

    def __post_init__(self) -> None:
        if type(self.function).__name__ != "Function":
            raise InputError("function must be a Warp function: decorate it with @wp.func.")
        positive("strength", self.strength, ())
        finite("numbers", self.numbers, (None,))
        object.__setattr__(self, "numbers", tuple(map(float, self.numbers)))
        if len(self.numbers) > NUMBERS:
            raise InputError(f"{len(self.numbers)} numbers are given; four are the most.")


@checked
@dataclass(frozen=True)
class BeamLimit:
    """Breaks an EVM bond by the stresses of the beam that it is (Potyondy and Cundall 2004).

    Where F_n/S + |M_b|/W exceeds `tension` or |F_s|/S + |M_t|/W_t exceeds `shear` [Pa], the moments
    being those at the bond's ends. section: a Circle, a Tube or a Rectangle, with its moduli W and
    W_t. Needs no faces, so it is for networks too.
    """

    tension: float
    shear: float
    section: Section

    kind: ClassVar[str] = "beam"

    def __post_init__(self) -> None:
        for name in ("tension", "shear"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name} is {getattr(self, name)}; it must be greater than zero.")
        if not isfinite(self.tension):
            raise InputError("the tensile strength of a beam must be finite.")
        check_section(self.section)

    @property
    def strength(self) -> float:
        """The threshold [Pa]."""
        return self.tension

    @property
    def numbers(self) -> tuple[float, ...]:
        """1/S, 1/W, 1/W_t, and tensile over shear strength."""
        x = self.section
        moduli = x.area, x.section_modulus, x.torsion_modulus
        return *(1.0 / m for m in moduli), self.tension / self.shear


Criterion = (
    HuberMisesHencky
    | DruckerPrager
    | Rankine
    | MohrCoulomb
    | MixedMode
    | PlasticStrainLimit
    | CustomCriterion
    | BeamLimit
)
Tensile = HuberMisesHencky | DruckerPrager | Rankine | MohrCoulomb | MixedMode  # by their tension


def with_tension(criterion: Tensile, tension: float) -> Tensile:
    """The same form of criterion at another strength in uniaxial tension [Pa]."""
    scale = tension / criterion.tension
    if isinstance(criterion, MohrCoulomb):
        cutoff = None if criterion.cutoff is None else criterion.cutoff * scale
        return replace(criterion, cohesion=criterion.cohesion * scale, cutoff=cutoff)
    if isinstance(criterion, DruckerPrager):
        return replace(criterion, compression=criterion.compression * scale)
    if isinstance(criterion, HuberMisesHencky):
        return replace(criterion, strength=criterion.strength * scale)
    if isinstance(criterion, MixedMode):
        return MixedMode(tension, criterion.shear * scale)
    return Rankine(tension)


def equivalent_stress(criterion: Tensile, stress: Array, normal: Array) -> float:
    """What a criterion makes of a stress tensor (3, 3) [Pa] on a face of unit normal (3,).

    The host's twin of kernels/fracture.py, for stresses that are at hand: Shilko eq. 14.
    """
    if isinstance(criterion, MixedMode):
        traction = stress @ normal
        along = traction @ normal
        across = np.linalg.norm(traction - along * normal)
        return float(np.hypot(max(float(along), 0.0), float(across) * criterion.numbers[0]))
    third, _, first = np.linalg.eigvalsh(stress)
    if isinstance(criterion, Rankine):
        return float(first)
    if isinstance(criterion, MohrCoulomb):
        sine, cut = criterion.numbers
        return float(max(first - third + (first + third) * sine, first * cut))
    intensity = float(von_mises(stress[None])[0])
    if isinstance(criterion, HuberMisesHencky):
        return intensity
    a = criterion.ratio
    return 0.5 * (a + 1.0) * intensity + 0.5 * (a - 1.0) * float(np.trace(stress))


@checked
@dataclass(frozen=True)
class Incubation:
    """A criterion that must be exceeded for some time: strength grows with the rate.

    The pair breaks where y > 1 with dy/dt = (R - y)/time, R the criterion's ratio: the criterion of
    incubation time (Petrov and Morozov 1994) with an exponential window. Slow loads break at the
    criterion's strength, short pulses by their impulse; a constant R > 1 breaks after
    time ln(R/(R - 1)).
    """

    criterion: Criterion
    time: float

    damage: ClassVar[str] = "incubation"

    def __post_init__(self) -> None:
        _inner(self.criterion)
        positive("time", self.time, ())

    @property
    def rate(self) -> tuple[float, float]:
        """Time [s] and exponent."""
        return self.time, 1.0


@checked
@dataclass(frozen=True)
class DamageRate:
    """A criterion below which damage grows too: the pair breaks where D > 1, dD/dt = R^n/time.

    R: the criterion's ratio, not below 0; at a constant R it lasts time/R^n, so that n is the
    exponent of static fatigue and of the growth of strength with rate (theory B10).
    """

    criterion: Criterion
    time: float
    exponent: float

    damage: ClassVar[str] = "power"

    def __post_init__(self) -> None:
        _inner(self.criterion)
        positive("time", self.time, ())
        positive("exponent", self.exponent, ())

    @property
    def rate(self) -> tuple[float, float]:
        """Time [s] and exponent."""
        return self.time, self.exponent


@checked
@dataclass(frozen=True)
class LinearSoftening:
    """A cohesive bond: beyond its strength the pair's stress falls linearly with its opening.

    fracture_energy: G_c [J/m^2] of a crack that opens along the plane of flattest faces; its bonds
    lose the last of their stress at an opening of 2 G_c/tension. Unloading leads back to the
    origin, in compression too. Bonds must be short enough for it: r0 times the packing's flatness
    below 2 G_c (lambda + 2G)/tension^2 (theory B10).
    """

    criterion: Tensile
    fracture_energy: float

    def __post_init__(self) -> None:
        _inner(self.criterion, Tensile)
        positive("fracture_energy", self.fracture_energy, ())


Fracture = Criterion | Incubation | DamageRate | LinearSoftening


def criterion_of(fracture: Fracture) -> Criterion:
    """The criterion itself, without what is wrapped around it."""
    if isinstance(fracture, Incubation | DamageRate | LinearSoftening):
        return fracture.criterion
    return fracture


def weaker(one: Fracture | None, other: Fracture | None) -> Fracture | None:
    """Of the criteria of two materials the one that a bond between them breaks by.

    The one of lower strength in tension, and of lower fracture energy if both soften; None is
    stronger than any. Raises InputError where neither is the weaker one.
    """
    if one is None or other is None or one == other:
        return other if one is None else one
    both = [x.criterion if isinstance(x, LinearSoftening) else x for x in (one, other)]
    softens = [isinstance(x, LinearSoftening) for x in (one, other)]
    if all(isinstance(x, Tensile) for x in both) and softens[0] == softens[1]:
        energy = [getattr(x, "fracture_energy", 0.0) for x in (one, other)]
        for law, k in ((one, 0), (other, 1)):
            lower = both[k].tension <= both[1 - k].tension  # type: ignore[union-attr]
            if lower and energy[k] <= energy[1 - k]:
                return law
    raise InputError(
        f"of {one} and {other} neither is the weaker criterion; give that of bonds between the two "
        "materials by pairs={(a, b): criterion}."
    )


def _inner(criterion: object, allowed: Any = Criterion) -> None:
    if not isinstance(criterion, allowed):
        raise InputError(f"criterion is {criterion!r}; give one such as Rankine or DruckerPrager.")

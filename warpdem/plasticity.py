"""Yield laws: when an element flows, and how its flow stress grows (Shilko 9-12, theory B6)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .errors import Array, InputError, checked, finite, positive


@checked
@dataclass(frozen=True)
class Voce:
    """Hardening that saturates: saturation (1 - exp(-rate p)) + modulus p [Pa].

    A saturation below zero softens, down to a flow stress that must stay above zero.
    """

    saturation: float
    rate: float
    modulus: float = 0.0

    kind: ClassVar[str] = "voce"

    def __post_init__(self) -> None:
        finite("saturation", self.saturation, ())
        positive("rate", self.rate, ())
        _not_negative(self.modulus)

    @property
    def numbers(self) -> tuple[float, float, float]:
        """What the device's law takes."""
        return self.saturation, self.rate, self.modulus

    @property
    def least(self) -> float:
        """Least growth of the flow stress [Pa]."""
        return min(self.saturation, 0.0)

    @property
    def fall(self) -> float:
        """Steepest softening, -d(stress)/dp [Pa], or 0."""
        return max(-self.saturation * self.rate - self.modulus, 0.0)

    def stress(self, p: Array) -> Array:
        """Growth of the flow stress at plastic strains p [Pa]."""
        return self.saturation * -np.expm1(-self.rate * p) + self.modulus * p


@checked
@dataclass(frozen=True)
class PowerLaw:
    """Hardening modulus ((offset + p)^exponent - offset^exponent) [Pa].

    Ludwik's law, or with an offset Swift's.
    """

    modulus: float
    exponent: float
    offset: float = 0.0

    kind: ClassVar[str] = "power"
    least: ClassVar[float] = 0.0
    fall: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        positive("modulus", self.modulus, ())
        positive("exponent", self.exponent, ())
        if finite("offset", self.offset, ()) < 0.0:
            raise InputError(f"offset is {self.offset:g}; it must not be negative.")

    @property
    def numbers(self) -> tuple[float, float, float]:
        """What the device's law takes."""
        return self.modulus, self.exponent, self.offset

    def stress(self, p: Array) -> Array:
        """Growth of the flow stress at plastic strains p [Pa]."""
        grown = (self.offset + p) ** self.exponent - self.offset**self.exponent
        return self.modulus * grown


@checked
@dataclass(frozen=True)
class Linear:
    """Hardening modulus p [Pa]."""

    modulus: float

    kind: ClassVar[str] = "linear"
    least: ClassVar[float] = 0.0
    fall: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        _not_negative(self.modulus)

    @property
    def numbers(self) -> tuple[float, float, float]:
        """What the device's law takes."""
        return self.modulus, 0.0, 0.0

    def stress(self, p: Array) -> Array:
        """Growth of the flow stress at plastic strains p [Pa]."""
        return self.modulus * np.asarray(p)


@checked
@dataclass(frozen=True)
class Table:
    """Hardening as measured: growth of the flow stress [Pa] at plastic strains that rise from 0.

    Between points it is linear, beyond the last one constant. It may fall: softening gathers in
    bands one element wide, so that what is dissipated depends on the elements' size.
    """

    plastic_strain: Sequence[float]
    growth: Sequence[float]

    kind: ClassVar[str] = "table"

    def __post_init__(self) -> None:
        p = finite("plastic_strain", self.plastic_strain, (None,))
        g = finite("growth", self.growth, (None,))
        if len(p) != len(g) or len(p) < 2 or (np.diff(p) <= 0.0).any():
            raise InputError("a hardening table needs two points or more, at growing strains.")
        if p[0] != 0.0 or g[0] != 0.0:
            raise InputError("a hardening table starts with growth 0 at plastic strain 0.")
        object.__setattr__(self, "plastic_strain", tuple(p.tolist()))
        object.__setattr__(self, "growth", tuple(g.tolist()))

    @property
    def least(self) -> float:
        """Least growth of the flow stress [Pa]."""
        return min(self.growth)

    @property
    def fall(self) -> float:
        """Steepest softening, -d(stress)/dp [Pa], or 0."""
        return float(np.max(-np.diff(self.growth) / np.diff(self.plastic_strain), initial=0.0))

    def stress(self, p: Array) -> Array:
        """Growth of the flow stress at plastic strains p [Pa]."""
        return np.interp(p, self.plastic_strain, self.growth)


@checked
@dataclass(frozen=True)
class Perzyna:
    """Viscous overstress: the flow stress is sigma(p) (1 + (time dp/dt)^(1/exponent))."""

    time: float
    exponent: float = 1.0

    kind: ClassVar[str] = "perzyna"

    def __post_init__(self) -> None:
        positive("time", self.time, ())
        positive("exponent", self.exponent, ())

    @property
    def numbers(self) -> tuple[float, float]:
        """What the device's law takes."""
        return self.time, self.exponent


@checked
@dataclass(frozen=True)
class JohnsonCook:
    """Flow stress sigma(p) (1 + coefficient ln(dp/dt / reference_rate)), at least sigma(p).

    With `PowerLaw` hardening the law of Johnson and Cook at constant temperature.
    """

    coefficient: float
    reference_rate: float = 1.0

    kind: ClassVar[str] = "johnson_cook"

    def __post_init__(self) -> None:
        positive("coefficient", self.coefficient, ())
        positive("reference_rate", self.reference_rate, ())

    @property
    def numbers(self) -> tuple[float, float]:
        """What the device's law takes."""
        return self.coefficient, self.reference_rate


Hardening = Linear | Voce | PowerLaw | Table
Rate = Perzyna | JohnsonCook


@checked
@dataclass(frozen=True)
class VonMises:
    """Flows where the stress intensity reaches the flow stress (Shilko 9-12).

    yield_stress: at no plastic strain [Pa], in uniaxial tension; hardening: a modulus [Pa] (0:
    perfect plasticity), or Voce, PowerLaw, Table; rate: Perzyna, JohnsonCook, or None.
    """

    yield_stress: float
    hardening: Hardening | float = 0.0
    rate: Rate | None = None

    friction: ClassVar[float] = 0.0
    dilatancy: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        positive("yield_stress", self.yield_stress, ())
        _complete(self)

    def flow_stress(self, plastic_strain: Array) -> Array:
        """Stress intensity of slow flow at plastic strains [Pa]."""
        assert not isinstance(self.hardening, int | float)
        return self.yield_stress + self.hardening.stress(np.asarray(plastic_strain))


@checked
@dataclass(frozen=True)
class Nikolaevsky:
    """Rocks' flow: q + friction m reaches the flow stress, with dilatancy (theory B6).

    q: stress intensity; m: mean stress, tension positive; yield_stress: Y [Pa], that of q where
    m = 0; friction: alpha, >= 0; dilatancy: growth of the volume strain over that of the
    plastic strain, from 0 to friction. Uniaxial compression flows at Y/(1 - alpha/3), tension at
    Y/(1 + alpha/3). Where tension leaves no deviator (the cone's tip) volume grows until
    alpha m = Y; without dilatancy any m stays. Not for plane stress.
    """

    yield_stress: float
    friction: float
    dilatancy: float = 0.0
    hardening: Hardening | float = 0.0
    rate: Rate | None = None

    def __post_init__(self) -> None:
        positive("yield_stress", self.yield_stress, ())
        if not 0.0 <= finite("friction", self.friction, ()) < 3.0:
            raise InputError(f"friction is {self.friction:g}; it must lie between 0 and 3.")
        if not 0.0 <= finite("dilatancy", self.dilatancy, ()) <= self.friction:
            raise InputError(
                f"dilatancy is {self.dilatancy:g}; it must lie between 0 and the friction "
                f"{self.friction:g}, or flow could create energy."
            )
        _complete(self)

    def flow_stress(self, plastic_strain: Array) -> Array:
        """Stress intensity of slow flow under no pressure at plastic strains [Pa]."""
        assert not isinstance(self.hardening, int | float)
        return self.yield_stress + self.hardening.stress(np.asarray(plastic_strain))


YieldLaw = VonMises | Nikolaevsky


def softening(law: YieldLaw) -> float:
    """Steepest fall of the flow stress, -d(stress)/dp [Pa], or 0."""
    assert not isinstance(law.hardening, int | float)
    return law.hardening.fall


def _not_negative(modulus: float) -> None:
    if finite("modulus", modulus, ()) < 0.0:
        raise InputError(
            f"the hardening modulus is {modulus:g} Pa; it must not be negative: give softening as "
            "a Table, whose end is the residual stress."
        )


def _complete(law: YieldLaw) -> None:
    """Check hardening and rate; a number for hardening is a modulus."""
    if isinstance(law.hardening, int | float):
        object.__setattr__(law, "hardening", Linear(float(law.hardening)))
    elif not isinstance(law.hardening, Hardening):
        raise InputError("hardening is a modulus [Pa], or Voce, PowerLaw or Table.")
    assert isinstance(law.hardening, Hardening)
    left = law.yield_stress + law.hardening.least
    if left <= 0.0:
        raise InputError(
            f"the flow stress would fall to {left:g} Pa; let it soften to a residual stress above "
            "zero."
        )
    if law.rate is not None and not isinstance(law.rate, Rate):
        raise InputError("rate is Perzyna, JohnsonCook or None.")

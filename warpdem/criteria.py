"""Fracture criteria: when a linked pair becomes unlinked (Shilko eq. 14)."""

from dataclasses import dataclass

from .errors import InputError, finite, positive


@dataclass(frozen=True)
class HuberMisesHencky:
    """Breaks where the stress intensity of the pair exceeds `strength` [Pa] (Shilko eq. 14)."""

    strength: float

    kind = "huber_mises_hencky"
    ratio = 1.0

    def __post_init__(self) -> None:
        positive("strength", self.strength, ())

    @property
    def tension(self) -> float:
        """Strength in uniaxial tension [Pa]."""
        return self.strength


@dataclass(frozen=True)
class DruckerPrager:
    """Breaks where (a+1)/2 q + 3(a-1)/2 m exceeds the compressive strength (Shilko eq. 14).

    compression: strength in uniaxial compression [Pa]; ratio: a = compressive over tensile
    strength, at least 1. Uniaxial tension breaks at compression/ratio (theory B10).
    """

    compression: float
    ratio: float

    kind = "drucker_prager"

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


@dataclass(frozen=True)
class Rankine:
    """Breaks where the greatest principal stress of the pair exceeds `tension` [Pa]."""

    tension: float

    kind = "rankine"
    ratio = 1.0

    def __post_init__(self) -> None:
        positive("tension", self.tension, ())

    @property
    def strength(self) -> float:
        """The threshold [Pa]."""
        return self.tension


Criterion = HuberMisesHencky | DruckerPrager | Rankine

"""Viscoelastic laws of the deviator; the mean stress stays elastic (theory B12)."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import Array, InputError, checked, finite, positive


class Branches(ABC):
    """What laws of springs and dashpots in series have in common."""

    retardation = 0.0

    @abstractmethod
    def series(self) -> tuple[Array, Array]:
        """Shares g_k of the instantaneous shear modulus and times T_k [s] of all branches."""

    def relaxation(self, time: ArrayLike) -> Array:
        """G(t)/G at times [s] after a step of strain: 1 - sum g_k (1 - exp(-t/T_k))."""
        g, times = self.series()
        t = np.asarray(time, dtype=np.float64)[..., None]
        return 1.0 + (g * np.expm1(-t / times)).sum(axis=-1)

    def complex_modulus(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """G*/G at angular frequencies [rad/s]: storage modulus + i loss modulus."""
        g, times = self.series()
        x = 1j * np.asarray(frequency, dtype=np.float64)[..., None] * times
        return 1.0 - (g / (1.0 + x)).sum(axis=-1)


@checked
@dataclass(frozen=True)
class Prony(Branches):
    """Branches of a spring and a dashpot in series, beside a spring: a Prony series.

    G(t) = G (1 - sum g_k + sum g_k exp(-t/T_k)), G the material's shear modulus: its moduli are the
    **instantaneous** ones. shares g_k > 0, with a sum of 1 at most (at 1 it is a fluid); times T_k
    [s] of relaxation.
    """

    shares: Sequence[float]
    times: Sequence[float]

    def __post_init__(self) -> None:
        g = positive("shares", self.shares, (None,))
        t = positive("times", self.times, (None,))
        if len(g) != len(t) or len(g) == 0:
            raise InputError(
                f"a Prony series has {len(g)} shares and {len(t)} times; give one of each a branch."
            )
        if g.sum() > 1.0 + 1e-12:
            raise InputError(
                f"the shares of a Prony series sum up to {g.sum():g}; they are shares of the "
                "instantaneous shear modulus, 1 at most in all."
            )
        object.__setattr__(self, "shares", tuple(g.tolist()))
        object.__setattr__(self, "times", tuple(t.tolist()))

    def series(self) -> tuple[Array, Array]:
        """Shares and times of all branches."""
        return np.array(self.shares), np.array(self.times)


@checked
@dataclass(frozen=True)
class Maxwell(Branches):
    """A spring and a dashpot of viscosity G time in series, a fluid: G(t) = G exp(-t/time).

    The material's moduli are the **instantaneous** ones; time [s] of relaxation.
    """

    time: float

    def __post_init__(self) -> None:
        positive("time", self.time, ())

    def series(self) -> tuple[Array, Array]:
        """Shares and times of all branches."""
        return np.ones(1), np.array([self.time])


@checked
@dataclass(frozen=True)
class StandardLinearSolid(Branches):
    """Zener's solid: G(t) = G (1 - share + share exp(-t/time)).

    The material's moduli are the **instantaneous** ones; a share (to 1) of G relaxes in time [s].
    """

    share: float
    time: float

    def __post_init__(self) -> None:
        positive("time", self.time, ())
        if not 0.0 < finite("share", self.share, ()) <= 1.0:
            raise InputError(f"share is {self.share:g}; it must lie above 0, and be 1 at most.")

    def series(self) -> tuple[Array, Array]:
        """Shares and times of all branches."""
        return np.array([self.share]), np.array([self.time])


@checked
@dataclass(frozen=True)
class KelvinVoigt:
    """A spring and a dashpot side by side: the deviator is 2 G (e + time de/dt).

    The material's moduli are the **relaxed** ones, those of the spring; time [s] of retardation:
    the viscosity is G time [Pa s]. Strong viscosity shortens the stable time step.
    """

    time: float

    def __post_init__(self) -> None:
        positive("time", self.time, ())

    @property
    def retardation(self) -> float:
        """Viscosity over shear modulus [s]."""
        return self.time

    def series(self) -> tuple[Array, Array]:
        """Shares and times of branches: there is none."""
        return np.zeros(0), np.zeros(0)

    def complex_modulus(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """G*/G at angular frequencies [rad/s]: storage modulus + i loss modulus."""
        x = np.asarray(frequency, dtype=np.complex128)
        return 1.0 + 1j * self.time * x


ViscousLaw = Prony | Maxwell | StandardLinearSolid | KelvinVoigt

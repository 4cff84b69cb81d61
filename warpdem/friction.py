"""Laws of friction: Coulomb's number, and rate and state (theory B11)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .errors import Array, InputError, checked, finite, not_negative, positive
from .material import Material

LAWS = ("aging", "slip")


@checked
@dataclass(frozen=True)
class RateAndState:
    """Rate-and-state friction of Dieterich and Ruina, regularised (Rice and Ben-Zion).

        mu = a asinh(V/(2 V0) exp((mu0 + b ln(V0 theta/Dc))/a))

    V [m/s] is the slip rate, theta [s] the state of a pair: its contact's age in the steady state.
    mu0: friction at the rate V0 [m/s]; a > 0: direct effect; b >= 0: of the state; Dc [m]: slip
    over which the state is renewed; law: "aging" (Dieterich), theta' = 1 - V theta/Dc, or "slip"
    (Ruina), theta' = -(V theta/Dc) ln(V theta/Dc); theta0 [s]: state of a pair as it comes to
    touch, by default Dc/V0, that of a steady slip at V0.

    Raises InputError unless mu0, a, V0, Dc, theta0 > 0 and b >= 0.
    """

    mu0: float
    a: float
    b: float
    V0: float
    Dc: float
    law: str = "aging"
    theta0: float | None = None

    def __post_init__(self) -> None:
        for name in ("mu0", "a", "V0", "Dc"):
            positive(name, getattr(self, name), ())
        if float(finite("b", self.b, ())) < 0.0:
            raise InputError(f"b is {self.b:g}; give 0 or more.")
        if self.law not in LAWS:
            raise InputError(f"law is {self.law!r}; choose from {LAWS}.")
        if self.theta0 is not None:
            positive("theta0", self.theta0, ())

    def steady(self, rate: ArrayLike) -> Array:
        """Friction in steady slip at rates [m/s]: theta = Dc/V."""
        v = np.asarray(rate, dtype=np.float64) / self.V0
        return self.a * np.arcsinh(0.5 * v * np.exp((self.mu0 - self.b * np.log(v)) / self.a))

    def critical_stiffness(self, pressure: float) -> float:
        """Stiffness per area [Pa/m] below which steady slip under a pressure [Pa] is unstable:
        sigma (b - a)/Dc (Ruina 1983); of forces [N], [N/m]."""
        return pressure * (self.b - self.a) / self.Dc


Friction = float | RateAndState


def checked_friction(friction: Friction) -> Friction:
    """A law of friction, or Coulomb's number that is not negative."""
    if isinstance(friction, RateAndState):
        return friction
    return not_negative("friction", friction)


def checked_pairs(
    pairs: Mapping[tuple[Material, Material], Friction] | None,
) -> dict[frozenset[Material], Friction]:
    """Laws of friction between pairs of materials, in either order."""
    laws: dict[frozenset[Material], Friction] = {}
    for pair, friction in (pairs or {}).items():
        if not (
            isinstance(pair, tuple)
            and len(pair) == 2
            and all(isinstance(m, Material) for m in pair)
        ):
            raise InputError(f"pairs has the key {pair!r}; give pairs of materials, (a, b).")
        law = checked_friction(friction)
        if laws.setdefault(frozenset(pair), law) != law:
            raise InputError("pairs has two laws for one pair of materials; give it once.")
    return laws


def rubs(friction: Friction) -> bool:
    """Whether it resists sliding at all."""
    return isinstance(friction, RateAndState) or friction > 0.0


def coulomb(friction: Friction) -> float:
    """Coulomb's number; of rate and state mu0."""
    return friction.mu0 if isinstance(friction, RateAndState) else friction


def numbers(friction: Friction) -> tuple[float, ...]:
    """As kernels read them: mu0, a, b, V0, Dc, theta0, and whether the slip law holds. a = 0 is
    Coulomb's law."""
    if not isinstance(friction, RateAndState):
        return (friction, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    f = friction
    theta0 = f.Dc / f.V0 if f.theta0 is None else f.theta0
    return (f.mu0, f.a, f.b, f.V0, f.Dc, theta0, float(f.law == "slip"))

"""Cross sections of bonds: area, second moment, torsion constant, shear coefficient."""

from dataclasses import dataclass
from math import cosh, pi, tanh
from typing import Protocol

from .errors import InputError, checked, positive


class Section(Protocol):
    """What a bond asks of its cross section; any object with these will do."""

    @property
    def area(self) -> float:
        """S [m^2]."""

    @property
    def second_moment(self) -> float:
        """J [m^4] of bending; of a rectangle, of bending in its plane."""

    @property
    def torsion_constant(self) -> float:
        """J_p [m^4] of Saint-Venant's torsion; of circles the polar moment."""

    @property
    def section_modulus(self) -> float:
        """W [m^3]: moment over the greatest stress in bending."""

    @property
    def torsion_modulus(self) -> float:
        """W_t [m^3]: moment over the greatest shear stress in torsion."""

    @property
    def bends_alike(self) -> bool:
        """Whether J is the same for every transverse direction."""

    def shear_coefficient(self, poisson: float) -> float:
        """k of Timoshenko's beam."""


def check_section(section: object) -> None:
    """Refuse what is no cross section."""
    if not hasattr(section, "second_moment"):
        raise InputError(f"section is {section!r}; give a Circle, a Tube or a Rectangle.")


@checked
@dataclass(frozen=True)
class Circle:
    """A solid circle of a radius [m]."""

    radius: float

    def __post_init__(self) -> None:
        positive("radius", self.radius, ())

    @property
    def area(self) -> float:
        """S [m^2]."""
        return pi * self.radius**2

    @property
    def second_moment(self) -> float:
        """J [m^4]."""
        return pi * self.radius**4 / 4.0

    @property
    def torsion_constant(self) -> float:
        """J_p [m^4]."""
        return pi * self.radius**4 / 2.0

    @property
    def section_modulus(self) -> float:
        """W [m^3]."""
        return self.second_moment / self.radius

    @property
    def torsion_modulus(self) -> float:
        """W_t [m^3]."""
        return self.torsion_constant / self.radius

    @property
    def bends_alike(self) -> bool:
        """A circle does."""
        return True

    def shear_coefficient(self, poisson: float) -> float:
        """Cowper 1966: 6 (1 + nu)/(7 + 6 nu)."""
        return 6.0 * (1.0 + poisson) / (7.0 + 6.0 * poisson)


@checked
@dataclass(frozen=True)
class Tube:
    """A circle of radius `outer` [m] with a hole of radius `inner` [m]."""

    outer: float
    inner: float

    def __post_init__(self) -> None:
        positive("outer", self.outer, ())
        positive("inner", self.inner, ())
        if not self.inner < self.outer:
            raise InputError(
                f"the tube's inner radius {self.inner:g} m is not below its outer radius "
                f"{self.outer:g} m; give a smaller one."
            )

    @property
    def area(self) -> float:
        """S [m^2]."""
        return pi * (self.outer**2 - self.inner**2)

    @property
    def second_moment(self) -> float:
        """J [m^4]."""
        return pi * (self.outer**4 - self.inner**4) / 4.0

    @property
    def torsion_constant(self) -> float:
        """J_p [m^4]."""
        return pi * (self.outer**4 - self.inner**4) / 2.0

    @property
    def section_modulus(self) -> float:
        """W [m^3]."""
        return self.second_moment / self.outer

    @property
    def torsion_modulus(self) -> float:
        """W_t [m^3]."""
        return self.torsion_constant / self.outer

    @property
    def bends_alike(self) -> bool:
        """A tube does."""
        return True

    def shear_coefficient(self, poisson: float) -> float:
        """Cowper 1966, with m the ratio of the radii."""
        square = (self.inner / self.outer) ** 2
        whole = (1.0 + square) ** 2
        return (
            6.0
            * (1.0 + poisson)
            * whole
            / ((7.0 + 6.0 * poisson) * whole + (20.0 + 12.0 * poisson) * square)
        )


@checked
@dataclass(frozen=True)
class Rectangle:
    """A rectangle: height [m] in the plane in which it bends, width [m] across it.

    In space only a square will do: an EVM bond bends alike in all directions.
    """

    width: float
    height: float

    def __post_init__(self) -> None:
        positive("width", self.width, ())
        positive("height", self.height, ())

    @property
    def area(self) -> float:
        """S [m^2]."""
        return self.width * self.height

    @property
    def second_moment(self) -> float:
        """J [m^4] of bending in the plane of the height."""
        return self.width * self.height**3 / 12.0

    @property
    def torsion_constant(self) -> float:
        """Saint-Venant's series [m^4], to rounding."""
        long, short = max(self.width, self.height), min(self.width, self.height)
        series = sum(tanh(n * pi * long / (2.0 * short)) / n**5 for n in range(1, 1001, 2))
        return long * short**3 * (1.0 - 192.0 / pi**5 * short / long * series) / 3.0

    @property
    def section_modulus(self) -> float:
        """W [m^3] of bending in the plane of the height."""
        return self.width * self.height**2 / 6.0

    @property
    def torsion_modulus(self) -> float:
        """Saint-Venant's series [m^3]: shear is greatest in the middle of a long side."""
        long, short = max(self.width, self.height), min(self.width, self.height)
        steps = ((n, min(0.5 * n * pi * long / short, 700.0)) for n in range(1, 200, 2))
        left = sum(1.0 / (n * n * cosh(x)) for n, x in steps)
        return self.torsion_constant / (short * (1.0 - 8.0 / pi**2 * left))

    @property
    def bends_alike(self) -> bool:
        """Whether it is a square."""
        return self.width == self.height

    def shear_coefficient(self, poisson: float) -> float:
        """Cowper 1966: 10 (1 + nu)/(12 + 11 nu)."""
        return 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)

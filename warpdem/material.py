"""Elastic constants, density and wave speeds of an isotropic solid."""

from dataclasses import dataclass
from math import sqrt

from .errors import InputError, checked, finite, one_of, positive

PLANES = ("strain", "stress", None)


@checked
@dataclass(frozen=True)
class Material:
    """An isotropic elastic solid.

    young: Young's modulus E [Pa]; poisson: Poisson's ratio, -1 < nu < 0.5; density [kg/m^3].
    Raises InputError outside these ranges.
    """

    young: float
    poisson: float
    density: float

    def __post_init__(self) -> None:
        positive("young", self.young, ())
        positive("density", self.density, ())
        if not -1.0 < finite("poisson", self.poisson, ()) < 0.5:
            raise InputError(f"poisson is {self.poisson:g}; it must lie between -1 and 0.5.")

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)) [Pa]."""
        return self.young / (2.0 * (1.0 + self.poisson))

    @property
    def bulk_modulus(self) -> float:
        """K = E / (3 (1 - 2 nu)) [Pa]."""
        return self.young / (3.0 * (1.0 - 2.0 * self.poisson))

    @property
    def coupling(self) -> float:
        """D = 1 - 2G/(3K) = 3 nu/(1 + nu), the share of the mean stress in Hooke's law.

        Shilko eqs 6-8 print 1 - 2G/K, which is right only if K there is 3 K_bulk (theory B3).
        """
        return 3.0 * self.poisson / (1.0 + self.poisson)

    def lame(self, plane: str | None = None) -> float:
        """First Lame constant lambda [Pa]; in plane stress 2 G nu/(1 - nu)."""
        one_of("plane", plane, PLANES)
        nu = self.poisson
        across = 1.0 - nu if plane == "stress" else 1.0 - 2.0 * nu
        return 2.0 * self.shear_modulus * nu / across

    def plane_modulus(self, plane: str | None = "strain") -> float:
        """E' of K^2 = G_c E' [Pa]: E/(1 - nu^2), in plane stress E."""
        one_of("plane", plane, PLANES)
        return self.young if plane == "stress" else self.young / (1.0 - self.poisson**2)

    def pressure_speed(self, plane: str | None = None) -> float:
        """Speed of longitudinal waves c_P [m/s]; in plane stress that of a thin plate."""
        return sqrt((self.lame(plane) + 2.0 * self.shear_modulus) / self.density)

    def shear_speed(self) -> float:
        """Speed of shear waves c_S [m/s]."""
        return sqrt(self.shear_modulus / self.density)

    def rayleigh_speed(self, plane: str | None = None) -> float:
        """Speed of surface waves c_R [m/s], root of Rayleigh's equation."""
        from scipy.optimize import brentq

        ratio = (self.shear_speed() / self.pressure_speed(plane)) ** 2

        def rayleigh(x: float) -> float:
            # 4 sqrt(1 - x r) sqrt(1 - x) = (2 - x)^2 with x = (c_R/c_S)^2
            return (2.0 - x) ** 2 - 4.0 * sqrt((1.0 - ratio * x) * (1.0 - x))

        return self.shear_speed() * sqrt(brentq(rayleigh, 1e-3, 1.0 - 1e-12, xtol=1e-15))

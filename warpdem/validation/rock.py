"""Virtual tests of rock against the criterion they are made of (theory B10, C2 26, C3 38)."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ..calibration import calibrate_strength
from ..criteria import Criterion, DruckerPrager, HuberMisesHencky, Rankine
from ..errors import Array
from ..experiments import (
    Brazilian,
    Compression,
    Confined,
    RockResult,
    Specimen,
    Tension,
    brazilian,
    compression,
    confined,
    material_strength,
    tension,
)
from ..experiments.rock import Rock, rock_test
from ..material import Material
from .case import Measurement, case
from .core import vanishing

PLATE: dict[str, Any] = {"width": 30e-3, "height": 60e-3}
SMALL: dict[str, Any] = {"width": 10e-3, "height": 20e-3, "plane": "space"}
RESIDUAL = {"float64": 1e-4, "mixed": 1e-3, "float32": 1e-3}
RATIO_LIMIT = 0.15  # theory C3 38
ANGLE_LIMIT = 20.0  # degrees: a band wanders, and another may be the densest
ROCK = Material(20e9, 0.2, 2300.0)
DEFAULTS: tuple[Rock, ...] = (Tension(), Compression(), Confined(), Brazilian())


def equivalent_stress(criterion: Criterion, stress: Array) -> float:
    """Shilko eq. 14 and the greatest principal stress, of normal stresses (3,), transcribed."""
    m = stress.mean()
    q = np.sqrt(1.5 * ((stress - m) ** 2).sum())
    if isinstance(criterion, DruckerPrager):
        a = criterion.ratio
        return float(0.5 * (a + 1.0) * q + 1.5 * (a - 1.0) * m)
    return float(stress.max() if isinstance(criterion, Rankine) else q)


def bearing(criterion: Criterion, plane: str | None, start: Array, direction: Array) -> float:
    """Load at which a criterion breaks in start + load * direction, (dim,)."""

    def excess(load: float) -> float:
        s = start + load * direction
        if plane is not None:
            s = np.append(s, ROCK.poisson * s.sum() if plane == "strain" else 0.0)
        return equivalent_stress(criterion, s) - criterion.strength

    return float(brentq(excess, 1e3, 1e10, xtol=1.0))


def _books(name: str, result: RockResult, moduli: float = 0.01) -> Iterator[Measurement]:
    """Moduli, with the limit of their error, and energy of a test."""
    p, precision = result.parameters, result.simulation.precision
    for what, exact, found in (
        ("Young's modulus", p.young, result.young),
        ("Poisson's ratio", p.poisson, result.poisson),
    ):
        error = abs(found / exact - 1.0)
        yield Measurement(f"{what}, {name}", exact, "given", found, error, moduli)
    limit = RESIDUAL[precision]
    yield vanishing(f"energy residual, {name}", "conservation", result.energy_error, limit)


def _ratio(name: str, p: Specimen, precision: str = "float64") -> Iterator[Measurement]:
    """Tension and compression of one specimen: their ratio, moduli, energy, planes of fracture."""
    pulled = tension(Tension(**p.common), precision=precision)
    pressed = compression(Compression(**p.common), precision=precision)
    exact = pressed.criterion_strength / pulled.criterion_strength
    found = pressed.strength / pulled.strength
    what = f"compressive over tensile strength, {name}"
    error = abs(found / exact - 1.0)
    yield Measurement(what, exact, "the criterion's", found, error, RATIO_LIMIT)
    yield from _books(f"tension, {name}", pulled)
    yield from _books(f"compression, {name}", pressed)
    if p.dim == 3:
        return  # of ten elements across there is no band to speak of
    for test, result in (("tension", pulled), ("compression", pressed)):
        what = f"fracture plane to the axis of {test} in degrees, {name}"
        error = abs(result.fracture_angle - result.expected_angle)
        source = "across" if test == "tension" else "45 - phi/2"
        yield Measurement(
            what, result.expected_angle, source, result.fracture_angle, error, ANGLE_LIMIT
        )


@case("fracture")
def rock_material_point() -> Iterator[Measurement]:
    """Loads at which a held patch in homogeneous stress breaks, against the criteria by hand."""
    for name, criterion, plane, sign, pressure in (
        ("Drucker-Prager, tension", DruckerPrager(50e6, 5.0), "stress", 1.0, 0.0),
        ("Drucker-Prager, compression", DruckerPrager(50e6, 5.0), "stress", -1.0, 0.0),
        ("Drucker-Prager, confined", DruckerPrager(50e6, 5.0), "stress", -1.0, 10e6),
        ("Drucker-Prager, compression", DruckerPrager(50e6, 3.0), "strain", -1.0, 0.0),
        ("Drucker-Prager, confined", DruckerPrager(50e6, 3.0), "strain", -1.0, 10e6),
        ("Huber-Mises-Hencky, compression", HuberMisesHencky(50e6), "strain", -1.0, 0.0),
        ("Rankine, tension", Rankine(10e6), "strain", 1.0, 0.0),
        ("Drucker-Prager, confined", DruckerPrager(50e6, 5.0), None, -1.0, 5e6),
    ):
        dim = 3 if plane is None else 2
        way, start = sign * np.eye(dim)[-1], np.full(dim, -pressure)
        exact = bearing(criterion, plane, start, way)
        found = material_strength(criterion, ROCK, plane, way, start)
        state = "space" if plane is None else f"plane {plane}"
        what = f"strength [Pa], {name}, {state}, {pressure / 1e6:g} MPa around"
        error = abs(found / exact - 1.0)
        yield Measurement(what, exact, "Shilko eq. 14", found, error, 2e-4)


@case("fracture", slow=True)
def rock_strength_ratio() -> Iterator[Measurement]:
    """A plate of random cells with scattered strengths in plane stress, pulled and pressed."""
    yield from _ratio("Voronoi, plane stress", Specimen(**PLATE))


@case("fracture", slow=True)
def rock_confined() -> Iterator[Measurement]:
    """Bonds of one strength, confined: the specimen bears what the criterion does."""
    p = Confined(weibull=inf, pressure=10e6, **PLATE)
    result = confined(p)
    exact, found = result.criterion_strength, result.strength
    error = abs(found / exact - 1.0)
    yield Measurement("axial stress [Pa]", exact, "the criterion's", found, error, 0.03)
    yield from _books("confined", result)


@case("fracture")
def rock_brazilian() -> Iterator[Measurement]:
    """A disc pressed across beside direct tension, with scattered strengths, in plane stress.

    The criterion sees the compression across the tension at the disc's centre, of three times its
    size, so that Drucker-Prager's breaks below its tensile strength.
    """
    disc = brazilian(Brazilian())
    pulled = tension(Tension(**PLATE))
    exact = disc.criterion_strength / pulled.criterion_strength
    found = disc.strength / pulled.strength
    what = "Brazilian over direct tensile strength"
    error = abs(found / exact - 1.0)
    yield Measurement(what, exact, "the criterion's at the centre", found, error, RATIO_LIMIT)
    yield from _books("Brazilian", disc, 0.02)  # of a core in uneven stress
    what = "fracture plane to the load in degrees"
    yield vanishing(what, "along it", disc.fracture_angle, ANGLE_LIMIT)


@case("fracture", slow=True)
def rock_packings() -> Iterator[Measurement]:
    """Ratio, moduli, energy on other packings, states, ratios and seeds."""
    strain = DruckerPrager(50e6, 3.0)  # of 5.6 in plane strain
    for name, p in {
        "hexagonal, plane stress": Specimen(packing="hexagonal", **PLATE),
        "hexagonal, plane strain": Specimen(
            packing="hexagonal", plane="strain", criterion=strain, **PLATE
        ),
        "Voronoi, plane strain": Specimen(plane="strain", criterion=strain, **PLATE),
        "Voronoi, plane stress, one strength": Specimen(weibull=inf, **PLATE),
        "Voronoi, plane stress, ratio 10, one strength": Specimen(
            criterion=DruckerPrager(100e6, 10.0), weibull=inf, **PLATE
        ),
        "Voronoi, plane stress, ratio 10": Specimen(criterion=DruckerPrager(100e6, 10.0), **PLATE),
        "Voronoi, plane stress, seed 1": Specimen(seed=1, **PLATE),
        "Voronoi, plane stress, seed 2": Specimen(seed=2, **PLATE),
        "Voronoi, box in space": Specimen(**SMALL),
        "Voronoi, cylinder": Specimen(shape="cylinder", **SMALL),
        "fcc": Specimen(packing="fcc", **SMALL),
    }.items():
        yield from _ratio(name, p)


@case("fracture", slow=True)
def rock_rate() -> Iterator[Measurement]:
    """Strengths at half the rate of loading, of the default specimens."""
    for p in DEFAULTS:
        fast = rock_test(p).strength
        slow = rock_test(replace(p, crossings=2.0 * p.crossings)).strength
        error = abs(fast / slow - 1.0)
        yield Measurement(f"strength [Pa], {p.name}", slow, "at half the rate", fast, error, 0.02)


@case("fracture", slow=True)
def rock_precisions() -> Iterator[Measurement]:
    """The default tests in float32 and mixed precision: energy, and strengths beside float64."""
    for p in DEFAULTS:
        exact = rock_test(p).strength
        for precision in ("float32", "mixed"):
            result = rock_test(p, precision=precision)
            where = f"{p.name}, {precision}"
            yield from _books(where, result, 0.02)
            error = abs(result.strength / exact - 1.0)
            what = f"strength [Pa], {where}"
            yield Measurement(what, exact, "float64", result.strength, error, 0.03)


@case("fracture", slow=True)
def rock_servo() -> Iterator[Measurement]:
    """Confinement by rigid walls on servos beside that by a pressure."""
    p = Confined(**PLATE)
    pressure, servo = confined(p), confined(replace(p, jacket="servo"))
    error = abs(servo.strength / pressure.strength - 1.0)
    yield Measurement(
        "axial stress [Pa]", pressure.strength, "under a pressure", servo.strength, error, 0.03
    )
    yield from _books("servo", servo)


@case("fracture", slow=True)
def rock_calibration() -> Iterator[Measurement]:
    """Criteria found for wanted strengths."""
    for name, p, targets in (
        ("plane stress", Specimen(**PLATE), (5e6, 50e6)),
        ("plane strain", Specimen(plane="strain", **PLATE), (5e6, 40e6)),
    ):
        found = calibrate_strength(*targets, p, tell=None)
        for kind, target in zip(("tension", "compression"), targets, strict=True):
            value = found.measured[kind]
            error = abs(value / target - 1.0)
            yield Measurement(f"{kind} [Pa], {name}", target, "wanted", value, error, 0.03)

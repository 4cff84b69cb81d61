"""From the strengths that tests of rock give to the criterion of the bonds (calibration).

A specimen breaks at less than the criterion of its bonds, whose strengths scatter and whose cracks
concentrate stress, so that wanted strengths have to be found by trial.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp, isfinite, log, sqrt
from typing import Any

from .criteria import Criterion, DruckerPrager, Tensile, with_tension
from .errors import InputError, NotConvergedError, positive
from .experiments.specimen import Compression, Specimen, Tension, compression, tension
from .toughness import tip_ratio

Form = Callable[..., Criterion]
Tell = Callable[[str], None]
SLOPES = (0.5, 2.0)  # between which a secant is believed
BISECTIONS = 12


@dataclass(frozen=True)
class StrengthCalibration:
    """A criterion and what specimens of it bear.

    targets, strengths, measured [Pa], by name: what was wanted, the numbers that the criterion was
    made of, and what the last tests gave; rounds: numbers and measurements of all tests made.
    stress_intensity [Pa m^0.5]: the K_Ic that the criterion has at the specimen's spacing; spacing
    [m]: that at which it has the wanted one, or the specimen's own if none was. Both None for
    criteria and packings without a table of tip stresses.
    """

    criterion: Criterion
    targets: dict[str, float]
    strengths: dict[str, float]
    measured: dict[str, float]
    rounds: tuple[tuple[dict[str, float], dict[str, float]], ...]
    stress_intensity: float | None = None
    spacing: float | None = None

    @property
    def error(self) -> float:
        """Greatest relative difference of measured and target."""
        return max(abs(self.measured[k] / v - 1.0) for k, v in self.targets.items())


def drucker_prager(tension: float, compression: float) -> DruckerPrager:
    """The criterion of these uniaxial strengths [Pa]."""
    return DruckerPrager(compression, compression / tension)


def calibrate_strength(
    tension: float,
    compression: float,
    specimen: Specimen | None = None,
    *,
    stress_intensity: float | None = None,
    form: Form = drucker_prager,
    tolerance: float = 0.03,
    rounds: int = 6,
    device: str = "cpu",
    precision: str = "float64",
    tell: Tell | None = print,
) -> StrengthCalibration:
    """Find the criterion with which a specimen has these strengths.

    tension, compression [Pa]: wanted in direct tension and in uniaxial compression (UCS); specimen:
    material, packing, scatter and loading of the tests, its criterion is not used; form: makes a
    criterion of strengths named as the targets; stress_intensity: K_Ic [Pa m^0.5] that cracks are
    to have as well. Strength and toughness together fix the size of elements, (c K_Ic/strength)^2
    with c of the table of tip stresses (theory B10), so it does not change the criterion, but the
    spacing that the result names: run with that one. tolerance: relative, on each target; rounds:
    of all tests, at most; tell: called with a line after each.

    Each target has a test that measures it and a strength of the criterion that it hangs on most;
    the strengths are found by the secant method on their logarithms. What random breaks scatter, 1
    to 3 % on some thousand elements, no calibration gets below. Raises InputError for targets that
    cannot be, NotConvergedError if `rounds` are not enough.
    """
    targets = {"tension": tension, "compression": compression}
    for name, value in targets.items():
        positive(name, value, ())
    positive("tolerance", tolerance, ())
    if stress_intensity is not None:
        positive("stress_intensity", stress_intensity, ())
    if rounds < 1:
        raise InputError(f"rounds is {rounds}; give 1 or more.")
    if compression <= tension:
        raise InputError(
            f"a compressive strength of {compression:g} Pa is not above the tensile one of "
            f"{tension:g} Pa, as that of rock is."
        )
    given = specimen or Specimen()
    common = given.common
    how: dict[str, Any] = {"device": device, "precision": precision}
    say = tell or (lambda line: None)
    strengths = _first_guess(given, form, targets)
    made: list[tuple[dict[str, float], dict[str, float]]] = []
    for _ in range(rounds):
        common["criterion"] = form(**strengths)
        measured = {name: TESTS[name](common, how) for name in targets}
        made.append((strengths, measured))
        say(
            f"round {len(made)}: "
            + "; ".join(
                f"{k} of bonds {strengths[k] / 1e6:.4g} MPa, of the specimen "
                f"{measured[k] / 1e6:.4g} (wanted {targets[k] / 1e6:.4g})"
                for k in targets
            )
        )
        found = StrengthCalibration(common["criterion"], targets, strengths, measured, tuple(made))
        if found.error <= tolerance:
            return _with_toughness(found, given, stress_intensity)
        strengths = {name: _secant(name, targets[name], made) for name in targets}
        strengths["compression"] = max(strengths["compression"], strengths["tension"])
    raise NotConvergedError(
        f"after {rounds} rounds a strength is {found.error:.1%} off, more than {tolerance:.1%}; "
        "allow more rounds or a greater tolerance, or take a larger specimen, which scatters less."
    )


def _with_toughness(
    found: StrengthCalibration, specimen: Specimen, wanted: float | None
) -> StrengthCalibration:
    """The result with the toughness of its criterion and the spacing at which it is the wanted."""
    criterion, packing = found.criterion, specimen.build_packing()
    if not isinstance(criterion, Tensile) or not packing.arrangement:
        if wanted is not None:
            raise InputError(
                "the toughness of this criterion or packing is not tabulated; leave "
                "stress_intensity out."
            )
        return found
    seen = tip_ratio(with_tension(criterion, 1.0), packing, specimen.poisson)
    own = criterion.tension * sqrt(packing.spacing) / seen
    spacing = packing.spacing if wanted is None else packing.spacing * (wanted / own) ** 2
    return replace(found, stress_intensity=own, spacing=spacing)


def _tensile_strength(common: dict[str, Any], how: dict[str, Any]) -> float:
    return tension(Tension(**common), **how).strength


def _compressive_strength(common: dict[str, Any], how: dict[str, Any]) -> float:
    return compression(Compression(**common), **how).strength


# what measures each target; a further one needs its test here and its strength in `form`
TESTS: dict[str, Callable[[dict[str, Any], dict[str, Any]], float]] = {
    "tension": _tensile_strength,
    "compression": _compressive_strength,
}


def _secant(
    name: str, target: float, made: list[tuple[dict[str, float], dict[str, float]]]
) -> float:
    """The next strength: a line through the last two rounds, at first through the origin."""
    strength, measured = made[-1][0][name], made[-1][1][name]
    slope = 1.0
    if len(made) > 1:
        step = log(strength / made[-2][0][name])
        if abs(step) > 0.01:
            slope = log(measured / made[-2][1][name]) / step
            slope = min(max(slope, SLOPES[0]), SLOPES[1])
    return strength * exp(log(target / measured) / slope)


def _first_guess(p: Specimen, form: Form, targets: dict[str, float]) -> dict[str, float]:
    """Strengths with which the criterion itself bears the targets in homogeneous stress.

    In plane strain these differ from the uniaxial strengths it is made of. All strengths scale with
    the stress, so it is their ratio that is looked for, by bisection.
    """
    wanted = targets["compression"] / targets["tension"]

    def own(ratio: float) -> tuple[float, float]:
        made = {"tension": targets["tension"], "compression": ratio * targets["tension"]}
        q = Specimen(**p.common | {"criterion": form(**made)})
        return q.strength(q.along()), q.strength(q.along(-1.0))

    low, high, ratio = 0.0, log(wanted), wanted
    for _ in range(BISECTIONS):
        pull, press = own(ratio)
        excess = press / pull / wanted
        if isfinite(excess) and abs(excess - 1.0) < 0.02:
            break
        if ratio == wanted and excess < 1.0:  # more than the targets' own ratio: leave it to tests
            break
        low, high = (low, log(ratio)) if excess > 1.0 else (log(ratio), high)
        ratio = exp(0.5 * (low + high))
    scale = targets["tension"] / pull
    return {
        "tension": scale * targets["tension"],
        "compression": scale * ratio * targets["tension"],
    }

"""The strength of a rock against the pressure on its sides."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import asin, degrees, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Array, InputError, finite
from ..write.record import describe_machine
from ..write.whole import folder, write_csv, write_json
from .rock import RockResult
from .shared import Say, silent
from .specimen import Compression, Confined, Specimen, Tension, compression, confined, tension

PRESSURES = (0.0, 2.5e6, 5e6, 10e6)
LINE = 6  # points of the criterion's line


@dataclass
class Envelope:
    """Strengths against confining pressures, compression positive [Pa].

    confining, strength (c,): pressure on the sides, and greatest axial stress; tension: strength in
    direct tension; line_confining, line_strength (k,): of the criterion in homogeneous stress;
    slope, compression, friction_angle [degrees], cohesion: of the straight line through the points,
    and what it is in Mohr and Coulomb's terms.
    """

    confining: Array
    strength: Array
    tension: float
    line_confining: Array
    line_strength: Array
    slope: float
    compression: float
    friction_angle: float
    cohesion: float
    tests: list[RockResult] = field(repr=False)

    def numbers(self) -> dict[str, Any]:
        """All but the tests themselves, of which the numbers."""
        own = {k: v for k, v in vars(self).items() if k != "tests"}
        return own | {"tests": [{"test": t.parameters.name, **t.numbers()} for t in self.tests]}


def strength_envelope(
    parameters: Specimen | None = None,
    pressures: Sequence[float] = PRESSURES,
    *,
    device: str = "cpu",
    precision: str = "float64",
    out: str | Path | None = None,
    say: Say = silent,
) -> Envelope:
    """Press like specimens under several lateral pressures, and pull one apart.

    parameters: of the specimen, of which a pressure is not used; pressures [Pa]: 0 for uniaxial
    compression; out: folder for envelope.png, envelope.csv and envelope.json. Raises InputError for
    parameters that cannot be run, and for fewer than two pressures.
    """
    began = time.perf_counter()
    p = parameters or Confined()
    wanted = np.unique(finite("pressures", pressures, (None,)))
    if len(wanted) < 2 or wanted[0] < 0.0:
        raise InputError("give at least two different pressures, not negative.")
    where = None if out is None else folder(out)
    common = p.common
    say("direct tension")
    tests = [tension(Tension(**common), device=device, precision=precision)]
    for pressure in wanted:
        say(f"compression under {pressure / 1e6:g} MPa")
        if pressure == 0.0:
            test = compression(Compression(**common), device=device, precision=precision)
        else:
            chosen = Confined(pressure=float(pressure), jacket=p.jacket, **common)
            test = confined(chosen, device=device, precision=precision)
        say(f"axial stress at the peak {test.strength / 1e6:.4g} MPa")
        tests.append(test)
    strength = np.array([t.strength for t in tests[1:]])
    line = np.linspace(0.0, wanted[-1], LINE)
    start = [np.full(p.dim, -x) for x in line]
    bearing = np.array([p.strength(p.along(-1.0), s) for s in start]) + line
    slope, ucs = np.polyfit(wanted, strength, 1)
    result = Envelope(
        confining=wanted,
        strength=strength,
        tension=tests[0].strength,
        line_confining=line,
        line_strength=bearing,
        slope=float(slope),
        compression=float(ucs),
        friction_angle=degrees(asin((slope - 1.0) / (slope + 1.0))),
        cohesion=float(ucs / (2.0 * sqrt(slope))),
        tests=tests,
    )
    if where is not None:
        _write(where, p, result, began)
    return result


def _write(where: Path, p: Specimen, result: Envelope, began: float) -> None:
    from ..write.specimen import draw_envelope

    draw_envelope(
        where / "envelope.png",
        f"Strength of specimens of {result.tests[0].elements} elements, "
        + ("space" if p.plane == "space" else f"plane {p.plane}"),
        result.confining,
        result.strength,
        result.line_confining,
        result.line_strength,
        result.slope,
        result.compression,
    )
    rows = np.zeros(len(result.confining), dtype=[("confining", float), ("strength", float)])
    rows["confining"], rows["strength"] = result.confining, result.strength
    write_csv(where / "envelope.csv", rows, {"confining": "Pa", "strength": "Pa"})
    record = {
        "experiment": "strength-envelope",
        **result.numbers(),
        "seconds": time.perf_counter() - began,
        "machine": describe_machine(),
    }
    write_json(where / "envelope.json", record)

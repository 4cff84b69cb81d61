"""Fracture: criteria, toughness, softening, scatter, the ledger of breaking bodies (theory B10)."""

from collections.abc import Iterator
from itertools import product
from math import cos

import numpy as np

from ..criteria import (
    Criterion,
    DruckerPrager,
    HuberMisesHencky,
    MohrCoulomb,
    Rankine,
)
from ..errors import Array
from ..simulation import Simulation
from . import reference
from .case import Measurement, case
from .core import facet_body, small_packing, vanishing

# criteria in homogeneous states, the strength 1
LAWS: tuple[Criterion, ...] = (
    HuberMisesHencky(1.0),
    DruckerPrager(1.0, 3.0),
    DruckerPrager(1.0, 10.0),
    Rankine(1.0),
    MohrCoulomb(0.5 / cos(0.5), 0.5),
    MohrCoulomb(0.5 / cos(0.5), 0.5, 0.3),
)


def _states(dim: int) -> dict[str, Array]:
    """Strains: along an axis, shear, equal ones, and turned and general ones."""
    rng = np.random.default_rng(13)
    general = rng.normal(size=(dim, dim))
    q, _ = np.linalg.qr(rng.normal(size=(dim, dim)))
    along = np.zeros((dim, dim))
    along[0, 0] = 1.0
    shear = np.zeros((dim, dim))
    shear[0, 1] = shear[1, 0] = 0.5
    return {
        "tension": along,
        "compression": -along,
        "shear": shear,
        "equal": np.eye(dim),
        "turned tension": q @ along @ q.T,
        "general": general + general.T,
    }


@case("fracture")
def criteria_in_uniform_stress() -> Iterator[Measurement]:
    """The ratio at which every inner bond stands, against the continuum criterion's."""
    for name, law in product(
        ("hex strain", "hex stress", "fcc", "voronoi strain", "voronoi stress", "voronoi space"),
        LAWS,
    ):
        p = small_packing(name)
        inner = ~p.boundary(layers=2)
        inside = inner[p.bonds].all(axis=1)
        worst = 0.0
        for strain in _states(p.dim).values():
            scene, body = facet_body(p, 0.3, law)
            scene.strain(body, 1e-6 * strain)
            scene.hold(body, np.arange(len(p)))
            sim = Simulation(scene, dt=1.0)
            sim.run(steps=1)
            exact = reference.hooke(1e-6 * strain, 1.0, 0.3, p.plane)
            level = max(reference.equivalent_stress(exact, law.kind, law.numbers), 0.0)
            ratio = sim.criterion_ratio[inside] * law.strength
            size = max(level, np.abs(exact).max())
            worst = max(worst, float(np.abs(ratio - level).max() / size))
        what = f"equivalent stress, {name}, {law.kind} {law.numbers}"
        yield vanishing(what, "Shilko eqs 13-14", worst, 1e-8)

"""Scenes whose steps are timed: what each switches on, and nothing else.

Stress is read every ten steps, as observers do; bonds that may break are tested every step, by
Drucker and Prager's criterion of the element stresses; in the scene of plasticity all elements
flow, by von Mises' law. Bodies of unit cells, Young's modulus and density, strained a little and
let go. In the plane hexagonal cells; in space fcc, for EVM bonds a simple cubic lattice.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import packing
from ..bond import EVMBond
from ..criteria import DruckerPrager
from ..material import Material
from ..packing import Packing
from ..plasticity import VonMises
from ..scene import Scene

STRAIN = 1e-3  # uniform, at the start
NOISE = 1e-3  # of velocities
STRENGTH = 1.0  # of bonds that may break: never reached
YIELD = 5e-4  # reached at once
BLOCK: dict[str, Any] = {"longitudinal": 1.0, "shear": 0.4, "bending": 0.05, "torsion": 0.04}
EVM = EVMBond(**BLOCK)


@dataclass(frozen=True)
class Kind:
    """What a scene has."""

    name: str
    bond: str = "facet"
    poisson: float = 0.0
    reads_stress: bool = False  # as observers do, every few steps
    breaks: bool = False
    flows: bool = False
    touches: bool = False


ELASTIC = Kind("facet, nu = 0.3", poisson=0.3)
KINDS = (
    Kind("EVM", bond="EVM"),
    Kind("facet, nu = 0"),
    ELASTIC,
    Kind("+ stress", poisson=0.3, reads_stress=True),
    Kind("+ fracture", poisson=0.3, breaks=True),
    Kind("+ plasticity", poisson=0.3, flows=True),
    Kind("+ fracture and contact", poisson=0.3, breaks=True, touches=True),
)


def cells(dim: int, elements: int, bond: str = "facet", cell: str = "") -> Packing:
    """About so many unit cells in a square or a cube; cell: "voronoi" in place of a lattice."""
    edge = elements ** (1.0 / dim)
    if cell == "voronoi":
        return packing.voronoi((edge,) * dim, 1.0)
    if dim == 2:
        count = round(edge)
        return packing.hexagonal((count, count * np.sqrt(3.0) / 2.0), 1.0)
    if bond == "EVM":
        return packing.simple_cubic((round(edge),) * 3, 1.0)
    return packing.fcc((round((elements / 4.0) ** (1.0 / 3.0)) * np.sqrt(2.0),) * 3, 1.0)


def build(kind: Kind, dim: int, elements: int, cell: str = "") -> Scene:
    """The scene, of about so many elements."""
    p = cells(dim, elements, kind.bond, cell)
    scene = Scene()
    body = scene.add(
        p,
        Material(young=1.0, poisson=kind.poisson, density=1.0),
        bond=EVM if kind.bond == "EVM" else "facet",
        fracture=DruckerPrager(compression=3.0 * STRENGTH, ratio=3.0) if kind.breaks else None,
        yielding=VonMises(YIELD) if kind.flows else None,
    )
    shear = np.zeros((dim, dim))
    shear[0, 1] = shear[1, 0] = STRAIN
    scene.strain(body, shear)
    # nothing is exactly at rest, else squares of what is left by rounding fall below the range of
    # normal numbers, which a processor handles slowly
    rng = np.random.default_rng(0)
    scene.set_velocity(
        body, NOISE * rng.normal(size=p.position.shape),
        NOISE * rng.normal(size=body.angular_velocity.shape),
    )  # fmt: skip
    if kind.touches:
        scene.contact(friction=0.3)
    return scene

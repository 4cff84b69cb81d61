"""What a fracture criterion makes of a homogeneous stress, as the code itself sees it.

By runs of one step in which all elements are held in the strain of that stress, so for any
criterion that a scene takes.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import ArrayLike

from .. import packing
from ..criteria import Criterion
from ..errors import Array, finite, one_of
from ..material import Material
from ..packing import Mask, Packing
from ..scene import Scene
from ..simulation import Simulation

CELLS = {2: 9.0, 3: 6.0}  # edge of the patch in spacings: some elements are two from any side
LARGEST, SMALLEST = 0.1, 1e-9  # strains between which the strength is looked for
FINE = 1e-4  # relative, of the strength found
MOST, HALVINGS = 16.0, 12  # greatest factor of strength at a side, and halvings of its logarithm


def principal_strain(material: Material, plane: str | None, stress: ArrayLike) -> Array:
    """Strains along the axes under normal stresses along them [Pa], (dim,), by Hooke's law."""
    s = finite("stress", stress, (3 if plane is None else 2,))
    nu = material.poisson
    if plane == "strain":
        s = np.append(s, nu * s.sum())
    strain: Array = ((1.0 + nu) * s - nu * s.sum()) / material.young
    return strain[: 3 if plane is None else 2]


def material_strength(
    criterion: Criterion,
    material: Material,
    plane: str | None,
    direction: ArrayLike,
    start: ArrayLike | None = None,
    spacing: float = 1.0,
) -> float:
    """Load [Pa] at which bonds break in the homogeneous stress start + load * direction.

    direction and start [Pa]: normal stresses along the axes, (dim,); plane: "strain", "stress" or
    None for space; spacing [m]: of the elements, for criteria that depend on it. Infinite if they
    never break. Found by bisection on a patch of random cells, to 1e-4 and the strain itself.
    """
    one_of("plane", plane, ("strain", "stress", None))
    dim = 3 if plane is None else 2
    way = finite("direction", direction, (dim,))
    base = np.zeros(dim) if start is None else finite("start", start, (dim,))
    patch = packing.voronoi((CELLS[dim] * spacing,) * dim, spacing, plane)
    # of elements next to the surface the mean stress is not that of the patch
    surface = patch.boundary(2)[patch.bonds].any(axis=1)
    factor = np.where(surface, inf, 1.0)

    def breaks(load: float) -> bool:
        return bool(_broken(patch, material, criterion, base + load * way, factor).any())

    strain = np.abs(principal_strain(material, plane, way)).max()  # of a unit load
    low, high = SMALLEST / strain, LARGEST / strain
    if not breaks(high):
        return inf
    while high > (1.0 + FINE) * low:
        middle = sqrt(low * high)
        low, high = (low, middle) if breaks(middle) else (middle, high)
    return high


def side_factors(
    packing: Packing, material: Material, criterion: Criterion, stress: ArrayLike, where: Mask
) -> Array:
    """Factors of strength, (b,), with which the bonds of some elements break when the others do.

    where: elements at a free side. Their mean stress leaves out what acts on the side itself, a
    pressure there or the faces that a lattice's cells lack, so that the criterion sees a wrong one:
    their bonds get, by bisection, the strength at which they just bear the homogeneous stress [Pa],
    (dim,), at which the others break. At least 1.
    """
    bonds = np.asarray(where[packing.bonds].any(axis=1))
    low, high = np.ones(len(bonds)), np.full(len(bonds), MOST)

    def broken(factor: Array) -> Mask:
        given = np.where(bonds, factor, inf)
        return _broken(packing, material, criterion, finite("stress", stress), given)

    weak = broken(low)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        gone = broken(middle)
        low, high = np.where(gone, middle, low), np.where(gone, high, middle)
    return np.where(weak, high, 1.0)


def _broken(
    packing: Packing, material: Material, criterion: Criterion, stress: Array, factor: Array
) -> Mask:
    """Bonds that break in a homogeneous stress, their strengths times a factor, (b,)."""
    scene = Scene()
    body = scene.add(packing, material, fracture=criterion)
    body.strength_factor[:] = factor
    scene.strain(body, np.diag(principal_strain(material, packing.plane, stress)))
    scene.hold(body, np.arange(len(packing)))
    sim = Simulation(scene, dt=1.0, force_dt=True)
    sim.run(steps=1)
    return ~sim.linked

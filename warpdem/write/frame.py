"""What a frame of a file for viewing holds of every element, whatever the format."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import Array
from ..fields import in_space, pressure, von_mises

if TYPE_CHECKING:
    from ..simulation import Simulation

FIELDS = ("velocity", "mean_stress", "von_mises", "damage", "plastic_strain")
SYMMETRIC = ((0, 1, 2, 0, 1, 0), (0, 1, 2, 1, 2, 2))  # xx, yy, zz, xy, yz, xz


def element_fields(sim: Simulation, stress: Array) -> dict[str, Array]:
    """`FIELDS` of every element, SI units, plastic_strain where bodies may flow; stress is the
    simulation's, (n, 3, 3)."""
    found = {
        "velocity": in_space(sim.velocity),
        "mean_stress": -pressure(stress),
        "von_mises": von_mises(stress),
        "damage": sim.damage,
    }
    return found | ({"plastic_strain": sim.plastic_strain} if sim.model.yielding else {})


def element_widths(sim: Simulation) -> Array:
    """The packing's spacing [m], (n,)."""
    packings = [b.packing for b in sim.scene.bodies]
    return np.concatenate([np.full(len(p), p.spacing) for p in packings])


def element_periods(sim: Simulation) -> Array | None:
    """Edges of the box that each element's body repeats with [m], (n, 3), inf along axes along
    which it does not; None if no body does."""
    packings = [b.packing for b in sim.scene.bodies]
    if all(p.period is None for p in packings):
        return None
    edges = np.full((len(packings), 3), np.inf)
    for row, p in zip(edges, packings, strict=True):
        if p.period is not None:
            row[: p.dim] = p.period
    return np.repeat(edges, [len(p) for p in packings], axis=0)


def element_ids(sim: Simulation) -> NDArray[np.int64]:
    """The packings' own ids, or the order of elements where these clash, (n,)."""
    ids = np.concatenate([b.packing.ids for b in sim.scene.bodies])
    return ids if len(np.unique(ids)) == len(ids) else np.arange(len(ids))


def element_bodies(sim: Simulation) -> NDArray[np.int64]:
    """Which body each element belongs to, (n,)."""
    return np.repeat(np.arange(len(sim.scene.bodies)), [len(b.packing) for b in sim.scene.bodies])

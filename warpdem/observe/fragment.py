"""The pieces that a body falls into: mass, velocity, spin, and their distribution over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import Array, InputError, checked
from ..fields import in_space

if TYPE_CHECKING:
    from ..simulation import Simulation

VECTORS = ("x", "y", "z", "vx", "vy", "vz", "wx", "wy", "wz")
PIECE = [("element", int), ("elements", int), ("mass", float)] + [(n, float) for n in VECTORS]
PIECE += [("kinetic_energy", float), ("spin_energy", float)]
SUMMARY = [("time", float), ("pieces", int), ("largest_mass", float), ("mean_mass", float)]
SUMMARY += [("kinetic_energy", float)]


def fragments(sim: Simulation) -> NDArray[np.void]:
    """Pieces that linked bonds hold together now, heaviest first, a structured array of the fields

    element (the first of the piece), elements (how many), mass [kg], x, y, z (its centre of mass
    [m]), vx, vy, vz [m/s], wx, wy, wz (spin as of a rigid body with its angular momentum [rad/s]),
    kinetic_energy (of both, as a rigid body) and spin_energy [J]. In the plane a mass is that of
    the thickness, and only wz turns.
    """
    label = piece_of(sim)
    count = int(label.max()) + 1
    n = sim.model.own_elements
    mass, inertia = sim.model.mass[:n], sim.model.inertia[:n]
    x, v, w = in_space(sim.position), in_space(sim.velocity), sim.angular_velocity
    w = np.pad(w, ((0, 0), (2, 0))) if w.shape[1] == 1 else w
    total = np.bincount(label, mass, count)
    centre, velocity = (_sums(label, mass[:, None] * a, count) / total[:, None] for a in (x, v))
    r, u = x - centre[label], v - velocity[label]
    momentum = _sums(label, mass[:, None] * np.cross(r, u) + inertia[:, None] * w, count)
    square = (r**2).sum(axis=1)[:, None, None] * np.eye(3) - r[:, :, None] * r[:, None, :]
    tensor = mass[:, None, None] * square + inertia[:, None, None] * np.eye(3)
    spin = np.linalg.solve(_sums(label, tensor, count), momentum[:, :, None])[:, :, 0]
    found = np.zeros(count, dtype=PIECE)
    found["element"] = np.unique(label, return_index=True)[1]
    found["elements"], found["mass"] = np.bincount(label, minlength=count), total
    for name, column in zip(VECTORS, np.hstack([centre, velocity, spin]).T, strict=True):
        found[name] = column
    found["spin_energy"] = 0.5 * (spin * momentum).sum(axis=1)
    found["kinetic_energy"] = 0.5 * total * (velocity**2).sum(axis=1) + found["spin_energy"]
    return found[np.lexsort((found["element"], -found["mass"]))]


def piece_of(sim: Simulation) -> NDArray[np.int64]:
    """Which piece each element belongs to, (n,), numbered in the order of their first elements."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = sim.model.own_elements
    pairs = sim.bonds[sim.linked]
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


class FragmentTracker:
    """Follows the pieces of a simulation.

    every: steps between looks. After a run: `history`, a structured array with a row for each look,
    of the fields time [s], pieces, largest_mass, mean_mass (weighted with the mass itself) [kg] and
    kinetic_energy [J]; and `pieces`, the last look's `fragments`.
    """

    @checked
    def __init__(self, every: int = 100) -> None:
        if every < 1:
            raise InputError(f"every is {every}; look every 1 or more steps.")
        self.every = every
        self.pieces: NDArray[np.void] = np.zeros(0, dtype=PIECE)
        self._rows: list[tuple] = []

    @property
    def history(self) -> NDArray[np.void]:
        """What was seen, look after look."""
        return np.array(self._rows, dtype=SUMMARY)

    def observe(self, sim: Simulation) -> None:
        """Look at the pieces."""
        p = self.pieces = fragments(sim)
        mean = float((p["mass"] ** 2).sum() / p["mass"].sum())
        energy = float(p["kinetic_energy"].sum())
        self._rows.append((sim.time, len(p), float(p["mass"][0]), mean, energy))

    def finish(self, sim: Simulation) -> None:
        """Look once more at the end."""
        if not self._rows or self._rows[-1][0] < sim.time:
            self.observe(sim)


def _sums(label: NDArray[np.int64], value: Array, count: int) -> Array:
    total = np.zeros((count, *value.shape[1:]))
    np.add.at(total, label, value)
    return total

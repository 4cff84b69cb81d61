"""Probes: values at points and along lines, resultants on planes, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Array, InputError, checked, finite, first_ids, one_of

if TYPE_CHECKING:
    from ..simulation import Simulation

QUANTITIES = (
    *("displacement", "velocity", "stress", "strain", "von_mises", "pressure", "rotation"),
    "plastic_strain",
)


class Probe:
    """Values at points of the reference state, every `every` steps.

    points [m]: (p, dim), or two ends and `count` for a line between them; quantity: one of
    displacement [m], velocity [m/s], stress [Pa], strain, von_mises [Pa], pressure [Pa], rotation
    [rad], plastic_strain. Between elements values are interpolated linearly over the nearest ones
    (least squares, weighted by distance). After a run: time [s] (t,), values (t, p, ...).

    Raises InputError for points outside the bodies.
    """

    @checked
    def __init__(
        self,
        points: ArrayLike,
        quantity: str = "displacement",
        every: int = 10,
        count: int | None = None,
    ) -> None:
        one_of("quantity", quantity, QUANTITIES)
        self.points = finite("points", points, (None, None))
        if count is not None:
            if len(self.points) != 2 or count < 2:
                raise InputError("a line takes two ends, and a count of at least 2.")
            share = np.linspace(0.0, 1.0, count)[:, None]
            self.points = (1.0 - share) * self.points[0] + share * self.points[1]
        self.quantity, self.every = quantity, every
        self._times: list[float] = []
        self._values: list[Array] = []
        self._weights: tuple[NDArray[np.int64], Array] | None = None

    def observe(self, sim: Simulation) -> None:
        """Read the values now."""
        if self._weights is None:
            self._weights = _interpolation(sim, self.points)
        ids, weight = self._weights
        value = getattr(sim, self.quantity)[ids]
        self._times.append(sim.time)
        self._values.append(np.einsum("pk,pk...->p...", weight, value))

    def finish(self, sim: Simulation) -> None:
        """Nothing is left to do."""

    @property
    def time(self) -> Array:
        """Times [s] (t,)."""
        return np.array(self._times)

    @property
    def values(self) -> Array:
        """Values (t, p, ...)."""
        return np.array(self._values)


class PlaneProbe:
    """Force and moment that bonds pass across a plane, every `every` steps.

    point [m] and normal (dim,) in the reference state; the resultant [N] is that of the side the
    normal points to on the other, so that tension is positive along the normal. After a run: time
    [s] (t,), force [N] (t, dim), moment about the point [N m] (t, 3).
    """

    @checked
    def __init__(self, point: ArrayLike, normal: ArrayLike, every: int = 10) -> None:
        self.point, n = finite("point", point, (None,)), finite("normal", normal, (None,))
        if not np.linalg.norm(n) > 0.0 or n.shape != self.point.shape:
            raise InputError("the normal must be a vector like the point, and not zero.")
        self.normal, self.every = n / np.linalg.norm(n), every
        self._times: list[float] = []
        self._rows: list[tuple[Array, Array]] = []
        self._bonds: tuple[NDArray[np.int64], Array] | None = None
        self._model: object = None  # whose bonds these are: renewed faces bring others

    def observe(self, sim: Simulation) -> None:
        """Sum the bonds' forces now."""
        if self._bonds is None or self._model is not sim.model:
            self._model = sim.model
            side = (sim.position - sim.displacement - self.point) @ self.normal > 0.0
            i, j = side[sim.bonds].T
            ids = np.flatnonzero(i != j)
            if len(ids) == 0:
                raise InputError("no bond crosses the plane; move it into a body.")
            self._bonds = ids, np.where(j[ids], 1.0, -1.0)
        ids, sign = self._bonds
        force = sign[:, None] * sim.bond_force[ids]
        place = sim.position[sim.bonds[ids]].mean(axis=1) - self.point
        lift = ((0, 0), (0, 3 - force.shape[1]))
        moment = np.cross(np.pad(place, lift), np.pad(force, lift)).sum(axis=0)
        self._times.append(sim.time)
        self._rows.append((force.sum(axis=0), moment))

    def finish(self, sim: Simulation) -> None:
        """Nothing is left to do."""

    @property
    def time(self) -> Array:
        """Times [s] (t,)."""
        return np.array(self._times)

    @property
    def force(self) -> Array:
        """Resultant force [N], (t, dim)."""
        return np.array([f for f, _ in self._rows])

    @property
    def moment(self) -> Array:
        """Resultant moment about the point [N m], (t, 3)."""
        return np.array([m for _, m in self._rows])


def _interpolation(sim: Simulation, points: Array) -> tuple[NDArray[np.int64], Array]:
    """Elements near each point and their weights, exact for linear fields, (p, k) each."""
    from scipy.spatial import cKDTree

    x = sim.position - sim.displacement
    dim = x.shape[1]
    if points.shape[1] != dim:
        raise InputError(f"points have {points.shape[1]} components; give {dim}.")
    count = min(len(x), 3 * (dim + 1))
    distance, ids = cKDTree(x).query(points, k=count)
    spacing = max(b.packing.spacing for b in sim.scene.bodies)
    bad = distance[:, 0] > 1.5 * spacing
    if bad.any():
        raise InputError(f"points {first_ids(bad)} lie outside the bodies.")
    weights = np.zeros(ids.shape)
    for p, (near, d) in enumerate(zip(ids, distance, strict=True)):
        w = np.exp(-((d / spacing) ** 2))
        basis = np.column_stack([np.ones(count), x[near] - points[p]])
        # value at the point of the plane that fits best: first row of the pseudo-inverse
        weights[p] = np.linalg.pinv(basis * np.sqrt(w)[:, None])[0] * np.sqrt(w)
    return ids, weights

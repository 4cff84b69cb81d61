"""Stress and strain of a specimen in a testing machine, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Array, InputError, entries, positive

if TYPE_CHECKING:
    from ..scene import Body
    from ..simulation import Simulation


class StressStrain:
    """Reads the grips of a specimen and a gauge inside it, every `every` steps.

    low, high: mask or ids of the elements gripped on either side of the body, along `axis` ("x",
    "y" or "z"); area [m^2]: what the grips' force is divided by; core: mask or ids of the elements
    over which the gauge reads; stop: once bonds have broken, the run ends when the stress has come
    back to this share of its greatest change, 0 for never; past: or when the strain has grown to
    this many times that of the greatest change, infinite for never.

    After a run, tension positive, (t,) unless said: time [s]; stress [Pa]: mean force of both
    grips over the area; strain: of the grips; gauge_strain (t, dim): along the axes, fitted to the
    core's displacements; core_stress (t, dim) [Pa]: along the axes, mean of the core; broken: bonds
    broken so far. `peak` is the place of the greatest change of stress in these.
    """

    def __init__(
        self,
        body: Body,
        low: ArrayLike,
        high: ArrayLike,
        axis: str,
        area: float,
        core: ArrayLike,
        every: int = 20,
        stop: float = 0.0,
        past: float = np.inf,
    ) -> None:
        positive("area", area, ())
        if not 0.0 <= stop < 1.0:
            raise InputError(f"stop is {stop:g}; give a share from 0 to below 1.")
        if not past > 1.0:
            raise InputError(f"past is {past:g}; give more than 1.")
        self.body, self.area, self.every, self.stop, self.past = body, area, every, stop, past
        self.axis = "xyz".index(axis)
        self._low, self._high, self._core = (_ids(body, where) for where in (low, high, core))
        place = body.packing.position
        inside = place[self._core]
        fit = np.column_stack([inside - inside.mean(axis=0), np.ones(len(inside))])
        if len(inside) <= place.shape[1]:
            raise InputError("the core holds too few elements to fit strains to; enlarge it.")
        self._gradient = np.linalg.pinv(fit)[:-1]
        apart = (place[side, self.axis].mean() for side in (self._high, self._low))
        self._length = float(next(apart) - next(apart))
        self._rows: list[tuple[float, float, float, Array, Array, int]] = []

    def observe(self, sim: Simulation) -> None:
        """Read all, and stop the run if it is over."""
        own, axis = sim.elements(self.body), self.axis
        u, force = sim.displacement[own], sim.force[own, axis]
        pull = 0.5 * float(force[self._low].sum() - force[self._high].sum())
        apart = u[self._high, axis].mean() - u[self._low, axis].mean()
        gauge = np.diagonal(self._gradient @ u[self._core])
        weight = self.body.packing.volume[self._core]
        inner = np.average(sim.stress[own][self._core], axis=0, weights=weight)
        self._rows.append((
            sim.time, pull / self.area, float(apart) / self._length, gauge,
            np.diagonal(inner)[: u.shape[1]], len(sim.broken_bonds()),
        ))  # fmt: skip
        if self._rows[-1][-1] and self._is_over():
            sim.stop()

    def finish(self, sim: Simulation) -> None:
        """Nothing is left to do."""

    def _is_over(self) -> bool:
        stress, strain = (np.abs(x - x[0]) for x in (self.stress, self.strain))
        fallen = stress[-1] < self.stop * stress.max()
        return bool(fallen or strain[-1] > self.past * strain[self.peak])

    @property
    def time(self) -> Array:
        """Times [s] (t,)."""
        return self._column(0)

    @property
    def stress(self) -> Array:
        """Force of the grips over the area [Pa], (t,)."""
        return self._column(1)

    @property
    def strain(self) -> Array:
        """Change of the grips' distance over that distance, (t,)."""
        return self._column(2)

    @property
    def gauge_strain(self) -> Array:
        """Strains of the core along the axes, (t, dim)."""
        return self._column(3)

    @property
    def core_stress(self) -> Array:
        """Normal stresses of the core along the axes [Pa], (t, dim)."""
        return self._column(4)

    @property
    def broken(self) -> NDArray[np.int64]:
        """Number of broken bonds, (t,)."""
        return self._column(5).astype(np.int64)

    @property
    def peak(self) -> int:
        """Place of the greatest change of stress."""
        return int(np.argmax(np.abs(self.stress - self.stress[0])))

    def _column(self, place: int) -> Array:
        return np.array([row[place] for row in self._rows])


def _ids(body: Body, where: ArrayLike) -> NDArray[np.int64]:
    chosen = entries("where", where)
    ids = np.flatnonzero(chosen) if chosen.dtype == bool else chosen
    if len(ids) == 0 or ids.min() < 0 or ids.max() >= len(body.packing):
        raise InputError("a grip or the core is empty, or names elements that are not there.")
    return ids.astype(np.int64)

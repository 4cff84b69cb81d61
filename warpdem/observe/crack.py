"""Where a crack is and how fast it runs, from the times at which bonds broke."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Array, InputError, checked, finite
from .growth import (
    Branch,
    Front,
    find_branches,
    find_front,
    front_speeds,
    released_energy_rate,
    window_speeds,
)

if TYPE_CHECKING:
    from ..simulation import Simulation

REACH = 2.5  # spacings within which breaks hang together
LEAST = 8.0  # spacings: the shortest branch


class CrackTracker:
    """Follows one crack along a direction.

    every: steps between looks at the tip; direction: of growth, shape (dim,), by default x;
    window [m]: crack length over which a speed is fitted, by default 25 spacings,
    or an eighth of the path if it is shorter; stop_at [m]:
    coordinate along the direction at which the run is stopped. `tip` [m] is that of the last look.

    After a run: `log` (all broken bonds), `length` (middle of each window, from the first break
    [m]), `window_speed` [m/s], `speed` and `spread`: mean and max - min of the windows in the last
    half of the path [m/s], NaN if no window holds five breaks.
    Speeds are robust (Theil-Sen) fits to break times over places, not polls of the tip.
    """

    @checked
    def __init__(
        self,
        every: int = 20,
        direction: ArrayLike | None = None,
        window: float | None = None,
        stop_at: float = np.inf,
    ) -> None:
        self.every = every
        self.stop_at = stop_at
        self._direction = None if direction is None else finite("direction", direction, (None,))
        if window is not None and not window > 0.0:
            raise InputError(f"window is {window:g} m; it must be greater than zero.")
        self.window = window
        self.tip: float = np.nan
        self.log: NDArray[np.void] = np.zeros(0, dtype=[("time", float)])
        self.length: Array = np.zeros(0)
        self.window_speed: Array = np.zeros(0)

    def observe(self, sim: Simulation) -> None:
        """Look where the tip is, and stop the run if it is far enough."""
        log, self._dim = sim.broken_bonds(), sim.model.features.dim
        if len(log):
            self.tip = float(self._coordinate(log).max())
            if self.tip >= self.stop_at:
                sim.stop()

    def finish(self, sim: Simulation) -> None:
        """Fit the speeds."""
        self.log, self._dim = sim.broken_bonds(), sim.model.features.dim
        if len(self.log) == 0:
            return
        x = self._coordinate(self.log)
        x = x - x.min()
        self._spacing = max(b.packing.spacing for b in sim.scene.bodies)
        if self.window is None:
            self.window = min(25.0 * self._spacing, x.max() / 8.0)
        if self.window > 0.0:
            self.length, self.window_speed = window_speeds(x, self.log["time"], self.window)
        self._depth = self._thickness(sim)
        self._grown = x

    @property
    def speed(self) -> float:
        """Mean speed over the last half of the path [m/s]."""
        return float(self._late.mean()) if len(self._late) else np.nan

    @property
    def spread(self) -> float:
        """Greatest less least speed over the last half of the path [m/s]."""
        return float(np.ptp(self._late)) if len(self._late) else np.nan

    @property
    def release(self) -> tuple[Array, Array]:
        """Middle of each window [m] and energy that breaks in it released per new area [J/m^2].

        Since the ledger closes, it is what bodies and loads lost per area of crack.
        """
        if len(self.log) == 0 or not self.window:
            return np.zeros(0), np.zeros(0)
        energy = self.log["released_energy"]
        return released_energy_rate(self._grown, energy, self.window, self._depth)

    def branches(self, reach: float | None = None, least: float | None = None) -> list[Branch]:
        """All cracks and their branches (`find_branches`), of any number and direction.

        reach [m]: by default 2.5 spacings; least [m]: the shortest branch, by default 8 spacings.
        """
        if len(self.log) == 0:
            return []
        reach = REACH * self._spacing if reach is None else reach
        least = LEAST * self._spacing if least is None else least
        return find_branches(self._place(self.log), self.log["time"], reach, least)

    def front(self, across: ArrayLike, slices: int) -> list[tuple[float, Array, Array]]:
        """The crack's front in slices across it (`front_speeds`), for cracks in space."""
        if len(self.log) == 0 or not self.window:
            return []
        time = self.log["time"]
        return front_speeds(self._place(self.log), time, self._ahead, across, slices, self.window)

    def front_at(self, across: ArrayLike, slices: int, instants: int) -> Front:
        """Where the crack's front is in slices across it at some instants (`find_front`)."""
        if len(self.log) == 0:
            return Front(np.zeros(slices), np.zeros(0), np.zeros((0, slices)))
        time = self.log["time"]
        return find_front(self._place(self.log), time, self._ahead, across, slices, instants)

    def _place(self, log: NDArray[np.void]) -> Array:
        return np.stack([log[c] for c in "xyz"[: self._dim]], axis=1)

    @property
    def _ahead(self) -> Array:
        given = np.eye(self._dim)[0] if self._direction is None else self._direction
        return given / np.linalg.norm(given)

    def _thickness(self, sim: Simulation) -> float:
        """Length of the crack's front [m]: the plate's thickness, in space that of its breaks."""
        if self._dim == 2:
            return sim.scene.bodies[0].packing.thickness
        period = sim.scene.bodies[0].packing.period
        if period is not None and np.isfinite(period[2]):
            return float(period[2])
        return float(np.ptp(self.log["z"])) + self._spacing

    @property
    def _late(self) -> Array:
        if len(self.length) == 0:
            return self.length
        half = 0.5 * (self.length[-1] + 0.5 * (self.window or 0.0))
        return self.window_speed[self.length > half]

    def _coordinate(self, log: NDArray[np.void]) -> Array:
        return self._place(log) @ self._ahead

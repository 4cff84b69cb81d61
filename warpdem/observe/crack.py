"""Where a crack is and how fast it runs, from the times at which bonds broke."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Array, InputError, finite

if TYPE_CHECKING:
    from ..simulation import Simulation

FEWEST = 5  # broken bonds in a window that gives a speed


class CrackTracker:
    """Follows one crack along a direction.

    every: steps between looks at the tip; direction: of growth, shape (dim,), by default x;
    window [m]: crack length over which a speed is fitted, by default 25 spacings,
    or an eighth of the path if it is shorter; stop_at [m]:
    coordinate along the direction at which the run is stopped.

    After a run: `log` (all broken bonds), `length` (middle of each window, from the first break
    [m]), `window_speed` [m/s], `speed` and `spread`: mean and max - min of the windows in the last
    half of the path [m/s], NaN if no window holds five breaks.
    Speeds are robust (Theil-Sen) fits to break times over places, not polls of the tip.
    """

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
        log = sim.broken_bonds()
        if len(log):
            self.tip = float(self._coordinate(log, sim).max())
            if self.tip >= self.stop_at:
                sim.stop()

    def finish(self, sim: Simulation) -> None:
        """Fit the speeds."""
        self.log = sim.broken_bonds()
        if len(self.log) == 0:
            return
        from scipy.stats import theilslopes  # takes most of a second to load

        x = self._coordinate(self.log, sim)
        x = x - x.min()
        if self.window is None:
            self.window = 25.0 * max(b.packing.spacing for b in sim.scene.bodies)
            self.window = min(self.window, x.max() / 8.0)
        edges = np.arange(0.0, x.max() + 1e-9 * self.window, self.window)
        length, speed = [], []
        for low, high in pairwise(edges):
            inside = (x >= low) & (x < high)
            if inside.sum() >= FEWEST:
                slope = theilslopes(self.log["time"][inside], x[inside]).slope
                if slope > 0.0:
                    length.append(0.5 * (low + high))
                    speed.append(1.0 / slope)
        self.length, self.window_speed = np.array(length), np.array(speed)

    @property
    def speed(self) -> float:
        """Mean speed over the last half of the path [m/s]."""
        return float(self._late.mean()) if len(self._late) else np.nan

    @property
    def spread(self) -> float:
        """Greatest less least speed over the last half of the path [m/s]."""
        return float(np.ptp(self._late)) if len(self._late) else np.nan

    @property
    def _late(self) -> Array:
        if len(self.length) == 0:
            return self.length
        half = 0.5 * (self.length[-1] + 0.5 * (self.window or 0.0))
        return self.window_speed[self.length > half]

    def _coordinate(self, log: NDArray[np.void], sim: Simulation) -> Array:
        dim = sim.model.features.dim
        direction = np.eye(dim)[0] if self._direction is None else self._direction
        direction = direction / np.linalg.norm(direction)
        place = np.stack([log[c] for c in "xyz"[:dim]], axis=1)
        return place @ direction

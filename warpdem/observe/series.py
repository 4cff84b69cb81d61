"""Numbers of a simulation over time, any that a function can read."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import Array, InputError

if TYPE_CHECKING:
    from ..simulation import Simulation


class Series:
    """Reads named numbers every `every` steps.

    columns: names, each with a function of the simulation that gives a number, such as
    `{"force": lambda sim: sim.wall_force(plate)[1]}`. After a run: `table`, a structured array of
    time [s] and the columns with a row for each look; `series["force"]` is one of them.
    """

    def __init__(self, columns: dict[str, Callable[[Simulation], float]], every: int = 10) -> None:
        if not columns or "time" in columns:
            raise InputError("give columns other than time, each a name and a function.")
        self.columns, self.every = columns, every
        self._rows: list[tuple[float, ...]] = []

    @property
    def table(self) -> NDArray[np.void]:
        """What was read, look after look."""
        return np.array(self._rows, dtype=[(n, float) for n in ("time", *self.columns)])

    def __getitem__(self, name: str) -> Array:
        column: Array = self.table[name]
        return column

    def observe(self, sim: Simulation) -> None:
        """Read the numbers now."""
        self._rows.append((sim.time, *(float(read(sim)) for read in self.columns.values())))

    def finish(self, sim: Simulation) -> None:
        """Nothing is left to do."""

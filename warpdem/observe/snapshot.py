"""A picture of all elements at one instant."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from ..errors import Array

if TYPE_CHECKING:
    from ..simulation import Simulation


class Snapshot:
    """Keeps places and velocities the first time a condition holds, looking every `every` steps.

    After it was taken: time [s], position [m] and velocity [m/s] (n, dim), with `stress` the
    greatest principal one [Pa] (n,); `taken` says whether it was.
    """

    def __init__(
        self, when: Callable[[Simulation], bool], every: int = 20, stress: bool = False
    ) -> None:
        self.every, self.when, self.taken, self._stress = every, when, False, stress
        self.time = np.nan
        self.position: Array = np.zeros((0, 2))
        self.velocity: Array = np.zeros((0, 2))
        self.stress: Array = np.zeros(0)

    def observe(self, sim: Simulation) -> None:
        """Take it, if it is time."""
        if not self.taken and self.when(sim):
            self.taken, self.time = True, sim.time
            self.position, self.velocity = sim.position, sim.velocity
            if self._stress:
                self.stress = sim.principal_stress[:, 0]

    def slice(self, z: float, half: float) -> Snapshot:
        """Of a body in space the part within `half` of a height z [m], seen along the third axis:
        places and velocities (m, 2)."""
        part = copy(self)
        near = np.abs(self.position[:, -1] - z) <= half
        part.position, part.velocity = self.position[near, :2], self.velocity[near, :2]
        part.stress = self.stress[near] if len(self.stress) else self.stress
        return part

    def finish(self, sim: Simulation) -> None:
        """Nothing is left to do."""

"""Observers that are called only where something has happened."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..simulation import Observer, Simulation


class When:
    """Calls an observer where a condition holds, looking every `every` steps."""

    def __init__(
        self, observer: Observer, due: Callable[[Simulation], bool], every: int = 20
    ) -> None:
        self.observer, self.due, self.every = observer, due, every

    def observe(self, sim: Simulation) -> None:
        """Call it, if it is due."""
        if self.due(sim):
            self.observer.observe(sim)

    def finish(self, sim: Simulation) -> None:
        """Tell it that the run is over."""
        self.observer.finish(sim)

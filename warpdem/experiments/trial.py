"""Experiments that run for a time: how they are run, what is recorded and written of them.

Sliding, impact, indentation, crushing, drop: each has a file of its own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Unpack

import numpy as np

from .. import packing
from ..observe import FragmentTracker, Series
from ..packing import Packing
from ..scene import Scene
from ..simulation import Observer, Simulation
from ..write.chart import Chart
from ..write.log import UNITS
from ..write.whole import write_csv
from .shared import (
    Conduct,
    Options,
    Result,
    film,
    run_numbers,
)

FILES = ("picture.png", "scene.usd", "series.csv", "run.json")
BREAKING = ("broken_bonds.csv", "fragments.csv", "fragments_history.csv", "fragments.png")
ROWS, LOOKS, FRAMES = 600, 120, 48  # of the series, at fragments, of the USD scene
Reader = Callable[[Simulation], float]


@dataclass
class Stage:
    """The scene of a trial, and what is read of it.

    until [s]: when the run is over; size: of the bodies, in words; columns: of the series, with
    their units; damping: local; shows: the field that colours the USD scene; ends: observers that
    may end the run earlier.
    """

    scene: Scene
    until: float
    size: str
    columns: dict[str, Reader]
    units: dict[str, str]
    damping: float = 0.0
    shows: str = "von_mises"
    ends: tuple[Observer, ...] = ()
    series: Series = field(init=False)

    def __post_init__(self) -> None:
        self.series = Series(self.columns)


class Trial(ABC):
    """What is simulated. Dataclasses of parameters inherit from this."""

    name: ClassVar[str]
    title: ClassVar[str]
    files: ClassVar[tuple[str, ...]] = FILES

    @abstractmethod
    def stage(self) -> Stage:
        """The scene."""

    @abstractmethod
    def measure(self, run: Run) -> TrialResult:
        """What came out."""


@dataclass
class Run:
    """A trial that has run; pieces: where bodies break."""

    stage: Stage
    sim: Simulation
    pieces: FragmentTracker | None

    @property
    def numbers(self) -> dict[str, Any]:
        """The fields of `TrialResult`, but for the parameters."""
        return run_numbers(self.sim) | {"series": self.stage.series, "pieces": self.pieces}


@dataclass
class TrialResult(Result, ABC):
    """What came out of a trial: its numbers, the series over time, and the pieces if it breaks."""

    series: Series = field(repr=False)
    pieces: FragmentTracker | None = field(repr=False)
    parameters: Any = field(repr=False)

    objects: ClassVar[tuple[str, ...]] = ("simulation", "series", "pieces", "parameters")

    @property
    @abstractmethod
    def told(self) -> list[str]:
        """The result in words, line by line."""

    @property
    @abstractmethod
    def charts(self) -> list[Chart]:
        """The result in curves."""


def lattice_disc(diameter: float, spacing: float, plane: str) -> Packing:
    """A disc cut from a hexagonal lattice, about the origin, with rows along x."""
    edge = diameter + 4.0 * spacing
    p = packing.hexagonal((edge, edge), spacing, plane)
    middle = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
    middle = p.position[np.argmin(np.linalg.norm(p.position - middle, axis=1))]
    p = replace(p, position=p.position - middle)
    return p.without(np.linalg.norm(p.position, axis=1) > 0.5 * diameter)


def run_trial(
    p: Trial,
    **options: Unpack[Options],
) -> Any:
    """Make a trial; its result is that of `p.measure`.

    options: `shared.Options`; `p.files` are written. Raises InputError for parameters that cannot
    be run.
    """
    run = Conduct(**({"frames": FRAMES} | options))
    run.say("building the scene")
    stage = p.stage()
    sim = run.build(stage.scene, stage.size, stage.damping)
    steps = round(stage.until / sim.dt)
    run.foresee(sim, steps)
    stage.series.every = max(1, steps // ROWS)
    pieces = FragmentTracker(max(1, steps // LOOKS)) if BREAKING[0] in p.files else None
    own = (stage.series, *stage.ends, *([] if pieces is None else [pieces]))
    run.watch(sim, stage, own, film("scene.usd", steps // run.frames, stage.shows))
    sim.run(until=stage.until)
    result = p.measure(Run(stage, sim, pieces))
    if run.where is not None:
        _write(run.where, p, stage, result)
    run.close(p.name, p, result)
    return result


def _write(where: Path, p: Trial, stage: Stage, result: TrialResult) -> None:
    from ..write.fragment import write_fragments
    from ..write.trial import draw_trial

    sim = result.simulation
    title = f"{p.title}: {stage.size}; {result.elements} elements, {sim.precision}"
    draw_trial(where / "picture.png", title, result.charts, sim)
    write_csv(where / "series.csv", result.series.table, {"time": "s"} | stage.units)
    if result.pieces is not None:
        write_csv(where / "broken_bonds.csv", sim.broken_bonds(), UNITS)
        write_fragments(where, result.pieces)

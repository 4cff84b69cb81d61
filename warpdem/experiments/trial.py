"""Experiments that run for a time: how they are run, what is recorded and written of them.

Sliding, impact, indentation, crushing, drop: each has a file of its own.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from .. import packing
from ..checkpoint import Checkpoint
from ..observe import FragmentTracker, Series
from ..packing import Packing
from ..scene import Scene
from ..simulation import Observer, Simulation
from ..write.chart import Chart
from ..write.whole import folder, write_csv
from .shared import UNITS, Result, build, foreseen, run_numbers, silent, write_record

FILES = ("picture.png", "scene.usd", "series.csv", "run.json")
BREAKING = ("broken_bonds.csv", "fragments.csv", "fragments_history.csv", "fragments.png")
ROWS, LOOKS, FRAMES = 600, 120, 48  # of the series, at fragments, of the USD scene
Reader = Callable[[Simulation], float]


def _at_once(_: Simulation) -> None:
    """Nothing to do before the run."""


@dataclass
class Stage:
    """The scene of a trial, and what is read of it.

    until [s]: when the run is over; size: of the bodies, in words; columns: of the series, with
    their units; damping: local; start: brings the simulation to its start; shows: the field that
    colours the USD scene; ends: observers that may end the run earlier.
    """

    scene: Scene
    until: float
    size: str
    columns: dict[str, Reader]
    units: dict[str, str]
    damping: float = 0.0
    start: Callable[[Simulation], None] = _at_once
    shows: str = "von_mises"
    dt: float | None = None
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
    *,
    device: str = "cpu",
    precision: str = "float64",
    threads: int = 1,
    out: str | Path | None = None,
    observers: Callable[[Simulation, Any], list[Any]] | None = None,
    say: Callable[[str], None] = silent,
    frames: int = FRAMES,
    checkpoint: Checkpoint | None = None,
) -> Any:
    """Make a trial; its result is that of `p.measure`.

    out: folder for `p.files`; None writes nothing. observers: makes further observers of the run;
    say: is told what happens, line by line; frames: of the USD scene, about; threads: of the CPU;
    checkpoint: of the run, which goes on from its file if there is one.
    Raises InputError for parameters that cannot be run.
    """
    began = time.perf_counter()
    where = None if out is None else folder(out)
    say("building the scene")
    stage = p.stage()
    sim = build(
        stage.scene,
        device,
        precision,
        say,
        stage.size,
        stage.damping,
        threads,
        stage.dt,
        checkpoint,
    )
    if not sim.steps:
        stage.start(sim)
    steps = round(stage.until / sim.dt)
    say(foreseen(sim, steps))
    pieces = None
    stage.series.every = max(1, steps // ROWS)
    sim.observe(stage.series)
    for end in stage.ends:
        sim.observe(end)
    if BREAKING[0] in p.files:
        pieces = FragmentTracker(max(1, steps // LOOKS))
        sim.observe(pieces)
    if where is not None:
        from ..write.usd import UsdWriter

        film = UsdWriter(where / "scene.usd", max(1, steps // frames), color=stage.shows)
        sim.observe(film)
    for observer in observers(sim, stage) if observers else []:
        sim.observe(observer)
    sim.run(until=stage.until)
    result = p.measure(Run(stage, sim, pieces))
    if where is None:
        result.seconds = time.perf_counter() - began
    else:
        _write(where, p, stage, result)
        write_record(where, p.name, p, result, began)
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

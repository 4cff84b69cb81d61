"""An experiment over a grid of parameters: one process and one folder a run, resumable."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .errors import InputError, library, one_of
from .experiments.described import Experiment, find, write_given
from .experiments.shared import CHECKPOINT, Say, silent
from .write.claim import alone
from .write.whole import folder, whole, write_json

INTERRUPTED = (128 + signal.SIGINT, 128 + signal.SIGTERM)  # status of runs that saved their state
POLL = 0.1  # s between looks at the runs
PARENT = "WARPDEM_PARENT"  # in whose life alone a run goes on, an id of a process


class Job(Protocol):
    """A run under way; result: its exit status."""

    def done(self) -> bool:
        """Whether it has ended."""

    def result(self) -> int:
        """Its exit status, negative if a signal ended it."""

    def cancel(self) -> object:
        """End it."""


@dataclass
class Run:
    """One run: its folder, its parameters as given, and its record (run.json).

    status: new, running, complete, failed (it ended with an error) or interrupted (it was ended).
    """

    folder: Path
    given: dict[str, Any]
    status: str = "new"
    record: dict[str, Any] = field(default_factory=dict, repr=False)

    def read(self) -> None:
        """Take the status from the folder; one that nobody runs any more is interrupted."""
        if (self.folder / "run.json").is_file():
            self.record = json.loads((self.folder / "run.json").read_text())
            self.status = self.record["status"]
            if self.status == "running":
                self.status = "interrupted"

    def write(self, experiment: str, status: str, **more: object) -> None:
        """Note a status other than complete, which the run itself writes."""
        self.status = status
        self.record = {"experiment": experiment, "status": status, "parameters": self.given} | more
        self.record["given"] = write_given(self.given)
        write_json(self.folder / "run.json", self.record)

    def command(self, experiment: Experiment, *more: str) -> list[str]:
        """The command line of the run, which goes on from its checkpoint if there is one."""
        if not more and (self.folder / CHECKPOINT).exists():
            return [sys.executable, "-m", "warpdem", "resume", str(self.folder)]
        line = [sys.executable, "-m", "warpdem", "run", experiment.name]
        for name, value in self.given.items():
            option = name.replace("_", "-")
            if isinstance(value, bool):
                line.append(f"--{option}" if value else f"--no-{option}")
            elif value is not None:
                line.append(f"--{option}={value}")
        return [*line, f"--out={self.folder}", *more]


@dataclass
class Sweep:
    """What came of a sweep; swept: names of parameters with several values."""

    experiment: Experiment
    runs: list[Run]
    swept: list[str]
    result: str
    against: str

    def values(self, name: str) -> NDArray[np.float64]:
        """A result of every run, (runs,); nan where a run is not complete or has none."""
        found = [r.record.get(name) if r.status == "complete" else None for r in self.runs]
        return np.array([np.nan if v is None else v for v in found], dtype=float)

    def count(self, status: str) -> int:
        """How many runs have a status."""
        return sum(r.status == status for r in self.runs)

    def write(self, where: Path) -> None:
        """table.csv, a line for every run, and sweep.png, the result against a parameter."""
        from .write.sweep import draw_sweep

        names = self.experiment.results
        with whole(where / "table.csv") as part, part.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["run", *self.swept, "status", *names, "error"])
            for r in self.runs:
                numbers = [r.record.get(n) if r.status == "complete" else None for n in names]
                given = [r.given[n] for n in self.swept]
                writer.writerow([r.folder.name, *given, r.status, *numbers, r.record.get("error")])
        others = [n for n in self.swept if n not in (self.against, "seed")]
        lines = [", ".join(f"{n} {r.given[n]}" for n in others) for r in self.runs]
        at = [r.given[self.against] for r in self.runs]
        draw_sweep(
            where / "sweep.png", at, self.values(self.result), lines, self.against, self.result
        )


def sweep(
    name: str,
    grid: Mapping[str, Any],
    *,
    out: str | Path,
    jobs: int = 1,
    engine: str = "local",
    options: Mapping[str, Any] | None = None,
    result: str | None = None,
    against: str | None = None,
    retry: bool = False,
    say: Say = silent,
    watch: Callable[[Sweep, Run | None], None] | None = None,
) -> Sweep:
    """Run an experiment for every combination of parameters.

    name: of the experiment; grid: its parameters, each a value or a list of them; out: folder;
    jobs: runs at a time; engine: local, dask or slurm, with `options` (see `docs/sweeps.md`);
    result and against: what is drawn, by default the experiment's first number against the first
    parameter with several values. Complete runs in the folder are kept and interrupted ones run
    again; failed ones only with `retry`. say: is told what happens; watch: is told of each run as
    it ends, and once before the first with None. Raises InputError for parameters that the
    experiment does not have, or where another sweep works in the folder.
    """
    experiment = find(name)
    columns: dict[str, list[Any]] = {}
    for key, value in grid.items():
        one_of(f"parameter of {name}", key, experiment.described)
        many = isinstance(value, Iterable) and not isinstance(value, str)
        values = [experiment.described[key].read(v) for v in (value if many else [value])]
        if not values:
            raise InputError(f"{key} has no values; give one or more.")
        columns[key] = list(dict.fromkeys(values))
    if jobs < 1:
        raise InputError(f"jobs is {jobs}; it must be 1 or more.")
    one_of("engine", engine, ENGINES)
    swept = [key for key, values in columns.items() if len(values) > 1] or list(columns)[:1]
    if not swept:
        raise InputError("no parameter is given; give one with several values.")
    one_of("result", result or experiment.results[0], experiment.results)
    one_of("against", against or swept[0], swept)

    where = folder(out).resolve()
    runs = []
    for combination in product(*columns.values()):
        given = dict(zip(columns, combination, strict=True))
        runs.append(Run(where / _folder_name(name, given, swept), given))
    _refuse_if_none_valid(experiment, runs)
    found = Sweep(experiment, runs, swept, result or experiment.results[0], against or swept[0])
    with alone(where, "another sweep works in"):
        for run in runs:
            run.read()
        wanted = ("new", "interrupted", "failed") if retry else ("new", "interrupted")
        todo = [r for r in runs if r.status in wanted]
        say(
            f"{len(runs)} runs of {name}: {found.count('complete')} complete, {len(todo)} to do, "
            f"{jobs} at a time, in {where}"
        )
        if found.count("failed") and not retry:
            say(f"{found.count('failed')} failed before and are left; --retry runs them again")
        if watch:
            watch(found, None)
        if todo:
            _work(found, todo, where, jobs, engine, dict(options or {}), say, watch)
        found.write(where)
    return found


def _work(
    found: Sweep,
    todo: list[Run],
    where: Path,
    jobs: int,
    engine: str,
    options: dict[str, Any],
    say: Say,
    watch: Callable[[Sweep, Run | None], None] | None,
) -> None:
    experiment = found.experiment
    submit, close = ENGINES[engine](where, jobs, options)
    active: dict[int, tuple[Run, Job]] = {}
    try:
        kinds = _kinds(experiment, todo)
        if len(todo) > 1 and jobs > 1:
            say(f"compiling the kernels of {len(kinds)} kind(s) of scene, once for all runs")
            for run in kinds:
                job = submit(run.command(experiment, "--compile-only"), where / "compile.txt")
                active[-1] = (run, job)
                while not job.done():
                    time.sleep(POLL)
                del active[-1]
        waiting = list(enumerate(todo))[::-1]
        while waiting or active:
            while waiting and len(active) < jobs:
                i, run = waiting.pop()
                folder(run.folder)
                run.write(experiment.name, "running")
                active[i] = run, submit(run.command(experiment), run.folder / "log.txt")
            for i, (run, job) in list(active.items()):
                if job.done():
                    _end(experiment, run, job)
                    del active[i]
                    if watch:
                        watch(found, run)
            time.sleep(POLL)
    finally:  # also at Ctrl-C
        for _, job in active.values():
            job.cancel()
        close()
        for i, (run, _) in active.items():
            if i >= 0:
                run.read()
                if run.status != "complete":
                    run.write(experiment.name, "interrupted", error="the sweep was stopped")


def _end(experiment: Experiment, run: Run, job: Job) -> None:
    try:
        status = job.result()
    except Exception as lost:  # whatever an engine raises of a worker that was lost
        run.write(experiment.name, "interrupted", error=f"the worker was lost: {lost}")
        return
    run.read()
    if status == 0 and run.status == "complete":
        return
    if status < 0 or status in INTERRUPTED:
        number = -status if status < 0 else status - 128
        run.write(experiment.name, "interrupted", error=f"ended by signal {number}")
        return
    log = run.folder / "log.txt"
    lines = [x for x in log.read_text(errors="replace").splitlines() if x.strip()]
    told = [x for x in lines if x.startswith(("error: ", "stopped: "))]
    said = (told or lines or ["it wrote nothing"])[-1]
    run.write(experiment.name, "failed", error=said, exit_status=status)


def _kinds(experiment: Experiment, runs: list[Run]) -> list[Run]:
    """One run for each combination of values that are no numbers: those choose the kernels."""
    kinds: dict[tuple[Any, ...], Run] = {}
    for r in runs:
        words = tuple(
            str(v).partition(":")[0] if experiment.described[k].criterion else v
            for k, v in r.given.items()
            if v is None or isinstance(v, str | bool)
        )
        kinds.setdefault(words, r)
    return list(kinds.values())


def _folder_name(name: str, given: dict[str, Any], swept: list[str]) -> str:
    """Readable, and another one for other parameters."""
    shown = ",".join(f"{k}={given[k]}" for k in swept)
    key = json.dumps([name, sorted(given.items())])
    digest = hashlib.sha256(key.encode()).hexdigest()[:8]
    readable = re.sub(r"[^-\w.,=+]", "_", shown)[:100]
    return f"{readable}-{digest}"


def _refuse_if_none_valid(experiment: Experiment, runs: list[Run]) -> None:
    """Single bad combinations fail as runs; if all are bad, that is said at once."""
    said = ""
    for run in runs:
        try:
            experiment.build(run.given)
            return
        except InputError as error:
            said = str(error)
    raise InputError(f"no combination can be run; the last: {said}")


def _start(command: list[str], log: Path) -> subprocess.Popen[bytes]:
    environment = os.environ | {PARENT: str(os.getpid()), "PYTHONUNBUFFERED": "1"}
    with log.open("wb") as file:
        # a session of its own: Ctrl-C reaches the sweep alone, which ends its runs
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )


def _execute(command: list[str], log: str) -> int:
    """What a worker of a cluster does."""
    return _start(command, Path(log)).wait()


class _Process:
    def __init__(self, command: list[str], log: Path) -> None:
        self.process = _start(command, log)

    def done(self) -> bool:
        return self.process.poll() is not None

    def result(self) -> int:
        return self.process.wait()

    def cancel(self) -> None:
        self.process.kill()
        self.process.wait()


Submit = Callable[[list[str], Path], Job]
Engine = Callable[[Path, int, dict[str, Any]], tuple[Submit, Callable[[], None]]]


def _local(where: Path, jobs: int, options: dict[str, Any]) -> tuple[Submit, Callable[[], None]]:
    if options:
        raise InputError(f"the local engine takes no options, not {', '.join(options)}.")
    return _Process, lambda: None


def _dask(where: Path, jobs: int, options: dict[str, Any]) -> tuple[Submit, Callable[[], None]]:
    """options: those of dask.distributed.Client; without an address a local cluster of processes"""
    if "address" not in options:
        options = {"n_workers": jobs, "threads_per_worker": 1, "dashboard_address": None} | options
    client = library("distributed", "cluster").Client(**options)

    def submit(command: list[str], log: Path) -> Job:
        job: Job = client.submit(_execute, command, str(log), pure=False, retries=0)
        return job

    return submit, client.close


def _slurm(where: Path, jobs: int, options: dict[str, Any]) -> tuple[Submit, Callable[[], None]]:
    """options: of submitit; cluster=local runs the jobs here."""
    engine = library("submitit", "cluster")
    executor = engine.AutoExecutor(where / "jobs", cluster=options.pop("cluster", "slurm"))
    executor.update_parameters(**{"timeout_min": 24 * 60} | options)

    def submit(command: list[str], log: Path) -> Job:
        job: Job = executor.submit(_execute, command, str(log))
        return job

    return submit, lambda: None


ENGINES: dict[str, Engine] = {"local": _local, "dask": _dask, "slurm": _slurm}

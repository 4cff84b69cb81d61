"""The command line: `warpdem run NAME`, `resume`, `sweep`, `film`, `validate`, `bench`, `info`."""

import json
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable
from enum import Enum
from importlib.metadata import version
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as RichTable

from . import experiments
from .archive import previous as one_before
from .checkpoint import Checkpoint
from .errors import (
    InputError,
    NonFiniteError,
    NotConvergedError,
    TooFastError,
    TroubledBondError,
)
from .experiments import ModeIIResult, ModeIResult, Result
from .experiments.described import EXPERIMENTS, Experiment, read_given, write_given
from .experiments.rock import Rig, Rock, RockResult
from .experiments.shared import CHECKPOINT, start_record
from .observe import CrackTracker
from .simulation import GUARD_EVERY, Observer, Simulation
from .sweeps import ENGINES, PARENT, Run, Sweep, sweep
from .write.claim import claimed
from .write.record import describe_machine
from .write.whole import unit_of, write_text

CHECKPOINT_EVERY = 600.0
CHECKPOINT_HELP = (
    "Seconds between checkpoints, from which `warpdem resume` goes on; 0 for none but the one that "
    "SIGTERM or Ctrl-C write."
)
NEVER = 1e12  # s
CONDUCTS: dict[str, Callable[..., None]] = {}  # what `warpdem resume` calls, by experiment

app = typer.Typer(help="Fracture of solids made of bonded elements.", no_args_is_help=True)
run = typer.Typer(help="Run a published experiment.", no_args_is_help=True)
app.add_typer(run, name="run")
many = typer.Typer(help="Run an experiment over a grid of parameters.", no_args_is_help=True)
app.add_typer(many, name="sweep")
console = Console(highlight=False, soft_wrap=True)
errors = Console(stderr=True, highlight=False, soft_wrap=True)


class Start(Enum):
    """From what a run in a folder starts."""

    ANEW, LAST, PREVIOUS = range(3)


Done = Callable[[Simulation], tuple[float, str]]


class Advance:
    """An observer that shows how far a run has come, its rate and the time left.

    what: a word, and `of` what there is in all; done: how much of `total` a simulation has done,
    with the text that says so.
    """

    every = 20
    not_saved = ("told", "task")  # of the terminal

    def __init__(self, what: str, of: str, total: float, done: Done):
        self.what, self.of, self.done = what, of, done
        self.told = time.perf_counter()
        self.bar = Progress(
            TextColumn(what + " {task.fields[shown]:>5} of " + of),
            BarColumn(),
            TextColumn("{task.fields[rate]:.1f} million element-steps/s, left"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self.task = self.bar.add_task(what, total=total, shown="", rate=0.0)
        self.bar.start()

    def observe(self, sim: Simulation) -> None:
        """Move the bar, or print a line where there is no terminal."""
        completed, shown = self.done(sim)
        self.bar.update(self.task, completed=completed, shown=shown, rate=sim.rate / 1e6)
        if not console.is_terminal and time.perf_counter() - self.told > 5.0:
            self.told = time.perf_counter()
            console.print(
                f"step {sim.steps}: {self.what} {shown} of {self.of}, "
                f"{sim.rate / 1e6:.1f} million element-steps/s"
            )

    def finish(self, sim: Simulation) -> None:
        """Leave the bar as it stands."""
        self.bar.stop()


def experiment(
    name: str,
    title: str,
    parameters: type,
    function: Callable[..., Result],
    progress: Callable[[Any, Any], Observer],
    closing: Callable[[Any], list[str]],
) -> None:
    """Make an experiment a command whose options are the fields of its parameters, and known.

    progress: makes the observer that shows how far it is, of the parameters and of what the
    experiment hands to `observers`; closing: lines about the result.
    """

    told = Experiment(name, title, parameters, function)
    EXPERIMENTS[name] = told

    def run_it(
        given: dict[str, Any], threads: int, out: Path | None, checkpoint: Checkpoint | None
    ) -> Result:
        """The experiment, or without a folder its kernels alone."""
        chosen = told.build(given)

        def observers(_: Simulation, measured: Any) -> list[Observer]:
            if out is None:
                console.print("kernels are compiled")
                raise typer.Exit
            return [progress(chosen, measured)]

        return function(
            chosen,
            device=given["device"],
            precision=given["precision"],
            threads=threads,
            out=out,
            observers=observers,
            say=console.print,
            checkpoint=checkpoint,
        )

    def conduct(
        out: Path, threads: int, checkpoint_every: float, goes_on: Start, **given: Any
    ) -> None:
        """The experiment in a folder of its own, with checkpoints."""
        chosen = told.build(given)
        record = start_record(name, chosen, given["precision"], given["device"])
        record["given"] = write_given(given)
        if checkpoint_every < 0.0:
            raise InputError(f"checkpoint-every is {checkpoint_every:g} s; give 0 or more.")
        try:
            with claimed(out, record):
                kept = Checkpoint(out / CHECKPOINT, GUARD_EVERY, checkpoint_every or NEVER)
                if goes_on is Start.PREVIOUS:
                    os.replace(one_before(kept.path), kept.path)
                if kept.path.exists() and goes_on is Start.ANEW:
                    raise InputError(
                        f"{out} has the checkpoint of a run that was interrupted: go on with "
                        f"`warpdem resume {out}`, remove {CHECKPOINT} to start anew, or choose "
                        "another folder."
                    )
                result = run_it(given, threads, out, kept)
                kept.remove()
        except (KeyboardInterrupt, SystemExit):
            if (out / CHECKPOINT).exists():
                errors.print(f"interrupted: `warpdem resume {out}` goes on from {out / CHECKPOINT}")
            raise
        for line in closing(result):
            console.print(line)
        console.print(
            f"energy error {result.energy_error:.1e}; broken bonds {result.broken_bonds}; "
            f"{result.element_steps_per_second / 1e6:.1f} million element-steps/s; "
            f"{result.seconds:.0f} s in all"
        )
        console.print(f"written to {out}: {' '.join(chosen.files)}")

    CONDUCTS[name] = conduct

    def command(
        out: Path, compile_only: bool, threads: int, checkpoint_every: float, **given: Any
    ) -> None:
        console.print(f"warpdem {version('warpdem')}: {title}")
        if compile_only:
            run_it(given, threads, None, None)
            return
        conduct(out, threads, checkpoint_every, Start.ANEW, **given)

    options = [_option(d.name, d.kind, d.default, d.help) for d in told.described.values()]
    options += [
        _option("out", Path, Path("out") / name, "Folder for the results."),
        _option("threads", int, 1, "Threads of the CPU; results do not depend on them."),
        _option("checkpoint_every", float, CHECKPOINT_EVERY, CHECKPOINT_HELP),
        _option("compile_only", bool, False, "Compile the kernels and stop before the first step."),
    ]
    _add(run, told, command, options)
    _add_sweep(told)


def _add_sweep(told: Experiment) -> None:
    """The command whose options take a value or a list of them each."""

    def command(
        out: Path, jobs: int, engine: str, engine_options: str, result: str, against: str,
        retry: bool, **given: str | None,
    ) -> None:  # fmt: skip
        grid = {k: told.described[k].split(v) for k, v in given.items() if v is not None}
        pairs = [part.partition("=") for part in engine_options.split(",") if part]
        bar = Progress(
            TextColumn("{task.completed} of {task.total} runs, {task.fields[bad]} not complete"),
            BarColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        with bar:
            task = bar.add_task("", total=None, bad=0)

            def watch(found: Sweep, ended: Run | None) -> None:
                done = found.count("complete")
                bad = found.count("failed") + (found.count("interrupted") if ended else 0)
                bar.update(task, total=len(found.runs), completed=done, bad=bad)
                if ended is not None:
                    shown = ", ".join(f"{k} {ended.given[k]}" for k in found.swept)
                    number = ended.record.get(found.result, ended.record.get("error"))
                    words = f"{found.result} {number:.6g}" if _is_number(number) else str(number)
                    console.print(
                        f"{done} of {len(found.runs)}: {shown}: {ended.status}, {words}",
                        markup=False,
                    )

            found = sweep(
                told.name, grid, out=out, jobs=jobs, engine=engine, retry=retry, watch=watch,
                result=result or None, against=against or None, say=console.print,
                options={k: int(v) if v.isdigit() else v for k, _, v in pairs},
            )  # fmt: skip
        table = RichTable(*found.swept, "status", found.result, "energy error", "seconds")
        for r, *numbers in zip(
            found.runs, *map(found.values, (found.result, "energy_error", "seconds")), strict=True
        ):
            table.add_row(
                *(str(r.given[k]) for k in found.swept), r.status, *(f"{n:.4g}" for n in numbers)
            )
        console.print(table)
        console.print(f"written to {out}: table.csv sweep.png, and a folder for each run")
        missing = len(found.runs) - found.count("complete")
        if missing:
            errors.print(
                f"{missing} runs are not complete: the same command runs interrupted ones again, "
                "with --retry failed ones too; log.txt in a run's folder says what happened"
            )
            raise typer.Exit(1)

    options = [
        _option(d.name, str | None, None, d.help, str(d.default)) for d in told.described.values()
    ]
    options += [
        _option("out", Path, Path("out") / f"{told.name}-sweep", "Folder for the runs."),
        _option("jobs", int, 1, "Runs at a time."),
        _option("engine", str, "local", f"Where runs go: {', '.join(ENGINES)}."),
        _option("engine_options", str, "", "Of the engine, name=value,..."),
        _option("result", str, "", "Drawn and printed.", told.results[0]),
        _option("against", str, "", "Parameter that it is drawn against.", "the first swept"),
        _option("retry", bool, False, "Run failed runs again too."),
    ]
    _add(many, told, command, options)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def _add(to: typer.Typer, told: Experiment, command: Any, options: list[Parameter]) -> None:
    command.__signature__ = Signature(options)
    command.__annotations__ = {}
    command.__doc__ = (told.function.__doc__ or "").partition("\n\n")[0]
    to.command(told.name)(command)


def _option(name: str, kind: Any, default: Any, words: str, shown: Any = True) -> Parameter:
    option = Annotated[kind, typer.Option(help=words, show_default=shown)]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=option)


def _crack_progress(p: experiments.ModeI, crack: CrackTracker) -> Observer:
    scale, unit = unit_of(crack.stop_at)

    def done(_: Simulation) -> tuple[float, str]:
        tip = min(crack.tip, crack.stop_at) if np.isfinite(crack.tip) else p.notch
        return tip - p.notch, f"{tip * scale:.4g}"

    return Advance("crack", f"{crack.stop_at * scale:.4g} {unit}", crack.stop_at - p.notch, done)


def _crack_closing(result: ModeIResult) -> list[str]:
    if not np.isfinite(result.speed_over_rayleigh):
        return [
            "the crack did not run far enough for a terminal speed; raise --strain or lower "
            "--strength"
        ]
    return [
        f"terminal speed / Rayleigh speed: {result.speed_over_rayleigh:.3f} "
        f"(max - min of its windows {result.speed_spread:.3f}); "
        f"Rayleigh speed {result.rayleigh_speed:.0f} m/s"
    ]


experiment(
    "mode-i",
    "mode I crack in a strained plate",
    experiments.ModeI,
    experiments.mode_i,
    _crack_progress,
    _crack_closing,
)


def _shear_progress(p: experiments.ModeII, crack: CrackTracker) -> Observer:
    scale, unit = unit_of(crack.stop_at)

    def done(_: Simulation) -> tuple[float, str]:
        tip = min(crack.tip, crack.stop_at) if np.isfinite(crack.tip) else p.centre
        return tip - p.centre, f"{tip * scale:.4g}"

    return Advance("crack", f"{crack.stop_at * scale:.4g} {unit}", crack.stop_at - p.centre, done)


def _shear_closing(result: ModeIIResult) -> list[str]:
    if not np.isfinite(result.final_over_p):
        return ["the crack did not run far enough; raise --overload or lower --seismic-ratio"]
    return [
        f"S {result.seismic_ratio:.3g}: plateau at {result.plateau_over_rayleigh:.3f} of the "
        f"Rayleigh speed over {result.plateau_spacings:.0f} spacings; at the end "
        f"{result.final_over_p:.3f} of the P wave speed, {result.final_over_rayleigh:.3f} of the "
        f"Rayleigh speed; rank correlation of speed and length {result.rank_correlation:.3f}"
    ]


experiment(
    "mode-ii",
    "mode II crack in a sheared plate",
    experiments.ModeII,
    experiments.mode_ii,
    _shear_progress,
    _shear_closing,
)


def _load_progress(p: Rock, rig: Rig) -> Observer:
    def done(_: Simulation) -> tuple[float, str]:
        stress = p.sign * rig.history.stress if len(rig.history.time) else np.zeros(1)
        return float(stress[-1]), f"{stress[-1] / 1e6:.4g}"

    most = f"{rig.strength / 1e6:.4g} MPa that the criterion bears"
    return Advance("stress", most, rig.strength, done)


def _rock_closing(result: RockResult) -> list[str]:
    p = result.parameters
    lines = [
        f"{p.title}: {p.stress_name} {result.strength / 1e6:.4g} MPa at the peak, "
        f"{result.strength / result.criterion_strength:.3f} of the criterion's "
        f"{result.criterion_strength / 1e6:.4g} MPa in homogeneous stress; first bond broken at "
        f"{result.first_break_stress / 1e6:.4g} MPa"
    ]
    if np.isfinite(result.young):
        lines.append(
            f"Young's modulus {result.young / 1e9:.4g} GPa (given {p.young / 1e9:.4g}), Poisson's "
            f"ratio {result.poisson:.4f} (given {p.poisson:g})"
        )
    if np.isfinite(result.fracture_angle):
        lines.append(
            f"densest band of broken bonds {result.fracture_angle:.0f} degrees to the load "
            f"(expected {result.expected_angle:.0f}), {result.band_share:.0%} of them in it; "
            f"{result.tensile_breaks} bonds broke in tension, {result.shear_breaks} in shear"
        )
    return lines


for _parameters, _function in (
    (experiments.Tension, experiments.tension),
    (experiments.Compression, experiments.compression),
    (experiments.Confined, experiments.confined),
    (experiments.Brazilian, experiments.brazilian),
):
    experiment(
        _parameters.name,
        _parameters.title.lower(),
        _parameters,
        _function,
        _load_progress,
        _rock_closing,
    )


def _time_progress(until: float) -> Observer:
    scale, unit = unit_of(until)

    def done(sim: Simulation) -> tuple[float, str]:
        return sim.time, f"{sim.time * scale:.4g}"

    return Advance("time", f"{until * scale:.4g} {unit[:-1]}s", until, done)


for _trial, _make in (
    (experiments.SlidingBlock, experiments.sliding_block),
    (experiments.SpringSlider, experiments.spring_slider),
    (experiments.Drop, experiments.drop),
    (experiments.CrushedGrain, experiments.crushed_grain),
    (experiments.Indentation, experiments.indentation),
    (experiments.Impact, experiments.impact),
):
    experiment(
        _trial.name,
        _trial.title.lower(),
        _trial,
        _make,
        lambda _, stage: _time_progress(stage.until),
        lambda result: result.told,
    )


for _kind, _run in (
    (experiments.Kalthoff, experiments.kalthoff),
    (experiments.JohnShah, experiments.john_shah),
    (experiments.Branching, experiments.branching),
    (experiments.Heterogeneous, experiments.heterogeneous),
    (experiments.Bimaterial, experiments.bimaterial),
):
    experiment(
        _kind.name,
        _kind.title,
        _kind,
        _run,
        lambda p, _: _time_progress(p.duration),
        lambda result: result.told,
    )


@app.command()
def resume(
    folder: Annotated[Path, typer.Argument(help="Folder of a run that was interrupted.")],
    threads: Annotated[int, typer.Option(help="Threads of the CPU.")] = 1,
    checkpoint_every: Annotated[float, typer.Option(help=CHECKPOINT_HELP)] = CHECKPOINT_EVERY,
    previous: Annotated[
        bool, typer.Option("--previous", help="Go on from the checkpoint before the last.")
    ] = False,
) -> None:
    """Go on with a run from its last checkpoint, to the results it would have had."""
    name, given = read_given(folder)
    last = folder / CHECKPOINT
    if previous and not one_before(last).exists():
        raise InputError(
            f"{folder} has no {one_before(last).name}: the run ended before its second checkpoint."
        )
    if not previous and not last.exists():
        raise InputError(
            f"{folder} has no {CHECKPOINT}: the run ended before its first one. Start it again "
            f"with `warpdem run {name}`."
        )
    console.print(f"warpdem {version('warpdem')}: {EXPERIMENTS[name].title}, going on in {folder}")
    goes_on = Start.PREVIOUS if previous else Start.LAST
    CONDUCTS[name](folder, threads, checkpoint_every, goes_on, **given)


@app.command()
def validate(
    name: Annotated[
        str | None, typer.Argument(help="A group of cases, or one case; all by default.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a list of objects.")] = False,
    slow: Annotated[bool, typer.Option(help="Run the cases that take minutes as well.")] = True,
    write: Annotated[
        Path | None, typer.Option(help="Also write the table as a Markdown file.")
    ] = None,
) -> None:
    """Measure the code against theory; exit status 1 if a limit is missed."""
    from .validation import Check, as_markdown, cases

    checks: list[Check] = []
    for case in cases(name):
        if case.slow and not slow:
            continue
        found = case.run()
        checks += found
        if not as_json:
            console.print(f"{case.name} ({found[0].seconds:.1f} s)", style="bold")
            for check in found:
                mark = "ok  " if check.passed else "MISS"
                console.print(
                    f"  {mark} {check.quantity}: measured {check.measured:.6g}, reference "
                    f"{check.reference:.6g} ({check.source}), error {check.error:.2g}, limit "
                    f"{check.limit:.2g}",
                )
    missed = sum(not check.passed for check in checks)
    if as_json:
        keys = ("case", "quantity", "reference", "source", "measured", "error", "limit", "seconds")
        print(json.dumps([{k: getattr(c, k) for k in keys} for c in checks], indent=1))
    else:
        console.print(f"{len(checks)} checks, {missed} missed")
    if write is not None:
        write_text(write, as_markdown(checks))
    if missed:
        raise typer.Exit(1)


@app.command()
def film(
    scene: Annotated[Path, typer.Argument(help="A USD scene that a run wrote.")],
    out: Annotated[
        Path | None, typer.Option(help=".gif, or .png for a sequence; by default beside it.")
    ] = None,
    pixels: Annotated[int, typer.Option(help="Along the longer edge.")] = 640,
) -> None:
    """Make a film from a USD scene, as its camera sees it."""
    from .write.film import write_film

    path = out or scene.with_suffix(".gif")
    console.print(f"{write_film(scene, path, pixels)} frames: {path}")


@app.command()
def bench(
    size: Annotated[
        int, typer.Option(help="Elements of the bodies whose steps are timed.")
    ] = 30_000,
    threads: Annotated[int, typer.Option(help="Threads of the CPU.")] = 1,
    device: Annotated[str, typer.Option(help="Where the steps are timed.")] = "cpu",
    cases: Annotated[bool, typer.Option(help="Also the cases whose answer is known.")] = True,
) -> None:
    """How fast this machine steps scenes, and what error known answers cost; in a minute or two.

    docs/performance.md has the long version.
    """
    from .benchmark.short import errors_and_costs, speeds

    table = RichTable(
        "scene", "dim", "elements", "kernels", "B an element", "float32", "float64",
        title=f"million element-steps/s, {device}, {threads} threads",
    )  # fmt: skip
    for row in speeds(size, device, threads):
        rates = (f"{row.rates[p] / 1e6:.1f}" for p in ("float32", "float64"))
        counts = (row.dim, row.elements, row.kernels, round(row.bytes))
        table.add_row(row.kind, *map(str, counts), *rates)
    console.print(table)
    if cases:
        table = RichTable("case", "line", "knob", "error", "seconds", "million el.-steps/s",
                          title="cases whose answer is known, on one core")  # fmt: skip
        for name, line, knob, point in errors_and_costs():
            rate = "-" if point.steps is None else f"{point.rate / 1e6:.1f}"
            table.add_row(name, line, knob, f"{point.error:.1e}", f"{point.seconds:.3f}", rate)
        console.print(table)


@app.command()
def info() -> None:
    """Versions and devices."""
    machine = describe_machine()
    console.print(f"python {machine['python']} on {machine['system']}")
    for name, number in dict(machine["versions"]).items():  # type: ignore[call-overload]
        console.print(f"{name} {number}")
    for device in list(machine["devices"]):  # type: ignore[call-overload]
        console.print(f"device {device}")


def _print_note(message: Warning | str, *_: object, **__: object) -> None:
    errors.print(f"note: {message}", markup=False)


def _end_with(parent: int) -> None:
    """End a run of a sweep whose process is gone: another may start the same run."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def main() -> None:
    """Run the command line; bad input ends with one sentence and exit status 2."""
    warnings.showwarning = _print_note
    if PARENT in os.environ:
        threading.Thread(target=_end_with, args=(int(os.environ[PARENT]),), daemon=True).start()
    try:
        app()
    except InputError as error:
        errors.print(f"error: {error}", markup=False)
        sys.exit(2)
    except (NonFiniteError, NotConvergedError, TooFastError, TroubledBondError) as error:
        errors.print(f"stopped: {error}", markup=False)
        sys.exit(3)

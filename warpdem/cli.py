"""The command line: `warpdem run NAME`, `warpdem info`."""

import json
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import MISSING, fields
from importlib.metadata import version
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from . import experiments
from .criteria import Criterion
from .errors import InputError, NonFiniteError, NotConvergedError, TroubledBondError
from .experiments import ModeIResult, Result
from .experiments.mode_i import FILES as MODE_I_FILES
from .experiments.rock import FILES as ROCK_FILES
from .experiments.rock import Rig, Rock, RockResult
from .experiments.shared import read_criterion, start_record, write_criterion
from .observe import CrackTracker
from .simulation import PRECISIONS, Observer, Simulation
from .write.claim import claimed
from .write.record import describe_machine
from .write.whole import unit_of, write_text

app = typer.Typer(help="Fracture of solids made of bonded elements.", no_args_is_help=True)
run = typer.Typer(help="Run a published experiment.", no_args_is_help=True)
app.add_typer(run, name="run")
console = Console(highlight=False, soft_wrap=True)
errors = Console(stderr=True, highlight=False, soft_wrap=True)


class Advance:
    """An observer that shows how far a run has come, its rate and the time left.

    what: a word, and `of` what there is in all; done: how much of `total` is done, with the text
    that says so.
    """

    every = 20

    def __init__(self, what: str, of: str, total: float, done: Callable[[], tuple[float, str]]):
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
        completed, shown = self.done()
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
    files: tuple[str, ...],
    progress: Callable[[Any, Any], Observer],
    closing: Callable[[Any], list[str]],
) -> None:
    """Make an experiment a command whose options are the fields of its parameters.

    files: what it writes; progress: makes the observer that shows how far it is, of the parameters
    and of what the experiment hands to `observers`; closing: lines about the result.
    """

    def command(precision: str, device: str, out: Path, **given: Any) -> None:
        console.print(f"warpdem {version('warpdem')}: {title}")
        chosen = parameters(**given | {k: read_criterion(given[k]) for k in written})
        record = start_record(name, chosen, precision, device)
        with claimed(out, record):
            result = function(
                chosen,
                device=device,
                precision=precision,
                out=out,
                observers=lambda _, measured: [progress(chosen, measured)],
                say=console.print,
            )
        for line in closing(result):
            console.print(line)
        console.print(
            f"energy error {result.energy_error:.1e}; broken bonds {result.broken_bonds}; "
            f"{result.element_steps_per_second / 1e6:.1f} million element-steps/s; "
            f"{result.seconds:.0f} s in all"
        )
        console.print(f"written to {out}: {' '.join(files)}")

    hints = get_type_hints(parameters, include_extras=True)
    written: list[str] = []  # criteria, in words
    options = []
    for f in fields(parameters):
        hint, default = hints[f.name], f.default
        if isinstance(default, Criterion):
            written.append(f.name)
            hint, default = Annotated[str, hint.__metadata__[0]], write_criterion(default)
        options.append(_option(f.name, hint, default))
    arithmetic = f"Arithmetic: {', '.join(PRECISIONS)} (places in float64)."
    options += [
        _option("precision", Annotated[str, arithmetic], "float64"),
        _option("device", Annotated[str, "cpu or cuda."], "cpu"),
        _option("out", Annotated[Path, "Folder for the results."], Path("out") / name),
    ]
    command.__signature__ = Signature(options)  # type: ignore[attr-defined]
    command.__annotations__ = {}
    command.__doc__ = (function.__doc__ or "").partition("\n\n")[0]
    run.command(name)(command)


def _option(name: str, hint: Any, default: Any) -> Parameter:
    assert get_origin(hint) is Annotated and default is not MISSING
    kind: Any = hint.__origin__
    option = Annotated[kind, typer.Option(help=hint.__metadata__[0])]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=option)


def _crack_progress(p: experiments.ModeI, crack: CrackTracker) -> Observer:
    scale, unit = unit_of(crack.stop_at)

    def done() -> tuple[float, str]:
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
    MODE_I_FILES,
    _crack_progress,
    _crack_closing,
)


def _load_progress(p: Rock, rig: Rig) -> Observer:
    def done() -> tuple[float, str]:
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
        ROCK_FILES,
        _load_progress,
        _rock_closing,
    )


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


def main() -> None:
    """Run the command line; bad input ends with one sentence and exit status 2."""
    warnings.showwarning = _print_note
    try:
        app()
    except InputError as error:
        errors.print(f"error: {error}", markup=False)
        sys.exit(2)
    except (NonFiniteError, NotConvergedError, TroubledBondError) as error:
        errors.print(f"stopped: {error}", markup=False)
        sys.exit(3)

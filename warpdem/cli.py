"""The command line: `warpdem run NAME`, `warpdem info`."""

import json
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from . import experiments
from .errors import InputError, NonFiniteError, NotConvergedError, TroubledBondError
from .experiments.mode_i import CRITERIA, PACKINGS
from .observe import CrackTracker
from .simulation import PRECISIONS, Observer, Simulation
from .write.record import describe_machine
from .write.whole import unit_of, write_text

app = typer.Typer(help="Fracture of solids made of bonded elements.", no_args_is_help=True)
run = typer.Typer(help="Run a published experiment.", no_args_is_help=True)
app.add_typer(run, name="run")
console = Console(highlight=False, soft_wrap=True)
errors = Console(stderr=True, highlight=False, soft_wrap=True)

DEFAULT = experiments.ModeI()


class CrackProgress:
    """An observer that shows how far the crack has run, the rate and the time left."""

    every = 20

    def __init__(self, crack: CrackTracker, start: float, end: float) -> None:
        self.crack, self.start, self.end = crack, start, end
        self.scale, self.unit = unit_of(end)
        self.told = time.perf_counter()
        self.bar = Progress(
            TextColumn("crack {task.fields[tip]:>5} of " + f"{end * self.scale:.4g} {self.unit}"),
            BarColumn(),
            TextColumn("{task.fields[rate]:.1f} million element-steps/s, left"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self.task = self.bar.add_task("crack", total=end - start, tip="", rate=0.0)
        self.bar.start()

    def observe(self, sim: Simulation) -> None:
        """Move the bar, or print a line where there is no terminal."""
        tip = min(self.crack.tip, self.end) if np.isfinite(self.crack.tip) else self.start
        shown = f"{tip * self.scale:.4g}"
        self.bar.update(self.task, completed=tip - self.start, tip=shown, rate=sim.rate / 1e6)
        if not console.is_terminal and time.perf_counter() - self.told > 5.0:
            self.told = time.perf_counter()
            console.print(
                f"step {sim.steps}: crack {shown} of {self.end * self.scale:.4g} {self.unit}, "
                f"{sim.rate / 1e6:.1f} million element-steps/s"
            )

    def finish(self, sim: Simulation) -> None:
        """Leave the bar as it stands."""
        self.bar.stop()


@run.command("mode-i")
def mode_i(
    length: Annotated[float, typer.Option(help="Length of the plate, m.")] = DEFAULT.length,
    height: Annotated[float, typer.Option(help="Height of the plate, m.")] = DEFAULT.height,
    spacing: Annotated[float, typer.Option(help="Distance of elements, m.")] = DEFAULT.spacing,
    notch: Annotated[float, typer.Option(help="Length of the notch, m.")] = DEFAULT.notch,
    strain: Annotated[float, typer.Option(help="Strain across the crack.")] = DEFAULT.strain,
    young: Annotated[float, typer.Option(help="Young's modulus, Pa.")] = DEFAULT.young,
    poisson: Annotated[float, typer.Option(help="Poisson's ratio.")] = DEFAULT.poisson,
    density: Annotated[float, typer.Option(help="Density, kg/m^3.")] = DEFAULT.density,
    strength: Annotated[
        float, typer.Option(help="Tensile strength of the weak plane at this spacing, Pa.")
    ] = DEFAULT.strength,
    bulk_strength: Annotated[
        float, typer.Option(help="Strength elsewhere over the weak plane's; inf: unbreakable.")
    ] = DEFAULT.bulk_strength,
    criterion: Annotated[
        str, typer.Option(help=f"When a bond breaks: {', '.join(CRITERIA)}.")
    ] = DEFAULT.criterion,
    packing: Annotated[
        str, typer.Option(help=f"Arrangement of elements: {', '.join(PACKINGS)}.")
    ] = DEFAULT.packing,
    refine: Annotated[
        int, typer.Option(help="Divide the spacing by this, at the same toughness.")
    ] = DEFAULT.refine,
    seed: Annotated[int, typer.Option(help="Seed of the Voronoi packing.")] = DEFAULT.seed,
    precision: Annotated[
        str, typer.Option(help=f"Arithmetic: {', '.join(PRECISIONS)} (places in float64).")
    ] = "float64",
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out/mode-i"),
) -> None:
    """A tensile crack along a weak plane of a strained plate: its speed over the Rayleigh speed."""
    console.print(f"warpdem {version('warpdem')}: mode I crack in a strained plate")
    parameters = experiments.ModeI(
        length=length,
        height=height,
        spacing=spacing,
        notch=notch,
        strain=strain,
        young=young,
        poisson=poisson,
        density=density,
        strength=strength,
        bulk_strength=bulk_strength,
        criterion=criterion,
        packing=packing,
        refine=refine,
        seed=seed,
    )

    def progress(_: Simulation, crack: CrackTracker) -> list[Observer]:
        return [CrackProgress(crack, notch, crack.stop_at)]

    result = experiments.mode_i(
        parameters,
        device=device,
        precision=precision,
        out=out,
        observers=progress,
        say=console.print,
    )
    if np.isfinite(result.speed_over_rayleigh):
        console.print(
            f"terminal speed / Rayleigh speed: {result.speed_over_rayleigh:.3f} "
            f"(max - min of its windows {result.speed_spread:.3f}); "
            f"Rayleigh speed {result.rayleigh_speed:.0f} m/s"
        )
    else:
        console.print(
            "the crack did not run far enough for a terminal speed; raise --strain or lower "
            "--strength"
        )
    console.print(
        f"energy error {result.energy_error:.1e}; broken bonds {result.broken_bonds}; "
        f"{result.element_steps_per_second / 1e6:.1f} million element-steps/s; "
        f"{result.seconds:.0f} s in all"
    )
    console.print(f"written to {out}: crack.png crack.usd broken_bonds.csv run.json")


@app.command()
def validate(
    group: Annotated[str | None, typer.Argument(help="Group of cases; all by default.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a list of objects.")] = False,
    slow: Annotated[bool, typer.Option(help="Run the cases that take minutes as well.")] = True,
    write: Annotated[
        Path | None, typer.Option(help="Also write the table as a Markdown file.")
    ] = None,
) -> None:
    """Measure the code against theory; exit status 1 if a limit is missed."""
    from .validation import Check, as_markdown, cases

    checks: list[Check] = []
    for case in cases(group):
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

"""What all experiments share: what they tell, what they measure of a run, what they write."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from math import inf
from pathlib import Path
from typing import Any, ClassVar, TypedDict

import numpy as np

from .. import criteria
from ..checkpoint import Checkpoint
from ..criteria import Criterion
from ..errors import InputError, one_of
from ..packing import Mask
from ..scene import Body, Scene
from ..simulation import Observer, Simulation, resume
from ..write.record import describe_machine
from ..write.whole import folder, write_json

Say = Callable[[str], None]
TURNED = 1.4  # rad: a loose element that rolls on would turn its faces inside out
CHECKPOINT = "checkpoint.npz"  # in the folder of a run, while it is not complete
# makes further observers of a run, of the simulation and what the experiment measures
Observers = Callable[[Simulation, Any], list[Observer]]
Film = Callable[[Path], Observer]


class Options(TypedDict, total=False):
    """What experiments take beside their parameters.

    device, precision, threads: of the simulation; out: folder for the files, None writes nothing;
    observers: makes further observers of the run; say: is told what happens, line by line; frames:
    of the USD scene, about; checkpoint: of the run, which goes on from its file if there is one.
    """

    device: str
    precision: str
    threads: int
    out: str | Path | None
    observers: Observers | None
    say: Say
    frames: int
    checkpoint: Checkpoint | None


def silent(line: str) -> None:
    """Tell nobody."""


def film(name: str, every: int, color: str = "von_mises") -> Film:
    """A USD scene of this name, with a frame every so many steps."""

    def made(where: Path) -> Observer:
        from ..write.usd import UsdWriter

        return UsdWriter(where / name, max(1, every), color)

    return made


class Conduct:
    """An experiment under way: the simulation of its scene, who watches it, what is written.

    Made from `Options`. where: the folder for the files, or None.
    """

    def __init__(
        self,
        *,
        device: str = "cpu",
        precision: str = "float64",
        threads: int = 1,
        out: str | Path | None = None,
        observers: Observers | None = None,
        say: Say = silent,
        frames: int = 24,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self.began = time.perf_counter()
        self.where = None if out is None else folder(out)
        self.say, self.frames = say, frames
        self._observers, self._checkpoint = observers, checkpoint
        self._device, self._precision, self._threads = device, precision, threads

    def build(self, scene: Scene, size: str, local_damping: float = 0.0) -> Simulation:
        """The simulation of a scene, which goes on from the checkpoint's file if there is one;
        tells its size, in words, and its time step."""
        self.say("compiling kernels, once for each kind of scene; later runs take them from disk")
        kept = self._checkpoint
        if kept is not None and kept.path.exists():
            sim = resume(kept.path, scene, device=self._device, threads=self._threads)
        else:
            sim = Simulation(
                scene,
                self._device,
                self._precision,
                local_damping=local_damping,
                threads=self._threads,
            )
        if kept is not None:
            sim.observe(kept)
        self.say(
            f"{sim.model.elements} elements, {sim.model.bonds} bonds on {sim.device} in "
            f"{sim.precision}, {sim.bytes / 1e6:.0f} MB; {size}"
        )
        self.say(
            f"dt {sim.dt:.4g} s, {sim.dt / sim.dt_limit:.2g} of the stability limit "
            f"{sim.dt_limit:.4g} s found by iteration (rigorous bound {sim.dt_bound:.4g} s)"
        )
        return sim

    def foresee(self, sim: Simulation, steps: int, note: str = "") -> None:
        """Tell how long a run of about so many steps will take."""
        told = f"going on at step {sim.steps} of about {steps}"
        if not sim.steps:  # looking at the passes could change what is to go on to the bit
            told = f"about {steps} steps, {steps * sim.seconds_per_step():.0f} s"
        self.say(told + note)

    def watch(
        self, sim: Simulation, measured: Any, own: Iterable[Observer], film: Film | None = None
    ) -> None:
        """Hand over observers: the experiment's own, that of the USD scene, which `film` makes of
        the folder, and further ones, made of the simulation and what is measured."""
        for observer in own:
            sim.observe(observer)
        if film is not None and self.where is not None:
            sim.observe(film(self.where))
        for observer in self._observers(sim, measured) if self._observers else []:
            sim.observe(observer)

    def close(self, name: str, parameters: Any, result: Result) -> None:
        """Note how long it took, and write run.json."""
        result.seconds = time.perf_counter() - self.began
        if self.where is not None:
            write_record(self.where, name, parameters, result)


@dataclass
class Result:
    """What is reported of every run."""

    energy_error: float
    broken_bonds: int
    element_steps_per_second: float
    seconds: float
    steps: int
    elements: int
    bonds: int
    dt: float
    dt_limit: float
    dt_bound: float
    simulation: Simulation = field(repr=False)

    objects: ClassVar[tuple[str, ...]] = ("simulation",)  # that are no numbers

    def numbers(self) -> dict[str, object]:
        """The result without the simulation itself."""
        return {k: v for k, v in vars(self).items() if k not in self.objects}


def run_numbers(sim: Simulation) -> dict[str, Any]:
    """The fields of `Result`, of a run just made."""
    return {
        "energy_error": sim.energy_error,
        "broken_bonds": len(sim.broken_bonds()),
        "element_steps_per_second": sim.rate,
        "seconds": float("nan"),
        "steps": sim.steps,
        "elements": sim.model.elements,
        "bonds": sim.model.bonds,
        "dt": sim.dt,
        "dt_limit": sim.dt_limit,
        "dt_bound": sim.dt_bound,
        "simulation": sim,
    }


def start_record(
    experiment: str, parameters: Any, precision: str, device: str
) -> dict[str, object]:
    """What of run.json is known before a run."""
    given = {f.name: _told(getattr(parameters, f.name)) for f in fields(parameters)}
    return {
        "experiment": experiment,
        "parameters": given | {"precision": precision, "device": device},
    }


def write_record(where: Path, experiment: str, parameters: Any, result: Result) -> None:
    """run.json: all parameters, numbers, energies and versions."""
    sim = result.simulation
    record = {
        "status": "complete",
        **start_record(experiment, parameters, sim.precision, str(sim.device)),
        **result.numbers(),
        "energy": sim.energy(),
        "machine": describe_machine(),
    }
    write_json(where / "run.json", record)


def guard(body: Body, grips: Mask, layers: int) -> None:
    """Make the bonds of gripped elements, and of so many layers beside them, unbreakable.

    Elements at a grip lack faces, so that the stress beside them is uneven by up to a tenth.
    """
    near, bonds = grips.copy(), body.packing.bonds
    for _ in range(layers):
        near[bonds[near[bonds].any(axis=1)]] = True
    body.strength_factor[near[bonds].any(axis=1)] = inf


class Rolling:
    """Ends a run in which a loose element rolls.

    Unlinked pairs touch along the mean of the normals that both carry, which is none where these
    are opposite: beyond half a turn the energy of a contact means nothing.
    """

    every = 20

    def observe(self, sim: Simulation) -> None:
        """Look at the turns."""
        if np.linalg.norm(sim.rotation, axis=1).max() > TURNED:
            sim.stop()

    def finish(self, sim: Simulation) -> None:
        """Nothing is left to do."""


def read_criterion(text: str) -> Criterion:
    """A fracture criterion written as a name and numbers, such as drucker-prager:50e6,5.

    Numbers in the order of the class of that name in `criteria`, or as name=number.
    """
    known = {
        _kebab(name): kind
        for name, kind in vars(criteria).items()
        if isinstance(kind, type) and is_dataclass(kind) and hasattr(kind, "kind")
    }
    name, _, rest = text.partition(":")
    one_of("criterion", name, known)
    wanted = [f.name for f in fields(known[name])]
    try:
        numbers = {}
        for place, part in enumerate(rest.split(",")):
            key, _, value = part.rpartition("=")
            numbers[key or wanted[place]] = float(value)
        return known[name](**numbers)  # type: ignore[return-value]
    except (TypeError, IndexError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"criterion is {text!r}; {name} takes numbers: write "
            f"{name}:{','.join(w + '=...' for w in wanted)}."
        ) from None


def write_criterion(criterion: Criterion) -> str:
    """A criterion as `read_criterion` reads it."""
    numbers = (f"{f.name}={getattr(criterion, f.name):g}" for f in fields(criterion))
    return f"{_kebab(type(criterion).__name__)}:{','.join(numbers)}"


def _kebab(name: str) -> str:
    return "".join("-" + c.lower() if c.isupper() else c for c in name).lstrip("-")


def _told(value: Any) -> Any:
    """A parameter as run.json keeps it: objects by the name of their class."""
    if is_dataclass(value) and not isinstance(value, type):
        return {"class": type(value).__name__, **asdict(value)}
    return value

"""All that a simulation is made of at an instant, to be written and to go on from.

But for what is compared with the scene, nothing here knows the names of arrays or attributes: every
array of the step, and whatever numbers, texts and arrays the step, the list of neighbours, the
checks, the servos and the observers hold, are kept. A new one is kept without anyone remembering.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .archive import previous, read_archive, write_archive
from .errors import DamagedFileError, InputError, positive, whole_number
from .model import state_arrays
from .wall import Shape

if TYPE_CHECKING:
    from .simulation import Observer, Simulation
    from .step import Step

KIND = "warpdem checkpoint"
STATE = "state/"  # before the names of the step's arrays in the file
HISTORIES = ("load_factor", "grip_factor", "box_strain")  # what a scene's functions of time give
SIGNALS = (signal.SIGTERM, signal.SIGINT)


class Checkpoint:
    """Writes a checkpoint every `every` steps, at the end of a run, and when SIGTERM or SIGINT end
    it; `wd.resume(path, scene)` goes on from it.

    path: ends in .npz; the checkpoint before it is kept as NAME.previous.npz. seconds: of wall
    time; if given, one is written no more often than that, and none at the end of a run. Handed to
    a simulation like an observer; it comes after all of them (at the end of a run before they
    finish, so that a run that goes on has them unfinished), and changes no bit of the run.
    """

    def __init__(self, path: str | Path, every: int = 1000, seconds: float | None = None) -> None:
        self.path, self.every = Path(path), whole_number("every", every, 1)
        self.seconds = None if seconds is None else float(positive("seconds", seconds, ()))
        if self.path.suffix != ".npz":
            raise InputError(f"{self.path.name} must end in .npz.")
        if not self.path.parent.is_dir():
            raise InputError(f"there is no folder {self.path.parent}; make it first.")
        self._saved, self._since = -1, 0.0

    def start(self, sim: Simulation) -> None:
        """What a run starts from needs no checkpoint."""
        self._saved, self._since = sim.steps, time.monotonic()

    def observe(self, sim: Simulation) -> None:
        """Write one, if it is time."""
        if self.seconds is None or time.monotonic() - self._since >= self.seconds:
            self.write(sim)

    def finish(self, sim: Simulation) -> None:
        """Write the last one."""
        if self.seconds is None:
            self.write(sim)

    def write(self, sim: Simulation) -> None:
        """Write one, if there is none of this step."""
        if self._saved != sim.steps or not self.path.exists():
            sim._step.synchronise()
            save(sim, self.path)
            self._saved, self._since = sim.steps, time.monotonic()

    def remove(self) -> None:
        """Remove the files, of a run that is complete."""
        for path in (self.path, previous(self.path)):
            path.unlink(missing_ok=True)


@contextmanager
def noted_signals(wanted: bool) -> Iterator[list[int]]:
    """Notes SIGTERM and SIGINT instead of ending the process, while it lasts."""
    noted: list[int] = []
    if not wanted or threading.current_thread() is not threading.main_thread():
        yield noted
        return
    # what ignores them, such as a job in the background, goes on doing so
    heard = [s for s in SIGNALS if signal.getsignal(s) not in (signal.SIG_IGN, None)]
    before = {s: signal.signal(s, lambda number, _: noted.append(number)) for s in heard}
    try:
        yield noted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def save(sim: Simulation, path: Path) -> None:
    """Write a simulation's state; see `Simulation.save`."""
    step, data = sim._step, {}  # type: ignore[var-annotated]
    arrays = {
        STATE + name: array.numpy()
        for name, array in step.arrays.items()
        if name not in step.addresses
    }
    parts = {name: told(part, data) for name, part in _parts(sim).items()}
    if sim._awaited:
        raise InputError(
            "observers of the run that goes on have not been handed over; their records would be "
            "lost. Hand them over before the state is saved."
        )
    observers = [[type(o).__name__, told(o, data)] for o in sim._observers]
    header = {
        "kind": KIND,
        "device": str(sim.device),
        "options": sim.options,
        "steps": sim.steps,
        "time": sim.time,
        "scene": fingerprint(sim),
        "shapes": {name: list(shape) for name, shape in step.arrays.shapes.items()},
        "parts": parts,
        "observers": observers,
    }
    write_archive(path, header, arrays | data)


def read(path: Path) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Header and arrays of a checkpoint; raises DamagedFileError."""
    header, arrays = read_archive(path)
    if header.get("kind") != KIND:
        raise DamagedFileError(f"{path} is whole, but no checkpoint.")
    return header, arrays


def restore(sim: Simulation, header: dict[str, Any], arrays: dict[str, NDArray]) -> None:
    """Bring a simulation just made from the same scene to the state of a checkpoint."""
    _compare(header["scene"], fingerprint(sim))
    renewed = _read(dict(_pairs(header["parts"]["simulation"]))["_renewed"], arrays)
    if renewed:  # its faces are no longer those of the scene
        model = sim._with_faces(**renewed)
        linked = np.ones(model.bonds, dtype=bool)
        sim._adopt(model, state_arrays(model, sim.scene, linked))
    step = sim._step
    parts = _parts(sim)
    saved = {n.removeprefix(STATE): a for n, a in arrays.items() if n.startswith(STATE)}
    if step.neighbours is not None:
        step.neighbours.reserve(saved)
        step._bind_contact()
    missing = sorted(step.arrays.keys() - saved.keys() - set(step.addresses))
    if missing:
        raise InputError(f"the checkpoint lacks {', '.join(missing)}; another warpdem wrote it.")
    for name, value in saved.items():
        step.restore(name, value, tuple(header["shapes"].get(name, value.shape)))
    for name, part in parts.items():
        retell(part, header["parts"][name], arrays)
    if step.neighbours is not None:
        step.neighbours.reshape()
    _check_histories(step, saved)
    records = {name: a for name, a in arrays.items() if not name.startswith(STATE)}
    sim._awaited = [(name, data, records) for name, data in header["observers"]]
    sim._guarded.check(step)


def hand_over(awaited: tuple[str, Any, dict[str, NDArray]], observer: Observer) -> None:
    """Give an observer the records that it had when the checkpoint was written."""
    name, data, arrays = awaited
    if type(observer).__name__ != name:
        raise InputError(
            f"the checkpoint has the records of a {name} here, not of a {type(observer).__name__}; "
            "hand over the observers of the run in the same order."
        )
    retell(observer, data, arrays)


def fingerprint(sim: Simulation) -> dict[str, Any]:
    """What must be the same for a state to belong to a scene, by name."""
    model = sim._first_model
    return {f.name: _described(getattr(model, f.name)) for f in fields(model)}


# -- whatever an object holds ---------------------------------------------------------------------


class _NotPlainError(Exception):
    """Something that cannot be written as numbers and texts."""


def told(owner: object, arrays: dict[str, NDArray]) -> Any:
    """The attributes of an object that are plain data, as JSON and arrays; functions, files and
    the like are left to whoever makes the object anew. So are those named in its `not_saved`.
    Objects in it that are observers, or say so by `has_records`, are told likewise."""
    pairs, left = [], getattr(owner, "not_saved", ())
    for name, value in getattr(owner, "__dict__", {}).items():
        if name in left:
            continue
        before = len(arrays)
        try:
            if _has_records(value):
                pairs.append([name, {"object": told(value, arrays)}])
            else:
                pairs.append([name, _tell(value, arrays)])
        except _NotPlainError:
            for orphan in list(arrays)[before:]:
                del arrays[orphan]
    return {"dict": pairs}


def retell(owner: object, data: Any, arrays: dict[str, NDArray]) -> None:
    """Give an object its attributes back; lists, sets and dictionaries are filled in place, as
    others may hold them."""
    own = getattr(owner, "__dict__", {})
    for name, value in data["dict"]:
        if isinstance(value, dict) and "object" in value:
            if name in own:
                retell(own[name], value["object"], arrays)
            continue
        new, now = _read(value, arrays), own.get(name)
        if isinstance(now, list) and isinstance(new, list):
            now[:] = new
        elif isinstance(now, set | dict) and type(now) is type(new):
            now.clear()
            now.update(new)
        else:
            own[name] = new


def _has_records(value: object) -> bool:
    observes = hasattr(value, "observe") and hasattr(value, "finish") and hasattr(value, "__dict__")
    return observes or getattr(value, "has_records", False) is True


def _tell(value: Any, arrays: dict[str, NDArray]) -> Any:
    """JSON of a value; its arrays go to `arrays`."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return {"array" if isinstance(value, np.ndarray) else "scalar": _put(value, arrays)}
    if isinstance(value, np.random.Generator):
        return {"generator": _tell(value.bit_generator.state, arrays)}
    if type(value) is dict:
        return {"dict": [[_key(k), _tell(v, arrays)] for k, v in value.items()]}
    if type(value) in (set, frozenset):
        return {type(value).__name__: [_tell(x, arrays) for x in sorted(value, key=repr)]}
    if type(value) is tuple:
        return {"tuple": [_tell(x, arrays) for x in value]}
    if type(value) is not list:
        raise _NotPlainError
    if (
        value
        and type(value[0]) is tuple
        and value[0]
        and all(type(x) is tuple and len(x) == len(value[0]) for x in value)
    ):  # rows of a table: column by column, in few arrays
        return {"rows": [_tell(list(c), arrays) for c in zip(*value, strict=True)]}
    first = value[0] if value else None
    if isinstance(first, np.ndarray | np.generic) and all(
        type(x) is type(first) and x.dtype == first.dtype and x.shape == first.shape for x in value
    ):
        kind = "scalars" if isinstance(first, np.generic) else "stack"
        return {kind: _put(np.stack(value), arrays)}
    return {"list": [_tell(x, arrays) for x in value]}


def _put(value: Any, arrays: dict[str, NDArray]) -> str:
    array = np.asarray(value)
    if array.dtype.hasobject or array.dtype.kind in "mMOc":
        raise _NotPlainError
    name = f"data/{len(arrays)}"
    arrays[name] = array
    return name


def _key(value: Any) -> Any:
    if isinstance(value, np.integer):
        return int(value)
    if type(value) not in (str, int):
        raise _NotPlainError
    return value


def _read(data: Any, arrays: dict[str, NDArray]) -> Any:
    if not isinstance(data, dict):
        return data
    ((kind, inner),) = data.items()
    if kind in ("array", "scalar", "stack", "scalars"):
        array = arrays[inner]
        if kind == "array":
            return array
        return array[()] if kind == "scalar" else [x.copy() for x in array]
    if kind == "generator":
        state = _read(inner, arrays)
        bits = getattr(np.random, state["bit_generator"])()
        bits.state = state
        return np.random.Generator(bits)
    if kind == "dict":
        return {k: _read(v, arrays) for k, v in inner}
    items = [_read(x, arrays) for x in inner]
    if kind == "rows":
        return list(zip(*items, strict=True))
    return {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}[kind](items)


# -- within ---------------------------------------------------------------------------------------


def _parts(sim: Simulation) -> dict[str, object]:
    """Objects whose numbers are part of the state."""
    parts: dict[str, object] = {"step": sim._step, "simulation": sim}
    if sim._step.neighbours is not None:
        parts["neighbours"] = sim._step.neighbours
    parts |= {f"trouble {i}": x for i, x in enumerate(sim._troubles)}
    return parts | {f"servo {i}": x for i, x in enumerate(sim.scene.servos)}


def _pairs(data: Any) -> list:
    return data["dict"]


def _described(value: Any) -> Any:
    """A value in few words of JSON, by which two are compared."""
    if isinstance(value, np.ndarray):
        seal = sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return [value.dtype.str, list(value.shape), seal]
    if is_dataclass(value) and not isinstance(value, type):
        return [[f.name, _described(getattr(value, f.name))] for f in fields(value)]
    if isinstance(value, tuple | list):
        return [_described(x) for x in value]
    if isinstance(value, np.generic):
        return _described(value.item())
    if isinstance(value, float):
        return repr(value)
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Shape):
        return [type(value).__qualname__, _described(list(vars(value).items()))]
    source = getattr(getattr(value, "adj", None), "source", None)  # of a function for the device
    return source or getattr(value, "__qualname__", type(value).__qualname__)


def _compare(saved: dict[str, Any], now: dict[str, Any]) -> None:
    differing = sorted(n for n in saved.keys() | now.keys() if saved.get(n) != now.get(n))
    if differing:
        raise InputError(
            f"the checkpoint is of another scene: {', '.join(differing)} differ; build the scene "
            "as it was built for the run."
        )


def _check_histories(step: Step, saved: dict[str, NDArray]) -> None:
    """Functions of time cannot be compared, but what they give now can."""
    step.set_factors()
    for name in HISTORIES:
        if name in saved and step.arrays[name].numpy().tobytes() != saved[name].tobytes():
            raise InputError(
                f"the scene's functions of time ({name}) give other values at this instant than in "
                "the run of the checkpoint; build the scene as it was built for the run."
            )
    for row, pose in enumerate(step.wall_poses(step.count)):
        for name, found in zip(("wall_place", "wall_turn"), pose, strict=True):
            kept = saved[name].reshape(len(step.wall_way), -1)[row]
            if found.tobytes() != kept.tobytes():
                raise InputError(
                    f"wall {row} is elsewhere at this instant than in the run of the checkpoint "
                    "(its path gives other values); build the scene as it was built for the run."
                )

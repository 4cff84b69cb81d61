"""What the command line and sweeps need to know of an experiment: its parameters and results."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from ..criteria import Criterion
from ..errors import InputError, one_of
from ..simulation import PRECISIONS
from .shared import Result, read_criterion, write_criterion


@dataclass(frozen=True)
class Described:
    """A parameter: name, type, default and what it is; `criterion`: one, written in words."""

    name: str
    kind: Any
    default: Any
    help: str
    criterion: bool = False

    @property
    def types(self) -> tuple[type, ...]:
        """The types that its values have."""
        return get_args(self.kind) or (self.kind,)

    def read(self, value: Any) -> Any:
        """A value given as text or as itself; raises InputError if it is of another type."""
        if isinstance(value, Criterion):
            value = write_criterion(value)
        if self.criterion:
            read_criterion(str(value))
            return str(value)
        if value is None and NoneType in self.types:
            return None
        (kind,) = (t for t in self.types if t is not NoneType)
        try:
            if kind is bool:
                return {"true": True, "false": False}[str(value).lower()]
            if kind is int and int(value) != float(value):
                raise ValueError
            return kind(value)
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{self.name} is {value!r}; give {_name(kind)}.") from None

    def split(self, text: str) -> list[Any]:
        """The values of a list written with commas; of criteria, whose numbers have them, with ;"""
        parts = text.split(";" if self.criterion else ",")
        return [self.read(part.strip()) for part in parts]


@dataclass(frozen=True)
class Experiment:
    """An experiment: `function` of an instance of `parameters`, whose `files` it writes."""

    name: str
    title: str
    parameters: type
    function: Callable[..., Result]

    @cached_property
    def described(self) -> dict[str, Described]:
        """Its parameters by name, with arithmetic and device."""
        hints = get_type_hints(self.parameters, include_extras=True)
        found = []
        for f in fields(self.parameters):
            hint, default = hints[f.name], f.default
            assert get_origin(hint) is Annotated and default is not MISSING
            kind, words = hint.__origin__, hint.__metadata__[0]
            if isinstance(default, Criterion):
                found.append(Described(f.name, str, write_criterion(default), words, True))
            else:
                found.append(Described(f.name, kind, default, words))
        arithmetic = f"Arithmetic: {', '.join(PRECISIONS)} (places in float64)."
        found.append(Described("precision", str, "float64", arithmetic))
        found.append(Described("device", str, "cpu", "cpu or cuda."))
        return {d.name: d for d in found}

    @cached_property
    def results(self) -> tuple[str, ...]:
        """Names of the numbers that come out, its own before those of every experiment."""
        kind: type[Result] = get_type_hints(self.function)["return"]
        hints = get_type_hints(kind)
        names = [f.name for f in fields(kind) if hints[f.name] in (int, float)]
        common = {f.name for f in fields(Result)}
        return tuple(sorted(names, key=lambda name: name in common))

    def build(self, given: dict[str, Any]) -> Any:
        """Its parameters from those given; criteria are written in words."""
        known = {f.name for f in fields(self.parameters)}
        return self.parameters(
            **{
                name: read_criterion(value) if self.described[name].criterion else value
                for name, value in given.items()
                if name in known
            }
        )


EXPERIMENTS: dict[str, Experiment] = {}


def find(name: str) -> Experiment:
    """The experiment of a name; raises InputError if there is none."""
    one_of("experiment", name, EXPERIMENTS)
    return EXPERIMENTS[name]


def write_given(given: dict[str, Any]) -> dict[str, str]:
    """Parameters in words, as run.json keeps them for `read_given`."""
    return {name: str(value) for name, value in given.items() if value is not None}


def read_given(where: Path) -> tuple[str, dict[str, Any]]:
    """Experiment and parameters of the run in a folder; raises InputError if it cannot go on."""
    record = where / "run.json"
    try:
        told = json.loads(record.read_text())
        name, words, status = told["experiment"], told.get("given"), told["status"]
    except OSError as error:
        raise InputError(f"cannot read {record}: {error.strerror}; give a run's folder.") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{record} is not as `warpdem run` writes it.") from None
    if status == "complete":
        raise InputError(f"the run in {where} is complete; its results are there.")
    known = find(name).described
    if not isinstance(words, dict) or not words.keys() <= known.keys():
        raise InputError(f"{record} is not as this version of `warpdem run` writes it.")
    return name, {k: d.read(words[k]) if k in words else d.default for k, d in known.items()}


def _name(kind: type) -> str:
    names = {float: "a number", int: "a whole number", bool: "true or false"}
    return names.get(kind, kind.__name__)

"""Checks on what a user hands in. Every refusal is one sentence: what, where, what is allowed."""

from collections.abc import Callable, Iterable
from functools import wraps
from importlib import import_module
from inspect import Parameter, signature
from math import isnan
from operator import index
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])
MOST = 10**9  # elements, steps of a search and the like; more is a slip of the pen


class InputError(ValueError):
    """Input that cannot be simulated; the message names the culprit and what is allowed."""


class ModelWarning(UserWarning):
    """Something a user should know of a scene that can be simulated all the same."""


class NonFiniteError(RuntimeError):
    """The run left the finite numbers; the message names element, step and time step.

    last: displacement, orientation, velocity and angular_velocity at the last look without fault,
    at step `last_step`; empty, -1 if there was none.
    """

    last: dict[str, NDArray] = {}  # noqa: RUF012
    last_step = -1


class UnstableError(NonFiniteError):
    """Numbers are finite still, but motion or energy is more than can be."""


class TroubledBondError(RuntimeError):
    """A bond left the range of its law; the message names it, how far and the step."""


class DamagedFileError(InputError):
    """A file that is not whole, or not what it says it is; the message says what is wrong."""


class UnwritableError(InputError):
    """A file that cannot be written, as on a full disk; the message says what is whole still."""


class NotConvergedError(RuntimeError):
    """A search for rest did not reach its residual; the message says how far it came."""


class TooFastError(RuntimeError):
    """An element would pass through another within a step; the message names it and a time step."""


def first_ids(mask: ArrayLike) -> str:
    """The first five ids at which a mask is set, for a message."""
    ids = np.flatnonzero(np.asarray(mask))
    more = f" and {len(ids) - 5} more" if len(ids) > 5 else ""
    return ", ".join(map(str, ids[:5])) + more


def finite(name: str, value: ArrayLike, shape: tuple[int | None, ...] | None = None) -> Array:
    """`value` as float64 of the given shape (None: any length), every number finite."""
    try:
        a = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers, not {_short(value)}.") from None
    if shape is not None and (
        a.ndim != len(shape)
        or any(want is not None and want != n for want, n in zip(shape, a.shape, strict=True))
    ):
        wanted = tuple("n" if n is None else n for n in shape)
        raise InputError(f"{name} has shape {a.shape}; give shape {wanted}.".replace("'", ""))
    bad = ~np.isfinite(a)
    if bad.any():
        where = f" at {first_ids(_rows(bad))}" if a.ndim else ""
        raise InputError(f"{name} is not finite{where}; give finite numbers.")
    return a


def entries(name: str, value: ArrayLike) -> NDArray:
    """`value` as an array of any kind; rows of unlike lengths are none."""
    try:
        return np.asarray(value)
    except ValueError:
        raise InputError(f"{name} has rows of unlike lengths; give an array.") from None


def positive(name: str, value: ArrayLike, shape: tuple[int | None, ...] | None = None) -> Array:
    """As `finite`, and greater than zero."""
    a = finite(name, value, shape)
    bad = a <= 0.0
    if bad.any():
        where = f" at {first_ids(_rows(bad))}" if a.ndim else f", it is {a:g}"
        raise InputError(f"{name} must be greater than zero{where}.")
    return a


def positive_or_inf(name: str, value: float) -> None:
    """A number greater than zero; infinity is one, NaN is none."""
    if not value > 0.0:
        raise InputError(f"{name} is {value:g}; it must be greater than zero.")


def not_negative(name: str, given: float) -> float:
    """A number that is not negative."""
    value = float(finite(name, given, ()))
    if value < 0.0:
        raise InputError(f"{name} is {value:g}; give 0 or more.")
    return value


def whole_number(name: str, value: object, least: int = 0, most: int = MOST) -> int:
    """A whole number between two."""
    try:
        number = index(value)  # type: ignore[arg-type]
    except TypeError:
        number = least - 1
    if isinstance(value, bool | np.bool_) or not least <= number <= most:
        range_ = f"at least {least}" if number < least else f"{least} to {most}"
        raise InputError(f"{name} is {_short(value)}; give a whole number, {range_}.")
    return number


def first_value(name: str, function: Callable[[float], Any]) -> Any:
    """What a function of time that a user gives is at time 0."""
    try:
        return function(0.0)
    except Exception as error:
        raise InputError(
            f"{name} fails at time 0 with {type(error).__name__}: {error}; give a function of time "
            "in s."
        ) from error


def one_of(name: str, value: object, allowed: Iterable[object]) -> None:
    """Refuse a value that is not among the allowed ones."""
    choices = list(allowed)
    if not any(isinstance(value, type(c)) and value == c for c in choices):
        raise InputError(
            f"{name} is {_short(value)}; choose one of {', '.join(map(repr, choices))}."
        )


def checked(function: Function) -> Function:
    """Refuse arguments that are not of the plain kind which their annotation names.

    Of a function, a method, or a class with its fields: `bool`, `int`, `float` and `str`, each with
    or without None; whole numbers become int, other numbers float, and NaN is none.
    """
    call: Any = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    parameters = signature(call).parameters
    kinds = {p.name: kind for p in parameters.values() if (kind := _kind(p)) is not None}
    names = list(parameters)

    @wraps(call)
    def checking(*args: Any, **given: Any) -> Any:
        plain = list(args)
        for at, value in enumerate(args):
            if at < len(names) and names[at] in kinds:
                plain[at] = _plain(names[at], value, kinds[names[at]])
        for name, value in given.items():
            if name in kinds:
                given[name] = _plain(name, value, kinds[name])
        return call(*plain, **given)

    if isinstance(function, type):
        function.__init__ = checking  # type: ignore[misc]
        return function
    return checking  # type: ignore[return-value]


def _kind(parameter: Parameter) -> set[str] | None:
    """The plain kinds that an annotation allows, None where it allows others."""
    hint = parameter.annotation
    text = hint.__name__ if isinstance(hint, type) else str(hint)
    kinds = set(text.split(" | "))
    plain = kinds <= {"bool", "int", "float", "str", "None"} and kinds != {"None"}
    return kinds if plain and parameter.kind is not Parameter.VAR_KEYWORD else None


def _plain(name: str, value: Any, kinds: set[str]) -> Any:
    if value is None and "None" in kinds:
        return None
    single = getattr(value, "ndim", 0) == 0
    if "bool" in kinds and single and isinstance(value, bool | np.bool_):
        return bool(value)
    if "str" in kinds and isinstance(value, str):
        return value
    if single and not isinstance(value, bool | np.bool_ | str | bytes):
        try:
            if "int" in kinds:
                return index(value)
            if "float" in kinds:
                number = float(value)
                if isnan(number):
                    raise InputError(f"{name} is not finite; give a number.")
                return number
        except InputError:
            raise
        except (TypeError, OverflowError, ValueError):
            pass
    words = {"bool": "True or False", "int": "a whole number", "float": "a number", "str": "a text"}
    allowed = " or ".join(words[k] for k in words if k in kinds)
    raise InputError(f"{name} is {_short(value)}; give {allowed}.")


def _short(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) < 60 else text[:57] + "..."


def library(name: str, extra: str) -> ModuleType:
    """A library that only some users need, or a word on the extra that brings it."""
    try:
        return import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise InputError(
            f'this needs {package}; install it with pip install "warpdem[{extra}]".'
        ) from None


def _rows(bad: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.atleast_1d(bad.reshape(len(bad), -1).any(axis=1))

"""Checks on what a user hands in. Every refusal is one sentence: what, where, what is allowed."""

from collections.abc import Iterable
from importlib import import_module
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


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
        raise InputError(f"{name} must be numbers, not {value!r}.") from None
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


def positive(name: str, value: ArrayLike, shape: tuple[int | None, ...] | None = None) -> Array:
    """As `finite`, and greater than zero."""
    a = finite(name, value, shape)
    bad = a <= 0.0
    if bad.any():
        where = f" at {first_ids(_rows(bad))}" if a.ndim else f", it is {a:g}"
        raise InputError(f"{name} must be greater than zero{where}.")
    return a


def one_of(name: str, value: object, allowed: Iterable[object]) -> None:
    """Refuse a value that is not among the allowed ones."""
    choices = list(allowed)
    if value not in choices:
        raise InputError(f"{name} is {value!r}; choose one of {', '.join(map(repr, choices))}.")


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

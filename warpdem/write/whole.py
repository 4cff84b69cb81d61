"""Files that appear under their final name only when they are whole."""

import csv
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, UnwritableError


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """Yields a temporary name beside `path`, renamed to it at the end, removed on any error.

    Raises UnwritableError where the system does not let it be written.
    """
    final = Path(path)
    part = final.with_name(f".{final.stem}.{os.getpid()}.part{final.suffix}")
    try:
        yield part
        with part.open("rb+") as file:
            os.fsync(file.fileno())  # before its name says that it is whole
        os.replace(part, final)
        sync_folder(final.parent)
    except OSError as error:
        if error.filename not in (None, str(part), str(final)):
            raise  # of another file
        raise UnwritableError(
            f"cannot write {final}: {error.strerror or error}; what was there before is whole. "
            "Free some space, or choose another folder."
        ) from None
    finally:
        part.unlink(missing_ok=True)


def sync_folder(path: Path) -> None:
    """Make renames in a folder last through a loss of power, where the system can."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:  # Windows opens no folders
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def folder(path: str | Path) -> Path:
    """Make a folder for output and make sure that it can be written to.

    Raises InputError if it cannot.
    """
    out = Path(path)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise InputError(
            f"cannot write into the folder {out}: {error.strerror}; choose another one."
        ) from None
    return out


def unit_of(length: float) -> tuple[float, str]:
    """A factor and a unit in which a length [m] is a handy number."""
    for factor, name in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if length * factor >= 0.9:
            return factor, name
    return 1e9, "nm"


def write_text(path: Path, text: str) -> None:
    """A text file."""
    with whole(path) as part:
        part.write_text(text)


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Strict JSON: a number that is not finite is written as null."""
    write_text(path, json.dumps(_plain(data), indent=2, allow_nan=False) + "\n")


def write_csv(path: Path, rows: NDArray[np.void], units: dict[str, str]) -> None:
    """A structured array as CSV, its first line the names with units in brackets."""
    with whole(path) as part, part.open("w", newline="") as file:
        writer = csv.writer(file)
        names = rows.dtype.names or ()
        writer.writerow(f"{n} [{units[n]}]" if n in units else n for n in names)
        writer.writerows(row.tolist() for row in rows)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value

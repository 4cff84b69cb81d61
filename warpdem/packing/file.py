"""Packings in files."""

import os
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .packing import Packing

MARK = "warpdem_packing"  # the name of the format's version
VERSION = 1
NUMBERS = ("thickness", "spacing")
WORDS = ("plane", "arrangement")
FIELDS = [f.name for f in fields(Packing) if f.name not in ("sides", *WORDS, *NUMBERS)]


def save(packing: Packing, path: Path) -> None:
    """Write an NPZ file under another name and rename it when it is whole."""
    values = {name: getattr(packing, name) for name in (*FIELDS, *NUMBERS)}
    arrays: dict[str, Any] = {name: a for name, a in values.items() if a is not None}
    names = list(packing.sides)
    arrays |= {MARK: VERSION, "side_names": np.array(names, "U")}
    arrays |= {name: getattr(packing, name) or "" for name in WORDS}
    arrays["sides"] = np.array([packing.sides[n] for n in names], bool).reshape(-1, len(packing))
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def restored(table: dict[str, NDArray], name: str) -> Packing:
    """The packing of a file's arrays, checked as any input is."""
    version = table.pop(MARK)
    if version.shape != () or version != VERSION:
        raise InputError(f"{name} is a packing of version {version}; this one reads {VERSION}.")
    needed = ("position", "volume", "bonds", "plane", "side_names", "sides", *NUMBERS)
    missing = [key for key in needed if key not in table]
    extra = [key for key in table if key not in (*needed, *FIELDS, *WORDS)]
    if missing or extra:
        raise InputError(
            f"{name} is not a whole packing: it lacks {missing or 'nothing'} and has "
            f"{extra or 'nothing'} besides."
        )
    names, sides = table.pop("side_names"), table.pop("sides")
    if names.ndim != 1 or names.dtype.kind != "U" or sides.shape[:1] != names.shape:
        raise InputError(f"{name}: its sides and their names do not match.")
    plane, arrangement = str(table.pop("plane")), str(table.pop("arrangement", ""))
    numbers: dict[str, Any] = {}
    for key in NUMBERS:
        value = table.pop(key)
        if value.shape != () or value.dtype.kind not in "fiu" or not 0.0 <= value < np.inf:
            raise InputError(f"{name}: {key} must be a number, not negative.")
        numbers[key] = float(value)
    named = dict(zip(map(str, names), sides, strict=True))
    given: dict[str, Any] = table | numbers
    return Packing(**given, plane=plane or None, sides=named, arrangement=arrangement)

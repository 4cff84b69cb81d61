"""A folder for the results of one run at a time, which says how far that run came."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ..errors import InputError
from .whole import folder, write_json


@contextmanager
def claimed(path: str | Path, record: dict[str, Any]) -> Iterator[Path]:
    """A folder that no other process writes results into meanwhile.

    Its run.json holds the record and `status`: "running" from the start, so that it stays after a
    run that was killed; "stopped", and why, after an error; a finished run writes its own.
    After an InputError the folder is as it was. Raises InputError if another run has the folder.
    """
    out = folder(path)
    lock = FileLock(out / ".lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(
            f"another run writes into {out}; wait until it is over, or choose another folder."
        ) from None
    told = out / "run.json"
    before = told.read_bytes() if told.exists() else None
    try:
        write_json(told, {"status": "running", **record})
        yield out
    except InputError:  # nothing was run: all is as it was
        told.unlink()
        if before is not None:
            told.write_bytes(before)
        (out / ".lock").unlink(missing_ok=True)
        raise
    except BaseException as error:
        why = f"{type(error).__name__}: {error}"
        write_json(told, {"status": "stopped", "why": why, **record})
        raise
    finally:
        lock.release()

"""A folder for the results of one run at a time, which says how far that run came."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ..errors import InputError, UnwritableError
from .whole import folder, whole, write_json


@contextmanager
def alone(where: Path, refusal: str) -> Iterator[None]:
    """Holds a folder against other processes, whose InputError begins with `refusal`."""
    lock = FileLock(where / ".lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(
            f"{refusal} {where}; wait until it is over, or choose another folder."
        ) from None
    try:
        yield
    finally:
        lock.release()


@contextmanager
def claimed(path: str | Path, record: dict[str, Any]) -> Iterator[Path]:
    """A folder that no other process writes results into meanwhile.

    Its run.json holds the record and `status`: "running" from the start, so that it stays after a
    run that was killed; "failed" or "interrupted", and the `error`; a complete run writes its own.
    After an InputError the folder is as it was. Raises InputError if another run has the folder.
    """
    out = folder(path)
    with alone(out, "another run writes into"):
        yield from _told(out, record)


def _told(out: Path, record: dict[str, Any]) -> Iterator[Path]:
    told = out / "run.json"
    before = told.read_bytes() if told.exists() else None
    try:
        write_json(told, record | {"status": "running"})
        yield out
    except BaseException as error:
        if isinstance(error, InputError) and not isinstance(error, UnwritableError):
            # nothing was run: all is as it was
            if before is None:
                told.unlink()
            else:
                with whole(told) as part:
                    part.write_bytes(before)
            (out / ".lock").unlink(missing_ok=True)
            raise
        ended = isinstance(error, KeyboardInterrupt | SystemExit)
        why = f"{type(error).__name__}: {error}"
        if ended:
            code = getattr(error, "code", 128 + signal.SIGINT)
            names = {128 + s: s.name for s in signal.Signals}
            why = f"ended by {names[code]}" if code in names else why
        with suppress(UnwritableError):  # where the disk is full, "running" stays
            write_json(
                told, record | {"status": "interrupted" if ended else "failed", "error": why}
            )
        raise

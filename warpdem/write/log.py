"""A log of broken bonds on disk while the run goes on."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, UnwritableError
from .whole import folder

if TYPE_CHECKING:
    from ..simulation import Simulation

UNITS = {"time": "s", "normal_stress": "Pa", "shear_stress": "Pa", "released_energy": "J"}
UNITS |= dict.fromkeys("xyz", "m")


class BreakLog:
    """Appends the bonds that broke to a CSV file every `every` steps, and at the end of a run.

    What `observe` has returned from is on the disk. A new run starts the file anew; a resumed one
    goes on with it: an unfinished line is dropped, lines later than the checkpoint stay, as the
    run on the same device breaks the same bonds. `rows`: bonds written.
    """

    def __init__(self, path: str | Path, every: int = 100) -> None:
        self.path, self.every, self.rows = Path(path), every, -1
        self._file: io.FileIO | None = None
        folder(self.path.parent)

    def observe(self, sim: Simulation) -> None:
        """Append what broke since the last look."""
        log = sim.broken_bonds()
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        try:
            if self._file is None:
                self._file = self._open()
            if self.rows < 0:
                names = log.dtype.names or ()
                writer.writerow(f"{n} [{UNITS[n]}]" if n in UNITS else n for n in names)
            done = max(self.rows, 0)
            writer.writerows(row.tolist() for row in log[done:])
            lines = text.getvalue().encode()
            if lines:
                self._append(lines)
        except OSError as error:
            raise UnwritableError(
                f"cannot write {self.path}: {error.strerror}; its first {max(self.rows, 0)} bonds "
                "are whole. Free some space, or choose another folder."
            ) from None
        self.rows = max(done, len(log))

    def finish(self, sim: Simulation) -> None:
        """Append the rest."""
        self.observe(sim)

    def _append(self, lines: bytes) -> None:
        assert self._file is not None
        start = self._file.seek(0, os.SEEK_END)
        try:
            while lines:
                lines = lines[self._file.write(lines) :]
            os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(start)
            raise

    def _open(self) -> io.FileIO:
        if self.rows < 0:
            return io.FileIO(self.path, "w")
        file = io.FileIO(self.path, "r+")
        whole = file.readall()
        whole = whole[: whole.rfind(b"\n") + 1]
        file.truncate(len(whole))
        found = whole.count(b"\n") - 1
        if found < self.rows:
            file.close()
            raise InputError(
                f"{self.path} has {found} bonds, and had {self.rows} at the checkpoint; put the "
                "file of that run back, or hand over a log of another name."
            )
        self.rows = found
        return file

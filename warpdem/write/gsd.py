"""GSD files of particles, for OVITO and all that reads HOOMD's schema."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, library
from ..fields import in_space
from .frame import SYMMETRIC, element_bodies, element_fields, element_ids, element_widths
from .whole import folder, whole

if TYPE_CHECKING:
    from ..simulation import Simulation


class GsdWriter:
    """Appends a frame every `every` steps; each is in the file, whole, once it is written.

    Particles have position, orientation, velocity, mass, diameter (the packing's spacing), and
    their body as type; bonds are those linked at the time. Per particle there are also `id` (the
    packing's), `stress` [Pa] (xx, yy, zz, xy, yz, xz; tension positive), `mean_stress`,
    `von_mises`, `damage`, `angular_velocity` [rad/s] and, where bodies may flow, `plastic_strain`;
    per frame `time` [s]. SI units, single precision, a plane scene at z = 0. The first frame starts
    the file anew; later and resumed runs go on with it.

    Raises InputError without the extra `gsd`, or if the file cannot be written.
    """

    def __init__(self, path: str | Path, every: int = 100) -> None:
        library("gsd.hoomd", "gsd")
        self.path, self.every = Path(path), every
        if self.path.suffix != ".gsd":
            raise InputError(f"{self.path.name} must end in .gsd.")
        folder(self.path.parent)
        self._frames = 0

    def observe(self, sim: Simulation) -> None:
        """Add a frame."""
        hoomd = library("gsd.hoomd", "gsd")
        if self._frames == 0:
            hoomd.open(self.path, "w").close()
        there = 0
        if self.path.exists():
            with hoomd.open(self.path, "r") as file:
                there = len(file)
        if there < self._frames:
            raise InputError(
                f"{self.path} has {there} of the {self._frames} frames that it had at the "
                "checkpoint; put it back, or hand over a writer of another name."
            )
        if there > self._frames:  # of a run that went on beyond the checkpoint
            self._keep(self._frames)
        with hoomd.open(self.path, "r+") as file:
            file.append(self._frame(sim))
        self._frames += 1

    def finish(self, sim: Simulation) -> None:
        """Everything is in the file already."""

    def _keep(self, frames: int) -> None:
        """Cut the file after a number of frames."""
        hoomd = library("gsd.hoomd", "gsd")
        with (
            whole(self.path) as part,
            hoomd.open(self.path, "r") as file,
            hoomd.open(part, "w") as kept,
        ):
            kept.extend(file[:frames])

    def _frame(self, sim: Simulation) -> Any:
        frame = library("gsd.hoomd", "gsd").Frame()
        place, dim = in_space(sim.position), sim.position.shape[1]
        width, body, stress = element_widths(sim), element_bodies(sim), sim.stress
        frame.configuration.step = sim.steps
        frame.configuration.dimensions = dim
        reach = 2.0 * np.abs(place).max(axis=0) + width.max()
        frame.configuration.box = [*reach[:dim], *[0.0] * (3 - dim), 0.0, 0.0, 0.0]
        p, q = frame.particles, sim.orientation
        p.N, p.types, p.typeid = len(place), [f"body_{b}" for b in np.unique(body)], body
        p.position, p.velocity = place, in_space(sim.velocity)
        p.mass = sim.model.mass[: len(place)]
        p.diameter = width
        turn = np.zeros((len(place), 4))  # real part first; in the plane about z
        turn[:, 0], turn[:, 5 - q.shape[1] :] = q[:, -1], q[:, :-1]
        p.orientation = turn
        linked = sim.bonds[sim.linked]
        frame.bonds.N, frame.bonds.types = len(linked), ["linked"]
        frame.bonds.typeid, frame.bonds.group = np.zeros(len(linked), dtype=int), linked
        fields = element_fields(sim, stress) | {
            "id": element_ids(sim),
            "stress": stress[:, *SYMMETRIC],
            "angular_velocity": sim.angular_velocity,
        }
        del fields["velocity"]
        frame.log = {f"particles/{n}": np.ascontiguousarray(v) for n, v in fields.items()}
        frame.log["time"] = np.array([sim.time])
        return frame

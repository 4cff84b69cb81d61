"""VTK files for ParaView."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, library
from ..fields import in_space
from .frame import SYMMETRIC, element_bodies, element_fields, element_ids, element_widths
from .whole import folder, whole, write_json

if TYPE_CHECKING:
    from ..simulation import Simulation

DIGITS = 6  # of frames' numbers


class VtkWriter:
    """Writes a file of every frame, NAME_000000.vtp and so on, and their times in NAME.vtp.series,
    which ParaView opens; all of them whole at any moment.

    Points are elements with their place, `id`, `body`, `width` (the packing's spacing), `velocity`,
    `stress` [Pa] (a symmetric tensor), `mean_stress`, `von_mises`, `damage` and, where bodies may
    flow, `plastic_strain`; lines are bonds with `linked` (1, or 0 once broken) and `force` [N], on
    the first end. SI units, a plane scene at z = 0. The first frame starts the series anew; later
    and resumed runs go on with it.

    Raises InputError without the extra `vtk`, or if files cannot be written.
    """

    def __init__(self, path: str | Path, every: int = 100) -> None:
        library("vtkmodules", "vtk")
        self.path, self.every = Path(path), every
        if self.path.suffix != ".vtp":
            raise InputError(f"{self.path.name} must end in .vtp.")
        folder(self.path.parent)
        self._times: list[float] = []

    def observe(self, sim: Simulation) -> None:
        """Add a frame."""
        before = (self._name(n) for n in range(len(self._times)))
        missing = [name for name in before if not self.path.with_name(name).exists()]
        if missing:
            raise InputError(
                f"{missing[0]} and maybe more were there at the checkpoint and are gone; put them "
                "back, or hand over a writer of another name."
            )
        writer = library("vtkmodules.vtkIOXML", "vtk").vtkXMLPolyDataWriter()
        name = self._name(len(self._times))
        with whole(self.path.with_name(name)) as part:
            writer.SetFileName(str(part))
            writer.SetInputData(self._surface(sim))
            if not writer.Write():
                raise OSError(f"{name} could not be written; is there room for it?")
        self._times.append(sim.time)
        files = [{"name": self._name(n), "time": t} for n, t in enumerate(self._times)]
        series = self.path.with_name(self.path.name + ".series")
        write_json(series, {"file-series-version": "1.0", "files": files})

    def finish(self, sim: Simulation) -> None:
        """Everything is in files already."""

    def _name(self, frame: int) -> str:
        return f"{self.path.stem}_{frame:0{DIGITS}d}{self.path.suffix}"

    def _surface(self, sim: Simulation) -> object:
        model = library("vtkmodules.vtkCommonDataModel", "vtk")
        core = library("vtkmodules.vtkCommonCore", "vtk")
        as_vtk = library("vtkmodules.util.numpy_support", "vtk").numpy_to_vtk

        def array(value: NDArray) -> Any:
            return as_vtk(np.ascontiguousarray(value), deep=True)

        data, points, lines = model.vtkPolyData(), core.vtkPoints(), model.vtkCellArray()
        points.SetData(array(in_space(sim.position)))
        data.SetPoints(points)
        bonds = sim.bonds
        lines.SetData(array(np.arange(0, bonds.size + 1, 2)), array(bonds.ravel()))
        data.SetLines(lines)
        stress = sim.stress
        fields = element_fields(sim, stress) | {
            "id": element_ids(sim),
            "body": element_bodies(sim),
            "width": element_widths(sim),
            "stress": stress[:, *SYMMETRIC],
        }
        along: dict[str, NDArray] = {
            "linked": sim.linked.astype(np.uint8),
            "force": in_space(sim.bond_force),
        }
        whole_frame = {"TimeValue": np.array([sim.time])}
        told: list[tuple[Any, dict[str, NDArray]]] = [
            (data.GetPointData(), fields),
            (data.GetCellData(), along),
            (data.GetFieldData(), whole_frame),
        ]
        for holder, values in told:
            for name, value in values.items():
                column = array(value)
                column.SetName(name)
                holder.AddArray(column)
        return data

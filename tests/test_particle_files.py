"""Files for OVITO (GSD) and ParaView (VTK), read back by their own libraries."""

import json
import sys

import gsd.hoomd
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

import warpdem as wd
from warpdem.validation import core

SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def breaking(name):
    p = core.small_packing(name)
    scene = wd.Scene()
    body = scene.add(p, wd.Material(1.0, 0.3, 1.0), fracture=wd.Rankine(2e-3))
    scene.set_velocity(body, 0.01 * np.sign(p.position - p.position.mean(axis=0)))
    return wd.Simulation(scene), p


def columns(data):
    return {
        data.GetArrayName(n): vtk_to_numpy(data.GetArray(n))
        for n in range(data.GetNumberOfArrays())
    }


@pytest.fixture(scope="module", params=["voronoi strain", "voronoi space"])
def written(request, tmp_path_factory):
    """A body that breaks, with a frame every 40 steps, and its last state."""
    folder = tmp_path_factory.mktemp("frames")
    sim, packing = breaking(request.param)
    sim.observe(wd.GsdWriter(folder / "body.gsd", every=40))
    sim.observe(wd.VtkWriter(folder / "body.vtp", every=40))
    sim.run(steps=120)
    assert 0 < len(sim.broken_bonds()) < len(packing.bonds)
    return folder, sim, packing


def close(found, expected):
    size = np.abs(expected).max()
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() <= 1e-6 * size


def test_gsd_gives_the_simulation(written):
    folder, sim, p = written
    dim = p.dim
    with gsd.hoomd.open(folder / "body.gsd", "r") as file:
        assert [f.configuration.step for f in file] == [0, 40, 80, 120]
        frame = file[-1]
    assert frame.configuration.dimensions == dim
    assert (2 * np.abs(frame.particles.position).max(axis=0)[:dim]
            < frame.configuration.box[:dim]).all()  # fmt: skip
    close(frame.particles.position[:, :dim], sim.position)
    assert not frame.particles.position[:, dim:].any()
    close(frame.particles.velocity[:, :dim], sim.velocity)
    close(frame.particles.mass, p.volume)  # of density 1
    # w, x, y, z against x, y, z, w or, in the plane, the turn about z
    turn, q = frame.particles.orientation, sim.orientation
    close(turn[:, 0], q[:, -1])
    close(turn[:, 4 - q.shape[1] + 1 :], q[:, :-1])
    assert np.linalg.norm(turn, axis=1) == pytest.approx(1.0, abs=1e-6)
    assert np.array_equal(frame.bonds.group, p.bonds[sim.linked])
    close(frame.log["particles/stress"], np.stack([sim.stress[:, *k] for k in SIX], axis=1))
    close(frame.log["particles/von_mises"], sim.von_mises)
    close(frame.log["particles/damage"], sim.damage)
    assert frame.log["time"] == pytest.approx(sim.time)
    assert "particles/plastic_strain" not in frame.log


def test_vtk_gives_the_simulation(written):
    folder, sim, p = written
    told = json.loads((folder / "body.vtp.series").read_text())["files"]
    assert [f["time"] for f in told] == pytest.approx([n * 40 * sim.dt for n in range(4)])
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(folder / told[-1]["name"]))
    reader.Update()
    data = reader.GetOutput()
    points, lines = columns(data.GetPointData()), columns(data.GetCellData())
    close(vtk_to_numpy(data.GetPoints().GetData())[:, : p.dim], sim.position)
    close(points["stress"], np.stack([sim.stress[:, *k] for k in SIX], axis=1))
    close(points["velocity"][:, : p.dim], sim.velocity)
    assert np.array_equal(points["id"], p.ids)
    ends = vtk_to_numpy(data.GetLines().GetConnectivityArray()).reshape(-1, 2)
    assert np.array_equal(ends, p.bonds)
    assert np.array_equal(lines["linked"].astype(bool), sim.linked)
    close(lines["force"][:, : p.dim], sim.bond_force)


def test_a_gsd_file_is_whole_after_every_frame(tmp_path):
    sim, _ = breaking("voronoi strain")
    path = tmp_path / "body.gsd"

    class Reader:
        every, seen = 40, ()

        def observe(self, sim):
            with gsd.hoomd.open(path, "r") as file:
                self.seen += (len(file),)

        def finish(self, sim):
            pass

    sim.observe(wd.GsdWriter(path, every=40))
    reader = sim.observe(Reader())
    sim.run(steps=80)
    assert reader.seen == (1, 2, 3)
    sim.run(steps=40)
    with gsd.hoomd.open(path, "r") as file:
        assert [f.configuration.step for f in file] == [0, 40, 80, 120]


@pytest.mark.parametrize(("writer", "name"), [("GsdWriter", "gsd"), ("VtkWriter", "vtp")])
def test_resumed_runs_go_on_with_their_files(tmp_path, writer, name):
    path, kept = tmp_path / f"body.{name}", tmp_path / "a.npz"

    def frames():
        if name == "gsd":
            with gsd.hoomd.open(path, "r") as file:
                return [int(f.configuration.step) for f in file]
        told = json.loads(path.with_name(path.name + ".series").read_text())["files"]
        return [round(f["time"] / sim.dt) for f in told]

    sim, _ = breaking("voronoi strain")
    sim.observe(getattr(wd, writer)(path, every=40))
    sim.run(steps=80)
    sim.save(kept)
    sim.run(steps=80)
    assert frames() == [0, 40, 80, 120, 160]
    again = wd.resume(kept, sim.scene)  # the frames beyond the checkpoint are of no run
    again.observe(getattr(wd, writer)(path, every=40))
    again.run(steps=40)
    assert frames() == [0, 40, 80, 120]
    for file in (*tmp_path.glob("body*.vtp"), *tmp_path.glob("*.gsd")):
        file.unlink()
    lost = wd.resume(kept, sim.scene)
    lost.observe(getattr(wd, writer)(path, every=40))
    with pytest.raises(wd.InputError, match="at the checkpoint"):
        lost.run(steps=40)


@pytest.mark.parametrize(("writer", "name"), [("GsdWriter", "gsd"), ("VtkWriter", "vtk")])
def test_what_is_missing_is_told(tmp_path, monkeypatch, writer, name):
    with pytest.raises(wd.InputError, match="must end in"):
        getattr(wd, writer)(tmp_path / "body.usd")
    for module in [m for m in sys.modules if m.split(".")[0] in ("gsd", "vtkmodules")]:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(wd.InputError, match=rf"warpdem\[{name}\]"):
        getattr(wd, writer)(tmp_path / f"body.{name}")

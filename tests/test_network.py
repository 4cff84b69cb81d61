"""Rods, rings, frames, sheets and imported particles."""

from math import pi, sqrt

import numpy as np
import pytest

import warpdem as wd

SECTION = wd.Circle(0.01)


def test_filament_has_equal_bonds_and_the_mass_of_its_rod():
    def parabola(s):
        return [s, s * s]

    rod = wd.packing.filament(parabola, 40, SECTION)
    assert np.ptp(rod.bond_length) < 1e-12
    length = sqrt(5) / 2 + np.arcsinh(2.0) / 4  # of y = x^2 from 0 to 1
    assert rod.bond_length.sum() == pytest.approx(length, rel=1e-3)
    assert rod.volume.sum() == pytest.approx(SECTION.area * rod.bond_length.sum())
    assert rod.position[:, 1] == pytest.approx(rod.position[:, 0] ** 2, abs=1e-6)
    assert rod.side("start").sum() == rod.side("end").sum() == 1


def test_filament_through_points_and_closed():
    angle = np.linspace(0, 2 * pi, 200, endpoint=False)
    loop = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    rod = wd.packing.filament(loop, 60, SECTION, closed=True)
    assert len(rod) == len(rod.bonds) == 60
    assert np.ptp(rod.bond_length) < 1e-10
    assert np.linalg.norm(rod.position, axis=1) == pytest.approx(1.0, abs=1e-3)
    square = wd.packing.filament([[0, 0], [1, 0], [1, 1]], 10, SECTION)
    assert np.ptp(square.bond_length) < 1e-9


def test_rod_inertia_lies_along_the_rod():
    rod = wd.packing.helix(1.0, 0.3, 2, 30, SECTION)
    plain = rod.radius[0] ** 2 * 0.4  # of a sphere
    assert plain == pytest.approx(SECTION.second_moment / SECTION.area)
    rod = wd.packing.filament([[0, 0, 0], [1, 1, 1]], 10, SECTION, rod_inertia=True)
    x, y, z, w = rod.axes.T
    along = np.stack([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)], axis=1)
    assert along == pytest.approx(np.full((11, 3), 1 / sqrt(3)))
    assert rod.gyration[0] ** 2 == pytest.approx(np.array([0.25, 0.25, 0.5]) * 1e-4)


def test_ring_frame_and_sheet():
    ring = wd.packing.ring(2.0, 30, SECTION)
    assert ring.bond_length == pytest.approx(4.0 * np.sin(pi / 30))
    assert ring.pieces == 1 and len(ring.bonds) == 30
    frame = wd.packing.frame([[0, 0], [1, 0], [0, 1]], [[0, 1], [1, 2], [2, 0]], SECTION, 5)
    assert len(frame) == 3 + 3 * 4 and len(frame.bonds) == 15 and frame.pieces == 1
    assert frame.volume.sum() == pytest.approx(SECTION.area * (2 + sqrt(2)))
    sheet = wd.packing.honeycomb((10.0, 9.0), 1.0, 0.5)
    degree = np.bincount(sheet.bonds.ravel())
    assert degree.max() == 3 and sheet.bond_length == pytest.approx(1.0)
    # an inner site has a third of three half rings of area 3 sqrt(3)/2
    assert sheet.volume[0] == pytest.approx(0.5 * 3 * sqrt(3) / 4)
    assert (sheet.left | sheet.right | sheet.top | sheet.bottom).sum() > 10


def test_import_keeps_ids(tmp_path):
    particles, bonds = tmp_path / "p.csv", tmp_path / "b.csv"
    particles.write_text("id,x,y,z,radius\n7,0,0,0,0.5\n3,1,0,0,0.5\n12,2,0,0,0.4\n")
    bonds.write_text("i,j\n7,3\n12,3\n")
    p = wd.packing.load(particles, bonds)
    assert p.ids.tolist() == [7, 3, 12]
    assert p.bonds.tolist() == [[0, 1], [2, 1]]
    assert p.volume[2] == pytest.approx(4 / 3 * pi * 0.4**3)
    np.savez(
        tmp_path / "p.npz", x=[0.0, 1.0], y=[0.0, 0.0], volume=[1.0, 2.0],
        id=[5, 4], bonds=[[5, 4]],
    )  # fmt: skip
    q = wd.packing.load(tmp_path / "p.npz")
    assert q.dim == 2 and q.ids.tolist() == [5, 4] and q.bonds.tolist() == [[0, 1]]
    scene = wd.Scene()
    scene.add(p, wd.Material(1, 0, 1), bond=wd.EVMBond(1.0, 1.0, 1.0, 1.0))
    assert wd.Simulation(scene).model.bonds == 2


@pytest.mark.parametrize(
    ("particles", "bonds", "words"),
    [
        ("id,x,y,radius\n1,0,0,1\n2,1,0,1\n", "i,j\n1,9\n", "no such ids: 9"),
        ("id,x,y,radius\n1,0,0,1\n1,1,0,1\n", "i,j\n1,1\n", "different integers|itself"),
        ("x,y,radius\n0,0,nan\n1,0,1\n", "i,j\n0,1\n", "radius is not finite"),
        ("x,y,radius\n0,0,-1\n1,0,1\n", "i,j\n0,1\n", "radius must be greater"),
        ("x,y\n0,0\n1,0\n", "i,j\n0,1\n", "neither radius nor volume"),
        ("x,y,radius\n0,0,a\n", "i,j\n0,1\n", "not a table of numbers"),
        ("x,y,radius\n0,0,1\n1,0,1\n", "i,j\n0,0.5\n", "whole numbers"),
        ("x,y,radius\n0,0,1\n1,0,1\n", "a,b\n0,1\n", "mean nothing here: a, b"),
        ("x,y,radius\n0,0,1\n1,0,1\n", "i\n0\n1\n", "lacks j"),
        ("ID,x,y,radius\n1,0,0,1\n2,1,0,1\n", "i,j\n1,2\n", "mean nothing here: ID"),
        ("x,y,radius\n", "i,j\n0,1\n", "no rows"),
    ],
)
def test_bad_files_are_refused(tmp_path, particles, bonds, words):
    (tmp_path / "p.csv").write_text(particles)
    (tmp_path / "b.csv").write_text(bonds)
    with pytest.raises(wd.InputError, match=words):
        wd.packing.load(tmp_path / "p.csv", tmp_path / "b.csv")


def test_a_spreadsheets_mark_does_not_hide_the_ids(tmp_path):
    (tmp_path / "p.csv").write_text("id,x,y,radius\n2,0,0,1\n1,1,0,1\n", encoding="utf-8-sig")
    (tmp_path / "b.csv").write_text("i,j\n1,2\n")
    p = wd.packing.load(tmp_path / "p.csv", tmp_path / "b.csv")
    assert p.ids.tolist() == [2, 1] and p.index([1]).tolist() == [1]
    with pytest.raises(wd.InputError, match="no element has the ids"):
        p.index([3])
    with pytest.raises(wd.InputError, match="not a table"):
        wd.packing.load(tmp_path / "missing.csv", tmp_path / "b.csv")


def test_bad_builders_are_refused():
    with pytest.raises(wd.InputError, match="at least 1"):
        wd.packing.filament([[0, 0], [1, 0]], 0, SECTION)
    with pytest.raises(wd.InputError, match=r"outside 0\.\.2"):
        wd.packing.frame([[0, 0], [1, 0], [0, 1]], [[0, 3]], SECTION)
    with pytest.raises(wd.InputError, match="above the sum"):
        wd.packing.network([[0, 0, 0]], [], 1.0, gyration=np.sqrt([[1.0, 1.0, 2.5]]))
    cell = wd.packing.voronoi((10, 10), 1.0, periodic=True)
    with pytest.raises(wd.InputError, match="periodic"):
        wd.Scene().add(cell, wd.Material(1, 0, 1), bond=wd.EVMBond(1.0, 1.0, 1.0))


def test_periodic_cells_close():
    for size in ((12.0, 10.0), (5.0, 5.0, 5.0)):
        cell = wd.packing.voronoi(size, 1.0, periodic=True, relaxations=3)
        assert cell.volume.sum() == pytest.approx(np.prod(size))
        assert np.abs(cell.exposed_area).max() < 1e-12  # sum S n = 0 for every cell

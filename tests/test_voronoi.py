import sys
from dataclasses import fields
from math import pi

import numpy as np
import pytest

import warpdem as wd
from warpdem.packing import (
    Box,
    Cylinder,
    Disc,
    Mesh,
    Packing,
    Plate,
    Polygon,
    Ring,
    Sphere,
    laguerre,
    polydisperse,
    voronoi,
)

CUBE = np.indices((2, 2, 2)).reshape(3, -1).T * 6.0
FACES = [
    *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
    *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
]
NOTCHED = [[0, 0], [9, 0], [9, 9], [6.5, 9], [4.5, 4], [2.5, 9], [0, 9]]
SHAPES = {
    "box": (Box((9.0, 8.0), (-1.0, 2.0)), 72.0, {"left", "right", "bottom", "top"}),
    "disc": (Disc(5.0, (1.0, 2.0)), 25 * pi, {"outer"}),
    "ring": (Ring(3.0, 6.0), 27 * pi, {"outer", "inner"}),
    "polygon": (Polygon(NOTCHED), 71.0, {"outer"}),
    "plate": (
        Plate((12.0, 8.0), [Disc(2.0, (3.0, 4.0)), [[8, 3], [8, 5], [10, 4]]]),
        94 - 4 * pi,
        {"left", "right", "bottom", "top", "hole 0", "hole 1", "hole"},
    ),
    "block": (Box((4.0, 3.0, 3.0)), 36.0, {"left", "right", "bottom", "top", "back", "front"}),
    "sphere": (Sphere(2.5, (1.0, 0.0, 0.0)), 4 / 3 * pi * 2.5**3, {"outer"}),
    "cylinder": (Cylinder(2.0, 4.0), 16 * pi, {"bottom", "top", "side"}),
    "mesh": (Mesh(CUBE / 1.5, FACES), 64.0, {"outer"}),
}


def moment(p: Packing) -> np.ndarray:
    """sum S c (x) n of every element."""
    n = p.bond_vector / p.bond_length[:, None]
    total = np.zeros((len(p), p.dim, p.dim))
    for side in (0, 1):
        sn = (1 - 2 * side) * p.area[:, None] * n
        np.add.at(total, p.bonds[:, side], p.arms[:, side, :, None] * sn[:, None, :])
    return total


@pytest.mark.parametrize("name", SHAPES)
def test_cells_fill_the_shape(name):
    shape, volume, sides = SHAPES[name]
    p = voronoi(shape, 1.0, seed=3, relaxations=4)
    assert p.volume.sum() == pytest.approx(volume, rel=1e-12)
    assert set(p.sides) == sides
    inner = ~p.boundary()
    assert all(mask.any() for mask in p.sides.values())
    unit = p.volume[:, None, None] * np.eye(p.dim)
    assert np.abs(moment(p) - unit)[inner].max(initial=0.0) < 1e-12
    assert np.abs(p.exposed_area[inner]).max(initial=0.0) < 1e-12
    assert (np.linalg.norm(p.exposed_area[~inner], axis=1) > 1e-6).all()
    assert p.volume.min() > 0.3 * p.volume.mean()
    again = voronoi(shape, 1.0, seed=3, relaxations=4)
    assert np.array_equal(p.position, again.position) and np.array_equal(p.area, again.area)


def test_free_surface_is_that_of_the_shape():
    p = voronoi(Cylinder(2.0, 4.0), 1.0, relaxations=3)
    end = p.exposed_area[p.side("top")].sum(axis=0)
    assert end[2] == pytest.approx(4 * pi, rel=1e-12)
    p = voronoi(Plate((9.0, 7.0), [Disc(2.0, (4.5, 3.5))]), 0.7, thickness=0.5, relaxations=3)
    rim = p.exposed_area[p.side("hole")]
    toward = np.array([4.5, 3.5]) - p.position[p.side("hole")]
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    # out of the body is into the hole, and chords are a little shorter than the rim
    assert (rim * toward).sum() == pytest.approx(4 * pi * 0.5, rel=0.03)


def test_seeds_differ_and_repeat():
    a, b, c = (voronoi((8.0, 8.0), 1.0, seed=s) for s in (1, 1, 2))
    assert np.array_equal(a.position, b.position)
    assert not np.array_equal(a.position, c.position)


@pytest.mark.parametrize(
    ("size", "lattice"),
    [((20.0, 20.0), wd.packing.hexagonal), ((7.0, 7.0, 7.0), wd.packing.fcc)],
)
def test_time_step_is_close_to_that_of_a_lattice(size, lattice):
    def limit(p: Packing) -> float:
        scene = wd.Scene()
        scene.add(p, wd.Material(young=1.0, poisson=0.3, density=1.0), bond="facet")
        return wd.Simulation(scene).dt_limit

    assert limit(voronoi(size, 1.0)) > 0.9 * limit(lattice(size, 1.0))


def test_grading():
    def local(x):
        return 0.3 + 0.1 * np.hypot(*x.T)

    p = voronoi(Disc(6.0), local)
    size = np.sqrt(p.volume * 2 / np.sqrt(3)) / local(p.position)
    assert size.mean() == pytest.approx(1.0, abs=0.03)
    assert size.std() < 0.08


def test_periodic_cells_have_no_boundary():
    p = voronoi(Box((9.0, 8.0)), 1.0, periodic=True)
    assert not p.boundary().any()
    assert np.abs(moment(p) - p.volume[:, None, None] * np.eye(2)).max() < 1e-12


def test_cells_between_the_legs_of_a_slit_are_parted():
    slit = Polygon([[0, 0], [9, 0], [9, 9], [4.7, 9], [4.7, 4], [4.3, 4], [4.3, 9], [0, 9]])
    p = voronoi(slit, 1.0, seed=1)
    assert p.volume.sum() == pytest.approx(79.0)
    assert not len(p.crossing((4.5, 4.05), (4.5, 9.0)))


def test_radical_faces_pass_where_spheres_touch():
    x = [[1.0, 2.0], [4.0, 2.0], [1.0, 5.5], [4.0, 5.5]]
    p = laguerre((5.5, 7.0), x, [1.0, 2.0, 1.0, 2.0])
    (face,) = np.flatnonzero((p.bonds == [0, 1]).all(axis=1))
    assert p.arms[face, 0, 0] == pytest.approx(1.0) and p.arms[face, 1, 0] == pytest.approx(-2.0)
    assert p.volume.sum() == pytest.approx(38.5)
    equal = laguerre((5.5, 7.0), x, 4 * [1.0])
    assert equal.arms[face, 0, 0] == pytest.approx(1.5)


@pytest.mark.parametrize("shape", [(12.0, 10.0), Disc(6.0), (4.0, 4.0, 4.0), Sphere(2.5)])
def test_polydisperse_cells(shape):
    radius = np.random.default_rng(0).uniform(0.6, 1.4, 120)
    p = polydisperse(shape, radius)
    inner = ~p.boundary()
    assert np.abs(moment(p) - p.volume[:, None, None] * np.eye(p.dim))[inner].max() < 1e-12
    assert np.corrcoef(p.volume, radius**p.dim)[0, 1] > 0.9


def test_spheres_that_make_bad_cells_are_refused():
    x = [[1.0, 1.0], [1.5, 3.0], [4.0, 1.0], [4.0, 4.0], [1.0, 4.5]]
    with pytest.raises(wd.InputError, match=r"centres 1 lie outside their cells.*\(1.5, 3\)"):
        laguerre((5.0, 5.0), x, [0.5, 0.5, 0.5, 0.5, 1.7])
    with pytest.raises(wd.InputError, match=r"centres 1 have no cell.*\(1.5, 3\)"):
        laguerre((5.0, 5.0), x, [0.5, 0.1, 0.5, 0.5, 3.5])
    with pytest.raises(wd.InputError, match="spheres 0 have their centres outside"):
        laguerre(Disc(2.7), np.array(x) - 3.0, 0.5 * np.ones(5))


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        (Polygon([[0, 0], [5, 5], [5, 0], [0, 5]]), r"Self-intersection\[2.5 2.5\]"),
        (Plate((9.0, 9.0), [Disc(2.0, (1.0, 4.0))]), "crosses or touches itself"),
        (Mesh(CUBE, FACES[:-1]), r"3 edges .* from \(0, 0, 6\) m to"),
        (Mesh(CUBE, [*FACES, [0, 1, 2]]), "not closed, manifold"),
        (Mesh(CUBE, [*FACES[:-1], FACES[-1][::-1]]), "not closed, manifold"),
        (Mesh(CUBE, [*FACES[:-1], [1, 7, 8]]), r"triangles 11 name vertices outside 0\.\.7"),
        (Polygon([[0, 0], [5, 5]]), "at least 3"),
        ("round", "is no shape"),
    ],
)
def test_bad_shapes_are_refused(shape, says):
    with pytest.raises(wd.InputError, match=says):
        voronoi(shape, 1.0)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Box((1.0,)), "two for the plane"),
        (lambda: Ring(2.0, 1.0), "must exceed"),
        (lambda: Sphere(-1.0), "radius must be greater"),
        (lambda: voronoi(Disc(3.0), 1.0, periodic=True), "only boxes are periodic"),
        (lambda: voronoi(Disc(3.0), lambda x: x[:, 0]), "spacing must be greater than zero"),
        (lambda: voronoi(Sphere(1.0), 3.0), "too few elements"),
    ],
)
def test_bad_arguments_are_refused(make, says):
    with pytest.raises(wd.InputError, match=says):
        make()


def test_mesh_that_overlaps_itself_is_refused():
    through = Mesh(np.concatenate([CUBE, CUBE + 2.0]), [*FACES, *(np.array(FACES) + 8)])
    with pytest.raises(wd.InputError, match="passes through itself"):
        voronoi(through, 1.5)


def test_body_in_pieces_is_told():
    apart = np.concatenate([CUBE, CUBE + np.array([7.0, 0.0, 0.0])])
    with pytest.warns(wd.ModelWarning, match="2 pieces of elements: .* with element"):
        voronoi(Mesh(apart, [*FACES, *(np.array(FACES) + 8)]), 1.5, relaxations=2)


def test_stl_is_read(tmp_path):
    corners = CUBE[np.array(FACES)]
    text = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in corners
    )
    (tmp_path / "a.stl").write_text(f"solid cube\n{text}endsolid\n")
    row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(corners), row)
    rows["corners"] = corners
    (tmp_path / "b.stl").write_bytes(bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes())
    for name in ("a.stl", "b.stl"):
        p = voronoi(Mesh.from_file(tmp_path / name), 2.0, relaxations=1)
        assert p.volume.sum() == pytest.approx(216.0)
    (tmp_path / "c.stl").write_text("solid nothing\n")
    with pytest.raises(wd.InputError, match="not an STL file"):
        Mesh.from_file(tmp_path / "c.stl")


def test_progress_is_told():
    lines: list[str] = []
    voronoi((9.0, 9.0), 1.0, relaxations=3, tell=lines.append)
    assert len(lines) == 3 and lines[2].startswith("sweep 3 of 3: 94 cells")


@pytest.mark.parametrize(
    "make",
    [
        lambda: voronoi(Ring(2.0, 5.0), 1.0, thickness=0.1, plane="stress"),
        lambda: voronoi((5.0, 5.0, 5.0), 1.0, periodic=True),
        lambda: wd.packing.network(
            np.eye(3),
            [[7, 5], [5, 9]],
            [1.0, 2.0, 3.0],
            ids=[5, 7, 9],
            gyration=np.full((3, 3), 0.3),
        ),
    ],
)
def test_a_saved_packing_comes_back_equal(tmp_path, make):
    p = make()
    p.save(tmp_path / "p.npz")
    q = wd.packing.load(tmp_path / "p.npz")
    for f in fields(Packing):
        a, b = getattr(p, f.name), getattr(q, f.name)
        if f.name == "sides":
            assert a.keys() == b.keys()
            assert all(np.array_equal(a[name], b[name]) for name in a)
        elif isinstance(a, np.ndarray):
            assert np.array_equal(a, b) and a.dtype == b.dtype
        else:
            assert a == b
    assert [path.name for path in tmp_path.iterdir()] == ["p.npz"]


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "p.npz"
    voronoi((6.0, 6.0), 1.0).save(path)
    whole = dict(np.load(path))

    def refused(says: str, **change: object) -> None:
        np.savez(path, **{k: v for k, v in (whole | change).items() if v is not None})
        with pytest.raises(wd.InputError, match=says):
            wd.packing.load(path)

    refused("version 9", warpdem_packing=9)
    refused("lacks .*volume", volume=None)
    refused("has .*more", more=1)
    refused("do not enclose", volume=0.5 * whole["volume"])
    refused("not finite", position=np.full_like(whole["position"], np.nan))
    refused("must be a mask", sides=whole["sides"][:, :-1])
    refused("names do not match", sides=whole["sides"][:-1])
    refused("thickness must be", thickness=np.nan)
    refused("not an NPZ file of plain arrays", plane=np.array({}, dtype=object))
    path.write_bytes(b"PK\3\4 torn")
    with pytest.raises(wd.InputError, match="not an NPZ file"):
        wd.packing.load(path)


@pytest.mark.parametrize(("shape", "name"), [(Disc(3.0), "shapely"), (Sphere(3.0), "manifold3d")])
def test_missing_library_is_named(monkeypatch, shape, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(wd.InputError, match=f"needs {name}; install it with .*geometry"):
        voronoi(shape, 1.0)

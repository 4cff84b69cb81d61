import resource
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import warpdem as wd
from warpdem import room


@pytest.mark.parametrize(
    ("shape", "cell"),
    [
        (wd.packing.hexagonal((10, 9), 1.0, thickness=0.1), np.sqrt(3) / 2 * 0.1),
        (wd.packing.fcc((6, 6, 6), 1.0), 1 / np.sqrt(2)),
    ],
)
def test_lattice_cells(shape, cell):
    assert shape.volume == pytest.approx(np.full(len(shape), cell))
    assert shape.bond_length == pytest.approx(np.ones(len(shape.bonds)))
    inner = ~shape.boundary()
    neighbours = np.bincount(shape.bonds.ravel(), minlength=len(shape))
    assert set(neighbours[inner]) == {6 if shape.dim == 2 else 12}
    assert np.abs(shape.exposed_area[inner]).max() < 1e-12


@pytest.mark.parametrize("size", [(12.0, 9.0), (5.0, 4.0, 4.0)])
def test_voronoi_fills_the_box(size):
    p = wd.packing.voronoi(size, 1.0, seed=3, relaxations=3, thickness=0.5)
    filled = np.prod(size) * (0.5 if p.dim == 2 else 1.0)
    assert p.volume.sum() == pytest.approx(filled, rel=1e-12)
    # the free surface of the whole is the box's
    top = p.exposed_area[p.side("top")].sum(axis=0)[1]
    assert top == pytest.approx(filled / size[1], rel=0.1)
    again = wd.packing.voronoi(size, 1.0, seed=3, relaxations=3, thickness=0.5)
    assert np.array_equal(p.position, again.position)


def test_divergence_theorem_on_random_cells():
    for size in ((9.0, 9.0), (5.0, 5.0, 5.0)):
        p = wd.packing.voronoi(size, 1.0, seed=1, relaxations=0)
        inner = ~p.boundary()
        n = p.bond_vector / p.bond_length[:, None]
        total = np.zeros(len(p))
        for side, sign in ((0, 1.0), (1, -1.0)):
            np.add.at(total, p.bonds[:, side], sign * p.area * (p.arms[:, side] * n).sum(axis=1))
        assert total[inner] == pytest.approx(p.dim * p.volume[inner], rel=1e-10)


def test_relaxation_rounds_the_cells():
    raw = wd.packing.voronoi((12.0, 12.0), 1.0, relaxations=0)
    relaxed = wd.packing.voronoi((12.0, 12.0), 1.0)
    assert relaxed.bond_length.min() > 2.0 * raw.bond_length.min()


def test_crossing_in_the_plane():
    p = wd.packing.hexagonal((10, 9), 1.0)
    pitch = np.sqrt(3) / 2
    all_across = p.crossing((-1, 5 * pitch), (11, 5 * pitch))
    rows = np.round(p.position[p.bonds][..., 1] / pitch - 0.5).astype(int)
    assert set(all_across) == set(np.flatnonzero(np.sort(rows, axis=1)[:, 0] + 1 == (
        np.sort(rows, axis=1)[:, 1])) ) & set(np.flatnonzero(rows.min(axis=1) == 4))  # fmt: skip
    some = p.crossing((-1, 5 * pitch), (5, 5 * pitch))
    assert set(some) < set(all_across)
    middle = p.position[p.bonds[some]].mean(axis=1)
    assert middle[:, 0].max() <= 5 + 1e-9


def test_crossing_in_space():
    p = wd.packing.fcc((5, 5, 5), 1.0)
    ids = p.crossing((-1, 2.0, 0), (6, 2.0, 0))
    y = p.position[p.bonds[ids]][..., 1]
    assert ((y.min(axis=1) < 2.0) & (y.max(axis=1) >= 2.0)).all()
    across = (p.position[p.bonds][..., 1] < 2.0 - 1e-9).sum(axis=1) == 1
    assert len(ids) == across.sum()
    assert len(p.crossing((-1, 2.0, 0), (6, 2.0, 0), depth=(0, 0, 2.5))) < len(ids)


@pytest.mark.parametrize(
    "make",
    [
        lambda: wd.packing.fcc((7.0, 7.0, 3.0), 1.0, periodic="z"),
        lambda: wd.packing.voronoi((7.0, 7.0, 4.0), 1.0, periodic="z", relaxations=3),
    ],
)
def test_slabs_that_repeat_across_their_thickness(make):
    """Cells are closed but at the four other sides, and fill the box; a uniform strain whose part
    across the thickness is kept by the box leaves the inside without net force."""
    p = make()
    assert set(p.sides) == {"left", "right", "bottom", "top"}
    assert np.isinf(p.period[:2]).all()
    box = (7.0, 7.0, p.period[2])
    inner = ~p.boundary()
    assert inner.sum() > 10
    assert np.abs(p.exposed_area[inner]).max() < 1e-12
    assert np.abs(p.exposed_area[:, 2]).max() < 1e-12
    if p.arrangement == "voronoi":
        assert p.volume.sum() == pytest.approx(np.prod(box))
    scene = wd.Scene()
    body = scene.add(p, wd.Material(1.0, 0.3, 1.0))
    scene.strain(body, np.diag([1e-6, 3e-6, -2e-6]))
    sim = wd.Simulation(scene)
    deep = ~p.boundary(2)
    assert deep.any()
    assert np.abs(sim.force[deep]).max() < 1e-9 * np.abs(sim.bond_force).max()
    exact = 1.0 / 1.3 * np.diag([1e-6, 3e-6, -2e-6]) + 0.3 / (1.3 * 0.4) * 2e-6 * np.eye(3)
    assert np.abs(sim.stress[deep] - exact).max() < 1e-4 * exact.max()


def test_what_cannot_repeat_along_some_axes_is_refused():
    with pytest.raises(wd.InputError, match="some of 'xyz'"):
        wd.packing.fcc((4.0, 4.0, 4.0), 1.0, periodic="w")
    slab = wd.packing.fcc((4.0, 4.0, 2.9), 1.0, periodic="z")
    scene = wd.Scene()
    scene.add(slab, wd.Material(1.0, 0.3, 1.0))
    scene.contact()
    with pytest.raises(wd.InputError, match="repeat along some axes alone"):
        wd.Simulation(scene)
    with pytest.raises(wd.InputError, match="leave it out"):
        replace(slab, period=np.full(3, np.inf))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"position": [[0, 0], [np.nan, 0], [2, 0]]}, "not finite at 1"),
        ({"position": [[0, 0], [1, 0], [0, 0]]}, "elements 2 lie on the same place"),
        ({"bonds": [[0, 1], [1, 1]]}, "bonds 1 join an element to itself"),
        ({"bonds": [[0, 1], [1, 0]]}, "bonds 1 join pairs that earlier bonds join"),
        ({"bonds": [[0, 1], [1, 3]]}, "bonds 1 name elements outside 0..2"),
        ({"bonds": [[0.5, 1]]}, "integers"),
        ({"bonds": [[0], [1, 2]]}, "bonds has rows of unlike lengths"),
        ({"volume": [1, 0, 1]}, "volume must be greater than zero at 1"),
        ({"radius": -1.0}, "radius must be greater than zero at 0, 1, 2"),
        ({"plane": "strian"}, "'strain', 'stress'"),
    ],
)
def test_bad_networks_are_refused(change, says):
    given = {
        "position": [[0, 0], [1, 0], [2, 0]], "bonds": [[0, 1], [1, 2]], "volume": 1.0,
        "plane": "strain",
    }  # fmt: skip
    with pytest.raises(wd.InputError, match=says):
        wd.packing.network(**(given | change))


def test_faces_that_do_not_close_are_refused():
    p = wd.packing.hexagonal((6, 6), 1.0)
    wrong = np.array(p.volume)
    inner = np.flatnonzero(~p.boundary())[0]
    wrong[inner] *= 1.01
    with pytest.raises(wd.InputError, match=f"faces of elements {inner} do not enclose"):
        wd.Packing(p.position, wrong, p.bonds, p.area, p.arms, plane="strain")


@pytest.mark.parametrize(
    "make",
    [
        lambda p: p.voronoi((4.0, 3.0), 1e-300),
        lambda p: p.hexagonal((1.0, 1.0), 1e-6),
        lambda p: p.fcc((1e300, 3.0, 3.0), 1e-300),
        lambda p: p.fcc((1e300, 3.0, 3.0), 1e-300, periodic=True),
        lambda p: p.honeycomb((1e300, 3.0), 1e-300, 1.0),
        lambda p: p.filament([[0.0, 0.0], [1.0, 0.0]], 10**9, wd.Circle(0.1)),
        lambda p: p.helix(1.0, 1.0, 1e7, 50, wd.Circle(0.1)),
        lambda p: p.ring(1.0, 10**9, wd.Circle(0.1)),
        lambda p: p.frame([[0.0, 0.0], [1.0, 0.0]], [[0, 1]], wd.Circle(0.1), 10**9),
    ],
)
def test_bodies_without_room_are_refused_before_they_are_made(make, monkeypatch):
    monkeypatch.setattr(room, "host_memory", lambda: 10**9)
    with pytest.raises(wd.InputError, match=r"at most 2\.0e\+06 fit into the memory"):
        make(wd.packing)


def test_room_is_what_a_limit_on_the_process_leaves(monkeypatch):
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most = used + 10**8
    monkeypatch.setattr(resource, "getrlimit", lambda _: (most, most))
    assert 0 < room.host_memory() < 2 * 10**8
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1, 1))
    assert room.host_memory() == 0


@pytest.mark.parametrize("periodic", [2.5, None, "", "xw", object()])
def test_what_names_no_axes_is_refused(periodic):
    for make, size in ((wd.packing.fcc, (3.0,) * 3), (wd.packing.voronoi, (3.0, 3.0))):
        with pytest.raises(wd.InputError, match=r"periodic is .*; give True"):
            make(size, 1.0, periodic=periodic)


@pytest.mark.parametrize("make", [wd.packing.hexagonal, wd.packing.voronoi])
def test_bad_boxes_are_refused(make):
    with pytest.raises(wd.InputError, match="spacing must be greater than zero"):
        make((1.0, 1.0), 0.0)
    with pytest.raises(wd.InputError, match="enlarge"):
        make((1.0, 1.0), 10.0)


def test_a_volume_that_its_faces_overfill_is_told():
    p = wd.packing.voronoi((8, 8), 1.0)
    corner = int(np.argmin(p.position.sum(axis=1)))
    volume = p.volume.copy()
    volume[corner] *= 0.1
    with pytest.warns(wd.ModelWarning, match=rf"faces of elements {corner} enclose more"):
        replace(p, volume=volume)
    volume = p.volume.copy()
    inner = int(np.flatnonzero(~p.boundary())[0])
    volume[inner] *= 0.9
    with pytest.raises(wd.InputError, match=rf"faces of elements {inner} do not enclose"):
        replace(p, volume=volume)

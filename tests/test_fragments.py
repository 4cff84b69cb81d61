"""Pieces of broken bodies."""

import csv

import numpy as np
import pytest

import warpdem as wd

SOFT = wd.Material(1.0, 0.3, 2.0)


def two_pieces(packing, spins):
    """A body cut in two along y = 3, each piece in a rigid motion of its own."""
    scene = wd.Scene()
    body = scene.add(packing, SOFT, fracture=wd.Rankine(1e3))
    low, high = [-1.0] * packing.dim, [10.0] * packing.dim
    low[1] = high[1] = 3.0
    scene.cut(body, low, high)
    x, mass = packing.position, packing.volume * SOFT.density
    upper = x[:, 1] > 3.0
    velocity = np.zeros_like(x)
    for piece, spin, speed in ((upper, spins[0], 0.3), (~upper, spins[1], -0.1)):
        centre = np.average(x[piece], axis=0, weights=mass[piece])
        arm = np.pad(x[piece] - centre, ((0, 0), (0, 3 - packing.dim)))
        turning = np.cross(np.pad(spin, (3 - len(spin), 0)), arm)[:, : packing.dim]
        velocity[piece] = turning + speed * np.eye(packing.dim)[1]
        scene.set_velocity(body, velocity[piece], spin, where=np.flatnonzero(piece))
    return wd.Simulation(scene), mass, upper


@pytest.mark.parametrize("dim", [2, 3])
def test_pieces_of_a_cut_body(dim):
    if dim == 2:
        p, spins = wd.packing.voronoi((5.0, 7.0), 1.0, seed=2), ([0.02], [-0.05])
    else:
        p = wd.packing.voronoi((4.0, 7.0, 4.0), 1.0, seed=2)
        spins = ([0.02, -0.01, 0.03], [-0.05, 0.02, 0.01])
    sim, mass, upper = two_pieces(p, spins)
    found = wd.fragments(sim)
    assert len(found) == 2
    order = np.argsort([-mass[upper].sum(), -mass[~upper].sum()])
    for piece, k in zip(found, order, strict=True):
        members = (upper, ~upper)[k]
        assert piece["mass"] == pytest.approx(mass[members].sum(), rel=1e-13)
        assert piece["elements"] == members.sum()
        assert piece["vy"] == pytest.approx((0.3, -0.1)[k], rel=1e-12)
        spin = [piece[c] for c in ("wx", "wy", "wz")][3 - len(spins[k]) :]
        assert spin == pytest.approx(spins[k], rel=1e-11)
    # rigid motions, so all kinetic energy is the pieces'
    assert found["kinetic_energy"].sum() == pytest.approx(sim.energy()["kinetic"], rel=1e-12)


def test_history_and_files(tmp_path):
    p = wd.packing.voronoi(wd.packing.Disc(6.0), 1.0, seed=1)
    scene = wd.Scene()
    body = scene.add(p, SOFT, fracture=wd.Rankine(1e-3))
    scene.scatter_strength(body, 5.0)
    scene.set_velocity(body, 2e-3 * p.position)
    sim = wd.Simulation(scene)
    tracker = sim.observe(wd.FragmentTracker(every=50))
    sim.run(steps=220)
    history = tracker.history
    assert list(np.round(history["time"] / sim.dt)) == [0, 50, 100, 150, 200, 220]
    assert history["pieces"][0] == 1
    assert history["pieces"][-1] == len(tracker.pieces) > 3
    assert (np.diff(history["pieces"]) >= 0).all()
    assert tracker.pieces["mass"].sum() == pytest.approx(2.0 * p.volume.sum(), rel=1e-12)
    wd.write_fragments(tmp_path, tracker)
    with (tmp_path / "fragments.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][2] == "mass [kg]" and len(rows) == 1 + len(tracker.pieces)
    assert (tmp_path / "fragments.png").stat().st_size > 5000


def test_a_look_every_no_step_is_refused():
    with pytest.raises(wd.InputError, match="every 1 or more"):
        wd.FragmentTracker(every=0)

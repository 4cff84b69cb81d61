"""The list of neighbours against an independent search over all pairs and images in NumPy."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import warpdem as wd
from warpdem.validation.contact import ball, balls

SOFT = wd.Material(1.0, 0.3, 1.0)
pytestmark = pytest.mark.filterwarnings("ignore::warpdem.ModelWarning")  # of loose elements


def all_pairs(x, radius, skin, edges=None):
    """Pairs nearer than their radii and the skin, of any of their images: all against all."""
    near = np.zeros((len(x), len(x)), dtype=bool)
    dim = x.shape[1]
    counts = [np.zeros(dim)] if edges is None else product((-2, -1, 0, 1, 2), repeat=dim)
    for count in counts:
        shift = 0.0 if edges is None else edges @ np.array(count)
        d = x[None] + shift - x[:, None]
        near |= np.einsum("ijk,ijk->ij", d, d) <= (radius[None] + radius[:, None] + skin) ** 2
    i, j = np.nonzero(np.triu(near, 1))
    return set(zip(i.tolist(), j.tolist(), strict=True)) - {(0, 1)}  # a bond joins these


def scene_of(x, radius, period=None, strain=None, skin=0.4):
    scene = wd.Scene()
    dim = x.shape[1]
    p = balls(x, radius)
    if period is None:
        body = scene.add(p, SOFT, bond=wd.EVMBond(1.0, 1.0, 1.0, 1.0))
    else:
        body = scene.add(loose(x, radius, period), SOFT)
        if strain is not None:
            scene.strain(body, strain)
    scene.contact(skin=skin, friction=0.3)
    return scene, body, dim


def loose(x, radius, period):
    """Elements of a periodic box, the first two joined by a face of no concern."""
    dim = x.shape[1]
    d = x[1] - x[0]
    return wd.packing.Packing(
        x,
        np.pi * radius**2 if dim == 2 else 4.0 / 3.0 * np.pi * radius**3,
        np.array([[0, 1]]),
        radius=radius,
        plane="strain" if dim == 2 else None,
        area=np.array([1e-3]),
        arms=np.array([[0.5 * d, -0.5 * d]]),
        period=period,
    )


def starts_of(dim, rng):
    return {
        "random": rng.uniform(0.0, 10.0, (300, dim)),
        "clustered": rng.normal(0.0, 0.6, (250, dim)) + 40.0 * rng.integers(0, 3, (250, dim)),
        "far": rng.uniform(0.0, 8.0, (250, dim)) + 1e6,
        "line": np.linspace(0.0, 200.0, 300)[:, None] * np.eye(dim)[0],
    }


@pytest.mark.parametrize(
    "precision", ["float64", "float32", pytest.param("mixed", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("dim", [2, 3])
def test_pairs_are_those_of_all_against_all(dim, precision):
    rng = np.random.default_rng(5)
    for x in starts_of(dim, rng).values():
        radius = rng.uniform(0.1, 0.5, len(x))
        scene, _, _ = scene_of(x, radius)
        sim = wd.Simulation(scene, dt=1e-6, force_dt=True, precision=precision)
        near = sim._step.neighbours
        for moved in (0.0, 1.0):
            if moved:  # rounded as the device keeps it
                u = rng.normal(0.0, moved, x.shape)
                sim.set_state(displacement=u)
            place = sim.model.contact_position + sim._step.download("displacement")
            reach = sim.model.contact_radius.astype(sim._step.download("displacement").dtype)
            wanted = all_pairs(place, reach.astype(float), near.skin)
            found = near.pairs().tolist()
            assert len(found) == len({*map(tuple, found)})
            assert {*map(tuple, found)} == wanted


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("strain", [0.0, 0.15])
@pytest.mark.parametrize(("dim", "edge"), [(2, 2.6), (2, 3.4), (2, 9.0), (3, 2.6), (3, 6.0)])
def test_pairs_in_a_periodic_box(dim, edge, strain, precision):
    """Boxes of two, three and many cells across; elements that have gone round them many times."""
    rng = np.random.default_rng(11)
    period = edge * np.array([1.0, 1.1, 1.3])[:dim]
    n = int(np.clip(2.0 * period.prod(), 40, 300))
    x = rng.uniform(0.0, 1.0, (n, dim)) * period
    x[1] = x[0] + 0.05
    e = strain * np.array([[0.5, 1.0, -0.3], [1.0, 0.2, 0.4], [-0.3, 0.4, 0.1]])[:dim, :dim]
    radius = rng.uniform(0.1, 0.4, n)
    scene, _, _ = scene_of(x, radius, period, e, skin=0.5)
    sim = wd.Simulation(scene, dt=1e-9, force_dt=True, precision=precision)
    near = sim._step.neighbours
    edges = (np.eye(dim) + e) * period
    for turns in (0, 1, 7):
        if turns:
            u = sim.displacement + rng.integers(-turns, turns + 1, (n, dim)) @ edges.T
            u[:2] = sim.displacement[:2]
            sim.set_state(displacement=u + rng.normal(0.0, 0.02, (n, dim)))
        place = sim.model.contact_position + sim._step.download("displacement")
        place = place @ np.linalg.inv(edges).T
        place = (place - np.floor(place)) @ edges.T
        reach = sim.model.contact_radius.astype(sim._step.download("displacement").dtype)
        wanted = all_pairs(place, reach.astype(float), near.skin, edges)
        found = near.pairs().tolist()
        assert len(wanted) > 10
        assert {*map(tuple, found)} == wanted
        # the way to the neighbour leads to the image that is near
        start = sim._step.arrays["contact_start"].numpy()
        own = np.repeat(sim.model.contact_elements, np.diff(start))
        j = sim._step.arrays["contact_neighbour"].numpy()[: start[-1]]
        d = sim._step.arrays["contact_reference"].numpy().reshape(-1, dim)[: start[-1]]
        image = sim._step.arrays["contact_image"].numpy().reshape(-1, dim)[: start[-1]]
        u = sim.displacement
        d = d + image @ (e * period).T + u[j] - u[own]
        size = np.linalg.norm(d, axis=1)
        assert (size <= reach[own] + reach[j] + near.skin + 1e-5).all()


def test_no_pair_is_missed_while_a_strained_box_changes():
    """Elements on both sides of a large box go with it as its strain grows from 0.3: the images of
    those beyond a side go by more than they do."""
    period, first = np.array([40.0, 44.0]), 0.3 * np.diag([1.0, -0.5])
    rise = np.array([[1e-3, 0.0], [0.0, -5e-4]])

    def strain(time):
        return first + time * rise

    scene = wd.Scene()
    rows = np.arange(0.2, 43.0, 2.0)
    middle = (np.eye(2) + first) @ [0.5 * (0.5 + 39.3), 0.5 * (rows[0] + rows[-1])]
    for side in (0.5, 39.3):
        for row in rows:
            place = (np.eye(2) + first) @ [side, row]
            body = scene.add(replace(ball(place, 0.4), period=period), SOFT)
            scene.strain(body, strain)
            scene.set_velocity(body, rise @ (place - middle))
    scene.contact(skin=0.25)
    sim = wd.Simulation(scene, dt=0.1)
    near, most = sim._step.neighbours, 0
    for _ in range(50):
        sim.run(steps=20)
        edges = (np.eye(2) + strain(sim.time)) * period
        place = (sim.model.contact_position + sim.displacement) @ np.linalg.inv(edges).T
        place = (place - np.floor(place)) @ edges.T
        touching = all_pairs(place, sim.model.contact_radius, 0.0, edges)
        most = max(most, len(touching))
        assert touching <= {*map(tuple, near.pairs().tolist())}
    assert most > 10 and near.builds > 1


def test_more_neighbours_than_there_is_room_for_are_all_found():
    rng = np.random.default_rng(2)
    x = rng.uniform(0.0, 20.0, (120, 2))
    scene, _, _ = scene_of(x, np.full(120, 0.5))
    sim = wd.Simulation(scene, dt=1e-6, force_dt=True)
    near = sim._step.neighbours
    before = near.searches - near.builds
    sim.set_state(displacement=0.95 * (x.mean(axis=0) - x))  # most are near most
    assert near.searches - near.builds == before + 1  # it was told, and sought again
    place = sim.model.contact_position + sim._step.download("displacement")
    wanted = all_pairs(place, sim.model.contact_radius, near.skin)
    assert len(wanted) > 4000
    assert {*map(tuple, near.pairs().tolist())} == wanted


def test_a_box_that_is_too_small_is_refused():
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 1.0, (6, 2))
    scene, _, _ = scene_of(x, np.full(6, 0.4), np.array([1.5, 4.0]))
    with pytest.raises(wd.InputError, match=r"periodic box is 1\.5 m across"):
        wd.Simulation(scene, dt=1e-6, force_dt=True)

"""Threads of a CPU: the same results to the bit, whatever their number."""

import numpy as np
import pytest

import warpdem as wd
from warpdem import passes

pytestmark = pytest.mark.usefixtures("two_threads")


def breaking_plate(threads, precision="float64"):
    glass = wd.Material(72e9, 0.22, 2440)
    plate = wd.packing.hexagonal(size=(0.12, 0.08), spacing=1e-3, plane="strain")
    scene = wd.Scene()
    body = scene.add(plate, glass, fracture=wd.Rankine(10e6))
    scene.contact(friction=0.3)
    scene.cut(body, start=(0, 0.04), end=(0.03, 0.04))
    scene.pull(body, where=plate.top, traction=(0, 12e6))
    scene.pull(body, where=plate.bottom, traction=(0, -12e6))
    return wd.Simulation(scene, precision=precision, threads=threads)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_results_do_not_depend_on_threads(precision):
    one, two = breaking_plate(1, precision), breaking_plate(2, precision)
    assert len(one.displacement) > 2 * passes.SHARED  # launches are shared out
    for sim in (one, two):
        sim.run(steps=120)
    assert len(one.broken_bonds()) > 10
    assert np.array_equal(one.displacement, two.displacement)
    assert np.array_equal(one.broken_bonds(), two.broken_bonds())
    assert one.energy() == two.energy()


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_loose_elements_do_not_depend_on_threads(dim):
    """The search, contact and closing of faces that turn away from each other."""
    if dim == 2:
        p = wd.packing.hexagonal((100.0, 75.0), 1.0, "strain")
    else:
        p = wd.packing.fcc((15.0,) * 3, 1.0)
    runs = []
    for threads in (1, 2):
        rng = np.random.default_rng(1)
        scene = wd.Scene()
        body = scene.add(p, wd.Material(1.0, 0.3, 1.0))
        body.linked[:] = False
        scene.set_velocity(body, 0.05 * rng.normal(size=p.position.shape))
        body.angular_velocity[:] = 0.2 * rng.normal(size=body.angular_velocity.shape)
        scene.contact(friction=0.3)
        sim = wd.Simulation(scene, threads=threads)
        assert sim._step.neighbours.rows >= passes.SHARED
        sim.run(steps=80)
        runs.append(sim)
    one, two = runs
    assert one._step.neighbours.builds > 2 and len(one.contacts) > 10
    assert np.array_equal(one.displacement, two.displacement)
    assert np.array_equal(one.angular_velocity, two.angular_velocity)
    assert one.energy() == two.energy()


def test_every_index_is_taken_by_one_thread():
    sim = breaking_plate(2)
    team = sim._step._team
    for launch in sim._step._forces.launches:
        size = launch.bounds.size
        taken = []
        for share in (team._share(launch, rank) for rank in range(2)):
            if share is not None:
                last = share.bounds.size
                taken += range(share.bounds.shape[0] - last, last)
        assert taken == list(range(size))


def test_a_team_ends_with_its_simulation():
    import gc
    import threading
    import time

    before = set(threading.enumerate())  # some of them of other tests, and about to end
    sim = breaking_plate(2)
    sim.run(steps=3)
    (own,) = set(threading.enumerate()) - before
    del sim
    gc.collect()
    for _ in range(200):
        if not own.is_alive():
            break
        time.sleep(0.01)
    assert not own.is_alive()


@pytest.mark.parametrize("threads", [0, 10_000])
def test_a_number_of_threads_that_cannot_be_is_refused(threads):
    with pytest.raises(wd.InputError, match="may use"):
        breaking_plate(threads)

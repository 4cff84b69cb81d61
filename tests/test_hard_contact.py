import numpy as np
import pytest

import warpdem as wd
from warpdem.validation.contact import ball

SOFT = wd.Material(1.0, 0.3, 1.0)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["facet", "EVM"])
def test_every_bond_may_break_in_one_step(dim, kind):
    size = (6.0, 5.0, 4.0)[:dim]
    p = wd.packing.voronoi(size, 1.0, "strain" if dim == 2 else None, seed=1)
    scene = wd.Scene()
    bond = "facet" if kind == "facet" else wd.EVMBond(1.0, 0.4, 0.1, 0.1)
    body = scene.add(p, wd.Material(1.0, 0.3, 1.0), bond=bond, fracture=wd.Rankine(1e-9))
    scene.strain(body, np.diag([2e-2, 1e-2, 3e-2][:dim]))
    scene.contact(friction=0.3)
    sim = wd.Simulation(scene)
    before = sim.energy()
    held = before["pair"] + before["volume"]
    sim.run(steps=1)
    assert not sim.linked.any()
    sim.run(steps=500)  # numbers that are not finite would end it
    ledger = sim.energy()
    now = ledger["kinetic"] + ledger["contact"]
    assert now <= held and ledger["fracture"] > 0.0
    assert abs(ledger["residual"]) < 1e-3 * held


def thrown(speed, **wall):
    """One element above a floor, thrown at it."""
    scene = wd.Scene()
    body = scene.add(ball(np.array([0.0, 0.6]), 0.5), SOFT)
    scene.contact(friction=0.3)
    scene.wall([0.0, 0.0], [0.0, 1.0], **wall)
    scene.set_velocity(body, [0.0, speed])
    return wd.Simulation(scene)


def test_one_element_alone_falls_touches_and_flies():
    sim = thrown(-0.02)
    sim.run(steps=200)
    assert sim.velocity[0, 1] == pytest.approx(0.02, rel=1e-12)
    assert abs(sim.energy()["residual"]) < 1e-14
    scene = wd.Scene()
    scene.add(ball(np.zeros(3), 0.5), SOFT)
    scene.contact()
    sim = wd.Simulation(scene)
    sim.run(steps=5)
    assert len(sim.contacts) == 0 and not sim.velocity.any()


def test_an_element_that_would_cross_a_wall_in_a_step_is_refused():
    with pytest.raises(wd.InputError, match=r"elements 0 move .* pass through wall 0; take dt bel"):
        thrown(-10.0)
    with pytest.raises(wd.InputError, match="pass through wall 0"):
        thrown(0.0, velocity=[0.0, 10.0])
    with pytest.raises(wd.InputError, match="pass through wall 0"):
        thrown(0.0, spin=20.0, pivot=[1.0, 0.6])
    sim = thrown(0.0)
    with pytest.raises(wd.TooFastError, match="pass through wall 0"):
        sim.set_state(velocity=[[0.0, -10.0]])
    assert thrown(-10.0, velocity=[0.0, -10.0]).velocity[0, 1] == -10.0  # both fly alike


def test_a_wall_that_becomes_too_fast_on_its_path_ends_the_run():
    scene = wd.Scene()
    scene.add(ball(np.array([0.0, 9.0]), 0.5), SOFT)
    scene.contact()
    scene.wall([0.0, 0.0], [0.0, 1.0], path=lambda t: [0.0, 1e-3 * t**2 - 200.0, 0.0])
    sim = wd.Simulation(scene)
    with pytest.raises(wd.TooFastError, match="pass through wall 0"):
        sim.run(steps=4000)


def test_a_projectile_that_would_cross_an_element_in_a_step_is_refused():
    def shot(dt, speed=0.5):
        scene = wd.Scene()
        scene.add(ball(np.zeros(2), 0.5), SOFT)
        bullet = scene.add(ball(np.array([3.0, 0.0]), 0.1), SOFT)
        scene.set_velocity(bullet, [-speed, 0.0])
        scene.contact()
        return wd.Simulation(scene, dt=dt, force_dt=True)

    with pytest.raises(wd.InputError, match=r"elements 1 .*through others; take dt below") as why:
        shot(0.2)
    sim = shot(0.3 * float(str(why.value).split("below ")[1].split(" s")[0]))  # as it says
    before = sim.model.mass @ sim.velocity
    sim.run(until=8.0)
    assert sim.velocity[1, 0] > sim.velocity[0, 0]  # it bounced
    assert sim.model.mass @ sim.velocity == pytest.approx(before, rel=1e-13)
    assert abs(sim.energy()["residual"]) < 1e-6 * sim.energy()["kinetic"]
    with pytest.warns(wd.ModelWarning, match="elements 1 move at up to 3.* the speed of waves"):
        shot(1e-3, speed=4.0)

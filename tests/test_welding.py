import numpy as np
import pytest

import warpdem as wd
from warpdem.validation.contact import ball

SOFT = wd.Material(1.0, 0.3, 1.0)
HEX = wd.packing.hexagonal((5.0, 4.0), 1.0, "strain")


def meeting(welding, skin=0.5, friction=0.4, apart=0.05, **more):
    """Two bodies that meet slowly."""
    scene = wd.Scene()
    scene.add(HEX, SOFT)
    other = scene.add(HEX, SOFT)
    other.displacement[:, 0] = np.ptp(HEX.position[:, 0]) + 1.0 + apart
    scene.set_velocity(other, [-0.01, 0.002])
    scene.contact(friction=friction, skin=skin, welding=welding, **more)
    return wd.Simulation(scene)


def test_without_welding_nothing_of_it_exists():
    sim = meeting(None)
    assert not any(
        "weld" in x or x in ("contact_pressed", "contact_worked") for x in sim._step.arrays
    )
    assert len(sim.welded) == len(sim.welded_pairs()) == 0


def test_what_a_weld_bears_does_not_roll():
    """Two discs weld and are pulled along their line: rolling friction has no part in it."""
    runs = []
    for rolling in (0.0, 0.5):
        scene = wd.Scene()
        one = scene.add(ball(np.zeros(2), 0.5), SOFT)
        other = scene.add(ball(np.array([0.99, 0.0]), 0.5), SOFT)
        scene.contact(friction=0.4, rolling_friction=rolling, welding=wd.Welding(strength=5e-2))
        scene.set_velocity(one, [-0.01, 0.0])
        scene.set_velocity(other, [0.01, 0.0])
        sim = wd.Simulation(scene, dt=0.1)
        sim.run(steps=40)
        assert len(sim.welded) == 1
        runs.append(sim)
    plain, rolls = runs
    assert plain.force[0, 0] > 1e-4  # it is pulled
    assert np.array_equal(plain.force, rolls.force) and not rolls.torque.any()


def test_bodies_weld_and_fly_on_as_one():
    sim = meeting(wd.Welding(strength=0.1))
    free = meeting(None)
    for x in (sim, free):
        x.run(until=300.0)
    assert len(sim.welded) >= 2 and len(free.contacts) == 0
    log = sim.welded_pairs()
    assert (log["kind"] == "welded").all() and (log["released_energy"] == 0.0).all()
    v = [sim.velocity[sim.elements(b), 0].mean() for b in sim.scene.bodies]
    assert np.mean(v) == pytest.approx(-0.005, rel=1e-9)
    assert abs(sim.energy()["residual"]) < 1e-4 * sim.initial_energies["kinetic"]


def test_welds_outlive_the_list_they_were_made_in():
    runs = [meeting(wd.Welding(strength=0.05, time=1.0), skin) for skin in (0.5, 0.2)]
    for sim in runs:
        sim.run(until=60.0)
    one, two = runs
    assert two._step.neighbours.builds > one._step.neighbours.builds
    assert len(one.welded) and np.array_equal(one.welded, two.welded)
    assert np.array_equal(one.displacement, two.displacement)
    pressed = one._step.arrays["contact_spring"].numpy().copy()
    one._step.neighbours.build()
    assert np.array_equal(one.welded, two.welded)
    assert np.array_equal(one._step.arrays["contact_spring"].numpy(), pressed)


def test_welds_go_on_from_a_checkpoint(tmp_path):
    whole, first = (meeting(wd.Welding(strength=4e-3)) for _ in range(2))
    whole.run(steps=800)
    first.run(steps=250)
    assert len(first.welded)
    first.save(tmp_path / "weld.npz")
    second = wd.resume(tmp_path / "weld.npz", first.scene)
    second.run(steps=550)
    assert np.array_equal(whole.displacement, second.displacement)
    assert np.array_equal(whole.welded, second.welded)
    assert np.array_equal(whole.welded_pairs(), second.welded_pairs())
    assert (whole.welded_pairs()["kind"] == "broken").any()


def test_slip_work_and_pressure_are_waited_for():
    assert len(meeting_log(wd.Welding(0.1, pressure=1.0))) == 0
    assert len(meeting_log(wd.Welding(0.1, work=1.0))) == 0
    assert len(meeting_log(wd.Welding(0.1, work=1e-9))) > 0


def meeting_log(welding):
    sim = meeting(welding)
    sim.run(until=60.0)
    return sim.welded_pairs()


def test_a_weld_without_friction_does_not_slip():
    scene = wd.Scene()
    scene.add(ball(np.zeros(2), 0.5), SOFT)
    other = scene.add(ball(np.array([0.999, 0.0]), 0.5), SOFT)
    scene.set_velocity(other, [0.0, 1e-3])
    scene.contact(welding=wd.Welding(strength=0.1))
    sim = wd.Simulation(scene)
    sim.run(steps=2)
    assert len(sim.welded) == 1
    spins = []
    for _ in range(200):
        sim.run(steps=1)
        spins.append(np.abs(sim.angular_velocity).max())
    assert max(spins) > 1e-4  # the spring across turns both
    assert sim.energy()["friction"] == 0.0
    assert abs(sim.energy()["residual"]) < 1e-4 * sim.initial_energies["kinetic"]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"welding": 3}, "give a Welding"),
        ({"law": "hertz"}, "linear law"),
        ({"friction": wd.RateAndState(0.6, 0.01, 0.015, 1e-6, 1e-5)}, "Coulomb"),
    ],
)
def test_what_welding_does_not_know_is_refused(given, message):
    with pytest.raises(wd.InputError, match=message):
        wd.Scene().contact(**({"welding": wd.Welding(1.0)} | given))


def test_laws_that_cannot_be_are_refused():
    with pytest.raises(wd.InputError, match="time is -1"):
        wd.Welding(1.0, time=-1.0)
    with pytest.raises(wd.InputError, match="strength must be greater"):
        wd.Welding(0.0)
    with pytest.raises(wd.InputError, match="give a strength below"):
        meeting(wd.Welding(strength=1.0))

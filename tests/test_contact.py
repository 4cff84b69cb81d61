import numpy as np
import pytest

import warpdem as wd
from warpdem.validation.contact import ball, balls

SOFT = wd.Material(1.0, 0.3, 1.0)
HEX = wd.packing.hexagonal((5.0, 4.0), 1.0, "strain")


def meeting(gap=0.1, speed=0.01, contact=True, bodies=2, **options):
    """Two hexagonal bodies on their way to each other."""
    scene = wd.Scene()
    for number in range(bodies):
        body = scene.add(HEX, SOFT)
        wide = np.ptp(HEX.position[:, 0]) + 1.0 + gap
        body.displacement[:, 0] = number * wide
        scene.set_velocity(body, [-speed * number, 0.0])
    if contact:
        scene.contact(**options)
    return scene


def kernels(sim):
    """Names of the kernels of a step."""
    step = sim._step
    passes = [step._start, step._finish_and_start]
    passes += [step._evaluate] if step.neighbours is not None else []
    return {launch.kernel.key for p in passes for launch in p.launches}


def test_without_contact_no_kernel_and_no_array():
    sim = wd.Simulation(meeting(contact=False))
    assert sim._step.neighbours is None
    assert not any(x.startswith(("contact", "wall", "settling")) for x in sim._step.arrays)
    touching = wd.Simulation(meeting())
    assert kernels(sim) == kernels(touching)
    assert sim.model.features.slots == touching.model.features.slots - 1
    assert len(sim.contacts) == 0


def test_only_what_can_touch_takes_part():
    sim = wd.Simulation(meeting(bodies=1))
    inner = ~HEX.boundary(1)
    assert not np.isin(np.flatnonzero(inner), sim.model.contact_elements).any()
    assert np.isin(np.flatnonzero(~inner), sim.model.contact_elements).all()
    scene = wd.Scene()
    scene.add(HEX, SOFT, fracture=wd.Rankine(1.0))
    scene.contact()
    assert len(wd.Simulation(scene).model.contact_elements) == len(HEX)


def test_bonded_pairs_are_not_listed():
    scene = wd.Scene()
    body = scene.add(HEX, SOFT)
    body.linked[:] = False
    scene.contact(skin=0.8)
    sim = wd.Simulation(scene)
    bonded = {tuple(sorted(b)) for b in HEX.bonds.tolist()}
    assert not bonded & {tuple(p) for p in sim._step.neighbours.pairs().tolist()}


def test_bodies_rebound_instead_of_passing():
    sim = wd.Simulation(meeting())
    seen = 0
    for _ in range(30):
        sim.run(steps=10)
        seen = max(seen, len(sim.contacts))
    assert seen > 0
    first, second = (sim.velocity[sim.elements(b), 0].mean() for b in sim.scene.bodies)
    assert second > first
    passing = wd.Simulation(meeting(contact=False))
    passing.run(steps=300)
    assert passing.velocity[len(HEX) :, 0].mean() == pytest.approx(-0.01)


def test_the_list_grows_and_keeps_what_it_knew():
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 30.0, (60, 2))
    scene = wd.Scene()
    body = scene.add(balls(x, np.full(60, 0.5)), SOFT, bond=wd.EVMBond(1.0, 1.0, 1.0))
    scene.contact(friction=0.5)
    sim = wd.Simulation(scene, dt=1e-3, force_dt=True)
    near = sim._step.neighbours
    before = near.capacity
    sim.set_state(displacement=0.5 * (x.mean(axis=0) - x))
    sim.set_state(displacement=0.8 * (x.mean(axis=0) - x))
    assert near.capacity > before
    assert len(near.pairs()) <= near.capacity
    sim.run(steps=20)
    assert sim._step.arrays["contact_spring"].numpy().any()
    old = {tuple(p) for p in near.pairs().tolist()}
    held = sim.energy()["contact"]
    near.build()
    assert {tuple(p) for p in near.pairs().tolist()} == old
    assert sim.energy()["contact"] == held
    assert body is scene.bodies[0]


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_runs_repeat_to_the_bit(friction):
    one, two = (wd.Simulation(meeting(friction=friction)) for _ in range(2))
    for sim in (one, two):
        sim.run(steps=200)
    assert np.array_equal(one.displacement, two.displacement)
    three = wd.Simulation(meeting(friction=friction, skin=0.2))  # other lists, the same sums
    three.run(steps=200)
    assert three._step.neighbours.builds > one._step.neighbours.builds
    assert np.array_equal(one.displacement, three.displacement)


def test_a_moving_wall_pushes_and_its_work_is_booked():
    scene = wd.Scene()
    body = scene.add(HEX, SOFT)
    scene.contact(friction=0.3)
    low = HEX.position[:, 1].min() - 0.55
    wall = scene.wall([0.0, low], [0.0, 1.0], velocity=[0.002, 0.01])
    sim = wd.Simulation(scene)
    impulse, before = 0.0, sim.model.mass @ sim.velocity
    for _ in range(200):
        sim.run(steps=1)
        impulse = impulse - sim.wall_force(wall) * sim.dt
    gained = sim.model.mass @ sim.velocity - before
    assert gained[1] / sim.model.mass.sum() > 0.01  # it flies ahead of the wall
    assert gained[0] > 0.0
    assert impulse == pytest.approx(gained, rel=0.05)
    ledger = sim.energy()
    assert ledger["work"] > 0.0
    assert abs(ledger["residual"]) < 1e-3 * ledger["work"]
    assert body is scene.bodies[0]


def test_restitution_takes_energy_at_a_wall():
    scene = wd.Scene()
    body = scene.add(ball(np.array([0.0, 1.0]), 0.5), SOFT)
    scene.contact(restitution=0.5)
    scene.wall([0.0, 0.0], [0.0, 2.0])
    scene.set_velocity(body, [0.0, -0.02])
    sim = wd.Simulation(scene)
    sim.run(until=60.0)
    assert sim.velocity[0, 1] == pytest.approx(0.01, rel=1e-12)
    ledger = sim.energy()
    assert ledger["damping"] == pytest.approx(3.0 * ledger["kinetic"], rel=1e-12)


def test_fast_elements_are_refused():
    with pytest.raises(wd.InputError, match=r"move by up to .* take dt below"):
        wd.Simulation(meeting(speed=5.0))
    sim = wd.Simulation(meeting())
    v = sim.velocity
    v[0] = 50.0
    with pytest.raises(wd.TooFastError, match="elements 0"):
        sim.set_state(velocity=v)
    wd.Simulation(meeting(contact=False, speed=5.0))


def test_lost_elements_are_refused():
    sim = wd.Simulation(meeting())
    u = sim.displacement
    u[3, 0] = 1e12
    with pytest.raises(wd.NonFiniteError, match="elements 3 are nowhere near"):
        sim.set_state(displacement=u)


def test_relax_finds_rest_on_a_wall():
    scene = wd.Scene()
    scene.add(HEX, SOFT)
    scene.contact()
    wall = scene.wall([0.0, HEX.position[:, 1].min() - 0.5], [0.0, 1.0])
    scene.set_gravity([0.0, -1e-4])
    sim = wd.Simulation(scene)
    sim.relax(tolerance=1e-8)
    weight = 1e-4 * sim.model.mass.sum()
    assert sim.wall_force(wall) == pytest.approx([0.0, -weight], abs=1e-6 * weight)
    with pytest.raises(wd.InputError, match="does not know of contact"):
        sim.equilibrate()


def test_bad_input_is_refused():
    scene = wd.Scene()
    with pytest.raises(wd.InputError, match="call contact first"):
        scene.wall([0.0, 0.0], [0.0, 1.0])
    with pytest.raises(wd.InputError, match="friction is -1"):
        scene.contact(friction=-1.0)
    with pytest.raises(wd.InputError, match="restitution is 2"):
        scene.contact(restitution=2.0)
    with pytest.raises(wd.InputError, match="skin must be greater"):
        scene.contact(skin=0.0)
    scene.contact()
    with pytest.raises(wd.InputError, match="add bodies"):
        scene.wall([0.0, 0.0], [0.0, 1.0])
    scene.add(HEX, SOFT)
    with pytest.raises(wd.InputError, match="normal is zero"):
        scene.wall([0.0, 0.0], [0.0, 0.0])
    with pytest.raises(wd.InputError, match="normal has shape"):
        scene.wall([0.0, 0.0], [0.0, 0.0, 1.0])
    wall = scene.wall([0.0, -9.0], [0.0, 1.0])
    sim = wd.Simulation(meeting())
    with pytest.raises(wd.InputError, match="not in the simulation"):
        sim.wall_force(wall)


@pytest.mark.parametrize("precision", ["float32", "mixed"])
def test_single_precision_holds(precision):
    sim = wd.Simulation(meeting(friction=0.3), precision=precision)
    sim.run(steps=300)
    assert abs(sim.energy_error) < 1e-3
    p = sim.model.mass @ sim.velocity
    assert p[0] == pytest.approx(-0.01 * sim.model.mass[len(HEX) :].sum(), rel=1e-5)


def test_stress_of_elements_counts_what_presses_them():
    p = wd.packing.square((4.0, 5.0), 1.0, "strain")
    scene = wd.Scene()
    scene.add(p, wd.Material(1.0, 0.0, 1.0), facet_bending=True)
    scene.contact()
    low, high = p.position[:, 1].min() - 0.5, p.position[:, 1].max() + 0.5
    floor = scene.wall([0.0, low + 1e-3], [0.0, 1.0])
    scene.wall([0.0, high - 1e-3], [0.0, -1.0])
    sim = wd.Simulation(scene)
    sim.relax(tolerance=1e-9)
    pressed = sim.wall_force(floor)[1] / 4.0
    assert pressed < 0.0
    # the same in all rows, up to how far the pressed radius is shorter
    assert sim.stress[:, 1, 1] == pytest.approx(np.full(len(p), pressed), rel=2e-3)

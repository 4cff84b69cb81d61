"""Laws of contact: turned-over pairs, dashpots, rolling, friction by materials (theory B11)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import warpdem as wd
from warpdem.contact import damping_ratio
from warpdem.validation.contact import SOFT, ball

AXIS = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])


def cut_pair(dim, **contact):
    """Two elements whose only bond is cut."""
    shape = (2.0, 1.0) if dim == 2 else (2.0, 1.0, 1.0)
    p = wd.packing.square(shape, 1.0, "strain") if dim == 2 else wd.packing.simple_cubic(shape, 1.0)
    scene = wd.Scene()
    body = scene.add(p, SOFT, volume=False, facet_bending=True)
    body.linked[:] = False
    if contact:
        scene.contact(**contact)
    return wd.Simulation(scene, dt=0.01)


def turned(dim, angle, more=(0.0, 0.0, 0.0)):
    """Orientations of which the second is turned by an angle, and then a little more."""
    if dim == 2:
        half = 0.5 * (angle + more[2])
        return np.array([[0.0, 1.0], [np.sin(half), np.cos(half)]])
    turn = Rotation.from_rotvec(more) * Rotation.from_rotvec(angle * AXIS)
    return np.stack([[0.0, 0.0, 0.0, 1.0], turn.as_quat()])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_face_turns_over_without_a_jump(dim):
    sim = cut_pair(dim)
    u = np.array([[0.0, 0.0, 0.0], [-0.3, 0.1, 0.05]])[:, :dim]

    def held(angle, more=(0.0, 0.0, 0.0), shift=0.0):
        sim.set_state(displacement=u + shift, orientation=turned(dim, angle, more))
        return sim.energy()["contact"]

    # about z the carried normals oppose each other at pi; about another axis they pass beside
    angles = np.linspace(np.pi - 1e-3, np.pi + 1e-3, 41)
    energy = np.array([held(a) for a in angles])
    assert np.isfinite(energy).all()
    assert np.abs(np.diff(energy)).max() < 1e-4
    h = 1e-6
    for angle in (0.4, 2.0, 2.1, 3.0, np.pi, 3.3, 4.4):
        held(angle)
        force, torque = sim.force[1].copy(), sim.torque[1].copy()
        assert np.isfinite(force).all()
        for axis in range(dim):
            step = np.zeros((2, dim))
            step[1, axis] = h
            slope = -(held(angle, shift=step) - held(angle, shift=-step)) / (2 * h)
            assert slope == pytest.approx(force[axis], abs=1e-8)
        for axis in range(3)[-torque.size :]:
            more = h * np.eye(3)[axis]
            slope = -(held(angle, more) - held(angle, -more)) / (2 * h)
            assert slope == pytest.approx(torque[axis - 3], abs=1e-8)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("kind", ["facet", "EVM", "EVM in space"])
def test_a_face_spun_over_keeps_its_books(precision, kind):
    # turns of pi are passed again and again, on a step of the very angle too
    dim = 3 if "space" in kind else 2
    p = wd.packing.square((2.0, 1.0), 1.0, "strain")
    if dim == 3:
        p = wd.packing.simple_cubic((2.0, 1.0, 1.0), 1.0)
    bond = "facet" if kind == "facet" else wd.EVMBond(1.0, 0.0, 0.1, 0.1, offset=0.3)
    scene = wd.Scene()
    body = scene.add(p, SOFT, bond=bond, facet_bending=kind == "facet")
    body.linked[:] = False
    scene.contact(friction=0.3)
    spin = [0.5] if dim == 2 else [0.3, 0.0, 0.4]
    scene.set_velocity(body, np.zeros(dim), angular_velocity=spin, where=[1])
    dt = 2.0 * np.pi / 0.5 / 2000.0
    sim = wd.Simulation(scene, dt=dt, precision=precision)
    sim.set_state(displacement=[np.zeros(dim), -0.05 * np.eye(dim)[0]])
    held = sum(sim.energy()[x] for x in ("kinetic", "contact"))
    most = 0.0
    for _ in range(200):
        sim.run(steps=20)
        ledger = sim.energy()
        most = max(most, ledger["kinetic"] + ledger["contact"])
    assert np.isfinite(sim.position).all()
    assert most < (1.0 + 1e-3) * held
    assert ledger["friction"] > 0.01 * held
    assert abs(ledger["residual"]) < 1e-4 * held


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_friction_survives_elements_that_pass_through_each_other(dim, precision):
    scene = wd.Scene()
    scene.add(ball(np.zeros(dim), 0.5), SOFT)
    scene.add(ball(0.4 * np.eye(dim)[0], 0.5), SOFT)
    scene.contact(friction=100.0)
    sim = wd.Simulation(scene, dt=0.1, precision=precision)
    step = sim._step
    for miss in (0.0, 1e-9, 1e-5, 1e-3, 0.1):  # by which centres miss each other
        spring = np.zeros(step.arrays["contact_spring"].size)
        own = np.array([0.0, 0.01, 0.02])[:dim]
        spring[: 2 * dim] = np.tile(own, 2)
        step.upload("displacement", np.zeros((2, dim)))
        step.arrays["contact_spring"].assign(spring)
        u = np.zeros((2, dim))
        u[1, 0], u[1, 1] = -0.8, miss
        step.upload("displacement", u)
        step.upload("velocity", u / sim.dt)
        step._touch(moves=True)
        found = step.arrays["contact_spring"].numpy()[: 2 * dim].reshape(2, dim)
        assert np.array_equal(found[0], found[1])
        assert np.isfinite(found).all()
        # what the motion across the normal adds aside, no longer than it was
        moved = np.linalg.norm(found[0])
        assert moved <= np.linalg.norm(own) + 2.0 * miss + 1e-6


def heap(skin=0.5, precision="float64", **contact):
    """Elements that fall onto a floor and onto each other."""
    rng = np.random.default_rng(4)
    scene = wd.Scene()
    for row in range(2):
        for column in range(3):
            place = np.array([1.1 * column, 0.6 + 1.2 * row])
            scene.add(ball(place + rng.uniform(-0.05, 0.05, 2), 0.5), SOFT)
    scene.contact(skin=skin, **contact)
    scene.wall([0.0, 0.0], [0.0, 1.0])
    scene.wall([-0.6, 0.0], [1.0, 0.0])
    scene.wall([2.8, 0.0], [-1.0, 0.0])
    scene.set_gravity([0.0, -1e-4])
    return wd.Simulation(scene, precision=precision)


def test_ratio_of_damping_is_that_of_an_impact():
    from scipy.integrate import solve_ivp

    for e in (0.05, 0.3, 0.9):
        beta = damping_ratio(e)

        def force(_t, y, beta=beta):  # of a pressed linear contact, in units of m and k
            return y[0] + 2.0 * beta * y[1]

        force.terminal = True
        solved = solve_ivp(
            lambda t, y, f=force: [y[1], -f(t, y)], (0.0, 50.0), [0.0, 1.0], events=force,
            rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        assert -solved.y[1, -1] == pytest.approx(e, abs=1e-8)
    assert damping_ratio(np.exp(-2.0)) == pytest.approx(1.0, abs=1e-7)
    assert damping_ratio(1.0) == 0.0


def test_dashpots_bring_a_heap_to_rest():
    sim = heap(friction=0.3, restitution=0.3, restitution_by="dashpot")
    first = sim.energy()
    fallen = 1e-4 * sim.model.mass @ sim.position[:, 1]
    sim.run(until=1500.0)
    ledger = sim.energy()
    assert ledger["kinetic"] < 1e-8 * fallen
    assert ledger["damping"] > 0.1 * fallen
    assert ledger["friction"] > 0.0
    assert abs(ledger["residual"]) < 1e-4 * fallen
    assert first["damping"] == 0.0
    opening = heap(friction=0.3, restitution=0.3)
    opening.run(until=1500.0)
    assert opening.energy()["kinetic"] > 1e3 * ledger["kinetic"]


def test_dashpots_go_over_to_a_new_list():
    given = {"restitution": 0.4, "restitution_by": "dashpot"}
    one, two = heap(**given), heap(skin=0.1, **given)
    for sim in (one, two):
        sim.run(steps=600)
    assert two._step.neighbours.builds > one._step.neighbours.builds
    assert np.array_equal(one.displacement, two.displacement)
    # what is owed from a step that a new list cut would be missing
    assert one.energy()["damping"] == pytest.approx(two.energy()["damping"], rel=1e-13)


def test_dashpots_never_pull():
    scene = wd.Scene()
    body = scene.add(ball(np.array([0.0, 0.51]), 0.5), SOFT)
    scene.contact(restitution=0.05, restitution_by="dashpot")
    wall = scene.wall([0.0, 0.0], [0.0, 1.0])
    scene.set_velocity(body, [0.0, -0.01])
    sim = wd.Simulation(scene)
    least = 0.0
    for _ in range(400):
        sim.run(steps=1)
        least = min(least, -sim.wall_force(wall)[1])
    assert least == 0.0
    assert sim.velocity[0, 1] > 0.0


def test_dashpots_forget_a_state_that_was_overwritten():
    scene = wd.Scene()
    scene.add(ball(np.zeros(2), 0.5), SOFT)
    other = scene.add(ball(np.array([1.01, 0.0]), 0.5), SOFT)
    scene.set_velocity(other, [-0.05, 0.0])
    scene.contact(restitution=0.3, restitution_by="dashpot", skin=4.0)
    sim = wd.Simulation(scene, dt=0.05)
    while not sim.force.any():
        sim.run(steps=1)
    sim.run(steps=2)
    sim.set_state(displacement=[[0.0, 0.0], [0.1, 0.0]], velocity=[[0.0, 0.0], [-0.05, 0.0]])
    held, past = sim.energy()["kinetic"], sim.energy()["damping"]
    sim.run(until=sim.time + 20.0)
    ledger = sim.energy()
    assert ledger["damping"] > past
    assert abs(ledger["residual"]) < 1e-12 * held


@pytest.mark.parametrize("precision", ["float32", "mixed"])
def test_dashpots_in_single_precision(precision):
    sim = heap(precision=precision, friction=0.3, restitution=0.3, restitution_by="dashpot")
    fallen = 1e-4 * sim.model.mass @ sim.position[:, 1]
    sim.run(until=300.0)
    assert sim.energy()["damping"] > 0.1 * fallen
    assert abs(sim.energy()["residual"]) < 1e-3 * fallen


def test_only_scenes_with_dashpots_have_their_arrays():
    names = {"contact_dashpot", "wall_dashpot"}
    assert not names & heap(restitution=0.5)._step.arrays.keys()
    damped = heap(restitution=0.5, restitution_by="dashpot")._step.arrays.keys()
    assert names <= damped
    assert not {"contact_opened", "wall_opened"} & damped
    assert not names & heap(restitution=1.0, restitution_by="dashpot")._step.arrays.keys()


def test_bad_dashpots_are_refused():
    scene = wd.Scene()
    with pytest.raises(wd.InputError, match="restitution is 0; dashpots"):
        scene.contact(restitution=0.0, restitution_by="dashpot")
    with pytest.raises(wd.InputError, match="restitution_by"):
        scene.contact(restitution=0.5, restitution_by="magic")


def test_walls_have_their_own_rolling_friction():
    ways = []
    for own in (None, 0.1):
        scene = wd.Scene()
        body = scene.add(ball(np.array([0.0, 0.5]), 0.5), SOFT)
        scene.contact(friction=0.6, rolling_friction=0.05)
        scene.wall([0.0, 0.0], [0.0, 1.0], rolling_friction=own)
        scene.set_gravity([0.0, -1e-4])
        scene.set_velocity(body, [2e-3, 0.0], angular_velocity=[-4e-3])
        sim = wd.Simulation(scene)
        sim.run(until=1500.0)
        ways.append(sim.displacement[0, 0])
    assert ways[0] == pytest.approx(2.0 * ways[1], rel=0.01)


@pytest.mark.parametrize(
    "precision",
    ["float64", *(pytest.param(x, marks=pytest.mark.slow) for x in ("float32", "mixed"))],
)
def test_a_turning_wall_rolls_what_it_touches_and_its_work_is_booked(precision):
    # a plate that turns about its own normal and tilts, with a sphere on it that nothing else turns
    scene = wd.Scene()
    body = scene.add(ball(np.array([0.0, 0.5, 0.0]), 0.5), SOFT)
    scene.hold(body, [0], axes="xyz", rotation=False)
    body.displacement[0, 1] = -0.02
    scene.contact(rolling_friction=0.2, twisting_friction=0.02)
    wall = scene.wall([0.0, 0.0, 0.0], [0.0, 1.0, 0.0], spin=[0.0, 0.01, 0.0])
    sim = wd.Simulation(scene, precision=precision, dt=0.1)
    sim.run(steps=5)
    assert sim.angular_velocity[0, 1] > 0.0
    assert sim.wall_torque(wall)[1] == pytest.approx(-sim.torque[0, 1], rel=1e-5)
    sim.run(until=2000.0)
    ledger = sim.energy()
    assert -1e-3 < sim.angular_velocity[0, 1] < 0.021  # it swings about that of the wall
    assert ledger["friction"] > 0.0
    assert ledger["work"] > ledger["friction"]
    assert abs(ledger["residual"]) < 1e-4 * ledger["work"]


def test_rolling_springs_go_over_to_a_new_list():
    given = {"friction": 0.3, "rolling_friction": 0.1, "restitution": 0.3}
    given["restitution_by"] = "dashpot"
    one, two = heap(**given), heap(skin=0.1, **given)
    rolled = 0
    for _ in range(30):
        for sim in (one, two):
            sim.run(steps=50)
        rolled += one._step.arrays["contact_roll"].numpy().any()
    assert rolled
    assert two._step.neighbours.builds > one._step.neighbours.builds
    assert np.array_equal(one.orientation, two.orientation)


def test_only_scenes_that_resist_rolling_have_its_arrays():
    names = {"contact_roll", "wall_roll", "wall_rolling", "wall_twisting"}
    assert not names & heap(friction=0.3)._step.arrays.keys()
    assert names <= heap(rolling_friction=0.1)._step.arrays.keys()
    assert "contact_spring" not in heap(rolling_friction=0.1)._step.arrays


def test_bad_rolling_is_refused():
    scene = wd.Scene()
    with pytest.raises(wd.InputError, match="rolling_friction is -1"):
        scene.contact(rolling_friction=-1.0)
    with pytest.raises(wd.InputError, match="in the plane nothing twists"):
        heap(twisting_friction=0.1)


OTHER = wd.Material(2.0, 0.2, 1.5)


@pytest.mark.parametrize("bond", ["facet", "EVM"])
def test_broken_faces_rub_by_their_material(bond):
    # halves of one grid, cut and pressed together, of either material
    p = wd.packing.square((2.0, 1.0), 1.0, "strain")
    found = {}
    for name, m in (("a", SOFT), ("b", OTHER)):
        scene = wd.Scene()
        kind = "facet" if bond == "facet" else wd.EVMBond(1.0, 1.0, 1.0)
        body = scene.add(p, m, bond=kind, facet_bending=bond == "facet")
        body.linked[:] = False
        scene.add(ball(np.array([9.0, 9.0]), 0.5), OTHER if m is SOFT else SOFT)
        scene.hold(body, [0])
        scene.hold(body, [1], velocity=[0.0, 1e-3])
        body.displacement[1, 0] = -1e-4
        scene.contact(friction=0.1, pairs={(OTHER, OTHER): 0.6})
        sim = wd.Simulation(scene, dt=0.01)
        sim.run(steps=100)
        x, f = sim.position, sim.force[1]
        n = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
        if bond == "facet":
            n = np.array([1.0, 0.0])
        found[name] = np.linalg.norm(f - (f @ n) * n) / (f @ n)
    assert found == pytest.approx({"a": 0.1, "b": 0.6}, rel=1e-9)


def test_rate_and_state_of_one_material_on_a_wall():
    law = wd.RateAndState(mu0=0.4, a=0.01, b=0.015, V0=1e-3, Dc=1e-2)
    scene = wd.Scene()
    for n, m in enumerate((SOFT, OTHER)):
        body = scene.add(ball(np.array([3.0 * n, 0.499]), 0.5), m)
        scene.hold(body, [0], velocity=[law.V0, 0.0])
    scene.contact(friction=0.1)
    wall = scene.wall([0.0, 0.0], [0.0, 1.0], friction={OTHER: law})
    sim = wd.Simulation(scene, dt=0.05)
    sim.run(until=60.0)
    f = sim.force
    assert -f[:, 0] / f[:, 1] == pytest.approx([0.1, 0.4], rel=1e-3)
    assert sim.wall_force(wall) == pytest.approx(-f.sum(axis=0))


def test_only_scenes_that_tell_materials_apart_have_tables():
    names = {"contact_kind", "friction_table"}
    assert not names & heap(friction=0.3)._step.arrays.keys()
    assert names <= heap(pairs={(SOFT, SOFT): 0.3})._step.arrays.keys()


def test_bad_pairs_are_refused():
    scene = wd.Scene()
    with pytest.raises(wd.InputError, match="give pairs of materials"):
        scene.contact(pairs={SOFT: 0.3})
    with pytest.raises(wd.InputError, match="two laws for one pair"):
        scene.contact(pairs={(SOFT, OTHER): 0.3, (OTHER, SOFT): 0.4})
    with pytest.raises(wd.InputError, match="which no body is of"):
        heap(pairs={(SOFT, OTHER): 0.3})
    scene.add(ball(np.zeros(2), 0.5), SOFT)
    scene.contact()
    with pytest.raises(wd.InputError, match="by materials"):
        scene.wall([0.0, -1.0], [0.0, 1.0], friction={"steel": 0.3})


def test_welding_refuses_friction_with_a_state_anywhere():
    law = wd.RateAndState(mu0=0.4, a=0.01, b=0.015, V0=1e-3, Dc=1e-2)
    scene = wd.Scene()
    scene.add(ball(np.zeros(2), 0.5), SOFT)
    scene.contact(welding=wd.Welding(1e-2, pressure=1e-3))
    scene.wall([0.0, -0.5], [0.0, 1.0], friction=law)
    with pytest.raises(wd.InputError, match="welding is for Coulomb's friction"):
        wd.Simulation(scene, dt=0.1)


def test_dashpots_and_rolling_go_on_from_a_checkpoint(tmp_path):
    given = {"friction": 0.3, "rolling_friction": 0.1, "restitution": 0.3}
    given |= {"restitution_by": "dashpot", "pairs": {(SOFT, SOFT): 0.2}}
    sim = heap(**given)
    while not len(sim.contacts):
        sim.run(steps=20)
    sim.run(steps=40)
    sim.save(tmp_path / "heap.npz")
    again = wd.resume(tmp_path / "heap.npz", heap(**given).scene)
    for one in (sim, again):
        one.run(steps=400)
    assert np.array_equal(sim.displacement, again.displacement)
    assert sim.energy() == again.energy()

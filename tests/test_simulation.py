import numpy as np
import pytest
import warp as wp

import warpdem as wd
from warpdem.kernels import memory
from warpdem.validation import core

SOFT = wd.Material(1.0, 0.3, 1.0)


def vibrating(precision="float64", bond="facet", shape="hex strain", **options):
    """A free body in random motion."""
    p = core.small_packing(shape)
    scene = wd.Scene()
    body = scene.add(p, SOFT, bond=bond)
    rng = np.random.default_rng(0)
    scene.set_velocity(body, 1e-5 * rng.normal(size=p.position.shape))
    return wd.Simulation(scene, precision=precision, **options)


def breaking(**options):
    """A body that tears itself apart, every bond breakable."""
    p = core.small_packing("voronoi strain")
    scene = wd.Scene()
    body = scene.add(p, SOFT, fracture=wd.Rankine(2e-3))
    x = p.position - p.position.mean(axis=0)
    scene.set_velocity(body, 0.01 * np.sign(x))
    return wd.Simulation(scene, **options)


class Counter:
    def __init__(self, every):
        self.every, self.seen, self.finished = every, [], 0

    def observe(self, sim):
        self.seen.append(sim.steps)

    def finish(self, sim):
        self.finished += 1


def test_observers_are_called_in_time():
    sim = vibrating()
    counter = sim.observe(Counter(7))
    sim.run(steps=20)
    sim.run(steps=3)
    assert counter.seen == [0, 7, 14, 21]
    assert counter.finished == 2


@pytest.mark.parametrize("make", [vibrating, breaking])
def test_observing_changes_no_bit(make):
    alone, watched = make(), make()
    watched.observe(Counter(1))
    alone.run(steps=60)
    watched.run(steps=60)
    for name in ("displacement", "orientation", "velocity", "angular_velocity"):
        a, b = getattr(alone, name), getattr(watched, name)
        if make is vibrating:
            assert np.array_equal(a, b), name
        else:  # a break between two halves of a kick rounds once more
            assert np.abs(a - b).max() <= 1e-14 * np.abs(a).max(), name


def test_runs_repeat_to_the_bit():
    one, two = breaking(), breaking()
    one.run(steps=80)
    two.run(steps=80)
    assert len(one.broken_bonds()) > 10
    assert np.array_equal(one.displacement, two.displacement)
    assert np.array_equal(one.broken_bonds(), two.broken_bonds())


@pytest.mark.parametrize("shape", ["hex strain", "fcc", "voronoi space"])
def test_vectorised_and_plain_loops_agree(shape):
    fast, plain = vibrating(shape=shape), vibrating(shape=shape, simd=False, dt=None)
    for sim in (fast, plain):
        sim.run(steps=50)
    assert (
        np.abs(fast.displacement - plain.displacement).max()
        < 1e-11 * np.abs(plain.displacement).max()
    )


def test_without_the_known_template_everything_still_runs(monkeypatch):
    import warp._src.codegen as codegen

    monkeypatch.setattr(codegen, "cpu_module_template_forward", "unknown")
    assert not memory.is_patched.__wrapped__()


@pytest.mark.parametrize("bond", ["facet", wd.EVMBond(1.0, 0.6, 0.1)], ids=["facet", "evm"])
def test_undamped_body_keeps_its_energy(bond):
    sim = vibrating(bond=bond)
    sim.run(steps=3000)
    # the integrator's own term is exact in a linear body; strains are about 1e-5 here
    assert abs(sim.energy_error) < 1e-5
    assert sim.energy()["kinetic"] > 0.0


def test_ledger_closes_while_everything_breaks():
    sim = breaking()
    sim.run(steps=300)
    ledger = sim.energy()
    assert len(sim.broken_bonds()) > 50
    assert ledger["fracture"] > 0.0
    assert abs(sim.energy_error) < 2e-3  # linear to about 1 %: the integrator's term is exact there


def test_ledger_starts_anew_after_breaks():
    sim = breaking()
    sim.run(steps=100)
    assert sim.energy()["fracture"] > 0.0
    sim.set_state(velocity=0.5 * sim.velocity)
    assert sim.energy()["residual"] == 0.0


@pytest.mark.parametrize("volume", [False, True], ids=["pair", "hybrid"])
def test_evm_bonds_break_and_their_ledger_closes(volume):
    p = core.small_packing("hex strain")
    scene = wd.Scene()
    bond = wd.EVMBond(0.45, 0.45, 0.02, offset=0.1)
    body = scene.add(p, SOFT, bond=bond, volume=volume, fracture=wd.Rankine(2e-4))
    scene.set_velocity(body, 1e-3 * np.sign(p.position - p.position.mean(axis=0)))
    sim = wd.Simulation(scene)
    sim.run(steps=300)
    log = sim.broken_bonds()
    assert len(log) > 20
    assert log["released_energy"].sum() == pytest.approx(sim.energy()["fracture"])
    assert abs(sim.energy_error) < 1e-3
    # a broken bond pulls no more
    broken = ~sim.linked
    along = (sim.bond_force[broken] * (sim.position[sim.bonds[broken, 1]]
             - sim.position[sim.bonds[broken, 0]])).sum(axis=1)  # fmt: skip
    assert (along <= 1e-12).all()


@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_unlinked_evm_bond_is_the_derivative_of_its_energy(offset):
    p = wd.packing.network([[0, 0, 0], [1.0, 0, 0]], [[0, 1]], 1.0)
    scene = wd.Scene()
    body = scene.add(p, SOFT, bond=wd.EVMBond(2.0, 1.0, 1.0, 1.0, offset=offset))
    scene.cut(body, (0.5, -1, 0), (0.5, 1, 0), depth=(0, 0, 1.0))
    sim = wd.Simulation(scene, dt=0.1)
    rng = np.random.default_rng(2)
    u = np.array([[0.0, 0, 0], [-0.2, 0.05, 0.03]])
    q = core.random_orientation(rng, 2, 3, 0.1)

    def contact(displacement, orientation):
        sim.set_state(displacement=displacement, orientation=orientation)
        return sim.energy()["contact"]

    assert contact(u, q) > 0.0
    force, torque = sim.force.copy(), sim.torque.copy()
    h = 1e-6
    for i in (0, 1):
        for axis in range(3):
            step = np.zeros((2, 3))
            step[i, axis] = h
            slope = -(contact(u + step, q) - contact(u - step, q)) / (2 * h)
            assert slope == pytest.approx(force[i, axis], abs=1e-8)
            ends = [core.turned(q, axis, s * h, slice(i, i + 1)) for s in (1, -1)]
            slope = -(contact(u, ends[0]) - contact(u, ends[1])) / (2 * h)
            assert slope == pytest.approx(torque[i, axis], abs=1e-8)


def test_ledger_counts_the_work_of_grips_and_tractions():
    p = wd.packing.hexagonal((6, 10), 1.0)
    for load in ("grip", "traction"):
        scene = wd.Scene()
        body = scene.add(p, SOFT)
        scene.hold(body, p.bottom)
        if load == "grip":
            scene.hold(body, p.top, velocity=(0.0, 1e-4))
        else:
            scene.pull(body, p.top, (0.0, 1e-4))
        sim = wd.Simulation(scene)
        sim.run(steps=500)
        assert sim.energy()["work"] > 0.0
        assert abs(sim.energy_error) < 1e-5, load


def test_traction_stretches_by_hooke():
    p = wd.packing.hexagonal((6, 24), 1.0, plane="stress")
    scene = wd.Scene()
    body = scene.add(p, SOFT)
    scene.hold(body, p.bottom, axes="y", rotation=False)
    scene.hold(body, [2], axes="x")
    scene.pull(body, p.top, (0.0, 1e-4))
    sim = wd.Simulation(scene)
    period = 4 * 24 / np.sqrt(SOFT.young / SOFT.density)
    mean, count = 0.0, 0
    while sim.time < 4 * period:  # the mean of whole periods is the static answer
        sim.run(steps=20)
        mean, count = mean + sim.stress[~p.boundary()].mean(axis=0), count + 1
    assert mean[1, 1] / count == pytest.approx(1e-4, rel=0.05)
    assert abs(mean[0, 0]) / count < 1e-5


def test_held_elements_keep_still_and_moved_ones_move():
    p = wd.packing.hexagonal((6, 6), 1.0)
    scene = wd.Scene()
    body = scene.add(p, SOFT)
    scene.hold(body, p.bottom)
    scene.hold(body, p.top, velocity=(0.0, 1e-3))
    sim = wd.Simulation(scene)
    sim.run(steps=100)
    assert not sim.displacement[p.bottom].any()
    assert sim.displacement[p.top] == pytest.approx(
        np.tile([0.0, 1e-3 * sim.time], (p.top.sum(), 1)), rel=1e-12
    )


def test_dt_is_four_fifths_of_the_limit():
    sim = vibrating()
    assert sim.dt == pytest.approx(0.8 * sim.dt_limit)
    with pytest.raises(wd.InputError, match="above the stability limit"):
        vibrating(dt=1.01 * sim.dt_limit)
    assert vibrating(dt=1.01 * sim.dt_limit, force_dt=True).dt > sim.dt_limit


def test_limit_of_a_pair_is_exact():
    # two masses 1 on a spring c: omega^2 = 2c
    p = wd.packing.network([[0, 0, 0], [1.0, 0, 0]], [[0, 1]], 1.0, radius=100.0)
    scene = wd.Scene()
    scene.add(p, SOFT, bond=wd.EVMBond(5.0, 0.0, 1e-9))
    assert wd.Simulation(scene).dt_limit == pytest.approx(2 / np.sqrt(2 * 5.0), rel=1e-6)


def test_guard_names_element_step_and_dt():
    sim = vibrating(dt=100.0, force_dt=True)
    counter = sim.observe(Counter(1000))
    with pytest.raises(wd.NonFiniteError, match=r"elements .* at step .*dt 100"):
        sim.run(steps=20000)
    assert counter.finished == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"precision": "half"}, "'float64', 'float32', 'mixed'"),
        ({"device": "cuda:7"}, "this machine has cpu"),
        ({"dt": 0.0}, "greater than zero"),
        ({"dt": -1.0}, "greater than zero"),
        ({"dt": np.nan}, "not finite"),
    ],
)
def test_bad_options_are_refused(options, says):
    with pytest.raises(wd.InputError, match=says):
        vibrating(**options)


def test_bad_runs_are_refused():
    sim = vibrating()
    for bad in ({}, {"until": 1.0, "steps": 1}, {"steps": -1}, {"until": np.nan}):
        with pytest.raises(wd.InputError):
            sim.run(**bad)
    with pytest.raises(wd.InputError, match="every is 0"):
        sim.observe(Counter(0))
    q = sim.orientation
    q[3] = 0.0
    with pytest.raises(wd.InputError, match="unit length at 3"):
        sim.set_state(orientation=q)


def test_log_tells_how_each_bond_broke():
    sim = breaking()
    sim.run(steps=200)
    log = sim.broken_bonds()
    pairs = sim.bonds[log["bond"]]
    assert np.array_equal(pairs[:, 0], log["i"])
    assert (np.diff(log["step"]) >= 0).all()
    assert log["time"] == pytest.approx(log["step"] * sim.dt)
    assert set(log["mode"]) <= {"normal", "shear"}
    assert len(log) == (~sim.linked).sum()
    assert log["released_energy"].sum() == pytest.approx(sim.energy()["fracture"])


def test_unneeded_arrays_do_not_exist():
    plain = wd.Scene()
    plain.add(core.small_packing("hex strain"), wd.Material(1.0, 0.0, 1.0))
    names = set(wd.Simulation(plain)._step.arrays)
    for absent in ("bond_linked", "volume_stress", "stress", "external_force", "break_step"):
        assert absent not in names


def test_plane_costs_three_degrees_of_freedom_an_element():
    for shape, expected in (("hex strain", 3), ("fcc", 6)):
        sim = vibrating(shape=shape)
        assert sim.velocity.shape[1] + sim.angular_velocity.shape[1] == expected


def test_two_bodies_of_both_papers_side_by_side():
    lattice = core.small_packing("hex strain")
    x = np.array([[20.0, 0], [21, 0], [22, 0]])
    # a chain with faces, so that both bodies may share a scene with volume terms
    half = np.array([[[0.5, 0], [-0.5, 0]]] * 2)
    chain = wd.Packing(x, np.ones(3), np.array([[0, 1], [1, 2]]), np.ones(2), half, plane="strain")
    scene = wd.Scene()
    rod = scene.add(chain, SOFT, bond=wd.EVMBond(1.0, 0.5, 0.1))
    block = scene.add(lattice, SOFT)
    scene.set_velocity(rod, [[-1e-5, 0], [0, 1e-5], [1e-5, 0]])
    scene.set_velocity(block, 1e-5 * np.random.default_rng(1).normal(size=lattice.position.shape))
    sim = wd.Simulation(scene)
    sim.run(steps=500)
    assert abs(sim.energy_error) < 1e-5
    alone = wd.Scene()
    body = alone.add(chain, SOFT, bond=wd.EVMBond(1.0, 0.5, 0.1))
    alone.set_velocity(body, [[-1e-5, 0], [0, 1e-5], [1e-5, 0]])
    single = wd.Simulation(alone, dt=sim.dt)
    single.run(steps=500)
    assert np.abs(single.displacement - sim.displacement[sim.elements(rod)]).max() < 1e-15


def bouncing(bond, dt_share):
    """Two halves of a cut body thrown at each other; no other bond between them."""
    p = wd.packing.hexagonal((3, 4 * np.sqrt(3)), 1.0)
    scene = wd.Scene()
    body = scene.add(p, SOFT, bond=bond)
    height = 4 * np.sqrt(3) / 2
    scene.cut(body, (-1, height), (5, height))
    upper = p.position[:, 1] > height
    scene.set_velocity(body, (0.0, -1e-5), where=upper)
    limit = wd.Simulation(scene).dt_limit
    return wd.Simulation(scene, dt=dt_share * limit), upper


@pytest.mark.parametrize("share", [0.2, 0.8])
@pytest.mark.parametrize("bond", ["facet", wd.EVMBond(1.0, 0.6, 0.1)], ids=["facet", "evm"])
def test_halves_bounce_without_gain_or_loss(bond, share):
    sim, upper = bouncing(bond, share)
    momentum = (sim.model.mass[:, None] * sim.velocity).sum(axis=0)
    sim.run(steps=400)
    mean = sim.velocity[upper].mean(axis=0)[1]
    assert mean > -1e-6  # it came back, or what it had went into the other half
    assert abs(sim.energy_error) < 1e-4
    after = (sim.model.mass[:, None] * sim.velocity).sum(axis=0)
    assert after == pytest.approx(momentum, abs=1e-12 * np.abs(momentum).max())


def test_closing_pairs_do_not_meet_the_traction_twice():
    # impulses of closing pairs are applied without the external force
    p = wd.packing.hexagonal((6, 8), 1.0)
    scene = wd.Scene()
    body = scene.add(p, SOFT)
    scene.hold(body, p.bottom)
    scene.cut(body, (1.2, 4 * np.sqrt(3) / 2), (4.6, 4 * np.sqrt(3) / 2))
    scene.pull(body, p.top, (0.0, -1e-6))
    sim = wd.Simulation(scene)
    sim.run(steps=2000)
    assert sim.energy()["contact"] > 0.0
    assert abs(sim.energy_error) < 1e-4


def test_bound_is_never_above_the_limit():
    for shape in ("hex strain", "voronoi strain", "fcc"):
        sim = vibrating(shape=shape)
        assert 0.0 < sim.dt_bound <= sim.dt_limit


@pytest.mark.gpu
def test_gpu_agrees_with_cpu():
    cpu, gpu = breaking(), breaking(device="cuda")
    for sim in (cpu, gpu):
        sim.run(steps=40)
    wp.synchronize()
    assert np.abs(cpu.displacement - gpu.displacement).max() < 1e-9

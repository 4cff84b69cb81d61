"""What EVM scenes have beside their law: trouble told once, damping, statics, moduli."""

import warnings

import numpy as np
import pytest

import warpdem as wd

UNIT = wd.Material(1.0, 0.0, 1.0)


def pair(bond):
    scene = wd.Scene()
    body = scene.add(
        wd.packing.network([[0, 0, 0], [1, 0, 0]], [[0, 1]], 1.0, radius=0.5), UNIT, bond=bond
    )
    return scene, body


def test_trouble_is_told_once_with_ids_and_angle():
    scene, body = pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1))
    scene.hold(body, [0])
    scene.hold(body, [1], angular_velocity=[0.01, 0, 0])
    sim = wd.Simulation(scene, dt=0.1)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sim.run(steps=2000)
    messages = [str(w.message) for w in told if issubclass(w.category, wd.ModelWarning)]
    assert len(messages) == 1
    assert "0 (elements 0 and 1) by 63 deg" in messages[0] and "twisted" in messages[0]
    log = sim.troubled_bonds()
    assert log["kind"].tolist() == ["twisted"] and log["value"][0] == pytest.approx(1.1, abs=0.11)
    stopping = wd.Simulation(scene, dt=0.1, trouble="stop")
    with pytest.raises(wd.TroubledBondError, match="twisted"):
        stopping.run(steps=2000)
    scene, body = pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1, large_rotation=True))
    scene.hold(body, [0])
    scene.hold(body, [1], angular_velocity=[0.01, 0, 0])
    sim = wd.Simulation(scene, dt=0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.run(steps=2000)  # to 2 rad


def test_bending_limit_is_where_the_moment_is_greatest():
    from warpdem.trouble import bend_limit

    # theory A5: 115.2, 90, 51.1 and 45 degrees for B2/c_B = 12 (Bernoulli-Euler), 4, 1 and 0
    bonds = [wd.EVMBond(1.0, b2, 1.0).parameters(np.ones(1))[0] for b2 in (12.0, 4.0, 1.0, 0.0)]
    limit = np.degrees(bend_limit(np.array(bonds)))
    assert limit == pytest.approx([115.2, 90.0, 51.1, 45.0], abs=0.06)


def test_crushed_bonds_are_told():
    sim = wd.Simulation(pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1))[0])
    with pytest.warns(wd.ModelWarning, match=r"crushed.*to 0\.05 of its length"):
        sim.set_state(displacement=[[0, 0, 0], [-0.95, 0, 0]])


def test_only_what_a_scene_needs():
    plain = wd.Simulation(pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1))[0])
    arrays = set(plain._step.arrays)
    assert not arrays & {
        *("evm_dashpot", "damping_force", "damping_torque", "damped_energy"),
        *("principal_moment", "principal_axes", "external_force", "external_torque"),
        *("element_work", "relaxing_mix"),
    }
    damped = wd.Simulation(pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1, damping=0.1))[0])
    assert len(plain._step._start.launches) == 2  # move, evm_forces
    assert len(damped._step._start.launches) == 4  # evm_dashpots, damp
    local = wd.Simulation(pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1))[0], local_damping=0.7)
    assert len(local._step._start.launches) == 3
    assert "damping_force" not in local._step.arrays


def test_dashpots_bound_the_time_step():
    limits = [
        wd.Simulation(pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1, damping=d))[0]).dt_limit
        for d in (0.0, 0.1, 3.0)
    ]
    assert limits[0] == limits[1] > 2 * limits[2]


def test_grip_that_turns_does_the_work_it_should():
    section = wd.Circle(0.1)
    rod = wd.packing.filament([[0, 0, 0], [1, 0, 0]], 8, section)
    steel = wd.Material(1.0, 0.3, 1.0)
    scene = wd.Scene()
    body = scene.add(rod, steel, bond=wd.EVMBond.timoshenko(steel, section, rod.bond_length))
    scene.hold(body, rod.side("start"))
    scene.hold(body, rod.side("end"), angular_velocity=[0.001, 0, 0])
    sim = wd.Simulation(scene)
    sim.run(until=100.0)
    ledger = sim.energy()
    stiffness = steel.shear_modulus * section.torsion_constant
    assert ledger["work"] == pytest.approx(0.5 * stiffness * 0.1**2, rel=0.05)
    assert abs(ledger["residual"]) < 1e-6 * ledger["work"]


def test_torque_does_work():
    scene, body = pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1))
    scene.load(body, [1], torque=[0.001, 0, 0])
    sim = wd.Simulation(scene, dt=0.02)
    sim.run(until=10.0)
    assert sim.energy()["work"] > 1e-6
    assert abs(sim.energy_error) < 1e-6


def test_statics_say_what_is_wrong():
    scene, body = pair(wd.EVMBond(1.0, 1.0, 0.2, 0.1))
    scene.load(body, [1], force=[0.1, 0, 0])
    free = wd.Simulation(scene)
    with pytest.raises(wd.NotConvergedError, match="hold"):
        free.equilibrate()
    scene.hold(body, [0])
    with pytest.raises(wd.NotConvergedError, match="max_steps"):
        wd.Simulation(scene).relax(max_steps=20, tolerance=1e-9)
    with pytest.raises(wd.InputError, match="float64"):
        wd.Simulation(scene, precision="float32").equilibrate()
    held = wd.Simulation(scene)
    told = []
    assert held.equilibrate(tell=lambda n, r: told.append(r)) <= 1e-8
    assert told[-1] <= 1e-8
    assert held.displacement[1, 0] == pytest.approx(0.1)
    relaxed = wd.Simulation(scene, precision="float32")
    relaxed.relax(tolerance=1e-4)
    assert relaxed.displacement[1, 0] == pytest.approx(0.1, rel=1e-3)
    assert relaxed.time == 0.0


def test_natural_frequencies_of_a_pair():
    sim = wd.Simulation(pair(wd.EVMBond(1.0, 0.4, 0.05, 0.04))[0])
    found = sim.natural_frequencies(12)
    assert np.abs(found[:6]).max() < 1e-4  # rigid motions
    # m_eff = 1/2, J_eff = 1/20: stretch sqrt(2), twist sqrt(.04/.05), bending sqrt(.05/.05) twice
    for exact in (np.sqrt(2.0), np.sqrt(0.8), 1.0):
        assert np.abs(found - exact).min() < 1e-8


def test_unreachable_poisson_ratios_name_the_way_out():
    fcc = wd.packing.fcc((5, 5, 5), 1.0, neighbours=2)
    with pytest.raises(wd.InputError, match="facet"):
        wd.lattice_bond(fcc, wd.Material(1.0, 0.26, 1.0))
    sheet = wd.packing.hexagonal((6, 6), 1.0, plane="stress")
    assert wd.lattice_bond(sheet, wd.Material(1.0, 0.33, 1.0)).shear is not None
    with pytest.raises(wd.InputError, match="facet"):
        wd.lattice_bond(sheet, wd.Material(1.0, 0.34, 1.0))
    nearest = wd.packing.fcc((5, 5, 5), 1.0)
    with pytest.raises(wd.InputError, match="neighbours=2"):
        wd.lattice_bond(nearest, wd.Material(1.0, 0.2, 1.0))
    cell = wd.packing.voronoi((12, 12), 1.0, periodic=True)
    lines = []
    with pytest.raises(wd.InputError, match="facet"):
        wd.calibrate(cell, wd.Material(1.0, 0.4, 1.0), tell=lines.append)
    assert lines and "relaxation 1" in lines[0]


@pytest.mark.parametrize("poisson", [-0.3, 0.0, 0.2, 0.25])
@pytest.mark.parametrize("name", ["hexagonal", "square", "simple_cubic", "bcc", "fcc"])
def test_lattice_bonds_both_ways(name, poisson):
    size = (9.0, 9.0) if name in ("hexagonal", "square") else (5.0, 5.0, 5.0)
    p = getattr(wd.packing, name)(size, 1.0, neighbours=1 if name == "hexagonal" else 2)
    wanted = wd.Material(7.0, poisson, 1.0)
    found = wd.lattice_moduli(p, wd.lattice_bond(p, wanted))
    assert found.young == pytest.approx(7.0) and found.poisson == pytest.approx(poisson, abs=1e-12)
    assert found.anisotropy < 1e-12


def cantilever(dim=3, bonds=8, **more):
    section, steel = wd.Circle(0.005), wd.Material(210e9, 0.3, 7850)
    rod = wd.packing.filament([[0] * dim, [0.5] + [0] * (dim - 1)], bonds, section)
    scene = wd.Scene()
    bond = wd.EVMBond.timoshenko(steel, section, rod.bond_length, **more)
    body = scene.add(rod, steel, bond=bond)
    scene.hold(body, rod.side("start"))
    scene.load(body, rod.side("end"), force=[0, -40.0] + [0] * (dim - 2))
    return scene, body


@pytest.mark.parametrize("dim", [2, 3])
def test_dashpots_and_local_damping_together_only_take(dim):
    sim = wd.Simulation(cantilever(dim, 16, damping=0.05)[0], local_damping=0.7)
    most = 0.0
    for _ in range(20):
        sim.run(steps=25)
        most = max(most, sim.energy()["kinetic"] + sim.energy()["pair"])
    assert most < 1.0  # J; at rest it holds 0.3
    assert abs(sim.energy_error) < 1e-6


def test_rest_is_rest():
    scene, _ = cantilever()
    sim = wd.Simulation(scene)
    sim.run(steps=500)
    sim.equilibrate()
    assert np.abs(sim.velocity).max() == 0.0


def test_a_failed_search_leaves_loads_and_books():
    scene, body = cantilever()
    body.held[:] = False
    body.held_rotation[:] = False
    scene.hold(body, [0], axes="y", rotation=False)  # free to turn and slide
    sim = wd.Simulation(scene)
    with pytest.raises(wd.NotConvergedError):
        sim.equilibrate(load_steps=4)
    assert sim._step.download("external_force")[-1, 1] == -40.0
    scene, _ = cantilever()
    sim = wd.Simulation(scene)
    with pytest.raises(wd.NotConvergedError):
        sim.relax(max_steps=50)
    sim.run(steps=100)
    assert abs(sim.energy_error) < 1e-3


def test_set_state_keeps_grips_and_is_whole():
    sim = wd.Simulation(cantilever()[0])
    sim.set_state(velocity=np.full((9, 3), 0.1))
    assert np.abs(sim.velocity[0]).max() == 0.0 and sim.velocity[1, 0] == 0.1
    before = sim.displacement
    with pytest.raises(wd.InputError, match="velocity has shape"):
        sim.set_state(displacement=np.ones((9, 3)), velocity=[1.0])
    assert np.array_equal(sim.displacement, before)


def test_looking_at_frequencies_changes_nothing():
    runs = []
    for looks in (False, True):
        sim = wd.Simulation(cantilever()[0])
        sim.run(steps=100)
        if looks:
            sim.natural_frequencies(2)
        sim.run(steps=100)
        runs.append(sim.displacement)
    assert np.array_equal(*runs)


def test_local_damping_never_gives_energy_to_flat_bodies():
    body = wd.packing.network(
        [[0.0, 0.0, 0.0]], [], 1.0, gyration=np.sqrt([[0.02, 1.0, 1.0]])
    )  # fmt: skip
    scene = wd.Scene()
    added = scene.add(body, UNIT, wd.EVMBond(1.0, 0.0, 0.0))
    scene.load(added, [0], torque=[-1.0, 0.0, 0.0])
    scene.set_velocity(added, [0.0, 0.0, 0.0], [0.001, 0.0, 0.0])
    sim = wd.Simulation(scene, dt=1e-2, local_damping=0.5)
    sim.run(steps=1)
    assert sim.energy()["damping"] >= 0.0


def test_a_grips_spin_has_its_shape():
    scene, body = pair(wd.EVMBond(1.0, 1.0, 1.0))
    for wrong in ([1.0, 2.0], 1.0):
        with pytest.raises(wd.InputError, match="angular_velocity has shape"):
            scene.hold(body, [0], angular_velocity=wrong)


def test_what_no_one_holds_has_no_place_of_rest():
    scene = wd.Scene()
    body = scene.add(
        wd.packing.network([[0, 0, 0], [1, 0, 0]], [[0, 1]], 1.0), UNIT, wd.EVMBond(1, 1, 1)
    )
    scene.load(body, [1], force=[1.0, 0, 0])
    with pytest.raises(wd.NotConvergedError, match="along x, where nothing is held"):
        wd.Simulation(scene).relax()

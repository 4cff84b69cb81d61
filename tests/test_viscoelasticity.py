import numpy as np
import pytest

import warpdem as wd
from warpdem.validation import core

SOFT = wd.Material(1.0, 0.3, 1.0)
LAWS = {
    "prony": wd.Prony((0.5, 0.3), (5.0, 40.0)),
    "kelvin_voigt": wd.KelvinVoigt(0.5),
}
# what only scenes with branches, and only scenes with Kelvin and Voigt's dashpots, have
BRANCHES = {"mean_creep", "facet_creep", "remember_openings", "creep_books"}
DASHPOTS = {"opening_rates", "mean_rates", "facet_dashpots", "trial_kick", "retarded_volume"}


def scene_of(shape="hex strain", **options):
    p = core.small_packing(shape)
    scene = wd.Scene()
    body = scene.add(p, SOFT, **options)
    rng = np.random.default_rng(0)
    scene.set_velocity(body, 1e-5 * rng.normal(size=p.position.shape))
    return scene


def launched(sim):
    step = sim._step
    passes = [step._start, step._finish_and_start]
    return {launch.kernel.func.__name__ for x in passes for launch in x.launches}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: wd.Prony((0.5,), (1.0, 2.0)), "1 shares and 2 times"),
        (lambda: wd.Prony((), ()), "0 shares and 0 times"),
        (lambda: wd.Prony((0.5, 0.6), (1.0, 2.0)), "sum up to 1.1"),
        (lambda: wd.Prony((0.5, -0.1), (1.0, 2.0)), "shares must be greater than zero at 1"),
        (lambda: wd.Prony((0.5,), (np.inf,)), "times is not finite at 0"),
        (lambda: wd.Maxwell(0.0), "time must be greater than zero"),
        (lambda: wd.StandardLinearSolid(1.5, 1.0), "share is 1.5"),
        (lambda: wd.StandardLinearSolid(0.5, -1.0), "time must be greater than zero"),
        (lambda: wd.KelvinVoigt(-1.0), "time must be greater than zero"),
    ],
)
def test_laws_refuse(make, message):
    with pytest.raises(wd.InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"viscous": 3.0}, "viscous is one law"),
        ({"viscous": [wd.Maxwell(1.0), None]}, "each of the 1 materials"),
        ({"viscous": wd.Maxwell(1.0), "volume": False}, "needs the volume term"),
        (
            {"viscous": wd.Maxwell(1.0), "bond": wd.EVMBond(1.0, 1.0, 1.0), "volume": True},
            "EVM bonds have dashpots",
        ),
        ({"viscous": wd.Maxwell(1.0), "yielding": wd.VonMises(1.0)}, "not both"),
    ],
)
def test_scenes_refuse(options, message):
    with pytest.raises(wd.InputError, match=message):
        scene_of(**options)


def test_a_viscous_body_beside_one_that_yields_is_refused():
    scene = scene_of(yielding=wd.VonMises(1.0))
    with pytest.raises(wd.InputError, match="not both"):
        scene.add(core.small_packing("hex strain"), SOFT, viscous=wd.Maxwell(1.0))


def test_irregular_cells_are_refused():
    cells = wd.packing.voronoi((6.0, 6.0, 6.0), 1.0, seed=0, relaxations=0)
    scene = wd.Scene()
    scene.add(cells, SOFT, viscous=wd.Maxwell(1.0))
    with pytest.raises(wd.InputError, match="too irregular for a viscous law"):
        wd.Simulation(scene)


def test_kelvin_voigt_refuses_a_negative_ratio():
    scene = wd.Scene()
    p = core.small_packing("hex strain")
    scene.add(p, wd.Material(1.0, -0.2, 1.0), viscous=wd.KelvinVoigt(1.0))
    with pytest.raises(wd.InputError, match=r"Poisson's ratio of 0 or above"):
        wd.Simulation(scene)


def test_only_scenes_that_creep_have_its_passes_and_arrays():
    elastic = wd.Simulation(scene_of())
    assert not launched(elastic) & (BRANCHES | DASHPOTS)
    names = {"branch_slip", "bond_slip", "last_opening", "rate_viscosity", "damping_force"}
    assert not names & elastic._step.arrays.keys()
    fluid = wd.Simulation(scene_of(viscous=LAWS["prony"]))
    assert launched(fluid) >= BRANCHES - {"remember_openings"}
    assert not launched(fluid) & DASHPOTS
    assert "damping_force" not in fluid._step.arrays
    solid = wd.Simulation(scene_of(viscous=LAWS["kelvin_voigt"]))
    assert launched(solid) >= DASHPOTS
    assert not launched(solid) & BRANCHES
    assert "branch_slip" not in solid._step.arrays


def test_no_relaxation_is_elastic():
    """A branch that never relaxes leaves the motion as it was."""
    elastic = wd.Simulation(scene_of("voronoi strain"))
    law = wd.StandardLinearSolid(0.7, 1e15)
    slow = wd.Simulation(scene_of("voronoi strain", viscous=law))
    for sim in (elastic, slow):
        sim.run(steps=200)
    size = np.abs(elastic.displacement).max()
    assert np.abs(slow.displacement - elastic.displacement).max() < 1e-11 * size


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_observing_and_repeating_change_no_bit(law):
    runs = [wd.Simulation(scene_of("fcc", viscous=law)) for _ in range(2)]
    runs[0].run(steps=40)
    for _ in range(8):
        runs[1].run(steps=5)
        runs[1].energy()
    assert np.array_equal(runs[0].displacement, runs[1].displacement)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_vectorised_and_plain_loops_agree(law):
    fast, plain = (
        wd.Simulation(scene_of("voronoi strain", viscous=law), simd=simd) for simd in (True, False)
    )
    for sim in (fast, plain):
        sim.run(steps=50)
    size = np.abs(plain.displacement).max()
    assert np.abs(fast.displacement - plain.displacement).max() < 1e-11 * size


def test_books_start_anew_with_a_state():
    sim = wd.Simulation(scene_of("voronoi stress", viscous=LAWS["prony"]))
    sim.run(steps=50)
    assert sim.energy()["viscous"] > 0.0
    sim.set_state(displacement=0.5 * sim.displacement)
    assert sim.energy()["residual"] == 0.0
    before = sum(sim.energy()[k] for k in ("kinetic", "pair", "volume"))
    sim.run(steps=200)
    assert abs(sim.energy()["residual"]) < 1e-6 * before


def test_a_solid_of_kelvin_and_voigt_rests_where_its_spring_does():
    """Dashpots have no part in a place of rest, nor in natural frequencies."""
    found = []
    for law in (None, wd.KelvinVoigt(2.0)):
        p = core.small_packing("voronoi stress")
        scene = wd.Scene()
        body = scene.add(p, SOFT, viscous=law)
        scene.hold(body, p.bottom)
        scene.pull(body, p.top, (1e-4, 2e-4))
        sim = wd.Simulation(scene)
        sim.equilibrate()
        found.append((sim.displacement, sim.natural_frequencies(3)))
        rest = sim.displacement
        sim.run(steps=100)
        assert np.abs(sim.displacement - rest).max() < 1e-6 * np.abs(rest).max()
    for elastic, viscous in zip(*found, strict=True):
        assert np.allclose(viscous, elastic, rtol=1e-6)


def test_what_flows_too_far_is_told_once():
    p = wd.packing.hexagonal((6.0, 6.0), 1.0)
    scene = wd.Scene()
    body = scene.add(p, SOFT, viscous=wd.Maxwell(1.0))
    x = p.position - 3.0
    scene.hold(body, np.arange(len(p)), np.stack([0.02 * x[:, 1], 0.0 * x[:, 0]], axis=1))
    sim = wd.Simulation(scene, dt=0.1, force_dt=True)
    with pytest.warns(wd.ModelWarning, match="have crept by more than") as told:
        sim.run(until=60.0)
    assert len(told) == 1
    log = sim.troubled_bonds()
    assert set(log["kind"]) == {"crept"}
    assert (log["value"] > 0.3).all()
    strict = wd.Simulation(scene, dt=0.1, force_dt=True, trouble="stop")
    with pytest.raises(wd.TroubledBondError, match="have crept by more than"):
        strict.run(until=60.0)


def test_branches_faster_than_a_step_are_told():
    with pytest.warns(wd.ModelWarning, match="shortest time of relaxation, 0.001 s"):
        sim = wd.Simulation(scene_of(viscous=wd.StandardLinearSolid(0.5, 1e-3)))
    start = sum(sim.energy()[k] for k in ("kinetic", "pair", "volume"))
    sim.run(steps=500)
    ledger = sim.energy()
    assert ledger["kinetic"] + ledger["pair"] + ledger["volume"] < start
    assert abs(ledger["residual"]) < 1e-6 * start


def test_work_on_a_driven_box_is_what_its_dashpots_take():
    """A periodic cell of Kelvin and Voigt's solid, sheared at a constant rate."""
    p = wd.packing.voronoi((4.0, 4.0), 1.0, seed=1, periodic=True)
    rate, law = 1e-6, wd.KelvinVoigt(3.0)
    shear = 0.5 * rate * np.array([[0.0, 1.0], [1.0, 0.0]])
    scene = wd.Scene()
    body = scene.add(p, SOFT, viscous=law)
    scene.strain(body, lambda time: shear * time)
    x = p.position - 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
    scene.hold(body, np.arange(len(p)), x @ shear)
    sim = wd.Simulation(scene, dt=0.01, force_dt=True)
    sim.run(steps=1)  # the first step starts the box
    before = sim.energy()
    sim.run(steps=200)
    after = sim.energy()
    # viscosity times the square of the rate, G T rate^2, over the volume and 200 steps
    exact = SOFT.shear_modulus * 3.0 * rate**2 * 16.0 * 2.0
    assert after["damping"] - before["damping"] == pytest.approx(exact, rel=1e-6)
    assert abs(after["residual"] - before["residual"]) < 1e-9 * exact


def test_complex_modulus_and_relaxation():
    law = wd.Prony((0.5, 0.3), (5.0, 40.0))
    assert law.relaxation(0.0) == 1.0
    assert law.relaxation(1e6) == pytest.approx(0.2)
    # one decay by hand: 1 - 0.8 + 0.5/e + 0.3 exp(-1/8)
    assert law.relaxation(5.0) == pytest.approx(0.2 + 0.5 / np.e + 0.3 * np.exp(-0.125))
    assert wd.Maxwell(2.0).complex_modulus(0.5) == pytest.approx(0.5 + 0.5j)
    assert wd.KelvinVoigt(2.0).complex_modulus(0.5) == pytest.approx(1.0 + 1.0j)
    assert wd.StandardLinearSolid(0.6, 2.0).complex_modulus(0.5) == pytest.approx(0.7 + 0.3j)

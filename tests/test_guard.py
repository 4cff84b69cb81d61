"""What is wrong with a run is found within a look's interval, and named."""

import numpy as np
import pytest
from test_checkpoint import (
    ageing,
    contact,
    evm,
    facets,
    finite,
    healing,
    plastic,
    prony,
    renewing,
    tools,
)

import warpdem as wd
from warpdem.simulation import GUARD_EVERY
from warpdem.validation import core

MAKES = (facets, evm, plastic, finite, renewing, prony, contact, tools, ageing, healing)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("make", MAKES, ids=lambda m: m.__name__)
def test_a_nan_in_any_state_array_is_found(make):
    """Without a step in between, so that what steps overwrite is seen as well."""
    sim = wd.Simulation(make())
    sim.run(steps=3)
    names = [
        name
        for name, array in sim._step.arrays.items()
        if array.numpy().dtype.kind == "f" and array.size and name not in sim._guarded._fixed
    ]
    assert len(names) > 15
    for name in names:
        array = sim._step.arrays[name]
        kept = array.numpy().copy()
        bad = kept.copy()
        bad.reshape(-1)[-1 if len(bad.reshape(-1)) < 3 else 2] = np.nan
        array.assign(bad)
        with pytest.raises(wd.NonFiniteError, match=rf"{name} \(1\)"):
            sim._guard()
        array.assign(kept)
    sim._guard()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_the_run_stops_within_a_look_and_hands_over_what_was_sound(value, tmp_path):
    sim = wd.Simulation(facets())
    sim.run(steps=20)
    sound = sim.displacement
    bad = sim._step.download("velocity")
    bad[7, 0] = value
    sim._step.upload("velocity", bad)
    path = tmp_path / "a.npz"
    with pytest.raises(wd.NonFiniteError, match=r"at step .*dt") as caught:
        sim.run(steps=5 * GUARD_EVERY, checkpoint=path, checkpoint_every=10)
    assert sim.steps <= 20 + GUARD_EVERY
    assert caught.value.last_step == 20
    assert np.array_equal(caught.value.last["displacement"], sound)
    assert not path.exists()


def test_the_element_is_named():
    sim = wd.Simulation(facets())
    bad = sim._step.download("velocity")
    bad[7, 1] = np.nan
    sim._step.upload("velocity", bad)
    with pytest.raises(wd.NonFiniteError, match="velocity of elements 7 is"):
        sim._guard()
    sim = wd.Simulation(facets())
    bad = sim._step.download("facet_stiffness")
    bad[11] = np.nan
    sim._step.upload("facet_stiffness", bad)
    with pytest.raises(wd.NonFiniteError, match="facet_stiffness of bonds 11 is"):
        sim._guard()

    ring = wd.packing.ring(1.0, 8, wd.Circle(0.1))  # of as many bonds as elements
    scene = wd.Scene()
    scene.add(ring, wd.Material(1.0, 0.3, 1.0), bond=wd.EVMBond(1.0, 1.0, 1.0, 1.0))
    sim = wd.Simulation(scene)
    bad = sim._step.download("evm_stiffness")
    bad[5, 0] = np.nan
    sim._step.upload("evm_stiffness", bad)
    with pytest.raises(wd.NonFiniteError, match="evm_stiffness of bonds 5 is"):
        sim._guard()


def test_what_was_sound_is_known_after_a_renewal_and_a_resume(tmp_path):
    sim = wd.Simulation(renewing())
    sim.run(steps=3)
    sim.renew_faces()
    assert sim._guarded.last_step == 3 and len(sim._guarded.last)
    sim = wd.Simulation(facets())
    sim.run(steps=20)
    sim.save(tmp_path / "a.npz")
    again = wd.resume(tmp_path / "a.npz", facets())
    assert again._guarded.last_step == 20
    assert np.array_equal(again._guarded.last["displacement"], sim.displacement)


def test_twice_the_stable_step_is_found_while_numbers_are_finite():
    p = core.small_packing("hex strain")
    scene = wd.Scene()
    body = scene.add(p, wd.Material(1.0, 0.3, 1.0))
    scene.set_velocity(body, 1e-5 * np.random.default_rng(0).normal(size=p.position.shape))
    limit = wd.Simulation(scene).dt_limit
    sim = wd.Simulation(scene, dt=2.0 * limit, force_dt=True)
    with pytest.raises(wd.NonFiniteError, match=r"elements [\d, ]+.* step \d+ .*dt"):
        sim.run(steps=10 * GUARD_EVERY)
    assert sim.steps <= GUARD_EVERY


def test_energy_from_nowhere_is_found():
    sim = wd.Simulation(prony())
    sim.run(steps=GUARD_EVERY)
    step = sim._step
    step.upload("velocity", 10.0 * (step.download("velocity") + 1e-4))
    with pytest.raises(wd.UnstableError, match="energy grew by"):
        sim.run(steps=GUARD_EVERY)


def test_a_zero_volume_is_named():
    p = core.small_packing("hex strain")
    volume = p.volume.copy()
    volume[5] = 0.0
    with pytest.raises(wd.InputError, match=r"volume.* 5"):
        wd.Packing(p.position, volume, p.bonds, p.area, p.arms, plane="strain")

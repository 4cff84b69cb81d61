"""Laws of friction (theory B11); validation/friction.py has the cases against SciPy."""

import numpy as np
import pytest

import warpdem as wd
from warpdem.validation.contact import SOFT, ball

LAW = wd.RateAndState(mu0=0.4, a=0.01, b=0.015, V0=1e-3, Dc=1e-2)


def rubbing(precision: str = "float64", skin: float = 0.5) -> wd.Simulation:
    """Two elements that meet obliquely."""
    scene = wd.Scene()
    one = scene.add(ball(np.zeros(2), 0.5), SOFT)
    scene.add(ball(np.array([1.05, 0.3]), 0.5), SOFT)
    scene.set_velocity(one, [2e-2, 1e-3])
    scene.contact(friction=LAW, skin=skin)
    return wd.Simulation(scene, precision=precision)


@pytest.mark.parametrize(("precision", "limit"), [("float64", 2e-4), ("float32", 3e-4)])
def test_slip_is_booked_and_momentum_kept(precision, limit):
    # Coulomb's own number leaves 9.4e-5 at this step, a twelfth of it at an eighth of the step
    sim = rubbing(precision)
    held = sim.energy()["kinetic"]
    p = sim.model.mass @ sim.velocity
    sim.run(steps=2000)
    assert not len(sim.contacts)
    ledger = sim.energy()
    assert ledger["friction"] > 1e-4 * held
    assert abs(ledger["residual"]) < limit * held
    assert sim.model.mass @ sim.velocity == pytest.approx(p, abs=1e-6 * np.abs(p).max())


def test_the_state_goes_over_to_a_new_list():
    sim = rubbing()
    while not len(sim.contacts):
        sim.run(steps=1)
    sim.run(steps=3)
    theta = sim._step.arrays["contact_theta"].numpy()[:2].copy()
    assert theta[0] == theta[1] > 0.0
    assert theta[0] != LAW.Dc / LAW.V0
    sim._step.neighbours.build()
    assert np.array_equal(sim._step.arrays["contact_theta"].numpy()[:2], theta)


def test_steady_friction_and_critical_stiffness():
    # mu0 + (a - b) ln(V/V0), Dieterich 1979, to the share that regularisation takes
    assert LAW.steady([1e-3, 1e-2]) == pytest.approx([0.4, 0.4 - 0.005 * np.log(10.0)], abs=1e-9)
    assert LAW.critical_stiffness(2e6) == pytest.approx(2e6 * 0.005 / 1e-2)


def test_bad_input_is_refused():
    with pytest.raises(wd.InputError, match="a must be greater"):
        wd.RateAndState(0.6, 0.0, 0.01, 1e-6, 1e-5)
    with pytest.raises(wd.InputError, match="b is -1"):
        wd.RateAndState(0.6, 0.01, -1.0, 1e-6, 1e-5)
    with pytest.raises(wd.InputError, match="law is 'slips'"):
        wd.RateAndState(0.6, 0.01, 0.01, 1e-6, 1e-5, law="slips")


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_faces_of_a_broken_bond_rub_by_it(precision):
    scene = wd.Scene()
    p = wd.packing.square((2.0, 1.0), 1.0, "strain")
    body = scene.add(p, SOFT, facet_bending=True, fracture=wd.Rankine(1e6))
    middle = p.position.mean(axis=0)
    across = np.array([0.0, 0.9])
    scene.cut(body, middle - across, middle + across)
    scene.hold(body, [0])
    scene.hold(body, [1], velocity=[0.0, LAW.V0])
    scene.contact(friction=LAW)
    sim = wd.Simulation(scene, dt=0.02, precision=precision)
    sim.set_state(displacement=[[0.0, 0.0], [-1e-3, 0.0]])
    sim.run(steps=500)
    force = sim.force[1]
    assert -force[1] / force[0] == pytest.approx(LAW.mu0, rel=0.02)

"""Laws of contact: turned-over pairs (theory B11)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import warpdem as wd
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

"""Bodies whose EVM bonds are of few kinds: the literal law, and all that is read of them."""

import numpy as np
import pytest

import warpdem as wd
from warpdem.validation import reference
from warpdem.validation.core import random_orientation

UNIT = wd.Material(1.0, 0.0, 1.0)
BOND = wd.EVMBond(1.0, 0.4, 0.05, 0.04, offset=0.1)
PACKINGS = {
    "simple cubic": lambda: wd.packing.simple_cubic((9, 8, 8), 1.0),
    "fcc": lambda: wd.packing.fcc((6 * 2**0.5,) * 3, 1.0),
    "hexagonal": lambda: wd.packing.hexagonal((25.0, 25.0), 1.0),
}
LIMIT = {"float64": 1e-13, "mixed": 1e-6, "float32": 1e-6}


def body(name, bond=BOND):
    scene = wd.Scene()
    scene.add(PACKINGS[name](), UNIT, bond=bond)
    return scene


def shaken(sim, size=0.05):
    """Any small displacements and turns of a simulation's elements."""
    rng, (n, dim) = np.random.default_rng(3), sim.position.shape
    turns = random_orientation(rng, n, dim, size)
    sim.set_state(displacement=size * rng.normal(size=(n, dim)), orientation=turns)
    return sim


def literal(sim):
    """Energy of bonds, force on their first elements, forces and torques of elements: Kuzkin eqs 2
    and 3 by NumPy, as vectors of space."""
    m, (i, j) = sim.model, sim.bonds.T
    u, q = reference.in_space(sim.displacement), reference.rotation_matrices(sim.orientation)
    e = reference.in_space(m.evm_direction)
    length = m.evm_length + m.evm_offset.sum(axis=1)

    def turned(triad, end):
        return triad @ np.swapaxes(q[end], 1, 2)

    def law(u, ni, nj):
        r = length[:, None] * e + u[j] - u[i]
        return reference.evm(r, ni, nj, m.evm_offset, m.evm_length, m.evm_stiffness)

    ni, nj = reference.triads(e, np.zeros(len(e)))
    energy, force, on_i, on_j = law(u, turned(ni, i), turned(nj, j))
    energy -= law(0.0 * u, ni, nj)[0]
    total, torque = np.zeros_like(u), np.zeros_like(u)
    for at, f, t in ((i, force, on_i), (j, -force, on_j)):
        np.add.at(total, at, f)
        np.add.at(torque, at, t)
    return energy, force, total, torque


@pytest.mark.parametrize("precision", LIMIT)
@pytest.mark.parametrize("name", PACKINGS)
def test_forces_and_energies_are_those_of_the_law(name, precision):
    sim = shaken(wd.Simulation(body(name), precision=precision))
    assert sim.model.features.bond_kinds == {"fcc": 6}.get(name, 3)
    energy, force, total, torque = literal(sim)
    found = reference.in_space(sim.bond_force), reference.in_space(sim.force), sim.torque
    exact = force, total, torque[:, -1:] if len(sim.position.T) == 2 else torque
    for own, other in zip(found, exact, strict=True):
        assert np.abs(own - other).max() < LIMIT[precision] * np.abs(other).max()
    assert np.abs(sim.bond_energy - energy).max() < 10 * LIMIT[precision] * energy.max()


def test_large_rotations_have_their_law():
    bond = wd.EVMBond(1.0, 0.4, 0.05, 0.04, large_rotation=True)
    sim = shaken(wd.Simulation(body("simple cubic", bond)), 0.3)
    n = sim.model.elements
    for axis, end in ((0, 5), (2, 300)):  # forces are derivatives of the energy
        u, h = sim.displacement, 1e-5
        force = sim.force[end, axis]
        held = []
        for sign in (1.0, -1.0):
            moved = u.copy()
            moved[end, axis] += sign * h
            sim.set_state(displacement=moved, orientation=sim.orientation)
            held.append(sim.bond_energy.sum())
        sim.set_state(displacement=u, orientation=sim.orientation)
        assert force == pytest.approx(-(held[0] - held[1]) / (2 * h), abs=1e-8)
    assert sim.model.features.bond_kinds == 3 and n == 576


def test_a_body_moves_as_one_whose_bonds_are_worked_out_one_by_one():
    def moved(scene):
        sim = wd.Simulation(scene, dt=0.2, local_damping=0.1)
        shaken(sim).run(steps=50)
        return sim

    def loaded():
        scene = body("simple cubic")
        scene.hold(scene.bodies[0], np.arange(9), velocity=[0.01, 0, 0])
        scene.set_gravity([0, 0, -0.01])
        return scene

    whole = moved(loaded())
    broken = loaded()
    # a contact is for pairs, for which elements need slots
    broken.contact()
    apart = moved(broken)
    assert whole.model.features.bond_kinds == 3 and apart.model.features.bond_kinds == 0
    for name in ("displacement", "velocity", "angular_velocity", "bond_force", "stress"):
        own, other = getattr(whole, name), getattr(apart, name)
        assert np.abs(own - other).max() < 1e-11 * max(np.abs(other).max(), 1e-30), name
    for name in ("pair", "kinetic", "residual"):
        assert whole.energy()[name] == pytest.approx(apart.energy()[name], abs=1e-11)


def test_what_is_no_lattice_has_slots():
    few = wd.Scene()
    few.add(wd.packing.simple_cubic((4, 4, 4), 1.0), UNIT, bond=BOND)
    unlike = body("simple cubic", wd.EVMBond(np.linspace(1, 2, 1520), 0.4, 0.05, 0.04))
    damped = body("simple cubic", wd.EVMBond(1.0, 0.4, 0.05, 0.04, damping=0.1))
    for scene in (few, unlike, damped):
        assert wd.Simulation(scene).model.features.bond_kinds == 0


def test_a_lattice_comes_to_rest_and_goes_on_from_a_checkpoint(tmp_path):
    def standing():
        scene = body("hexagonal")
        own = scene.bodies[0]
        scene.hold(own, own.packing.position[:, 1] < 1.0)
        scene.set_gravity([0.0, -1e-5])
        return scene

    sim = shaken(wd.Simulation(standing()), 1e-3)
    sim.run(steps=7)
    sim.save(tmp_path / "lattice.npz")
    sim.run(steps=9)
    again = wd.resume(tmp_path / "lattice.npz", standing())
    again.run(steps=9)
    assert np.array_equal(sim.displacement, again.displacement)
    assert np.array_equal(sim.angular_velocity, again.angular_velocity)
    sim.relax()
    free = sim.model.inverse_mass[:, 1] > 0.0
    weight = sim.model.mass[free] * 1e-5
    assert np.abs(sim.force[free, 1] - weight).max() < 1e-6 * np.abs(sim.bond_force).max()
    again.equilibrate()
    assert np.abs(sim.displacement - again.displacement).max() < 1e-3 * sim.displacement.max()

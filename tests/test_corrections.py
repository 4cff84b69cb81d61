"""Where the papers err (docs/equations.md): each test fails on the printed form."""

import numpy as np
import pytest

import warpdem as wd
from warpdem.validation import core, reference

E, NU = 1.0, 0.3
G = E / (2 * (1 + NU))
K = E / (3 * (1 - 2 * NU))


def uniform(strain, shape="hex strain", poisson=NU):
    """Inner element stresses of a uniformly strained body, which end away from its boundary."""
    p = core.small_packing(shape)
    scene, body = core.facet_body(p, poisson)
    scene.strain(body, strain)
    scene.hold(body, p.boundary(layers=2))
    return wd.Simulation(scene).stress[~p.boundary(layers=2)].mean(axis=0), p


def pair(displacement, turn_i=None, turn_j=None, **stiffness):
    """One EVM bond of length 1 along x in space; its simulation in the given state."""
    p = wd.packing.network([[0, 0, 0], [1.0, 0, 0]], [[0, 1]], 1.0)
    scene = wd.Scene()
    bond = wd.EVMBond(
        **({"longitudinal": 3.0, "shear": 2.0, "bending": 1.0, "torsion": 0.7} | stiffness)
    )
    scene.add(p, wd.Material(1.0, 0.0, 1.0), bond=bond)
    sim = wd.Simulation(scene)
    q = np.tile([0.0, 0, 0, 1], (2, 1))
    for row, turn in enumerate((turn_i, turn_j)):
        if turn is not None:
            axis, angle = turn
            q[row, :3], q[row, 3] = np.sin(angle / 2) * np.array(axis), np.cos(angle / 2)
    u = np.zeros((2, 3))
    u[1] = displacement
    sim.set_state(displacement=u, orientation=q)
    return sim


def test_eq1_triad_of_j_is_left_handed():
    _, nj = reference.triads(np.array([[1.0, 0, 0]]), np.array([0.3]))
    assert np.linalg.det(nj[0]) == pytest.approx(-1.0)
    # a right-handed triad of j (n_j3 reversed) would give a body at rest a torsional energy
    # - B4/2 (1 - 1) instead of - B4; the code's body at rest has none above its minimum
    sim = pair([0, 0, 0])
    assert sim.bond_energy[0] == 0.0
    assert not sim.torque.any()


def test_eq4_tension_is_along_the_unit_vector():
    stretch = 0.5
    force = pair([stretch, 0, 0]).bond_force[0]
    assert force == pytest.approx([3.0 * stretch, 0, 0], abs=1e-14)
    printed = 3.0 * stretch * (1.0 + stretch)  # B1 (r - a) r_ij
    assert abs(force[0] - printed) > 0.5


def test_eq10_torsion_drags_the_other_end_along():
    phi = 0.4
    sim = pair([0, 0, 0], turn_j=([1, 0, 0], phi))
    assert sim.torque[0] == pytest.approx([0.7 * np.sin(phi), 0, 0], abs=1e-14)
    # printed: - B4 sin(phi)
    assert sim.torque[0][0] > 0.0


def test_eq9_bending_moment_restores_the_end():
    phi = 0.3
    sim = pair([0, 0, 0], turn_i=([0, 1, 0], phi), turn_j=([0, 1, 0], -phi))
    assert sim.torque[0][1] < 0.0
    assert sim.torque[1][1] > 0.0


def test_angular_momentum_needs_r_cross_force():
    sim = pair([0.1, 0.3, -0.2], turn_i=([0, 1, 0], 0.3), turn_j=([1, 0, 0], 0.5))
    total = sim.torque.sum(axis=0)
    couple = np.cross(sim.position[1] - sim.position[0], sim.bond_force[0])
    assert total == pytest.approx(couple, abs=1e-14)
    assert np.abs(total + couple).max() > 0.1  # the other sign


def test_bond_length_excludes_the_offsets():
    # c_D = B2 / a^2 with a = r - R_i - R_j: a small shear of an unturned pair
    sim = pair([0, 1e-6, 0], offset=0.3, shear=2.0)
    a = 1.0 - 2 * 0.3
    assert sim.bond_force[0][1] == pytest.approx(2.0 * 1e-6, rel=1e-6)
    with_r = sim.scene.bodies[0].bond.parameters(np.array([1.0]))[0, 1] / a**2
    assert with_r == pytest.approx(2.0 / a**2)  # what the centres' distance would give


@pytest.mark.parametrize("shape", ["hex strain", "fcc", "voronoi strain", "voronoi space"])
def test_eq6_needs_three_bulk_moduli(shape):
    p = core.small_packing(shape)
    strain = 1e-4 * np.eye(p.dim)
    stress, _ = uniform(strain, shape)
    exact = reference.hooke(strain, E, NU, p.plane)
    assert stress == pytest.approx(exact, abs=1e-12)
    mean = np.trace(exact) / 3
    assert exact[0, 0] == pytest.approx(2 * G * strain[0, 0] + (1 - 2 * G / (3 * K)) * mean)
    printed = 2 * G * strain[0, 0] + (1 - 2 * G / K) * mean
    assert abs(stress[0, 0] - printed) > 0.2 * abs(exact[0, 0])


def test_eq8_strain_shares_are_weighted_by_distance():
    # unweighted shares (eps_i + eps_j = h/r0) halve the pair stiffness: S 2G h / (2 r0)
    p = core.small_packing("hex strain")
    scene, body = core.facet_body(p, 0.0)
    scene.strain(body, [[0, 0], [0, 1e-4]])
    sim = wd.Simulation(scene)
    vertical = np.abs(p.bond_vector[:, 0]) < 0.6
    h = 1e-4 * p.bond_vector[vertical, 1] ** 2
    n = p.bond_vector[vertical]
    found = (sim.bond_force[vertical] * n).sum(axis=1)
    assert found == pytest.approx(p.area[vertical] * 2 * (E / 2) * h, rel=1e-6)


def test_eq6_shear_strain_in_eq7_is_tensorial():
    strain = np.array([[0, 1e-4], [1e-4, 0]])
    stress, _ = uniform(strain)
    assert stress[0, 1] == pytest.approx(2 * G * 1e-4, rel=1e-9)
    printed = 2 * G * 2e-4  # eq. 7 with the engineering gamma of eq. 6
    assert abs(stress[0, 1] - printed) > 0.9 * stress[0, 1]


def test_elongation_is_positive():
    stress, _ = uniform(np.array([[1e-4, 0], [0, 0]]))
    assert stress[0, 0] > 0.0  # h as an overlap would make tension negative


def test_eq5_with_the_arms_to_face_centroids():
    # arms along the centre line (q n) instead of to the centroid, on irregular cells
    strain = np.array([[1e-4, 0], [0, -5e-5]])
    p = core.small_packing("voronoi strain")
    scene, body = core.facet_body(p, NU)
    scene.strain(body, strain)
    sim = wd.Simulation(scene)
    inner = ~p.boundary(layers=2)
    exact = reference.hooke(strain, E, NU, "strain")[:2, :2]
    found = sim.stress[inner][:, :2, :2]
    printed = np.zeros((len(p), 2, 2))
    n = p.bond_vector / p.bond_length[:, None]
    for side, sign in ((0, 1.0), (1, -1.0)):
        arm = (p.arms[:, side] * n).sum(axis=1)[:, None] * n
        moment = sign * arm[:, :, None] * sim.bond_force[:, None, :]
        np.add.at(printed, p.bonds[:, side], moment)
    printed = (printed / p.volume[:, None, None])[inner]
    assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()
    assert np.abs(printed - exact).max() > 0.01 * np.abs(exact).max()


def test_eq3_pressure_acts_with_the_coupling_and_from_both_sides():
    # own pressure alone on each side would break Newton's third law where pressures differ
    p = core.small_packing("voronoi strain")
    scene, _ = core.facet_body(p, NU)
    sim = wd.Simulation(scene)
    u = 1e-3 * np.random.default_rng(0).normal(size=p.position.shape)
    sim.set_state(displacement=u)
    assert np.abs(sim.force.sum(axis=0)).max() < 1e-14
    mean = np.trace(sim.stress, axis1=1, axis2=2) / 3
    assert np.ptp(mean[p.bonds], axis=1).max() > 1e-4  # so that the test could fail


def test_eq14_threshold_is_the_compressive_strength():
    law = wd.DruckerPrager(compression=3.0, ratio=3.0)
    tension = np.diag([1.0, 0, 0])
    assert law.tension == 1.0
    assert reference.equivalent_stress(tension, law.kind, law.numbers) == pytest.approx(3.0)
    assert reference.equivalent_stress(-3.0 * tension, law.kind, law.numbers) == pytest.approx(3.0)


def test_eq13_in_space_needs_the_shear_within_the_face():
    # pure shear in the plane of a face: without s_t1t2 that pair would feel no stress at all
    t = reference.hooke(np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0.0]]), E, 0.0, None)
    face = np.eye(3) - np.outer([0, 0, 1.0], [0, 0, 1.0])
    kept = face @ t @ face
    literal = np.diag(np.diag(kept))  # eq. 13 interpolates the diagonal components alone
    assert reference.von_mises(kept) == pytest.approx(reference.von_mises(t))
    assert reference.von_mises(literal) == 0.0
    # the device code on every bond direction of fcc: criteria_in_uniform_stress
    p = core.small_packing("fcc")
    inner = ~p.boundary(layers=2)
    inside = inner[p.bonds].all(axis=1)
    scene, body = core.facet_body(p, 0.0, wd.HuberMisesHencky(0.999e-6 * reference.von_mises(t)))
    scene.strain(body, 1e-6 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0.0]]))
    scene.hold(body, np.arange(len(p)))
    sim = wd.Simulation(scene, dt=1.0)
    sim.run(steps=1)
    assert not sim.linked[inside].any()

"""Bonds that may break between unlike materials: theory B4, B10 and B11 at a face with a node."""

import numpy as np
import pytest

import warpdem as wd
from warpdem.criteria import weaker
from warpdem.toughness import dundurs
from warpdem.validation import reference

LIGHT, HEAVY = wd.Material(1.0, 0.2, 1.0), wd.Material(3.0, 0.3, 2.0)


def layered(name, size, plane=None, **options):
    """A block whose upper half is of the other material, and which bonds join both."""
    kind = {} if plane is None else {"plane": plane}
    p = getattr(wd.packing, name)(size, 1.0, **kind)
    grain = (p.position[:, -1] > p.position[:, -1].mean()).astype(int)
    scene = wd.Scene()
    body = scene.add(p, [LIGHT, HEAVY], grain=grain, **options)
    return p, scene, body, grain[p.bonds].sum(axis=1) == 1


def energy(sim, p, grain, linked, displacement, points):
    """U of theory B4: each side of a face between both materials has a spring of its own to the
    point y, and shares of V E from it. Unlike faces, in order of bonds, have `points`."""
    turn = reference.rotation_matrices(sim.orientation)
    u, arms = reference.in_space(displacement), reference.in_space(p.arms)
    g = np.array([m.shear_modulus for m in (LIGHT, HEAVY)])[grain]
    d = np.array([m.coupling for m in (LIGHT, HEAVY)])[grain]
    n = reference.in_space(p.bond_vector) / p.bond_length[:, None]
    dilation, faces, pair, row = np.zeros(len(p)), np.zeros(len(p)), 0.0, 0
    for b, (i, j) in enumerate(p.bonds):
        if grain[i] != grain[j]:
            row += 1
        if not linked[b]:
            continue
        ends = [u[i] + turn[i] @ arms[b, 0] - arms[b, 0], u[j] + turn[j] @ arms[b, 1] - arms[b, 1]]
        q = [arms[b, 0] @ n[b], -arms[b, 1] @ n[b]]
        if grain[i] == grain[j]:
            share = q[0] / (q[0] + q[1])
            y = (1 - share) * ends[0] + share * ends[1]
        else:
            y = points[row - 1]
        for side, e in enumerate((i, j)):
            opening = (y - ends[side]) / q[side]
            pair += g[e] * p.area[b] * q[side] * (opening @ opening)
            dilation[e] += p.area[b] * (turn[e] @ arms[b, side]) @ opening
            faces[e] += p.area[b] * q[side]
    starred = faces / p.volume + (p.plane == "strain")
    a = 2 * g * d / (3 - d * starred)
    return pair + (p.volume * a * (dilation / p.volume) ** 2 / 2).sum()


@pytest.mark.parametrize(
    ("name", "size", "plane"),
    [
        ("hexagonal", (5.0, 4.5), "strain"),
        pytest.param("voronoi", (5.0, 5.0), "stress", marks=pytest.mark.slow),
        pytest.param("fcc", (2.0, 2.0, 2.5), None, marks=pytest.mark.slow),
    ],
)
def test_break_of_an_unlike_pair(name, size, plane):
    """Energy, release, stress at the criterion, forces after it, and closing of the parted face."""
    p, scene, body, unlike = layered(name, size, plane, fracture=wd.Rankine(1e-9))
    grain = body.grain
    chosen = int(np.flatnonzero(unlike)[unlike.sum() // 2])
    body.strength_factor[np.arange(len(p.bonds)) != chosen] = np.inf
    rng = np.random.default_rng(1)
    body.displacement[:] = 1e-5 * rng.normal(size=p.position.shape)
    body.displacement[:, -1] += 1e-4 * p.position[:, -1]
    scene.hold(body, np.arange(len(p)))
    sim = wd.Simulation(scene)
    sim.equilibrate(tolerance=1e-11)  # of the nodes
    m = sim.model
    ends = reference.in_space(sim._step.download("displacement"))
    # which node each unlike face has: the one between its elements
    found = {
        (int(m.bond_i[a]), int(m.bond_j[b])): int(m.bond_j[a])
        for a, b in zip(m.node_bonds, range(*m.second_bonds.indices(m.bonds)), strict=True)
    }
    points = np.array([ends[found[tuple(pair)]] for pair in p.bonds[unlike]])
    linked = np.ones(len(p.bonds), dtype=bool)
    u = sim.position - p.position
    before, held = energy(sim, p, grain, linked, u, points), sim.energy()
    assert held["pair"] + held["volume"] == pytest.approx(before, rel=1e-9)
    force = sim.bond_force[chosen]
    i, j = p.bonds[chosen]
    n = reference.in_space(p.bond_vector[chosen]) / p.bond_length[chosen]
    q = np.array([p.arms[chosen, 0], -p.arms[chosen, 1]]) @ n[: p.dim]
    mean = (sim.stress[i] * q[1] + sim.stress[j] * q[0]) / q.sum()
    traction = reference.in_space(force) / p.area[chosen]
    tensor = reference.pair_tensor(mean, traction, n)
    sim.run(steps=1)
    assert sim.criterion_ratio[chosen] * 1e-9 == pytest.approx(
        reference.equivalent_stress(tensor, "rankine"), rel=1e-8
    )
    log = sim.broken_bonds()
    assert log["bond"].tolist() == [chosen] and (log["i"][0], log["j"][0]) == (i, j)
    assert log["normal_stress"][0] == pytest.approx(traction @ n, rel=1e-8)
    linked[chosen] = False
    after = energy(sim, p, grain, linked, u, points)
    assert log["released_energy"][0] == pytest.approx(before - after, rel=1e-7)
    assert abs(sim.energy_error) < 1e-12
    assert np.abs(sim.bond_force[chosen]).max() == 0.0 and not sim.linked[chosen]
    step, found_force = 1e-7, sim.force
    for element in (int(i), int(j)):
        for axis in range(p.dim):
            moved = np.zeros_like(u)
            moved[element, axis] = step
            change = [energy(sim, p, grain, linked, u + s * moved, points) for s in (1.0, -1.0)]
            assert found_force[element, axis] == pytest.approx(
                (change[1] - change[0]) / (2 * step), abs=1e-6 * np.abs(found_force).max()
            )
    # pressed together again it is a face in series of both, and nothing at a gap of 0
    moved = np.zeros_like(u)
    moved[grain == 1] -= 2e-4 * n[: p.dim]
    sim.set_state(displacement=moved)
    modulus = [m.lame(plane) + 2 * m.shear_modulus for m in (LIGHT, HEAVY)]
    stiffness = p.area[chosen] / (q / np.array(modulus)[grain[[i, j]]]).sum()
    assert sim.energy()["contact"] == pytest.approx(0.5 * stiffness * 4e-8, rel=1e-9)
    push = sim.bond_force[chosen]
    assert push == pytest.approx(-stiffness * 2e-4 * n[: p.dim], rel=1e-9)


@pytest.mark.parametrize("softens", [False, True])
def test_a_block_torn_along_its_interface(softens):
    """Momentum and energy are kept while an interface tears, nodes included."""
    law = wd.Rankine(0.02)
    if softens:
        law = wd.LinearSoftening(law, 1e-3)
    p, scene, body, unlike = layered("hexagonal", (10.0, 9.0), "strain", fracture=law)
    up = body.grain[:, None] * [0.0, 0.1] - [0.0, 0.05]
    scene.set_velocity(body, up + 2e-3 * p.position[:, 1:])
    sim = wd.Simulation(scene)
    m = sim.model
    assert m.interfaces == unlike.sum() == m.nodes

    def momentum():
        v, w = (sim._step.download(x) for x in ("velocity", "angular_velocity"))
        x = m.position + sim._step.download("displacement")
        spin = (m.inertia * w[:, 0])[: m.own_elements].sum()
        return (m.mass[:, None] * v).sum(axis=0), spin + m.mass @ (
            x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]
        )

    before = momentum()
    assert m.mass.sum() == pytest.approx(body.density @ p.volume)
    sim.run(steps=300)
    after, log = momentum(), sim.broken_bonds()
    assert np.isin(np.flatnonzero(unlike), log["bond"]).all()
    # the integrator's order: 1e-6 and 1.5e-5 found, a fourth of that at half the step
    assert abs(sim.energy_error) < 5e-5
    assert after[0] == pytest.approx(before[0], abs=1e-13)
    # a node is put back to its facet point, by the opening that it had: of bonds that soften 0.1
    assert after[1] == pytest.approx(before[1], rel=1e-3 if softens else 1e-4)
    if not softens:
        assert log["released_energy"].sum() == pytest.approx(sim.energy()["fracture"])


def test_which_criterion_an_interface_has():
    p = wd.packing.hexagonal((6.0, 6.0), 1.0)
    grain = (p.position[:, 1] > 3.0).astype(int)
    unlike = grain[p.bonds].sum(axis=1) == 1
    strong, weak = wd.Rankine(2.0), wd.DruckerPrager(3.0, 3.0)
    scene = wd.Scene()
    body = scene.add(p, [LIGHT, HEAVY], grain=grain, fracture=[strong, weak])
    assert body.fractures[body.fracture_law[unlike][0]] == weak
    glued = wd.MixedMode(0.1, 0.2)
    body = scene.add(
        p, [LIGHT, HEAVY], grain=grain, fracture=[strong, None], pairs={(HEAVY, LIGHT): glued}
    )
    assert {body.fractures[k] for k in body.fracture_law[unlike]} == {glued}
    assert (body.fracture_law[(grain[p.bonds] == 1).all(axis=1)] == -1).all()
    assert weaker(None, strong) == strong and weaker(None, None) is None
    assert weaker(wd.LinearSoftening(strong, 2.0), wd.LinearSoftening(strong, 1.0)) == (
        wd.LinearSoftening(strong, 1.0)
    )
    # a crack between like halves needs what it needs in either
    tough = wd.Toughness(wd.Rankine(1.0), energy=2.0)
    assert tough.at(p, LIGHT, LIGHT) == tough.at(p, LIGHT)
    # Hutchinson and Suo 1992, 2.7: alpha = (E'_1 - E'_2)/(E'_1 + E'_2)
    moduli = [m.plane_modulus() for m in (HEAVY, LIGHT)]
    assert dundurs(HEAVY, LIGHT)[0] == pytest.approx(
        (moduli[0] - moduli[1]) / (moduli[0] + moduli[1])
    )


def test_a_scene_of_one_material_knows_nothing_of_interfaces():
    p = wd.packing.hexagonal((5.0, 4.5), 1.0)
    scene = wd.Scene()
    scene.add(p, LIGHT, fracture=wd.Rankine(1.0))
    model = wd.Simulation(scene).model
    assert model.interfaces == model.nodes == 0
    assert not any(name.startswith(("interface", "point")) for name in model.arrays())


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"yielding": wd.VonMises(1.0)}, "yield or creep such bonds do not break"),
        ({"viscous": wd.Maxwell(1.0)}, "yield or creep such bonds do not break"),
        ({"healing": wd.Healing(pressure=1.0)}, "would heal"),
        ({"fracture": [wd.Rankine(1.0)] * 3}, "fracture has 3 criteria"),
        ({"pairs": {(LIGHT, LIGHT): None}}, "two of the body's materials"),
        (
            {"fracture": [wd.Rankine(1.0), wd.DamageRate(wd.Rankine(1.0), 1.0, 2.0)]},
            "neither is the weaker",
        ),
        (
            {"pairs": {(LIGHT, HEAVY): wd.Rankine(1.0), (HEAVY, LIGHT): wd.Rankine(2.0)}},
            "two criteria for one pair",
        ),
    ],
)
def test_what_interfaces_refuse(options, says):
    given = {"fracture": wd.Rankine(1.0)} | options
    with pytest.raises(wd.InputError, match=says):
        wd.Simulation(layered("hexagonal", (5.0, 4.5), "strain", **given)[1])

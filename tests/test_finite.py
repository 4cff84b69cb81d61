"""Bodies with finite_strain: what is refused, what is told, precisions, unlike elements, cuts."""

import warnings

import numpy as np
import pytest

import warpdem as wd

COPPER = wd.Material(2.6, 0.3, 1.0)  # G = 1
LAW = wd.VonMises(0.01, 0.01)


def scene_of(packing, law=LAW, **options):
    scene = wd.Scene()
    return scene, scene.add(packing, COPPER, yielding=law, finite_strain=True, **options)


def sheet(plane="strain", size=(6.0, 6.0)):
    return wd.packing.hexagonal(size, 1.0, plane)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"volume": False, "yielding": None}, "with their volume term"),
        ({"fracture": wd.Rankine(1.0)}, "bonds that break"),
        ({"yielding": wd.Nikolaevsky(0.01, 0.5, 0.1)}, "Nikolaevsky"),
        ({"material": wd.Material(1.0, -0.2, 1.0)}, "0 or more"),
        ({"bond": wd.EVMBond(1.0, 1.0, 0.2, 0.1), "volume": True}, "facet"),
    ],
)
def test_what_is_refused(options, sentence):
    given = {"material": COPPER, "finite_strain": True} | options
    with pytest.raises(wd.InputError, match=sentence):
        wd.Scene().add(sheet(), **given)


def test_all_bodies_or_none():
    scene, _ = scene_of(sheet())
    far = wd.packing.voronoi(wd.packing.Box((4.0, 4.0), (20.0, 0.0)), 1.0, "strain")
    scene.add(far, COPPER)
    with pytest.raises(wd.InputError, match="all bodies"):
        wd.Simulation(scene)


def test_an_element_on_one_bond_is_refused():
    p = sheet()
    corner = int(np.argmin(p.position.sum(axis=1)))
    near = p.bonds[(p.bonds == corner).any(axis=1)].ravel()
    others = np.setdiff1d(near, [corner])
    scene, _ = scene_of(p.without(others[1:]))
    with pytest.raises(wd.InputError, match="too few faces"):
        wd.Simulation(scene)


def test_other_scenes_have_none_of_it():
    for law in (None, LAW):
        scene = wd.Scene()
        scene.add(sheet(), COPPER, yielding=law)
        sim = wd.Simulation(scene)
        kernels = [launch.kernel.key for launch in sim._step._start.launches]
        assert not any("finite" in k or "deform" in k or "growth" in k for k in kernels)
        assert not {"displacement_gradient", "centre_opening"} & set(sim._step.arrays)
        with pytest.raises(wd.InputError, match="finite_strain"):
            sim.deformation_gradient  # noqa: B018


def pulled(precision="float64", packing=None):
    """A bar pulled to 10 % between ends that are free across."""
    p = sheet(size=(6.0, 12.0)) if packing is None else packing
    scene, body = scene_of(p)
    y = p.position[:, 1] - p.position[:, 1].mean()
    v = np.stack([np.zeros(len(p)), 2e-3 * y], axis=1)
    scene.set_velocity(body, v)
    ends = p.top | p.bottom
    scene.hold(body, ends, v[ends], axes="y", rotation=False)
    sim = wd.Simulation(scene, precision=precision)
    sim.run(until=50.0)
    return sim


@pytest.mark.slow
def test_precisions_agree():
    exact = pulled()
    assert exact.plastic_strain.mean() > 0.08
    for precision, tolerance in (("mixed", 1e-3), ("float32", 1e-3)):
        sim = pulled(precision)
        apart = np.abs(sim.plastic_strain - exact.plastic_strain).max()
        assert apart < tolerance * exact.plastic_strain.max()
        assert abs(sim.energy_error) < 1e-4


def test_nominal_force_falls_short_of_true_stress():
    sim = pulled()
    middle = np.abs(sim.model.position[:, 1] - sim.model.position[:, 1].mean()) < 2.0
    narrower = np.linalg.inv(sim.deformation_gradient[middle])[:, 1, 1].mean()
    assert narrower == pytest.approx(1.0 / 1.1, abs=0.02)
    s = sim.stress[middle].mean(axis=0)
    flow = LAW.flow_stress(sim.plastic_strain[middle].mean())
    assert s[1, 1] == pytest.approx(2.0 / np.sqrt(3.0) * flow, rel=0.06)


def test_distortion_is_told_once():
    p = sheet()
    scene, _ = scene_of(p)
    sim = wd.Simulation(scene)
    x = p.position
    with pytest.warns(wd.ModelWarning, match="time step") as caught:
        sim.set_state(displacement=x * [1.5, -0.4])
    assert "give a dt of" in str(caught[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.set_state(displacement=x * [1.5, -0.4])
    with pytest.warns(wd.ModelWarning, match="ratio 25"):
        sim.set_state(displacement=x * [5.0, -0.85])
    with pytest.warns(wd.ModelWarning, match="inside out"):
        sim.set_state(displacement=x * [0.0, -2.0])


def test_unlike_materials_and_a_notch():
    """Faces between unlike elements, and a cut, keep the ledger closed."""
    p = sheet(size=(8.0, 12.0))
    scene = wd.Scene()
    grain = (p.position[:, 0] > 4.0).astype(int)
    soft = wd.Material(1.3, 0.2, 1.0)
    body = scene.add(p, [COPPER, soft], grain=grain, yielding=[LAW, None], finite_strain=True)
    scene.cut(body, (-1.0, 6.0), (2.2, 6.0))
    y = p.position[:, 1] - 6.0
    v = np.stack([np.zeros(len(p)), 1e-3 * y], axis=1)
    scene.set_velocity(body, v)
    ends = p.top | p.bottom
    scene.hold(body, ends, v[ends], axes="y", rotation=False)
    sim = wd.Simulation(scene)
    sim.run(until=30.0)
    own = grain == 0
    assert sim.plastic_strain[own].max() > 0.01
    assert abs(sim.energy()["residual"]) < 1e-4 * sim.energy()["work"]


def renewing(share=0.3, precision="float64", packing=None, **given):
    p = packing or wd.packing.voronoi((8.0, 8.0), 1.0, "strain", seed=1, periodic=True)
    scene = wd.Scene()
    body = scene.add(p, COPPER, yielding=LAW, finite_strain=True, renew_faces=share, **given)
    rate = 4e-3
    if p.period is not None:
        scene.strain(body, lambda t: np.diag([np.expm1(rate * t), np.expm1(-rate * t)]))
    scene.set_velocity(body, rate * p.position * [1.0, -1.0])
    sim = wd.Simulation(scene, precision=precision, dt=0.3 * wd.Simulation(scene).dt_limit)
    return sim, rate


@pytest.mark.parametrize(
    "precision",
    ["float64", *(pytest.param(x, marks=pytest.mark.slow) for x in ("float32", "mixed"))],
)
def test_faces_are_renewed_in_every_precision(precision):
    sim, rate = renewing(precision=precision)
    bonds = sim.bonds
    sim.run(until=0.6 / rate)
    assert sim.renewals
    assert {tuple(b) for b in bonds} != {tuple(b) for b in sim.bonds}
    flow = LAW.flow_stress(sim.plastic_strain.mean())
    s = sim.stress.mean(axis=0)
    assert s[0, 0] - s[1, 1] == pytest.approx(2.0 / np.sqrt(3.0) * flow, rel=0.02)
    assert abs(sim.energy_error) < 1e-4
    assert (
        np.abs(sim.position - sim.displacement - sim.scene.bodies[0].packing.position).max() < 1e-4
    )


def test_state_may_be_set_after_a_renewal():
    sim, rate = renewing()
    sim.run(until=0.1 / rate)
    sim.renew_faces()
    place, stress = sim.displacement, sim.stress
    sim.set_state(displacement=place)
    assert np.abs(sim.displacement - place).max() < 1e-12
    assert np.abs(sim.stress - stress).max() < 1e-9 * np.abs(stress).max()


def test_sections_follow_renewed_bonds():
    p = wd.packing.hexagonal((8.0, 8.0), 1.0, "strain")
    sim, _ = renewing(packing=p, share=9.0)
    section = wd.PlaneProbe(p.position.mean(axis=0), (1.0, 0.0), every=1)
    sim.observe(section)
    sim.run(steps=100)
    sim.renew_faces()
    sim.run(steps=1)
    force = np.array(section.force)
    assert np.abs(force[-1] - force[-2]).max() < 0.2 * np.abs(force[-2]).max()


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"finite_strain": False}, "finite strain"),
        ({"yielding": None}, "yield"),
        ({"facet_bending": True}, "bent"),
        ({"renew_faces": 0.0}, "renew_faces"),
    ],
)
def test_renewal_is_refused_where_nothing_is_carried_over(given, match):
    scene = wd.Scene()
    given = {"yielding": LAW, "finite_strain": True, "renew_faces": 0.3} | given
    with pytest.raises(wd.InputError, match=match):
        scene.add(wd.packing.hexagonal((4.0, 4.0), 1.0, "strain"), COPPER, **given)


def test_renewal_is_refused_in_scenes_it_does_not_know():
    scene = wd.Scene()
    p = wd.packing.hexagonal((4.0, 4.0), 1.0, "strain")
    body = scene.add(p, COPPER, yielding=LAW, finite_strain=True, renew_faces=0.3)
    scene.cut(body, (2.0, 2.0), (9.0, 2.3))
    with pytest.raises(wd.InputError, match="heal"):
        wd.Simulation(scene)
    scene, _ = scene_of(p)
    scene.add(p, COPPER, yielding=LAW, finite_strain=True, renew_faces=0.3)
    with pytest.raises(wd.InputError, match="one body"):
        wd.Simulation(scene)
    with pytest.raises(wd.InputError, match="thickness"):
        scene_of(sheet("stress"), renew_faces=0.3)
    scene, _ = scene_of(p)
    with pytest.raises(wd.InputError, match="added with renew_faces"):
        wd.Simulation(scene).renew_faces()


def test_what_slides_past_its_neighbours_is_told_of():
    p = sheet()
    scene, _ = scene_of(p, law=wd.VonMises(100.0))
    sim = wd.Simulation(scene)
    upper = (p.position[:, 1] > p.position[:, 1].mean())[:, None]
    with pytest.warns(wd.ModelWarning, match="slid past"):
        sim.set_state(displacement=upper * [1.5, 0.0])
    assert "plastic_dilation" not in sim._step.arrays


def test_faces_that_cannot_be_renewed_stay():
    sim, _ = renewing(packing=wd.packing.hexagonal((2.0, 2.0), 1.0, "strain"), share=1e-3)
    flat = sim.scene.bodies[0].packing.position * [0.0, -0.99]
    with pytest.warns(wd.ModelWarning, match="distorted"):
        sim.set_state(displacement=flat)
    before = sim.model
    with pytest.raises(wd.InputError):
        sim.renew_faces()
    assert sim.model is before

"""Plastic flow: what is refused, what stays, what is told. Numbers are in validation/plastic.py."""

import warnings

import numpy as np
import pytest

import warpdem as wd

SOLID = wd.Material(2.6, 0.3, 1.0)  # G = 1
LAW = wd.VonMises(0.01, 0.1)


def pulled(packing, law=LAW, rate=1e-3, precision="float64", trouble="warn", **options):
    """A block pulled along its last axis."""
    scene = wd.Scene()
    body = scene.add(packing, SOLID, yielding=law, **options)
    axis = packing.dim - 1
    velocity = np.zeros_like(packing.position)
    velocity[:, axis] = rate * packing.position[:, axis]
    scene.set_velocity(body, velocity)
    low, high = ("bottom", "top") if packing.dim == 2 else ("back", "front")
    grips = packing.side(low) | packing.side(high)
    scene.hold(body, grips, velocity[grips])
    return wd.Simulation(scene, precision=precision, trouble=trouble)


def block(plane="strain"):
    return wd.packing.hexagonal((8.0, 8.0), 1.0, plane)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: wd.VonMises(0.0), "yield_stress must be greater"),
        (lambda: wd.VonMises(1.0, "steel"), "hardening is a modulus"),
        (lambda: wd.VonMises(1.0, -1.0), "modulus is -1 Pa; it must not be negative"),
        (lambda: wd.VonMises(1.0, rate=3.0), "rate is Perzyna, JohnsonCook or None"),
        (lambda: wd.Table([0.0], [0.0]), "two points or more"),
        (lambda: wd.Table([0.0, 0.1], [0.0]), "two points or more"),
        (lambda: wd.Table([0.0, 0.2, 0.1], [0.0, 1.0, 2.0]), "at growing strains"),
        (lambda: wd.Table([0.1, 0.2], [0.0, 1.0]), "starts with growth 0"),
        (lambda: wd.Table([0.0, 0.1], [0.0, np.nan]), "growth is not finite"),
        (lambda: wd.VonMises(1.0, wd.Table([0.0, 0.1], [0.0, -1.0])), "would fall to 0 Pa"),
        (lambda: wd.VonMises(1.0, wd.Voce(-2.0, 1.0)), "would fall to -1 Pa"),
        (lambda: wd.Voce(1.0, 0.0), "rate must be greater"),
        (lambda: wd.PowerLaw(1.0, 0.2, -0.1), "offset is -0.1"),
        (lambda: wd.Perzyna(0.0), "time must be greater"),
        (lambda: wd.JohnsonCook(0.01, 0.0), "reference_rate must be greater"),
        (lambda: wd.Nikolaevsky(1.0, 3.0), "friction is 3"),
        (lambda: wd.Nikolaevsky(1.0, 0.5, 0.6), "dilatancy is 0.6"),
    ],
)
def test_laws_that_cannot_be_are_refused(make, says):
    with pytest.raises(wd.InputError, match=says):
        make()


def evm(**options):
    return wd.EVMBond(1.0, 1.0, 0.1, 0.1, **options)


@pytest.mark.parametrize(
    ("packing", "options", "says"),
    [
        (block("stress"), {"yielding": wd.Nikolaevsky(1.0, 0.5)}, "not plane stress"),
        (block(), {"yielding": LAW, "bond": evm()}, "needs the volume term"),
        (block(), {"yielding": LAW, "volume": False}, "needs the volume term"),
        (
            block(),
            {"yielding": LAW, "bond": evm(large_rotation=True), "volume": True},
            "large_rotation do not yield",
        ),
        (block(), {"yielding": [LAW, None]}, "for each of the 1 materials"),
        (block(), {"yielding": "steel"}, "yielding is one law"),
        (
            wd.packing.network([[0, 0, 0], [1, 0, 0]], [[0, 1]], 1.0),
            {"yielding": LAW, "bond": evm()},
            "needs a packing with faces",
        ),
        (
            block(),
            {"yielding": wd.VonMises(1.0, wd.Table([0.0, 0.1], [0.0, -0.5]))},
            "falls by 5 Pa per unit of plastic strain",
        ),
    ],
)
def test_bodies_that_cannot_yield_are_refused(packing, options, says):
    with pytest.raises(wd.InputError, match=says):
        wd.Scene().add(packing, SOLID, **options)


def test_flow_stress_of_the_laws():
    assert wd.VonMises(2.0, 3.0).flow_stress(0.5) == pytest.approx(3.5)
    assert wd.VonMises(2.0, wd.Voce(1.0, 1e3, 2.0)).flow_stress(0.5) == pytest.approx(4.0)
    assert wd.VonMises(2.0, wd.PowerLaw(3.0, 0.5)).flow_stress(0.25) == pytest.approx(3.5)
    table = wd.Nikolaevsky(2.0, 0.3, 0.0, wd.Table([0.0, 1.0], [0.0, 4.0]))
    assert table.flow_stress([0.5, 3.0]) == pytest.approx([4.0, 6.0])


def state(sim):
    names = ("bond_slip", "plastic_strain", "displacement", "velocity", "orientation")
    return [sim._step.download(name) for name in names]


@pytest.mark.parametrize("precision", ["float64", "mixed"])
def test_observing_and_stopping_change_no_bit(precision):
    class Stops:
        every = 7

        def observe(self, sim):
            assert np.isfinite(sim.energy()["plastic"])
            assert sim.stress.shape == (len(sim.position), 3, 3)
            sim.stop()

        def finish(self, sim):
            pass

    straight, stopped = (pulled(block(), precision=precision) for _ in range(2))
    straight.run(steps=100)
    stopped.observe(Stops())
    while stopped.steps < 100:
        stopped.run(steps=100 - stopped.steps)
    assert straight.plastic_strain.max() > 0.01
    for a, b in zip(state(straight), state(stopped), strict=True):
        assert (a == b).all()


@pytest.mark.parametrize("way", ["relax", "equilibrate"])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_rest_is_found_with_slips_as_they_are(way, plane):
    sim = pulled(block(plane))
    sim.run(steps=100)
    slip, strain = state(sim)[:2]
    getattr(sim, way)(tolerance=1e-6)
    assert strain.max() > 0.01
    assert (sim.plastic_strain == strain).all()
    assert (state(sim)[0] == slip).all()
    assert sim.energy()["residual"] == 0.0
    assert sim.von_mises.max() > LAW.flow_stress(0.0)
    sim.run(steps=1)  # what is beyond the flow stress at that place returns now
    assert (sim.plastic_strain >= strain).all() and (sim.plastic_strain > strain).any()


def test_plastic_strain_is_read_and_written(tmp_path):
    from pxr import Usd, UsdGeom

    for law in (LAW, None):
        sim = pulled(block(), law)
        probe = sim.observe(wd.Probe([[4.0, 4.0]], "plastic_strain", every=60))
        sim.observe(wd.UsdWriter(tmp_path / f"{law is None}.usd", every=60))
        sim.run(steps=120)
        stage = Usd.Stage.Open(str(tmp_path / f"{law is None}.usd"))
        api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/elements"))
        assert api.HasPrimvar("plastic_strain") == (law is not None)
        if law is not None:
            found = api.GetPrimvar("plastic_strain").Get(stage.GetEndTimeCode())
            assert np.array(found) == pytest.approx(sim.plastic_strain, rel=1e-6)
            inside = sim.plastic_strain[~block().boundary(2)]
            assert inside.min() < probe.values[-1][0] < inside.max()
            assert probe.values[0][0] == 0.0


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda s, b, p: s.strain(b, lambda t: np.eye(2)), "only the strain of a periodic body"),
        (lambda s, b, p: s.hold(b, p.top, np.zeros((3, 2))), r"give \(2,\) or \(8, 2\)"),
    ],
)
def test_loads_that_cannot_be_are_refused(act, says):
    packing, scene = block(), wd.Scene()
    with pytest.raises(wd.InputError, match=says):
        act(scene, scene.add(packing, SOLID), packing)


def launches(sim):
    return [launch.kernel.key.split("__locals__")[1] for launch in sim._step._start.launches]


def test_only_scenes_that_yield_pay_for_it():
    plastic, elastic = pulled(block()), pulled(block(), None)
    extra = ["radial_return", "facet_slip"]
    assert launches(plastic) == launches(elastic) + extra
    assert launches(elastic) == ["move", "face_dilation", "volume_stresses", "facet_forces"]
    new = set(plastic._step.arrays) - set(elastic._step.arrays)
    assert new == {
        *("flow_elements", "plastic_strain", "plastic_strain_zz", "return_loss", "mean_stiffness"),
        *("mean_stress", "bond_slip", "spring_force", "bond_dissipation", "locked_energy"),
        *("incidence", "element_coupling", "bond_area"),  # which only flow reads here
    }
    assert (elastic.plastic_strain == 0.0).all()
    again = ["volume_stresses", "facet_forces", "dilation_books"]
    assert launches(pulled(block("stress"))) == launches(elastic) + extra + again


def test_what_has_no_law_does_not_flow():
    packing = block()
    right = packing.position[:, 0] > 4.0
    sim = pulled_pair(packing, right)
    sim.run(steps=120)
    assert (sim.plastic_strain[right] == 0.0).all()
    assert (sim.plastic_strain[~right] > 0.0).mean() > 0.8


def pulled_pair(packing, right):
    scene = wd.Scene()
    options = {"grain": right.astype(int), "yielding": [LAW, None]}
    body = scene.add(packing, [SOLID, SOLID], **options)
    velocity = 1e-3 * packing.position * [0.0, 1.0]
    scene.set_velocity(body, velocity)
    grips = packing.bottom | packing.top
    scene.hold(body, grips, velocity[grips])
    return wd.Simulation(scene)


@pytest.mark.parametrize("precision", ["float64", "float32", "mixed"])
def test_below_yield_nothing_creeps(precision):
    # weights of a face sum to 1 but for rounding, which must not slip
    packing = wd.packing.voronoi((6.0, 6.0), 1.0, seed=3)
    sim = pulled(packing, wd.VonMises(1.0), precision=precision)
    sim.run(steps=50)
    assert sim.von_mises.max() > 0.01
    assert (sim._step.download("bond_slip") == 0.0).all()


@pytest.mark.parametrize("bond", ["facet", "evm"])
def test_slips_beyond_small_strain_are_told_once(bond):
    packing = block()
    options = {}
    if bond == "evm":
        along = 2.0 * packing.area / packing.bond_length
        options = {"bond": wd.EVMBond(along, along, 0.1, 0.1), "volume": True}
    law = wd.VonMises(0.01, 0.3)
    sim = pulled(packing, law, rate=0.01, **options)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sim.run(until=80.0)
    messages = [str(w.message) for w in told if "have flowed" in str(w.message)]
    assert len(messages) == 1
    assert "have flowed by more than 0.3" in messages[0] and "elements" in messages[0]
    stopping = pulled(packing, law, rate=0.01, trouble="stop", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stopping.run(until=10.0)  # a strain of 0.1
        with pytest.raises(wd.TroubledBondError, match=r"have flowed by more than 0\.3"):
            stopping.run(until=80.0)


def test_energy_density_is_all_that_is_stored():
    sim = pulled(block())
    sim.run(steps=120)
    ledger = sim.energy()
    assert sim.plastic_strain.max() > 0.01
    stored = (sim.energy_density * sim.model.element_volume).sum()
    assert stored == pytest.approx(ledger["pair"] + ledger["volume"])
    assert abs(ledger["residual"]) < 1e-6 * ledger["work"]


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_the_ledger_closes_where_flowing_bonds_break(plane):
    scene = wd.Scene()
    packing = wd.packing.hexagonal((16.0, 12.0), 1.0, plane)
    strength = 0.025 if plane == "strain" else 0.0115
    body = scene.add(packing, SOLID, fracture=wd.Rankine(strength), yielding=LAW)
    scene.cut(body, (-1.0, 6.0), (5.0, 6.0))
    velocity = 3e-4 * (packing.position - 6.0) * [0.0, 1.0]
    scene.set_velocity(body, velocity)
    grips = packing.side("bottom", 2) | packing.side("top", 2)
    scene.set_strength(body, np.inf)
    scene.set_strength(body, 1.0, (-1.0, 6.0), (17.0, 6.0))
    scene.hold(body, grips, velocity[grips])
    sim = wd.Simulation(scene)
    sim.run(until=60.0)
    ledger = sim.energy()
    assert len(sim.broken_bonds()) > 5
    assert ledger["plastic"] > 0.05 * ledger["work"]
    assert abs(ledger["residual"]) < 1e-4 * ledger["work"]


def test_a_strained_periodic_cell_has_the_time_step_of_one_at_rest():
    cell = wd.packing.voronoi((6.0, 6.0), 1.0, periodic=True)
    limits = []
    for size in (0.0, 1e-4):
        scene = wd.Scene()
        body = scene.add(cell, SOLID)
        scene.strain(body, size * np.eye(2))
        limits.append(wd.Simulation(scene).dt_limit)
    assert limits[1] == pytest.approx(limits[0], rel=2e-3)


def test_pressure_acts_along_exposed_area():
    ring = wd.packing.voronoi(wd.packing.Ring(4.0, 8.0), 1.0)
    scene = wd.Scene()
    body = scene.add(ring, SOLID)
    inner = ring.side("inner")
    scene.press(body, inner, 3.0)
    outwards = ring.position / np.linalg.norm(ring.position, axis=1)[:, None]
    along = (body.force * outwards).sum(axis=1)
    assert (along[inner] > 0.0).all() and (body.force[~inner] == 0.0).all()
    assert along.sum() == pytest.approx(3.0 * 2.0 * np.pi * 4.0, rel=1e-2)
    assert np.abs(body.force.sum(axis=0)).max() < 1e-9  # a closed surface
    scene.press(body, ring.side("outer"), 1.0, history=([0.0, 1.0], [0.0, 1.0]))
    assert (body.timed_loads[0].force * outwards).sum() < 0.0
    deep = np.flatnonzero(np.abs(np.linalg.norm(ring.position, axis=1) - 6.0) < 0.3)
    for pressure, where, says in (
        (1.0, deep, "no free surface to press on"),
        (np.inf, inner, "pressure is not finite"),
        ([1.0, 2.0], inner, "pressure is .1.0, 2.0.; give a number"),
    ):
        with pytest.raises(wd.InputError, match=says):
            scene.press(body, where, pressure)

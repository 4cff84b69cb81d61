import pytest

import warpdem as wd
from warpdem.validation.relink import _driven, _pressed

SOFT = wd.Material(1.0, 0.3, 1.0)
HEX = wd.packing.hexagonal((5.0, 4.0), 1.0, "strain")


def test_without_healing_nothing_of_it_exists():
    scene = wd.Scene()
    scene.add(HEX, SOFT, fracture=wd.Rankine(1.0))
    sim = wd.Simulation(scene)
    names = ("heal", "any_healed", "relink", "rest_dilation", "bond_slip")
    assert not any(name.startswith(names) for name in sim._step.arrays)
    assert len(sim.relinked_bonds()) == len(sim.waiting_bonds()) == 0


def test_time_under_pressure_is_waited_for():
    sim = _pressed(HEX, wd.Healing(pressure=1e-6, time=1.0), "float64")
    sim.run(until=0.9)
    assert len(sim.relinked_bonds()) == 0
    sim.run(until=1.5)
    log = sim.relinked_bonds()
    assert len(log) and (log["time"] >= 1.0 - sim.dt).all() and (log["pressure"] >= 1e-6).all()
    assert sim.linked[log["bond"]].all()


def test_a_pressure_that_is_not_reached_links_nothing():
    sim = _pressed(HEX, wd.Healing(pressure=1.0), "float64")
    sim.run(steps=50)
    assert len(sim.relinked_bonds()) == 0


def test_every_break_and_link_is_in_a_log():
    sim, _ = _driven(3, 120.0, 0.03, 0.01, True, "float64")
    broke, linked = sim.broken_bonds(), sim.relinked_bonds()
    assert len(linked) >= 3 and 0 <= len(broke) - len(linked) <= 1
    assert (broke["step"][: len(linked)] < linked["step"]).all()
    ledger = sim.energy()
    assert broke["released_energy"].sum() == pytest.approx(ledger["fracture"], rel=1e-12)
    assert linked["released_energy"].sum() == pytest.approx(ledger["healing"], rel=1e-12)
    assert ledger["fracture"] + ledger["healing"] > 0.0


def test_damage_starts_anew_with_a_link():
    """It takes tension for a time, the incubation, to break the bond; each time again."""
    slow = wd.Incubation(wd.Rankine(2e-3), time=5.0)
    sim, _ = _driven(3, 120.0, 0.03, 0.01, True, "float64", slow)
    broke, linked = sim.broken_bonds(), sim.relinked_bonds()
    assert len(linked) >= 3 and 0 <= len(broke) - len(linked) <= 1
    after = broke["time"][1:] - linked["time"][: len(broke) - 1]
    assert (after >= 5.0).all()  # not at once, while it is pressed
    assert (broke["normal_stress"] > 2e-3).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"healing": 3}, "give a Healing"),
        ({"bond": wd.EVMBond(1.0, 1.0, 1.0), "volume": False}, "without facet_bending"),
        ({"facet_bending": True}, "without facet_bending"),
        ({"fracture": wd.LinearSoftening(wd.Rankine(1e-3), 1.0)}, "do not heal"),
    ],
)
def test_what_healing_does_not_know_is_refused(given, message):
    with pytest.raises(wd.InputError, match=message):
        wd.Scene().add(HEX, SOFT, **({"healing": wd.Healing()} | given))


def test_laws_that_cannot_be_are_refused():
    with pytest.raises(wd.InputError, match="pressure is -1"):
        wd.Healing(pressure=-1.0)
    with pytest.raises(wd.InputError, match="strength is 2"):
        wd.Healing(strength=2.0)
    scene = wd.Scene()
    scene.add(HEX, SOFT, healing=wd.Healing(work=1.0))
    with pytest.raises(wd.InputError, match="needs friction"):
        wd.Simulation(scene)
    scene = wd.Scene()
    scene.add(HEX, SOFT, healing=wd.Healing(), viscous=wd.Maxwell(1.0))
    with pytest.raises(wd.InputError, match="elastic bodies"):
        wd.Simulation(scene)

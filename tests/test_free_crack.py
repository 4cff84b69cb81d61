"""Experiments whose cracks find their own way: small versions, and what they are measured by."""

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Usd

import warpdem as wd
from warpdem.experiments.free_crack import FILES, CrackRun, crack_at
from warpdem.experiments.john_shah import MIDSPAN
from warpdem.observe.growth import find_branches, path_angle


@pytest.mark.parametrize("degrees", [-120.0, 25.0, 68.0, 90.0])
def test_angle_of_a_path(degrees):
    """A straight path with small steps across it, and a tenth of its places far off it."""
    rng = np.random.default_rng(1)
    s = np.arange(100.0)
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    place = s[:, None] * along + 0.3 * rng.normal(size=(100, 2))
    place[20:30] += 8.0
    assert path_angle(place) == pytest.approx(degrees, abs=1.5)


def test_angle_of_steps_on_a_lattice():
    """Three steps at 60 degrees and then one at 120, again and again: their mean direction."""
    step = np.radians(np.tile([60.0, 60.0, 60.0, 120.0], 20))
    path = np.cumsum(np.stack([np.cos(step), np.sin(step)], axis=1), axis=0)
    mean = np.degrees(np.arctan2(4.0 * np.sin(np.pi / 3.0), 1.0))
    assert path_angle(path) == pytest.approx(mean, abs=1.5)


def test_angle_of_nothing():
    assert np.isnan(path_angle(np.zeros((1, 2))))


def test_rows_along_y_are_rows_along_x_turned():
    x, y = (wd.packing.hexagonal(size, 1.0, rows=r) for size, r in (((9, 7), "x"), ((7, 9), "y")))
    assert y.position == pytest.approx(x.position[:, ::-1])
    assert (x.bonds == y.bonds).all()
    for one, other in (("left", "bottom"), ("right", "top"), ("bottom", "left")):
        assert (x.side(one) == y.side(other)).all()
    with pytest.raises(wd.InputError, match="rows is 'z'"):
        wd.packing.hexagonal((9, 7), 1.0, rows="z")


@pytest.mark.filterwarnings("ignore:the body is in 2 pieces")
def test_a_slit_neither_holds_nor_closes():
    """Bodies on both sides of it pass through each other at a constant speed."""
    p = wd.packing.hexagonal((10.0, 7.0), 1.0)
    middle = 0.5 * (p.position[:, 1].min() + p.position[:, 1].max())
    halves = p.slit((-1.0, middle), (11.0, middle))
    assert len(halves.bonds) == len(p.bonds) - len(p.crossing((-1.0, middle), (11.0, middle)))
    assert halves.pieces == 2
    scene = wd.Scene()
    body = scene.add(halves, wd.Material(1.0, 0.25, 1.0))
    up = p.position[:, 1] > middle
    scene.set_velocity(body, np.where(up, -0.1, 0.1)[:, None] * [0.0, 1.0])
    sim = wd.Simulation(scene)
    sim.run(until=5.0)
    assert sim.velocity[:, 1] == pytest.approx(np.where(up, -0.1, 0.1), abs=1e-12)
    with pytest.raises(wd.InputError, match="no bond crosses"):
        p.slit((20.0, 0.0), (30.0, 0.0))


def test_the_crack_at_a_notch():
    """Of two cracks the one that starts there, also where one far away is longer."""
    x = np.arange(0.0, 40.0, 0.5)
    near = np.stack([10.0 + 0.5 * x, 5.0 + 0.5 * x], axis=1)
    far = np.stack([x, np.full(len(x), 60.0)], axis=1)
    found = find_branches(np.concatenate([far, near]), np.concatenate([x, 10.0 + x]), 1.6, 8.0)
    (own,) = crack_at(found, (10.0, 5.0), 3.0)
    assert own.tip == pytest.approx(near[-1])
    assert crack_at(found, (100.0, 0.0), 3.0) == []
    assert crack_at([], (0.0, 0.0), 3.0) == []


@pytest.fixture(scope="module")
def kalthoff(tmp_path_factory):
    """A coarse plate and its folder."""
    out = tmp_path_factory.mktemp("kalthoff")
    p = wd.experiments.Kalthoff(spacing=2.5e-3)
    return wd.experiments.kalthoff(p, out=out), out


def test_kalthoff_on_a_coarse_plate(kalthoff):
    """The published angle and start (theory C3 row 36), more widely than the fine plate's."""
    result, _ = kalthoff
    assert 55.0 < result.angle_degrees < 80.0
    assert 20e-6 < result.start_time < 32e-6
    assert result.crack_length > 0.03
    assert result.fastest_over_rayleigh < 0.6
    assert abs(result.energy_error) < 1e-4


def test_kalthoff_writes_its_files(kalthoff):
    result, out = kalthoff
    assert sorted(f.name for f in out.iterdir()) == sorted(FILES)
    record = json.loads((out / "run.json").read_text())
    assert record["angle_degrees"] == result.angle_degrees
    assert record["branches"][0]["parent"] is None
    assert record["parameters"]["speed"] == 16.5
    with (out / "branches.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {"branch", "time [s]", "distance [m]", "speed [m/s]"} == set(rows[0])
    assert Usd.Stage.Open(str(out / "crack.usd")).GetEndTimeCode() > 20


@pytest.mark.parametrize(("gamma", "fails_from"), [(0.5, "notch"), (0.9, "midspan")])
def test_john_and_shah_on_a_coarse_beam(gamma, fails_from, tmp_path):
    """On either side of the published gamma_t = 0.77 (theory C3 row 37), and what is written."""
    p = wd.experiments.JohnShah(spacing=3.8e-3, gamma=gamma, duration=1.5e-3)
    result = wd.experiments.john_shah(p, out=tmp_path)
    assert sorted(f.name for f in tmp_path.iterdir()) == sorted(FILES)
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["fails_from"] == result.fails_from == fails_from
    at = gamma if fails_from == "notch" else 0.0
    # three elements, within which random cells turn the crack at once or are the weakest
    assert record["fails_at_gamma"] == pytest.approx(at, abs=0.12)
    assert 0.0 < record["failure_time"] < result.simulation.time - 1e-4 < p.duration - 1e-4
    assert np.isfinite(result.start_time) == (fails_from == "notch")
    assert fails_from == "midspan" or 30.0 < record["angle_degrees"] < 90.0
    assert abs(result.energy_error) < 1e-4


def test_a_beam_fails_from_the_first_crack_that_comes_through():
    """The notch's starts first and stops at two thirds; midspan's passes it; breaks at the top."""
    y = np.linspace(1e-3, 0.075, 150)
    notch = np.stack([np.full(62, 0.05), y[38:100], y[38:100]], axis=1)  # x, y, time
    midspan = np.stack([np.full(150, MIDSPAN), y, 0.03 + y], axis=1)
    top = np.stack([np.linspace(0.15, 0.17, 40), np.full(40, 0.074), np.full(40, 0.01)], axis=1)
    for breaks, place, time in (
        ([notch, midspan, top], MIDSPAN, 0.03 + 0.75 * 0.0762),
        ([notch, top], None, np.nan),
    ):
        rows = np.concatenate(breaks)
        cracks = find_branches(rows[:, :2], rows[:, 2], 4e-3, 12e-3)
        log = np.rec.fromarrays(rows.T, names="x,y,time")
        crack = SimpleNamespace(log=log, branches=lambda found=cracks: found)
        own = crack_at(cracks, (0.05, 0.019), 6e-3)
        found = wd.experiments.JohnShah().measure(CrackRun(own, {}, crack, None))
        assert found["fails_from"] == ("nothing" if place is None else "midspan")
        assert found["failure_time"] == pytest.approx(time, abs=1e-3, nan_ok=True)
        assert found["angle_degrees"] == pytest.approx(90.0)


def test_john_and_shah_before_it_fails():
    p = wd.experiments.JohnShah(spacing=3.8e-3, duration=1e-4)
    result = wd.experiments.john_shah(p)
    assert result.fails_from == "nothing"
    assert np.isnan([result.fails_at_gamma, result.failure_time, result.angle_degrees]).all()
    assert result.told[-1] == "the beam did not fail; raise --duration"
    with pytest.raises(wd.InputError, match="gamma is 1; a notch between midspan and the support"):
        replace(p, gamma=1.0)
    # a crack in another material has no published place
    assert p.expected.lines and not replace(p, strength=5e6).expected.lines


def test_branching_at_a_high_load():
    """Twice the stress over a stiffer plate's toughness: it branches early."""
    soda = wd.experiments.Branching.soda_lime(spacing=1e-3, seed=1)
    low = wd.experiments.branching(replace(soda, traction=6e6))
    high = wd.experiments.branching(replace(soda, traction=24e6))
    assert high.branch_count > max(low.branch_count, 1)
    assert high.start_time < low.start_time
    assert high.start_time < high.branching_time < soda.duration
    assert 0.2 < high.before_over_rayleigh < 1.0


def test_uneven_strength_slows_a_crack():
    coarse = wd.experiments.Heterogeneous(spacing=4e-5)
    uneven = wd.experiments.heterogeneous(coarse)
    even = wd.experiments.heterogeneous(replace(coarse, weibull=np.inf))
    assert uneven.broken_bonds > 1.2 * even.broken_bonds
    assert uneven.speed_over_rayleigh < 0.98 * even.speed_over_rayleigh < 0.95


def test_inclusions_lie_apart_and_are_tougher():
    p = wd.experiments.Heterogeneous(
        spacing=4e-5, weibull=np.inf, inclusions=0.2, inclusion_size=2e-4, inclusion_strength=3.0
    )
    centre = p.centres()
    area = len(centre) * 0.25 * np.pi * p.inclusion_size**2
    assert area == pytest.approx(0.2 * p.size[0] * p.size[1], rel=0.05)
    away = np.linalg.norm(centre[:, None] - centre, axis=2) + np.eye(len(centre))
    assert away.min() > p.inclusion_size
    _, body = p.build(p.fill())
    free = np.isfinite(body.strength_factor)
    tough = free & (body.strength_factor > 2.5)
    assert tough.sum() / free.sum() == pytest.approx(0.2, abs=0.06)
    even = replace(p, inclusions=0.0)
    # scatter leaves the mean strength as it was
    _, scattered = replace(even, weibull=5.0).build(even.fill())
    plain = even.build(even.fill())[1].strength_factor
    ratio = scattered.strength_factor[np.isfinite(plain)] / plain[np.isfinite(plain)]
    assert ratio.mean() == pytest.approx(1.0, abs=0.02)


def test_cracks_at_an_interface():
    """Along it below the first material's Rayleigh speed; across it by its toughness."""
    given = wd.experiments.Bimaterial(spacing=1e-3, duration=4e-5)
    along = wd.experiments.bimaterial(given)
    assert along.way == "along" and 0.6 < along.speed_over_rayleigh < 1.0
    assert abs(along.energy_error) < 1e-4
    body = along.simulation.scene.bodies[0]
    crossed = body.grain[along.crack.log["i"]] != body.grain[along.crack.log["j"]]
    # mirrored cells have their faces in it
    assert along.crack.log["y"][crossed] == pytest.approx(0.01, abs=1e-12)
    ways = [
        wd.experiments.bimaterial(replace(given, path="across", interface_toughness=ratio))
        for ratio in (0.05, 1.0)
    ]
    assert ways[0].debonded_spacings > 5.0 and ways[0].penetrated_spacings == 0.0
    assert ways[1].way == "through" and ways[1].deflection < 0.3
    with pytest.raises(wd.InputError, match="path is 'up'"):
        replace(given, path="up")
    with pytest.raises(wd.InputError, match="the whole interface bears"):
        wd.experiments.bimaterial(replace(given, overload=3.0))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"packing": "fcc"}, "packing is 'fcc'"),
        ({"rows": "z"}, "rows is 'z'"),
        ({"spacing": 0.01}, "twenty elements across"),
        ({"fracture_energy": 0.0}, "fracture_energy must be greater"),
        ({"strength": -1.0}, "strength must be greater"),
    ],
)
def test_bad_input_is_a_sentence(given, says):
    with pytest.raises(wd.InputError, match=says):
        wd.experiments.Kalthoff(**({"spacing": 2.5e-3} | given))

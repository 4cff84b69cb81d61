"""Experiments that run for a time (docs/experiments.md), small and short; the defaults are slow."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest
from pxr import UsdGeom
from stages import opened

import warpdem as wd
from warpdem.experiments import (
    CrushedGrain,
    Drop,
    Impact,
    Indentation,
    SlidingBlock,
    SpringSlider,
    crushed_grain,
    drop,
    impact,
    indentation,
    sliding_block,
    spring_slider,
)

SOFT = {"young": 1e7, "speed": 0.1}


def written(result, where):
    """Check the files of a trial; returns what run.json holds."""
    p = result.parameters
    assert sorted(f.name for f in where.iterdir()) == sorted(p.files)
    for picture in where.glob("*.png"):
        assert picture.stat().st_size > 10_000
    stage = opened(where / "scene.usd")
    # the last frame is at most one frame's time before the end
    end, sim = stage.GetEndTimeCode(), result.simulation
    told = stage.GetDefaultPrim().GetAttribute("warpdem:time")
    assert sim.time - told.Get(end) <= 1.01 * (told.Get(1) - told.Get(0))
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements"))
    assert len(points.GetPointsAttr().Get(end)) == result.elements
    record = json.loads((where / "run.json").read_text())
    assert record["experiment"] == p.name and record["status"] == "complete"
    for name, value in result.numbers().items():
        if isinstance(value, float) and np.isfinite(value):
            assert record[name] == pytest.approx(value)
    with (where / "series.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(result.series.table)
    assert float(rows[-1]["time [s]"]) == pytest.approx(result.series["time"][-1])
    return record


def test_a_series_reads_numbers():
    scene = wd.Scene()
    body = scene.add(
        wd.packing.square((3.0, 3.0), 1.0), wd.Material(1.0, 0.0, 1.0), facet_bending=True
    )
    scene.set_velocity(body, [2.0, 0.0])
    sim = wd.Simulation(scene)
    series = wd.Series({"speed": lambda s: s.velocity[0, 0]}, every=5)
    sim.observe(series)
    sim.run(steps=20)
    assert series["time"] == pytest.approx(sim.dt * np.arange(0, 21, 5))
    assert series["speed"] == pytest.approx(np.full(5, 2.0))
    for columns in ({}, {"time": lambda s: 0.0}):
        with pytest.raises(wd.InputError, match="columns other than time"):
            wd.Series(columns)


# -- sliding block --------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 12.0])
def test_a_block_stops_and_stays(angle, tmp_path):
    result = sliding_block(SlidingBlock(angle=angle, **SOFT), out=tmp_path)
    # v^2/(2 g (mu cos - sin))
    slope = np.radians(angle)
    way = 0.1**2 / (2.0 * 9.81 * (0.4 * np.cos(slope) - np.sin(slope)))
    assert result.stopping_distance == pytest.approx(way, rel=1e-3)
    assert result.creep < 1e-4 * way  # what is left of its ringing
    assert abs(result.energy_error) < 1e-5
    assert written(result, tmp_path)["distance_error"] == pytest.approx(0.0, abs=1e-3)


def test_below_the_angle_of_friction_it_sticks_and_above_it_slides():
    sticks = sliding_block(SlidingBlock(angle=15.0, young=1e7, speed=0.0))
    assert abs(sticks.stopping_distance) < 5e-5
    assert sticks.creep < 1e-9
    slides = sliding_block(SlidingBlock(angle=30.0, young=1e7, speed=0.0))
    wanted = 9.81 * (np.sin(np.pi / 6.0) - 0.4 * np.cos(np.pi / 6.0))
    assert -slides.deceleration == pytest.approx(wanted, rel=1e-3)


def test_a_block_that_cannot_move_is_refused():
    with pytest.raises(wd.InputError, match="neither speed nor slope"):
        SlidingBlock(speed=0.0)
    with pytest.raises(wd.InputError, match="angle is 90"):
        SlidingBlock(angle=90.0)


def test_trials_are_commands(tmp_path):
    words = ("run", "sliding-block", "--young", "1e6", "--speed", "0.05", "--out", "out")
    command = [sys.executable, "-m", "warpdem", *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    assert "it stops after" in done.stdout
    assert (tmp_path / "out" / "picture.png").is_file()


@pytest.mark.slow
def test_the_default_block():
    assert sliding_block().distance_error == pytest.approx(0.0, abs=1e-4)


def test_a_trial_goes_on_from_its_checkpoint_to_the_same_files(tmp_path):
    class EndedError(Exception):
        pass

    def run(where, ends):
        class Ends:
            every = 300

            def observe(self, sim):
                if ends and sim.steps:
                    raise EndedError

            def finish(self, sim):
                pass

        kept = wd.Checkpoint(where / "checkpoint.npz", 100)
        options = {"checkpoint": kept, "observers": lambda sim, measured: [Ends()]}
        return sliding_block(SlidingBlock(young=1e6, speed=0.05), out=where, **options)

    one, two = tmp_path / "one", tmp_path / "two"
    for where in (one, two):
        where.mkdir()
    whole = run(one, ends=False)
    assert whole.steps > 400
    with pytest.raises(EndedError):
        run(two, ends=True)
    assert run(two, ends=False).stopping_distance == whole.stopping_distance
    for name in ("series.csv", "picture.png"):
        assert (one / name).read_bytes() == (two / name).read_bytes()


# -- spring sliders -------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["aging", pytest.param("slip", marks=pytest.mark.slow)])
def test_sliders_swing_up_below_the_critical_stiffness_and_down_above(law, tmp_path):
    result = spring_slider(SpringSlider(law=law, rate=3e-2, swings=3.0), out=tmp_path)
    assert result.soft_growth > 1.1
    assert result.stiff_growth < 0.9
    # against SciPy; at this rate with 200 steps over Dc
    assert max(result.soft_error, result.stiff_error) < 1e-4
    # Ruina's linear theory; the swings are small, not infinitely so, and inertia is 1e-3
    assert result.soft_growth == pytest.approx(result.soft_expected_growth, rel=0.02)
    assert result.stiff_growth == pytest.approx(result.stiff_expected_growth, rel=0.02)
    assert result.pressing_force == pytest.approx(1e4, rel=1e-9)
    written(result, tmp_path)


def test_growth_of_swings_is_known_at_the_threshold():
    p = SpringSlider()
    assert p.growth(1.0) == pytest.approx(1.0)
    # k_crit = N (b - a)/Dc, period 2 pi Dc/V sqrt(a/(b - a))
    assert p.critical_stiffness == pytest.approx(1e4 * 0.005 / 1e-5)
    assert p.swing_time(1.0) == pytest.approx(2.0 * np.pi * 1e-5 / 1.1e-2 * np.sqrt(2.0))


def test_friction_that_strengthens_has_no_threshold():
    with pytest.raises(wd.InputError, match="give b above a"):
        SpringSlider(a=0.02)
    with pytest.raises(wd.InputError, match="stiffer than the contact"):
        SpringSlider(slip=1e-8)


@pytest.mark.slow
def test_the_default_sliders():
    result = spring_slider()
    assert max(result.soft_error, result.stiff_error) < 1e-4
    assert result.stiff_growth < 1.0 < result.soft_growth


# -- plate impact ---------------------------------------------------------------------------------

PLATES = {"flyer": 2e-3, "target": 5e-3, "width": 1e-3}


def test_a_plate_spalls_where_the_waves_meet(tmp_path):
    result = impact(Impact(**PLATES), out=tmp_path)
    assert result.plateau_over_speed == pytest.approx(1.0, abs=5e-3)
    assert result.arrival == pytest.approx(result.expected_arrival, rel=0.03)
    assert result.spall_depth_over_flyer == pytest.approx(1.0, abs=0.05)
    # the dip is as short as fronts are, so that the back sees part of it
    assert 0.3 < result.pull_back_strength / 100e6 < 1.0
    assert result.momentum_error < 1e-12
    assert abs(result.energy_error) < 1e-4
    assert result.pieces_at_end > 2
    assert written(result, tmp_path)["peak_stress"] == pytest.approx(
        0.5 * 2500.0 * np.sqrt(70e9 * 0.75 / (1.25 * 0.5) / 2500.0) * 80.0
    )


def test_below_its_strength_a_plate_does_not_spall():
    result = impact(Impact(**PLATES, speed=10.0, weibull=np.inf))  # 72 MPa
    assert result.broken_bonds == 0 and np.isnan(result.spall_depth)
    # the flyer hands over all of its momentum: once its wave has left the back, before it returns,
    # the back rests
    p, time = result.parameters, result.series["time"]
    between = (2.0 * p.target + p.flyer) / p.wave_speed
    assert abs(np.interp(between, time, result.series["back_speed"])) < 0.02 * p.speed


def test_plates_too_thin_are_refused():
    with pytest.raises(wd.InputError, match="give 10 or more"):
        Impact(flyer=5e-4)


# -- indentation ----------------------------------------------------------------------------------

BLOCK = {"width": 30e-3, "height": 15e-3, "spacing": 0.5e-3, "radius": 100e-3, "speed": 4.0}


def test_a_tool_presses_before_anything_breaks():
    result = indentation(Indentation(width=20e-3, height=10e-3, depth=2e-5))
    # few elements touch at this size; the default has 1.05
    assert result.half_width_over_hertz == pytest.approx(1.0, abs=0.1)
    assert result.broken_bonds == 0 and abs(result.energy_error) < 1e-6
    assert not any("nan" in line or "broke by" in line for line in result.told)


@pytest.mark.slow
def test_a_tool_presses_as_hertz_says_and_then_the_block_breaks(tmp_path):
    brittle = wd.DruckerPrager(compression=150e6, ratio=10.0)
    result = indentation(Indentation(**BLOCK, depth=60e-6, criterion=brittle), out=tmp_path)
    # few elements touch at this size; the default has 1.05
    assert result.half_width_over_hertz == pytest.approx(1.0, abs=0.3)
    assert result.broken_bonds > 10 and result.greatest_force > result.first_break_force
    assert abs(result.energy_error) < 1e-4
    written(result, tmp_path)


def test_forces_of_elements_on_a_wall_are_its_force():
    p = wd.packing.square((4.0, 2.0), 1.0)
    scene = wd.Scene()
    scene.add(p, wd.Material(1.0, 0.0, 1.0), facet_bending=True)
    scene.contact()
    wall = scene.wall([0.0, p.position[:, 1].min() - 0.49], [0.0, 1.0])
    sim = wd.Simulation(scene)
    forces = sim.wall_forces(wall)
    assert forces.shape == (8, 2)
    assert (forces[p.side("bottom"), 1] < 0.0).all() and not forces[~p.side("bottom")].any()
    assert forces.sum(axis=0) == pytest.approx(sim.wall_force(wall))


# -- crushed grain --------------------------------------------------------------------------------

GRAIN = {"diameter": 16e-3, "spacing": 1e-3}


def test_a_small_grain_cracks():
    result = crushed_grain(CrushedGrain(diameter=6e-3, closing=3e-5))
    assert result.broken_bonds > 0 and abs(result.energy_error) < 1e-5


@pytest.mark.slow
def test_a_grain_is_crushed(tmp_path):
    result = crushed_grain(CrushedGrain(**GRAIN, speed=1.0, closing=0.08e-3), out=tmp_path)
    assert 0.3 < result.first_crack_over_strength < 1.2
    assert 0.5 < result.greatest_stress / 10e6 < 1.5
    assert result.pieces_at_end > 2
    assert abs(result.energy_error) < 1e-4
    written(result, tmp_path)


@pytest.mark.slow
def test_a_pair_of_grains_keeps_momentum_and_parts(tmp_path):
    broken = crushed_grain(CrushedGrain(**GRAIN, pair=True, speed=4.0), out=tmp_path)
    assert broken.momentum_error < 1e-12
    assert abs(broken.energy_error) < 1e-4
    assert broken.pieces_at_end > 2
    whole = crushed_grain(CrushedGrain(**GRAIN, pair=True, speed=0.05))
    assert whole.broken_bonds == 0 and whole.pieces_at_end == 2
    # what is lost of the speed is the grains' ringing and the dashpots'
    assert broken.restitution < whole.restitution < 1.0
    written(broken, tmp_path)


# -- drop -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_dropped_body_meets_the_plane_and_falls_into_pieces(tmp_path):
    small = {"diameter": 20e-3, "spacing": 1e-3, "time": 8e-4}
    result = drop(Drop(**small), out=tmp_path)
    assert result.impact_speed == pytest.approx(np.sqrt(2.0 * 9.81 * 2.0), rel=1e-6)
    assert result.impulse_error == pytest.approx(0.0, abs=0.05)
    assert abs(result.energy_error) < 1e-4
    assert result.pieces_at_end > 2
    shares = result.kinetic_share + result.fracture_share + result.lost_share
    assert shares == pytest.approx(1.0, abs=0.02)  # the rest is strain, and gravity's work
    written(result, tmp_path)


def test_a_small_drop_meets_the_plane():
    result = drop(Drop(diameter=12e-3, time=5e-4))
    assert result.impact_speed == pytest.approx(np.sqrt(2.0 * 9.81 * 2.0), rel=1e-9)
    assert abs(result.energy_error) < 1e-4


def test_a_drop_from_below_its_start_is_refused():
    with pytest.raises(wd.InputError, match="the height is"):
        Drop(height=1e-4)


@pytest.mark.slow
def test_the_default_block_under_a_tool_follows_hertz():
    result = indentation(Indentation(depth=0.08e-3))
    assert result.half_width_over_hertz == pytest.approx(1.0, abs=0.06)
    # a half-space's, of which the block is a piece
    assert result.depth_over_hertz == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("make", [impact, indentation, crushed_grain, drop])
def test_the_defaults_close_their_books(make):
    result = make()
    assert abs(result.energy_error) < 1e-4
    assert result.broken_bonds > 100

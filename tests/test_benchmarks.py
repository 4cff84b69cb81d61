"""The scripts of benchmarks/ run, in seconds, so that they do not rot; memory that they report."""

import json
import subprocess
import sys
from pathlib import Path

import ceiling
import numpy as np
import pytest

import warpdem as wd
from warpdem import arrays
from warpdem.benchmark.scenes import KINDS, build

FOLDER = Path(__file__).parents[1] / "benchmarks"


def run(script, *options):
    command = [sys.executable, str(FOLDER / script), "--quick", *map(str, options)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_throughput_runs(tmp_path):
    run("throughput.py", "--output", tmp_path / "t.json")
    found = json.loads((tmp_path / "t.json").read_text())
    assert all(r["median"] > 0 for row in found["kinds"] for r in row["rates"].values())
    assert found["crack"]["elements"] > 30_000


@pytest.mark.slow
def test_scenes_runs(tmp_path):
    run("scenes.py", "--output", tmp_path / "s.json")
    found = json.loads((tmp_path / "s.json").read_text())
    assert {"hexagonal", "fcc", "Voronoi, space"} == {row["packing"] for row in found["memory"]}
    for row in found["scenes"]:  # volume term: face dilations, volume stresses
        assert row["kernels"] == ["move", "face_dilation", "volume_stresses", "facet_forces"]


@pytest.mark.slow
def test_speed_vs_error_runs_and_draws(tmp_path):
    picture = tmp_path / "p.png"
    run("speed_vs_error.py", "--output", tmp_path / "v.json", "--picture", picture)
    found = json.loads((tmp_path / "v.json").read_text())["cases"]
    assert len(found) >= 5
    # the coarsest runs, whose errors are those of their resolution
    assert found["elastica"]["lines"]["float64 Newton"][0]["error"] < 2e-3
    assert found["wave"]["lines"]["float32"][0]["error"] < 7e-3
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_start_and_report_run(tmp_path):
    run("start.py", "--output", tmp_path / "start.json")
    run_report = [sys.executable, str(FOLDER / "report.py"), "--folder", str(tmp_path)]
    page = tmp_path / "page.md"
    done = subprocess.run([*run_report, "--output", str(page)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    text = page.read_text()
    assert "| mode-i |" in text
    for name in ("throughput", "scenes", "speed_vs_error", "peers", "spall"):
        assert f"`{name}.py`: not measured" in text


def test_the_page_is_that_of_the_files(tmp_path):
    page = tmp_path / "page.md"
    command = [sys.executable, str(FOLDER / "report.py"), "--output", str(page)]
    subprocess.run(command, check=True)
    assert page.read_text() == (FOLDER.parent / "docs" / "performance.md").read_text()


@pytest.mark.slow
def test_bench_prints_rates_and_errors():
    command = [sys.executable, "-m", "warpdem", "bench", "--size", "300"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "+ fracture" in done.stdout and "elastica" in done.stdout


@pytest.mark.slow
def test_errors_fall_with_resolution_at_second_order():
    from warpdem.benchmark import work

    for run_case, knob, values in (
        (work.wave, "length", (8, 16)),
        (work.beam_frequency, "bonds", (8, 16)),
        (work.spinning_bar, "bonds", (4, 8)),
    ):
        coarse, fine = (run_case(**{knob: v}).error for v in values)
        assert 3.5 < coarse / fine < 4.5
    long, short = (work.hot_block(dt).error for dt in (0.1, 0.05))
    assert 3.5 < long / short < 4.5


@pytest.mark.skipif(
    ceiling.compiler() is None,
    reason="the hand-written steps are C++, whose compiler warpdem itself does not need",
)
def test_hand_written_steps_are_the_same_steps():
    sims = [wd.Simulation(build(KINDS[0], 3, 1000)) for _ in range(2)]
    for sim in sims:
        sim._step.advance()
    by_hand = ceiling.Handwritten(sims[1])
    for _ in range(20):
        sims[0]._step.advance()
    by_hand.steps(20)
    for name in ("displacement", "velocity", "angular_velocity"):
        own, other = (sim._step.download(name) for sim in sims)
        assert np.abs(own - other).max() < 1e-12 * np.abs(own).max()


def test_arrays_reach_the_device_when_a_pass_asks_for_them():
    breaks = next(k for k in KINDS if k.breaks and not k.touches)
    sim = wd.Simulation(build(breaks, 2, 400))
    sim.run(steps=2)
    # what only a pair that closes needs is not there yet
    for name in ("closing_impulse", "closing_twist"):
        assert name not in sim.memory
    assert sim.bytes == sum(sim.memory.values())
    assert list(sim.memory.values()) == sorted(sim.memory.values(), reverse=True)


def test_a_scene_too_large_for_a_device_is_refused(monkeypatch):
    monkeypatch.setattr(arrays, "free_memory", lambda device: 1000)
    with pytest.raises(wd.InputError, match=r"400 elements needs up to .* GB on 'cpu'"):
        wd.Simulation(build(KINDS[1], 2, 400))

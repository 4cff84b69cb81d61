"""The scripts of benchmarks/ run, in seconds, so that they do not rot; memory that they report."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import warpdem as wd
from warpdem import step as step_module
from warpdem.benchmark.scenes import KINDS, build

FOLDER = Path(__file__).parents[1] / "benchmarks"


def run(script, *options):
    command = [sys.executable, str(FOLDER / script), "--quick", *map(str, options)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_throughput_runs(tmp_path):
    run("throughput.py", "--output", tmp_path / "t.json")
    found = json.loads((tmp_path / "t.json").read_text())
    assert all(r["median"] > 0 for row in found["kinds"] for r in row["rates"].values())
    assert found["crack"]["elements"] > 30_000


def test_scenes_runs(tmp_path):
    run("scenes.py", "--output", tmp_path / "s.json")
    found = json.loads((tmp_path / "s.json").read_text())
    assert {"hexagonal", "fcc", "Voronoi, space"} == {row["packing"] for row in found["memory"]}
    for row in found["scenes"]:  # volume term: face dilations, volume stresses
        assert row["kernels"] == ["move", "face_dilation", "volume_stresses", "facet_forces"]


def test_hand_written_steps_are_the_same_steps():
    sys.path.insert(0, str(FOLDER))
    try:
        import ceiling
    finally:
        sys.path.remove(str(FOLDER))
    if ceiling.compiler() is None:
        pytest.skip("no C++ compiler")
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
    # what only a break or a pair that closes needs is not there yet
    for name in ("break_energy", "closing_impulse", "bond_face"):
        assert name not in sim.memory
    assert sim.bytes == sum(sim.memory.values())
    assert list(sim.memory.values()) == sorted(sim.memory.values(), reverse=True)


def test_a_scene_too_large_for_a_device_is_refused(monkeypatch):
    monkeypatch.setattr(step_module, "free_memory", lambda device: 1000)
    with pytest.raises(wd.InputError, match=r"400 elements needs up to .* GB on 'cpu'"):
        wd.Simulation(build(KINDS[1], 2, 400))

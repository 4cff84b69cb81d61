import csv
import json
import os
import signal
import subprocess
import sys
import time
from inspect import get_annotations, signature
from pathlib import Path

import pytest

import warpdem as wd
from warpdem import cli
from warpdem.experiments.described import EXPERIMENTS
from warpdem.experiments.shared import Conduct, Options

SMALL = {"length": 8e-4, "height": 3.7e-4, "notch": 1.5e-4}


def start(out, *arguments):
    size = [f"--{name}={value}" for name, value in SMALL.items()]
    command = [sys.executable, "-m", "warpdem", "sweep", "mode-i", *size, f"--out={out}"]
    return subprocess.Popen(
        [*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def running(sweep, name):
    """Process of a run whose folder begins with a name, once it is under way."""
    for _ in range(3000):
        children = Path(f"/proc/{sweep.pid}/task/{sweep.pid}/children").read_text().split()
        for child in children:
            line = Path(f"/proc/{child}/cmdline").read_text()
            if f"/{name}" in line and "--compile-only" not in line:
                return int(child)
        assert sweep.poll() is None, sweep.communicate()
        time.sleep(0.02)
    raise AssertionError(f"no run {name}")


def table(out):
    with (out / "table.csv").open() as file:
        return list(csv.DictReader(file))


def test_killed_and_failed_runs_are_told_and_run_again(tmp_path):
    out = tmp_path / "sweep"
    given = ("--strain=0.0012,0.07", "--jobs=1")
    first = start(out, *given)
    os.kill(running(first, "strain=0.0012"), signal.SIGKILL)
    said, errors = first.communicate()
    assert first.returncode == 1
    assert "0 complete, 2 to do" in said and "2 runs are not complete" in errors
    assert [row["status"] for row in table(out)] == ["interrupted", "failed"]
    assert "strain is 0.07" in table(out)[1]["error"]

    again = start(out, *given)
    child = running(again, "strain=0.0012")
    os.kill(child, signal.SIGSTOP)  # or it may be complete before the other has been refused
    other = start(out, *given)
    assert "another sweep works in" in other.communicate()[1] and other.returncode == 2
    os.kill(child, signal.SIGCONT)
    again.send_signal(signal.SIGINT)
    again.communicate()
    assert again.returncode not in (0, 1)
    assert not Path(f"/proc/{child}").exists()
    (record,) = out.glob("strain=0.0012*/run.json")
    assert json.loads(record.read_text())["status"] == "interrupted"

    last = start(out, *given)
    assert "1 failed before and are left" in last.communicate()[0]
    assert [row["status"] for row in table(out)] == ["complete", "failed"]
    assert (out / "sweep.png").stat().st_size > 1000
    # the run is the one that the experiment makes by itself
    alone = wd.experiments.mode_i(wd.experiments.ModeI(**SMALL, strain=0.0012))
    assert float(table(out)[0]["speed_over_rayleigh"]) == alone.speed_over_rayleigh


@pytest.mark.slow
@pytest.mark.parametrize(("engine", "options"), [("dask", {}), ("slurm", {"cluster": "local"})])
def test_engines_of_clusters(engine, options, tmp_path):
    pytest.importorskip({"dask": "distributed", "slurm": "submitit"}[engine])
    found = wd.sweep(
        "mode-i", SMALL | {"strain": [0.0012, 0.07]}, out=tmp_path, engine=engine, options=options
    )
    assert [r.status for r in found.runs] == ["complete", "failed"]
    assert found.values("broken_bonds")[0] > 20


@pytest.mark.parametrize(
    ("grid", "more", "says"),
    [
        ({"wish": 1}, {}, "parameter of mode-i is 'wish'"),
        ({"strain": "big"}, {}, "strain is 'big'; give a number"),
        ({"refine": 1.5}, {}, "give a whole number"),
        ({"strain": []}, {}, "strain has no values"),
        ({"strain": [0.07, 0.08]}, {}, "no combination can be run"),
        ({}, {}, "no parameter is given"),
        ({"seed": [0]}, {"jobs": 0}, "jobs is 0"),
        ({"seed": [0]}, {"engine": "wish"}, "engine is 'wish'"),
        ({"seed": [0]}, {"result": "wish"}, "result is 'wish'"),
    ],
)
def test_bad_sweeps_are_refused_at_once(grid, more, says, tmp_path):
    with pytest.raises(wd.InputError, match=says):
        wd.sweep("mode-i", grid, out=tmp_path, **more)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_twelve_runs_of_which_one_is_killed(tmp_path):
    given = ("--strain=0.0011,0.0012,0.0013,0.0014", "--young=70e9,75e9,80e9", "--jobs=2")
    first = start(tmp_path, *given)
    os.kill(running(first, "strain=0.0012,young=75"), signal.SIGKILL)
    first.communicate()
    assert first.returncode == 1
    assert sorted(row["status"] for row in table(tmp_path)) == ["complete"] * 11 + ["interrupted"]
    before = {f: f.stat().st_mtime_ns for f in tmp_path.glob("*/run.json")}
    again = start(tmp_path, *given)
    assert "11 complete, 1 to do" in again.communicate()[0]
    assert again.returncode == 0
    assert [row["status"] for row in table(tmp_path)] == ["complete"] * 12
    assert sum(f.stat().st_mtime_ns != t for f, t in before.items()) == 1


def test_every_experiment_agrees_with_its_commands():
    assert cli.EXPERIMENTS is EXPERIMENTS
    keywords = {"device", "precision", "threads", "out", "observers", "say", "checkpoint", "frames"}
    assert set(signature(Conduct).parameters) == set(get_annotations(Options)) == keywords
    for name, told in EXPERIMENTS.items():
        assert signature(told.function).parameters["options"].annotation == "Unpack[Options]", name
        for commands, own in (
            (cli.run, {"out", "compile_only", "threads", "checkpoint_every"}),
            (cli.many, {"out", "jobs", "engine", "engine_options", "result", "against", "retry"}),
        ):
            (command,) = [c for c in commands.registered_commands if c.name == name]
            assert set(signature(command.callback).parameters) == set(told.described) | own
        defaults = {k: d.default for k, d in told.described.items()}
        assert told.build(defaults) == told.parameters(), name

import csv
import json
import shutil
import signal
import subprocess
import sys
import time

import pytest
from pxr import Usd

from warpdem import cli
from warpdem.errors import InputError
from warpdem.experiments.described import find
from warpdem.sweeps import Run

SMALL = ("--length", "8e-4", "--height", "3.7e-4", "--notch", "1.5e-4", "--strain", "0.0012")


def warpdem(*arguments, cwd=None):
    command = [sys.executable, "-c", "from warpdem.cli import main; main()", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small mode I run and its folder."""
    folder = tmp_path_factory.mktemp("cli")
    done = warpdem("run", "mode-i", *SMALL, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout, folder / "out" / "mode-i"


def test_it_says_what_it_does(run):
    said, _ = run
    for words in (
        "compiling kernels, once", "elements", "bonds on cpu in float64", "MB", "of the stability",
        "about", "terminal speed / Rayleigh speed: 0.", "energy error", "broken bonds", "written",
    ):  # fmt: skip
        assert words in said, words


def test_it_writes_four_whole_files(run):
    _, out = run
    assert sorted(f.name for f in out.glob("[!.]*")) == [
        "broken_bonds.csv", "crack.png", "crack.usd", "run.json",
    ]  # fmt: skip
    assert (out / "crack.png").read_bytes().startswith(b"\x89PNG")
    assert Usd.Stage.Open(str(out / "crack.usd")).GetEndTimeCode() > 3


def test_a_folder_belongs_to_one_run_and_says_how_it_ended(run, tmp_path):
    from filelock import FileLock

    assert json.loads((run[1] / "run.json").read_text())["status"] == "complete"
    with FileLock(tmp_path / ".lock"):
        done = warpdem("run", "mode-i", *SMALL, "--out", str(tmp_path))
    assert done.returncode == 2 and "another run writes into" in done.stderr
    assert not (tmp_path / "run.json").exists()
    code = f"""
import os, signal
from warpdem.write.claim import claimed
with claimed({str(tmp_path)!r}, {{"experiment": "mine"}}):
    os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", code], check=False)
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "running"
    again = subprocess.run([sys.executable, "-c", code.replace("os.kill", "max")], check=False)
    assert again.returncode == 0  # the lock of a killed run is free
    subprocess.run(
        [sys.executable, "-c", code.replace("os.kill", "open")], check=False, capture_output=True
    )
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["status"] == "failed" and record["error"].startswith("TypeError")
    assert record["experiment"] == "mine"


def interrupted(out, *arguments):
    """A run ended by SIGTERM once it has written a checkpoint: its messages."""
    code = "from warpdem.cli import main; main()"
    command = [sys.executable, "-c", code, "run", "mode-i", *SMALL, "--out", str(out), *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (out / "checkpoint.npz").exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    said = process.communicate()
    assert process.returncode == 128 + signal.SIGTERM
    return said


def test_a_run_that_a_signal_ended_goes_on_to_the_same_results(run, tmp_path):
    out = tmp_path / "out"
    _, errors = interrupted(out, "--checkpoint-every", "0.01")
    assert f"`warpdem resume {out}` goes on" in errors
    record = json.loads((out / "run.json").read_text())
    assert (record["status"], record["error"]) == ("interrupted", "ended by SIGTERM")
    anew = warpdem("run", "mode-i", *SMALL, "--out", str(out))
    assert anew.returncode == 2 and "has the checkpoint of a run" in anew.stderr
    assert json.loads((out / "run.json").read_text()) == record

    older = shutil.copytree(out, tmp_path / "older")
    done = warpdem("resume", str(older), "--previous")
    assert done.returncode == 0, done.stderr
    assert (older / "broken_bonds.csv").read_bytes() == (run[1] / "broken_bonds.csv").read_bytes()

    # as a sweep does with a run of its own
    assert Run(out, {}).command(find("mode-i"))[-2:] == ["resume", str(out)]
    done = warpdem("resume", str(out))
    assert done.returncode == 0, done.stderr
    assert "going on at step" in done.stdout
    assert not list(out.glob("checkpoint*"))
    for name in ("broken_bonds.csv", "crack.png"):
        assert (out / name).read_bytes() == (run[1] / name).read_bytes()
    ours, theirs = (json.loads((x / "run.json").read_text()) for x in (out, run[1]))
    for key in ("seconds", "element_steps_per_second"):
        del ours[key], theirs[key]
    assert ours == theirs


def test_what_cannot_go_on_is_told(tmp_path):
    def says(words):
        with pytest.raises(InputError, match=words):
            cli.resume(tmp_path)

    says("cannot read")
    (tmp_path / "run.json").write_text("{")
    says("is not as `warpdem run` writes it")
    record = {"experiment": "mode-i", "status": "interrupted", "given": {"strain": "0.001"}}
    (tmp_path / "run.json").write_text(json.dumps(record))
    says("ended before its first one")
    with pytest.raises(InputError, match="ended before its second checkpoint"):
        cli.resume(tmp_path, previous=True)
    record["given"] = {"wish": "1"}
    (tmp_path / "run.json").write_text(json.dumps(record))
    says("not as this version")
    record["status"] = "complete"
    (tmp_path / "run.json").write_text(json.dumps(record))
    says("is complete; its results are there")


def test_record_and_log_agree(run):
    _, out = run
    record = json.loads((out / "run.json").read_text())
    for key in (
        "speed_over_rayleigh", "speed_spread", "energy_error", "broken_bonds",
        "element_steps_per_second", "seconds", "parameters", "machine",
    ):  # fmt: skip
        assert key in record, key
    assert record["parameters"]["strain"] == 0.0012
    assert record["machine"]["versions"]["warp-lang"]
    with (out / "broken_bonds.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == record["broken_bonds"] > 20
    assert {"bond", "i", "j", "time [s]", "x [m]", "mode", "released_energy [J]"} <= set(rows[0])
    assert 0.5 < record["speed_over_rayleigh"] < 1.1


def test_a_shear_crack_writes_its_files(tmp_path):
    size = ("--length", "1.2e-3", "--height", "3.8e-4", "--toughness", "2e5", "--overload", "1.8")
    done = warpdem("run", "mode-ii", *size, "--threads", "1", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["status"] == "complete"
    assert record["broken_bonds"] > 50
    assert 0.2 < record["final_over_p"] < 1.0
    assert sorted(f.name for f in (tmp_path / "out").glob("[!.]*")) == [
        "broken_bonds.csv", "crack.png", "crack.usd", "run.json", "speeds.csv",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--spacing", "-1"), "spacing must be greater than zero"),
        (("--spacing", "nan"), "spacing is not finite"),
        (("--strain", "2"), "strain is 2"),
        (("--poisson", "0.5"), "poisson is 0.5"),
        (("--criterion", "wish"), "criterion is 'wish'; choose one of 'drucker-prager'"),
        (("--packing", "heap"), "packing is 'heap'"),
        (("--precision", "half"), "precision is 'half'"),
        (("--device", "cuda:9"), "device is 'cuda:9'"),
        (("--notch", "1"), "notch must be shorter"),
        (("--refine", "0"), "refine is 0"),
        (("--out", "file/out"), "cannot write into the folder"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_written(arguments, says, tmp_path):
    (tmp_path / "file").touch()
    done = warpdem("run", "mode-i", *SMALL, *arguments, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = [x for x in done.stderr.splitlines() if "CUDA driver" not in x]
    assert line.startswith("error: ")
    assert says in line
    left = [f for f in tmp_path.rglob("*") if f.is_file()]
    assert left == [tmp_path / "file"]


def test_unknown_option_is_refused(tmp_path):
    done = warpdem("run", "mode-i", "--wish", "1", cwd=tmp_path)
    assert done.returncode == 2
    assert "--wish" in done.stderr


def test_info_names_versions_and_devices():
    said = warpdem("info").stdout
    assert "warp-lang 1." in said
    assert "device cpu" in said


def test_validate_prints_json(tmp_path):
    done = warpdem(
        "validate", "patch-test", "--no-slow", "--json", "--write", str(tmp_path / "v.md")
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    keys = {"case", "quantity", "reference", "source", "measured", "error", "limit", "seconds"}
    assert set(found[0]) == keys
    assert all(c["error"] <= c["limit"] for c in found)
    assert "## patch-test" in (tmp_path / "v.md").read_text()


def test_a_missed_limit_is_exit_status_1(monkeypatch, capsys):
    from warpdem import cli
    from warpdem.validation import CASES, Case, Measurement

    def off():
        """One quantity that is off."""
        yield Measurement("a thing", 1.0, "theory", 1.5, 0.5, 0.1)

    monkeypatch.setitem(CASES, "off", Case("off", "trial", False, off))
    monkeypatch.setattr(sys, "argv", ["warpdem", "validate", "trial"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    assert "MISS a thing: measured 1.5" in capsys.readouterr().out


def test_validate_knows_its_groups():
    done = warpdem("validate", "wishes")
    assert done.returncode == 2
    assert "no group or case 'wishes'" in done.stderr

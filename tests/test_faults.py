"""Faults of disks, files and processes: what was told to be on the disk is there, runs go on."""

import json
import resource
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import gsd.hoomd
import numpy as np
import pytest
import warp as wp
from kills import EVERY, writers
from pxr import Sdf, Usd, UsdGeom
from test_checkpoint import bytes_of, facets, tools
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

import warpdem as wd
from warpdem import archive, cache, checkpoint
from warpdem.kernels import memory
from warpdem.write import whole

WHOLE = 160  # steps of the run that killed ones are compared with


def kills(where, count, longest):
    """Kill runs at random moments; see kills.py."""
    script = Path(__file__).parent / "kills.py"
    subprocess.run([sys.executable, str(script), str(where), str(count), str(longest)], check=True)


@pytest.fixture(scope="module")
def one_run(tmp_path_factory):
    """A run that nobody killed: its arrays, log and frames."""
    where = tmp_path_factory.mktemp("whole")
    sim = wd.Simulation(facets())
    for writer in writers(where).values():
        sim.observe(writer)
    sim.run(steps=WHOLE)
    return bytes_of(sim), (where / "a.csv").read_bytes(), frames_of(where)


def frames_of(where):
    """All frames of a run: the USD scene, numbers of GSD, bytes of ParaView's files."""
    with gsd.hoomd.open(where / "a.gsd", "r") as file:
        steps = [int(f.configuration.step) for f in file]
        places = np.array([f.particles.position for f in file]).tobytes()
    vtk = [(where / f["name"]).read_bytes() for f in series_of(where)]
    return text_of(where / "a.usd"), steps, places, vtk


def series_of(where):
    return json.loads((where / "a.vtp.series").read_text())["files"]


def text_of(path):
    return Sdf.Layer.OpenAsAnonymous(str(path)).ExportToString()


def check(where, log):
    """What a killed run left: steps of its checkpoint, and frames."""
    told = json.loads((where / "acknowledged.json").read_text())
    steps = checkpoint.read(where / "a.npz")[0]["steps"]
    if (where / "a.previous.npz").exists():
        checkpoint.read(where / "a.previous.npz")
    if (where / "a.csv").exists():
        found = (where / "a.csv").read_bytes()
        assert found.count(b"\n") - 1 >= told["log"]
        found = found[: found.rfind(b"\n") + 1]
        assert log.startswith(found) or found.startswith(log)
    else:
        assert told["log"] == 0
    frames = sorted((where / "a.take").glob("frame.*"))
    assert len(frames) >= told["usd"]
    for number, path in enumerate(frames):
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
        assert layer.ListTimeSamplesForPath("/World/elements.points") == [number]
    if told["usd"]:
        stage = Usd.Stage.Open(str(where / "a.take" / "root.usda"))
        assert told["usd"] - 1 <= stage.GetEndTimeCode() < len(frames)
        points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements")).GetPointsAttr()
        assert len(points.Get(stage.GetEndTimeCode())) > 0
    if told["gsd"]:
        with gsd.hoomd.open(where / "a.gsd", "r") as file:
            found = [int(f.configuration.step) for f in file]
        assert len(found) >= told["gsd"] and found == [EVERY * n for n in range(len(found))]
    if told["vtk"]:
        assert len(series_of(where)) >= told["vtk"]
        for frame in series_of(where):
            reader = vtkXMLPolyDataReader()
            reader.SetFileName(str(where / frame["name"]))
            reader.Update()
            assert reader.GetOutput().GetNumberOfPoints() > 0
    return steps, len(frames)


def goes_on(where, one_run):
    """Resume a killed run, to the bits and files of the one that was not."""
    sim = wd.resume(where / "a.npz", facets())
    for writer in writers(where).values():
        sim.observe(writer)
    sim.run(steps=WHOLE - sim.steps)
    arrays, log, frames = one_run
    assert bytes_of(sim) == arrays
    assert (where / "a.csv").read_bytes().startswith(log)
    assert frames_of(where) == frames
    assert not (where / "a.take").exists()


def killed_and_resumed(where, one_run, count, resumed):
    """Steps of all checkpoints, numbers of runs resumed and of frames that were opened."""
    kills(where, count, 4.0)
    kept, went_on, frames = [], 0, 0
    for turn in range(count):
        steps, opened = check(where / str(turn), one_run[1])
        kept, frames = [*kept, steps], frames + opened
        if steps < WHOLE and went_on < resumed:
            went_on += 1
            goes_on(where / str(turn), one_run)
    return kept, went_on, frames


def test_killed_runs_lose_nothing_they_told_and_go_on(one_run, tmp_path):
    kept, went_on, frames = killed_and_resumed(tmp_path, one_run, 8, 2)
    assert len(kept) == 8 and max(kept) > 0 and went_on == 2 and frames > 10


@pytest.mark.slow
def test_a_hundred_killed_runs(one_run, tmp_path):
    kept, went_on, frames = killed_and_resumed(tmp_path, one_run, 100, 20)
    print(f"{len(kept)} checkpoints whole, {went_on} resumed, {frames} frames opened")
    assert len(kept) == 100 and len(set(kept)) > 10 and went_on == 20 and frames > 500


def test_walls_in_a_resumed_take_are_those_of_one_run(tmp_path):
    """What is drawn of infinite walls has the size that the first frame gave it."""
    one, two = wd.Simulation(tools()), wd.Simulation(tools())
    for sim, name in ((one, "one.usd"), (two, "two.usd")):
        sim.observe(wd.UsdWriter(tmp_path / name, every=5))
    one.run(steps=30)

    class KilledError(Exception):
        pass

    class Killer:
        every = 17

        def observe(self, sim):
            if sim.steps:
                raise KilledError

        def finish(self, sim):
            pass

    two.observe(Killer())
    with pytest.raises(KilledError):
        two.run(steps=30, checkpoint=tmp_path / "a.npz", checkpoint_every=12)
    two = wd.resume(tmp_path / "a.npz", tools())
    two.observe(wd.UsdWriter(tmp_path / "two.usd", every=5))
    two.run(steps=30 - two.steps)
    assert text_of(tmp_path / "one.usd") == text_of(tmp_path / "two.usd")


def test_a_take_that_lost_frames_is_refused(tmp_path):
    sim = wd.Simulation(facets())
    film = sim.observe(wd.UsdWriter(tmp_path / "a.usd", every=5))
    sim.run(steps=0)  # the film begins with the next run
    film._open(sim)
    film._frame = 2
    film._stage = None
    with pytest.raises(wd.InputError, match=r"a\.take lacks frames \[0, 1\]"):
        film._open(sim)


@contextmanager
def room_for(size):
    """Files of no more bytes can be written, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("what", ["log", "frames", "checkpoint", "json"])
def test_a_full_disk_is_told_and_earlier_data_is_whole(what, tmp_path):
    sim = wd.Simulation(facets())
    if what == "log":
        sim.observe(wd.BreakLog(tmp_path / "a.csv", every=1))
    if what == "frames":
        sim.observe(wd.UsdWriter(tmp_path / "a.usd", every=4))
    path = tmp_path / "a.npz"
    sim.run(steps=20, checkpoint=path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def act():
        if what == "json":
            whole.write_json(tmp_path / "run.json", {"numbers": list(range(1000))})
        sim.run(steps=20, checkpoint=path if what == "checkpoint" else None)

    with room_for(900), pytest.raises(wd.UnwritableError, match=r"cannot write .* whole"):
        act()
    after = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    for p, data in before.items():
        assert after[p].startswith(data) if p.suffix == ".csv" else after[p] == data, p
    assert not [p for p in after if ".part" in p.name]
    again = wd.resume(path, facets())
    assert again.steps == 20


def test_a_folder_that_is_gone_is_told(tmp_path):
    sim = wd.Simulation(facets())
    place = tmp_path / "disk"
    place.mkdir()
    kept = wd.Checkpoint(place / "a.npz", every=5)
    shutil.rmtree(place)
    sim.observe(kept)
    with pytest.raises(wd.UnwritableError, match=r"cannot write .*No such file"):
        sim.run(steps=10)
    with pytest.raises(wd.InputError, match="cannot write into the folder"):
        wd.BreakLog("/proc/none/a.csv")


def doubled(x: wp.array(dtype=float)):
    i = wp.tid()
    x[i] = 2.0 * x[i]


@pytest.fixture
def kernel(tmp_path, monkeypatch):
    """A kernel compiled into a cache of its own: a call of it, and its files."""
    cache.start()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path / "cache"))
    (tmp_path / "cache").mkdir()
    made = memory.kernel(doubled)
    made.module.unload()

    def call():
        made.module.unload()  # as in another process
        x = wp.ones(100, dtype=float, device="cpu")
        wp.launch(made, 100, [x], device="cpu")
        assert (x.numpy() == 2.0).all()

    call()
    (folder,) = (tmp_path / "cache").iterdir()
    yield call, {p.suffix: p for p in folder.iterdir()}
    made.module.unload()


@pytest.mark.parametrize(  # without a digest one bit cannot be seen
    ("fault", "is_sealed"),
    [("bit", True), *((fault, x) for fault in ("cut", "empty", "gone") for x in (True, False))],
)
@pytest.mark.parametrize("suffix", [".o", ".meta"])
def test_a_damaged_kernel_is_built_anew(kernel, fault, suffix, is_sealed):
    call, files = kernel
    path, seal = files[suffix], files[".sha256"]
    good = path.read_bytes()
    bad = bytearray(good)
    bad[len(bad) // 3] ^= 4
    if fault == "gone":
        path.unlink()
    else:
        path.write_bytes({"bit": bytes(bad), "cut": good[: len(good) // 2], "empty": b""}[fault])
    if not is_sealed:
        seal.unlink()
    call()
    assert path.read_bytes() == good
    assert seal.exists()


def test_a_cache_that_cannot_be_written_is_told(kernel, monkeypatch):
    call, files = kernel
    shutil.rmtree(files[".o"].parents[1])
    files[".o"].parents[1].write_text("not a folder")
    with pytest.raises(wd.UnwritableError, match="set WARP_CACHE_PATH"):
        call()
    files[".o"].parents[1].unlink()
    monkeypatch.setattr(wp, "init", lambda: Path("/proc/none/cache").mkdir())
    with pytest.raises(wd.UnwritableError, match="cannot keep compiled kernels"):
        wd.Simulation(facets())


COLD = """
import sys
sys.path.insert(0, {tests!r})
import warpdem as wd
from test_checkpoint import facets, bytes_of
from hashlib import sha256
sim = wd.Simulation(facets())
sim.run(steps=50)
print(sha256(b"".join(v for _, v in sorted(bytes_of(sim).items()))).hexdigest())
"""


@pytest.mark.slow
def test_four_cold_starts_at_once_give_one_result(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    code = COLD.format(tests=str(Path(__file__).parent))
    command = [sys.executable, "-c", code]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    said = [process.communicate()[0].split()[-1] for process in started]
    assert [process.returncode for process in started] == [0] * 4
    assert len(set(said)) == 1


@pytest.mark.parametrize(
    ("number", "ends"), [(signal.SIGTERM, SystemExit), (signal.SIGINT, KeyboardInterrupt)]
)
def test_a_signal_within_a_step_saves_a_whole_one(number, ends, tmp_path):
    """While the passes of steps run: they are made, then the state is written."""
    sim, path = wd.Simulation(facets()), tmp_path / "a.npz"
    advance = sim._step.advance

    def interrupted(steps):
        signal.raise_signal(number)
        advance(steps)

    sim._step.advance = interrupted
    with pytest.raises(ends) as ended:
        sim.run(steps=40, checkpoint=path)
    if ends is SystemExit:
        assert ended.value.code == 128 + number
    again, one = wd.resume(path, facets()), wd.Simulation(facets())
    assert 0 < again.steps < 40
    again.run(steps=40 - again.steps)
    one.run(steps=40)
    assert bytes_of(again) == bytes_of(one)


def test_many_bytes_are_claimed_by_a_header_alone(tmp_path):
    """A checkpoint whose header claims 1e12 values of a state array is refused as damaged."""
    sim = wd.Simulation(facets())
    path = tmp_path / "a.npz"
    sim.save(path)
    header, arrays = archive.read_archive(path)
    name = "state/velocity"
    header["arrays"][name] = ["<f8", [10**12]]
    told = {k: v for k, v in header.items() if k not in ("version", "arrays")}
    archive.write_archive(path, told, arrays | {name: np.zeros(3)})
    with pytest.raises(wd.InputError, match="velocity of the checkpoint is float64"):
        wd.resume(path, facets())

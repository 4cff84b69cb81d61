"""Runs killed at random moments: `python tests/kills.py FOLDER COUNT SECONDS`.

Each run writes checkpoints, a log of broken bonds, and frames as USD, GSD and VTK into a folder of
its own, and says through a pipe how many lines and frames it was told are on the disk. They are
children of this one process, which has compiled and built all before, so that a kill falls into the
run itself.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
from test_checkpoint import facets

import warpdem as wd

EVERY = 4  # steps from frame to frame


def writers(folder):
    """What a run writes, by the name under which it is told."""
    return {
        "log": wd.BreakLog(folder / "a.csv", every=1),
        "usd": wd.UsdWriter(folder / "a.usd", every=EVERY),
        "gsd": wd.GsdWriter(folder / "a.gsd", every=EVERY),
        "vtk": wd.VtkWriter(folder / "a.vtp", every=EVERY),
    }


def acknowledging(observer, pipe, name):
    """The observer, which tells after each look how many lines or frames it has written."""
    look, frames = observer.observe, 0

    def observe(sim):
        nonlocal frames
        look(sim)
        frames += 1
        number = observer.rows if name == "log" else frames
        os.write(pipe, f"{name} {number}\n".encode())

    observer.observe = observe
    return observer


def killed(sim, folder, seconds):
    """Start a run, kill it so long after it has begun, and return what it said."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        for name, writer in writers(folder).items():
            sim.observe(acknowledging(writer, theirs, name))
        sim.save(folder / "a.npz")
        os.write(theirs, b"begun\n")
        sim.run(steps=10**7, checkpoint=folder / "a.npz", checkpoint_every=10)
    os.close(theirs)
    with os.fdopen(ours) as pipe:
        assert pipe.readline() == "begun\n"
        time.sleep(seconds)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return pipe.read().splitlines()


def main(where, count, longest):
    """Kill runs; acknowledged.json in each folder has the last counts that were told."""
    rng, sim = np.random.default_rng(5), wd.Simulation(facets())
    writers(where)  # their libraries are imported once for all
    for turn in range(count):
        folder = where / str(turn)
        folder.mkdir()
        told = dict.fromkeys(writers(folder), 0)
        for line in killed(sim, folder, longest * float(rng.uniform()) ** 2):
            name, number = line.split()
            told[name] = int(number)
        (folder / "acknowledged.json").write_text(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))

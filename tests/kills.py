"""Runs killed at random moments: `python tests/kills.py FOLDER COUNT SECONDS`.

Each run writes checkpoints, a log of broken bonds and USD frames into a folder of its own, and says
through a pipe how many lines and frames it was told are on the disk. They are children of this one
process, which has compiled and built all before, so that a kill falls into the run itself.
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


def acknowledging(observer, pipe, key, count):
    """The observer, which tells its count after each look."""
    look = observer.observe

    def observe(sim):
        look(sim)
        os.write(pipe, f"{key} {count()}\n".encode())

    observer.observe = observe
    return observer


def outputs(sim, folder, pipe):
    """What a run writes."""
    log, film = wd.BreakLog(folder / "a.csv", every=1), wd.UsdWriter(folder / "a.usd", every=4)
    sim.observe(acknowledging(log, pipe, "rows", lambda: log.rows))
    sim.observe(acknowledging(film, pipe, "frames", lambda: film._frame))


def killed(sim, folder, seconds):
    """Start a run, kill it so long after it has begun, and return what it said."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        outputs(sim, folder, theirs)
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
    assert wd.UsdWriter  # imported once for all
    for turn in range(count):
        folder = where / str(turn)
        folder.mkdir()
        told = {"rows": 0, "frames": 0}
        for line in killed(sim, folder, longest * float(rng.uniform()) ** 2):
            key, number = line.split()
            told[key] = int(number)
        (folder / "acknowledged.json").write_text(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))

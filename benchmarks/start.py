"""Time from the command to the first step of an experiment, kernels compiled before or not.

Written to start.json: seconds of a process of its own, cold (no kernel on disk) and warm, seconds
of the processor of the warm one, and the number of kernels compiled by then.

    python benchmarks/start.py [--quick]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from warpdem.benchmark.timing import about, spread
from warpdem.write.whole import write_json

HERE = Path(__file__).parent


def started(experiment: str, cache: str, options: list[str]) -> tuple[float, float]:
    """Seconds until the first step could be made: on the clock, and of the processor."""
    environment = os.environ | {
        "WARP_CACHE_PATH": cache,
        "PYTHONPATH": os.pathsep.join(
            x for x in (str(HERE.parent), os.environ.get("PYTHONPATH", "")) if x
        ),
    }
    command = [sys.executable, "-m", "warpdem", "run", experiment, "--compile-only", *options]
    began, before = time.perf_counter(), os.times()
    subprocess.run(command, env=environment, capture_output=True, check=True)
    after = os.times()
    worked = after.children_user + after.children_system
    worked -= before.children_user + before.children_system
    return time.perf_counter() - began, worked


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small plate, one round")
    parser.add_argument("--output", type=Path, default=HERE / "start.json")
    given = parser.parse_args()
    small = ["--spacing", "4e-5"] if given.quick else []
    runs = []
    for experiment in ("mode-i",) if given.quick else ("mode-i", "mode-ii", "tension"):
        options = small if experiment == "mode-i" else []
        with tempfile.TemporaryDirectory() as cache:
            cold, _ = started(experiment, cache, options)
            kernels = sum(1 for _ in Path(cache).rglob("*.o"))
            warm, worked = zip(
                *(started(experiment, cache, options) for _ in range(1 if given.quick else 5)),
                strict=True,
            )
        runs.append({"experiment": experiment, "kernels": kernels, "cold": cold,
                     "warm": spread(list(warm)), "processor": spread(list(worked))})  # fmt: skip
        print(
            f"{experiment}: cold {cold:.1f} s, {kernels} kernels compiled; warm "
            f"{runs[-1]['warm']['median']:.2f} s, of the processor {min(worked):.2f} s"
        )
    write_json(given.output, {"machine": about(), "runs": runs, "load after": about()["load"]})


if __name__ == "__main__":
    main()

"""What a scene pays for laws that it does not use: nothing, shown by counts and by time.

Runs the same scenes on this version and on another checkout of the project, in turns, each in a
process of its own, and writes benchmarks/cost_of_laws.json: kernels in a step, bytes on the device,
median time of a step. The table is printed.

    git worktree add ../before 80cf09f && python benchmarks/cost_of_laws.py --against ../before
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

from warpdem.write.record import describe_machine
from warpdem.write.whole import write_json

HERE = Path(__file__).parents[1]
ROUNDS = 5
RUN = """
import json, sys, time
import numpy as np
import warpdem as wd

name = sys.argv[1]
solid = wd.Material(1.0, 0.3, 1.0)
if "space" in name:
    p = wd.packing.fcc((28.0, 28.0, 28.0), 1.0)
else:
    p = wd.packing.hexagonal((200.0, 173.0), 1.0)
scene = wd.Scene()
more = {"fracture": wd.Rankine(1.0)} if "breakable" in name else {}
if "EVM" in name:
    more["bond"] = wd.EVMBond(1.0, 0.5, 0.1)
body = scene.add(p, solid, **more)
rng = np.random.default_rng(0)
scene.set_velocity(body, 1e-6 * rng.normal(size=p.position.shape))
sim = wd.Simulation(scene, dt=0.1)
sim.run(steps=20)
times = []
for _ in range(5):
    began = time.perf_counter()
    sim.run(steps=40)
    times.append((time.perf_counter() - began) / 40)
kernels = [launch.kernel.key.split("__")[-1] for launch in sim._step._finish_and_start.launches]
print(json.dumps({"kernels": kernels, "bytes": sim.bytes, "seconds": sorted(times)[2],
                  "best": min(times), "elements": len(p)}))
"""
SCENES = (
    "plane, elastic",
    "space, elastic",
    "plane, EVM",
    "plane, breakable",
)


def measured(checkout: Path, scene: str) -> dict:
    """One run in a process of its own."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    command = [sys.executable, "-c", RUN, scene]
    done = subprocess.run(
        command, cwd=checkout, env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", type=Path, required=True, help="another checkout")
    other = parser.parse_args().against
    version = subprocess.run(
        ["git", "describe", "--always"], cwd=other, capture_output=True, text=True, check=True
    ).stdout.strip()
    rows = []
    for scene in SCENES:
        runs = [(measured(other, scene), measured(HERE, scene)) for _ in range(ROUNDS)]
        before, now = runs[0]
        ratios = sorted(b["seconds"] / a["seconds"] for a, b in runs)
        row = {
            "scene": scene,
            "elements": now["elements"],
            "kernels_before": len(before["kernels"]),
            "kernels": len(now["kernels"]),
            "bytes_before": before["bytes"],
            "bytes": now["bytes"],
            "step_before_ms": 1e3 * statistics.median(a["seconds"] for a, _ in runs),
            "step_ms": 1e3 * statistics.median(b["seconds"] for _, b in runs),
            "time_over_before": statistics.median(ratios),
            "time_over_before_range": [ratios[0], ratios[-1]],
            # of all rounds, which a busy machine disturbs least
            "best_over_before": min(b["best"] for _, b in runs) / min(a["best"] for a, _ in runs),
        }
        rows.append(row)
        print(
            f"{scene}: {row['kernels']} kernels ({row['kernels_before']} before), "
            f"{row['bytes']} B ({row['bytes_before']}), {row['step_ms']:.2f} ms a step "
            f"({row['step_before_ms']:.2f}), ratio {row['time_over_before']:.3f} "
            f"({ratios[0]:.3f} to {ratios[-1]:.3f}), of the best {row['best_over_before']:.3f}"
        )
    record = {"against": version, "rounds": ROUNDS, "scenes": rows, "machine": describe_machine()}
    write_json(HERE / "benchmarks" / "cost_of_laws.json", record)


if __name__ == "__main__":
    main()

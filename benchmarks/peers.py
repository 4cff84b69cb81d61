"""Elastic bonded blocks that vibrate: warpdem beside LAMMPS bpm/rotational.

The same particles, bonds and start velocities in both codes, nothing breaks or touches; runs in
turns, each code on one and on two cores. Written to peers.json: element-steps a second of each, and
their ratio to those of LAMMPS on one core in the same round.

    python benchmarks/peers.py --lammps ../lammps
"""

import argparse
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import peer

from warpdem.write.whole import write_json

HERE = Path(__file__).parent
CASES = {"block20": 400, "fcc13": 200, "block40": 60}  # steps in a round
WARM = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lammps", type=Path, required=True, help="its virtual environment")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--output", type=Path, default=HERE / "peers.json")
    given = parser.parse_args()
    lammps = peer.Lammps(given.lammps)
    record: dict[str, Any] = {"rounds": given.rounds, "machine": peer.about(lammps), "cases": {}}
    for case in given.cases.split(","):
        bodies, steps = peer.vibrating(case), CASES[case]
        own = {
            f"{precision}, threads {threads}": peer.simulate(bodies, precision, threads)
            for precision in ("float32", "float64")
            for threads in (1, 2)
        }
        for sim in own.values():
            sim.run(steps=WARM)
        rates: dict[str, list[float]] = defaultdict(list)
        for _ in range(given.rounds):
            for cores in (1, 2):
                told = lammps.run(bodies, steps, cores, warm=WARM)
                rates[f"LAMMPS, cores {cores}"].append(len(bodies.x) * steps / told.seconds)
            for name, sim in own.items():
                began = time.perf_counter()
                sim.run(steps=steps)
                rates[name].append(len(bodies.x) * steps / (time.perf_counter() - began))
        codes = {}
        for name, found in rates.items():
            over = [a / b for a, b in zip(found, rates["LAMMPS, cores 1"], strict=True)]
            codes[name] = {
                "element_steps_per_second": peer.spread(found),
                "over_LAMMPS": peer.spread(over),
            }
            r = codes[name]["over_LAMMPS"]
            print(
                f"{case}, {name}: {peer.spread(found)['median'] / 1e6:.2f} million "
                f"element-steps/s, over LAMMPS {r['median']:.2f} "
                f"({r['least']:.2f} to {r['greatest']:.2f})"
            )
        record["cases"][case] = {
            "elements": len(bodies.x),
            "bonds": len(bodies.bonds),
            "steps": steps,
            "codes": codes,
            "load after": peer.about()["load"],
        }
        write_json(given.output, record)


if __name__ == "__main__":
    main()

"""Elastic bonded blocks that vibrate: warpdem beside LAMMPS bpm/rotational.

The same particles, bonds and start velocities in both codes, nothing breaks or touches; runs in
turns, each code on one and on two cores. Written to peers.json: element-steps a second of each, and
their ratio to those of LAMMPS in the same round, on one core and on as many.

    python benchmarks/peers.py --lammps ../lammps [--quick]
"""

import argparse
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import peer

from warpdem.benchmark.timing import spread
from warpdem.write.whole import write_json

HERE = Path(__file__).parent
CASES = {"block20": 400, "fcc13": 200, "block40": 100, "block60": 100}  # steps in a round
WARM = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lammps", type=Path, required=True, help="its virtual environment")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--output", type=Path, default=HERE / "peers.json")
    parser.add_argument("--quick", action="store_true", help="one short round, to see that it runs")
    given = parser.parse_args()
    if given.quick:
        given.rounds, given.cases = 1, "block20"
    lammps = peer.Lammps(given.lammps)
    record: dict[str, Any] = {"rounds": given.rounds, "machine": peer.about(lammps), "cases": {}}
    for case in given.cases.split(","):
        bodies, steps = peer.vibrating(case), 20 if given.quick else CASES[case]
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
            over, equal = (
                [a / b for a, b in zip(found, rates[f"LAMMPS, cores {n}"], strict=True)]
                for n in (1, int(name[-1]))
            )
            codes[name] = {
                "element_steps_per_second": spread(found),
                "over_LAMMPS": spread(over),
                "over_LAMMPS_on_as_many": spread(equal),
            }
            r = codes[name]["over_LAMMPS_on_as_many"]
            print(
                f"{case}, {name}: {spread(found)['median'] / 1e6:.2f} million "
                f"element-steps/s, over LAMMPS on as many cores {r['median']:.2f} "
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

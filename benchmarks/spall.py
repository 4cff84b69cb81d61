"""Impact of two halves of a bonded block that breaks: warpdem beside LAMMPS bpm/rotational.

8000 particles in a cubic lattice, EVM bonds that break, contact with friction and the search for
neighbours on, in both codes; the same steps from the same start, in turns. Written to spall.json:
element-steps a second, their ratio within a round, the share of warpdem's time in each pass, and
bonds broken and fragments of both. The codes' breaking laws differ: LAMMPS adds up all four loads
of a bond over their strengths, a beam's stresses take tension with bending and shear with torsion,
and the larger counts, so that warpdem breaks somewhat fewer bonds.

    python benchmarks/spall.py --lammps ../lammps
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import peer

from warpdem.benchmark.timing import spread
from warpdem.neighbours import Neighbours
from warpdem.passes import Passes
from warpdem.step import Step
from warpdem.write.whole import write_json

HERE = Path(__file__).parent
# what each kernel is for; the rest of the time is the host's
PARTS = {
    "break_": "breaking",
    "evm_forces": "forces",
    "evm_closing": "closing of broken bonds",
    "evm_settle": "closing of broken bonds",
    "contact_": "contact",
    "move": "motion",
}


@contextmanager
def watched(spent: dict[str, float]):
    """Time each launch of passes, each list of neighbours, and what follows when bonds break."""
    launch, build, break_bonds = Passes.launch, Neighbours.build, Step.break_bonds

    def timed(name: str, function: Callable[..., Any], *given: Any) -> Any:
        began = time.perf_counter()
        result = function(*given)
        spent[name] += time.perf_counter() - began
        return result

    def one_by_one(passes: Passes) -> None:
        for x in passes.launches:
            timed(x.kernel.key.split("__")[-1], x.launch)

    Passes.launch = one_by_one  # type: ignore[method-assign]
    Neighbours.build = lambda *given: timed("search", build, *given)  # type: ignore[method-assign]
    Step.break_bonds = lambda own: timed("break_bonds", break_bonds, own)  # type: ignore[method-assign]
    try:
        yield
    finally:
        Passes.launch, Neighbours.build = launch, build  # type: ignore[method-assign]
        Step.break_bonds = break_bonds  # type: ignore[method-assign]


def shares(bodies: peer.Bodies, precision: str, steps: int) -> dict[str, float]:
    """Share of a run's time in each part."""
    spent: dict[str, float] = defaultdict(float)
    with watched(spent):
        sim = peer.simulate(bodies, precision, breaks=True)
        sim.run(steps=20)
        spent.clear()
        began = time.perf_counter()
        sim.run(steps=steps - 20)
        whole = time.perf_counter() - began
    parts: dict[str, float] = defaultdict(float)
    for name, seconds in spent.items():
        known = [part for key, part in PARTS.items() if name.startswith(key)]
        parts["search" if name == "search" else known[0] if known else name] += seconds / whole
    parts["host and the rest"] = 1.0 - sum(parts.values())
    return dict(sorted(parts.items(), key=lambda item: -item[1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lammps", type=Path, required=True, help="its virtual environment")
    parser.add_argument("--size", type=int, default=20)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--output", type=Path, default=HERE / "spall.json")
    given = parser.parse_args()
    lammps, bodies = peer.Lammps(given.lammps), peer.colliding(given.size)
    n, steps = len(bodies.x), given.steps
    start = peer.about(lammps)
    rates: dict[str, list[float]] = defaultdict(list)
    outcome: dict[str, dict[str, Any]] = {}

    def note(name: str, seconds: float, bonds: Any) -> None:
        rates[name].append(n * steps / seconds)
        sizes = peer.fragments(n, bonds)
        outcome[name] = {
            "broken": len(bodies.bonds) - len(bonds),
            "fragments": len(sizes),
            "greatest": sizes[:3].tolist(),
        }

    for precision in ("float32", "float64"):  # compiles all kernels
        peer.simulate(bodies, precision, breaks=True).run(steps=steps)
    for _ in range(given.rounds):
        told = lammps.run(bodies, steps, breaks=True)
        note("LAMMPS", told.seconds, told.bonds)
        for precision in ("float32", "float64"):
            for threads in (1, 2):
                sim = peer.simulate(bodies, precision, threads, breaks=True)
                began = time.perf_counter()
                sim.run(steps=steps)
                seconds = time.perf_counter() - began
                note(f"{precision}, threads {threads}", seconds, sim.bonds[sim.linked])
    record: dict[str, Any] = {"elements": n, "bonds": len(bodies.bonds), "steps": steps}
    record |= {"rounds": given.rounds, "codes": {}, "LAMMPS shares": told.shares}
    for name, found in rates.items():
        over = [a / b for a, b in zip(found, rates["LAMMPS"], strict=True)]
        record["codes"][name] = {
            "element_steps_per_second": spread(found),
            "over_LAMMPS": spread(over),
            **outcome[name],
        }
        r = record["codes"][name]["over_LAMMPS"]
        print(
            f"{name}: {spread(found)['median'] / 1e6:.2f} million element-steps/s, over LAMMPS"
            f" {r['median']:.2f} ({r['least']:.2f} to {r['greatest']:.2f}), "
            f"{outcome[name]['broken']} bonds broken, {outcome[name]['fragments']} fragments"
        )
    record["shares of one thread"] = {p: shares(bodies, p, steps) for p in ("float32", "float64")}
    for precision, parts in record["shares of one thread"].items():
        print(precision, ", ".join(f"{part} {share:.0%}" for part, share in parts.items()))
    write_json(given.output, record | {"machine": start, "load after": peer.about()["load"]})


if __name__ == "__main__":
    main()

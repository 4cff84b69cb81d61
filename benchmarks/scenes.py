"""What each feature of a scene costs: kernels in a step, bytes of device memory, time of a step.

Written to scenes.json. A scene launches what it needs and no more, so each row beyond the elastic
ones tells what was added; the kernels of a row are listed there. Two rows more are of bodies that
break, on the packings on which memory has limits, with the largest arrays by name.

    python benchmarks/scenes.py [--quick]
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import warpdem as wd
from warpdem.benchmark.scenes import ELASTIC, KINDS, Kind, build
from warpdem.benchmark.timing import about, in_turns, seconds_a_step
from warpdem.write.whole import write_json

HERE = Path(__file__).parent
PRECISIONS = ("float32", "float64")
BREAKS = next(k for k in KINDS if k.breaks and not k.touches)


class ReadStress:
    """Reads the stress every ten steps, as a snapshot does."""

    every = 10

    def observe(self, sim: wd.Simulation) -> None:
        sim.stress  # noqa: B018

    def finish(self, sim: wd.Simulation) -> None:
        pass


def simulated(kind: Kind, dim: int, elements: int, precision: str) -> wd.Simulation:
    sim = wd.Simulation(build(kind, dim, elements), precision=precision)
    if kind.reads_stress:
        sim.observe(ReadStress())
    return sim


def table(size: int, rounds: int, seconds: float, kinds: tuple[Kind, ...]) -> list[dict[str, Any]]:
    """Kinds of one dimension in turns, so that their times can be compared."""
    rows = []
    for dim in (2, 3):
        for precision in PRECISIONS:
            runs: dict[str, Callable[[], float]] = {}
            told: dict[str, dict[str, Any]] = {}
            for kind in kinds:
                sim = simulated(kind, dim, size, precision)
                runs[kind.name] = seconds_a_step(sim, seconds)
                told[kind.name] = {
                    "elements": len(sim.position),
                    "kernels": sim.kernels,
                    "bytes an element": sim.bytes / len(sim.position),
                }
            spent = in_turns(runs, rounds)
            if ELASTIC.name in spent:
                base = spent[ELASTIC.name]["median"]
                told = {k: v | {"over elastic": spent[k]["median"] / base} for k, v in told.items()}
            for name, row in told.items():
                rows.append({"kind": name, "dim": dim, "precision": precision, **row,
                             "seconds a step": spent[name]})  # fmt: skip
                print(
                    f"{name}, {dim}D, {precision}: {len(row['kernels'])} kernels, "
                    f"{row['bytes an element']:.0f} B an element, "
                    f"{1e9 * spent[name]['median'] / row['elements']:.1f} ns an element-step"
                )
    return rows


def memory(size: int) -> list[dict[str, Any]]:
    """Bodies that break, in float32, as they start and once pairs have closed."""
    rows = []
    for name, dim, cell in (
        ("hexagonal", 2, ""), ("fcc", 3, ""), ("Voronoi, space", 3, "voronoi"),
    ):  # fmt: skip
        sim = wd.Simulation(build(BREAKS, dim, size, cell), precision="float32")
        sim.run(steps=1)
        n = len(sim.position)
        rows.append(
            {
                "packing": name,
                "elements": n,
                "bonds an element": len(sim.bonds) / n,
                "bytes an element": sim.bytes / n,
                "arrays": {k: v / n for k, v in sim.memory.items() if v > n},
            }
        )
        print(f"{name}, breaks, float32: {sim.bytes / n:.0f} B an element")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small and short, to see that it runs")
    parser.add_argument("--output", type=Path, default=HERE / "scenes.json")
    given = parser.parse_args()
    rounds, seconds = (1, 0.01) if given.quick else (7, 0.1)
    record: dict[str, Any] = {"machine": about(), "rounds": rounds}
    kinds = KINDS[2:4] if given.quick else KINDS
    record["scenes"] = table(500 if given.quick else 30_000, rounds, seconds, kinds)
    record["memory"] = memory(500 if given.quick else 10_000)
    write_json(given.output, record | {"load after": about()["load"]})


if __name__ == "__main__":
    main()

"""Element-steps a second over size, dimension, law, precision and threads, under their ceilings.

Written to throughput.json, each rate in turns with the others of its table, medians with least and
greatest:

- kinds: scenes of several laws, 64,000 elements, in all precisions, on one thread and on two;
- sizes: cost of an element-step from 8,000 elements to a million;
- ceilings: the same steps of EVM bonds written by hand in C++ (ceiling.cpp) on the same arrays,
  compiled on the spot, and the bandwidth of the STREAM triad;
- crack: the plate of `warpdem run mode-i`, volume term, stresses and Drucker-Prager in every step.

    python benchmarks/throughput.py [--quick]
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ceiling

import warpdem as wd
from warpdem.benchmark.scenes import KINDS, Kind, build
from warpdem.benchmark.timing import about, in_turns, rates, seconds_a_step
from warpdem.experiments import ModeI, mode_i
from warpdem.passes import cores
from warpdem.write.whole import write_json

HERE = Path(__file__).parent
PRECISIONS = ("float32", "mixed", "float64")
LAWS = tuple(k for k in KINDS if not k.reads_stress)
EVM, FACET = KINDS[0], KINDS[2]
SIZES = {"EVM, space": (EVM, 3), "facet, nu = 0.3, plane": (FACET, 2)}


def threads() -> tuple[int, ...]:
    """One, and two where there are two cores."""
    return (1, 2) if cores() > 1 else (1,)


def steppers(
    scene: wd.Scene, precisions: tuple[str, ...], seconds: float
) -> tuple[dict[str, Callable[[], float]], int]:
    """Steps of a scene by precision and threads; elements."""
    runs, dt, elements = {}, None, 0
    for precision in precisions:
        for n in threads():
            sim = wd.Simulation(scene, precision=precision, threads=n, dt=dt)
            dt, elements = sim.dt, len(sim.position)
            runs[f"{precision}, threads {n}"] = seconds_a_step(sim, seconds)
    return runs, elements


def kinds(size: int, rounds: int, seconds: float, names: tuple[Kind, ...]) -> list[dict[str, Any]]:
    """Rates of every kind of scene."""
    rows = []
    for dim in (2, 3):
        for kind in names:
            runs, n = steppers(build(kind, dim, size), PRECISIONS, seconds)
            found = {k: rates(v, n) for k, v in in_turns(runs, rounds).items()}
            rows.append({"kind": kind.name, "dim": dim, "elements": n, "rates": found})
            _tell(f"{kind.name}, {dim}D, {n}", found)
    return rows


def sizes(counts: tuple[int, ...], rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Cost of an element-step over size: all sizes of a scene in turns."""
    rows = []
    for name, (kind, dim) in SIZES.items():
        for precision in ("float32", "float64"):
            runs, elements = {}, []
            for count in counts:
                sim = wd.Simulation(build(kind, dim, count), precision=precision)
                elements.append(len(sim.position))
                runs[str(count)] = seconds_a_step(sim, seconds)
            spent = in_turns(runs, rounds)
            points = [
                {"elements": n, "rates": rates(s, n)}
                for n, s in zip(elements, spent.values(), strict=True)
            ]
            cost = [1.0 / p["rates"]["median"] for p in points]
            rise = max(cost) / cost[0]
            rows.append({"scene": name, "precision": precision, "points": points, "rise": rise})
            print(f"{name}, {precision}: cost rises to {rise:.2f} from {elements[0]} elements")
    return rows


def ceilings(counts: tuple[int, ...], rounds: int, seconds: float) -> dict[str, Any] | None:
    """The same steps in C++, and bandwidth; None without a compiler."""
    if ceiling.compiler() is None:
        print("no C++ compiler: ceilings are not measured")
        return None
    streams = {f"threads {n}": ceiling.triad(n) for n in threads()}
    found = in_turns(streams, rounds)
    bandwidth = {k: {"median": 1.0 / v["median"], "greatest": 1.0 / v["least"]}
                 for k, v in found.items()}  # fmt: skip
    rows = []
    for count in counts:
        for precision in ("float32", "float64"):
            for n in threads():
                scene = build(EVM, 3, count)
                sim, other = (wd.Simulation(scene, precision=precision, threads=t) for t in (n, 1))
                own = seconds_a_step(sim, seconds)
                by_hand = ceiling.Handwritten(other)
                steps = max(2, round(seconds / by_hand.steps(2, n)))
                spent = in_turns(
                    {"warpdem": own, "C++": lambda h=by_hand, k=steps, n=n: h.steps(k, n)}, rounds
                )
                elements, moved = len(sim.position), ceiling.bytes_a_step(sim)
                least = moved / bandwidth[f"threads {n}"]["median"]
                rows.append(
                    {
                        "elements": elements,
                        "precision": precision,
                        "threads": n,
                        "rates": {k: rates(v, elements) for k, v in spent.items()},
                        "share of C++": spent["C++"]["median"] / spent["warpdem"]["median"],
                        "share of bandwidth": least / spent["warpdem"]["median"],
                        "bytes an element-step": moved / elements,
                    }
                )
                r = rows[-1]
                print(
                    f"EVM, space, {elements}, {precision}, threads {n}: of C++ "
                    f"{r['share of C++']:.2f}, of bandwidth {r['share of bandwidth']:.2f}"
                )
    return {"compiler": Path(str(ceiling.compiler())).name, "bytes a second": bandwidth,
            "EVM": rows}  # fmt: skip


def crack(refine: int, rounds: int, seconds: float) -> dict[str, Any]:
    """The plate of mode I as its crack runs."""
    runs: dict[str, Callable[[], float]] = {}
    elements = 0
    for precision in ("float32", "float64"):
        for n in threads():
            sim = started(refine, precision, n)
            elements = len(sim.position)
            runs[f"{precision}, threads {n}"] = seconds_a_step(sim, seconds)
    found = {k: rates(v, elements) for k, v in in_turns(runs, rounds).items()}
    _tell(f"mode I plate, {elements}", found)
    return {"elements": elements, "rates": found}


class Started(Exception):  # noqa: N818
    """Hands a simulation out of an experiment before its first step."""

    def __init__(self, sim: wd.Simulation) -> None:
        self.sim = sim


def started(refine: int, precision: str, threads: int) -> wd.Simulation:
    """The simulation of a mode I experiment, ready for its first step."""

    def leave(sim: wd.Simulation, _: Any) -> list[Any]:
        raise Started(sim)

    try:
        mode_i(ModeI(refine=refine), precision=precision, threads=threads, observers=leave)
    except Started as out:
        return out.sim
    raise AssertionError("the experiment asks for observers before it runs")


def _tell(what: str, found: dict[str, dict[str, float]]) -> None:
    print(f"{what}: " + "; ".join(f"{k} {v['median'] / 1e6:.1f}" for k, v in found.items())
          + " million element-steps/s")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small and short, to see that it runs")
    parser.add_argument("--output", type=Path, default=HERE / "throughput.json")
    given = parser.parse_args()
    quick = given.quick
    rounds, seconds = (1, 0.01) if quick else (7, 0.2)
    record: dict[str, Any] = {"machine": about(), "rounds": rounds}
    record["ceilings"] = ceilings((1000,) if quick else (8000, 64_000, 262_144), rounds, seconds)
    record["crack"] = crack(1 if quick else 2, rounds, seconds)
    record["kinds"] = kinds(500 if quick else 64_000, rounds, seconds, LAWS[:2] if quick else LAWS)
    record["sizes"] = sizes(
        (500, 2000) if quick else (8000, 64_000, 262_144, 1_000_000), rounds, seconds
    )
    write_json(given.output, record | {"load after": about()["load"]})


if __name__ == "__main__":
    main()

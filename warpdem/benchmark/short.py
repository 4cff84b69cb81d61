"""The short version of the benchmarks: what `warpdem bench` prints."""

from collections.abc import Iterator
from dataclasses import dataclass

from ..simulation import Simulation
from .scenes import KINDS, build
from .timing import in_turns, seconds_a_step
from .work import CASES, Point

SHORT = ("elastica", "wave", "hot block", "beam frequency", "spinning bar")  # of seconds
LAST = 2  # points of a line, its finest


@dataclass(frozen=True)
class Speed:
    """A kind of scene: what it needs, and element-steps a second by precision."""

    kind: str
    dim: int
    elements: int
    kernels: int
    bytes: float  # an element, in float32
    rates: dict[str, float]


def speeds(size: int, device: str = "cpu", threads: int = 1, seconds: float = 0.1) -> list[Speed]:
    """Each kind of scene in the plane and in space, median of three turns."""
    found = []
    for dim in (2, 3):
        for kind in KINDS:
            if kind.reads_stress:
                continue
            scene = build(kind, dim, size)
            sims = {
                p: Simulation(scene, device=device, precision=p, threads=threads)
                for p in ("float32", "float64")
            }
            runs = {p: seconds_a_step(sim, seconds) for p, sim in sims.items()}
            spent = in_turns(runs, 3)
            sim = sims["float32"]
            n = len(sim.position)
            rates = {p: n / s["median"] for p, s in spent.items()}
            found.append(Speed(kind.name, dim, n, len(sim.kernels), sim.bytes / n, rates))
    return found


def errors_and_costs(last: int = LAST) -> Iterator[tuple[str, str, str, Point]]:
    """Case, line, knob and point, of the finest points of each line."""
    for name in SHORT:
        case = CASES[name]
        for line, knobs in case.lines.items():
            case.run(**knobs[0])  # compiles its kernels
            for chosen in knobs[-last:]:
                knob, value = next(iter(chosen.items()))
                yield name, line, f"{knob} {value:g}", case.run(**chosen)

"""Times on a machine that does other things as well: in turns, medians and minima."""

import os
import platform
import re
from collections.abc import Callable, Mapping
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from ..passes import BATCH, MANY
from ..simulation import Simulation
from ..write.record import describe_machine

WARM = 10.0  # seconds at most before a timing


def about() -> dict[str, Any]:
    """Machine, versions, date, and how busy the machine is with other things."""
    path = Path("/proc/cpuinfo")
    info = path.read_text() if path.exists() else ""
    model = re.search(r"model name\s*:\s*(.+)", info)
    vectors = next((name for name in ("avx512f", "avx2", "avx") if f" {name} " in info), "")
    return {
        **describe_machine(),
        "processor": model[1] if model else platform.processor(),
        "vectors": vectors,
        "cores": os.cpu_count(),
        "load": list(os.getloadavg()) if hasattr(os, "getloadavg") else [],
        "date": date.today().isoformat(),
    }


def spread(values: list[float]) -> dict[str, float]:
    """Median, least and greatest."""
    return {
        "median": float(np.median(values)),
        "least": float(min(values)),
        "greatest": float(max(values)),
    }


def in_turns(runs: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, dict[str, float]]:
    """Call each in turn, and all again, so that what disturbs one disturbs the others.

    Each returns seconds; what comes back is their spread by name.
    """
    found: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            found[name].append(run())
    return {name: spread(values) for name, values in found.items()}


def seconds_a_step(sim: Simulation, seconds: float = 0.2) -> Callable[[], float]:
    """A function that steps a warm simulation for about so long, in whole graphs of steps, and
    returns seconds a step, those of its looks at the state left out."""

    def timed(steps: int) -> float:
        began = sim.seconds
        sim.run(steps=steps)
        return (sim.seconds - began) / steps

    timed(2)
    each = timed(BATCH)
    if each * MANY < WARM:  # so that graphs of many steps are captured as well
        timed(MANY + BATCH)
    graphs = round(seconds / each / BATCH)
    return lambda: timed(BATCH * max(1, min(64, graphs)))


def rates(seconds: dict[str, float], elements: int) -> dict[str, float]:
    """Element-steps a second, from a spread of seconds a step."""
    return {
        "median": elements / seconds["median"],
        "least": elements / seconds["greatest"],
        "greatest": elements / seconds["least"],
    }

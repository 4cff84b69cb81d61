"""Pieces of broken bodies in files and pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..observe import FragmentTracker
from .whole import folder, unit_of, whole, write_csv

UNITS = {
    **dict.fromkeys("xyz", "m"),
    **dict.fromkeys(("vx", "vy", "vz"), "m/s"),
    **dict.fromkeys(("wx", "wy", "wz"), "rad/s"),
    **dict.fromkeys(("mass", "largest_mass", "mean_mass"), "kg"),
    **dict.fromkeys(("kinetic_energy", "spin_energy"), "J"),
    "time": "s",
}


def write_fragments(path: str | Path, tracker: FragmentTracker) -> None:
    """Into a folder: fragments.csv (the last pieces), fragments_history.csv and fragments.png."""
    where = folder(path)
    write_csv(where / "fragments.csv", tracker.pieces, UNITS)
    write_csv(where / "fragments_history.csv", tracker.history, UNITS)
    draw_fragments(where / "fragments.png", tracker)


def draw_fragments(path: str | Path, tracker: FragmentTracker) -> None:
    """Number of pieces and largest mass over time; masses of the last pieces, cumulated."""
    history, mass = tracker.history, tracker.pieces["mass"]
    total = mass.sum()
    factor, unit = unit_of(float(history["time"].max(initial=1e-12)))
    fig = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = fig.subplots(1, 2)
    time = history["time"] * factor
    left.plot(time, history["pieces"], color="C0")
    left.set_xlabel(f"time [{unit[:-1]}s]")
    left.set_ylabel("number of pieces", color="C0")
    left.set_ylim(bottom=0.0)
    other = left.twinx()
    other.plot(time, history["largest_mass"] / total, color="C3")
    other.set_ylabel("mass of the largest over the whole", color="C3")
    other.set_ylim(0.0, 1.05)
    left.set_title("Pieces over time")
    share = np.sort(mass)[::-1] / total
    right.step(share, np.arange(1, len(share) + 1), where="post", marker=".", color="C0")
    right.set(
        xscale="log",
        yscale="log",
        xlabel="mass over the whole",
        ylabel="number of pieces as heavy or heavier",
        title=f"Masses of the {len(share)} pieces at the end",
    )
    right.grid(which="both", alpha=0.3)
    with whole(path) as part:
        fig.savefig(part, dpi=120)

"""A picture of a sweep."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .whole import whole


def draw_sweep(
    path: Path, at: list[Any], result: NDArray[np.float64], lines: list[str], x: str, y: str
) -> None:
    """A result of every run against a parameter: points, and a line through the mean of each.

    at, result, lines: of each run, (runs,), the last naming the line that it belongs to.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    words = any(not isinstance(a, int | float) for a in at)
    places = [str(a) if words else a for a in at]
    for line in dict.fromkeys(lines):
        mine = [i for i, of in enumerate(lines) if of == line and np.isfinite(result[i])]
        spots = list(dict.fromkeys(places[i] for i in mine))
        if not words:
            spots = sorted(spots)
        means = [np.mean([result[i] for i in mine if places[i] == s]) for s in spots]
        (drawn,) = axes.plot(spots, means, label=line or None)
        axes.plot([places[i] for i in mine], result[mine], "o", color=drawn.get_color())
    axes.set_xlabel(x)
    axes.set_ylabel(y.replace("_", " "))
    if any(lines):
        axes.legend()
    with whole(path) as part:
        figure.savefig(part, dpi=150)

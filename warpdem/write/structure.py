"""Pictures of rods, rings, frames and sheets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from ..errors import Array, InputError
from .whole import folder, unit_of, whole

Shape = tuple[str, Array]


def draw_structure(
    path: str | Path,
    shapes: Sequence[Shape],
    bonds: NDArray[np.int64],
    value: Array | None = None,
    label: str = "",
    title: str = "",
    view: tuple[float, float] = (20.0, -60.0),
) -> None:
    """Draw the bonds of one structure in one or more shapes, all to one scale, as a PNG file.

    shapes: pairs of a name and positions [m] (n, dim), as they are called in the legend; bonds
    (b, 2); value (b,) with its label and unit: colours the last shape's bonds; view: elevation and
    azimuth [degrees] in space.
    """
    names, places = zip(*shapes, strict=True)
    dim = places[0].shape[1]
    if value is not None and np.shape(value) != (len(bonds),):
        raise InputError(f"value has shape {np.shape(value)}; give one a bond ({len(bonds)},).")
    if any(p.shape != places[0].shape for p in places):
        raise InputError("all shapes must have the same elements.")
    folder(Path(path).parent)
    low = np.min([p.min(axis=0) for p in places], axis=0)
    high = np.max([p.max(axis=0) for p in places], axis=0)
    factor, unit = unit_of(float((high - low).max()))
    fig = Figure(figsize=(9, 6), layout="constrained")
    ax = fig.add_subplot(projection="3d" if dim == 3 else None)
    collection = Line3DCollection if dim == 3 else LineCollection
    for index, (name, place) in enumerate(shapes):
        last = index == len(shapes) - 1
        plain = "C3" if last else f"{0.75 - 0.3 * index / len(shapes)}"
        is_coloured = last and value is not None
        lines = collection(
            list(factor * place[bonds]),
            linewidths=2.5 if last else 1.2,
            colors=None if is_coloured else plain,
            cmap="viridis" if is_coloured else None,
            label=name,
        )
        if is_coloured:
            lines.set_array(value)
            fig.colorbar(lines, ax=ax, label=label, shrink=0.7)
        ax.add_collection(lines)
    middle = factor * 0.5 * (low + high)
    half = 0.53 * factor * np.maximum(high - low, 0.15 * (high - low).max())
    ax.set(xlim=(middle[0] - half[0], middle[0] + half[0]))
    ax.set(ylim=(middle[1] - half[1], middle[1] + half[1]))
    ax.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]", title=title)
    ax.locator_params(nbins=5)
    if dim == 3:
        ax.set_zlim(middle[2] - half[2], middle[2] + half[2])  # type: ignore[attr-defined]
        ax.set_zlabel(f"z [{unit}]")  # type: ignore[attr-defined]
        ax.set_box_aspect(half)  # type: ignore[arg-type]
        ax.view_init(*view)  # type: ignore[attr-defined]
    else:
        ax.set_aspect("equal")
    if len(names) > 1:
        legend = ax.legend()
        if value is not None:
            for line in legend.get_lines()[-1:]:
                line.set_color("#21918c")  # the middle of viridis
    with whole(Path(path)) as part:
        fig.savefig(part, dpi=130)

"""Pictures of a field over the elements of a plane body."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from ..errors import Array, InputError, finite
from .whole import folder, unit_of, whole

if TYPE_CHECKING:
    from ..packing import Packing


def draw_field(
    path: str | Path,
    packing: Packing,
    value: ArrayLike,
    label: str = "",
    title: str = "",
    limits: tuple[float, float] | None = None,
    window: tuple[tuple[float, float], tuple[float, float]] | None = None,
) -> None:
    """Draw a value of every element (n,) of a plane packing with faces, each as its cell, PNG.

    label: what it is, with its unit; limits: of the colour scale, by default those of 98 % of the
    elements; window: lower and upper corner [m] of the piece shown.
    """
    if packing.dim != 2 or packing.area is None:
        raise InputError("draw_field takes a plane packing with faces.")
    shown = finite("value", value, (len(packing),))
    folder(Path(path).parent)
    low, high = packing.position.min(axis=0), packing.position.max(axis=0)
    if window is not None:
        low, high = (finite("window", corner, (2,)) for corner in window)
    factor, unit = unit_of(float((high - low).max()))
    if limits is None:
        least, most = np.percentile(shown, [1.0, 99.0])
        if least < 0.0 < most and min(-least, most) > 0.2 * max(-least, most):
            least, most = -max(-least, most), max(-least, most)
        limits = float(least), float(most)
    colours = "RdBu_r" if limits[0] == -limits[1] else "viridis"
    fig = Figure(figsize=(8.5, 6.5), layout="constrained")
    ax = fig.add_subplot()
    cells = PolyCollection(
        [factor * c for c in outlines(packing)], cmap=colours, edgecolors="face", linewidths=0.2
    )
    cells.set_array(shown)
    cells.set_clim(*limits)
    ax.add_collection(cells)
    edge = 0.02 * factor * (high - low).max()
    ax.set(
        xlim=(factor * low[0] - edge, factor * high[0] + edge),
        ylim=(factor * low[1] - edge, factor * high[1] + edge),
        xlabel=f"x [{unit}]",
        ylabel=f"y [{unit}]",
        title=title,
        aspect="equal",
    )
    extend = "both" if shown.min() < limits[0] and shown.max() > limits[1] else (
        "min" if shown.min() < limits[0] else "max" if shown.max() > limits[1] else "neither"
    )  # fmt: skip
    fig.colorbar(cells, ax=ax, label=label, extend=extend)
    with whole(Path(path)) as part:
        fig.savefig(part, dpi=130)


def outlines(packing: Packing) -> list[Array]:
    """Corners of every cell: ends of its faces, and its centre where it meets the surface."""
    assert packing.area is not None and packing.arms is not None
    n = packing.bond_vector / packing.bond_length[:, None]
    along = 0.5 * packing.area[:, None] / packing.thickness * np.stack([-n[:, 1], n[:, 0]], axis=1)
    corners: list[list[Array]] = [[] for _ in range(len(packing))]
    for side in (0, 1):
        for element, arm, half in zip(packing.bonds[:, side], packing.arms[:, side], along,
                                      strict=True):  # fmt: skip
            corners[element] += [arm + half, arm - half]
    exposed = packing.exposed_area / packing.thickness
    cells = []
    for place, own, free, volume in zip(
        packing.position, corners, exposed, packing.volume, strict=True
    ):
        points = np.array([*own, np.zeros(2)])
        size = np.linalg.norm(free)
        missing = volume / packing.thickness
        if size > 1e-6 * np.sqrt(missing):
            mirrored = np.concatenate([points, -points])  # a lattice's cell, mirrored at its centre
            if len(points) > 3 and abs(ConvexHull(mirrored).volume / missing - 1.0) < 1e-6:
                points = mirrored
            else:  # the free side: as far out as fills the cell's area
                points = _closed(points, free / size, missing)
        if len(points) > 2 and np.linalg.matrix_rank(points - points[0]) == 2:
            points = points[ConvexHull(points).vertices]
        cells.append(place + points)
    return cells


def _closed(points: Array, outward: Array, area: float) -> Array:
    """Points and a free side across `outward` that make up an area."""
    across = np.array([-outward[1], outward[0]])
    reach = points @ across
    ends = [reach.min(), reach.max()]

    def with_side(out: float) -> Array:
        return np.concatenate([points, [out * outward + e * across for e in ends]])

    low, high = 0.0, 2.0 * np.sqrt(area)
    for _ in range(30):
        middle = 0.5 * (low + high)
        if ConvexHull(with_side(middle)).volume < area:
            low = middle
        else:
            high = middle
    return with_side(high)

"""Pictures of trials: curves over time, and the bodies and walls at the end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from numpy.typing import NDArray

from ..errors import Array
from ..observe import piece_of
from ..wall import Box, Plane, Sphere, rotated
from .chart import Chart
from .field import outlines
from .whole import folder, unit_of, whole

if TYPE_CHECKING:
    from ..simulation import Simulation
    from ..wall import Wall

SMALL = 3  # elements: pieces up to so many are dust
LARGE = 0.02  # of all elements: pieces from so many on are large ones
DUST = (0.35, 0.35, 0.38, 1.0)
GREY = "0.6"


def draw_trial(path: str | Path, title: str, charts: Sequence[Chart], sim: Simulation) -> None:
    """Charts side by side, and the bodies of a plane scene as they are now, pieces in colours."""
    folder(Path(path).parent)
    flat = sim.model.features.dim == 2 and all(b.packing.area is not None for b in sim.scene.bodies)
    count = len(charts) + flat
    fig = Figure(figsize=(6.2 * count, 5.4), layout="constrained")
    axes = np.atleast_1d(fig.subplots(1, count))
    fig.suptitle(title)
    for ax, chart in zip(axes, charts, strict=False):
        draw_chart(ax, chart)
    if flat:
        draw_bodies(axes[-1], sim)
    with whole(path) as part:
        fig.savefig(part, dpi=120)


def draw_chart(ax: Axes, chart: Chart) -> None:
    """Curves with their names."""
    for line in chart.lines:
        ax.plot(line.x, line.y, line.style, color=line.color, label=line.label or None)
    ax.set(title=chart.title, xlabel=chart.xlabel, ylabel=chart.ylabel)
    ax.grid(alpha=0.3)
    if any(line.label for line in chart.lines):
        ax.legend(fontsize=9)


def draw_bodies(ax: Axes, sim: Simulation) -> None:
    """Cells where the elements are now, each large piece in a colour of its own, and the walls."""
    factor, unit = unit_of(float(np.ptp(sim.position, axis=0).max()))
    piece = piece_of(sim)
    size = np.bincount(piece)
    order = np.argsort(-size)
    colour = np.tile(DUST, (len(size), 1))
    large = [p for p in order if size[p] > max(SMALL, LARGE * len(piece))]
    middle = [p for p in order if SMALL < size[p] <= LARGE * len(piece)]
    colour[large] = colormaps["tab20"](np.arange(len(large)) % 20)
    colour[middle] = colormaps["Set3"](np.arange(len(middle)) % 12)
    cells = []
    for body in sim.scene.bodies:
        at = sim.elements(body)
        move, turn = sim.position[at], sim.orientation[at]
        cells += [
            factor * (x + rotated(q, cell - place))
            for cell, place, x, q in zip(
                outlines(body.packing), body.packing.position, move, turn, strict=True
            )
        ]
    ax.add_collection(
        PolyCollection(cells, facecolors=colour[piece], edgecolors="white", linewidths=0.2)
    )
    cracks = LineCollection(_broken_faces(sim, factor), colors="darkred", linewidths=0.9)
    ax.add_collection(cracks)
    edge = factor * max(b.packing.spacing for b in sim.scene.bodies)
    inner = np.percentile(factor * sim.position, [1.0, 99.0], axis=0)
    corner = np.concatenate(cells)
    low, high = corner.min(axis=0) - edge, corner.max(axis=0) + edge
    room = 0.6 * np.ptp(inner, axis=0).max()  # pieces flown far off stay out of the picture
    low, high = np.maximum(low, inner[0] - room), np.minimum(high, inner[1] + room)
    for wall in sim.scene.walls:
        _draw_wall(ax, wall, sim, factor, 0.5 * (low + high), float(np.linalg.norm(high - low)))
    ax.set(
        xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal",
        xlabel=f"x [{unit}]", ylabel=f"y [{unit}]",
        title=_count(size, sim.time),
    )  # fmt: skip


def _broken_faces(sim: Simulation, factor: float) -> list[Array]:
    """Faces of broken bonds as lines, on the first element of each."""
    packings = [body.packing for body in sim.scene.bodies]
    arm = np.concatenate([p.arms[:, 0] for p in packings if p.arms is not None])
    n = np.concatenate([p.bond_vector / p.bond_length[:, None] for p in packings])
    size = np.concatenate([p.area / p.thickness for p in packings if p.area is not None])
    half = 0.5 * size[:, None] * np.stack([-n[:, 1], n[:, 0]], axis=1)
    log = sim.broken_bonds()
    return [
        factor * (sim_x + rotated(q, np.stack([a - h, a + h])))
        for sim_x, q, a, h in zip(
            sim.position[log["i"]], sim.orientation[log["i"]], arm[log["bond"]], half[log["bond"]],
            strict=True,
        )
    ]  # fmt: skip


def _count(size: NDArray[np.int64], time: float) -> str:
    factor, unit = unit_of(time)
    when = f"{factor * time:.3g} {unit[:-1]}s"
    if len(size) == 1:
        return f"At the end, {when}: in one piece"
    return f"At the end, {when}: {len(size)} pieces, the large ones in colours"


def _draw_wall(
    ax: Axes, wall: Wall, sim: Simulation, factor: float, middle: Array, reach: float
) -> None:
    """middle: of the view, that a plane is drawn beside; reach: across the view."""
    place, turn = sim.wall_pose(wall)
    at, shape = factor * place, wall.shape
    if isinstance(shape, Plane):
        n = rotated(turn, shape.normal)
        tangent = np.array([-n[1], n[0]])
        at, along = at + ((middle - at) @ tangent) * tangent, reach * tangent
        edge = [at - along, at + along, at + along - reach * n, at - along - reach * n]
        ax.add_patch(Polygon(edge, facecolor=GREY, edgecolor="0.3", hatch="//", alpha=0.6))
    elif isinstance(shape, Sphere):
        fill = {"fill": False} if shape.hollow else {"facecolor": GREY}
        ax.add_patch(Circle(tuple(at), factor * shape.radius, edgecolor="0.3", **fill))
    elif isinstance(shape, Box):
        size = factor * shape.size
        angle = float(np.degrees(2.0 * np.arctan2(turn[0], turn[1])))
        ax.add_patch(
            Rectangle(tuple(at - 0.5 * size), *size, angle=angle, rotation_point="center",
                      facecolor=GREY, edgecolor="0.3")
        )  # fmt: skip

"""Pictures of a crack run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..errors import Array
from ..observe import CrackTracker, Snapshot
from ..observe.growth import Front
from ..observe.vortex import on_grid
from .whole import unit_of, whole


def draw_crack(
    path: Path,
    crack: CrackTracker,
    field: Snapshot,
    reference_speed: float,
    title: str,
    crack_line: tuple[float, float],
    tip: float,
    reach: float,
    front: Front | None = None,
) -> None:
    """Speed against crack length, and the velocity field near the tip at one instant.

    reference_speed [m/s]: of Rayleigh waves; crack_line: start x and height y of the crack [m];
    tip: its tip in the field [m]; reach: half the width of the piece of the field shown [m];
    front: in space, drawn at its instants.
    """
    factor, unit = unit_of(crack.length.max(initial=reach))
    fig, left, right = _panels(title, front, factor, unit)
    left.axhline(1.0, color="0.4", ls="--", lw=1)
    left.text(0.0, 1.01, "Rayleigh wave speed", color="0.3", va="bottom")
    if len(crack.length):
        left.plot(crack.length * factor, crack.window_speed / reference_speed, "o-", color="C0")
        late = crack.length > 0.5 * (crack.length[-1] + 0.5 * (crack.window or 0.0))
        mean = crack.speed / reference_speed
        left.plot(crack.length[late] * factor, np.full(late.sum(), mean), color="C3", lw=2)
        left.text(
            crack.length[late].mean() * factor,
            mean - 0.05,
            f"mean of the last half: {mean:.3f}",
            color="C3",
            ha="center",
            va="top",
        )
    left.set(
        xlabel=f"crack growth [{unit}]",
        ylabel="crack speed / Rayleigh wave speed",
        ylim=(0.0, 1.2),
        title="Crack speed from break times",
    )
    left.set_xlim(left=0.0)
    _draw_field(fig, right, field, crack_line, tip, reach, factor, unit)
    with whole(path) as part:
        fig.savefig(part, dpi=130)


def draw_shear_crack(
    path: Path,
    length: Array,
    speed: Array,
    wave_speeds: dict[str, float],
    field: Snapshot,
    title: str,
    crack_line: tuple[float, float],
    tip: float,
    reach: float,
    front: Front | None = None,
) -> None:
    """Speed of a shear crack against its growth beside wave speeds, and the field at its tip.

    length [m], speed [m/s]: windows; wave_speeds [m/s]: by name, the greatest last; the rest as of
    `draw_crack`.
    """
    factor, unit = unit_of(float(length.max(initial=reach)))
    fig, left, right = _panels(title, front, factor, unit)
    most = max(wave_speeds.values())
    at_right = left.get_yaxis_transform()  # x over the width of the panel
    for name, value in wave_speeds.items():
        left.axhline(value / most, color="0.4", ls="--", lw=1)
        side = "top" if "Rayleigh" in name else "bottom"
        left.text(0.99, value / most, name, color="0.3", va=side, ha="right", transform=at_right)
    left.plot(length * factor, speed / most, "o-", color="C0")
    left.set(
        xlabel=f"crack growth [{unit}]",
        ylabel="crack speed / P wave speed",
        ylim=(0.0, 1.1),
        title="Crack speed from break times",
    )
    left.set_xlim(left=0.0)
    _draw_field(fig, right, field, crack_line, tip, reach, factor, unit)
    with whole(path) as part:
        fig.savefig(part, dpi=130)


def _panels(title: str, front: Front | None, factor: float, unit: str) -> tuple[Figure, Axes, Axes]:
    """Two panels side by side; in space a third below, with the front at its instants."""
    fig = Figure(figsize=(13, 5 if front is None else 7), layout="constrained")
    fig.suptitle(title)
    upper: Any = fig
    if front is not None:
        upper, lower = fig.subfigures(2, 1, height_ratios=[5, 2])  # type: ignore[misc]
        _draw_front(lower, front, factor, unit)
    left, right = upper.subplots(1, 2, gridspec_kw={"width_ratios": [1, 1.5]})
    return fig, left, right


def _draw_front(fig: Any, front: Front, factor: float, unit: str) -> None:
    """The front at its instants, seen across the crack's plane."""
    ax = fig.subplots()
    if len(front.time):
        scale = Normalize(front.time[0] * 1e6, front.time[-1] * 1e6)
        for time, ahead in zip(front.time, front.ahead, strict=True):
            color = colormaps["viridis"](scale(time * 1e6))
            ax.plot(ahead * factor, front.across * factor, "o-", ms=3, color=color)
        fig.colorbar(ScalarMappable(scale, "viridis"), ax=ax, label="time [µs]")
    ax.set(
        xlabel=f"x [{unit}]",
        ylabel=f"z [{unit}]",
        title="Front of the crack at some instants; z is through the thickness (axes of unlike "
        "scale)",
    )


def _draw_field(
    fig: Figure,
    ax: Axes,
    field: Snapshot,
    crack_line: tuple[float, float],
    tip: float,
    reach: float,
    factor: float,
    unit: str,
) -> None:
    if not field.taken:
        ax.set_axis_off()
        ax.text(0.5, 0.5, "the crack did not run far enough\nfor a picture of its tip", ha="center")
        return
    start, height = crack_line
    half, step = np.array([reach, 0.65 * reach]), reach / 80.0
    middle = np.array([tip, height])
    plane = on_grid(field.position, field.velocity, middle - half, middle + half, step)
    spin = 0.5 * plane.vorticity  # of the material
    limit = np.nanpercentile(np.abs(spin), 97.0)
    image = ax.pcolormesh(
        plane.x * factor,
        plane.y * factor,
        spin,
        cmap="RdBu_r",
        vmin=-limit,
        vmax=limit,
        shading="gouraud",
        rasterized=True,
    )
    fig.colorbar(image, ax=ax, label="rotation rate of the material [rad/s]", shrink=0.8)
    # streamlines of the velocity without the shaking of single elements
    calm = plane.smoothed(2.0 * step)
    ax.streamplot(
        plane.x * factor,
        plane.y * factor,
        calm.velocity[..., 0],
        calm.velocity[..., 1],
        density=1.7,
        color="0.15",
        linewidth=0.7,
        arrowsize=0.8,
    )
    left = max(start, tip - reach)
    ax.plot(np.array([left, tip]) * factor, np.full(2, height) * factor, color="k", lw=2.5)
    ax.plot(tip * factor, height * factor, ">", color="k", ms=9)
    ax.set(
        xlim=((tip - reach) * factor, (tip + reach) * factor),
        xlabel=f"x [{unit}]",
        ylabel=f"y [{unit}]",
        aspect="equal",
        title="Streamlines of the velocity near the tip (thick line: crack)",
    )


def draw_free_crack(
    path: Path,
    title: str,
    position: Array,
    field: Snapshot,
    log: NDArray[np.void],
    speeds: NDArray[np.void],
    reference_speed: float,
    expected: dict[str, Any],
) -> None:
    """Paths of cracks over the stress at one instant, and their speeds against time.

    position (n, 2) [m]: of elements at first; field: with the greatest principal stress; log: of
    broken bonds; speeds: columns branch, time [s], speed [m/s]; reference_speed [m/s]: of Rayleigh
    waves; expected: published facts to draw beside: `notches` [m], `lines` (m, 2) [m] (closed ones
    are filled), `levels` of speed over the reference, `times` (first, last) [s], by their words.
    """
    factor, unit = unit_of(float(np.ptp(position, axis=0).max()))
    wide = np.ptp(position[:, 0]) > 1.6 * np.ptp(position[:, 1])
    fig = Figure(figsize=(9.5, 8.5) if wide else (14, 6), layout="constrained")
    left, right = fig.subplots(2, 1) if wide else fig.subplots(1, 2)
    fig.suptitle(title)
    if field.taken:
        image, extent = _nearest(position, field.stress)
        limit = np.nanpercentile(np.abs(image), 99.0) / 1e6
        shown = left.imshow(
            image / 1e6, extent=[factor * e for e in extent], origin="lower", cmap="RdBu_r",
            vmin=-limit, vmax=limit, alpha=0.6, interpolation="nearest",
        )  # fmt: skip
        words = f"greatest principal stress at {field.time * 1e6:.4g} µs [MPa]"
        fig.colorbar(shown, ax=left, label=words, shrink=0.85)
    for words, line in expected["lines"].items():
        left.fill(*(factor * line.T), facecolor="0.5", edgecolor="0.3", alpha=0.35, label=words)
    for notch in expected["notches"]:
        left.plot(*(factor * np.array(notch).T), color="k", lw=3, label="notch")
    dots = left.scatter(
        log["x"] * factor, log["y"] * factor, c=log["time"] * 1e6, s=7, cmap="viridis", zorder=3
    )
    fig.colorbar(dots, ax=left, label="broken bonds: time [µs]", shrink=0.85)
    left.set(
        aspect="equal",
        xlim=(factor * position[:, 0].min(), factor * position[:, 0].max()),
        ylim=(factor * position[:, 1].min(), factor * position[:, 1].max()),
        xlabel=f"x [{unit}]",
        ylabel=f"y [{unit}]",
        title="Paths of the cracks",
    )
    if left.get_legend_handles_labels()[0]:
        left.legend(fontsize=9)  # where it hides least
    for number in np.unique(speeds["branch"]):
        rows = np.sort(speeds[speeds["branch"] == number], order="time")
        x, y = rows["time"] * 1e6, rows["speed"] / reference_speed
        right.plot(x, y, "o-", ms=4, label=f"branch {number}" if number < 8 else None)
    for words, (first, last) in expected["times"].items():
        right.axvspan(first * 1e6, last * 1e6, color="C2", alpha=0.2, label=words)
    for words, level in expected["levels"].items():
        right.axhline(level, color="0.4", ls="--", lw=1)
        right.text(
            0.99, level, words, transform=right.get_yaxis_transform(), ha="right", va="bottom"
        )
    right.set(
        xlabel="time [µs]",
        ylabel="crack speed / Rayleigh wave speed",
        ylim=(0.0, max(1.2, 1.1 * speeds["speed"].max(initial=0.0) / reference_speed)),
        title="Crack speed from break times",
    )
    right.set_xlim(left=0.0)
    if right.get_legend_handles_labels()[0]:
        right.legend(fontsize=9, loc="upper right", ncols=2)
    with whole(path) as part:
        fig.savefig(part, dpi=110, bbox_inches="tight")


def _nearest(position: Array, value: Array, pixels: int = 500) -> tuple[Array, list[float]]:
    """An image of the value of the nearest element, and its extent [m]."""
    from scipy.spatial import cKDTree

    low, high = position.min(axis=0), position.max(axis=0)
    step = float((high - low).max()) / pixels
    x, y = (np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    return value[cKDTree(position).query(grid)[1]], [low[0], high[0], low[1], high[1]]

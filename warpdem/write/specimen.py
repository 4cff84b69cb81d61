"""Pictures of tests of rock: stress against strain, the broken specimen, strength envelopes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..errors import Array
from .field import outlines
from .whole import folder, unit_of, whole

if TYPE_CHECKING:
    from ..observe import FracturePlane, StressStrain
    from ..packing import Packing

BINS = 60  # of strain, in the counts of broken bonds
MEGA = 1e-6
COLOURS = "plasma"


def draw_test(
    path: str | Path,
    title: str,
    packing: Packing,
    history: StressStrain,
    volumetric_strain: Array,
    log: NDArray[np.void],
    break_strain: Array,
    plane: FracturePlane | None,
    displacement: Array,
    sign: float,
    stress_name: str = "axial stress",
    criterion_strength: float = np.nan,
) -> None:
    """Stress and emission against strain, and the specimen at the end with its broken bonds.

    history, log, break_strain (b,), plane: of the test; displacement [m] (n, dim) at its end; sign:
    1 if tension is drawn upwards, -1 if compression; criterion_strength [Pa]: drawn as a line.
    """
    path = Path(path)
    folder(path.parent)
    fig = Figure(figsize=(13, 6.5), layout="constrained")
    left, right = fig.subplots(1, 2, gridspec_kw={"width_ratios": [1.25, 1]})
    fig.suptitle(title)
    _draw_curve(left, history, volumetric_strain, break_strain, sign, stress_name,
                criterion_strength)  # fmt: skip
    span = _span(break_strain, 1e3)
    if packing.dim == 2:
        _draw_plane_specimen(right, packing, log, 1e3 * break_strain, displacement, span)
    else:
        _draw_solid_specimen(right, packing, log, 1e3 * break_strain, history.axis, plane, span)
    _draw_fracture_plane(right, packing, history.axis, plane)
    shown = ScalarMappable(span, COLOURS)
    fig.colorbar(shown, ax=right, label="axial strain at which the bond broke [1e-3]", shrink=0.8)
    modes = [int((log["mode"] == m).sum()) for m in ("normal", "shear")]
    right.set_title(f"Broken bonds: {modes[0]} in tension, {modes[1]} in shear")
    with whole(path) as part:
        fig.savefig(part, dpi=130)


def draw_envelope(
    path: str | Path,
    title: str,
    confining: Array,
    strength: Array,
    line_confining: Array,
    line_strength: Array,
    slope: float,
    compression: float,
) -> None:
    """Strength against confining pressure [Pa], (c,), beside the criterion's line (k,).

    slope, compression [Pa]: of the straight line through the points.
    """
    path = Path(path)
    folder(path.parent)
    fig = Figure(figsize=(7.5, 6.0), layout="constrained")
    ax = fig.add_subplot()
    ax.plot(line_confining * MEGA, line_strength * MEGA, color="0.35",
            label="criterion in homogeneous stress")  # fmt: skip
    ends = np.array([0.0, confining.max()])
    ax.plot(ends * MEGA, (compression + slope * ends) * MEGA, color="C3", ls="--", lw=1.2,
            label=f"{compression * MEGA:.3g} MPa + {slope:.3g} x pressure")  # fmt: skip
    ax.plot(confining * MEGA, strength * MEGA, "o", color="C3", ms=8, label="specimens")
    ax.set(
        xlabel="confining pressure [MPa]",
        ylabel="axial stress at the peak, compression positive [MPa]",
        title=title,
        ylim=(0.0, None),
    )
    ax.legend(loc="upper left")
    with whole(path) as part:
        fig.savefig(part, dpi=130)


def _draw_curve(
    ax: Axes,
    history: StressStrain,
    volumetric_strain: Array,
    break_strain: Array,
    sign: float,
    stress_name: str,
    criterion_strength: float,
) -> None:
    axis, gauge = history.axis, history.gauge_strain
    stress, strain = sign * history.stress * MEGA, 1e3 * sign * history.strain
    others = [k for k in range(gauge.shape[1]) if k != axis]
    # a gauge across which the specimen breaks goes off the scale
    reach = np.abs(strain).max(initial=1e-9)
    lateral, volume = (
        np.where(np.abs(v) < 1.2 * reach, v, np.nan)
        for v in (1e3 * sign * gauge[:, others].mean(axis=1), 1e3 * sign * volumetric_strain)
    )
    ax.plot(strain, stress, color="C0", lw=2, label="axial strain of the grips")
    ax.plot(lateral, stress, color="C2", lw=1.2, label="lateral strain of the core")
    ax.plot(volume, stress, color="C1", lw=1.2, ls="--", label="volumetric strain of the core")
    peak = history.peak
    ax.plot(strain[peak], stress[peak], "o", color="C0")
    ax.annotate(f"peak {stress[peak]:.4g} MPa", (strain[peak], stress[peak]), (-8, 6),
                textcoords="offset points", ha="right")  # fmt: skip
    top = stress.max()
    if np.isfinite(criterion_strength):
        line = criterion_strength * MEGA
        ax.axhline(line, color="0.5", ls=":", lw=1.2, label="criterion in homogeneous stress")
        top = max(top, line)
    ax.axvline(0.0, color="0.85", lw=0.8, zorder=0)
    ax.set_ylim(min(0.0, 1.1 * stress.min()), 1.12 * top)
    kind = ""
    if stress_name == "axial stress":
        kind = f", {'tension' if sign > 0.0 else 'compression'} positive"
    ax.set(
        xlabel=f"strain, {'extension' if sign > 0.0 else 'shortening'} positive [1e-3]",
        ylabel=f"{stress_name}{kind} [MPa]",
        title="Stress, strain and broken bonds",
    )
    ax.legend(loc="upper left", fontsize=9)
    count = ax.twinx()
    width = np.linspace(0.0, strain.max(initial=1e-9), BINS)
    count.hist(1e3 * break_strain, width.tolist(), color="C3", alpha=0.45)
    most = np.histogram(1e3 * break_strain, width)[0].max(initial=1)
    count.set_ylim(0.0, 2.2 * most)  # below the curve
    count.set_ylabel("bonds broken in each sixtieth of the strain", color="C3")
    count.tick_params(axis="y", colors="C3")


def _draw_plane_specimen(
    ax: Axes, packing: Packing, log: NDArray[np.void], at: Array, displacement: Array,
    span: Normalize,
) -> None:  # fmt: skip
    assert packing.area is not None and packing.arms is not None
    factor, unit = unit_of(float(np.ptp(packing.position, axis=0).max()))
    shapes = [factor * (c + u) for c, u in zip(outlines(packing), displacement, strict=True)]
    ax.add_collection(PolyCollection(shapes, facecolors="0.93", edgecolors="0.85", linewidths=0.3))
    bond = log["bond"]
    i = packing.bonds[bond, 0]
    middle = packing.position[i] + displacement[i] + packing.arms[bond, 0]
    n = packing.bond_vector[bond] / packing.bond_length[bond, None]
    half = 0.5 * packing.area[bond, None] / packing.thickness * np.stack([-n[:, 1], n[:, 0]], 1)
    faces = factor * np.stack([middle - half, middle + half], axis=1)
    lines = LineCollection(list(faces), cmap=COLOURS, norm=span, linewidths=1.6)
    lines.set_array(at)
    ax.add_collection(lines)
    _frame(ax, factor * packing.position, factor * packing.spacing, unit, "xy")


def _draw_solid_specimen(
    ax: Axes, packing: Packing, log: NDArray[np.void], at: Array, axis: int,
    plane: FracturePlane | None, span: Normalize,
) -> None:  # fmt: skip
    """Seen along the strike of the plane of fracture, or along y."""
    factor, unit = unit_of(float(np.ptp(packing.position, axis=0).max()))
    across, name = _view(packing.dim, axis, plane)
    frame = np.stack([across, np.eye(3)[axis]])
    place = np.stack([log[c] for c in "xyz"], axis=1)
    body = factor * packing.position @ frame.T
    ax.scatter(body[:, 0], body[:, 1], s=8, color="0.88", linewidths=0)
    seen = factor * place @ frame.T
    ax.scatter(seen[:, 0], seen[:, 1], c=at, cmap=COLOURS, norm=span, s=6, linewidths=0, alpha=0.6)
    _frame(ax, body, factor * packing.spacing, unit, (name, "xyz"[axis]))


def _draw_fracture_plane(
    ax: Axes, packing: Packing, axis: int, plane: FracturePlane | None
) -> None:
    if plane is None:
        return
    factor, _ = unit_of(float(np.ptp(packing.position, axis=0).max()))
    load = np.eye(packing.dim)[axis]
    across, _ = _view(packing.dim, axis, plane)
    frame = np.stack([across, load]) if packing.dim == 3 else np.eye(2)
    normal, point = frame @ plane.normal, factor * frame @ plane.point
    along = np.array([-normal[1], normal[0]])
    if not np.linalg.norm(along) > 0.0:
        return
    box = factor * packing.position @ frame.T
    reach = np.linalg.norm(np.ptp(box, axis=0)) * along / np.linalg.norm(along)
    ends = np.stack([point - reach, point + reach])
    limits = ax.get_xlim(), ax.get_ylim()
    text = f"densest band, {plane.angle_to(load):.0f}° to the load"
    ax.plot(*ends.T, color="k", ls="--", lw=1.2, label=text)
    ax.set(xlim=limits[0], ylim=limits[1])
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), frameon=False)


def _view(dim: int, axis: int, plane: FracturePlane | None) -> tuple[Array, str]:
    """The horizontal direction of a picture, and its name."""
    across = np.zeros(dim)
    across[0] = 1.0
    if dim == 2 or plane is None:
        return across, "x"
    flat = plane.normal.copy()
    flat[axis] = 0.0
    size = np.linalg.norm(flat)
    return (flat / size, "distance across the strike") if size > 0.2 else (across, "x")


def _frame(ax: Axes, place: Array, edge: float, unit: str, names: tuple[str, str] | str) -> None:
    low, high = place.min(axis=0) - 1.5 * edge, place.max(axis=0) + 1.5 * edge
    ax.set(
        xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal",
        xlabel=f"{names[0]} [{unit}]", ylabel=f"{names[1]} [{unit}]",
    )  # fmt: skip


def _span(break_strain: Array, factor: float) -> Normalize:
    if len(break_strain) == 0:
        return Normalize(0.0, 1.0)
    low, high = factor * np.percentile(break_strain, [2.0, 100.0])
    return Normalize(float(low), float(max(high, low + 1e-6)))

"""Lattices in boxes."""

from collections.abc import Mapping, Sequence
from math import inf, prod, sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import Array, InputError, checked, one_of
from ..room import check_elements
from .packing import SIDES, Mask, Packing, check_box, repeated


@checked
def hexagonal(
    size: Sequence[float],
    spacing: float,
    plane: str = "strain",
    thickness: float = 1.0,
    neighbours: int = 1,
    rows: str = "x",
) -> Packing:
    """Close-packed rows in a box from (0, 0), cells of area sqrt(3)/2 spacing^2.

    size: width and height [m] of the box; spacing: distance d of neighbours [m]; plane: "strain"
    or "stress"; thickness [m]; neighbours: 2 adds bonds to second neighbours, without faces; rows:
    the axis that they run along, "x" or "y".
    """
    check_box(size, spacing, 2)
    one_of("rows", rows, ("x", "y"))
    along = int(rows == "y")
    pitch = sqrt(3.0) / 2.0 * spacing
    columns, count = _counts(size[along] / spacing, size[1 - along] / pitch)
    row, column = np.divmod(np.arange(count * columns), columns)
    place = [(column + 0.25 + 0.5 * (row % 2)) * spacing, (row + 0.5) * pitch]
    ends = [(column == 0, column == columns - 1), (row == 0, row == count - 1)]
    if along:
        place, ends = place[::-1], ends[::-1]
    sides = dict(zip(("left", "right", "bottom", "top"), (*ends[0], *ends[1]), strict=True))
    return _lattice(
        np.stack(place, axis=1),
        spacing,
        volume=pitch * spacing * thickness,
        area=spacing / sqrt(3.0) * thickness,
        sides=sides,
        plane=plane,
        thickness=thickness,
        second=_second(neighbours, sqrt(3.0)),
        arrangement="hexagonal",
    )


@checked
def square(
    size: Sequence[float],
    spacing: float,
    plane: str = "strain",
    thickness: float = 1.0,
    neighbours: int = 1,
) -> Packing:
    """Square cells in a box from (0, 0). Facet bonds leave it with gear modes (theory B8).

    size: width and height [m]; spacing: distance d of neighbours [m]; neighbours: 2 adds bonds to
    second neighbours, without faces.
    """
    check_box(size, spacing, 2)
    sites = _sites(size, spacing)
    return _lattice(
        (sites + 0.5) * spacing,
        spacing,
        volume=spacing**2 * thickness,
        area=spacing * thickness,
        sides=_sides(sites),
        plane=plane,
        thickness=thickness,
        second=_second(neighbours, sqrt(2.0)),
    )


@checked
def simple_cubic(size: Sequence[float], spacing: float, neighbours: int = 1) -> Packing:
    """Cubic cells in a box from (0, 0, 0). Facet bonds leave it with gear modes (theory B8).

    size: the three edges of the box [m]; spacing: distance d of neighbours [m]; neighbours: 2 adds
    bonds to second neighbours, without faces.
    """
    check_box(size, spacing, 3)
    sites = _sites(size, spacing)
    return _lattice(
        (sites + 0.5) * spacing,
        spacing,
        volume=spacing**3,
        area=spacing**2,
        sides=_sides(sites),
        second=_second(neighbours, sqrt(2.0)),
    )


@checked
def bcc(size: Sequence[float], spacing: float, neighbours: int = 1) -> Packing:
    """Body-centred cubic packing, eight neighbours, in a box from (0, 0, 0).

    The area of its bonds is not that of Voronoi faces, which would need fourteen neighbours, but
    satisfies the divergence theorem, so that the packing is exactly isotropic (theory B1).
    size: the three edges of the box [m]; spacing: distance d of neighbours [m]; neighbours: 2 adds
    bonds to second neighbours, without faces.
    """
    check_box(size, spacing, 3)
    half = spacing / sqrt(3.0)
    sites = _sites(size, half)
    sites = sites[np.ptp(sites % 2, axis=1) == 0]
    volume = 4.0 * spacing**3 / (3.0 * sqrt(3.0))
    return _lattice(
        (sites + 0.5) * half,
        spacing,
        volume=volume,
        area=3.0 * volume / (4.0 * spacing),
        sides=_sides(sites, layers=2),
        second=_second(neighbours, 2.0 / sqrt(3.0)),
    )


@checked
def fcc(
    size: Sequence[float], spacing: float, neighbours: int = 1, periodic: bool | str = False
) -> Packing:
    """Face-centred cubic packing, cube edges along the axes, in a box from (0, 0, 0).

    size: the three edges of the box [m]; spacing: distance d of neighbours [m]; neighbours: 2 adds
    bonds to second neighbours, without faces. periodic: the packing repeats, along all axes or
    those named, such as "z", after the whole cubes of edge sqrt(2) d nearest to size.
    """
    check_box(size, spacing, 3)
    half = spacing / sqrt(2.0)
    repeats = repeated(periodic, 3)
    edges = np.asarray(size, dtype=np.float64)
    with np.errstate(over="ignore"):  # too many are refused with the sites
        edges[repeats] = 2.0 * half * np.maximum(np.rint(0.5 * edges[repeats] / half), 1.0)
    sites = _sites(edges.tolist(), half)
    sites = sites[sites.sum(axis=1) % 2 == 0]
    sides = _sides(sites)
    return _lattice(
        (sites + 0.5) * half,
        spacing,
        volume=spacing**3 / sqrt(2.0),
        area=spacing**2 / (2.0 * sqrt(2.0)),
        sides={n: m for k, (n, m) in enumerate(sides.items()) if not repeats[k // 2]},
        second=_second(neighbours, sqrt(2.0)),
        arrangement="fcc",
        period=np.where(repeats, edges, inf) if repeats.any() else None,
    )


def _lattice(
    position: NDArray[np.floating],
    spacing: float,
    volume: float,
    area: float,
    sides: Mapping[str, Mask],
    plane: str | None = None,
    thickness: float = 1.0,
    second: float = 1.0,
    arrangement: str = "",
    period: Array | None = None,
) -> Packing:
    from scipy.spatial import cKDTree

    box = None if period is None else np.where(np.isfinite(period), period, 0.0)
    tree = cKDTree(position, boxsize=box)
    bonds = tree.query_pairs(1.01 * second * spacing, output_type="ndarray")
    bonds = bonds.astype(np.int64)
    bonds = bonds[np.lexsort((bonds[:, 1], bonds[:, 0]))]
    half = 0.5 * (position[bonds[:, 1]] - position[bonds[:, 0]])
    if period is not None and box is not None:
        half -= 0.5 * box * np.rint(2.0 * half / period)
    faces = {"area": np.full(len(bonds), area), "arms": np.stack([half, -half], axis=1)}
    return Packing(
        position=position.astype(np.float64),
        volume=np.full(len(position), volume),
        bonds=bonds,
        **(faces if second == 1.0 else {}),
        plane=plane,
        thickness=thickness,
        spacing=spacing,
        sides=sides,
        period=period,
        arrangement=arrangement,
    )


def _second(neighbours: int, distance: float) -> float:
    """How far bonds reach, in spacings: 1, or the distance of second neighbours."""
    one_of("neighbours", neighbours, (1, 2))
    return 1.0 if neighbours == 1 else distance


def _sites(size: Sequence[float], pitch: float) -> NDArray[np.int64]:
    """Integer places of a grid that fills a box, (n, dim)."""
    counts = _counts(*(edge / pitch for edge in size))
    return np.indices(counts).reshape(len(counts), -1).T


def _sides(sites: NDArray[np.int64], layers: int = 1) -> dict[str, Mask]:
    """The outermost `layers` planes of sites on each side."""
    sides = {}
    for axis, (low, high) in enumerate(zip(SIDES[::2], SIDES[1::2], strict=True)):
        if axis < sites.shape[1]:
            sides[low] = sites[:, axis] < layers
            sides[high] = sites[:, axis] > sites[:, axis].max() - layers
    return sides


def _counts(*sites: float) -> list[int]:
    """Whole numbers of sites along the edges of a box; raises InputError if it holds none, or more
    than there is room for."""
    check_elements(prod(sites))
    counts = [round(n) for n in sites]
    if min(counts) < 1:
        raise InputError("the box holds no element; enlarge size or reduce spacing.")
    return counts

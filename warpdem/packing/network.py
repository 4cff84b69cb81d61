"""Networks of bonds without faces: rods, rings, frames, sheets, imported particles."""

from collections.abc import Callable, Sequence
from math import pi, sqrt
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import (
    MOST,
    Array,
    InputError,
    checked,
    entries,
    finite,
    first_ids,
    positive,
    whole_number,
)
from ..room import check_elements
from ..section import Section, check_section
from . import file
from .packing import Mask, Packing

Curve = Callable[[float], ArrayLike] | ArrayLike


@checked
def network(
    position: ArrayLike,
    bonds: ArrayLike,
    volume: ArrayLike,
    radius: ArrayLike | None = None,
    plane: str | None = None,
    thickness: float = 1.0,
    gyration: ArrayLike | None = None,
    axes: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    sides: dict[str, Mask] | None = None,
) -> Packing:
    """Elements joined by given bonds without faces, for EVM bonds.

    position [m] (n, dim); bonds: pairs of elements (b, 2), by their ids if ids are given; volume
    [m^3]: a number or (n,), gives the mass; radius [m]: a number or (n,), gives the inertia, by
    default that of equal volume; gyration [m] (n, 3) and axes (n, 4): as in Packing; ids (n,): your
    own numbers of the elements; sides: named sets of elements.
    """
    x = finite("position", position, (None, None))
    n = len(x)
    pairs = entries("bonds", bonds)
    numbers = None if ids is None else entries("ids", ids)
    if numbers is not None and numbers.shape != (n,):
        raise InputError(f"ids has shape {numbers.shape}; give one for each of {n} elements.")
    if numbers is not None and pairs.size:
        pairs = _places(numbers, pairs)
    return Packing(
        position=x,
        volume=_each("volume", volume, n),
        bonds=pairs,
        radius=None if radius is None else _each("radius", radius, n),
        gyration=None if gyration is None else entries("gyration", gyration),
        axes=None if axes is None else entries("axes", axes),
        ids=numbers,
        plane=plane,
        thickness=thickness,
        sides=sides or {},
    )


@checked
def filament(
    curve: Curve,
    bonds: int,
    section: Section,
    closed: bool = False,
    plane: str | None = None,
    rod_inertia: bool = False,
) -> Packing:
    """A rod along a curve, of bonds of equal length.

    curve: a function of s from 0 to 1 that gives a point [m] of the plane or of space, or points
    along it (m, dim); closed: the end joins the start. An element has the mass of the halves of its
    bonds (theory A8). Its inertia is that of the rod's cross section in bending, density * J *
    length, as a sphere's; with rod_inertia (in space) also in torsion, about the rod's own axis,
    which costs a few times more in motion. Sides: "start" and "end" of an open rod.
    """
    check_elements(whole_number("bonds", bonds, 3 if closed else 1))
    return _chain(_even(curve, bonds, closed), bonds, section, plane, rod_inertia)


def _chain(
    x: Array, bonds: int, section: Section, plane: str | None, rod_inertia: bool = False
) -> Packing:
    """A rod through points (n, dim), whose last is joined to the first if there are n bonds."""
    n, dim = x.shape
    pairs = np.stack([np.arange(bonds), np.arange(1, bonds + 1) % n], axis=1)
    plane = plane if dim == 3 or plane is not None else "stress"
    ends = {"start": np.arange(n) == 0, "end": np.arange(n) == n - 1}
    if rod_inertia and dim == 2:
        raise InputError("rods of the plane do not twist; leave rod_inertia out.")
    return _rods(x, pairs, section, plane, rod_inertia, {} if bonds == n else ends)


@checked
def helix(
    radius: float, pitch: float, turns: float, bonds_per_turn: int, section: Section
) -> Packing:
    """A coil spring about z: radius [m] of the coil, pitch [m] a turn. Sides as of a filament."""
    positive("radius", radius, ())
    positive("turns", turns, ())
    finite("pitch", pitch, ())
    whole_number("bonds_per_turn", bonds_per_turn, 1, int(MOST / max(turns, 1.0)))
    bonds = whole_number("the number of bonds", round(turns * bonds_per_turn), 1)
    check_elements(bonds)
    angle = 2.0 * pi * turns * np.linspace(0.0, 1.0, bonds + 1)
    rise = pitch * angle / (2.0 * pi)
    x = np.stack([radius * np.cos(angle), radius * np.sin(angle), rise], axis=1)
    return _chain(x, bonds, section, None)


@checked
def ring(
    radius: float,
    bonds: int,
    section: Section,
    plane: str | None = None,
    rod_inertia: bool = False,
) -> Packing:
    """A closed circular rod about the origin, radius [m]; with a plane in the plane, else in space
    about z."""
    positive("radius", radius, ())
    check_elements(whole_number("bonds", bonds, 3))
    angle = 2.0 * pi * np.arange(bonds) / bonds
    x = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if plane is None:
        x = np.concatenate([x, np.zeros((bonds, 1))], axis=1)
    return _chain(x, bonds, section, plane, rod_inertia)


@checked
def frame(
    nodes: ArrayLike,
    edges: ArrayLike,
    section: Section,
    bonds_per_edge: int = 1,
    plane: str | None = None,
) -> Packing:
    """Straight rods from node to node, stiff at the nodes.

    nodes [m] (m, dim); edges: pairs of nodes (e, 2); the first m elements are the nodes, those
    between them follow edge by edge.
    """
    x = finite("nodes", nodes, (None, None))
    ends = entries("edges", edges)
    if ends.ndim != 2 or ends.shape[1] != 2 or ends.dtype.kind not in "iu":
        raise InputError("edges must be pairs of nodes, integers of shape (e, 2).")
    if ((ends < 0) | (ends >= len(x))).any():
        raise InputError(f"edges name nodes outside 0..{len(x) - 1}.")
    inside = whole_number("bonds_per_edge", bonds_per_edge, 1) - 1
    check_elements(len(x) + inside * len(ends))
    lone = np.bincount(ends.ravel(), minlength=len(x)) == 0
    if lone.any():
        raise InputError(f"nodes {first_ids(lone)} belong to no edge; leave them out.")
    share = np.arange(1, bonds_per_edge)[:, None] / bonds_per_edge
    position, pairs, count = [x], [], len(x)
    for i, j in ends:
        inner = np.arange(count, count + bonds_per_edge - 1)
        position.append((1.0 - share) * x[i] + share * x[j])
        chain = np.concatenate([[i], inner, [j]])
        pairs.append(np.stack([chain[:-1], chain[1:]], axis=1))
        count += len(inner)
    plane = plane if x.shape[1] == 3 or plane is not None else "stress"
    return _rods(np.concatenate(position), np.concatenate(pairs), section, plane, False, {})


@checked
def honeycomb(size: Sequence[float], spacing: float, thickness: float) -> Packing:
    """A sheet of hexagonal rings in space, in the plane z = 0, as graphene has.

    size: width and height [m]; spacing [m]: length of a bond; thickness [m] of the sheet, which
    with the area of a site gives the mass. Rows along x are zigzag. Sides: left, right, bottom,
    top.
    """
    positive("size", size, (2,))
    positive("spacing", spacing, ())
    positive("thickness", thickness, ())
    width, height = sqrt(3.0) * spacing, 3.0 * spacing
    check_elements(4.0 * (size[0] / width) * (size[1] / height))
    columns, rows = round(size[0] / width), round(size[1] / height)
    if columns < 1 or rows < 1:
        raise InputError("the box holds no ring; enlarge size or reduce spacing.")
    cell = np.array([[0.0, 0.0], [0.5, 0.5], [0.5, 1.5], [0.0, 2.0]]) * [width, spacing]
    row, column = np.divmod(np.arange(rows * columns), columns)
    corner = np.stack([column * width, row * height], axis=1)
    plane = (corner[:, None, :] + cell).reshape(-1, 2)
    x = np.concatenate([plane, np.zeros((len(plane), 1))], axis=1)
    low, high = plane.min(axis=0), plane.max(axis=0)
    near = 0.3 * spacing
    return network(
        x,
        _within(x, 1.1 * spacing),
        volume=thickness * 0.75 * sqrt(3.0) * spacing**2,
        sides={
            "left": plane[:, 0] < low[0] + near,
            "right": plane[:, 0] > high[0] - near,
            "bottom": plane[:, 1] < low[1] + near,
            "top": plane[:, 1] > high[1] - near,
        },
    )


@checked
def load(particles: str | Path, bonds: str | Path | None = None) -> Packing:
    """A saved packing, or bonded particles from files; their ids are kept.

    particles: an NPZ file that Packing.save wrote; or a CSV file with a header among x, y, z,
    radius, volume, id [m, m^3]; or an NPZ file with arrays of these names and bonds (b, 2). bonds:
    a CSV file with a header i, j of ids. Without a volume it is that of the sphere (without z: disc
    of thickness 1) of the radius;
    without ids they count from 0.
    """
    path = Path(particles)
    if path.suffix == ".npz":
        table = _npz(path)
        if file.MARK in table and bonds is None:
            return file.restored(table, path.name)
        pairs = table.pop("bonds", None)
    else:
        table, pairs = _csv(path), None
    if bonds is not None:
        columns = _csv(Path(bonds))
        _have(Path(bonds), columns, ("i", "j"))
        pairs = np.stack([columns["i"], columns["j"]], axis=1)
    if pairs is None:
        raise InputError(f"{path.name} holds no bonds; give a file of bonds as well.")
    _have(path, table, ("x", "y"))
    if "radius" not in table and "volume" not in table:
        raise InputError(f"{path.name} has neither radius nor volume; give one of them.")
    axes = [name for name in "xyz" if name in table]
    x = np.stack([finite(name, table[name], (None,)) for name in axes], axis=1)
    radius = table.get("radius")
    if "volume" in table:
        volume = table["volume"]
    else:
        r = positive("radius", table["radius"], (len(x),))
        volume = pi * r**2 if len(axes) == 2 else 4.0 / 3.0 * pi * r**3
    ids = _whole("id", table["id"]) if "id" in table else np.arange(len(x))
    return network(
        x,
        _whole("bonds", pairs),
        volume,
        radius,
        plane="strain" if len(axes) == 2 else None,
        ids=ids,
    )


def _rods(
    x: Array,
    pairs: NDArray[np.int64],
    section: Section,
    plane: str | None,
    rod_inertia: bool,
    sides: dict[str, Mask],
) -> Packing:
    """Elements with the halves of their rods as mass, and the inertia of these cross sections."""
    check_section(section)
    edge = x[pairs[:, 1]] - x[pairs[:, 0]]
    half = np.repeat(0.5 * np.linalg.norm(edge, axis=1), 2)
    length = np.bincount(pairs.ravel(), half, minlength=len(x))
    square = section.second_moment / section.area  # of the radius of gyration in bending
    gyration = axes = None
    if rod_inertia:
        tangent = np.zeros_like(x)
        for side in (0, 1):
            np.add.at(tangent, pairs[:, side], edge)
        gyration = np.tile(np.sqrt([square, square, 2.0 * square]), (len(x), 1))
        axes = _from_z(tangent)
    # the sphere or disc of that inertia: 2/5 m R^2 or 1/2 m R^2
    radius = sqrt((2.5 if x.shape[1] == 3 else 2.0) * square)
    return network(
        x, pairs, section.area * length, radius, plane, gyration=gyration, axes=axes, sides=sides
    )


def _even(curve: Curve, bonds: int, closed: bool) -> Array:
    """Points on a curve with equal chords between neighbours."""
    from scipy.interpolate import CubicSpline

    if callable(curve):
        s = np.linspace(0.0, 1.0, 20 * bonds + 1)
        fine = finite("curve", [np.asarray(curve(t), dtype=np.float64) for t in s], (None, None))
        point = CubicSpline(s, fine, axis=0)
        reach = np.abs(np.diff(fine, axis=0)).sum()
        if closed and np.linalg.norm(fine[-1] - fine[0]) > 1e-6 * reach:
            raise InputError("the curve's end does not meet its start; a closed rod needs that.")
    else:
        fine = finite("curve", curve, (None, None))
        if closed:
            fine = np.concatenate([fine, fine[:1]])
        chord = np.linalg.norm(np.diff(fine, axis=0), axis=1)
        if len(fine) < 2 or (chord == 0.0).any():
            raise InputError("the curve's points must be at least two, neighbours not coincident.")
        s = np.concatenate([[0.0], np.cumsum(chord)]) / chord.sum()
        straight = len(fine) == 2

        def point(t: Array) -> Array:
            return (
                np.stack([np.interp(t, s, column) for column in fine.T], axis=1)
                if straight or len(fine) < 4
                else CubicSpline(s, fine, axis=0)(t)
            )

    t = np.linspace(0.0, 1.0, bonds + 1)
    before = np.inf
    for _ in range(200):  # move the parameters until all chords are equal, as far as rounding lets
        x = point(t)
        chord = np.linalg.norm(np.diff(x, axis=0), axis=1)
        if not chord.min() > 0.0:
            raise InputError("the curve comes to a stand; its points must all differ.")
        uneven = np.ptp(chord)
        if uneven <= 1e-13 * chord.mean() or uneven >= before:
            break
        before = uneven
        way = np.concatenate([[0.0], np.cumsum(chord)])
        t = np.interp(np.linspace(0.0, way[-1], bonds + 1), way, t)
    return x[:-1] if closed else x


def _from_z(direction: Array) -> Array:
    """Unit quaternions (x, y, z, w) that turn z into directions, the short way round."""
    d = direction / np.linalg.norm(direction, axis=1)[:, None]
    q = np.stack([-d[:, 1], d[:, 0], np.zeros(len(d)), 1.0 + d[:, 2]], axis=1)
    q[d[:, 2] < -1.0 + 1e-12] = [1.0, 0.0, 0.0, 0.0]
    return q / np.linalg.norm(q, axis=1)[:, None]


def _within(x: Array, distance: float) -> NDArray[np.int64]:
    from scipy.spatial import cKDTree

    pairs = cKDTree(x).query_pairs(distance, output_type="ndarray").astype(np.int64)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _places(ids: NDArray, pairs: NDArray) -> NDArray[np.int64]:
    """Places in the order of elements of pairs of ids."""
    order = np.argsort(ids)
    at = np.minimum(np.searchsorted(ids, pairs, sorter=order), len(ids) - 1)
    found = order[at]
    wrong = ids[found] != pairs
    if wrong.any():
        missing = ", ".join(map(str, np.unique(pairs[wrong])[:5]))
        raise InputError(f"bonds name elements that have no such ids: {missing}.")
    return found


def _each(name: str, value: ArrayLike, n: int) -> Array:
    a = finite(name, value)
    if a.shape not in ((), (n,)):
        raise InputError(f"{name} has shape {a.shape}; give one number or shape ({n},).")
    return np.broadcast_to(a, (n,)).copy()


def _npz(path: Path) -> dict[str, NDArray]:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (
        OSError,
        ValueError,
        EOFError,
        BadZipFile,
        KeyError,
        TypeError,
        AttributeError,
    ) as error:
        raise InputError(f"{path.name} is not an NPZ file of plain arrays: {error}.") from None


def _csv(path: Path) -> dict[str, NDArray]:
    try:
        with path.open(encoding="utf-8-sig") as lines:  # spreadsheets begin with a mark
            names = [name.strip() for name in lines.readline().split(",")]
            rows = np.array([line.split(",") for line in lines if line.strip()], dtype=np.float64)
    except (OSError, ValueError) as error:
        raise InputError(f"{path.name} is not a table of numbers: {error}.") from None
    if len(rows) == 0:
        raise InputError(f"{path.name} has no rows below its first line.")
    if rows.shape[1] != len(names):
        raise InputError(
            f"{path.name} has {len(names)} names in its first line and {rows.shape[1]} columns."
        )
    return dict(zip(names, rows.T, strict=True))


def _have(path: Path, table: dict[str, NDArray], names: Sequence[str]) -> None:
    allowed = ("x", "y", "z", "radius", "volume", "id", "i", "j")
    unknown = [name for name in table if name not in allowed]
    if unknown:
        raise InputError(
            f"{path.name} has columns that mean nothing here: {', '.join(unknown)}; the names are "
            f"{', '.join(allowed)}."
        )
    missing = [name for name in names if name not in table]
    if missing:
        raise InputError(f"{path.name} lacks {', '.join(missing)}; it has {', '.join(table)}.")


def _whole(name: str, value: NDArray) -> NDArray[np.int64]:
    a = finite(name, value)
    if (a != np.rint(a)).any():
        raise InputError(f"{name} must be whole numbers.")
    return a.astype(np.int64)

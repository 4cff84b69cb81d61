"""Voronoi and radical (Laguerre) packings of shapes."""

import sys
import time
import warnings
from collections.abc import Callable, Sequence
from math import ceil, inf, log2, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import (
    Array,
    InputError,
    ModelWarning,
    checked,
    finite,
    first_ids,
    positive,
    whole_number,
)
from ..room import check_elements
from .body import Body, body_of
from .packing import Packing
from .shapes import Box, Shape, place
from .tessellation import Cells

Spacing = float | Callable[[Array], ArrayLike]
Tell = Callable[[str], None]

MANY = 20_000  # cells from which on a build takes long enough to tell of it
SAMPLES = 4096  # points at which the local spacing is asked for beforehand
FINE = {2: 6.0, 3: 2.0}  # edges of a curved side for each spacing
OVER = 1.8  # a sweep's step over the way to the centroid: it does the work of nearly two


@checked
def voronoi(
    size: Shape | Sequence[float],
    spacing: Spacing,
    plane: str | None = "strain",
    thickness: float = 1.0,
    seed: int = 0,
    relaxations: int = 6,
    periodic: bool | str = False,
    tell: Tell | None = None,
) -> Packing:
    """Voronoi cells of random centres filling a shape, relaxed towards their centroids (Lloyd).

    size: edges [m] of a box from the origin, two in the plane, three in space (where plane and
    thickness [m] have no meaning), or a shape of this module. spacing [m]: of a hexagonal (fcc)
    packing with as many elements; for a graded one a function that gives it, (m,), at points
    (m, dim). seed: of the centres. relaxations: sweeps, of centres that start spread evenly; 0 for
    centres without any order, whose cells cost a many times smaller time step (theory B8).
    periodic: cells repeat with the box, along all axes or those named, such as "z". tell: called
    with a line of text after every sweep; by default those of 20,000 cells and more go to stderr.

    Cells are clipped to the shape. Its circles and spheres are polygons of their area, edges a
    sixth of the spacing, and polyhedra of their volume, edges half of it.

    Shapes other than boxes need warpdem[geometry]. Raises InputError for a shape that is not simple
    or not closed, and for cells that do not fill it; warns of a body in several pieces.
    """
    rng = np.random.default_rng(whole_number("seed", seed))
    shape, local = _shape(size), _local(spacing)
    rough = body_of(shape, inf, periodic)
    h = local(_points(rough, SAMPLES, rng))
    body = body_of(shape, float(h.min()) / FINE[rough.dim], periodic)
    cell = 0.5 * sqrt(3.0) * h**2 if body.dim == 2 else h**3 / sqrt(2.0)
    with np.errstate(divide="ignore", over="ignore"):
        count = check_elements(body.volume * float((1.0 / cell).mean()))
    _enough(count, body.dim)
    x = _points(body, count, rng, local, float(h.min()), even=relaxations > 0)
    grade = local if callable(spacing) else None
    x, cells = _relaxed(body, x, None, relaxations, grade, _teller(tell, count))
    arrangement = "voronoi" if relaxations > 0 else ""
    return _packing(body, x, cells, plane, thickness, arrangement)


@checked
def laguerre(
    shape: Shape | Sequence[float],
    position: ArrayLike,
    radius: ArrayLike,
    plane: str | None = "strain",
    thickness: float = 1.0,
    relaxations: int = 0,
    periodic: bool | str = False,
    tell: Tell | None = None,
) -> Packing:
    """Radical (Laguerre) cells of spheres, in the plane discs, filling a shape.

    position [m] (n, dim) inside the shape and radius [m] (n,): a face is where the tangents to its
    two spheres are of equal length, so that it parts spheres that touch. relaxations: sweeps that
    move the spheres towards the centroids of their cells. Other arguments as of voronoi.

    Raises InputError naming spheres whose centres are outside the shape or outside their cells
    (faces then do not lie between the centres, theory B8), or that have no cell.
    """
    shape = _shape(shape)
    x = finite("position", position, (None, None))
    r = positive("radius", radius, (len(x),))
    body = _fine(shape, len(x), periodic)
    if x.shape[1] != body.dim:
        raise InputError(f"position has {x.shape[1]} columns; the shape has {body.dim} dimensions.")
    outside = ~body.contains(x)
    if outside.any():
        raise InputError(f"spheres {first_ids(outside)} have their centres outside the shape.")
    x, cells = _relaxed(body, x, r**2, relaxations, None, _teller(tell, len(x)))
    return _packing(body, x, cells, plane, thickness)


@checked
def polydisperse(
    shape: Shape | Sequence[float],
    radius: ArrayLike,
    plane: str | None = "strain",
    thickness: float = 1.0,
    seed: int = 0,
    relaxations: int = 20,
    periodic: bool | str = False,
    tell: Tell | None = None,
) -> Packing:
    """Radical cells of spheres of given proportions, at random places filling a shape.

    radius (n,): of any distribution; radii are scaled so that the spheres' volumes are 0.64 of the
    shape's (discs' 0.84), as in a dense random packing. The spheres grow from points while they
    move towards the centroids of their cells. Other arguments as of voronoi.

    Raises InputError as laguerre does; more relaxations help.
    """
    rng = np.random.default_rng(whole_number("seed", seed))
    r = positive("radius", radius, (None,))
    body = _fine(_shape(shape), len(r), periodic)
    ball, part = (pi, 0.84) if body.dim == 2 else (4.0 / 3.0 * pi, 0.64)
    r = r * (part * body.volume / (ball * (r**body.dim).sum())) ** (1.0 / body.dim)
    x = _points(body, len(r), rng, even=True)
    x, cells = _relaxed(body, x, r**2, relaxations, None, _teller(tell, len(x)), grow=True)
    return _packing(body, x, cells, plane, thickness)


def _shape(shape: Any) -> Shape:
    return Box(tuple(shape)) if isinstance(shape, list | tuple | np.ndarray) else shape


def _fine(shape: Shape, count: int, periodic: bool | str) -> Body:
    """The body for a number of elements."""
    rough = body_of(shape, inf, periodic)
    _enough(count, rough.dim)
    return body_of(
        shape, float((rough.volume / count) ** (1.0 / rough.dim)) / FINE[rough.dim], periodic
    )


def _enough(count: int, dim: int) -> None:
    if count < dim + 2:
        raise InputError("the shape holds too few elements; enlarge it or reduce spacing.")


def _local(spacing: Spacing) -> Callable[[Array], Array]:
    """The spacing at points."""
    if not callable(spacing):
        h = float(positive("spacing", spacing, ()))
        return lambda x: np.full(len(x), h)
    return lambda x: positive("spacing", spacing(x), (len(x),))


def _teller(tell: Tell | None, count: int) -> Tell:
    if tell is None and count >= MANY:
        return lambda line: print(line, file=sys.stderr, flush=True)
    return tell or (lambda line: None)


def _points(
    body: Body,
    count: int,
    rng: np.random.Generator,
    local: Callable[[Array], Array] | None = None,
    least: float = 1.0,
    even: bool = True,
) -> Array:
    """Random points of a body, as many to a volume as the local spacing says, of which `least` is
    the least.

    Even ones are a scrambled Sobol sequence in which every point is shifted at random by up to half
    a spacing: numbers in large volumes hardly vary, and no direction is preferred.
    """
    from scipy.spatial import cKDTree
    from scipy.stats.qmc import Sobol

    dim, size = body.dim, body.high - body.low
    sobol = Sobol(dim + 1, seed=rng)
    batch = 2 ** ceil(log2(2 * count + 64))
    x = np.zeros((0, dim))
    for _ in range(1000):
        u = sobol.random(batch) if even else rng.random((batch, dim + 1))
        y = body.low + u[:, :dim] * size
        if local is not None:
            h = local(y)
            kept = u[:, dim] * h**dim < least**dim
            y, h = y[kept], h[kept]
            if even:
                y += h[:, None] * (rng.random(y.shape) - 0.5)
                y = body.high - np.abs(size - np.abs(y - body.low))  # back from beyond the ends
        x = np.concatenate([x, y[body.contains(y)]])
        if len(x) >= count:
            x = x[:count]
            return x[cKDTree(x).indices]  # neighbours in space are neighbours in memory
    raise InputError("the shape fills next to nothing of its bounds, or spacing varies too widely.")


def _relaxed(
    body: Body,
    x: Array,
    weight: Array | None,
    relaxations: int,
    grade: Callable[[Array], Array] | None,
    tell: Tell,
    grow: bool = False,
) -> tuple[Array, Cells]:
    """Centres after sweeps towards centroids, and their cells.

    If the spheres are to grow, they do so in the first half of the sweeps, from points.
    Where a cell is in several pieces, as on both sides of a slit, each gets a centre of its own.
    """
    whole_number("relaxations", relaxations, most=1000)
    began, most = time.perf_counter(), 2 * len(x)
    for attempt in range(6):
        sweeps = relaxations if attempt == 0 else min(relaxations, 3)
        for sweep in range(sweeps):
            size = min(1.0, 2.0 * (sweep + 1) / sweeps) if grow else 1.0
            grown = None if weight is None else weight * size**2
            cells = body.cells(x, grown, faces=False)
            if weight is None:
                over = OVER if sweep else 1.0
                x = x + over * (cells.centroid - x + _drift(body, cells, grade))
                x = np.concatenate([x[cells.volume > 0.0], cells.orphans])
            else:
                x = np.where(cells.volume[:, None] > 0.0, cells.centroid, x)
            x = body.wrapped(x)
            took = time.perf_counter() - began
            tell(f"sweep {sweep + 1} of {sweeps}: {len(x)} cells, {took:.0f} s")
        cells = body.cells(x, weight, faces=True)
        if not len(cells.torn):
            return x, cells
        if weight is not None or len(x) > most:
            break
        x = np.concatenate([x, cells.orphans])
    where = ", ".join(place(p) for p in cells.orphans[:3])
    raise InputError(
        f"cells {first_ids(np.bincount(cells.torn))} are in several pieces, near {where}: the "
        "shape, or a slit in it, is thinner there than the spacing; reduce spacing, or make a slit "
        "with Scene.cut."
    )


def _drift(body: Body, cells: Cells, grade: Callable[[Array], Array] | None) -> Array:
    """Way from centroids to those of a density under which cells settle at the local spacing h.

    The density is h^-(dim + 2); a cell's second moment is close to 0.08 volume^(1 + 2/dim).
    """
    if grade is None:
        return np.zeros_like(cells.centroid)
    h = grade(cells.centroid)
    slope = np.empty_like(cells.centroid)
    for k, shift in enumerate(np.eye(body.dim)):
        ahead = np.clip(cells.centroid + 0.1 * h[:, None] * shift, body.low, body.high)
        behind = np.clip(cells.centroid - 0.1 * h[:, None] * shift, body.low, body.high)
        slope[:, k] = (grade(ahead) - grade(behind)) / (ahead - behind)[:, k]
    square = cells.volume ** (2.0 / body.dim)
    way = -0.08 * (body.dim + 2) * (square / h)[:, None] * slope
    return np.clip(way, -0.2 * h[:, None], 0.2 * h[:, None])


def _packing(
    body: Body, x: Array, cells: Cells, plane: str | None, thickness: float, arrangement: str = ""
) -> Packing:
    """The packing of cells, once they are found sound."""
    n, dim = len(x), body.dim
    bad = cells.volume <= 0.0
    if bad.any():
        raise InputError(
            f"centres {first_ids(bad)} have no cell, the first at {place(x[bad][0])}: others or "
            "larger spheres leave them no room; move or remove them."
        )
    bad = ~body.contains(x)
    if bad.any():
        raise InputError(
            f"centres {first_ids(bad)} are outside the shape, the first at {place(x[bad][0])}: it "
            "is thinner there than the spacing; reduce spacing."
        )
    filled = cells.volume.sum()
    if abs(filled - body.volume) > 1e-9 * body.volume:
        raise InputError(
            f"the cells' volumes sum to {filled:.10g}, the shape's is {body.volume:.10g}: cells "
            "overlap or leave gaps; check the shape."
        )
    axis = cells.arms[:, 0] - cells.arms[:, 1]
    low = np.einsum("bsk,bk->bs", cells.arms, axis) * [1.0, -1.0] <= 0.0
    bad = np.isin(np.arange(n), cells.pair[low])
    if bad.any():
        raise InputError(
            f"centres {first_ids(bad)} lie outside their cells, the first at {place(x[bad][0])}; "
            "take radii that differ less or relax more."
        )
    bad = np.bincount(cells.pair.ravel(), minlength=n) == 0
    if bad.any():
        raise InputError(
            f"cells {first_ids(bad)} have no neighbour, the first at {place(x[bad][0])}; reduce "
            "spacing or remove that part of the shape."
        )
    order = np.lexsort(cells.pair.T[::-1])
    thickness = thickness if dim == 2 else 1.0
    mean = float(body.volume / n)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # cells at notches are known to be sound here
        packing = Packing(
            position=x,
            volume=cells.volume * thickness,
            bonds=cells.pair[order],
            area=cells.area[order] * thickness,
            arms=cells.arms[order],
            period=body.period,
            plane=plane if dim == 2 else None,
            thickness=thickness,
            spacing=sqrt(mean * 2.0 / sqrt(3.0)) if dim == 2 else float(np.cbrt(mean * sqrt(2.0))),
            sides=cells.sides,
            arrangement=arrangement,
        )
    _warn_of_pieces(packing)
    return packing


def _warn_of_pieces(packing: Packing) -> None:
    label = packing.piece
    count = label.max() + 1
    if count > 1:
        first = [int(np.flatnonzero(label == k)[0]) for k in range(min(count, 3))]
        sizes = ", ".join(
            f"{(label == label[i]).sum()} with element {i} at {place(packing.position[i])}"
            for i in first
        )
        warnings.warn(
            f"the body is in {count} pieces of elements: {sizes}{'' if count <= 3 else ' ...'}.",
            ModelWarning,
            stacklevel=5,
        )

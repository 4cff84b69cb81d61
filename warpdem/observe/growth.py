"""How cracks grew, from the places and times of broken bonds alone: speeds, branches, fronts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Array, InputError, finite, positive

FEWEST = 5  # broken bonds in a window that gives a speed
MOST = 2000  # of them that a fit takes, which looks at all pairs: large plates in space have more


def window_speeds(
    coordinate: ArrayLike, time: ArrayLike, window: float, start: float | None = None
) -> tuple[Array, Array]:
    """Middle [m] of every window of crack length, and the speed in it [m/s].

    coordinate [m] and time [s] of breaks, (b,). Speeds are robust fits (Theil-Sen, which bears 29 %
    of breaks out of place) of times over places, of at most 2000 in a window; windows with fewer
    than five breaks, or whose breaks did not come one after another, are left out. start: of the
    first window, by default the least coordinate.
    """
    from scipy.stats import theilslopes  # takes most of a second to load

    x, t = finite("coordinate", coordinate, (None,)), finite("time", time, (None,))
    if len(x) != len(t):
        raise InputError(f"there are {len(x)} coordinates and {len(t)} times; give one of each.")
    positive("window", window, ())
    if len(x) == 0:
        return np.zeros(0), np.zeros(0)
    first = float(x.min()) if start is None else start
    edges = np.arange(first, x.max() + 1e-9 * window, window)
    middle, speed = [], []
    for low, high in pairwise(edges):
        inside = (x >= low) & (x < high)
        if inside.sum() >= FEWEST:
            rows = np.flatnonzero(inside)
            rows = rows[:: -(-len(rows) // MOST)]
            slope = theilslopes(t[rows], x[rows]).slope
            if slope > 0.0:
                middle.append(0.5 * (low + high))
                speed.append(1.0 / slope)
    return np.array(middle), np.array(speed)


@dataclass(frozen=True, eq=False)
class Branch:
    """One path that a crack took.

    path (p, dim) [m]: from where it left its parent, or began, to its tip; rows: of the log that
    belong to it; distance [m] and time [s] of each of them, the distance along the path from its
    start; parent: number of the branch that it left, None of a crack's first; crack: number of the
    crack (breaks that hang together).
    """

    crack: int
    parent: int | None
    path: Array
    rows: NDArray[np.int64]
    distance: Array
    time: Array

    @property
    def length(self) -> float:
        """Length along the path [m]."""
        return float(self.distance.max(initial=0.0))

    @property
    def tip(self) -> Array:
        """Where it ended [m], (dim,)."""
        return self.path[-1]

    def speeds(self, window: float) -> tuple[Array, Array]:
        """Middles of windows along the path [m] and speeds in them [m/s] (`window_speeds`)."""
        return window_speeds(self.distance, self.time, window, 0.0)


def find_branches(place: ArrayLike, time: ArrayLike, reach: float, least: float) -> list[Branch]:
    """Cracks and their branches among breaks at places (b, dim) [m] and times (b,) [s].

    Breaks nearer than `reach` [m] hang together; a crack starts at its earliest break. Its longest
    shortest path is the first branch; the longest path that leaves those found is the next one,
    down to a length of `least` [m]. Breaks beside a path belong to the branch that is nearest.
    Cracks shorter than `least` are left out. A crack that runs both ways from its start has two
    branches. Sorted by crack, longest first.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components, dijkstra
    from scipy.spatial import cKDTree

    x, t = finite("place", place, (None, None)), finite("time", time, (None,))
    if len(x) != len(t):
        raise InputError(f"there are {len(x)} places and {len(t)} times; give one of each.")
    positive("reach", reach, ())
    positive("least", least, ())
    if len(x) == 0:
        return []
    i, j = cKDTree(x).query_pairs(reach, output_type="ndarray").T
    # breaks at one place are joined by a length that is not zero, which a sparse graph would drop
    weight = np.maximum(np.linalg.norm(x[i] - x[j], axis=1), 1e-12 * reach)
    graph = coo_array((weight, (i, j)), shape=(len(x), len(x))).tocsr()
    pieces, piece = connected_components(graph, directed=False)

    cracks: list[list[Branch]] = []
    for label in range(pieces):
        rows = np.flatnonzero(piece == label)
        root = rows[np.argmin(t[rows])]
        away, before = dijkstra(graph, directed=False, indices=root, return_predecessors=True)
        if away[rows].max() < least:
            continue
        owner = np.full(len(x), -1)
        paths: list[tuple[int, NDArray[np.int64]]] = []  # parent, rows from its start to its tip
        near = np.zeros(len(x), dtype=bool)
        near[rows] = True  # still to be claimed
        while near.any():
            tip = int(np.argmax(np.where(near, away, -1.0)))
            path = [tip]
            while path[-1] != root and owner[path[-1]] < 0:
                path.append(int(before[path[-1]]))
            parent = int(owner[path[-1]])
            run = np.array(path[::-1])
            near[tip] = False
            if away[tip] - away[run[0]] < least:
                continue
            new = run[owner[run] < 0]
            owner[new] = len(paths)
            paths.append((parent, run))
            # what lies beside the path is no branch of it
            near[rows] &= cKDTree(x[run]).query(x[rows])[0] > 0.5 * least
        claimed = rows[owner[rows] >= 0]
        nearest = claimed[cKDTree(x[claimed]).query(x[rows])[1]]
        owner[rows] = owner[nearest]
        found = []
        for k, (parent, run) in enumerate(paths):
            own = rows[owner[rows] == k]
            found.append(
                Branch(
                    len(cracks), None if parent < 0 else parent, x[run], own,
                    np.maximum(away[own] - away[run[0]], 0.0), t[own],
                )
            )  # fmt: skip
        cracks.append(found)
    return [branch for found in cracks for branch in found]


def path_angle(path: ArrayLike) -> float:
    """Angle of a path's places (m, 2) [m] to the x axis, in degrees: a robust fit.

    The median direction of all pairs of places at least a third of the chord apart: nearer ones
    see single steps of a lattice. NaN of fewer than two places.
    """
    x = finite("path", path, (None, 2))
    if len(x) < 2 or not (chord := x[-1] - x[0]).any():
        return float("nan")
    size = np.linalg.norm(chord)
    along = chord / size
    i, j = np.triu_indices(len(x), 1)
    step = x[j] - x[i]
    far = step @ along >= size / 3.0
    turn = np.arctan2(step[far] @ np.array([-along[1], along[0]]), step[far] @ along)
    return float(np.degrees(np.arctan2(along[1], along[0]) + np.median(turn)))


def front_speeds(
    place: ArrayLike,
    time: ArrayLike,
    direction: ArrayLike,
    across: ArrayLike,
    slices: int,
    window: float,
) -> list[tuple[float, Array, Array]]:
    """A crack's front in space, slice by slice: places across [m], and windows of each as of
    `window_speeds`.

    direction: of growth; across: along the front, (dim,) each.
    """
    x, t = finite("place", place, (None, None)), finite("time", time, (None,))
    along, middle, which = _sliced(x, direction, across, slices)
    start = float(along.min())
    return [
        (float(where), *window_speeds(along[which == k], t[which == k], window, start))
        for k, where in enumerate(middle)
    ]


@dataclass(frozen=True, eq=False)
class Front:
    """A crack's front in space at several instants.

    across (s,) [m]: middles of slices along it; time (m,) [s]; ahead (m, s) [m]: of the break that
    is farthest along the crack in each slice at each instant.
    """

    across: Array
    time: Array
    ahead: Array

    @property
    def roughness(self) -> float:
        """Root of the mean square distance of the front from a straight one [m], NaN of none."""
        if not len(self.time):
            return float("nan")
        return float(np.sqrt(((self.ahead - self.ahead.mean(axis=1, keepdims=True)) ** 2).mean()))


def find_front(
    place: ArrayLike,
    time: ArrayLike,
    direction: ArrayLike,
    across: ArrayLike,
    slices: int,
    instants: int,
) -> Front:
    """A crack's front by the places (b, dim) [m] and times (b,) [s] of breaks.

    direction: of growth; across: along the front, (dim,) each; slices of equal width; instants:
    evenly from the first at which all slices have a break to the last break.
    """
    x, t = finite("place", place, (None, None)), finite("time", time, (None,))
    if len(x) != len(t):
        raise InputError(f"there are {len(x)} places and {len(t)} times; give one of each.")
    along, middle, which = _sliced(x, direction, across, slices)
    first = np.array([t[which == k].min(initial=np.inf) for k in range(slices)])
    if not np.isfinite(first).all():  # too few breaks
        return Front(middle, np.zeros(0), np.zeros((0, slices)))
    at = np.linspace(first.max(), t.max(), instants)
    ahead = np.array(
        [[along[(which == k) & (t <= now)].max() for k in range(slices)] for now in at]
    )
    return Front(middle, at, ahead)


def _sliced(
    x: Array, direction: ArrayLike, across: ArrayLike, slices: int
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Places along the crack, middles of slices across, and the slice of each place."""
    ahead = finite("direction", direction, (x.shape[1],))
    side = finite("across", across, (x.shape[1],))
    if slices < 1:
        raise InputError(f"slices is {slices}; give 1 or more.")
    along, lateral = x @ ahead / np.linalg.norm(ahead), x @ side / np.linalg.norm(side)
    low, high = (lateral.min(), lateral.max()) if len(x) else (0.0, 0.0)
    edges = np.linspace(low, high, slices + 1)
    which = np.clip(np.searchsorted(edges, lateral, side="right") - 1, 0, slices - 1)
    return along, 0.5 * (edges[1:] + edges[:-1]), which


def released_energy_rate(
    coordinate: ArrayLike, energy: ArrayLike, window: float, thickness: float
) -> tuple[Array, Array]:
    """Middle [m] of every window of crack length, and energy that its breaks released over the
    area it made [J/m^2].

    Since the ledger closes, this is the loss of elastic and kinetic energy and the work of loads
    per area of new crack.
    """
    x, e = finite("coordinate", coordinate, (None,)), finite("energy", energy, (None,))
    positive("window", window, ())
    positive("thickness", thickness, ())
    if len(x) == 0:
        return np.zeros(0), np.zeros(0)
    edges = np.arange(x.min(), x.max() + 1e-9 * window, window)
    if len(edges) < 2:
        return np.zeros(0), np.zeros(0)
    total, _ = np.histogram(x, edges, weights=e)
    return 0.5 * (edges[1:] + edges[:-1]), total / (window * thickness)

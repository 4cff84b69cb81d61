"""The pairs ahead of a crack's tip in a field of known stress intensity (theory B10).

A patch whose outer elements are held where the field of a crack in a continuum has them; within,
the elements find their rest. Nothing links across the crack, so that its faces do not touch.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from .. import packing
from ..criteria import Fracture
from ..errors import Array
from ..material import Material
from ..packing import Packing
from ..scene import Scene
from ..simulation import Simulation
from ..toughness import Toughness
from . import reference

INTENSITY = 1e-5  # K over E sqrt(d): strains are small


@dataclass(frozen=True)
class Patch:
    """A packing, a crack along x up to a tip at (x, y), and the bonds the crack breaks next."""

    packing: Packing  # without the bonds that the crack has cut
    tip: Array
    ahead: Array


def near_field(x: Array, mode: str, shear_modulus: float, kappa: float) -> tuple[Array, Array]:
    """Displacement (n, 2) and turn (n,) at K = 1 around a tip at the origin (Westergaard, Irwin).

    kappa: 3 - 4 nu in plane strain, (3 - nu)/(1 + nu) in plane stress.
    """

    def displacement(x: Array) -> Array:
        r, half = np.linalg.norm(x, axis=1), 0.5 * np.arctan2(x[:, 1], x[:, 0])
        s, c, f = np.sin(half), np.cos(half), np.sqrt(r / (2.0 * pi)) / (2.0 * shear_modulus)
        if mode == "I":
            both = c * (kappa - np.cos(2.0 * half)), s * (kappa - np.cos(2.0 * half))
        else:
            both = s * (kappa + 2.0 + np.cos(2.0 * half)), -c * (kappa - 2.0 + np.cos(2.0 * half))
        return f[:, None] * np.stack(both, axis=1)

    return displacement(x), _turn(displacement, x)


def griffith_field(
    x: Array, half_length: float, shear_modulus: float, kappa: float
) -> tuple[Array, Array]:
    """Displacement (n, 2) and turn (n,) around a crack |x| < a, y = 0 in an infinite plate.

    Under a tension of 1 Pa from all sides (Westergaard 1939: Z = z/sqrt(z^2 - a^2)).
    """

    def displacement(x: Array) -> Array:
        z = x[:, 0] + 1j * x[:, 1]
        root = np.sqrt(z - half_length) * np.sqrt(z + half_length)  # the branch that is z far away
        y, ratio = x[:, 1], z / root
        along = 0.5 * (kappa - 1.0) * root.real - y * ratio.imag
        across = 0.5 * (kappa + 1.0) * root.imag - y * ratio.real
        return np.stack([along, across], axis=1) / (2.0 * shear_modulus)

    return displacement(x), _turn(displacement, x)


def _turn(displacement: Callable[[Array], Array], x: Array) -> Array:
    """Rotation of the continuum, half the curl, by differences."""
    h = 1e-4
    gradient = [(displacement(x + h * e) - displacement(x - h * e)) / (2.0 * h) for e in np.eye(2)]
    return 0.5 * (gradient[0][:, 1] - gradient[1][:, 0])


def patches(name: str, plane: str | None, radius: float, places: int) -> list[Patch]:
    """Patches of a packing with spacing 1 for several places of the tip along its path.

    name: "hexagonal", "fcc" or "voronoi"; in space they repeat along the front, z.
    """
    whole = _whole(name, plane, radius)
    x, pairs = whole.position, whole.bonds
    assert whole.area is not None and whole.arms is not None
    rows = np.unique(np.round(x[:, 1], 6))
    y = radius if name == "voronoi" else rows[np.abs(rows - radius).argsort()[:2]].mean()
    crossing = np.flatnonzero((x[pairs, 1] < y).sum(axis=1) == 1)
    middle = (x[pairs[:, 0]] + whole.arms[:, 0])[crossing, 0]
    steps = np.unique(np.round(middle, 6))
    if name == "voronoi" and plane is None:  # a straight front, whatever bonds there are
        steps = np.arange(0.25, 2.0 * radius, 0.5)
    start = int(np.searchsorted(steps, radius)) - places // 2
    found = []
    for k in range(start, start + places):
        tip = np.array([0.5 * (steps[k - 1] + steps[k]), y])
        kept = np.ones(len(pairs), dtype=bool)
        kept[crossing[middle < tip[0]]] = False
        ahead = crossing[(middle > tip[0]) & (middle < steps[k] + 1e-3)]
        rest = replace(whole, bonds=pairs[kept], area=whole.area[kept], arms=whole.arms[kept])
        found.append(Patch(rest, tip, (np.cumsum(kept) - 1)[ahead]))
    return found


def _whole(name: str, plane: str | None, radius: float) -> Packing:
    size = 2.0 * radius
    if name == "hexagonal":
        return packing.hexagonal((size, size), 1.0, str(plane))
    if name == "fcc":
        return packing.fcc((size, size, 2.0 * sqrt(2.0)), 1.0, periodic="z")
    if plane is not None:
        return packing.voronoi((size, size), 1.0, plane, seed=1)
    cells = packing.voronoi((size, size, 4.0), 1.0, seed=1, periodic=True)
    # no bonds through the sides but those along the front
    apart = cells.position[cells.bonds[:, 1]] - cells.position[cells.bonds[:, 0]]
    kept = (np.abs(apart[:, :2]) < radius).all(axis=1)
    assert cells.area is not None and cells.arms is not None
    return replace(cells, bonds=cells.bonds[kept], area=cells.area[kept], arms=cells.arms[kept])


def kolosov(plane: str | None, poisson: float) -> float:
    """kappa: 3 - 4 nu in plane strain and along a front, (3 - nu)/(1 + nu) in plane stress."""
    return (3.0 - poisson) / (1.0 + poisson) if plane == "stress" else 3.0 - 4.0 * poisson


def held_in_field(
    p: Packing, material: Material, u: Array, turn: Array, fracture: Fracture | Toughness | None
) -> Simulation:
    """A packing at rest whose outer elements, three layers, are held where a field has them.

    u (n, 2) [m] and turn (n,) [rad]: of every element, where the search for rest starts.
    """
    scene = Scene()
    body = scene.add(p, material, fracture=fracture)
    body.displacement[:, :2] = u
    low, high = p.position[:, :2].min(axis=0), p.position[:, :2].max(axis=0)
    inside = np.minimum(p.position[:, :2] - low, high - p.position[:, :2]).min(axis=1)
    scene.hold(body, inside < 3.0 * p.spacing)
    sim = Simulation(scene, dt=1e-6, force_dt=True)
    orientation = np.zeros((len(p), 2 if p.dim == 2 else 4))
    orientation[:, -2:] = np.stack([np.sin(0.5 * turn), np.cos(0.5 * turn)], axis=1)
    sim.set_state(orientation=orientation)
    sim.equilibrate(tolerance=1e-7)
    return sim


def tip_tensors(patch: Patch, mode: str, poisson: float) -> Array:
    """Tensors of the pairs ahead over K/sqrt(d), (pairs, 3, 3), the first axis along the normal."""
    p, material = patch.packing, Material(1.0, poisson, 1.0)
    x = p.position[:, :2] - patch.tip
    u, turn = near_field(x, mode, material.shear_modulus, kolosov(p.plane, poisson))
    sim = held_in_field(p, material, INTENSITY * u, INTENSITY * turn, None)
    force, stress = sim.bond_force, sim.stress
    found = []
    for b in patch.ahead:
        i, j = p.bonds[b]
        assert p.area is not None and p.arms is not None
        n = reference.in_space(p.bond_vector[b : b + 1])[0] / p.bond_length[b]
        traction = reference.in_space(force[b : b + 1])[0] / p.area[b]
        arm_i, arm_j = reference.in_space(p.arms[b])
        weight = np.array([-arm_j @ n, arm_i @ n])
        tensor = reference.pair_tensor(
            np.tensordot(weight / weight.sum(), stress[[i, j]], axes=1), traction, n
        )
        found.append(_along(n) @ tensor @ _along(n).T / INTENSITY)
    return np.array(found)


def _along(n: Array) -> Array:
    """Rotation to axes of which the first is n."""
    q, _ = np.linalg.qr(np.column_stack([n, np.eye(3)]))
    q[:, 0] = n
    return q[:, :3].T


@dataclass(frozen=True)
class Griffith:
    """A hexagonal patch of spacing 1 with a crack of half-length a in its middle."""

    whole: Packing
    half_length: float
    centre: Array
    crossing: NDArray[np.int64]
    middle: Array  # places of the crossing bonds along the crack

    @classmethod
    def of(cls, half_length: float, margin: float, plane: str = "strain") -> "Griffith":
        """The patch ends a margin [spacings] beyond the crack on all sides."""
        wide, high = half_length + margin, max(margin, 0.75 * half_length)
        whole = packing.hexagonal((2.0 * wide, 2.0 * high), 1.0, plane)
        rows = np.unique(np.round(whole.position[:, 1], 6))
        y = rows[np.abs(rows - high).argsort()[:2]].mean()
        crossing = np.flatnonzero((whole.position[whole.bonds, 1] < y).sum(axis=1) == 1)
        assert whole.arms is not None
        middle = (whole.position[whole.bonds[:, 0]] + whole.arms[:, 0])[crossing, 0]
        steps = np.unique(np.round(middle, 6))
        edges = 0.5 * (steps[1:] + steps[:-1])
        centre = np.array([edges[np.abs(edges - wide).argmin()], y])
        return cls(whole, half_length, centre, crossing, middle)

    def at_rest(
        self, material: Material, stress: float, longer: float, fracture: Fracture | Toughness
    ) -> Simulation:
        """Under a remote stress [Pa], the crack `longer` at both ends than its field has it."""
        reach = np.abs(self.middle - self.centre[0]) < self.half_length + longer
        kept = np.ones(len(self.whole.bonds), dtype=bool)
        kept[self.crossing[reach]] = False
        p = self.whole
        assert p.area is not None and p.arms is not None
        p = replace(p, bonds=p.bonds[kept], area=p.area[kept], arms=p.arms[kept])
        kappa = kolosov(p.plane, material.poisson)
        x = p.position - self.centre
        u, turn = griffith_field(x, self.half_length, material.shear_modulus, kappa)
        return held_in_field(p, material, stress * u, stress * turn, fracture)

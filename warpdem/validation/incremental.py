"""The element formalism in increments, as Shilko's paper has it, in NumPy float64.

Stresses of bonds are kept and grow step by step (eq. 8), the mean stress of an element is that of
the forces around it (eq. 5). Corrected as theory B3 and B5 say: K in eq. 8 is 3 K, its shares of
strain are weighted with the distances to the face, and eq. 5 is the sum of arms times forces.
"""

from collections.abc import Iterator
from math import log, sqrt

import numpy as np

from ..errors import Array
from ..material import Material
from ..packing import Packing
from ..simulation import Simulation
from .case import Measurement, case
from .core import facet_body, small_packing, vanishing


class Incremental:
    """A body of one material in the plane, moved step by step; nothing is taken from the device.

    lagged: the mean stress in eq. 8 is that of eq. 5 in the step before, as in a program that
    follows the paper line by line; else that of the present strains, eqs 5 and 8 solved together
    where it is uniform (theory B4).
    """

    def __init__(self, p: Packing, material: Material, lagged: bool = False) -> None:
        assert p.area is not None and p.arms is not None
        self.packing, self.area, self.lagged = p, p.area, lagged
        self.shear, self.coupling = material.shear_modulus, material.coupling
        self.apart, self.length = p.bond_vector, p.bond_length
        # the face's centroid in the bond's frame: q from both centres along it, offset across it
        along = self.apart / self.length[:, None]
        self.q = np.einsum("bsk,bk->sb", p.arms, along) * [[1.0], [-1.0]]
        self.offset = (p.arms[:, 0] * _across(along)).sum(axis=1)
        self.strain = np.zeros((2, len(p.bonds)))  # normal and tangential, of bonds
        self.traction = np.zeros((2, len(p.bonds)))  # sigma_ij and tau_ij
        self.mean = np.zeros(len(p))  # mean stress of elements
        filled = self._over_faces(np.stack([np.ones(len(p.bonds)), np.zeros(len(p.bonds))]))
        self.closed = 2.0 * self.shear / (3.0 - self.coupling * (filled + (p.plane == "strain")))

    def move(self, displacement: Array, turn: Array) -> None:
        """Make a step: increments of the elements' places (n, 2) and angles (n,)."""
        i, j = self.packing.bonds.T
        old, new = self.apart, self.apart + displacement[j] - displacement[i]
        before, after = (np.linalg.norm(x, axis=1) for x in (old, new))
        swing = np.arctan2(old[:, 0] * new[:, 1] - old[:, 1] * new[:, 0], (old * new).sum(axis=1))
        mean_turn = (self.q[0] * turn[i] + self.q[1] * turn[j]) / self.length
        stretch = after - before - self.offset * (turn[j] - turn[i])
        slip = after * (swing - mean_turn)
        self.apart = new
        step = np.stack([stretch, slip]) / self.length
        self.strain += step
        # eq. 8
        mean = self._lagging_mean() if self.lagged else self.closed * self._over_faces(self.strain)
        more = mean - self.mean
        self.mean = mean
        share = self.coupling / self.length
        self.traction += 2.0 * self.shear * step
        self.traction[0] += share * (self.q[0] * more[i] + self.q[1] * more[j])
        self.traction[1] += share * self.offset * (more[i] - more[j])

    def forces(self) -> tuple[Array, Array]:
        """Force (n, 2) and torque (n,) on the elements."""
        force = self._bond_forces()
        normal, tangential = self.area * self.traction
        stretched = self.q * np.linalg.norm(self.apart, axis=1) / self.length
        torque = self._sums(
            stretched[0] * tangential - self.offset * normal,
            stretched[1] * tangential + self.offset * normal,
        )
        return np.stack([self._sums(f, -f) for f in force.T], axis=1), torque

    def stress(self) -> Array:
        """In-plane average stress of the elements, (n, 2, 2): eq. 5."""
        along = self.apart / np.linalg.norm(self.apart, axis=1)[:, None]
        force, aside = self._bond_forces(), self.offset[:, None] * _across(along)
        first, second = self.q[0][:, None] * along + aside, aside - self.q[1][:, None] * along
        total = np.empty((len(self.mean), 2, 2))
        for a in (0, 1):
            for b in (0, 1):
                total[:, a, b] = self._sums(first[:, a] * force[:, b], -second[:, a] * force[:, b])
        total /= self.packing.volume[:, None, None]
        return 0.5 * (total + np.swapaxes(total, 1, 2))

    def _bond_forces(self) -> Array:
        along = self.apart / np.linalg.norm(self.apart, axis=1)[:, None]
        normal, tangential = self.area * self.traction
        return normal[:, None] * along + tangential[:, None] * _across(along)

    def _lagging_mean(self) -> Array:
        """Mean stress of the forces as they were, sigma_zz included: eq. 5."""
        out_of_plane = self.coupling * self.mean if self.packing.plane == "strain" else 0.0
        return (self._over_faces(self.traction) + out_of_plane) / 3.0

    def _over_faces(self, pair: Array) -> Array:
        """Sum over an element's faces of S c.(pair)/V, pair in the frame of the bond."""
        along, across = self.area * pair
        first = self.q[0] * along + self.offset * across
        second = self.q[1] * along - self.offset * across
        return self._sums(first, second) / self.packing.volume

    def _sums(self, first: Array, second: Array) -> Array:
        """Sums over an element's bonds, of those of which it is the first and the second."""
        i, j = self.packing.bonds.T
        n = len(self.packing)
        return np.bincount(i, first, n).astype(float) + np.bincount(j, second, n)


def _across(along: Array) -> Array:
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


@case("mca")
def incremental_form() -> Iterator[Measurement]:
    """Shilko's equations in increments against the device's energy, after a path of 100 steps.

    Random places and turns at the end, reached on a curved path. The two forms differ by the square
    of the strain, so their difference falls with it.
    """
    for name in ("hex strain", "hex stress", "voronoi strain", "voronoi stress"):
        for poisson in (0.2, 0.3, 0.45):
            p, size = small_packing(name), 1e-6
            rng = np.random.default_rng(6)
            ends, bend = size * rng.normal(size=(2, len(p), 3))
            scene, _ = facet_body(p, poisson)
            sim = Simulation(scene, dt=1.0, force_dt=True)
            body = Incremental(p, Material(1.0, poisson, 1.0))
            steps, place = 100, np.zeros((len(p), 3))
            for count in range(1, steps + 1):
                s = count / steps
                further = s * ends + np.sin(np.pi * s) * bend
                body.move((further - place)[:, :2], (further - place)[:, 2])
                place = further
            half = 0.5 * place[:, 2]
            turned = np.stack([np.sin(half), np.cos(half)], axis=1)
            sim.set_state(displacement=place[:, :2], orientation=turned)
            force, torque = body.forces()
            pairs = {
                "forces": (sim.force, force),
                "torques": (sim.torque[:, 0], torque),
                "stresses": (sim.stress[:, :2, :2], body.stress()),
            }
            for what, (device, found) in pairs.items():
                worst = float(np.abs(found - device).max() / np.abs(device).max())
                where = f"{what}, {name}, nu {poisson}"
                yield vanishing(f"difference of {where}", "Shilko 5, 8", worst, 20.0 * size)


@case("mca")
def lagged_mean_stress() -> Iterator[Measurement]:
    """Growth a step of a hexagonal patch whose mean stress is that of the step before.

    The "obvious" way to run Shilko eqs 5, 7, 8 is a negative viscosity: undamped, it blows up at
    any time step. dt_c = 0.3536 d/c_S is the limit of the bonds alone (theory B8). Beside it the
    same with the mean stress of the present places, which is stable.
    """
    # nu, dt/dt_c, growth: theory B4
    for poisson, share, growth in (
        (0.3, 0.1, 2.0e-3),
        (0.3, 0.3, 1.5e-2),
        (0.3, 0.9, 6.5e-2),
        (0.45, 0.1, 1.1e-2),
        (0.45, 0.3, 4.3e-2),
        (0.45, 0.9, 1.0e-1),
    ):
        found = _growth(poisson, share, lagged=True, steps=round(14.0 / growth))
        where = f"nu {poisson}, dt {share} dt_c"
        yield Measurement(
            f"growth a step, lagged, {where}", growth, "theory B4", found,
            abs(found / growth - 1.0), 0.2,
        )  # fmt: skip
        found = _growth(poisson, share, lagged=False, steps=1000)
        yield vanishing(f"growth a step, present, {where}", "stability", found, 1e-3)


def _growth(poisson: float, share: float, lagged: bool, steps: int) -> float:
    """Logarithmic growth of the speeds in a step, over the last half of a run from noise."""
    p = _patch()
    material = Material(1.0, poisson, 1.0)
    body = Incremental(p, material, lagged)
    dt = share * 0.3536 / material.shear_speed()
    mass = p.volume[0]
    motion = 1e-10 * np.random.default_rng(0).normal(size=(len(p), 3))
    size = []
    for _ in range(steps):
        force, torque = body.forces()
        motion[:, :2] += dt * force / mass
        motion[:, 2] += dt * torque / (mass / 8.0)  # J = m d^2/8 (theory B8)
        body.move(dt * motion[:, :2], dt * motion[:, 2])
        size.append(np.linalg.norm(motion))
    half, tenth = steps // 2, max(1, steps // 10)
    # means over some steps, since stable motion only swings
    late, early = np.mean(size[-tenth:]), np.mean(size[half : half + tenth])
    return log(late / early) / (steps - half - tenth)


def _patch() -> Packing:
    """Twelve by twelve hexagonal cells without a surface."""
    row, column = np.divmod(np.arange(144), 12)
    pitch = sqrt(3.0) / 2.0
    x = np.stack([column + 0.5 * (row % 2), row * pitch], axis=1)
    period = np.array([12.0, 12.0 * pitch])
    i, j = np.triu_indices(144, 1)
    apart = x[j] - x[i]
    apart -= period * np.rint(apart / period)
    near = np.linalg.norm(apart, axis=1) < 1.01
    arms = 0.5 * apart[near]
    return Packing(
        position=x,
        volume=np.full(144, pitch),
        bonds=np.stack([i, j], axis=1)[near],
        area=np.full(near.sum(), 1.0 / sqrt(3.0)),
        arms=np.stack([arms, -arms], axis=1),
        period=period,
        plane="strain",
    )

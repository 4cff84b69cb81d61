"""Plastic flow against the return of a continuum, limit loads, ledgers and momenta (theory C4)."""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from functools import cache
from itertools import product
from math import exp, log, pi, sqrt

import numpy as np
from scipy.optimize import brentq

from .. import packing
from ..bond import EVMBond
from ..errors import Array
from ..material import Material
from ..packing import Packing
from ..plasticity import (
    JohnsonCook,
    Nikolaevsky,
    Perzyna,
    PowerLaw,
    Table,
    Voce,
    VonMises,
    YieldLaw,
)
from ..scene import Body, Scene
from ..simulation import Simulation
from . import reference
from .case import Measurement, case
from .core import vanishing
from .foundation import at_least

G, NU, SY = 1.0, 0.3, 0.01
YOUNG = 2.0 * G * (1.0 + NU)
BULK = YOUNG / (3.0 * (1.0 - 2.0 * NU))
SOLID = Material(YOUNG, NU, 1.0)
PLANE_STRAIN = 2.0 / sqrt(3.0)  # limit in uniaxial plane strain over the yield stress


@cache
def _cell(plane: str | None, size: float, seed: int = 1) -> Packing:
    dim = 3 if plane is None else 2
    return packing.voronoi((size,) * dim, 1.0, plane, periodic=True, seed=seed)


# -- one element ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Law:
    """A law of the code, and its flow stress written out at a plastic strain and its rate."""

    given: YieldLaw
    flow: Callable[[float, float], float]


LAWS = {
    "perfect": Law(VonMises(SY), lambda p, r: SY),
    "linear": Law(VonMises(SY, 0.1), lambda p, r: SY + 0.1 * p),
    "Voce": Law(
        VonMises(SY, Voce(0.006, 60.0, 0.02)),
        lambda p, r: SY + 0.006 * (1.0 - exp(-60.0 * p)) + 0.02 * p,
    ),
    "Ludwik": Law(VonMises(SY, PowerLaw(0.03, 0.4)), lambda p, r: SY + 0.03 * p**0.4),
    "Swift": Law(
        VonMises(SY, PowerLaw(0.03, 0.2, 1e-3)),
        lambda p, r: SY + 0.03 * ((1e-3 + p) ** 0.2 - 1e-3**0.2),
    ),
    "table": Law(
        VonMises(SY, Table([0.0, 0.01, 0.03, 0.05], [0.0, 0.004, 0.006, 0.003])),
        lambda p, r: SY + float(np.interp(p, [0.0, 0.01, 0.03, 0.05], [0.0, 0.004, 0.006, 0.003])),
    ),
    "Perzyna": Law(
        VonMises(SY, 0.1, Perzyna(20.0, 2.0)),
        lambda p, r: (SY + 0.1 * p) * (1.0 + sqrt(20.0 * r)),
    ),
    "Johnson-Cook": Law(
        VonMises(SY, 0.1, JohnsonCook(0.05, 1e-4)),
        lambda p, r: (SY + 0.1 * p) * (1.0 + 0.05 * log(max(r / 1e-4, 1.0))),
    ),
    "Nikolaevsky": Law(Nikolaevsky(SY, 0.6, 0.3, 0.1), lambda p, r: SY + 0.1 * p),
    "Nikolaevsky, no dilatancy": Law(Nikolaevsky(SY, 0.6, 0.0, 0.1), lambda p, r: SY + 0.1 * p),
}


@case("plastic")
def one_element() -> Iterator[Measurement]:
    """Strain paths of 600 increments in ten directions, cells of a periodic packing held to them.

    Every hardening and rate law against a return written in NumPy, step by step.
    """
    for plane, (name, law) in product(("strain", "stress", None), LAWS.items()):
        if plane == "stress" and law.given.friction > 0.0:
            continue
        where = f"plane {plane}" if plane else "space"
        p = _cell(plane, 4.0)
        if law.given.friction == 0.0:
            error = _follow(p, law, _path(p.dim, 0.0))
            yield vanishing(f"stress, {name}, {where}", "continuum return", error, 1e-10)
            continue
        # to where rocks are pressed, and to the tip of the cone, where they are pulled apart
        error = _follow(p, law, _path(p.dim, -2e-5))
        yield vanishing(f"stress, {name}, {where}, pressed", "continuum return", error, 1e-10)
        if law.given.dilatancy > 0.0:
            error = _follow(p, law, _path(p.dim, 6e-5))
            yield vanishing(f"stress, {name}, {where}, pulled", "continuum return", error, 1e-10)


def _path(dim: int, dilation: float) -> Array:
    """Strains (601, dim, dim) from zero: ten directions at random, a steady change of volume."""
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(10, dim, dim))
    direction += np.swapaxes(direction, 1, 2)
    direction *= 2e-4 / np.linalg.norm(direction, axis=(1, 2))[:, None, None]
    steps = np.repeat(direction, 60, axis=0) + dilation * np.eye(dim)
    return np.concatenate([np.zeros((1, dim, dim)), np.cumsum(steps, axis=0)])


def _follow(p: Packing, law: Law, path: Array) -> float:
    """Greatest error of any element's stress at any increment, over the yield stress."""
    dt = 0.1
    scene = Scene()
    body = scene.add(p, SOLID, yielding=law.given)
    scene.strain(body, lambda t: path[min(round(t / dt), len(path) - 1)])
    scene.hold(body, np.arange(len(p)))
    sim = Simulation(scene, dt=dt)
    point = reference.FlowingPoint(
        YOUNG, NU, p.plane, law.flow, law.given.friction, law.given.dilatancy
    )
    worst = 0.0
    for strain in path[1:]:
        sim._step.upload("displacement", p.position @ strain)  # the box follows by itself
        sim._step.advance()
        error = np.abs(sim.stress - point.strain_to(strain, dt)).max()
        worst = max(worst, float(error) / SY)
    return worst


# -- limit loads ----------------------------------------------------------------------------------


def _add(scene: Scene, p: Packing, law: YieldLaw | None, stiffness: float | None) -> Body:
    """A body of facet bonds, or of EVM bonds `stiffness` times as stiff across as along."""
    if stiffness is None:
        return scene.add(p, SOLID, yielding=law)
    assert p.area is not None
    along = 2.0 * G * p.area / p.bond_length
    turning = 0.1 * along * p.bond_length**2
    bond = EVMBond(along, stiffness * along, turning, turning)
    return scene.add(p, SOLID, bond=bond, volume=True, yielding=law)


class Pulled:
    """A block pulled at a constant rate by grips of two layers that move affinely, sides free.

    The grips narrow as the flowing block does, so they hold back its elastic part only.
    """

    def __init__(
        self,
        packing: Packing,
        law: YieldLaw | None,
        stiffness: float | None = None,
        precision: str = "float64",
        rate: float = 2e-5,
    ) -> None:
        self.packing, self.rate = packing, rate
        scene = Scene()
        self.body = _add(scene, packing, law, stiffness)
        dim = packing.dim
        self.axis = dim - 1
        narrowing = 1.0 if packing.plane == "strain" else 0.5
        x = packing.position - 0.5 * (packing.position.max(axis=0) + packing.position.min(axis=0))
        self.motion = np.where(np.arange(dim) == self.axis, 1.0, -narrowing) * x
        ends = ("bottom", "top") if dim == 2 else ("back", "front")
        grips = np.logical_or(*(packing.side(name, 2) for name in ends))
        scene.set_velocity(self.body, rate * self.motion)
        scene.hold(self.body, grips, rate * self.motion[grips])
        self.inner = ~packing.boundary(4 if dim == 2 else 2)
        self.sim = Simulation(scene, precision=precision)

    def pull(self, strain: float) -> None:
        """To a mean strain."""
        self.sim.run(until=strain / self.rate)

    @property
    def stress(self) -> Array:
        """Mean stress of the inner elements, (3, 3)."""
        w = self.packing.volume[self.inner]
        return np.average(self.sim.stress[self.inner], axis=0, weights=w)

    @property
    def plastic_strain(self) -> float:
        """Mean plastic strain of the inner elements."""
        w = self.packing.volume[self.inner]
        return float(np.average(self.sim.plastic_strain[self.inner], weights=w))

    @property
    def ledger(self) -> float:
        """Residual of the energy ledger over the work."""
        ledger = self.sim.energy()
        return ledger["residual"] / ledger["work"]

    def unloading(self) -> float:
        """Stress over strain of the inner elements when the grips, at rest, go back a little."""
        small = 4e-4
        self.sim.equilibrate(tolerance=1e-9)
        before = self.stress
        back = small * self.motion * self.body.held
        self.sim.set_state(displacement=self.sim.displacement - back)
        self.sim.equilibrate(tolerance=1e-9)
        return float((before - self.stress)[self.axis, self.axis] / small)


def _hexagonal(plane: str) -> Packing:
    return packing.hexagonal((12.0, 21.6), 1.0, plane)


@case("plastic", slow=True)
def pulled_blocks() -> Iterator[Measurement]:
    """Blocks with free sides, hexagonal 12 wide and fcc 4 wide, pulled to a strain of 0.015.

    Stress inside against the limit of a perfectly plastic and of a hardening solid, the slope of
    unloading against that of the same elastic block, and the ledger.
    """
    fcc = packing.fcc((4.0, 4.0, 6.0), 1.0)
    for p, stiffness, hardening in (
        (_hexagonal("strain"), None, 0.0),
        (_hexagonal("stress"), None, 0.0),
        (_hexagonal("strain"), 1.0, 0.0),
        (_hexagonal("stress"), 1.0, 0.0),
        (_hexagonal("strain"), None, 0.3),
        (_hexagonal("stress"), None, 0.3),
        (fcc, None, 0.0),
        (fcc, 1.0, 0.0),
    ):
        block = Pulled(p, VonMises(SY, hardening), stiffness)
        block.pull(0.015)
        where = f"plane {p.plane}" if p.plane else "fcc"
        where += ", facet" if stiffness is None else ", EVM"
        where += f", H = {hardening:g} G" if hardening else ""
        stress = block.stress
        exact = SY + hardening * block.plastic_strain
        exact *= PLANE_STRAIN if p.plane == "strain" else 1.0
        found = stress[block.axis, block.axis]
        if hardening == 0.0 and p.dim == 2:
            error = abs(found / exact - 1.0)
            what = "2/sqrt(3) sigma_y" if p.plane == "strain" else "sigma_y"
            yield Measurement(f"axial stress, {where}", exact, what, float(found), error, 8e-3)
        if p.plane != "stress":  # grips hold the sides back a little
            found -= stress[0, 0]
            error = abs(found / exact - 1.0)
            what = "2/sqrt(3) sigma_y" if p.plane else "sigma_y"
            yield Measurement(f"axial - lateral, {where}", exact, what, float(found), error, 5e-3)
        elif hardening:
            error = abs(found / exact - 1.0)
            yield Measurement(f"axial stress, {where}", exact, "sigma_y", float(found), error, 5e-3)
        yield vanishing(f"ledger over work, {where}", "conservation", block.ledger, 1e-6)
        if stiffness is None and hardening == 0.0:
            elastic = Pulled(p, VonMises(1e6 * SY)).unloading()
            found = block.unloading()
            error = abs(found / elastic - 1.0)
            what = f"slope of unloading, {where}"
            yield Measurement(what, elastic, "elastic block", found, error, 1e-3)


@case("plastic", slow=True)
def cycles() -> Iterator[Measurement]:
    """Periodic random cells strained to 0.02, to -0.02 and to 0.02 again at constant volume.

    Stress at the turning points, slope of unloading, and what a closed cycle dissipates.
    """
    for plane, hardening in product(("strain", "stress", None), (0.0, 0.1)):
        cycle = Cycle(_cell(plane, 4.0 if plane is None else 10.0), VonMises(SY, hardening))
        where = f"plane {plane}" if plane else "space"
        where += f", H = {hardening:g} G" if hardening else ""
        exact, dissipated = cycle.theory(hardening)
        found, taken = np.zeros(3), np.zeros(3)
        for turn in range(3):
            cycle.run()
            found[turn], taken[turn] = cycle.difference, cycle.sim.energy()["plastic"]
            if turn == 0:
                slope = cycle.unloading
        for turn in range(3):
            error = abs(found[turn] / exact[turn] - 1.0)
            what = f"difference of stresses, turn {turn + 1}, {where}"
            yield Measurement(what, exact[turn], "continuum", float(found[turn]), error, 5e-4)
        stiff = (4.0 if cycle.packing.dim == 2 else 3.0) * G
        error = abs(slope / stiff - 1.0)
        yield Measurement(f"slope of unloading, {where}", stiff, "elastic", slope, error, 1e-3)
        error = abs((taken[2] - taken[0]) / dissipated - 1.0)
        what, cycled = f"dissipated in a cycle, {where}", float(taken[2] - taken[0])
        yield Measurement(what, dissipated, "stress over strain", cycled, error, 1e-3)
        ledger = cycle.sim.energy()
        error = ledger["residual"] / ledger["work"]
        yield vanishing(f"ledger over work, {where}", "conservation", error, 1e-6)


class Cycle:
    """A periodic body under (1, -1) or (1, -1/2, -1/2) times a strain that goes to and fro."""

    size, leg, dt = 0.02, 200.0, 0.25
    turns = np.array([0.0, 1.0, -1.0, 1.0])

    def __init__(self, packing: Packing, law: YieldLaw) -> None:
        self.packing, self.law = packing, law
        self.direction = np.diag([1.0, -1.0] if packing.dim == 2 else [1.0, -0.5, -0.5])
        scene = Scene()
        body = scene.add(packing, SOLID, yielding=law)
        scene.strain(body, lambda t: self.strain(t) * self.direction)
        self.sim = Simulation(scene, dt=self.dt)
        self.legs = 0
        self.unloading = np.nan

    def strain(self, time: float) -> float:
        """At rest at the turns, so that inertia is."""
        leg = min(int(time / self.leg), len(self.turns) - 2)
        before, after = self.turns[leg : leg + 2]
        share = min(time / self.leg - leg, 1.0)
        return self.size * float(before + 0.5 * (after - before) * (1.0 - np.cos(pi * share)))

    @property
    def difference(self) -> float:
        """Mean sigma_xx - sigma_yy."""
        s = np.average(self.sim.stress, axis=0, weights=self.packing.volume)
        return float(s[0, 0] - s[1, 1])

    def run(self) -> None:
        """To the next turn; on the way, the slope at a tenth of it."""
        steps = round(self.leg / self.dt)
        start, before = self.strain(self.sim.time), self.difference
        self.sim.run(steps=steps // 8)
        self.unloading = (self.difference - before) / (self.strain(self.sim.time) - start)
        self.sim.run(steps=steps - steps // 8)

    def theory(self, hardening: float) -> tuple[Array, float]:
        """Stress differences at the turns, and the dissipation of the cycle between turns 1 and 3,
        of the continuum in small steps."""
        path = [np.linspace(a, b, 2000) for a, b in zip(self.turns, self.turns[1:], strict=False)]
        strain = self.size * np.concatenate(path)
        point = reference.FlowingPoint(
            YOUNG, NU, self.packing.plane, lambda p, rate: SY + hardening * p
        )
        stress = [point.strain_to(e * self.direction, 1.0) for e in strain]
        difference = np.array([s[0, 0] - s[1, 1] for s in stress])
        power = 0.5 * (difference[1:] + difference[:-1]) * np.diff(strain)
        turn = [1999, 3999, 5999]
        elastic = difference[turn] ** 2 / (8.0 if self.packing.dim == 2 else 6.0) / G
        cycle = power[1999:].sum() - (elastic[2] - elastic[0])
        return difference[turn], float(cycle * self.packing.volume.sum())


# -- momentum and energy --------------------------------------------------------------------------


@case("plastic")
def spinning_yielding_bodies() -> Iterator[Measurement]:
    """Bodies that fly, turn by one radian to seven and yield: their momenta and their ledger.

    Facet and EVM bonds, a stiffer half that does not yield (its faces have nodes), Nikolaevsky's
    flow. The residual is over the dissipated energy; that of elastic spin is of the same size.
    """
    flat = {plane: packing.hexagonal((11.0, 10.5), 1.0, plane) for plane in ("strain", "stress")}
    fcc = packing.fcc((4.0, 4.0, 4.0), 1.0)
    random = packing.voronoi((10.0, 10.0), 1.0, seed=2)
    rock = Nikolaevsky(SY, 0.5, 0.3, 0.2)
    metal = VonMises(SY, 0.2)
    for name, p, spin, law, stiffness, other in (
        ("hexagonal, plane strain", flat["strain"], 0.08, metal, None, 0.0),
        ("hexagonal, plane stress", flat["stress"], 0.05, metal, None, 0.0),
        ("random, plane strain", random, 0.08, metal, None, 0.0),
        ("fcc", fcc, 0.12, metal, None, 0.0),
        ("random in space", packing.voronoi((4.0,) * 3, 1.0, seed=2), 0.12, metal, None, 0.0),
        ("hexagonal, plane strain, EVM", flat["strain"], 0.08, metal, 0.5, 0.0),
        ("hexagonal, plane stress, EVM", flat["stress"], 0.05, metal, 0.5, 0.0),
        ("fcc, EVM", fcc, 0.12, metal, 0.5, 0.0),
        ("random, half of it stiffer", random, 0.08, metal, None, 2.0),
        ("fcc, half of it stiffer", fcc, 0.12, metal, None, 2.0),
        ("hexagonal, plane stress, half of it elastic", flat["stress"], 0.05, metal, None, 1.0),
        ("hexagonal, Nikolaevsky", flat["strain"], 0.05, rock, None, 0.0),
        ("fcc, Nikolaevsky", fcc, 0.1, rock, None, 0.0),
    ):
        linear, angular, residual, strain = _spin(p, spin, law, stiffness, other)
        yield at_least(f"plastic strain, {name}", "it yields", strain, 0.02)
        yield vanishing(f"linear momentum, {name}", "Newton", linear, 1e-12)
        yield vanishing(f"angular momentum, {name}", "Newton", angular, 1e-12)
        yield vanishing(f"ledger over dissipated, {name}", "conservation", residual, 2e-4)
        if name in ("hexagonal, Nikolaevsky", "hexagonal, plane strain, EVM"):
            coarse = _spin(p, spin, law, stiffness, other, dt=0.06)[2]
            order = float(np.log2(abs(coarse / residual)))
            yield at_least(f"order of the ledger in dt, {name}", "velocity Verlet", order, 1.8)


def _spin(
    p: Packing,
    spin: float,
    law: YieldLaw,
    stiffness: float | None,
    other: float,
    dt: float = 0.03,
) -> tuple[float, float, float, float]:
    """Relative change of both momenta, residual over dissipated energy, greatest plastic strain.

    other: how much stiffer the right half is, that does not yield; 0: there is none.
    """
    scene = Scene()
    if other:
        materials = SOLID, Material(YOUNG * other, NU, 1.0)
        right = p.position[:, 0] > p.position[:, 0].mean()
        body = scene.add(p, materials, grain=right.astype(int), yielding=[law, None])
    else:
        body = _add(scene, p, law, stiffness)
    axis = np.array([0.0, 0.0, 1.0]) if p.dim == 2 else np.array([0.3, 0.4, 1.0]) / sqrt(1.25)
    centre = np.average(p.position, axis=0, weights=p.volume)
    velocity = np.cross(spin * axis, reference.in_space(p.position - centre))[:, : p.dim]
    noise = np.random.default_rng(0).normal(0.0, 1e-4, velocity.shape)
    drift = 0.1 * np.arange(1, p.dim + 1)
    scene.set_velocity(body, velocity + drift + noise, spin * (axis[2:] if p.dim == 2 else axis))
    sim = Simulation(scene, dt=dt)
    start = _momenta(sim)
    sim.run(until=6.0 / spin)
    linear, angular = (
        float(np.linalg.norm(b - a) / np.linalg.norm(a))
        for a, b in zip(start, _momenta(sim), strict=True)
    )
    ledger = sim.energy()
    residual = ledger["residual"] / ledger["plastic"]
    return linear, angular, residual, float(sim.plastic_strain.max())


def _momenta(sim: Simulation) -> tuple[Array, Array]:
    """Linear momentum, and angular momentum about the origin; those of faces' nodes included."""
    m = sim.model
    u, v, w = (sim._step.download(x) for x in ("displacement", "velocity", "angular_velocity"))
    momentum = m.mass[:, None] * v
    orbital = np.cross(reference.in_space(m.position + u), reference.in_space(momentum))
    own = (m.inertia[:, None] * w)[: m.own_elements].sum(axis=0)
    return momentum.sum(axis=0), orbital.sum(axis=0)[3 - len(own) :] + own


# -- a thick cylinder -----------------------------------------------------------------------------


@case("plastic")
def thick_cylinder() -> Iterator[Measurement]:
    """A cylinder whose outer radius b is twice the inner one, a, widened from inside (Hill).

    Plane strain, perfectly plastic, a = 10 and 20 spacings; the wall inside is a layer that moves
    outwards. Pressure at first yield, at radii c of the plastic zone, at collapse.
    """
    yield from _cylinders(10.0, 20.0)


@case("plastic", slow=True)
def fine_thick_cylinder() -> Iterator[Measurement]:
    """The same at a = 40 spacings."""
    yield from _cylinders(20.0, 40.0)


def hill(c: float, a: float, b: float) -> float:
    """Pressure on the wall over the yield stress when the plastic zone reaches radius c (Hill)."""
    return (1.0 - (c / b) ** 2 + 2.0 * log(c / a)) / sqrt(3.0)


def _cylinders(coarse: float, fine: float) -> Iterator[Measurement]:
    errors = {}
    for a in (coarse, fine):
        cylinder = widened(a)
        where = f"a = {a:g}"
        inner, b, p, c = cylinder.inner, cylinder.outer, cylinder.pressure, cylinder.zone
        # cells flow by their mean stress, half a spacing inside: back to the wall on a parabola
        early = (c >= inner + 0.5) & (c <= 1.2 * inner)
        fit = np.polyfit(c[early] - inner, p[early], 2)
        exact, found = hill(inner, inner, b), float(fit[-1])
        first_error = abs(found / exact - 1.0)
        what = f"pressure at first yield over sigma_y, {where}"
        yield Measurement(what, exact, "(1 - a^2/b^2)/sqrt(3)", found, first_error, 0.04)
        curve = 0.0
        for share in (1.2, 1.4, 1.6, 1.8):
            at = int(np.argmax(c >= share * inner))
            exact, found = hill(c[at], inner, b), float(p[at])
            error = abs(found / exact - 1.0)
            curve = max(curve, error)
            what = f"pressure over sigma_y where c = {share:g} a, {where}"
            yield Measurement(what, exact, "Hill", found, error, 0.04)
        exact, found = 2.0 * log(b / inner) / sqrt(3.0), float(p[-20:].mean())
        error = abs(found / exact - 1.0)
        what = f"pressure at collapse over sigma_y, {where}"
        yield Measurement(what, exact, "2 ln(b/a)/sqrt(3)", found, error, 0.04)
        errors[a] = first_error, curve
        motion = float(cylinder.kinetic[c > inner].max())
        yield vanishing(f"kinetic energy over work since first yield, {where}", "", motion, 0.01)
        yield vanishing(f"ledger over work, {where}", "conservation", cylinder.residual, 1e-6)
    for at, name in enumerate(("first yield", "the curve")):
        closer = errors[coarse][at] / errors[fine][at]
        what = f"error of {name}, a = {coarse:g} over that at {fine:g}"
        yield at_least(what, "refinement", closer, 1.2)


@dataclass(frozen=True)
class Cylinder:
    """What was seen of a cylinder that is widened: over time, and of its end."""

    inner: float  # radius of the wall, between the layer that moves and the rest
    outer: float
    pressure: Array  # on the wall, over the yield stress
    zone: Array  # outer radius of a ring of the area that flows
    kinetic: Array  # energy over the work done
    residual: float


@cache
def widened(a: float, precision: str = "float64") -> Cylinder:
    """A cylinder of inner radius a [spacings] and outer radius 2 a, widened from inside."""
    sy, b, time, looks = 1e-3 * G, 2.0 * a, 60.0 * a, 300
    p = packing.voronoi(packing.Ring(a - 1.0, b), 1.0)
    wall = p.side("inner")
    r = np.linalg.norm(p.position, axis=1)
    outwards = p.position / r[:, None]
    inner = sqrt(p.volume[wall].sum() / pi + (a - 1.0) ** 2)
    scene = Scene()
    body = scene.add(p, SOLID, yielding=VonMises(sy))
    # as Lame's elastic cylinder moves, so that nothing is jerked
    lame = (1.0 - 2.0 * NU) * r / b**2 + 1.0 / r
    speed = 1.6 * sy / sqrt(3.0) / (2.0 * G) * b**2 / time
    scene.set_velocity(body, speed * lame[:, None] * outwards)
    scene.hold(body, wall, speed * lame[wall, None] * outwards[wall])
    sim = Simulation(scene, precision=precision)
    # the wall's pressure: of bonds that cross it, along the radius of their middle
    i, j = sim.bonds.T
    crossing = wall[i] != wall[j]
    normal = p.position[i[crossing]] + p.position[j[crossing]]
    normal *= np.where(wall[i[crossing]], -1.0, 1.0)[:, None]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    pressure, zone, kinetic = np.zeros(looks), np.zeros(looks), np.zeros(looks)
    for look in range(looks):
        sim.run(until=(look + 1) * time / looks)
        force = (sim.bond_force[crossing] * normal).sum()
        pressure[look] = force / (2.0 * pi * inner * sy)
        flows = (sim.plastic_strain > 0.0) & ~wall
        zone[look] = sqrt(inner**2 + p.volume[flows].sum() / pi)
        ledger = sim.energy()
        kinetic[look] = ledger["kinetic"] / ledger["work"]
    return Cylinder(inner, b, pressure, zone, kinetic, ledger["residual"] / ledger["work"])


@case("plastic")
def pressed_ring() -> Iterator[Measurement]:
    """The same cylinder, a = 20, pressed from inside by a pressure that grows slowly (scene.press).

    Elastic widening of the bore (Lame), and the radius that the plastic zone reaches. The load acts
    at the centres of the cells of the wall, half a spacing away from it: of first order in that.
    """
    sy, a, b, time = 1e-3 * G, 20.0, 40.0, 1500.0
    p = packing.voronoi(packing.Ring(a, b), 1.0)
    r = np.linalg.norm(p.position, axis=1)
    outwards = p.position / r[:, None]
    most = 2.0 * log(b / a) / sqrt(3.0)  # collapse
    scene = Scene()
    body = scene.add(p, SOLID, yielding=VonMises(sy))
    scene.press(body, p.side("inner"), most * sy, history=([0.0, time], [0.0, 1.0]))
    # u = p/(2 G (1/a^2 - 1/b^2)) ((1 - 2 nu) r/b^2 + 1/r)
    lame = ((1.0 - 2.0 * NU) * r / b**2 + 1.0 / r) / (2.0 * G * (1.0 / a**2 - 1.0 / b**2))
    scene.set_velocity(body, most * sy / time * lame[:, None] * outwards)
    sim = Simulation(scene)
    sim.run(until=0.4 * time)
    far = p.side("outer")
    share = (sim.displacement * outwards).sum(axis=1)[far] / (0.4 * most * sy * lame[far])
    error = abs(float(share.mean()) - 1.0)
    what = "widening of the outside, elastic"
    yield Measurement(what, 1.0, "Lame", float(share.mean()), error, 0.01)
    for part in (0.9, 0.96):
        sim.run(until=part * time)
        zone = sqrt(a**2 + p.volume[sim.plastic_strain > 0.0].sum() / pi)
        exact, found = hill(zone, a, b), part * most
        error = abs(found / exact - 1.0)
        what = f"pressure over sigma_y where c = {zone / a:.3g} a"
        yield Measurement(what, exact, "Hill", found, error, 0.04)
    ledger = sim.energy()
    motion = ledger["kinetic"] / ledger["work"]
    yield vanishing("kinetic energy over work", "", motion, 0.01)
    error = ledger["residual"] / ledger["work"]
    yield vanishing("ledger over work", "conservation", error, 1e-6)


# -- precision, range, neighbours that do not flow ------------------------------------------------


@case("plastic")
def single_precision() -> Iterator[Measurement]:
    """The pulled blocks in float32 and mixed precision: their plateau and ledger."""
    for p, precision in (
        (_hexagonal("strain"), "float32"),
        (packing.fcc((4.0, 4.0, 6.0), 1.0), "mixed"),
    ):
        block = Pulled(p, VonMises(SY), None, precision)
        block.pull(0.015)
        where = f"plane {p.plane}" if p.plane else "fcc"
        exact = SY * (PLANE_STRAIN if p.plane == "strain" else 1.0)
        found = float(block.stress[block.axis, block.axis] - block.stress[0, 0])
        error = abs(found / exact - 1.0)
        what = f"axial - lateral, {where}, {precision}"
        yield Measurement(what, exact, "sigma_y", found, error, 8e-3)
        limit = 1e-3 if precision == "float32" else 1e-6
        yield vanishing(f"ledger over work, {where}, {precision}", "", block.ledger, limit)


@case("plastic")
def range_of_small_strain() -> Iterator[Measurement]:
    """What limits the strain: a stretch e at constant area shows a false pressure K e^2.

    Periodic random cells, sides held; the yield stress is 0.01 G. The difference of stresses stays.
    """
    for size in (0.01, 0.02, 0.05):
        p = _cell("strain", 8.0)
        scene = Scene()
        body = scene.add(p, SOLID, yielding=VonMises(SY))

        def stretch(time: float, size: float = size) -> Array:
            e = size * 0.5 * (1.0 - np.cos(pi * min(time / 400.0, 1.0)))
            return np.diag([e, 1.0 / (1.0 + e) - 1.0])

        scene.strain(body, stretch)
        sim = Simulation(scene)
        sim.run(until=400.0)
        s = np.average(sim.stress, axis=0, weights=p.volume)
        exact, found = -BULK * size**2 / SY, -float(np.trace(s)) / 3.0 / SY
        error = abs(found / exact - 1.0)
        what = f"false pressure over sigma_y at a strain of {size:g}"
        yield Measurement(what, exact, "-K e^2", found, error, 0.1)
        found = float(s[0, 0] - s[1, 1]) / SY
        error = abs(found / PLANE_STRAIN - 1.0)
        what = f"difference of stresses over sigma_y at a strain of {size:g}"
        yield Measurement(what, PLANE_STRAIN, "2/sqrt(3)", found, error, 1e-3)


@case("plastic")
def beside_elastic() -> Iterator[Measurement]:
    """Periodic random cells of which one half flows and the other, of the same moduli, does not.

    In space a pressure of ten yield stresses is added, which must not matter. In the plane the
    halves are layers; theory is a laminate, the error that of rough layers 8 and 16 cells thick.
    """
    found = [_sheared_halves(pressure) for pressure in (0.0, 10.0)]
    error = abs(found[1] / found[0] - 1.0)
    what = "difference of stresses under pressure, space"
    yield Measurement(what, found[0], "without pressure", found[1], error, 1e-3)
    for plane in ("strain", "stress"):
        exact, errors = _laminate(plane), []
        for size in (16.0, 32.0):
            layered = _layers(plane, size)
            errors.append(abs(layered / exact - 1.0))
            what = f"difference of stresses over sigma_y, plane {plane}, {size / 2.0:g} thick"
            limit = 0.96 / size
            yield Measurement(what, exact, "laminate", layered, errors[-1], limit)
        what = f"error at 8 thick over that at 16, plane {plane}"
        yield at_least(what, "refinement", errors[0] / errors[1], 1.5)


def _sheared_halves(pressure: float) -> float:
    """sigma_xx - sigma_yy over sigma_y, at a strain of twice that at yield."""
    sy = 1e-5 * G  # so small that strains are, under pressure too
    p = _cell(None, 5.0)
    half = (p.position[:, 2] > 2.5).astype(int)
    squeezed = -pressure * sy / (3.0 * BULK) * np.eye(3)
    most = 2.0 * sy / (3.0 * G)
    scene = Scene()
    body = scene.add(p, (SOLID, SOLID), grain=half, yielding=[VonMises(sy), None])
    direction = np.diag([1.0, -0.5, -0.5])
    scene.strain(body, lambda t: squeezed + most * min(t / 200.0, 1.0) * direction)
    sim = Simulation(scene, local_damping=0.3)
    sim.run(until=300.0)
    s = np.average(sim.stress, axis=0, weights=p.volume)
    return float(s[0, 0] - s[1, 1]) / sy


def _layers(plane: str, size: float) -> float:
    """Mean sigma_xx - sigma_yy over sigma_y of two layers at a strain of 0.01 along them, and
    -0.01 across."""
    p = packing.voronoi((8.0, size), 1.0, plane, periodic=True, seed=1)
    half = (p.position[:, 1] > 0.5 * size).astype(int)
    scene = Scene()
    body = scene.add(p, (SOLID, SOLID), grain=half, yielding=[VonMises(SY), None])
    direction = 0.005 * np.diag([1.0, -1.0])
    scene.strain(body, lambda t: (1.0 - np.cos(pi * min(t / 200.0, 1.0))) * direction)
    sim = Simulation(scene, local_damping=0.3)
    sim.run(until=200.0)
    s = np.average(sim.stress, axis=0, weights=p.volume)
    return float(s[0, 0] - s[1, 1]) / SY


def _laminate(plane: str) -> float:
    """The same of the continuum: strains along the layers and stresses across them agree."""
    soft = reference.FlowingPoint(YOUNG, NU, plane, lambda p, rate: SY)
    firm = reference.FlowingPoint(YOUNG, NU, plane, lambda p, rate: 1e9)
    for e in np.linspace(0.0, 0.01, 61)[1:]:

        def jump(across: float, e: float = e) -> float:
            own = copy(soft).strain_to(np.diag([e, across]), 1.0)[1, 1]
            return float(own - copy(firm).strain_to(np.diag([e, -2.0 * e - across]), 1.0)[1, 1])

        across = brentq(jump, -5.0 * e, 5.0 * e, xtol=1e-16)
        both = soft.strain_to(np.diag([e, across]), 1.0)
        both = both + firm.strain_to(np.diag([e, -2.0 * e - across]), 1.0)
    return 0.5 * float(both[0, 0] - both[1, 1]) / SY

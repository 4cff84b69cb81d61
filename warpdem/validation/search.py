"""The search for neighbours, periodic contact and hard cases of contact (theory B11, C5)."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .. import packing
from ..criteria import Rankine
from ..errors import Array
from ..material import Material
from ..scene import Body, Scene
from ..simulation import Simulation
from .case import Measurement, case
from .contact import ball, momenta
from .core import vanishing

SOFT = Material(1.0, 0.3, 1.0)


def _pair(
    dim: int, precision: str, restitution: float, rate: float, through: bool
) -> tuple[Simulation, Array]:
    """Two elements on their way to each other, and by how far the second is that which is met.

    through: in a periodic box whose strain grows at `rate`, through one of its sides, else in
    free space, where the second element moves as its image does.
    """
    edge = np.array([4.0, 5.0, 6.0])[:dim]
    shape = np.array([[1.0, 0.4, 0.2], [0.4, -0.5, 0.3], [0.2, 0.3, 0.7]])[:dim, :dim]
    count = np.array([1.0, 0.0, -1.0])[:dim]
    one, image = np.array([3.6, 1.0, 0.5])[:dim], np.array([4.65, 1.3, 0.3])[:dim]
    flow = rate * shape @ (count * edge)
    scene = Scene()
    bodies: list[Body] = []
    for place in (one, image - count * edge if through else image):
        p = replace(ball(place, 0.5 if not bodies else 0.4), period=edge if through else None)
        bodies.append(scene.add(p, SOFT))
        if through and rate:
            scene.strain(bodies[-1], _growing if rate > 0.0 else _shrinking)
        scene.set_velocity(bodies[-1], np.array([6e-3, 1e-3, -2e-3])[:dim] * (len(bodies) == 1))
    if not through:
        scene.set_velocity(bodies[1], flow)
    scene.contact(friction=0.3, restitution=restitution, skin=0.3)
    sim = Simulation(scene, precision=precision, dt=0.02)
    return sim, count * edge if through else np.zeros(dim)


def _growing(time: float) -> Array:
    shape = np.array([[1.0, 0.4, 0.2], [0.4, -0.5, 0.3], [0.2, 0.3, 0.7]])
    return 1e-4 * time * shape[:2, :2]


def _shrinking(time: float) -> Array:
    return -_growing(time)


@case("search")
def pairs_touch_through_sides() -> Iterator[Measurement]:
    """Two elements that meet through the sides of a periodic box, at rest and as its strain
    changes, beside the same two in free space."""
    runs = [(2, "float64", r, e) for r in (0.0, 1e-4, -1e-4) for e in (1.0, 0.6)]
    runs += [(3, "float64", 0.0, 1.0), (2, "mixed", -1e-4, 1.0), (2, "float32", -1e-4, 1.0)]
    limits = {"float64": 1e-12, "mixed": 1e-6, "float32": 1e-4}
    for dim, precision, rate, restitution in runs:
        one, shift = _pair(dim, precision, restitution, rate, through=True)
        two, _ = _pair(dim, precision, restitution, rate, through=False)
        flow = rate * np.array([1.0, 0.4]) * 4.0 if rate else np.zeros(dim)
        worst, touched = 0.0, 0
        for _ in range(300):
            for sim in (one, two):
                sim.run(steps=20)
            moved = shift + flow * one.time
            worst = max(
                worst,
                np.abs(one.position[1] + moved - two.position[1]).max(),
                np.abs(one.position[0] - two.position[0]).max(),
                np.abs(one.angular_velocity - two.angular_velocity).max(),
            )
            touched += len(one.contacts)
        where = f"{dim}D, {precision}, rate {rate:g}, restitution {restitution}"
        yield Measurement(
            f"times seen touching, {where}", 1, "they meet", touched, float(touched == 0), 0.0
        )
        limit = limits[precision]
        yield vanishing(f"places and spins apart, {where}", "free space", worst, limit)
        missing = [sim.energy()["residual"] / two.initial_energies["kinetic"] for sim in (one, two)]
        error = abs(missing[0] - missing[1])
        yield vanishing(f"energy missing beyond, {where}", "free space", error, 10.0 * limit)
        yield vanishing(f"energy missing, {where}", "conserved", abs(missing[0]), 1e-4)


@case("search")
def broken_periodic_bodies() -> Iterator[Measurement]:
    """All bonds of a strained periodic body break in one step; its pieces push each other, through
    the sides too, while the box shrinks."""
    for dim in (2, 3):
        p = packing.voronoi(
            (7.0, 6.0, 5.0)[:dim], 1.0, "strain" if dim == 2 else None, seed=1, periodic=True
        )
        tension = np.diag([2e-2, 1e-2, 3e-2][:dim])
        for moves in (False, True):
            scene = Scene()
            body = scene.add(p, SOFT, fracture=Rankine(1e-9))

            def shrinking(time: float, first: Array = tension) -> Array:
                return first * (1.0 - 0.02 * time)

            scene.strain(body, shrinking if moves else tension)
            rng = np.random.default_rng(3)
            v = 0.02 * rng.normal(size=p.position.shape)
            if moves:
                centre = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
                v -= 0.02 * (p.position - centre) @ tension
            scene.set_velocity(body, v)
            scene.contact(friction=0.3)
            sim = Simulation(scene, dt=0.1)
            before, size = momenta(sim)[0], 0.0
            start = sum(sim.initial_energies[x] for x in ("kinetic", "pair", "volume"))
            sim.run(steps=1)
            where = f"{dim}D, box " + ("shrinks" if moves else "stays")
            left = int(sim.linked.sum())
            yield vanishing(f"bonds left, {where}", "all break", left, 0.0)
            worst, touched, across = 0.0, 0, 0
            for _ in range(10):
                sim.run(until=sim.time + 15.0)
                now = momenta(sim)
                size = max(size, now[2])
                worst = max(worst, np.abs(now[0] - before).max())
                pairs = sim.contacts
                touched += len(pairs)
                apart = np.linalg.norm(
                    sim.position[pairs[:, 1]] - sim.position[pairs[:, 0]], axis=1
                )
                across += int((apart > 2.0).sum())
            yield Measurement(
                f"new pairs seen touching, through sides, {where}", 1, "they move", across,
                float(across == 0), 0.0,
            )  # fmt: skip
            yield vanishing(f"momentum, {where}", "Newton", worst / size, 1e-12)
            ledger = sim.energy()
            finite = np.isfinite(sim.position).all() and np.isfinite(sim.velocity).all()
            yield vanishing(f"numbers not finite, {where}", "none", float(not finite), 0.0)
            scale = start + abs(ledger["work"])
            yield vanishing(
                f"energy missing, {where}", "conserved", abs(ledger["residual"]) / scale, 1e-3
            )
            if not moves:
                gained = max(0.0, ledger["kinetic"] + ledger["contact"] - start) / start
                yield vanishing(f"energy gained, {where}", "bounded", gained, 0.0)

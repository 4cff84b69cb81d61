"""The search for neighbours, periodic contact and hard cases of contact (theory B11, C5)."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi

import numpy as np

from .. import packing
from ..criteria import Rankine
from ..errors import Array
from ..scene import Body, Scene
from ..simulation import Simulation
from .case import Measurement, case
from .contact import SOFT, ball, momenta, turned_once
from .core import vanishing


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


@case("search", slow=True)
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


@case("search", slow=True)
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


def _rubble(dim: int, pressed: float, friction: float = 0.3, seed: int = 4) -> Simulation:
    """A pressed, or stretched, body of which every element is on its own, and spins."""
    p = packing.voronoi((5.0, 4.0, 3.0)[:dim], 1.0, "strain" if dim == 2 else None, seed=seed)
    scene = Scene()
    body = scene.add(p, SOFT)
    body.linked[:] = False
    scene.strain(body, -pressed * np.eye(dim))
    rng = np.random.default_rng(seed)
    out = 0.02 * (p.position - p.position.mean(axis=0))
    scene.set_velocity(body, out + 5e-3 * rng.normal(size=p.position.shape))
    body.angular_velocity[:] = 0.1 * rng.normal(size=body.angular_velocity.shape)
    scene.contact(friction=friction)
    return Simulation(scene)


@case("search", slow=True)
def rubble_spins_and_flies() -> Iterator[Measurement]:
    """Loose elements, at first pressed on each other, that spin, push each other and fly apart:
    momenta step by step, energy, and the same bits in five runs."""
    for dim in (2, 3):
        for pressed in (0.05, -0.1):
            sim = _rubble(dim, pressed)
            start = sum(sim.initial_energies[x] for x in ("kinetic", "pair", "volume", "contact"))
            where = f"{dim}D, " + ("pressed" if pressed > 0.0 else "apart")
            last, worst, total, most = momenta(sim), 0.0, 0.0, 0.0
            first = last
            for _ in range(400):
                sim.run(steps=1)
                now = momenta(sim)
                for at in (0, 1):
                    size = max(now[2 + at], last[2 + at])
                    worst = max(worst, float(np.abs(now[at] - last[at]).max() / size))
                    total = max(total, float(np.abs(now[at] - first[at]).max() / size))
                last = now
            for _ in range(20):
                sim.run(steps=20)
                ledger = sim.energy()
                most = max(most, ledger["kinetic"] + ledger["contact"])
            yield vanishing(f"momenta, change in a step, {where}", "Newton", worst, 1e-12)
            yield vanishing(f"momenta, change in 400 steps, {where}", "Newton", total, 1e-11)
            gained = max(0.0, most - start) / start
            yield vanishing(f"energy gained, {where}", "bounded", gained, 1e-3)
            missing = abs(sim.energy()["residual"]) / start
            yield vanishing(f"energy missing, {where}", "conserved", missing, 1e-3)
            near = sim._step.neighbours
            assert near is not None
            builds = near.builds
            yield Measurement(
                f"lists built, {where}", 2, "they move", builds, float(builds < 2), 0.0
            )
        states = []
        for _ in range(5):
            sim = _rubble(dim, 0.05)
            sim.run(steps=300)
            states.append(np.concatenate([sim.position, sim.velocity], axis=1))
        differs = sum(int((state != states[0]).sum()) for state in states)
        yield vanishing(f"numbers that differ in five runs, {dim}D", "same bits", differs, 0.0)


@case("search")
def pressed_pairs_turn_once() -> Iterator[Measurement]:
    """A pressed pair with a tangential spring turns rigidly once, 1000 steps: two elements that
    touch, and two faces of a broken bond, in the plane and about any axis in space."""
    steps = 1000
    axes = [(2, [0.0, 0.0, 1.0]), (3, [0.3, -0.5, 0.8]), (3, [1.0, 0.0, 0.2])]
    axes += [(3, [0.0, 1.0, 0.0]), (3, [0.0, 0.0, 1.0])]
    for dim, axis in axes:
        for faces in (False, True):
            omega = np.array(axis) / np.linalg.norm(axis)
            scene = Scene()
            if faces:
                p = packing.square((2.0, 1.0), 1.0, "strain")
                p = p if dim == 2 else packing.simple_cubic((2.0, 1.0, 1.0), 1.0)
                body = scene.add(p, SOFT)
                body.linked[:] = False
                body.displacement[1, 0] = -0.05
            else:
                scene.add(ball(np.zeros(dim), 0.5), SOFT)
                scene.add(ball(0.9 * np.eye(dim)[0], 0.5), SOFT)
            scene.contact(friction=100.0)
            sim = Simulation(scene, dt=2.0 * pi / steps, force_dt=True)
            step, spring = sim._step, np.array([0.0, 0.01, 0.02])[:dim]
            if faces:
                name = "closing_spring"
                step.upload(name, spring[None])
                step.upload("closing_slip", (-0.05 * np.eye(dim)[0] - spring)[None])
            else:
                name = "contact_spring"
                whole = np.zeros(step.arrays[name].size)
                whole[: 2 * dim] = np.tile(spring, 2)
                step.arrays[name].assign(whole)
            error = turned_once(sim, name, spring, omega, steps)
            where = f"{dim}D, axis {axis}, " + ("faces" if faces else "elements")
            yield vanishing(f"spring on the way, {where}", "turned with the pair", error, 1e-5)
            lost = abs(sim.energy()["friction"])
            yield vanishing(f"taken by slip, {where}", "no slip", lost, 1e-15 if faces else 1e-20)

"""Rolling and twisting resistance of contacts against closed forms (theory B11)."""

from collections.abc import Iterator
from math import pi

import numpy as np

from ..scene import Scene
from ..simulation import Simulation
from .case import Measurement, case
from .contact import SOFT, ball, momenta, turned_once
from .core import vanishing

ROLLING, TWISTING = 0.05, 0.03
GRAVITY, RADIUS = 1e-4, 0.5


def _on_plane(
    dim: int, slope: float = 0.0, calm: float = 0.0, spin: float = 0.0, speed: float = 0.0
) -> Simulation:
    """An element at rest on a plane across it, or rolling on it, or spinning about the vertical."""
    scene = Scene()
    scene.add(ball(np.zeros(dim), RADIUS), SOFT)
    scene.contact(
        friction=0.6, rolling_friction=ROLLING, twisting_friction=TWISTING if dim == 3 else 0.0
    )
    up = np.eye(dim)[1]
    scene.wall(-RADIUS * up, up)
    fall = np.zeros(dim)
    fall[:2] = GRAVITY * np.sin(slope), -GRAVITY * np.cos(slope)
    scene.set_gravity(fall)
    sim = Simulation(scene, local_damping=calm)
    m = sim.model
    assert m.contact_compliance is not None and m.contact_width is not None
    area = 2.0 * RADIUS * m.contact_width[0] if dim == 2 else pi * RADIUS**2
    sag = m.mass[0] * GRAVITY * np.cos(slope) * m.contact_compliance[0] / area
    v, w = np.zeros((1, dim)), np.zeros((1, 1 if dim == 2 else 3))
    v[0, 0], w[0, -1] = speed, -speed / (RADIUS - sag)
    if spin:
        w[0, 1] = spin
    sim.set_state(displacement=[-sag * up], velocity=v, angular_velocity=w)
    return sim


def _inertia(sim: Simulation) -> float:
    """J/(m R^2)."""
    return float(sim.model.inertia[0] / (sim.model.mass[0] * RADIUS**2))


@case("contact", slow=True)
def rollers_stop() -> Iterator[Measurement]:
    """A disc and a sphere that roll on a plane come to rest after v^2/(2 a), a being
    mu_r g/(1 + J/(m R^2)); a sphere that spins on it after the turn J w^2/(2 mu_t R N)."""
    speed = 0.02
    for dim, name in ((2, "disc"), (3, "sphere")):
        sim = _on_plane(dim, speed=speed)
        held = sim.energy()["kinetic"]
        slowing = ROLLING * GRAVITY / (1.0 + _inertia(sim))
        sim.run(until=0.5 * speed / slowing)
        wanted = speed - slowing * sim.time
        found = float(sim.velocity[0, 0])
        yield Measurement(
            f"speed half way, {name}", wanted, "v - a t", found, abs(found / wanted - 1.0), 1e-3
        )
        way = speed**2 / (2.0 * slowing)
        sim.run(until=1.1 * speed / slowing)
        gone: list[float] = []  # it swings about its rest on the springs
        for _ in range(50):
            sim.run(steps=20)
            gone.append(float(sim.displacement[0, 0]))
        found = float(np.mean(gone))
        yield Measurement(f"way, {name}", way, "v^2/(2 a)", found, abs(found / way - 1.0), 1e-3)
        ledger = sim.energy()
        taken = ledger["friction"] / held
        yield Measurement(
            f"share of energy taken, {name}", 1.0, "all", taken, abs(taken - 1.0), 1e-5
        )
        yield vanishing(
            f"energy missing, {name}", "conserved", abs(ledger["residual"]) / held, 1e-5
        )
    spin = 0.02
    sim = _on_plane(3, spin=spin)
    m = sim.model
    slowing = TWISTING * RADIUS * m.mass[0] * GRAVITY / m.inertia[0]
    turn, held = spin**2 / (2.0 * slowing), sim.energy()["kinetic"]
    angle, last = 0.0, 0.0
    found_turns: list[float] = []
    while sim.time < 1.2 * spin / slowing:
        sim.run(steps=20)
        now = 2.0 * float(np.arctan2(sim.orientation[0, 1], sim.orientation[0, 3]))
        angle += (now - last + pi) % (2.0 * pi) - pi
        last = now
        if sim.time > 1.1 * spin / slowing:
            found_turns.append(angle)
    found = float(np.mean(found_turns))
    yield Measurement(
        "turn of a spinning sphere", turn, "J w^2/(2 mu_t R N)", found, abs(found / turn - 1.0),
        1e-3,
    )  # fmt: skip
    missing = abs(sim.energy()["residual"]) / held
    yield vanishing("energy missing, spinning sphere", "conserved", missing, 1e-5)


def _resting(dim: int, share: float, steps: int) -> Iterator[Measurement]:
    """Creep of an element on a slope, a share of the greatest on which it rests."""
    sim = _on_plane(dim, slope=float(np.arctan(share * ROLLING)), calm=0.7)
    sim.run(steps=6000)  # to rest, on springs that are held
    m = sim.model
    taken, place = sim.energy()["friction"], []
    most = sim.energy()["contact"] + sim.energy()["kinetic"]
    start = most
    for _ in range(40):
        sim.run(steps=steps // 40)
        place.append(float(sim.displacement[0, 0]))
        ledger = sim.energy()
        most = max(most, ledger["contact"] + ledger["kinetic"])
    creep = abs(np.mean(place[20:]) - np.mean(place[:20]))
    assert m.contact_shear is not None and m.contact_width is not None
    area = 2.0 * RADIUS * m.contact_width[0] if dim == 2 else pi * RADIUS**2
    give = m.mass[0] * GRAVITY * share * ROLLING / (area / m.contact_shear[0])
    where = f"{dim}D, {share} of the slope, {steps} steps"
    yield vanishing(f"creep over elastic give, {where}", "rest", float(creep / give), 1e-3)
    yield vanishing(f"taken, {where}", "rest", ledger["friction"] - taken, 1e-18)
    yield vanishing(f"energy gained over that held, {where}", "rest", most / start - 1.0, 1e-9)


@case("contact")
def rollers_rest_on_slopes() -> Iterator[Measurement]:
    """Below tan(slope) = mu_r a disc and a sphere rest without creep; above it they roll."""
    for dim in (2, 3):
        for share in (0.3, 0.8):
            yield from _resting(dim, share, 8000)
        slope = float(np.arctan(1.5 * ROLLING))
        sim = _on_plane(dim, slope)
        sim.run(steps=2000)
        v, time = float(sim.velocity[0, 0]), sim.time
        sim.run(steps=4000)
        found = (float(sim.velocity[0, 0]) - v) / (sim.time - time)
        wanted = GRAVITY * (np.sin(slope) - ROLLING * np.cos(slope)) / (1.0 + _inertia(sim))
        yield Measurement(
            f"acceleration on a steeper slope, {dim}D", wanted,
            "g (sin - mu_r cos)/(1 + J/(m R^2))", found, abs(found / wanted - 1.0), 1e-3,
        )  # fmt: skip


@case("contact", slow=True)
def rollers_rest_for_long() -> Iterator[Measurement]:
    """The same for a million steps."""
    for dim in (2, 3):
        yield from _resting(dim, 0.8, 1_000_000)


@case("contact")
def rolling_pairs() -> Iterator[Measurement]:
    """Pairs: an element turning on a held one is stopped by mu_r R N, 1/R the sum of curvatures;
    moments are opposite; the spring turns with its pair."""
    radii = 0.5, 0.35
    rolling = radii[0] * radii[1] / sum(radii)
    for dim, axis in ((2, 0), (3, 2), (3, 0)):
        scene = Scene()
        fixed = scene.add(ball(np.zeros(dim), radii[0]), SOFT)
        scene.add(ball((sum(radii) - 1e-3) * np.eye(dim)[0], radii[1]), SOFT)
        turning = scene.bodies[1]
        scene.hold(fixed, [0])
        scene.hold(turning, [0], rotation=False)
        twists = dim == 3 and axis == 0
        scene.contact(rolling_friction=ROLLING, twisting_friction=TWISTING if dim == 3 else 0.0)
        sim = Simulation(scene, dt=0.05)
        w = np.zeros_like(sim.angular_velocity)
        w[1, axis] = spin = 2e-3
        sim.set_state(angular_velocity=w)
        pressed = abs(float(sim.force[1, 0]))
        share = TWISTING if twists else ROLLING
        slowing = share * rolling * pressed / sim.model.inertia[1]
        held = sim.energy()["kinetic"]
        sim.run(until=0.4 * spin / slowing)  # beyond what the spring yields
        name = f"{dim}D, " + ("twisting" if twists else "rolling")
        time, early = sim.time, float(sim.angular_velocity[1, axis])
        sim.run(until=0.8 * spin / slowing)
        found = (early - float(sim.angular_velocity[1, axis])) / (sim.time - time)
        yield Measurement(
            f"slowing down, {name}", slowing, "mu R N/J", found, abs(found / slowing - 1.0), 1e-3
        )
        missing = abs(sim.energy()["residual"]) / held
        yield vanishing(f"energy missing, {name}", "conserved", missing, 1e-6)
        both = np.abs(sim.torque.sum(axis=0)).max() / np.abs(sim.torque).max()
        yield vanishing(f"moments on both, {name}", "opposite", float(both), 0.0)
    for dim in (2, 3):
        yield from _oblique(dim)
    yield from _turned_rigidly()


def _oblique(dim: int) -> Iterator[Measurement]:
    """Two spinning elements that meet obliquely: angular momentum and energy."""
    scene = Scene()
    one = scene.add(ball(np.zeros(dim), 0.5), SOFT)
    scene.add(ball(np.array([1.02, 0.3, -0.2])[:dim], 0.4), SOFT)
    spin = [0.05] if dim == 2 else [0.03, -0.02, 0.05]
    scene.set_velocity(one, np.array([5e-3, 1e-3, 0.0])[:dim], angular_velocity=spin)
    scene.contact(
        friction=0.3, rolling_friction=0.2, twisting_friction=0.1 if dim == 3 else 0.0,
        restitution=0.7, restitution_by="dashpot",
    )  # fmt: skip
    sim = Simulation(scene, dt=0.02)
    before, held = momenta(sim), sim.energy()["kinetic"]
    touched = False
    while (not touched or len(sim.contacts)) and sim.time < 1e4:
        sim.run(steps=10)
        touched |= len(sim.contacts) > 0
    after = momenta(sim)
    error = np.abs(after[0] - before[0]).max() / before[2]
    yield vanishing(f"momentum, oblique, {dim}D", "Newton", float(error), 1e-14)
    error = np.abs(after[1] - before[1]).max() / np.abs(before[1]).max()
    yield vanishing(f"angular momentum, oblique, {dim}D", "Newton", float(error), 1e-12)
    ledger = sim.energy()
    yield vanishing(
        f"energy missing, oblique, {dim}D", "conserved", abs(ledger["residual"]) / held, 1e-4
    )
    taken = ledger["friction"] / held
    yield Measurement(
        f"taken by friction, oblique, {dim}D", 0.0, "positive", taken, float(taken <= 0.0), 0.0
    )


def _turned_rigidly() -> Iterator[Measurement]:
    """A pressed pair with a spring of rolling and twisting turns once about an axis."""
    steps = 1000
    omega = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    scene = Scene()
    scene.add(ball(np.zeros(3), 0.5), SOFT)
    scene.add(ball(np.array([0.9, 0.0, 0.0]), 0.5), SOFT)
    scene.contact(rolling_friction=100.0, twisting_friction=100.0)
    sim = Simulation(scene, dt=2.0 * pi / steps, force_dt=True)
    spring, rolls = np.array([0.015, 0.01, 0.02]), sim._step.arrays["contact_roll"]
    whole = np.zeros(rolls.size)
    whole[:6] = np.tile(spring, 2)
    rolls.assign(whole)
    error = turned_once(sim, "contact_roll", spring, omega, steps)
    yield vanishing("spring on the way through a turn", "turned with the pair", error, 1e-5)
    lost = abs(sim.energy()["friction"])
    yield vanishing("taken through a turn", "nothing rolls", lost, 1e-20)

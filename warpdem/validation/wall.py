"""Walls of all shapes, how they move, and Hertz's contact with them (theory B11)."""

from collections.abc import Iterator
from math import pi

import numpy as np

from .. import packing
from ..errors import Array
from ..material import Material
from ..packing import Packing
from ..scene import Scene
from ..simulation import Simulation
from ..wall import Box, Cylinder, Mesh, Plane, Shape, Sphere, rotated, rotation
from .case import Measurement, case
from .contact import SOFT, ball
from .core import vanishing

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
# two triangles a side, against the clock from outside
SIDES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def box_mesh(centre: Array, size: Array) -> Mesh:
    """A box as a mesh of twelve triangles."""
    return Mesh(centre + 0.5 * size * CORNERS, SIDES)


def signed_distance(shape: Shape, x: Array) -> float:
    """Of a place from a shape, on the host; an independent transcription."""
    y = x - shape.place
    if isinstance(shape, Plane):
        return float(y @ shape.normal)
    if isinstance(shape, Sphere):
        d = float(np.linalg.norm(y)) - shape.radius
        return -d if shape.hollow else d
    if isinstance(shape, Cylinder):
        h = float(y @ shape.axis)
        d = float(np.linalg.norm(y - h * shape.axis)) - shape.radius
        if shape.hollow:
            return -d
        q = np.array([d, abs(h) - 0.5 * shape.length])
    else:
        rounding = shape.rounding if isinstance(shape, Box) else 0.0
        size = shape.size if isinstance(shape, Box) else np.ptp(shape.vertices, axis=0)
        q = np.abs(y) - 0.5 * size + rounding
        return float(np.linalg.norm(np.maximum(q, 0.0)) + min(q.max(), 0.0) - rounding)
    return float(np.linalg.norm(np.maximum(q, 0.0)) + min(q.max(), 0.0))


def _shapes(dim: int) -> dict[str, Shape]:
    o = np.zeros(dim)
    found: dict[str, Shape] = {
        "plane": Plane(o, np.array([0.3, 1.0, 0.2])[:dim]),
        "sphere": Sphere(o, 1.3),
        "hollow sphere": Sphere(o, 2.1, hollow=True),
        "box": Box(o, np.array([2.0, 1.6, 2.4])[:dim]),
        "rounded box": Box(o, np.array([2.0, 1.6, 2.4])[:dim], rounding=0.3),
    }
    if dim == 3:
        found |= {
            "cylinder": Cylinder(o, [0.2, 0.1, 1.0], 1.2),
            "short cylinder": Cylinder(o, [0.2, 1.0, 0.1], 1.1, length=1.4),
            "hollow cylinder": Cylinder(o, [0.2, 0.1, 1.0], 2.0, hollow=True),
            "mesh of a box": box_mesh(o, np.array([2.0, 1.6, 2.4])),
        }
    return found


def _rigid(x: Array, radius: float, shape: Shape, **motion) -> Simulation:
    """One element at a place and a wall."""
    scene = Scene()
    scene.add(ball(x, radius), SOFT)
    scene.contact(friction=motion.pop("friction", 0.0))
    scene.wall(shape, **motion)
    return Simulation(scene, dt=1e-3, force_dt=True)


@case("wall", slow=True)
def distances_of_shapes() -> Iterator[Measurement]:
    """Force on one element at random places of a turned, displaced shape: k times the overlap that
    the host's signed distance gives, along its gradient by central differences."""
    rng = np.random.default_rng(5)
    for dim in (2, 3):
        for name, shape in _shapes(dim).items():
            angle = rng.normal(0.0, 1.0, 1 if dim == 2 else 3)
            turn, way = rotation(angle), rng.normal(0.0, 3.0, dim)
            sim = _rigid(
                np.zeros(dim), 0.5, shape, angle=angle,
                path=lambda _t, way=way, dim=dim: np.append(way, np.zeros(1 if dim == 2 else 3)),
            )  # fmt: skip
            m = sim.model
            assert m.contact_compliance is not None and m.contact_width is not None
            area = m.contact_width[0] if dim == 2 else pi * 0.25
            k = area / m.contact_compliance[0]
            back = turn * np.append(-np.ones(len(turn) - 1), 1.0)
            worst, seen = 0.0, 0

            def distance(x, shape=shape, back=back, way=way):
                return signed_distance(shape, rotated(back, x - way))

            for _ in range(200):
                x = way + rng.normal(0.0, 1.2, dim)
                d = distance(x)
                sim.set_state(displacement=x[None])
                force = -sim.wall_force(sim.scene.walls[0])
                n = np.array([distance(x + e) - distance(x - e) for e in 1e-6 * np.eye(dim)]) / 2e-6
                if abs(np.linalg.norm(n) - 1.0) > 1e-6 or d < 0.0:
                    continue  # on an edge of the normal, or a centre within
                seen += d < 0.5
                error = np.abs(force - k * max(0.5 - d, 0.0) * n).max() / (0.5 * k)
                worst = max(worst, float(error))
            yield Measurement(f"places in touch, {name}, {dim}D", 20, "more", seen,
                              float(seen < 20), 0.0)  # fmt: skip
            yield vanishing(f"force of the {name}, {dim}D", "signed distance", worst, 1e-8)


@case("wall")
def a_mesh_is_the_box_it_makes() -> Iterator[Measurement]:
    """Forces of a box and of its mesh of triangles on elements over its sides."""
    rng = np.random.default_rng(1)
    size = np.array([2.0, 1.6, 2.4])
    sims = [
        _rigid(np.zeros(3), 0.5, shape)
        for shape in (Box(np.zeros(3), size), box_mesh(np.zeros(3), size))
    ]
    worst = largest = 0.0
    for _ in range(200):
        axis = rng.integers(0, 3)
        x = rng.uniform(-0.5, 0.5, 3) * size
        x[axis] = np.sign(x[axis]) * (0.5 * size[axis] + rng.uniform(0.1, 0.5))
        forces = []
        for sim in sims:
            sim.set_state(displacement=x[None])
            forces.append(sim.wall_force(sim.scene.walls[0]))
        worst = max(worst, float(np.abs(forces[0] - forces[1]).max()))
        largest = max(largest, float(np.abs(forces[0]).max()))
    yield vanishing("difference over the largest", "the box", worst / largest, 1e-14)


@case("wall", slow=True)
def elements_fall_onto_walls() -> Iterator[Measurement]:
    """An element falls onto every shape, fixed or turning as it moves, and leaves: energy, with the
    walls' work. Friction's books are of second order: with it dt is a tenth of its limit."""
    motions: dict[str, dict] = {
        "fixed": {},
        "moving": {"velocity": [0.003, 0.01, -0.002], "spin": [0.004, 0.02, 0.01]},
    }
    for dim in (2, 3):
        for name, shape in _shapes(dim).items():
            for how, motion in motions.items():
                for friction, share, limit in ((0.0, 0.8, 1e-6), (0.3, 0.1, 1e-4)):
                    if friction and how == "fixed":
                        continue
                    given = {
                        x: np.array(v)[: dim if x == "velocity" or dim == 3 else 1]
                        for x, v in motion.items()
                    }
                    sim, largest, left = _fall(shape, given, friction, share)
                    where = f"{how} {name}, friction {friction}, {dim}D"
                    yield Measurement(f"touched and left, {where}", 20, "it bounces",
                                      left, float(left < 20), 0.0)  # fmt: skip
                    error = abs(sim.energy()["residual"]) / largest
                    yield vanishing(f"energy missing, {where}", "conserved", error, limit)


def _fall(shape: Shape, motion: dict, friction: float, share: float) -> tuple:
    """Simulation of an element that falls onto a wall, the most kinetic energy seen, and steps
    since they parted; share: of the greatest time step."""
    dim = len(shape.place)
    hollow = getattr(shape, "hollow", False)
    start = np.array([0.2, 0.1, 0.15] if hollow else [0.3, 2.3, 0.25])[:dim]
    scene = Scene()
    body = scene.add(ball(start, 0.5), SOFT)
    scene.contact(friction=friction)
    wall = scene.wall(shape, **motion)
    scene.set_velocity(body, np.array([0.001, -0.02, 0.002])[:dim])
    scene.set_gravity(-1e-4 * np.eye(dim)[1])
    limit = Simulation(scene).dt_limit
    sim = Simulation(scene, dt=share * limit)
    largest, touched, left = 0.0, False, 0
    while left < 20 and sim.steps < 20000:
        sim.run(steps=1)
        presses = bool(sim.wall_force(wall).any())
        touched |= presses
        left = left + 1 if touched and not presses else 0
        largest = max(largest, float(0.5 * sim.model.mass @ (sim.velocity**2).sum(axis=1)))
    return sim, largest, left


@case("wall")
def forces_and_torques_balance() -> Iterator[Measurement]:
    """A body pressed and rubbed by a turning wall: what the wall feels, and what elements feel."""
    for dim in (2, 3):
        p = packing.voronoi((4.0, 3.0, 3.0)[:dim], 1.0, "strain" if dim == 2 else None, seed=1)
        scene = Scene()
        body = scene.add(p, SOFT)
        scene.hold(body, p.position[:, 1] < p.position[:, 1].min() + 0.5)
        scene.contact(friction=0.4)
        centre = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
        top = p.position[:, 1].max()
        centre[1] = top + 3.6
        spin = [0.02] if dim == 2 else [0.01, 0.003, 0.02]
        wall = scene.wall(Sphere(centre, 3.0), velocity=-0.005 * np.eye(dim)[1], spin=spin)
        sim = Simulation(scene)
        while not sim.wall_force(wall).any():
            sim.run(steps=5)
        sim.run(steps=40)
        step, n, slots = sim._step, sim.model.elements, sim.model.features.slots
        force = step.download("end_force").reshape(slots, n, dim)[-1]
        torque = step.download("end_torque").reshape(slots, n, -1)[-1]
        assert not len(sim.contacts)
        place = sim.wall_pose(wall)[0]
        size = np.abs(force).sum()
        error = np.abs(force.sum(axis=0) + sim.wall_force(wall)).max() / size
        yield vanishing(f"net force, {dim}D", "Newton", float(error), 1e-14)
        about = np.cross(sim.position - place, force).reshape(n, -1) + torque
        error = np.abs(about.sum(axis=0) + sim.wall_torque(wall)).max() / (3.0 * size)
        yield vanishing(f"net torque, {dim}D", "Newton", float(error), 1e-14)
        turns = float(np.abs(sim.wall_torque(wall)).max() / size)
        yield Measurement(
            f"torque on the wall, {dim}D", 0.0, "some", turns, float(not turns > 1e-3), 0.0
        )


@case("wall")
def a_turning_drum_drags() -> Iterator[Measurement]:
    """An element that cannot turn is pressed on a turning drum: accelerated by mu N while it
    slips. A free one is spun up by mu N R/J."""
    mu, pressed = 0.3, 1e-4
    for dim in (2, 3):
        for turns in (False, True):
            scene = Scene()
            # overlap at which the drum's spring holds the load
            x = np.zeros(dim)
            body = scene.add(ball(x, 0.5), SOFT)
            scene.hold(body, [0], axes="x" if turns else "", rotation=not turns)
            scene.contact(friction=mu)
            spin = np.array([1.0]) if dim == 2 else np.array([0.0, 0.0, 1.0])
            drum: Shape = Sphere([0.0, -1000.5], 1000.0)
            if dim == 3:
                drum = Cylinder([0.0, -1000.5, 0.0], [0.0, 0.0, 1.0], 1000.0)
            wall = scene.wall(drum, spin=-1e-3 * spin)
            scene.load(body, [0], force=-pressed * np.eye(dim)[1])
            sim = Simulation(scene)
            m = sim.model
            assert m.contact_compliance is not None and m.contact_width is not None
            k = (m.contact_width[0] if dim == 2 else 0.25 * pi) / m.contact_compliance[0]
            sim.set_state(displacement=-pressed / k * np.eye(dim)[1:2])
            sim.run(steps=200)
            time, v, w = sim.time, sim.velocity[0, 0], sim.angular_velocity[0, -1]
            sim.run(steps=400)
            passed = sim.time - time
            if turns:
                found = (sim.angular_velocity[0, -1] - w) / passed
                # the force acts at the drum's surface, nearer than R by the overlap
                wanted = mu * pressed * (0.5 - pressed / k) / m.inertia[0]
            else:
                found = (sim.velocity[0, 0] - v) / passed
                wanted = mu * pressed / m.mass[0]
            what = "spin up" if turns else "acceleration"
            error = abs(abs(found) / wanted - 1.0)
            yield Measurement(f"{what}, {dim}D", wanted, "mu N", abs(found), error, 1e-3)
            torque = abs(float(sim.wall_torque(wall)[-1]))
            error = abs(torque / (1000.0 * mu * pressed) - 1.0)
            yield Measurement(f"torque on the drum over mu N times its radius, {what}, {dim}D", 1,
                              "closed", torque / (1000.0 * mu * pressed), error, 1e-3)  # fmt: skip


@case("wall")
def steered_walls_press() -> Iterator[Measurement]:
    """A steered plate presses a block with the force that was asked for."""
    material = Material(1.0, 0.25, 1.0)
    for dim in (2, 3):
        p = (
            packing.square((8.0, 8.0), 1.0, "strain")
            if dim == 2
            else packing.simple_cubic((4.0,) * 3, 1.0)
        )
        scene = Scene()
        body = scene.add(p, material, facet_bending=True)
        scene.hold(body, p.position[:, 1] < p.position[:, 1].min() + 0.1, axes="y", rotation=False)
        scene.contact()
        top = p.position[:, 1].max() + 0.5
        plate = scene.wall(top * np.eye(dim)[1], -np.eye(dim)[1])
        wanted = 1e-3 * (8.0 if dim == 2 else 16.0)
        scene.steer(plate, force=wanted, direction=-np.eye(dim)[1], speed=0.01)
        sim = Simulation(scene, local_damping=0.7)
        sim.run(steps=4000)
        force = float(sim.wall_force(plate)[1])
        error = abs(force / wanted - 1.0)
        yield Measurement(f"force held, {dim}D", wanted, "asked for", force, error, 1e-4)


def _pressed(p: Packing, tool: Shape, poisson: float) -> tuple[Array, Array, float]:
    """A block at rest under a smooth rigid tool: places across it and forces [N] of the elements
    that the tool presses, and the force on the tool."""
    scene = Scene()
    body = scene.add(p, Material(1.0, poisson, 1.0), facet_bending=True)
    scene.hold(body, p.position[:, -1] < p.position[:, -1].min() + 0.1)
    scene.contact()
    wall = scene.wall(tool)
    sim = Simulation(scene)
    sim.relax(tolerance=1e-4)
    force = -sim._step.download("wall_reaction")[0][:, -1]
    assert sim.model.contact_elements is not None
    pressed = force < 0.0
    place = sim.position[sim.model.contact_elements[pressed]] - tool.place
    return place[:, :-1], -force[pressed], float(sim.wall_force(wall)[-1])


def _ellipse(x: Array, pressure: Array) -> tuple[float, float]:
    """Peak and half-width of p = p0 sqrt(1 - x^2/a^2), fitted to p^2 within 0.8 of its reach."""
    r2 = (x**2).sum(axis=1)
    inner = r2 < 0.64 * r2.max()
    slope, peak = np.polyfit(r2[inner], pressure[inner] ** 2, 1)
    return float(np.sqrt(peak)), float(np.sqrt(-peak / slope))


@case("wall")
def hertz_contact_of_a_line() -> Iterator[Measurement]:
    """A rigid smooth cylinder on a block, plane strain: the greatest pressure and half the width,
    p0 = sqrt(P E*/(pi R)), a = sqrt(4 P R/(pi E*)), of the load P that is found. R is the tool's
    radius and that of the elements, whose surfaces it meets."""
    for poisson in (0.0, 0.3):
        for wide, depth in ((60, 30), (100, 50)):
            p = packing.square((float(wide), float(depth)), 1.0, "strain")
            radius = 2.0 * wide
            top = p.position[:, 1].max() + 0.5
            middle = 0.5 * (p.position[:, 0].min() + p.position[:, 0].max())
            tool = Sphere([middle, top + radius - 0.004 * wide], radius)
            x, force, total = _pressed(p, tool, poisson)
            modulus = 1.0 / (1.0 - poisson**2)
            peak, half = _ellipse(x, force)
            whole = radius + 0.5
            for what, found, wanted in (
                ("pressure", peak, np.sqrt(total * modulus / (pi * whole))),
                ("half-width", half, np.sqrt(4.0 * total * whole / (pi * modulus))),
            ):
                yield Measurement(
                    f"{what}, {len(x)} elements wide, Poisson's ratio {poisson}", wanted, "Hertz",
                    found, abs(found / wanted - 1.0), 0.04,
                )  # fmt: skip


@case("wall")
def hertz_contact_of_a_sphere() -> Iterator[Measurement]:
    """A rigid smooth sphere on a block: p0 = (6 P E*^2/(pi^3 R^2))^(1/3), a = (3 P R/(4 E*))^(1/3)
    of the load P that is found. The error falls with the size of elements: 28, 36 and 44 of them
    across the block give 4.2, 3.4 and 2.9 % in the pressure."""
    yield from _sphere_on_block(36, 20)


@case("wall", slow=True)
def hertz_contact_of_a_sphere_refined() -> Iterator[Measurement]:
    """The same with smaller elements."""
    yield from _sphere_on_block(44, 24)


def _sphere_on_block(wide: int, depth: int) -> Iterator[Measurement]:
    p = packing.simple_cubic((float(wide), float(wide), float(depth)), 1.0)
    poisson, radius = 0.3, 3.0 * wide
    top = p.position.max(axis=0)[2] + 0.5
    middle = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
    tool = Sphere([middle[0], middle[1], top + radius - 0.011 * wide], radius)
    x, force, total = _pressed(p, tool, poisson)
    modulus, whole = 1.0 / (1.0 - poisson**2), radius + 0.5
    peak, half = _ellipse(x, force)
    for what, found, wanted in (
        ("pressure", peak, (6.0 * total * modulus**2 / (pi**3 * whole**2)) ** (1.0 / 3.0)),
        ("radius of contact", half, (0.75 * total * whole / modulus) ** (1.0 / 3.0)),
    ):
        error = abs(found / wanted - 1.0)
        yield Measurement(f"{what}, {len(x)} elements", wanted, "Hertz", found, error, 0.04)


@case("wall", slow=True)
def hertz_collision_of_two_spheres() -> Iterator[Measurement]:
    """Unlike elements, and an element and a wall, meet head on by Hertz's law: greatest overlap
    (15 m v^2/(16 E* sqrt(R)))^(2/5) and duration 2.94326 times that over v (Johnson 1985, 11.4)."""
    from scipy.special import beta

    stretch = 2.0 * 0.4 * beta(0.4, 0.5)  # 2 int dx/sqrt(1 - x^(5/2))
    stiff, soft, v = Material(1.0, 0.3, 1.0), Material(0.4, 0.1, 2.0), 1e-3
    for other in ("an element", "a wall"):
        scene = Scene()
        body = scene.add(ball(np.zeros(3), 0.5), stiff)
        scene.contact(law="hertz")
        if other == "a wall":
            scene.wall([0.51, 0.0, 0.0], [-1.0, 0.0, 0.0])
        else:
            scene.add(ball(np.array([0.86, 0.0, 0.0]), 0.35), soft)
        scene.set_velocity(body, [v, 0.0, 0.0])
        sim = Simulation(scene, dt=0.005)
        mass, compliance, radius, way = sim.model.mass, 1.0 - 0.3**2, 0.5, 0.01
        reduced = mass[0]
        if other == "an element":
            reduced = mass[0] * mass[1] / mass.sum()
            compliance += (1.0 - 0.1**2) / 0.4
            radius = 0.5 * 0.35 / 0.85
        held = sim.energy()["kinetic"]
        overlap, now, touched = 0.0, 0.0, 0
        while sim.time < 30.0 or now > 0.0:
            sim.run(steps=1)
            apart = sim.displacement[0, 0] - (sim.displacement[1, 0] if len(mass) > 1 else 0.0)
            now = float(apart - way)
            overlap, touched = max(overlap, now), touched + (now > 0.0)
        deep = (15.0 * reduced * v**2 * compliance / (16.0 * np.sqrt(radius))) ** 0.4
        yield Measurement(f"greatest overlap with {other}", deep, "Hertz", overlap,
                          abs(overlap / deep - 1.0), 1e-3)  # fmt: skip
        lasts = stretch * deep / v
        found = touched * sim.dt
        yield Measurement(f"duration with {other}", lasts, "Hertz", found,
                          abs(found / lasts - 1.0), 1e-3)  # fmt: skip
        error = abs(sim.energy()["residual"]) / held
        yield vanishing(f"energy missing with {other}", "conserved", error, 1e-9)

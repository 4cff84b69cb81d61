"""Elements that touch without a bond, friction and walls (theory B11, C5)."""

from collections.abc import Iterator
from math import pi

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from .. import packing
from ..bond import EVMBond
from ..errors import Array
from ..material import Material
from ..packing import Packing
from ..scene import Scene
from ..simulation import Simulation
from .case import Measurement, case
from .core import vanishing

SOFT = Material(1.0, 0.3, 1.0)
MU = 0.4  # friction


def ball(place: Array, radius: float) -> Packing:
    """One element of the plane or of space, without bonds."""
    dim = len(place)
    volume = pi * radius**2 if dim == 2 else 4.0 / 3.0 * pi * radius**3
    return Packing(
        np.array([place], dtype=float),
        np.array([volume]),
        np.zeros((0, 2), dtype=np.int64),
        plane="strain" if dim == 2 else None,
        area=np.zeros(0),
        arms=np.zeros((0, 2, dim)),
    )


def balls(place: Array, radius: Array) -> Packing:
    """Elements of which bonds of no concern join the first two, as a body needs one."""
    dim = place.shape[1]
    volume = pi * radius**2 if dim == 2 else 4.0 / 3.0 * pi * radius**3
    return Packing(
        place, volume, np.array([[0, 1]]), radius=radius, plane="strain" if dim == 2 else None
    )


def momenta(sim: Simulation) -> tuple[Array, Array, float, float]:
    """Momentum and angular momentum of all elements, and sums of the sizes they are made of."""
    m, j = sim.model.mass, sim.model.inertia
    p = m[:, None] * sim.velocity
    spin = j[:, None] * sim.angular_velocity
    orbit = np.cross(sim.position, p).reshape(len(p), -1)
    return p.sum(axis=0), (orbit + spin).sum(axis=0), np.abs(p).sum(), np.abs(orbit).sum()


@case("contact")
def neighbour_lists() -> Iterator[Measurement]:
    """The list of neighbours against a tree search on the host: pairs in one and not the other."""
    rng = np.random.default_rng(3)
    for dim in (2, 3):
        sets = {
            "random": rng.uniform(0.0, 12.0, (400, dim)),
            "clustered": rng.normal(0.0, 0.6, (300, dim)) + 40.0 * rng.integers(0, 3, (300, dim)),
            "far from the origin": rng.uniform(0.0, 9.0, (300, dim)) + 1e6,
            "on a line": np.linspace(0.0, 300.0, 400)[:, None] * np.eye(dim)[0],
        }
        for name, x in sets.items():
            radius = rng.uniform(0.1, 0.5, len(x))
            scene = Scene()
            bond = EVMBond(1.0, 1.0, 1.0, 1.0)
            scene.add(balls(x, radius), SOFT, bond=bond)
            scene.contact(skin=0.3)
            sim = Simulation(scene, dt=1e-6, force_dt=True)
            for moved in (False, True):  # as it starts, and where elements have gone elsewhere
                if moved:
                    u = rng.normal(0.0, 1.0, x.shape)
                    sim.set_state(displacement=u)
                assert sim.model.contact_radius is not None
                reach = sim.model.contact_radius
                near = sim._step.neighbours
                assert near is not None
                place = sim.position - x[0]
                i, j = cKDTree(place).query_pairs(2.0, output_type="ndarray").T
                apart = np.linalg.norm(place[j] - place[i], axis=1)
                listed = apart <= reach[i] + reach[j] + near.skin
                wanted = {(a, b) for a, b in zip(i[listed], j[listed], strict=True)}
                wanted -= {(0, 1)}
                found = {(a, b) for a, b in near.pairs()}
                where = f"{name}, {dim}D" + (", moved" if moved else "")
                yield Measurement(
                    f"listed pairs, {where}", len(wanted), "tree search", len(found),
                    len(wanted ^ found), 0.0,
                )  # fmt: skip
                double = len(near.pairs()) - len(found)
                yield vanishing(f"pairs listed twice, {where}", "tree search", double, 0.0)


@case("contact", slow=True)
def two_elements_collide() -> Iterator[Measurement]:
    """Two elements meet obliquely: momentum, energy, the speed along the normal they part at."""
    for dim in (2, 3):
        for precision, limit in (("float64", 1e-12), ("mixed", 1e-5), ("float32", 1e-4)):
            for restitution in (1.0, 0.7, 0.0):
                scene = Scene()
                one = scene.add(ball(np.zeros(dim), 0.5), SOFT)
                offset = np.array([1.05, 0.3, -0.2])[:dim]
                scene.add(ball(offset, 0.4), SOFT)
                scene.set_velocity(one, np.array([5e-3, 1e-3, 0.0])[:dim])
                scene.contact(restitution=restitution)
                sim = Simulation(scene, precision=precision)
                before = momenta(sim)
                held = sim.energy()["kinetic"]
                v = sim.velocity
                while not len(sim.contacts) and sim.time < 1e4:
                    sim.run(steps=1)
                while len(sim.contacts):
                    sim.run(steps=1)
                after = momenta(sim)
                where = f"{dim}D, {precision}, restitution {restitution}"
                error = np.abs(after[0] - before[0]).max() / before[2]
                yield vanishing(
                    f"momentum, {where}", "Newton", error, 1e-14 if limit < 1e-6 else 1e-6
                )
                # the impulse is along the normal at which they touch, as nothing rubs
                kick = sim.velocity - v
                n = kick[1] / np.linalg.norm(kick[1])
                closing = float((v[0] - v[1]) @ n)
                parting = float((sim.velocity[1] - sim.velocity[0]) @ n)
                yield Measurement(
                    f"speed along the kick after over before, {where}", restitution,
                    "as set", parting / closing, abs(parting / closing - restitution),
                    1e-3 if restitution < 1.0 else limit * 10,
                )  # fmt: skip
                ledger = sim.energy()
                error = abs(ledger["residual"]) / held
                yield vanishing(f"energy missing, {where}", "conserved", error, limit)


@case("contact", slow=True)
def dashpots_give_restitution() -> Iterator[Measurement]:
    """Unlike elements, and an element and a wall, meet head on with dashpots of a restitution, at a
    tenth of the greatest time step: its error falls with the square of that."""
    stiff, soft, v = Material(1.0, 0.3, 1.0), Material(0.4, 0.1, 2.0), 1e-3
    for law, other, dim in (
        ("linear", "a wall", 2), ("linear", "an element", 3),
        ("hertz", "a wall", 3), ("hertz", "an element", 3),
    ):  # fmt: skip
        for restitution in (0.2, 0.5, 0.8, 0.95):
            scene = Scene()
            x = np.eye(dim)[0]
            one = scene.add(ball(np.zeros(dim), 0.5), stiff)
            scene.contact(law=law, restitution=restitution, restitution_by="dashpot")
            if other == "a wall":
                scene.wall(0.502 * x, -x)
            else:
                scene.add(ball(0.852 * x, 0.35), soft)
            scene.set_velocity(one, v * x)
            sim = Simulation(scene, dt=0.1 * Simulation(scene).dt_limit)
            before, held = momenta(sim), sim.energy()["kinetic"]
            touched = False
            while (not touched or sim.force.any()) and sim.time < 1e5:
                sim.run(steps=4)
                touched |= bool(sim.force.any())
            sim.run(until=sim.time + 0.02 / v)  # the force ends before the overlap does
            u = sim.velocity[:, 0]
            found = float(u[1] - u[0] if len(u) > 1 else -u[0]) / v
            where = f"{law}, {other}, {dim}D"
            yield Measurement(
                f"speed after over before, {where}", restitution, "as set", found,
                abs(found - restitution), 1e-3,
            )  # fmt: skip
            ledger = sim.energy()
            where += f", restitution {restitution}"
            missing = abs(ledger["residual"]) / held
            yield vanishing(f"energy missing, {where}", "conserved", missing, 1e-12)
            if len(u) > 1:
                error = np.abs(momenta(sim)[0] - before[0]).max() / before[2]
                yield vanishing(f"momentum, {where}", "Newton", error, 1e-14)


@case("contact")
def two_bodies_collide() -> Iterator[Measurement]:
    """Two elastic bodies meet obliquely, at 5e-4 of the speed of sound."""
    shapes = {
        "hexagonal": packing.hexagonal((6.0, 5.0), 1.0, "strain"),
        "Voronoi": packing.voronoi((6.0, 5.0), 1.0, "stress", seed=2),
        "Voronoi in space": packing.voronoi((3.5, 3.5, 3.5), 1.0, seed=1),
    }
    speed = 5e-4
    for (name, p), friction in zip(
        [*shapes.items(), *shapes.items()], [0.0] * 3 + [0.4] * 3, strict=True
    ):
        scene = Scene()
        scene.add(p, SOFT)
        other = scene.add(p, SOFT)
        wide = p.position[:, 0].max() - p.position[:, 0].min() + 1.02
        other.displacement[:] = np.array([wide, 1.3, 0.6])[: p.dim]
        scene.set_velocity(other, -speed * np.array([1.0, 0.2, 0.1])[: p.dim])
        scene.contact(friction=friction)
        sim = Simulation(scene)
        before, held = momenta(sim), sim.energy()["kinetic"]
        touched = 0
        for _ in range(150):
            sim.run(until=sim.time + 8.0)
            touched += len(sim.contacts)
        after = momenta(sim)
        where = f"{name}, friction {friction}"
        yield Measurement(
            f"touching pairs seen, {where}", 1, "they meet", touched, float(touched == 0), 0.0
        )
        error = np.abs(after[0] - before[0]).max() / before[2]
        yield vanishing(f"momentum, {where}", "Newton", error, 1e-13)
        error = np.abs(after[1] - before[1]).max() / before[3]
        yield vanishing(f"angular momentum, {where}", "Newton", error, 1e-12)
        error = abs(sim.energy()["residual"]) / held
        yield vanishing(f"energy missing, {where}", "conserved", error, 1e-6)
        if friction:
            slipped = sim.energy()["friction"]
            yield Measurement(
                f"energy that slip took, {where}", 0.0, "positive", slipped,
                float(slipped <= 0.0), 0.0,
            )  # fmt: skip


def turned_once(sim: Simulation, name: str, spring: Array, omega: Array, steps: int) -> float:
    """Elements turn rigidly once, at omega [1/s], with a spring in an array of their contacts or
    faces: how far that comes off the turned one on the way, over its length."""
    step, start = sim._step, sim.position
    n, dim = start.shape
    wide = np.zeros((n, 3))
    wide[:, :dim] = start
    last, worst = start, 0.0
    for k in range(1, steps + 1):
        turn = Rotation.from_rotvec(2.0 * pi * k / steps * omega)
        now, q = turn.apply(wide)[:, :dim], turn.as_quat()
        step.upload("displacement", now - sim.model.position)
        step.upload("velocity", (now - last) / sim.dt)
        step.upload("angular_velocity", np.tile(omega if dim == 3 else omega[2:], (n, 1)))
        step.upload("orientation", np.tile(q if dim == 3 else q[2:], (n, 1)))
        step._touch(moves=True)
        if name.startswith("closing"):
            step._evaluate.launch()
        last, found = now, step.arrays[name].numpy()[: len(spring)]
        worst = max(worst, float(np.abs(found - turn.apply(_wide(spring))[: len(spring)]).max()))
    return worst / float(np.linalg.norm(spring))


def _wide(vector: Array) -> Array:
    return np.append(vector, np.zeros(3 - len(vector)))


def _block(slope: float) -> tuple[Simulation, float]:
    """A block on a wall, under gravity that is turned by a slope. Dashpots beside its bonds calm
    what friction rouses in it, and take no momentum."""
    p = packing.hexagonal((9.0, 3.5), 1.0, "strain")
    scene = Scene()
    scene.add(p, SOFT, bond=EVMBond(1.0, 0.4, 0.1, 0.1, damping=0.5))
    scene.contact(friction=MU)
    scene.wall([0.0, p.position[:, 1].min() - 0.5], [0.0, 1.0])
    g = 1e-4
    scene.set_gravity([g * np.sin(slope), -g * np.cos(slope)])
    return Simulation(scene), g


def _rider(slope: float, dim: int, calm: float = 0.0) -> tuple[Simulation, float]:
    """An element that does not turn, at rest on a wall across it."""
    scene = Scene()
    body = scene.add(ball(np.zeros(dim), 0.5), SOFT)
    scene.hold(body, [0], axes="", rotation=True)
    scene.contact(friction=MU)
    up = np.eye(dim)[1]
    scene.wall(-0.5 * up, up)
    g = 1e-4
    fall = np.zeros(dim)
    fall[:2] = g * np.sin(slope), -g * np.cos(slope)
    scene.set_gravity(fall)
    sim = Simulation(scene, local_damping=calm)
    model = sim.model
    assert model.contact_compliance is not None and model.contact_width is not None
    area = 2.0 * 0.5 * model.contact_width[0] if dim == 2 else pi * 0.25
    sag = model.mass[0] * g * np.cos(slope) * model.contact_compliance[0] / area
    sim.set_state(displacement=[-sag * up])
    return sim, g


@case("contact")
def unlike_materials_touch() -> Iterator[Measurement]:
    """Pressed pairs of unlike materials: S/(R_a/M_a + R_b/M_b) times the overlap, Hertz's
    4/3 E* sqrt(R) times its power 3/2, and the tangential spring S/(R_a/2G_a + R_b/2G_b)."""
    hard, soft = Material(3.0, 0.3, 1.0), Material(0.5, 0.1, 2.0)
    ra, rb, overlap, way = 0.5, 0.3, 1e-3, 1e-4
    radius = 2.0 * ra * rb / (ra + rb)

    def pressing(m: Material) -> float:
        """E (1 - nu)/((1 + nu) (1 - 2 nu))."""
        return m.young * (1.0 - m.poisson) / ((1.0 + m.poisson) * (1.0 - 2.0 * m.poisson))

    for law, dim in (("linear", 2), ("linear", 3), ("hertz", 3)):
        scene = Scene()
        x = np.eye(dim)
        for place, r, m in ((0.0 * x[0], ra, hard), ((ra + rb - overlap) * x[0], rb, soft)):
            scene.hold(scene.add(ball(place, r), m), [0])
        scene.contact(friction=50.0, law=law)
        sim = Simulation(scene, dt=0.01)
        area = 2.0 * radius if dim == 2 else pi * radius**2
        wanted = area * overlap / (ra / pressing(hard) + rb / pressing(soft))
        if law == "hertz":
            give = (1.0 - hard.poisson**2) / hard.young + (1.0 - soft.poisson**2) / soft.young
            wanted = 4.0 / 3.0 / give * np.sqrt(0.5 * radius) * overlap**1.5
        found = float(sim.force[1, 0])
        error = abs(found / wanted - 1.0)
        yield Measurement(f"force, {law}, {dim}D", wanted, "in series", found, error, 1e-12)
        scene.hold(scene.bodies[1], [0], velocity=way * x[1])
        sim = Simulation(scene, dt=0.01)
        sim.run(steps=100)
        give = sum(r * (1.0 + m.poisson) / m.young for r, m in ((ra, hard), (rb, soft)))
        wanted = area / give * way * sim.time
        f, n = sim.force[1], sim.position[1] - sim.position[0]
        found = float(np.linalg.norm(f - (f @ n) / (n @ n) * n))
        error = abs(found / wanted - 1.0)
        yield Measurement(f"force along, {law}, {dim}D", wanted, "in series", found, error, 1e-3)


@case("contact")
def friction_of_material_pairs() -> Iterator[Measurement]:
    """Elements of unlike materials slide on a wall, and on held ones, each by its own number."""
    one, other, third = SOFT, Material(2.0, 0.2, 1.5), Material(0.7, 0.3, 1.0)
    g, speed = 1e-4, 0.02
    for dim in (2, 3):
        up, along = np.eye(dim)[1], np.eye(dim)[0]
        scene = Scene()
        bodies = [
            scene.add(ball(10.0 * n * along, 0.5), m) for n, m in enumerate((one, other, third))
        ]
        for body in bodies:
            scene.hold(body, [0], axes="", rotation=True)
            scene.set_velocity(body, speed * along)
        scene.contact(friction=0.1)
        scene.wall(-0.5 * up, up, friction={one: 0.2, other: 0.4})
        scene.set_gravity(-g * up)
        # seated, so that the force is the weight
        for body, m in zip(bodies, (one, other, third), strict=True):
            area = 1.0 if dim == 2 else pi * 0.25
            modulus = m.lame("strain" if dim == 2 else None) + 2.0 * m.shear_modulus
            weight = float(body.packing.volume[0]) * m.density * g
            body.displacement[:] = -weight * 0.5 / modulus / area * up
        sim = Simulation(scene, dt=0.1)
        sim.run(until=20.0)
        v, time = sim.velocity[:, 0].copy(), sim.time
        sim.run(until=100.0)
        slowing = (v - sim.velocity[:, 0]) / (sim.time - time) / g
        for mu, found, name in zip((0.2, 0.4, 0.1), slowing, ("a", "b", "c"), strict=True):
            yield Measurement(
                f"slowing down over g, {name} on the wall, {dim}D", mu, "mu", found,
                abs(found / mu - 1.0), 1e-3,
            )  # fmt: skip
        scene = Scene()
        x = (0.0 * along, 0.99 * along, 5.0 * along, 5.99 * along)
        for n, (place, m) in enumerate(zip(x, (one, other, one, one), strict=True)):
            body = scene.add(ball(place, 0.5), m)
            scene.hold(body, [0], velocity=1e-3 * (n % 2) * up)
        scene.contact(friction=0.1, pairs={(other, one): 0.5})
        sim = Simulation(scene, dt=0.1)
        sim.run(until=20.0)
        f, centre = sim.force, sim.position
        for first, mu, name in ((0, 0.5, "a on b"), (2, 0.1, "a on a")):
            n = centre[first + 1] - centre[first]
            n /= np.linalg.norm(n)
            pressed = float(f[first] @ n)
            rubbed = float(np.linalg.norm(f[first] - pressed * n))
            found = rubbed / abs(pressed)
            yield Measurement(
                f"force along over across, {name}, {dim}D", mu, "mu", found, abs(found - mu), 1e-12
            )


@case("contact")
def sliders_stop() -> Iterator[Measurement]:
    """Friction on a wall stops an element, and a block: v^2/(2 mu g)."""
    speed = 0.02
    for name in ("element, 2D", "element, 3D", "block"):
        is_block = name == "block"
        sim, g = _block(0.0) if is_block else _rider(0.0, 2 if "2D" in name else 3)
        if is_block:
            sim.relax(tolerance=1e-8)
        weight = sim.model.mass.sum() * g
        pressed = -float(sim.wall_force(sim.scene.walls[0])[1])
        error = abs(pressed / weight - 1.0)
        yield Measurement(
            f"force on the wall over weight, {name}", 1, "rest", pressed / weight, error, 1e-6
        )
        v = np.zeros_like(sim.velocity)
        v[:, 0] = speed
        sim.set_state(velocity=v)
        share = sim.model.mass / sim.model.mass.sum()
        start = share @ sim.position[:, 0]
        way = speed**2 / (2.0 * MU * g)
        sim.run(until=1.1 * speed / (MU * g))
        gone = float(share @ sim.position[:, 0] - start)
        yield Measurement(
            f"way of the {name}", way, "v^2/(2 mu g)", gone, abs(gone / way - 1.0), 1e-3
        )
        ledger = sim.energy()
        held = 0.5 * sim.model.mass.sum() * speed**2
        missing = ledger["residual"] / held
        yield vanishing(f"energy missing, {name}", "conserved", missing, 1e-4)


def _stuck(name: str, share: float, steps: int) -> Iterator[Measurement]:
    """Creep between the halves of a rest of so many steps, after coming to it."""
    slope = np.arctan(share * MU)
    dim = 3 if "3D" in name else 2
    sim, g = _block(slope) if name == "block" else _rider(slope, dim, calm=0.7)
    sim.run(steps=6000)  # to rest, on springs that friction holds
    slipped = sim.energy()["friction"]
    place: list[Array] = []
    for _ in range(40):
        sim.run(steps=steps // 40)
        place.append(sim.position.mean(axis=0))
    early, late = np.mean(place[:20], axis=0), np.mean(place[20:], axis=0)
    size = sim.model.mass.sum() * g * np.sin(slope) / float(_shear_of_wall(sim))
    creep = np.abs(late - early).max() / size
    where = f"{name}, {share} of mu, {steps} steps"
    yield vanishing(f"creep over elastic give, {where}", "stick", creep, 1e-3)
    taken = sim.energy()["friction"] - slipped
    yield vanishing(f"taken by slip, {where}", "stick", taken, 1e-15)


@case("contact", slow=True)
def sliders_stick_for_long() -> Iterator[Measurement]:
    """Below the angle of friction nothing creeps in a million steps."""
    for name in ("element, 2D", "element, 3D", "block"):
        yield from _stuck(name, 0.8, 1_000_000)


@case("contact", slow=True)
def sliders_stick() -> Iterator[Measurement]:
    """Below the angle of friction an element and a block do not creep; above it they slide."""
    for name in ("element, 2D", "element, 3D", "block"):
        dim = 3 if "3D" in name else 2
        for share in (0.3, 0.8):
            yield from _stuck(name, share, 8000)
        slope = np.arctan(1.5 * MU)
        sim, g = _block(slope) if name == "block" else _rider(slope, dim)
        sim.run(steps=3000)
        mass = sim.model.mass / sim.model.mass.sum()
        v, time = mass @ sim.velocity[:, 0], sim.time
        sim.run(steps=3000)
        found = float(mass @ sim.velocity[:, 0] - v) / (sim.time - time)
        wanted = g * (np.sin(slope) - MU * np.cos(slope))
        what = f"acceleration beyond the angle of friction, {name}"
        error = abs(found / wanted - 1.0)
        yield Measurement(what, wanted, "g (sin - mu cos)", found, error, 1e-3)


def _shear_of_wall(sim: Simulation) -> float:
    """Tangential stiffness of all elements that touch the wall [N/m]."""
    m = sim.model
    assert m.contact_shear is not None and m.contact_radius is not None
    assert m.contact_width is not None
    low = m.position[:, 1] < m.position[:, 1].min() + 1e-6
    r = m.contact_radius
    area = 2.0 * r * m.contact_width if m.features.dim == 2 else pi * r**2
    return float((area / m.contact_shear)[low].sum())


@case("contact")
def fragments_fly_freely() -> Iterator[Measurement]:
    """Loose elements that fly apart with the search on: momentum, and the same bits again."""

    def flying() -> Simulation:
        p = packing.hexagonal((5.0, 4.0), 1.0, "strain")
        scene = Scene()
        body = scene.add(p, SOFT)
        body.linked[:] = False  # every element on its own
        rng = np.random.default_rng(1)
        centre = p.position.mean(axis=0)
        scene.set_velocity(body, 0.02 * (p.position - centre) + 1e-3 * rng.normal(size=(len(p), 2)))
        scene.contact(friction=0.3)
        return Simulation(scene)

    one, two = flying(), flying()
    before = momenta(one)
    worst = 0.0
    for _ in range(100):
        one.run(steps=10)
        worst = max(worst, np.abs(momenta(one)[0] - before[0]).max() / before[2])
    yield vanishing("momentum over 1000 steps", "Newton", worst, 1e-12)
    two.run(steps=1000)
    differs = int((one.displacement != two.displacement).sum())
    near = one._step.neighbours
    assert near is not None
    yield Measurement("lists built", 2, "they fly apart", near.builds, float(near.builds < 2), 0.0)
    yield vanishing("numbers that differ, run at once or in parts", "same bits", differs, 0.0)


@case("contact")
def parted_pairs_meet_again() -> Iterator[Measurement]:
    """Elements of a broken bond fly apart and meet again the other way round, one turned over."""
    for dim in (2, 3):
        p = (
            packing.hexagonal((4.0, 3.0), 1.0, "strain")
            if dim == 2
            else packing.fcc((3.0,) * 3, 1.0)
        )
        scene = Scene()
        body = scene.add(p, SOFT)
        body.linked[:] = False
        scene.contact()
        sim = Simulation(scene)
        i, j = p.bonds[0]
        along = p.bond_vector[0] / p.bond_length[0]
        apart = 9.0 * (p.position - p.position[0])  # every pair opens, and parts
        sim.set_state(displacement=apart)
        # j behind i now, moving towards it
        apart[j] = p.position[i] + apart[i] - 1.2 * along - p.position[j]
        v = np.zeros_like(p.position)
        v[j] = 0.01 * along
        turned = sim.orientation
        turned[j] = [1.0, 0.0] if dim == 2 else [0.0, 0.6, 0.8, 0.0]
        sim.set_state(displacement=apart, velocity=v, orientation=turned)
        held = sim.energy()
        yield vanishing(f"energy of contact at first, {dim}D", "apart", held["contact"], 0.0)
        sim.run(until=60.0)
        error = np.abs(sim.velocity[i] - v[j]).max() / 0.01
        yield vanishing(
            f"speed handed over, {dim}D", "elastic impact of equals", float(error), 1e-10
        )
        missing = sim.energy()["residual"] / held["kinetic"]
        yield vanishing(f"energy missing, {dim}D", "conserved", missing, 1e-10)


@case("contact")
def dense_overlap_stays_finite() -> Iterator[Measurement]:
    """Elements at one place, and a heap of loose ones that overlap by half: bounded, no NaN."""
    rng = np.random.default_rng(7)
    for dim in (2, 3):
        scene = Scene()
        x = rng.uniform(0.0, 6.0 if dim == 2 else 3.2, (40, dim))
        bodies = [scene.add(ball(place, 0.5), SOFT) for place in x]
        bodies[1].displacement[0] = x[0] - x[1]  # at one place
        bodies[2].displacement[0] = x[0] - x[2] + 1e-6 * np.eye(dim)[0]
        scene.contact(friction=0.5)
        sim = Simulation(scene, dt=0.02)
        held = sim.energy()
        total = held["contact"] + held["kinetic"]
        sim.run(steps=2000)
        ledger = sim.energy()
        finite = np.isfinite(sim.position).all() and np.isfinite(sim.velocity).all()
        yield Measurement(
            f"all numbers are finite, {dim}D", 1, "no NaN", float(finite), float(not finite), 0.0
        )
        grown = max(0.0, ledger["kinetic"] + ledger["contact"] - total) / total
        yield vanishing(f"energy gained over that at first, {dim}D", "bounded", grown, 1e-3)
        yield vanishing(f"energy missing, {dim}D", "conserved", ledger["residual"] / total, 1e-3)


@case("contact")
def broken_faces_rub() -> Iterator[Measurement]:
    """A block of two halves that a cut parts, pressed together, the upper slides on the lower: the
    force along the cut is mu times that across, slip takes what it should, angular momentum."""
    for name, bond in (("facet", "facet"), ("EVM", EVMBond(1.5, 0.4, 0.1, 0.1, offset=0.2))):
        yield from _rubbing_cut(name, bond)


def _rubbing_cut(name: str, bond: str | EVMBond) -> Iterator[Measurement]:
    """Measurements of a block of these bonds."""
    p = packing.square((8.0, 4.0), 1.0, "strain")
    low, high = p.position.min(axis=0), p.position.max(axis=0)
    middle = 0.5 * (low[1] + high[1])
    scene = Scene()
    is_facet = bond == "facet"
    body = scene.add(p, SOFT, bond=bond, facet_bending=is_facet)
    cut = scene.cut(body, [low[0] - 1.0, middle], [high[0] + 1.0, middle])
    scene.contact(friction=MU)
    # the line of an EVM bond's ends tilts as they slide, and opens: by little within a short way
    pressed, speed = 1e-3, 1e-3 if is_facet else 1e-4
    upper = p.position[:, 1] > middle
    body.displacement[upper, 1] = -pressed
    scene.hold(body, ~upper)
    scene.hold(body, upper, velocity=[speed, 0.0])
    sim = Simulation(scene, dt=0.01)
    first = sim.model.bond_place[::2][sim.model.own_bonds]
    two_shear = SOFT.young / (1.0 + SOFT.poisson)
    shear = two_shear * len(cut)  # 2 G S/r0
    ends = np.zeros(2)
    if isinstance(bond, EVMBond):
        shear *= float(np.asarray(bond.longitudinal)) / (SOFT.lame("strain") + two_shear)
        ends[1] = 2.0 * float(np.asarray(bond.offset))

    def forces() -> tuple[float, float]:
        """Of all pairs, along the face and across it."""
        x, (i, j) = sim.position, p.bonds[cut].T
        n = np.tile([0.0, 1.0], (len(cut), 1)) if is_facet else x[j] - x[i] - ends
        n /= np.linalg.norm(n, axis=1)[:, None]
        f = sim.bond_force[cut]
        across = (f * n).sum(axis=1)
        return float(np.linalg.norm(f - across[:, None] * n, axis=1).sum()), -float(across.sum())

    _, across = forces()
    early = 0.25 * MU * across / shear / speed
    sim.run(until=early)
    along, _ = forces()
    stuck = shear * speed * sim.time
    error = abs(along / stuck - 1.0)
    yield Measurement(
        f"force while friction holds, {name}", stuck, "k_t times the way", along, error, 1e-6
    )
    sim.run(until=20.0)
    along, now = forces()
    ratio = along / now
    yield Measurement(f"force along over across, {name}", MU, "mu", ratio, abs(ratio - MU), 1e-6)
    across -= (across - now) / 3.0  # it falls with the square of the way, or not at all
    slid = speed * sim.time - MU * across / shear
    ledger = sim.energy()
    wanted = MU * across * slid
    error = abs(ledger["friction"] / wanted - 1.0)
    yield Measurement(
        f"taken by slip, {name}", wanted, "mu N times the way", ledger["friction"], error,
        1e-6 if is_facet else 1e-3,
    )  # fmt: skip
    missing = ledger["residual"] / ledger["work"]
    yield vanishing(f"energy missing, {name}", "conserved", missing, 1e-6)
    force, torque = sim._step.download("end_force"), sim._step.download("end_torque")
    second = sim.model.bond_place[1::2][sim.model.own_bonds]
    x, (i, j) = sim.position, p.bonds[cut].T
    arm, f = x[j] - x[i], force[first[cut]]
    turning = arm[:, 0] * f[:, 1] - arm[:, 1] * f[:, 0]
    moment = torque[first[cut], 0] + torque[second[cut], 0] - turning
    worst = np.abs(moment).max() / np.abs(torque).max()
    yield vanishing(f"angular momentum, {name}", "M_ij + M_ji = r x F", worst, 1e-12)

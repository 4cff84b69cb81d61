"""Facet bonds with the volume term against Hooke's law and elasticity (theory C2)."""

from collections.abc import Iterator
from itertools import product
from math import pi

import numpy as np

from .. import packing
from ..errors import Array, InputError
from ..material import Material
from ..packing import Packing
from ..scene import Scene
from ..simulation import Simulation
from . import reference
from .case import Measurement, case
from .core import vanishing
from .foundation import at_least

STRAIN = 1e-6
SIZES = np.random.default_rng(0).uniform(0.3, 0.7, 130)  # radii
MANY = np.random.default_rng(0).uniform(0.4, 0.6, 260)
POISSON = (-0.3, 0.0, 0.2, 0.3, 0.45, 0.49)


def still(scene: Scene) -> Simulation:
    """A simulation that is not stepped."""
    return Simulation(scene, dt=1.0, force_dt=True)


def _any_strain(dim: int) -> Array:
    return STRAIN * np.array([[1.0, 0.4, 0.2], [0.4, -0.6, -0.3], [0.2, -0.3, 0.5]])[:dim, :dim]


@case("mca")
def patch_tests() -> Iterator[Measurement]:
    """Uniform strain, two layers held: stress and displacement of the inner elements at rest."""
    flat = {
        "hexagonal": packing.hexagonal((12.0, 10.0), 1.0, "strain"),
        "centroidal Voronoi": packing.voronoi((11.0, 11.0), 1.0, "stress", seed=1),
        "radical, polydisperse": packing.polydisperse((11.0, 11.0), SIZES, seed=1),
        "disc": packing.voronoi(packing.Disc(6.0), 1.0, "stress", seed=1),
        "random Voronoi": packing.voronoi((11.0, 11.0), 1.0, "strain", seed=1, relaxations=0),
    }
    solid = {
        "fcc": packing.fcc((4.5, 4.5, 4.5), 1.0),
        "bcc": packing.bcc((5.0, 5.0, 5.0), 1.0),
        "centroidal Voronoi in space": packing.voronoi((5.0, 5.0, 5.0), 1.0, seed=1),
        "radical, polydisperse in space": packing.polydisperse((5.5,) * 3, MANY, None, seed=1),
        "sphere": packing.voronoi(packing.Sphere(3.7), 1.0, None, seed=1),
        "random Voronoi in space": packing.voronoi((5.0, 5.0, 5.0), 1.0, seed=1, relaxations=0),
    }
    for (name, p), poisson in product((flat | solid).items(), POISSON):
        if poisson < 0.0 and ("random" in name or "radical" in name):
            continue  # may be indefinite there (theory B8), and is refused
        strain = _any_strain(p.dim)
        scene = Scene()
        body = scene.add(p, Material(1.0, poisson, 1.0), facet_bending=p.has_gears)
        scene.strain(body, strain, origin=np.zeros(p.dim))
        scene.hold(body, p.boundary(2))
        sim = still(scene)
        # from a disturbed start, so that the exact answer has to be found
        inner = ~p.boundary(2)
        u = sim.displacement
        noise = np.random.default_rng(2).normal(0.0, 0.1 * STRAIN, u.shape)
        sim.set_state(displacement=u + np.where(inner[:, None], noise, 0.0))
        sim.equilibrate(tolerance=1e-13 if p.dim == 2 else 1e-12)
        theory = reference.hooke(strain, 1.0, poisson, p.plane)
        where = f"{name}, nu {poisson}"
        error = np.abs(sim.stress[inner] - theory).max() / np.abs(theory).max()
        yield vanishing(f"inner stress, {where}", "Hooke's law", float(error), 1e-10)
        error = np.abs(sim.displacement - u)[inner].max() / (STRAIN * p.spacing)
        yield vanishing(f"displacement over strain, {where}", "uniform", float(error), 1e-10)


@case("mca", slow=True)
def free_sided_tension() -> Iterator[Measurement]:
    """A plate 60 elements across pulled between affine grips, sides free: E and nu inside."""
    for name, plane, poisson in product(
        ("hexagonal", "voronoi"), ("strain", "stress"), (0.0, 0.3, 0.49)
    ):
        found = _tension(name, plane, poisson, 60)
        across = poisson / (1.0 - poisson) if plane == "strain" else poisson
        along = 1.0 / (1.0 - poisson**2) if plane == "strain" else 1.0
        where = f"{name}, plane {plane}, nu {poisson}"
        error = abs(found[0] / along - 1.0)
        what = f"stress over strain, {where}"
        yield Measurement(what, along, "E or E/(1 - nu^2)", found[0], error, 3e-3)
        error = abs(found[1] - across)
        what = f"narrowing over strain, {where}"
        yield Measurement(what, across, "nu or nu/(1 - nu)", found[1], error, 3e-3)

    coarse, fine = (abs(_tension("hexagonal", "strain", 0.3, n)[0] * 0.91 - 1.0) for n in (15, 30))
    order = float(np.log2(coarse / fine))
    yield at_least("order of the error of E, hexagonal, 15 to 30 across", "theory B1", order, 1.0)


def _tension(name: str, plane: str, poisson: float, across: int) -> tuple[float, float]:
    """Axial stress over strain and lateral over axial strain in the middle of a plate."""
    p = getattr(packing, name)((float(across), 1.5 * across), 1.0, plane)
    scene = Scene()
    body = scene.add(p, Material(1.0, poisson, 1.0))
    scene.strain(body, np.diag([0.0, STRAIN]))
    grips = p.top | p.bottom
    # grips that let the plate narrow as it does inside
    ratio = poisson / (1.0 - poisson) if plane == "strain" else poisson
    centre = p.position - 0.5 * (p.position.max(axis=0) + p.position.min(axis=0))
    body.displacement[:] = centre * [-ratio * STRAIN, STRAIN]
    scene.hold(body, grips, axes="y", rotation=False)
    scene.hold(body, [int(np.argmin((centre**2).sum(axis=1)))])
    sim = still(scene)
    sim.equilibrate(tolerance=1e-9)
    x, u = p.position, sim.displacement
    middle = (np.abs(centre) < 0.25 * across).all(axis=1)
    fit = [np.polyfit(x[middle, axis], u[middle, axis], 1)[0] for axis in (0, 1)]
    stress = np.average(sim.stress[middle, 1, 1], weights=p.volume[middle])
    return float(stress / fit[1]), float(-fit[0] / fit[1])


@case("mca", slow=True)
def laminate() -> Iterator[Measurement]:
    """Layers of two materials: modulus across and along them, at 1 to 8 elements a layer.

    Along x nothing moves but as the uniform strain does, so that theory is that of layers.
    """
    for layer, ((e1, nu1), (e2, nu2)), plane in product(
        (1, 2, 8),
        (((1.0, 0.2), (1.0, 0.45)), ((1.0, 0.3), (1000.0, 0.3)), ((1.0, 0.0), (1e6, 0.4))),
        ("strain", "stress"),
    ):
        materials = Material(e1, nu1, 1.0), Material(e2, nu2, 1.0)
        p = packing.square((60.0, 12.0 * layer), 1.0, plane)
        grain = np.floor(p.position[:, 1] / layer + 1e-9).astype(int) % 2
        moduli = [m.lame(plane) + 2.0 * m.shear_modulus for m in materials]
        within = [m.plane_modulus(plane) for m in materials]
        where = f"{layer} a layer, ({e1:g}, {nu1}) and ({e2:g}, {nu2}), plane {plane}"
        for name, exact in (
            ("across", 2.0 / sum(1.0 / m for m in moduli)),
            ("along", 0.5 * sum(within)),
        ):
            found = _layers(p, materials, grain, layer, name)
            error = abs(found / exact - 1.0)
            what = f"modulus {name}, {where}"
            source = "series" if name == "across" else "parallel"
            yield Measurement(what, exact, source, found, error, 5e-3)


def _layers(
    p: Packing, materials: tuple[Material, ...], grain: Array, layer: int, direction: str
) -> float:
    scene = Scene()
    body = scene.add(p, materials, grain=grain, facet_bending=True)
    across = direction == "across"
    scene.strain(body, np.diag([0.0, STRAIN] if across else [STRAIN, 0.0]), origin=(0.0, 0.0))
    scene.hold(body, np.arange(len(p)), axes="x", rotation=False)
    if across:
        scene.hold(body, p.top | p.bottom)
    else:
        scene.hold(body, [len(p) // 2])
    sim = still(scene)
    sim.equilibrate(tolerance=1e-7)
    x, y = p.position.T
    column = np.flatnonzero(np.abs(x - np.floor(x.mean()) - 0.5) < 0.1)
    column = column[np.argsort(y[column])]
    stress = sim.stress[column]
    if not across:
        return float(stress[:, 0, 0].mean() / STRAIN)
    low, high = column[2 * layer], column[-2 * layer]  # whole periods apart
    u = sim.displacement[:, 1]
    return float(stress[len(column) // 2, 1, 1] / ((u[high] - u[low]) / (y[high] - y[low])))


@case("mca", slow=True)
def fine_laminate() -> Iterator[Measurement]:
    """The same at 32 elements a layer, six layers."""
    materials = Material(1.0, 0.2, 1.0), Material(1.0, 0.45, 1.0)
    p = packing.square((400.0, 192.0), 1.0)
    grain = np.floor(p.position[:, 1] / 32.0 + 1e-9).astype(int) % 2
    moduli = [m.lame("strain") + 2.0 * m.shear_modulus for m in materials]
    within = [m.plane_modulus("strain") for m in materials]
    for name, exact in (
        ("across", 2.0 / sum(1.0 / m for m in moduli)),
        ("along", 0.5 * sum(within)),
    ):
        found = _layers(p, materials, grain, 32, name)
        error = abs(found / exact - 1.0)
        yield Measurement(f"modulus {name}", exact, "layers", found, error, 5e-3)


@case("mca")
def two_phases() -> Iterator[Measurement]:
    """Random grains, a stiff inclusion, faces of their own: the undamped energy over 1e5 steps."""
    p = packing.voronoi((14.0, 14.0), 1.0, seed=3)
    rng = np.random.default_rng(4)
    centre = np.linalg.norm(p.position - 7.0, axis=1) < 4.0
    cases = {
        "random grains (1, .2) and (3, .45)": (rng.integers(0, 2, len(p)), 3.0, 0.45),
        "inclusion of contrast 1e6": (centre.astype(int), 1e6, 0.3),
    }
    for name, (grain, young, poisson) in cases.items():
        scene = Scene()
        dense = Material(young, poisson, 1.0 if young < 10.0 else 1e3)
        body = scene.add(p, (Material(1.0, 0.2, 1.0), dense), grain=grain)
        scene.set_velocity(body, 1e-6 * rng.normal(size=p.position.shape))
        sim = Simulation(scene)
        energy = []
        for _ in range(100):
            sim.run(steps=1000)
            ledger = sim.energy()
            energy.append(sum(ledger[k] for k in ("kinetic", "pair", "volume", "integrator")))
        e = np.array(energy)
        growth = float(e[-10:].mean() / e[:10].mean() - 1.0)
        yield vanishing(f"energy, last tenth over first, {name}", "conservation", growth, 1e-6)


@case("mca")
def spinning_body() -> Iterator[Measurement]:
    """A Voronoi body vibrates freely while it turns by 20 rad, 1e5 steps; forces balance."""
    p = packing.voronoi((7.0, 7.0), 1.0, seed=5)
    scene = Scene()
    body = scene.add(p, Material(1.0, 0.3, 1.0))
    centre = (p.volume[:, None] * p.position).sum(axis=0) / p.volume.sum()
    rng = np.random.default_rng(6)
    sim = Simulation(scene)
    spin = 20.0 / (1e5 * sim.dt)
    x = p.position - centre
    velocity = spin * np.stack([-x[:, 1], x[:, 0]], axis=1)
    scene.set_velocity(body, velocity + 2e-4 * rng.normal(size=x.shape), [spin])
    sim = Simulation(scene)
    energy, balance = [], 0.0
    for _ in range(200):
        sim.run(steps=500)
        ledger = sim.energy()
        energy.append(sum(ledger[k] for k in ("kinetic", "pair", "volume", "integrator")))
        force, place = sim.force, sim.position - centre
        lever = place[:, 0] * force[:, 1] - place[:, 1] * force[:, 0]
        moment = lever.sum() + sim.torque.sum()
        size = np.abs(force).sum()
        balance = max(balance, float(np.abs(force.sum(axis=0)).max() / size))
        balance = max(balance, float(abs(moment) / (size * 3.5)))
    e = np.array(energy) / energy[0] - 1.0
    trend = float(np.polyfit(np.linspace(0.0, 1.0, len(e)), e, 1)[0])
    yield vanishing("trend of the energy over 1e5 steps", "conservation", trend, 1e-5)
    yield vanishing("sum of forces, of torques over their size", "Newton", balance, 1e-12)


@case("mca")
def refusals() -> Iterator[Measurement]:
    """Random cells on which nu = -0.5 has no positive energy are refused (theory B8)."""
    refused = 0
    for seed in range(3):
        scene = Scene()
        cells = packing.voronoi((10.0, 10.0), 1.0, seed=seed, relaxations=0)
        scene.add(cells, Material(1.0, -0.5, 1.0))
        try:
            still(scene)
        except InputError:
            refused += 1
    error = abs(refused - 3)
    yield Measurement(
        "random packings refused at nu -0.5, of 3", 3.0, "theory B8", refused, error, 0.0
    )


@case("mca")
def kirsch() -> Iterator[Measurement]:
    """A hole of radius 20 spacings in a plate 40 radii wide, pulled: stress around its edge."""
    angle, hoop, exact = hoop_stress(20.0)
    for name, near in (
        ("across the pull (3 at the edge)", np.abs(np.sin(angle)) < 0.1),
        ("along the pull (-1 at the edge)", np.abs(np.cos(angle)) < 0.1),
    ):
        wanted, found = float(exact[near].mean()), float(hoop[near].mean())
        what = f"hoop stress of the edge's elements over the pull, {name}"
        error = abs(found - wanted) / 3.0
        yield Measurement(what, wanted, "Kirsch, there", found, error, 0.02)
    worst = float(np.sqrt(((hoop - exact) ** 2).mean()) / 3.0)
    what = "root mean square error around the edge over the greatest stress"
    yield vanishing(what, "Kirsch", worst, 0.02)


def hoop_stress(radius: float) -> tuple[Array, Array, Array]:
    """Of a hole's edge elements: angle, hoop stress over the pull, and that by Kirsch there.

    radius: in spacings.
    """
    width = 40.0 * radius
    middle = 0.5 * width

    def spacing(x: Array) -> Array:
        distance = np.linalg.norm(np.atleast_2d(x) - middle, axis=1) - radius
        return np.clip(1.0 + 0.12 * (distance - 0.3 * radius), 1.0, 1.5 * radius)

    hole = packing.Disc(radius, centre=(middle, middle))
    p = packing.voronoi(packing.Plate((width, width), holes=[hole]), spacing, plane="stress")
    scene = Scene()
    body = scene.add(p, Material(1.0, 0.3, 1.0))
    scene.pull(body, p.top, (0.0, STRAIN))
    scene.pull(body, p.bottom, (0.0, -STRAIN))
    x = p.position - middle
    for corner in (-1.0, 1.0):  # held at the middle of two sides, so that nothing turns
        at = int(np.argmin(np.abs(x[:, 0] - corner * middle) + np.abs(x[:, 1])))
        scene.hold(body, [at], axes="xy" if corner < 0.0 else "y", rotation=False)
    sim = still(scene)
    sim.equilibrate(tolerance=1e-7)
    edge = p.side("hole")
    r, angle = np.linalg.norm(x, axis=1)[edge], np.arctan2(x[edge, 1], x[edge, 0])
    around = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    hoop = np.einsum("na,nab,nb->n", around, sim.stress[edge][:, :2, :2], around) / STRAIN
    # Kirsch 1898 at the elements' own places; angles from the axis across the pull
    a2 = (radius / r) ** 2
    return angle, hoop, 0.5 * (1.0 + a2) + 0.5 * (1.0 + 3.0 * a2**2) * np.cos(2.0 * angle)


@case("mca")
def brazilian_disc() -> Iterator[Measurement]:
    """A disc 80 spacings across pressed between two narrow plates: stresses at its centre."""
    p = packing.voronoi(packing.Disc(40.0), 1.0, plane="stress", seed=2)
    scene = Scene()
    body = scene.add(p, Material(1.0, 0.25, 1.0))
    x = p.position
    force = 1e-4
    for sign in (1.0, -1.0):
        pressed = p.side("outer") & (sign * x[:, 1] > 0.0) & (np.abs(x[:, 0]) < 2.0)
        share = force / pressed.sum()
        scene.load(body, pressed, force=(0.0, -sign * share))
    # held far from the centre, against moving and turning as a whole
    scene.hold(body, [int(np.argmin(x[:, 0] + np.abs(x[:, 1])))], rotation=False)
    scene.hold(body, [int(np.argmax(x[:, 0] - np.abs(x[:, 1])))], axes="y", rotation=False)
    sim = still(scene)
    sim.equilibrate(tolerance=1e-7)
    near = np.linalg.norm(x, axis=1) < 3.0
    stress = np.average(sim.stress[near], axis=0, weights=p.volume[near])
    unit = force / (pi * 80.0)
    for name, found, exact in (
        ("tension across the load", stress[0, 0], 2.0 * unit),
        ("compression along it", stress[1, 1], -6.0 * unit),
    ):
        error = abs(found / exact - 1.0)
        yield Measurement(f"{name} [Pa]", exact, "Hertz, 2P/(pi D t)", float(found), error, 0.02)

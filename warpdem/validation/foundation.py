"""The ground under the laws: precision, objectivity, momentum, energy, waves, time step."""

import math
from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from .. import packing
from ..bond import EVMBond
from ..criteria import Rankine
from ..errors import Array
from ..material import Material
from ..packing import Packing
from ..scene import Scene
from ..simulation import Simulation
from . import reference
from .case import Measurement, case
from .core import facet_body, small_packing, vanishing


@case("core", slow=True)
def patch_test_precision() -> Iterator[Measurement]:
    """The patch test 40 elements across, at strains from 1e-3 to 1e-8, in float32 and mixed."""
    shapes = {
        "hex strain": packing.hexagonal((40.0, 12.0), 1.0),
        "hex stress": packing.hexagonal((40.0, 12.0), 1.0, plane="stress"),
        "square": packing.square((40.0, 10.0), 1.0),
        "simple cubic": packing.simple_cubic((40.0, 6.0, 6.0), 1.0),
        "bcc": packing.bcc((40.0, 5.0, 5.0), 1.0),
        "fcc": packing.fcc((40.0, 5.0, 5.0), 1.0),
    }
    for name, precision in product(shapes, ("float32", "mixed")):
        p = shapes[name]
        outer = p.boundary(layers=2)
        direction = np.random.default_rng(11).normal(size=(p.dim, p.dim))
        direction += direction.T
        worst = 0.0
        scene, _ = facet_body(p, 0.3)
        sim = Simulation(scene, precision=precision)
        for size in 10.0 ** np.arange(-3, -9, -1):
            strain = size * direction
            middle = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
            sim.set_state(displacement=(p.position - middle) @ strain)
            exact = reference.hooke(strain, 1.0, 0.3, p.plane)
            error = np.abs(sim.stress[~outer] - exact).max() / np.abs(exact).max()
            worst = max(worst, float(error))
        yield vanishing(f"worst stress error, {name}, {precision}", "Hooke's law", worst, 1e-5)


@case("core")
def objectivity() -> Iterator[Measurement]:
    """A strained block turned through one revolution: its stress turns with it.

    Over size, strain and precision. Rounding of places grows with size over strain, so float64 has
    its limit at the first size and strain; float32 is reported.
    """
    shapes = {
        "hex, 8 wide": packing.hexagonal((8.0, 7.0), 1.0),
        "hex, 40 wide": packing.hexagonal((40.0, 7.0), 1.0),
        "fcc, 8 wide": packing.fcc((8.0, 5.0, 5.0), 1.0),
    }
    limits = {"float64": 1e-12, "mixed": 1e-6, "float32": 0.1}
    for (name, p), size, precision in product(shapes.items(), (1e-2, 1e-3, 1e-4), limits):
        worst = _turned_stress_error(p, size, precision)
        limit = limits[precision]
        if precision == "float64" and (size < 1e-2 or "40" in name):
            limit = 1e-10
        what = f"worst stress error, {name}, strain {size:g}, {precision}"
        yield vanishing(what, "Hooke's law, turned", worst, limit)


def _turned_stress_error(p: Packing, size: float, precision: str) -> float:
    """Greatest error of the inner stress over one revolution, relative to the stress."""
    dim = p.dim
    shape = np.array([[1.0, 0.4, 0.2], [0.4, -0.3, 0.1], [0.2, 0.1, 0.5]])[:dim, :dim]
    x = p.position - p.position.mean(axis=0)
    strained = x + x @ (size * shape)
    exact = reference.hooke(size * shape, 1.0, 0.3, p.plane)
    scene, _ = facet_body(p, 0.3)
    sim = Simulation(scene, precision=precision, dt=1.0, force_dt=True)
    inner = ~p.boundary(layers=2)
    axis = np.array([0.0, 0, 1]) if dim == 2 else np.array([1.0, 2, 3]) / math.sqrt(14)
    worst = 0.0
    for angle in np.linspace(0.0, 2.0 * np.pi, 13):
        turn = Rotation.from_rotvec(angle * axis)
        q = turn.as_quat() if dim == 3 else np.array([math.sin(angle / 2), math.cos(angle / 2)])
        r = turn.as_matrix()
        sim.set_state(
            displacement=strained @ r[:dim, :dim].T - x, orientation=np.tile(q, (len(p), 1))
        )
        error = np.abs(sim.stress[inner] - r @ exact @ r.T).max() / np.abs(exact).max()
        worst = max(worst, float(error))
    return worst


@case("core")
def momentum() -> Iterator[Measurement]:
    """Momentum of a free cluster that breaks and closes, checked in every step."""
    for name in ("voronoi strain", "voronoi space", "fcc"):
        p = small_packing(name)
        scene, body = facet_body(p, 0.3, Rankine(2e-3))
        x = p.position - p.position.mean(axis=0)
        # torn apart along one axis, pushed together along another, spinning
        v = 0.02 * np.sign(x) * np.array([1.0, -1.0, 0.3])[: p.dim]
        w = 0.003 if p.dim == 2 else np.array([0.001, 0.002, 0.003])
        spin = np.cross(np.broadcast_to(np.array([0, 0, w]) if p.dim == 2 else w, (len(p), 3)),
                        reference.in_space(x))[:, : p.dim]  # fmt: skip
        scene.set_velocity(body, v + spin, np.atleast_1d(w))
        sim = Simulation(scene)
        start = _total_momentum(sim)
        worst_sum = worst_spin = 0.0
        closed = 0
        for _ in range(60):
            sim.run(steps=1)
            force, torque, bond = sim.force, sim.torque, sim.bond_force
            place, pull = reference.in_space(sim.position), reference.in_space(force)
            couple = np.cross(place, pull).sum(axis=0)[-torque.shape[1] :] + torque.sum(axis=0)
            size = np.linalg.norm(bond, axis=1).sum()
            if size == 0.0:
                break  # nothing is bonded or in contact any more
            worst_sum = max(worst_sum, float(np.abs(force.sum(axis=0)).max() / size))
            reach = size * np.abs(place).max()
            worst_spin = max(worst_spin, float(np.abs(couple).max() / reach))
            closed += int((bond[~sim.linked] != 0.0).any())
        source = "conservation"
        yield vanishing(f"sum of forces over moduli, {name}", source, worst_sum, 1e-12)
        yield vanishing(f"sum of torques over moduli, {name}", source, worst_spin, 1e-12)
        size = (sim.model.mass[:, None] * np.abs(sim.velocity)).sum()
        lost = np.abs(_total_momentum(sim) - start) / size
        yield vanishing(f"momentum lost in 60 steps, {name}", source, lost[:3].max(), 1e-12)
        spin = lost[3:].max() / np.abs(sim.position).max()
        yield vanishing(f"angular momentum lost in 60 steps, {name}", source, spin, 1e-12)
        broken = float(len(sim.broken_bonds()))
        yield at_least(f"broken bonds, {name}", "so that the case shows something", broken, 20)
        yield at_least(f"steps with closed pairs, {name}", "the same", closed, 20)


def _total_momentum(sim: Simulation) -> Array:
    """Linear and angular momentum of a scene, (6,)."""
    m, v = sim.model.mass[:, None], reference.in_space(sim.velocity)
    w = sim.angular_velocity
    w = np.concatenate([np.zeros((len(w), 2)), w], axis=1) if w.shape[1] == 1 else w
    spin = np.cross(reference.in_space(sim.position), m * v) + sim.model.inertia[:, None] * w
    return np.concatenate([(m * v).sum(axis=0), spin.sum(axis=0)])


@case("core")
def hot_block() -> Iterator[Measurement]:
    """An undamped 6 x 6 x 6 block of EVM bonds, random v and omega of rms 0.1, to t = 2000."""
    x = np.indices((6, 6, 6)).reshape(3, -1).T.astype(np.float64)
    index = np.arange(216).reshape(6, 6, 6)
    pairs = [
        (index[:-1], index[1:]),
        (index[:, :-1], index[:, 1:]),
        (index[..., :-1], index[..., 1:]),
    ]
    bonds = np.concatenate([np.stack([i.ravel(), j.ravel()], axis=1) for i, j in pairs])
    rng = np.random.default_rng(1)
    velocity = rng.normal(0.0, 0.1, x.shape)
    spin = rng.normal(0.0, 0.1, x.shape)
    block = packing.network(x, bonds, volume=1.0, radius=0.5)
    bond = EVMBond(longitudinal=1.0, shear=0.4, bending=0.05, torsion=0.04)
    for precision in ("float64", "mixed", "float32"):
        scene = Scene()
        body = scene.add(block, Material(1.0, 0.0, 1.0), bond=bond)
        scene.set_velocity(body, velocity - velocity.mean(axis=0), spin)
        sim = Simulation(scene, dt=0.05, precision=precision)
        energy = []
        for _ in range(200):
            sim.run(steps=200)
            ledger = sim.energy()
            energy.append(ledger["kinetic"] + ledger["pair"])
        start = sum(sim.initial_energies[k] for k in ("kinetic", "pair"))
        e = np.array(energy) / start - 1.0
        drift = float(e[-20:].mean() - e[:20].mean())
        source = "conservation"
        yield vanishing(f"energy, last tenth less first, {precision}", source, drift, 2e-4)


@case("core", slow=True)
def close_and_reopen() -> Iterator[Measurement]:
    """A crack inside an undamped body closes and reopens ten thousand times."""
    p = packing.voronoi((6.0, 6.0), 1.0, seed=2, relaxations=2)
    for poisson in (0.2, 0.3, 0.45):
        scene, body = facet_body(p, poisson)
        scene.cut(body, (1.2, 3.0), (4.8, 3.0))
        rng = np.random.default_rng(4)
        scene.set_velocity(body, 1e-5 * rng.normal(size=p.position.shape))
        sim = Simulation(scene)
        cut = np.flatnonzero(~sim.linked)
        closed, closings, energy = np.zeros(len(cut), dtype=bool), 0, []
        while closings < 10_000:
            sim.run(steps=1)
            now = np.abs(sim.bond_force[cut]).max(axis=1) > 0.0
            closings += int((now & ~closed).sum())
            closed = now
            if sim.steps % 20 == 0:
                ledger = sim.energy()
                energy.append(sum(ledger[k] for k in HELD))
        e = np.array(energy) / energy[0] - 1.0
        tenth = len(e) // 10
        drift = float(e[-tenth:].mean() - e[:tenth].mean())
        what = f"energy, last tenth less first, nu {poisson}, {sim.steps} steps"
        yield vanishing(what, "conservation", drift, 1e-4)


HELD = ("kinetic", "pair", "volume", "contact", "integrator")


@case("core")
def wave_speeds() -> Iterator[Measurement]:
    """Speeds of plane waves at 20 elements a wavelength, and how their error falls at 40."""
    directions = {
        "hex strain": ([1.0, 0.0], [0.0, 1.0]),
        "fcc": ([1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]),
    }
    shapes = {
        "hex strain": packing.hexagonal((9.0, 9.0), 1.0),
        "fcc": packing.fcc((7.5, 7.5, 7.5), 1.0),
    }
    for (name, rays), poisson in product(directions.items(), (0.0, 0.2, 0.3)):
        material = Material(1.0, poisson, 1.0)
        exact = {"P": material.pressure_speed(), "S": material.shear_speed()}
        worst = {}
        for length in (20.0, 40.0):
            found = [_plane_waves(shapes[name], poisson, np.array(r), length) for r in rays]
            for wave in "PS":
                errors = [abs(f[wave] / exact[wave] - 1.0) for f in found]
                worst[wave, length] = max(errors)
        for wave, limit in (("P", 0.01), ("S", 0.003)):
            where = f"{wave} waves, {name}, nu {poisson}"
            yield vanishing(
                f"worst speed error, {where}", "sqrt(modulus/density)", worst[wave, 20.0], limit
            )
            order = math.log2(worst[wave, 20.0] / worst[wave, 40.0])
            yield Measurement(
                f"order of the error, {where}", 2.0, "lattice", order, abs(order - 2.0), 0.1
            )


def _plane_waves(p: Packing, poisson: float, direction: Array, length: float) -> dict[str, float]:
    """Speeds of P and S waves of a wavelength from the forces on one element deep inside.

    Unit fields cos and sin of displacement and turning give the Bloch matrix of that element.
    """
    scene, _ = facet_body(p, poisson)
    sim = Simulation(scene, dt=1.0, force_dt=True)
    dim, spins = p.dim, 1 if p.dim == 2 else 3
    k = 2.0 * np.pi / length * direction / np.linalg.norm(direction)
    middle = int(np.argmin(((p.position - p.position.mean(axis=0)) ** 2).sum(axis=1)))
    phase = (p.position - p.position[middle]) @ k
    size = dim + spins
    bloch = np.zeros((size, size), dtype=complex)
    small = 1e-6
    for column, (part, wave) in product(range(size), ((1.0, np.cos), (1j, np.sin))):
        u = np.zeros((len(p), dim))
        turn = np.zeros((len(p), spins))
        (u if column < dim else turn)[:, column % dim if column < dim else column - dim] = (
            small * wave(phase)
        )
        q = np.concatenate([0.5 * turn, np.sqrt(1.0 - 0.25 * (turn**2).sum(1, keepdims=True))], 1)
        sim.set_state(displacement=u, orientation=q)
        force = np.concatenate([sim.force[middle], sim.torque[middle]])
        bloch[:, column] -= part * force / small
    mass = np.concatenate([np.full(dim, sim.model.mass[middle]),
                           np.full(spins, sim.model.inertia[middle])])  # fmt: skip
    root = 1.0 / np.sqrt(mass)
    square, modes = np.linalg.eigh(root[:, None] * bloch * root[None, :])
    speed = np.sqrt(np.maximum(square[:dim], 0.0)) / np.linalg.norm(k)
    along = np.abs((root[:dim, None] * modes[:dim, :dim]).T @ (k / np.linalg.norm(k)))
    push = int(np.argmax(along))
    return {"P": float(speed[push]), "S": float(np.delete(speed, push).mean())}


@case("core", slow=True)
def time_step() -> Iterator[Measurement]:
    """Stable at 0.99 of the limit over 1e5 steps, divergent at 1.02; the bound is never above."""
    couple = EVMBond(longitudinal=1.0, shear=1.0, bending=0.1, torsion=0.1)
    small = {
        "hex": packing.hexagonal((8.0, 7.0), 1.0),
        "fcc": packing.fcc((4.0, 4.0, 4.0), 1.0),
        "simple cubic with couple": packing.simple_cubic((4.0, 4.0, 4.0), 1.0),
        "random Voronoi": packing.voronoi((7.0, 7.0), 1.0, relaxations=0),
        "centroidal Voronoi": packing.voronoi((7.0, 7.0), 1.0),
        "centroidal Voronoi in space": packing.voronoi((4.0, 4.0, 4.0), 1.0),
    }
    for (name, p), poisson in product(small.items(), (0.3, 0.45)):
        growth = {}
        for factor, steps in ((0.99, 100_000), (1.02, 20_000)):
            scene = Scene()
            bond = couple if "couple" in name else "facet"
            body = scene.add(p, Material(1.0, poisson, 1.0), bond=bond, volume=True)
            rng = np.random.default_rng(8)
            scene.set_velocity(body, 1e-9 * rng.normal(size=p.position.shape),
                               1e-9 * rng.normal(size=body.angular_velocity.shape))  # fmt: skip
            limit = Simulation(scene).dt_limit
            sim = Simulation(scene, dt=factor * limit, force_dt=True)
            start, growth[factor] = sim.energy()["kinetic"], 0.0
            while sim.steps < steps and growth[factor] < 1e6:
                # divergence is to be seen before numbers overflow
                sim.run(steps=1000 if factor < 1.0 else 20)
                growth[factor] = max(growth[factor], sim.energy()["kinetic"] / start)
        where = f"{name}, nu {poisson}"
        yield Measurement(
            f"kinetic energy at 0.99, {where}", 1.0, "stability", growth[0.99],
            growth[0.99], 1e3,
        )  # fmt: skip
        yield at_least(f"kinetic energy at 1.02, {where}", "instability", growth[1.02], 1e6)
        ratio = (sim.dt_limit / sim.dt_bound) ** 2
        yield at_least(f"bound over true omega^2, {where}", "theory A9, B8", ratio, 1.0)


def at_least(quantity: str, source: str, measured: float, reference_value: float) -> Measurement:
    """A quantity that should not be smaller than a reference; the error is what it lacks."""
    lack = max(0.0, reference_value - measured)
    return Measurement(quantity, reference_value, source, float(measured), lack, 0.0)

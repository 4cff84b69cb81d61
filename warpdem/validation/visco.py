"""Viscoelastic laws of the deviator against closed forms (theory B12)."""

from collections.abc import Iterator
from itertools import product
from math import pi, sqrt

import numpy as np
from numpy.polynomial import Polynomial

from .. import packing
from ..criteria import Rankine
from ..errors import Array, InputError
from ..material import Material
from ..packing import Packing
from ..scene import Body, Scene
from ..simulation import Simulation
from ..viscoelasticity import KelvinVoigt, Maxwell, Prony, StandardLinearSolid, ViscousLaw
from . import reference
from .case import Measurement, case
from .core import vanishing
from .foundation import at_least

STRAIN = 1e-6
SOFT = Material(1.0, 0.3, 1.0)
TIME = 400.0  # of relaxation of most bodies here, in spacings over sqrt(E/rho)
LAWS: dict[str, Maxwell | StandardLinearSolid | Prony] = {
    "Maxwell": Maxwell(TIME),
    "standard linear solid": StandardLinearSolid(0.6, TIME),
    "two branches": Prony((0.3, 0.5), (0.3 * TIME, TIME)),
}
SPACES: tuple[str | None, ...] = ("strain", "stress", None)


def _named(plane: str | None) -> str:
    return "space" if plane is None else f"plane {plane}"


class Correspondence:
    """Moduli of a material of constant K and of G(t), as rational functions of Laplace's s.

    G(s) = G n/d; whatever elasticity says of G then holds of the transforms.
    """

    def __init__(self, law: ViscousLaw, material: Material = SOFT) -> None:
        self.bulk, self.shear = material.bulk_modulus, material.shear_modulus
        shares, times = law.series()
        d = Polynomial([1.0])
        for time in times:
            d = d * Polynomial([1.0, time])
        n = (1.0 - shares.sum()) * d + Polynomial([0.0, law.retardation])
        for k, (share, time) in enumerate(zip(shares, times, strict=True)):
            part = Polynomial([0.0, share * time])
            for other in np.delete(times, k):
                part = part * Polynomial([1.0, other])
            n = n + part
        self.n, self.d = self.shear * n, d

    def tension(self, plane: str | None) -> tuple[Polynomial, Polynomial]:
        """E = 9 K G/(3 K + G), in plane strain 4 G (3 K + G)/(3 K + 4 G)."""
        k, n, d = 3.0 * self.bulk, self.n, self.d
        if plane == "strain":
            return 4.0 * n * (k * d + n), d * (k * d + 4.0 * n)
        return 3.0 * k * n, k * d + n

    def in_plane_stress(self) -> tuple[Polynomial, Polynomial]:
        """Mean of the stresses in the plane over that of strains, 18 K G/(3 K + 4 G)."""
        k, n, d = 3.0 * self.bulk, self.n, self.d
        return 6.0 * k * n, k * d + 4.0 * n


def step_response(ratio: tuple[Polynomial, Polynomial], time: Array) -> Array:
    """Response to a unit step of a transfer function n/d at times > 0, by matrix exponentials.

    Powers of s in the ratio are impulses at time 0.
    """
    from scipy.linalg import expm
    from scipy.signal import tf2ss

    n, d = ratio
    whole, rest = divmod(n, d)
    a, b, c, _ = tf2ss(rest.coef[::-1], d.coef[::-1])
    size = len(a)
    both = np.zeros((size + 1, size + 1))
    both[:size, :size], both[:size, size:] = a, b
    states = np.stack([expm(t * both)[:size, size] for t in time])
    return (states @ c.T).ravel() + whole.coef[0]


def inverse(ratio: tuple[Polynomial, Polynomial]) -> tuple[Polynomial, Polynomial]:
    """One over it."""
    return ratio[1], ratio[0]


# -- laws -----------------------------------------------------------------------------------------


def _cells(plane: str | None, periodic: bool = False) -> Packing:
    size = (4.0, 4.0) if plane else (4.0, 4.0, 4.0)
    return packing.voronoi(size, 1.0, plane, seed=1, periodic=periodic)


@case("visco")
def branches_of_bonds() -> Iterator[Measurement]:
    """A free body in violent motion: forces and torques of its bonds against NumPy's, 100 steps."""
    law = Prony((0.5, 0.3), (5.0, 40.0))
    for plane in SPACES:
        p = _cells(plane)
        assert p.area is not None and p.arms is not None
        rng = np.random.default_rng(0)
        scene = Scene()
        body = scene.add(p, SOFT, viscous=law)
        scene.set_velocity(body, 0.1 * rng.normal(size=p.position.shape))
        sim = Simulation(scene)
        shares, times = law.series()
        numpy = reference.Creep(
            p.bonds, p.arms, p.area, p.volume, SOFT, plane, shares, -np.expm1(-sim.dt / times)
        )
        numpy.start(sim.displacement, sim.orientation)
        worst = 0.0
        for _ in range(100):
            sim.run(steps=1)
            f, ti, tj = numpy.step(sim.displacement, sim.orientation)
            worst = max(
                worst, float(np.abs(sim.bond_force - f[:, : p.dim]).max() / np.abs(f).max())
            )
            torque = np.zeros((len(p), 3))
            np.add.at(torque, p.bonds[:, 0], ti)
            np.add.at(torque, p.bonds[:, 1], tj)
            spins = torque[:, 2:] if plane else torque
            worst = max(worst, float(np.abs(sim.torque - spins).max() / np.abs(torque).max()))
        what = f"forces and torques over the greatest, {_named(plane)}"
        yield vanishing(what, "reference.Creep", worst, 1e-11)


@case("visco")
def uniform_states() -> Iterator[Measurement]:
    """A periodic cell after a step of any strain, at rest: its stresses to 2 T."""
    strain = STRAIN * np.array([[1.0, 0.4, 0.2], [0.4, -0.3, -0.3], [0.2, -0.3, 0.5]])
    for plane, (name, law) in product(SPACES, LAWS.items()):
        p = _cells(plane, periodic=True)
        scene = Scene()
        body = scene.add(p, SOFT, viscous=law)
        e = np.zeros((3, 3))
        e[: p.dim, : p.dim] = strain[: p.dim, : p.dim]
        scene.strain(body, e[: p.dim, : p.dim])
        sim = Simulation(scene)
        laplace, dilation = Correspondence(law), np.trace(e)
        worst = size = 0.0
        for _ in range(4):
            sim.run(until=sim.time + 0.5 * TIME)
            shear = 2.0 * SOFT.shear_modulus * law.relaxation(sim.time)
            exact = shear * (
                e - dilation / 3.0 * np.eye(3)
            ) + SOFT.bulk_modulus * dilation * np.eye(3)
            if plane == "stress":
                mean, flat = 0.5 * dilation, np.diag([1.0, 1.0, 0.0])
                within = step_response(laplace.in_plane_stress(), np.array([sim.time]))[0]
                exact = shear * (e - mean * flat) + within * mean * flat
            size = max(size, float(np.abs(exact).max()))
            worst = max(worst, float(np.abs(sim.stress - exact).max()))
        what = f"stress of every element, {name}, {_named(plane)}"
        yield vanishing(what, "Laplace", worst / size, 1e-6)


@case("visco")
def harmonic_strain() -> Iterator[Measurement]:
    """A periodic cell in harmonic shear: storage modulus from its stress, loss from the work."""
    laws: dict[str, ViscousLaw] = {"Kelvin-Voigt": KelvinVoigt(TIME), **LAWS}
    for (name, law), x in product(laws.items(), (0.5, 2.0)):
        exact = SOFT.shear_modulus * law.complex_modulus(x / TIME)
        found = _shaken(law, x / TIME)
        size = abs(exact)
        for part, value, wanted in (
            ("storage", found.real, exact.real),
            ("loss", found.imag, exact.imag),
        ):
            what = f"{part} modulus, {name}, omega T = {x:g}"
            error = abs(value - wanted) / size
            yield Measurement(what, float(wanted), "G*(omega)", float(value), float(error), 1e-3)


def _shaken(law: ViscousLaw, frequency: float) -> complex:
    """Complex shear modulus of a cell whose elements follow its shear; a cycle after the start."""
    p = _cells("strain", periodic=True)
    steps = 400
    dt = 2.0 * pi / (steps * frequency)
    shear = np.zeros((p.dim, p.dim))
    shear[0, 1] = shear[1, 0] = 0.5 * STRAIN
    scene = Scene()
    body = scene.add(p, SOFT, viscous=law)
    scene.strain(body, lambda time: shear * np.sin(frequency * time))
    x = p.position - 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
    # what moves elements from sine to sine in steps of dt
    even = np.sin(0.5 * frequency * dt) / (0.5 * dt)
    velocity = (x @ shear) * even
    scene.hold(body, np.arange(len(p)), velocity, history=lambda time: np.cos(frequency * time))
    sim = Simulation(scene, dt=dt, force_dt=True)
    longest = max(law.series()[1], default=0.0)
    sim.run(steps=steps * int(np.ceil(12.0 * longest * frequency / (2.0 * pi)) + 1))
    began = sim.energy()["work"]
    stress = np.zeros(steps)
    for n in range(steps):
        sim.run(steps=1)
        stress[n] = np.average(sim.stress[:, 0, 1], weights=p.volume)
    phase = frequency * dt * np.arange(1, steps + 1)
    storage = 2.0 * (stress * np.sin(phase)).mean() / STRAIN
    loss = (sim.energy()["work"] - began) / (pi * STRAIN**2 * p.volume.sum())
    return complex(storage, loss)


@case("visco")
def viscoelastic_layers() -> Iterator[Measurement]:
    """Layers of unlike fluids and solids strained across: faces of their own between them."""
    layers = Material(1.0, 0.2, 1.0), Material(3.0, 0.4, 1.0), Material(0.5, 0.1, 1.0)
    laws = Maxwell(TIME), StandardLinearSolid(0.5, 0.3 * TIME), None
    x = np.stack(np.divmod(np.arange(24), 6), axis=1) + 0.5
    p = _periodic(x, 1.0, 1.0, np.array([4.0, 6.0]))
    scene = Scene()
    grain = x[:, 1].astype(int) % 3
    body = scene.add(p, layers, grain=grain, facet_bending=True, viscous=laws)
    scene.strain(body, np.diag([0.0, STRAIN]))
    sim = Simulation(scene)
    _start_creeping(sim)
    # in series: with the sides held the stress of a layer is (K + 4/3 G) times its strain
    n, d = Polynomial([1.0]), Polynomial([0.0])
    for material, law in zip(layers, laws, strict=True):
        own = Correspondence(law or Prony((1e-12,), (1.0,)), material)
        modulus = own.bulk * own.d + 4.0 / 3.0 * own.n
        n, d = n * modulus, d * modulus + n * own.d / 3.0
    times, found = [], []
    for _ in range(6):
        sim.run(until=sim.time + 0.5 * TIME)
        times.append(sim.time)
        found.append(float(sim.stress[:, 1, 1].mean() / STRAIN))
    exact = step_response((n, d), np.array(times))
    error = float(np.abs(np.array(found) / exact - 1.0).max())
    yield Measurement("stress over strain at T", exact[1], "Laplace", found[1], error, 1e-4)


def _periodic(x: Array, volume: float, area: float, period: Array) -> Packing:
    """A lattice of unit spacing in plane strain that repeats a box, its faces in the middle."""
    i, j = np.triu_indices(len(x), 1)
    apart = x[j] - x[i]
    apart -= period * np.rint(apart / period)
    near = np.linalg.norm(apart, axis=1) < 1.01
    bonds, half = np.stack([i, j], axis=1)[near], 0.5 * apart[near]
    arms, faces = np.stack([half, -half], axis=1), np.full(len(bonds), area)
    return Packing(
        x, np.full(len(x), volume), bonds, faces, arms, period=period, plane="strain", spacing=1.0
    )


def _start_creeping(sim: Simulation) -> None:
    """Come to rest but for the speed of creep, so that nothing vibrates.

    That speed is what the first step adds to the place of rest.
    """
    places = []
    for steps in (0, 1):
        sim.run(steps=steps)
        sim.relax(tolerance=1e-9)
        places.append((sim.displacement, sim.rotation))
    speed, spin = ((after - before) / sim.dt for before, after in zip(*places, strict=True))
    sim.set_state(velocity=speed, angular_velocity=spin)


# -- bars -----------------------------------------------------------------------------------------


class Bars:
    """Bars of random cells with free sides, one a law and a load: a step of strain or of traction.

    Under a step of strain all elements keep their place along the bar. Read in the middle: cells
    at the ends, whose surface has a traction, are not in uniform stress.
    """

    def __init__(self, plane: str | None) -> None:
        size = (3.0, 14.0) if plane else (2.5, 2.5, 12.0)
        self.packing = p = packing.voronoi(size, 1.0, plane, seed=1)
        self.plane, self.axis = plane, p.dim - 1
        along = p.position[:, -1]
        self.middle = np.abs(along / size[-1] - 0.5) < 0.17
        ends = p.side("bottom") | p.side("top") if plane else p.side("back") | p.side("front")
        self.scene = Scene()
        self.bodies: dict[tuple[str, str], Body] = {}
        strain = np.zeros((p.dim, p.dim))
        strain[-1, -1] = STRAIN
        traction = np.zeros(p.dim)
        traction[-1] = STRAIN
        for (name, law), load in product(LAWS.items(), ("relaxation", "creep")):
            body = self.bodies[name, load] = self.scene.add(p, SOFT, viscous=law)
            if load == "relaxation":
                self.scene.strain(body, strain)
                every = np.arange(len(p))
                self.scene.hold(body, every, axes="xyz"[self.axis], rotation=False)
            else:
                for i in np.flatnonzero(ends):  # of each just what its own surface has
                    self.scene.load(body, [i], traction * p.exposed_area[i, self.axis])
                self.scene.hold(body, ends, axes="")
        self.sim = Simulation(self.scene)
        _start_creeping(self.sim)

    def read(self, name: str, load: str) -> float:
        """Stress over strain in the middle of a bar, or strain over traction of it."""
        p, at = self.packing, self.sim.elements(self.bodies[name, load])
        if load == "relaxation":
            stress = self.sim.stress[at][self.middle, self.axis, self.axis]
            return float(np.average(stress, weights=p.volume[self.middle]) / STRAIN)
        u = self.sim.displacement[at, self.axis][self.middle]
        return float(np.polyfit(p.position[self.middle, self.axis], u, 1)[0] / STRAIN)


@case("visco")
def relaxation_and_creep() -> Iterator[Measurement]:
    """Bars with free sides after a step of strain and after a step of traction, to 3 T."""
    for plane in SPACES:
        bars = Bars(plane)
        times: list[float] = []
        found: dict[tuple[str, str], list[float]] = {key: [] for key in bars.bodies}
        for _ in range(6):
            bars.sim.run(until=bars.sim.time + 0.5 * TIME)
            times.append(bars.sim.time)
            for key, values in found.items():
                values.append(bars.read(*key))
        for (name, load), values in found.items():
            modulus = Correspondence(LAWS[name]).tension(plane)
            ratio = modulus if load == "relaxation" else inverse(modulus)
            exact = step_response(ratio, np.array(times))
            error = np.abs(np.array(values) / exact - 1.0).max()
            what = f"{load} of a bar, {name}, {_named(plane)}: at T"
            yield Measurement(what, exact[1], "Laplace", values[1], float(error), 1e-3)


@case("visco")
def kelvin_voigt_creep() -> Iterator[Measurement]:
    """Bars of Kelvin and Voigt's solid under a sudden traction, two elements wide, to 2 T.

    From 1.5 T on: until then waves of volume, which shear dashpots hardly damp, run along the bar.

    In half of the default step: where dt is all but what dashpots allow, the fastest motions, as at
    the ends, lag. The reference has the inertia of a slow bar, -s^2 rho L^2/8 E^-2.
    """
    law, length = KelvinVoigt(50.0), 8.0
    for plane in SPACES:
        p = (
            packing.square((2.0, length), 1.0, plane)
            if plane
            else packing.simple_cubic((2.0, 2.0, length), 1.0)
        )
        along = p.position[:, -1]
        middle = np.abs(along - 0.5 * length) < 1.1
        pull = np.zeros(p.dim)
        pull[-1] = STRAIN
        scene = Scene()
        body = scene.add(p, SOFT, viscous=law, facet_bending=True)
        scene.load(body, along > length - 0.6, pull)
        scene.load(body, along < 0.6, -pull)
        sim = Simulation(scene)
        sim = Simulation(scene, dt=0.5 * sim.dt)
        n, d = Correspondence(law).tension(plane)
        slow = d * n - Polynomial([0.0, 0.0, SOFT.density * length**2 / 8.0]) * d * d
        worst = 0.0
        for time in (1.5, 2.0):
            sim.run(until=time * law.time)
            found = float(np.polyfit(along[middle], sim.displacement[middle, -1], 1)[0] / STRAIN)
            exact = float(step_response((slow, n * n), np.array([sim.time]))[0])
            worst = max(worst, abs(found / exact - 1.0))
        what = f"creep of a bar, {_named(plane)}: at 2 T"
        yield Measurement(what, exact, "Laplace", found, worst, 1e-3)


# -- energy and momentum --------------------------------------------------------------------------

EVERY: dict[str, ViscousLaw] = {
    "Maxwell": Maxwell(20.0),
    "standard linear solid": StandardLinearSolid(0.6, 5.0),
    "two branches": Prony((0.3, 0.5), (2.0, 40.0)),
    "Kelvin-Voigt": KelvinVoigt(0.5),
}


def _held(ledger: dict[str, float]) -> float:
    return sum(ledger[k] for k in ("kinetic", "pair", "volume", "contact", "integrator"))


@case("visco")
def vibrating_bodies() -> Iterator[Measurement]:
    """Free bodies in small random motion, 1000 steps: the ledger, and what is held only falls."""
    for plane, (name, law) in product(SPACES, EVERY.items()):
        p = _cells(plane)
        rng = np.random.default_rng(0)
        scene = Scene()
        body = scene.add(p, SOFT, viscous=law)
        scene.set_velocity(body, STRAIN * rng.normal(size=p.position.shape))
        sim = Simulation(scene)
        held = [_held(sim.energy())]
        for _ in range(200):
            sim.run(steps=5)
            held.append(_held(sim.energy()))
        where = f"{name}, {_named(plane)}"
        residual = sim.energy()["residual"] / held[0]
        yield vanishing(f"residual over the initial energy, {where}", "ledger", residual, 1e-6)
        rise = max(0.0, float(np.diff(held).max())) / held[0]
        yield vanishing(f"greatest rise of the energy held, {where}", "B12", rise, 1e-9)
        ledger = sim.energy()
        taken = (ledger["viscous"] + ledger["damping"]) / held[0]
        yield at_least(f"share of the energy taken, {where}", "B12", taken, 0.5)


@case("visco")
def spinning_viscous_bodies() -> Iterator[Measurement]:
    """Bodies that vibrate and creep while they turn by 6 rad: momenta and the ledger."""
    for plane, (name, law) in product(SPACES, EVERY.items()):
        p = _cells(plane)
        rng = np.random.default_rng(0)
        mass = p.volume
        x = p.position - np.average(p.position, axis=0, weights=mass)
        spin = 0.01 if plane else np.array([0.006, 0.0, 0.008])
        turn = np.array([0.0, 0.0, spin]) if plane else spin
        velocity = np.cross(turn, reference.in_space(x))[:, : p.dim]
        noise = 2e-3 * rng.normal(size=x.shape)
        scene = Scene()
        body = scene.add(p, SOFT, viscous=law)
        scene.set_velocity(body, velocity + noise, np.atleast_1d(spin))
        sim = Simulation(scene)
        momenta = [_momenta(sim)]
        start = sim.energy()
        sim.run(until=600.0)
        momenta.append(_momenta(sim))
        where = f"{name}, {_named(plane)}"
        change = max(
            float(np.abs(after - before).max() / size)
            for before, after, size in zip(*momenta, _sizes(sim, velocity + noise, x), strict=True)
        )
        yield vanishing(f"change of momenta over their size, {where}", "Newton", change, 1e-12)
        residual = sim.energy()["residual"] / _held(start)
        yield vanishing(f"residual over the initial energy, {where}", "ledger", residual, 2e-4)


def _momenta(sim: Simulation) -> tuple[Array, Array]:
    """Momentum and angular momentum about the origin, of space; faces of their own included."""
    sim._step.synchronise()
    u, v, w = (
        sim._step.download(name) for name in ("displacement", "velocity", "angular_velocity")
    )
    mass, x = sim.model.mass[:, None], reference.in_space(sim.model.position + u)
    spins = np.pad(w, ((0, 0), (3 - w.shape[1], 0)))
    turning = np.cross(x, mass * reference.in_space(v)) + sim.model.inertia[:, None] * spins
    return (mass * reference.in_space(v)).sum(axis=0), turning.sum(axis=0)


def _sizes(sim: Simulation, velocity: Array, x: Array) -> tuple[float, float]:
    """Sums of the sizes of both momenta of the elements."""
    size = sim.model.mass[: len(x)] * np.linalg.norm(velocity, axis=1)
    return float(size.sum()), float((size * np.linalg.norm(x, axis=1)).sum())


@case("visco")
def breaking_bodies() -> Iterator[Measurement]:
    """Bodies torn apart while they creep: a broken bond drops its branches, the ledger closes."""
    for plane, name in product(("strain", None), ("two branches", "Kelvin-Voigt")):
        p, law = _cells(plane), EVERY[name]
        rng = np.random.default_rng(0)
        scene = Scene()
        body = scene.add(p, SOFT, viscous=law, fracture=Rankine(1e-4))
        x = p.position - p.position.mean(axis=0)
        noise = 5e-5 * rng.normal(size=x.shape)
        scene.set_velocity(body, 1e-4 * np.sign(x) + noise)
        sim = Simulation(scene)
        start = _held(sim.energy())
        sim.run(until=30.0)
        where = f"{name}, {_named(plane)}"
        broken = len(sim.broken_bonds()) / len(p.bonds)
        yield at_least(f"share of the bonds broken, {where}", "Rankine", broken, 0.1)
        yield at_least(f"share of the bonds left, {where}", "Rankine", 1.0 - broken, 0.1)
        residual = sim.energy()["residual"] / start
        yield vanishing(f"residual over the initial energy, {where}", "ledger", residual, 1e-4)


# -- waves, time step, precision ------------------------------------------------------------------


@case("visco")
def attenuation() -> Iterator[Measurement]:
    """Shear waves from a plane that moves harmonically, 25 elements long: complex wavenumber."""
    speed = SOFT.shear_speed()
    omega = 2.0 * pi * speed / 25.0
    for name, law in (
        ("standard linear solid", StandardLinearSolid(0.6, 1.0 / omega)),
        ("Kelvin-Voigt", KelvinVoigt(0.3 / omega)),
    ):
        exact = omega / speed / np.sqrt(law.complex_modulus(omega))
        if exact.imag > 0.0:
            exact = exact.conjugate()
        found = _wavenumber(law, omega)
        for part, value, wanted in (
            ("wavenumber", found.real, exact.real),
            ("attenuation", -found.imag, -exact.imag),
        ):
            error = abs(value / wanted - 1.0)
            what = f"{part} times spacing, {name}"
            yield Measurement(what, float(wanted), "omega/sqrt(G*/rho)", value, float(error), 0.02)


def _wavenumber(law: ViscousLaw, omega: float) -> complex:
    """k of u = exp(i (omega t - k x)) on both sides of a column that is moved across x."""
    columns = 220
    row, column = np.divmod(np.arange(4 * columns), columns)
    x = np.stack([column + 0.5 * (row % 2), row * sqrt(3.0) / 2.0], axis=1)
    period = np.array([float(columns), 2.0 * sqrt(3.0)])
    p = _periodic(x, sqrt(3.0) / 2.0, 1.0 / sqrt(3.0), period)
    scene = Scene()
    body = scene.add(p, SOFT, viscous=law)
    rise = 4.0 * pi / omega

    def history(time: float) -> float:
        return float(np.cos(omega * time) * np.sin(0.5 * pi * min(time / rise, 1.0)) ** 2)

    scene.hold(body, x[:, 0] < 0.75, (0.0, STRAIN), rotation=False, history=history)
    sim = Simulation(scene)
    sim.run(until=0.45 * columns / SOFT.shear_speed() + rise)
    # amplitude and phase over one period, by least squares
    steps = max(1, round(2.0 * pi / omega / sim.dt / 32))
    u, waves = [], []
    for _ in range(32):
        sim.run(steps=steps)
        u.append(sim.displacement[:, 1])
        phase = omega * sim.time
        waves.append([np.cos(phase), -np.sin(phase), 1.0])
    real, imaginary, _ = np.linalg.lstsq(np.array(waves), np.array(u), rcond=None)[0]
    near = (x[:, 0] > 5.0) & (x[:, 0] < 45.0)
    order = np.argsort(x[near, 0])
    logs = np.log(real[near] + 1j * imaginary[near])[order]
    at = x[near, 0][order]
    decay = np.polyfit(at, logs.real, 1)[0]
    turn = np.polyfit(at, np.unwrap(logs.imag), 1)[0]
    return complex(-turn, decay)


@case("visco")
def time_steps() -> Iterator[Measurement]:
    """Strong viscosity: stable at the default step, refused beyond the limit, and why."""
    p = _cells("strain")
    for time in (0.0, 0.3, 3.0, 30.0):
        scene = Scene()
        body = scene.add(p, SOFT, viscous=KelvinVoigt(time) if time else None)
        rng = np.random.default_rng(0)
        scene.set_velocity(body, STRAIN * rng.normal(size=p.position.shape))
        sim = Simulation(scene)
        start = _held(sim.energy())
        sim.run(steps=2000)
        rise = _held(sim.energy()) / start
        yield at_least(f"energy at the start over that after 2000 steps, T = {time:g}", "B12",
                       1.0 / rise, 1.0 - 1e-6)  # fmt: skip
        if time < 1.0:
            continue
        wild = Simulation(scene, dt=2.5 * sim.dt_limit, force_dt=True)
        wild.run(steps=10)
        growth = _held(wild.energy()) / start
        what = f"energy after 10 steps of 2.5 times the limit over its start, T = {time:g}"
        yield at_least(what, "A9", growth, 1e3)
    refused = 0
    try:
        Simulation(scene, dt=1.01 * sim.dt_limit)
    except InputError:
        refused = 1
    yield at_least("refused above the limit", "A9", refused, 1)


@case("visco", slow=True)
def precisions() -> Iterator[Measurement]:
    """Mixed and single precision against double: held bodies that flow by 2e-5 of all a step."""
    shear = np.array([[0.0, 1e-3], [1e-3, 0.0]])
    pull = np.array([[0.0, 0.0], [0.0, 1e-3]])
    for plane, law, start, rate in (
        ("strain", Maxwell(2e4), shear, 0.0 * shear),
        ("stress", KelvinVoigt(5e4), 0.0 * pull, pull / 40.0),
    ):
        p, found = _cells(plane), {}
        for precision in ("float64", "mixed", "float32"):
            scene = Scene()
            body = scene.add(p, SOFT, viscous=law)
            scene.strain(body, start)
            velocity, still = (p.position - 2.0) @ rate, ([0.0, 40.0, 40.1], [1.0, 1.0, 0.0])
            scene.hold(body, np.arange(len(p)), velocity, history=still)
            sim = Simulation(scene, precision=precision, dt=0.4, force_dt=True)
            sim.run(until=4e3)
            found[precision] = sim.stress[~p.boundary(1)][:, :2, :2]
        exact = found["float64"]
        for precision, limit in (("mixed", 1e-6), ("float32", 1e-5)):
            error = float(np.abs(found[precision] - exact).max() / np.abs(exact).max())
            what = f"stress in {precision} against float64, {type(law).__name__}"
            yield vanishing(what, "B12", error, limit)


@case("visco")
def many_laws() -> Iterator[Measurement]:
    """Grains of five laws and stiffnesses in one spinning body: ledger, momenta, energy falls."""
    for plane in SPACES:
        p = _cells(plane)
        rng = np.random.default_rng(0)
        laws: list[ViscousLaw | None] = [*EVERY.values(), None]
        materials = [Material(1.0 + 0.5 * k, 0.1 * k, 1.0) for k in range(5)]
        x = p.position - np.average(p.position, axis=0, weights=p.volume)
        turn = np.array([0.0, 0.0, 0.01])
        velocity = np.cross(turn, reference.in_space(x))[:, : p.dim]
        velocity += 1e-4 * rng.normal(size=x.shape)
        scene = Scene()
        grain = rng.integers(0, 5, len(p))
        body = scene.add(p, materials, grain=grain, viscous=laws)
        scene.set_velocity(body, velocity, turn[2:] if plane else turn)
        sim = Simulation(scene)
        held, momenta = [_held(sim.energy())], [_momenta(sim)]
        for _ in range(100):
            sim.run(steps=10)
            held.append(_held(sim.energy()))
        momenta.append(_momenta(sim))
        lost = held[0] - held[-1]
        where = _named(plane)
        residual = sim.energy()["residual"] / held[0]
        yield vanishing(f"residual over the initial energy, {where}", "ledger", residual, 2e-4)
        rise = max(0.0, float(np.diff(held).max())) / lost
        yield vanishing(f"greatest rise over the energy taken, {where}", "B12", rise, 1e-6)
        change = max(
            float(np.abs(after - before).max() / size)
            for before, after, size in zip(*momenta, _sizes(sim, velocity, x), strict=True)
        )
        yield vanishing(f"change of momenta over their size, {where}", "Newton", change, 1e-12)

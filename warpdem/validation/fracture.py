"""Fracture: criteria, toughness, softening, scatter, the ledger of breaking bodies (theory B10)."""

from collections.abc import Iterator
from functools import cache
from itertools import product
from math import cos, log, pi, sqrt

import numpy as np

from .. import packing
from ..bond import EVMBond
from ..criteria import (
    BeamLimit,
    Criterion,
    DamageRate,
    DruckerPrager,
    Fracture,
    HuberMisesHencky,
    Incubation,
    LinearSoftening,
    MixedMode,
    MohrCoulomb,
    Rankine,
)
from ..errors import Array
from ..material import Material
from ..scene import Scene
from ..section import Circle
from ..simulation import Simulation
from ..toughness import Toughness, tip_ratio
from . import reference
from .case import Measurement, case
from .core import facet_body, small_packing, vanishing
from .tip import Griffith, patches, tip_tensors

GLASS = Material(1.0, 0.25, 1.0)
STRESS = 1e-5  # of cracked bodies: strains are small

# criteria in homogeneous states, the strength 1
LAWS: tuple[Criterion, ...] = (
    HuberMisesHencky(1.0),
    DruckerPrager(1.0, 3.0),
    DruckerPrager(1.0, 10.0),
    Rankine(1.0),
    MohrCoulomb(0.5 / cos(0.5), 0.5),
    MohrCoulomb(0.5 / cos(0.5), 0.5, 0.3),
)


def _states(dim: int) -> dict[str, Array]:
    """Strains: along an axis, shear, equal ones, and turned and general ones."""
    rng = np.random.default_rng(13)
    general = rng.normal(size=(dim, dim))
    q, _ = np.linalg.qr(rng.normal(size=(dim, dim)))
    along = np.zeros((dim, dim))
    along[0, 0] = 1.0
    shear = np.zeros((dim, dim))
    shear[0, 1] = shear[1, 0] = 0.5
    return {
        "tension": along,
        "compression": -along,
        "shear": shear,
        "equal": np.eye(dim),
        "turned tension": q @ along @ q.T,
        "general": general + general.T,
    }


@case("fracture")
def criteria_in_uniform_stress() -> Iterator[Measurement]:
    """The ratio at which every inner bond stands, against the continuum criterion's."""
    for name, law in product(
        ("hex strain", "hex stress", "fcc", "voronoi strain", "voronoi stress", "voronoi space"),
        LAWS,
    ):
        p = small_packing(name)
        inner = ~p.boundary(layers=2)
        inside = inner[p.bonds].all(axis=1)
        worst = 0.0
        for strain in _states(p.dim).values():
            scene, body = facet_body(p, 0.3, law)
            scene.strain(body, 1e-6 * strain)
            scene.hold(body, np.arange(len(p)))
            sim = Simulation(scene, dt=1.0)
            sim.run(steps=1)
            exact = reference.hooke(1e-6 * strain, 1.0, 0.3, p.plane)
            level = max(reference.equivalent_stress(exact, law.kind, law.numbers), 0.0)
            ratio = sim.criterion_ratio[inside] * law.strength
            size = max(level, np.abs(exact).max())
            worst = max(worst, float(np.abs(ratio - level).max() / size))
        what = f"equivalent stress, {name}, {law.kind} {law.numbers}"
        yield vanishing(what, "Shilko eqs 13-14", worst, 1e-8)


# -- cracks ---------------------------------------------------------------------------------------


@cache
def _griffith(half_length: float) -> tuple[float, float]:
    """Energy release rate over K^2/E', and ratio of a Rankine criterion over sqrt(pi a)."""
    crack = Griffith.of(half_length, 20.0)
    law = Rankine(1.0)
    sims = [crack.at_rest(GLASS, STRESS, longer, law) for longer in (-0.5, 0.0, 0.5)]
    shorter, longer = (sum(s.energy()[k] for k in ("pair", "volume")) for s in sims[::2])
    release = (shorter - longer) / 2.0  # each end grew by one spacing
    sims[1].run(steps=1)
    seen = float(sims[1].criterion_ratio.max()) / STRESS
    k = sqrt(pi * half_length)
    return release / (STRESS**2 * pi * half_length / GLASS.plane_modulus()), seen / k


@case("fracture")
def energy_release_rate() -> Iterator[Measurement]:
    """A crack in an infinite plate: energy that its growth by a spacing releases, over K^2/E'."""
    for half_length in (8.0, 16.0):
        found = _griffith(half_length)[0]
        what = f"G E'/K^2, half-length {half_length:g} spacings"
        yield Measurement(what, 1.0, "Irwin 1957", found, abs(found - 1.0), 0.03)


@case("fracture")
def griffith() -> Iterator[Measurement]:
    """Fracture stress times the root of the crack's half-length, over 8 to 16 spacings."""
    yield from _constant((8.0, 16.0))


@case("fracture", slow=True)
def long_griffith() -> Iterator[Measurement]:
    """The same over 8 to 40 spacings."""
    yield from _constant((8.0, 16.0, 28.0, 40.0))


def _constant(lengths: tuple[float, ...]) -> Iterator[Measurement]:
    product = np.array([1.0 / _griffith(a)[1] for a in lengths])
    spread = float(np.ptp(product) / product.mean())
    yield vanishing("spread of fracture stress sqrt(a)", "Griffith 1921", spread, 0.05)


@case("fracture")
def toughness_and_spacing() -> Iterator[Measurement]:
    """A crack of one length and K_Ic at 10, 20 and 40 spacings: the stress at which it breaks."""
    toughness = 2e-5
    exact = toughness / sqrt(pi)
    found = []
    for cells in (10.0, 20.0, 40.0):
        # lengths in units of the half-length: K_Ic sqrt(cells) per spacing^0.5
        law = Toughness(Rankine(1.0), stress_intensity=toughness * sqrt(cells))
        crack = Griffith.of(cells, 16.0)
        sim = crack.at_rest(GLASS, exact, 0.0, law)
        sim.run(steps=1)
        found.append(exact / float(sim.criterion_ratio.max()))
        error = abs(found[-1] / exact - 1.0)
        what = f"fracture stress, half-length {cells:g} spacings"
        yield Measurement(what, exact, "K_Ic/sqrt(pi a)", found[-1], error, 0.05)
    spread = float(np.ptp(found) / np.mean(found))
    yield vanishing("spread over a factor 4 of spacing", "toughness mode", spread, 0.05)


@case("fracture")
def tip_table() -> Iterator[Measurement]:
    """Entries of the table of tip stresses found again, and the figures of theory B10."""
    nu = 0.25
    for mode, quantity, exact in (
        ("I", "normal stress of the pair", 0.818),
        ("II", "shear stress of the pair", 0.440),
        ("II", "intensity of the pair", 1.00),
    ):
        (patch, _) = patches("hexagonal", "strain", 30.0, 2)
        (tensor,) = tip_tensors(patch, mode, nu)
        found = {
            "normal stress of the pair": tensor[0, 0],
            "shear stress of the pair": float(np.hypot(tensor[0, 1], tensor[0, 2])),
            "intensity of the pair": reference.von_mises(tensor),
        }[quantity]
        what = f"{quantity} over K/sqrt(d), hexagonal, mode {mode}"
        yield Measurement(what, exact, "theory B10", found, abs(found / exact - 1.0), 0.02)
    for law in (Rankine(1.0), DruckerPrager(3.0, 3.0), MohrCoulomb(1.0, 0.5)):
        for plane in ("strain", "stress"):
            p = packing.hexagonal((4.0, 4.0), 1.0, plane)
            (patch, _) = patches("hexagonal", plane, 24.0, 2)
            (tensor,) = tip_tensors(patch, "I", nu)
            direct = reference.equivalent_stress(tensor, law.kind, law.numbers) / law.strength
            table = tip_ratio(law, p, nu)
            what = f"table at nu 0.25, plane {plane}, {law.kind}"
            error = abs(table / direct - 1.0)
            yield Measurement(what, direct, "solved anew", table, error, 0.01)


# -- time and scatter -----------------------------------------------------------------------------


def _strained(law: Fracture, ratio: float, dt: float = 1e-3) -> Simulation:
    """Elements held in uniaxial strain, the stress being `ratio` times the strength 1e-3."""
    p = packing.hexagonal((6.0, 5.0), 1.0)
    scene, body = facet_body(p, 0.0, law)
    scene.strain(body, np.diag([0.0, ratio * 1e-3]))
    scene.hold(body, np.arange(len(p)))
    return Simulation(scene, dt=dt)


@case("fracture")
def time_to_fracture() -> Iterator[Measurement]:
    """Constant stress: the time until bonds break by incubation, and by a power of the stress."""
    inner = Rankine(1e-3)
    for ratio in (1.2, 1.5, 2.0):
        for name, law, exact in (
            ("incubation", Incubation(inner, 0.5), 0.5 * log(ratio / (ratio - 1.0))),
            ("power of 4", DamageRate(inner, 1.0, 4.0), ratio**-4.0),
        ):
            sim = _strained(law, ratio, dt=2e-4)
            sim.run(until=1.0)
            found = float(np.median(sim.broken_bonds()["time"]))
            what = f"time to fracture, {name}, stress over strength {ratio:g}"
            source = "T ln(R/(R - 1))" if name == "incubation" else "T/R^n"
            yield Measurement(what, exact, source, found, abs(found / exact - 1.0), 0.01)
    sim = _strained(Incubation(inner, 0.5), 0.98)
    sim.run(until=10.0)
    broken = float(len(sim.broken_bonds()))
    yield vanishing("broken after 20 T at 0.98 of the strength", "static limit", broken, 0.0)


@case("fracture")
def scatter() -> Iterator[Measurement]:
    """Weibull's distribution of strengths, by bond and by element."""
    from scipy.stats import kstest, weibull_min

    p = packing.hexagonal((60.0, 52.0), 1.0)
    for by, shape in (("bond", 1.0), ("element", 0.5 ** (1.0 / 8.0))):
        scene, body = facet_body(p, 0.0, Rankine(1.0))
        scene.scatter_strength(body, 8.0, seed=3, by=by)
        # the lesser of two has the same modulus and a strength 2^(-1/m) as great
        drawn = body.strength_factor
        if by == "element":  # pairs that share no element
            used = np.zeros(len(p), dtype=bool)
            free = []
            for b, (i, j) in enumerate(p.bonds):
                if not used[i] and not used[j]:
                    used[[i, j]] = True
                    free.append(b)
            drawn = drawn[free]
        found = kstest(drawn, weibull_min(8.0, scale=shape).cdf).statistic * sqrt(len(drawn))
        # the 1 % quantile of Kolmogorov's distribution is 1.63
        yield Measurement(
            f"Kolmogorov's statistic of factors by {by}", 0.0, "Weibull", found, found, 1.63
        )


# -- softening and beams --------------------------------------------------------------------------


@case("fracture")
def softening() -> Iterator[Measurement]:
    """A bar pulled apart at its weakest row: energy that the row takes over G_c, and the peak."""
    strength, energy = 1e-3, 2e-5
    for name, plane in (("hexagonal", "strain"), ("square", "stress")):
        p = getattr(packing, name)((6.0, 14.0), 1.0, plane)
        scene = Scene()
        body = scene.add(
            p,
            Material(1.0, 0.0, 1.0),
            fracture=LinearSoftening(Rankine(strength), energy),
            facet_bending=p.has_gears,
        )
        rows = np.unique(np.round(p.position[:, 1], 6))
        y = rows[len(rows) // 2 - 1 : len(rows) // 2 + 1].mean()
        scene.set_strength(body, np.inf)
        crossing = np.flatnonzero((p.position[p.bonds, 1] < y).sum(axis=1) == 1)
        body.strength_factor[crossing] = 1.0
        every = np.arange(len(p))
        scene.hold(body, every, axes="x")
        grip = p.top | p.bottom
        speed = np.where(p.position[grip, 1] > y, 1.0, -1.0)[:, None] * np.array([0.0, 2e-5])
        scene.hold(body, grip, velocity=speed)
        sim = Simulation(scene, local_damping=0.5)
        peak = 0.0
        area = 6.0
        for _ in range(80):
            sim.run(steps=100)
            peak = max(peak, float(sim.force[p.top, 1].sum()) / -area)
            if not sim.linked[crossing].any():
                break
        ledger = sim.energy()
        found = ledger["fracture"] / (area * energy)
        where = f"{name}, plane {plane}"
        yield Measurement(
            f"energy taken over G_c S, {where}", 1.0, "B10", found, abs(found - 1.0), 0.03
        )
        found = peak / strength
        yield Measurement(
            f"peak stress over strength, {where}", 1.0, "B10", found, abs(found - 1.0), 0.03
        )
        yield vanishing(f"ledger residual, {where}", "B13", sim.energy_error, 1e-4)


@case("fracture")
def beams() -> Iterator[Measurement]:
    """Ratio of a BeamLimit at the clamp of a cantilever in tension, bending and twist."""
    section = Circle(0.05)
    limit = BeamLimit(2e-6, 3e-6, section)
    for dim, pull, push, twist in (
        (2, 1e-9, 1e-11, 0.0),
        (3, 1e-9, 1e-11, 0.0),
        (3, 0.0, 0.0, 1e-11),
    ):
        ends = np.zeros((2, dim))
        ends[1, 0] = 1.0
        rod = packing.filament(ends, 16, section)
        scene = Scene()
        bond = EVMBond.bernoulli_euler(GLASS, section, rod.bond_length)
        body = scene.add(rod, GLASS, bond=bond, fracture=limit)
        scene.hold(body, rod.side("start"))
        force = np.zeros(dim)
        force[:2] = pull, push
        scene.load(body, rod.side("end"), force=force)
        if twist:
            scene.load(body, rod.side("end"), torque=(twist, 0.0, 0.0))
        sim = Simulation(scene, dt=1e-9, force_dt=True)
        sim.equilibrate(tolerance=1e-10)
        sim.run(steps=1)
        normal = pull / section.area + push / section.section_modulus
        shear = push / section.area + twist / section.torsion_modulus
        exact = max(normal / limit.tension, shear / limit.shear)
        found = float(sim.criterion_ratio.max())
        what = f"ratio, {dim} dimensions, {'twist' if twist else 'pull and bending'}"
        error = abs(found / exact - 1.0)
        yield Measurement(what, exact, "F/S + M/W, F/S + T/W_t", found, error, 1e-4)


# -- ledgers --------------------------------------------------------------------------------------


@case("fracture")
def ledgers() -> Iterator[Measurement]:
    """Bodies that tear themselves apart at the default dt: what their ledgers leave unexplained.

    Random velocities and a growing strain, at stresses of the order of a thousandth of E.
    """
    inner = Rankine(4e-4)
    laws: dict[str, Fracture] = {
        "Rankine": inner,
        "Drucker-Prager": DruckerPrager(1.2e-3, 3.0),
        "Huber-Mises-Hencky": HuberMisesHencky(4e-4),
        "Mohr-Coulomb": MohrCoulomb(4e-4, 0.5, 3e-4),
        "mixed mode": MixedMode(4e-4, 6e-4),
        "incubation": Incubation(inner, 1.0),
        "power of 4": DamageRate(inner, 2.0, 4.0),
        "softening": LinearSoftening(inner, 2e-6),
    }
    cases = [("voronoi strain", law, "float64") for law in laws]
    cases += [("voronoi strain", law, "float32") for law in ("Rankine", "softening")]
    cases += [("voronoi stress", "Rankine", "float64"), ("voronoi space", "Rankine", "float64")]
    cases += [("hex strain", "Rankine", "mixed"), ("fcc", "softening", "float64")]
    for name, law, precision in cases:
        p = small_packing(name)
        scene, body = facet_body(p, 0.3, laws[law])
        x = p.position - p.position.mean(axis=0)
        rng = np.random.default_rng(2)
        scene.set_velocity(body, 4e-4 * x + 2e-4 * rng.normal(size=x.shape))
        sim = Simulation(scene, precision=precision)
        sim.run(steps=400)
        share = float((sim.integrity < 1.0).mean())
        if not share > 0.02:
            raise AssertionError(f"{name}, {law}: only {share:.1%} of the bonds broke")
        limit = 1e-3 if precision == "float32" else 1e-4
        what = f"residual, {name}, {law}, {precision}, {share:.0%} of the bonds broken or soft"
        yield vanishing(what, "theory B13", sim.energy_error, limit)

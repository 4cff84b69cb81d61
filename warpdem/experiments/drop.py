"""A body falls on a plane and falls into pieces."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan, sqrt
from typing import Annotated, ClassVar, Unpack

import numpy as np

from ..contact import touching_radius
from ..criteria import Rankine
from ..errors import InputError, positive, positive_or_inf
from ..friction import checked_friction
from ..material import Material
from ..moduli import lattice_bond
from ..scene import Scene
from ..simulation import Simulation
from ..write.chart import Chart, Line
from .shared import Options
from .trial import BREAKING, FILES, Run, Stage, Trial, TrialResult, lattice_disc, run_trial

GAP = 2.0  # spacings of fall that are simulated before the body touches
STRAIN = ("pair", "volume", "contact", "integrator")  # what is held but kinetic energy
LOST = ("friction", "damping")
DAMPING = 0.1  # of the dashpots beside the bonds, over critical


@dataclass(frozen=True)
class Drop(Trial):
    """A disc of a hexagonal lattice in plane stress falls from `height` on a plane.

    The run starts two spacings above it, with the speed that the fall to there gives. Strengths of
    bonds are scattered by Weibull's distribution; dashpots beside the bonds have a tenth of
    critical damping. The defaults are plaster.
    """

    diameter: Annotated[float, "Diameter of the disc, m."] = 40e-3
    spacing: Annotated[float, "Distance of elements, m."] = 1e-3
    height: Annotated[float, "Height of its lowest point at first, m."] = 2.0
    gravity: Annotated[float, "Gravity, m/s^2."] = 9.81
    time: Annotated[float, "Length of the run, s."] = 1.5e-3
    young: Annotated[float, "Young's modulus, Pa."] = 3e9
    poisson: Annotated[float, "Poisson's ratio, up to 1/3."] = 0.2
    density: Annotated[float, "Density, kg/m^3."] = 1200.0
    strength: Annotated[float, "Tensile strength, Pa; inf: unbreakable."] = 2e6
    weibull: Annotated[float, "Weibull modulus of the strengths of bonds; inf: all alike."] = 10.0
    friction: Annotated[float, "Coulomb's friction."] = 0.4
    restitution: Annotated[float, "Of contacts between pieces, and with the plane."] = 0.6
    seed: Annotated[int, "Seed of the strengths."] = 0

    name = "drop"
    title = "Drop on a plane"
    files: ClassVar[tuple[str, ...]] = FILES + BREAKING

    def __post_init__(self) -> None:
        for name in ("diameter", "spacing", "height", "gravity", "time"):
            positive(name, getattr(self, name), ())
        for name in ("strength", "weibull"):
            positive_or_inf(name, getattr(self, name))
        checked_friction(self.friction)
        if self.height < self.gap:
            raise InputError(f"the height is {self.height:g} m; give {self.gap:g} m or more.")

    @property
    def gap(self) -> float:
        """Height from which on the fall is simulated [m]."""
        return GAP * self.spacing

    @property
    def impact_speed(self) -> float:
        """sqrt(2 g h) [m/s]."""
        return sqrt(2.0 * self.gravity * self.height)

    @property
    def material(self) -> Material:
        """Of all elements."""
        return Material(self.young, self.poisson, self.density)

    def stage(self) -> Stage:
        """The scene."""
        p = lattice_disc(self.diameter, self.spacing, "stress")
        scene = Scene()
        strength = Rankine(self.strength) if isfinite(self.strength) else None
        bond = lattice_bond(p, self.material, damping=DAMPING)
        body = scene.add(p, self.material, bond=bond, fracture=strength)
        if strength is not None and isfinite(self.weibull):
            scene.scatter_strength(body, self.weibull, self.seed)
        scene.contact(friction=self.friction, restitution=self.restitution)
        low = float((p.position[:, 1] - touching_radius(p)).min())
        plane = scene.wall([0.0, low - self.gap], [0.0, 1.0])
        scene.set_gravity([0.0, -self.gravity])
        scene.set_velocity(body, [0.0, -sqrt(2.0 * self.gravity * (self.height - self.gap))])
        mass = p.volume * self.density
        share = mass / mass.sum()

        ledger = _Ledger()
        return Stage(
            scene=scene,
            until=self.time,
            size=f"disc of {1e3 * self.diameter:g} mm from {self.height:g} m",
            columns={
                "height": lambda sim: float(share @ sim.position[:, 1]) - low + self.gap,
                "speed": lambda sim: float(share @ sim.velocity[:, 1]),
                "sideways": lambda sim: float(share @ sim.velocity[:, 0]),
                "force": lambda sim: -float(sim.wall_force(plane)[1]),
                "kinetic": lambda sim: ledger.of(sim, "kinetic"),
                "strain": lambda sim: ledger.of(sim, *STRAIN),
                "fracture": lambda sim: ledger.of(sim, "fracture"),
                "lost": lambda sim: ledger.of(sim, *LOST),
                "work": lambda sim: ledger.of(sim, "work"),
            },
            units={"height": "m", "speed": "m/s", "sideways": "m/s", "force": "N"}
            | dict.fromkeys(("kinetic", "strain", "fracture", "lost", "work"), "J"),
            shows="velocity",
        )

    def measure(self, run: Run) -> DropResult:
        """What came out."""
        s, sim = run.stage.series, run.sim
        touched = s["force"] > 0.0
        before = int(np.argmax(touched)) - 1 if touched.any() else len(s["time"]) - 1
        # of the last look before the body touches, and what it still has to fall
        speed, left = -s["speed"][before], self.gap - (s["height"][0] - s["height"][before])
        impact = sqrt(speed**2 + 2.0 * self.gravity * max(left, 0.0))
        mass, time = float(sim.model.mass.sum()), s["time"]
        push = 0.5 * ((s["force"][1:] + s["force"][:-1]) * np.diff(time)).sum()
        gained = mass * (s["speed"][-1] - s["speed"][0] + self.gravity * time[-1])
        ledger = sim.energy()
        spent = s["kinetic"][before]
        assert run.pieces is not None
        bodies = run.pieces.pieces
        return DropResult(
            **run.numbers,
            parameters=self,
            impact_speed=impact,
            expected_impact_speed=self.impact_speed,
            impact_speed_error=impact / self.impact_speed - 1.0,
            impact_energy=float(spent),
            kinetic_share=ledger["kinetic"] / spent,
            fracture_share=ledger["fracture"] / spent,
            lost_share=sum(ledger[x] for x in LOST) / spent,
            impulse=push,
            impulse_error=push / gained - 1.0 if gained > 0.0 else nan,
            pieces_at_end=len(bodies),
            largest_share=float(bodies["mass"][0]) / mass,
        )


class _Ledger:
    """The energy ledger of a step, read once."""

    def __init__(self) -> None:
        self.step, self.now = -1, {"kinetic": 0.0}

    def of(self, sim: Simulation, *names: str) -> float:
        """Sum of entries [J]."""
        if self.step != sim.steps:
            self.step, self.now = sim.steps, sim.energy()
        return sum(self.now[n] for n in names)


@dataclass
class DropResult(TrialResult):
    """What came out.

    impact_speed: when the body touches, beside sqrt(2 g h) [m/s]; impact_energy [J] then, and what
    of it is kinetic at the end, was released by cracks, and was taken by friction, restitution and
    dashpots; impulse: of the plane's force [N s] by looks at it, over what momentum and weight
    say; pieces and the largest one's share of the mass.
    """

    impact_speed: float
    expected_impact_speed: float
    impact_speed_error: float
    impact_energy: float
    kinetic_share: float
    fracture_share: float
    lost_share: float
    impulse: float
    impulse_error: float
    pieces_at_end: int
    largest_share: float

    @property
    def told(self) -> list[str]:
        """The result in words."""
        return [
            f"it meets the plane at {self.impact_speed:.6g} m/s; sqrt(2 g h) is "
            f"{self.expected_impact_speed:.6g} m/s: {self.impact_speed_error:+.1e}; impulse of the "
            f"plane {self.impulse:.4g} N s, {self.impulse_error:+.1e} of what momentum says",
            f"{self.pieces_at_end} pieces, the largest with {self.largest_share:.3f} of the mass; "
            f"{self.kinetic_share:.3f} of the energy stays motion, cracks released "
            f"{self.fracture_share:.4f}, friction, restitution and dashpots took "
            f"{self.lost_share:.3f}",
        ]

    @property
    def charts(self) -> list[Chart]:
        """Speed and energies against time."""
        p, s = self.parameters, self.series
        time = 1e3 * s["time"]
        energies = [
            Line(time, s[name], words, color=f"C{k}")
            for k, (name, words) in enumerate((
                ("kinetic", "motion"), ("strain", "strain and contact"),
                ("fracture", "released by cracks"), ("lost", "friction, restitution, dashpots"),
            ))
        ]  # fmt: skip
        return [
            Chart("Speed of the whole, downwards", "time [ms]", "speed [m/s]", [
                Line(time, -s["speed"], "measured"),
                Line(time[[0, -1]], [p.impact_speed] * 2, "sqrt(2 g h)", "--", "k"),
            ]),
            Chart("Where the energy goes", "time [ms]", "energy per metre of thickness [J/m]",
                  energies),
        ]  # fmt: skip


def drop(parameters: Drop | None = None, **options: Unpack[Options]) -> DropResult:
    """A body falls on a plane: sqrt(2 g h), the ledger of energy, its pieces over time.

    options: `shared.Options`.
    """
    result: DropResult = run_trial(parameters or Drop(), **options)
    return result

"""A grain is crushed between two plates, or two grains collide as in a ball mill."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan, pi
from typing import Annotated, ClassVar, Unpack

import numpy as np

from ..contact import touching_radius
from ..criteria import Rankine
from ..errors import Array, InputError, finite, positive, positive_or_inf
from ..friction import checked_friction
from ..material import Material
from ..moduli import lattice_bond
from ..scene import Scene
from ..simulation import Simulation
from ..write.chart import Chart, Line
from .shared import Options, guard
from .trial import BREAKING, FILES, Reader, Run, Stage, Trial, TrialResult, lattice_disc, run_trial

FEW = 5  # broken bonds from which on a crack is seen
GAP = 0.1  # spacings between two grains at first
CROSSINGS = 16.0  # of a grain by a pressure wave, after two have met: then they have parted
DAMPING = 0.1  # of the dashpots beside the bonds, over critical


@dataclass(frozen=True)
class CrushedGrain(Trial):
    """A disc of a hexagonal lattice in plane stress between plates that close at `speed`.

    Elements within `caps` of where the plates touch do not break: there few elements bear all of
    the force, and a bare grain (0) splits from under the plates. pair: two such discs meet head on
    at that speed instead, without plates and caps. Strengths of bonds are scattered by Weibull's
    distribution; dashpots beside the bonds have a tenth of critical damping.
    """

    diameter: Annotated[float, "Diameter of the grain, m."] = 20e-3
    spacing: Annotated[float, "Distance of elements, m."] = 0.5e-3
    pair: Annotated[bool, "Two grains collide, without plates."] = False
    speed: Annotated[float, "Speed of approach of the plates, or of the grains, m/s."] = 0.3
    closing: Annotated[float, "Way of the plates at the end, m."] = 0.06e-3
    caps: Annotated[float, "Reach of the unbreakable caps under plates, over the diameter."] = 0.2
    young: Annotated[float, "Young's modulus, Pa."] = 40e9
    poisson: Annotated[float, "Poisson's ratio, up to 1/3."] = 0.2
    density: Annotated[float, "Density, kg/m^3."] = 2600.0
    strength: Annotated[float, "Tensile strength, Pa."] = 10e6
    weibull: Annotated[float, "Weibull modulus of the strengths of bonds; inf: all alike."] = 20.0
    friction: Annotated[float, "Coulomb's friction between fragments, and on plates."] = 0.3
    seed: Annotated[int, "Seed of the strengths."] = 0

    name = "crushed-grain"
    title = "Crushed grain"
    files: ClassVar[tuple[str, ...]] = FILES + BREAKING

    def __post_init__(self) -> None:
        for name in ("diameter", "spacing", "speed", "closing", "strength"):
            positive(name, getattr(self, name), ())
        positive_or_inf("weibull", self.weibull)
        checked_friction(self.friction)
        if not 0.0 <= finite("caps", self.caps, ()) < 0.4:
            raise InputError(f"caps is {self.caps:g}; give 0 to below 0.4.")
        if self.diameter < 10.0 * self.spacing:
            raise InputError(
                f"the grain is {self.diameter / self.spacing:.3g} elements across; give 10 or more."
            )

    @property
    def material(self) -> Material:
        """Of all elements."""
        return Material(self.young, self.poisson, self.density)

    def stage(self) -> Stage:
        """The scene."""
        scene = Scene()
        radius, count = 0.5 * self.diameter, 2 if self.pair else 1
        grains, reach = [], []
        for k in range(count):
            p = lattice_disc(self.diameter, self.spacing, "stress")
            bond = lattice_bond(p, self.material, damping=DAMPING)
            grains.append(
                scene.add(
                    p, self.material, bond=bond,
                    fracture=Rankine(self.strength),
                )
            )  # fmt: skip
            if isfinite(self.weibull):
                scene.scatter_strength(grains[-1], self.weibull, self.seed + k)
            if not self.pair:
                pole = radius * np.array([[0.0, 1.0], [0.0, -1.0]])[:, None]
                away = np.linalg.norm(p.position - pole, axis=2).min(axis=0)
                capped = away < self.caps * self.diameter
                guard(grains[-1], capped, 0)
            r, y = touching_radius(p), p.position[:, 1]
            reach.append((float((y - r).min()), float((y + r).max())))
        scene.contact(friction=self.friction)
        columns: dict[str, Reader] = {
            "broken_bonds": lambda sim: len(sim.broken_bonds()),
        }
        units = {"force": "N", "stress": "Pa"}
        if self.pair:
            grains[1].displacement[:, 1] = reach[0][1] - reach[1][0] + GAP * self.spacing
            for k, way in enumerate((0.5, -0.5)):
                scene.set_velocity(grains[k], [0.0, way * self.speed])
            mass = np.concatenate([g.packing.volume * self.density for g in grains])
            columns["lower_speed"] = lambda sim: _mean(sim, sim.elements(grains[0]), mass)
            columns["upper_speed"] = lambda sim: _mean(sim, sim.elements(grains[1]), mass)
            columns["kinetic"] = lambda sim: sim.energy()["kinetic"]
            units |= {"lower_speed": "m/s", "upper_speed": "m/s", "kinetic": "J"}
        else:
            low = scene.wall([0.0, reach[0][0]], [0.0, 1.0], velocity=[0.0, 0.5 * self.speed])
            high = scene.wall([0.0, reach[0][1]], [0.0, -1.0], velocity=[0.0, -0.5 * self.speed])
            area = 0.5 * pi * self.diameter * grains[0].packing.thickness

            def force(sim: Simulation) -> float:
                return 0.5 * float(sim.wall_force(high)[1] - sim.wall_force(low)[1])

            columns["closing"] = lambda sim: self.speed * sim.time
            columns["force"] = force
            columns["stress"] = lambda sim: force(sim) / area
            units |= {"closing": "m"}
        until = self.closing / self.speed
        if self.pair:
            crossing = self.diameter / grains[0].materials[0].pressure_speed("stress")
            until = GAP * self.spacing / self.speed + CROSSINGS * crossing
        return Stage(
            scene=scene,
            until=until,
            size=f"{'two discs' if self.pair else 'disc'} of {1e3 * self.diameter:g} mm at "
            f"{self.speed:g} m/s",
            columns=columns,
            units=units,
        )

    def measure(self, run: Run) -> CrushedGrainResult:
        """What came out."""
        s, sim = run.stage.series, run.sim
        cracked = int(np.argmax(s["broken_bonds"] >= FEW)) if s["broken_bonds"].max() >= FEW else 0
        crack = peak = restitution = drift = nan
        if self.pair:
            v = np.stack([s["lower_speed"], s["upper_speed"]])
            drift = float(np.abs(v.sum(axis=0)).max() / self.speed)
            restitution = float((v[1, -1] - v[0, -1]) / self.speed)
        else:
            crack = float(s["stress"][cracked]) if cracked else nan
            peak = float(s["stress"].max())
        ledger = sim.energy()
        return CrushedGrainResult(
            **run.numbers,
            parameters=self,
            first_crack_time=float(s["time"][cracked]) if cracked else nan,
            first_crack_stress=crack,
            first_crack_over_strength=crack / self.strength,
            greatest_stress=peak,
            greatest_over_strength=peak / self.strength,
            restitution=restitution,
            momentum_error=drift,
            energy_of_cracks=ledger["fracture"],
            pieces_at_end=1 if run.pieces is None else len(run.pieces.pieces),
        )


def _mean(sim: Simulation, own: slice, mass: Array) -> float:
    return float(mass[own] @ sim.velocity[own, 1] / mass[own].sum())


@dataclass
class CrushedGrainResult(TrialResult):
    """What came out; stresses are 2P/(pi D t) [Pa], NaN of a pair.

    first_crack_time [s], first_crack_stress: with the fifth broken bond; greatest_stress: until
    the grain has fallen apart; both beside the strength.
    Of a pair: restitution, speed of parting of the grains' masses over that of approach, and
    momentum_error, what of the speed is left over in the sum of both. energy_of_cracks [J].
    """

    first_crack_time: float
    first_crack_stress: float
    first_crack_over_strength: float
    greatest_stress: float
    greatest_over_strength: float
    restitution: float
    momentum_error: float
    energy_of_cracks: float
    pieces_at_end: int

    @property
    def told(self) -> list[str]:
        """The result in words."""
        p = self.parameters
        if p.pair:
            return [
                f"restitution {self.restitution:.4f}; momentum is kept to {self.momentum_error:.1e}"
                f"; {self.pieces_at_end} pieces, {self.energy_of_cracks:.3g} J in their cracks"
            ]
        return [
            f"first crack at 2P/(pi D t) = {self.first_crack_stress / 1e6:.4g} MPa, "
            f"{self.first_crack_over_strength:.3f} of the strength; the grain bears up to "
            f"{self.greatest_stress / 1e6:.4g} MPa, {self.greatest_over_strength:.3f} of it; "
            f"{self.pieces_at_end} pieces"
        ]

    @property
    def charts(self) -> list[Chart]:
        """Force against closing, or speeds against time, and pieces."""
        p, s = self.parameters, self.series
        if p.pair:
            time = 1e6 * s["time"]
            first = Chart("Mean speeds of the grains", "time [µs]", "speed [m/s]", [
                Line(time, s["lower_speed"], "lower"),
                Line(time, s["upper_speed"], "upper", color="C3"),
                Line(time, s["lower_speed"] + s["upper_speed"], "sum", "--", "k"),
            ])  # fmt: skip
            return [first, self._pieces()]
        ends = 1e6 * s["closing"][[0, -1]]
        force = Chart("Stress in the grain", "closing of the plates [µm]", "2P/(pi D t) [MPa]", [
            Line(1e6 * s["closing"], 1e-6 * s["stress"], "measured"),
            Line(ends, [1e-6 * p.strength] * 2, "tensile strength", "--", "k"),
        ])  # fmt: skip
        if isfinite(self.first_crack_time):
            at = [1e6 * self.first_crack_time * p.speed]
            force.lines.append(Line(at, [1e-6 * self.first_crack_stress], "first crack", "o", "C3"))
        return [force, self._pieces()]

    def _pieces(self) -> Chart:
        assert self.pieces is not None
        h = self.pieces.history
        share = h["largest_mass"] / self.pieces.pieces["mass"].sum()
        title = f"Pieces over time: the largest has {share[-1]:.2f} of the mass"
        return Chart(title, "time [µs]", "number of pieces; broken bonds / 10", [
            Line(1e6 * h["time"], h["pieces"], "pieces"),
            Line(1e6 * self.series["time"], 0.1 * self.series["broken_bonds"],
                 "broken bonds / 10", "--", "C3"),
        ])  # fmt: skip


def crushed_grain(
    parameters: CrushedGrain | None = None, **options: Unpack[Options]
) -> CrushedGrainResult:
    """A grain is crushed between plates, 2P/(pi D t) beside its strength; or two collide.

    options: `shared.Options`.
    """
    result: CrushedGrainResult = run_trial(parameters or CrushedGrain(), **options)
    return result

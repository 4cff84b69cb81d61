"""The notched concrete beam of John and Shah, hit at midspan (theory C3 row 37)."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Annotated, Any, Unpack

import numpy as np

from ..criteria import LinearSoftening, Rankine
from ..errors import InputError, positive
from ..observe import CrackTracker
from ..observe.growth import path_angle
from ..packing import Packing
from ..scene import Body, Scene
from ..simulation import Simulation
from .free_crack import PACKINGS, CrackRun, Expected, FreeCrack, FreeCrackResult, free_crack
from .shared import Options, guard

LENGTH, DEPTH, SPAN, NOTCH = 0.2286, 0.0762, 0.2032, 0.019  # m
MIDSPAN = 0.5 * LENGTH  # m from the left end
THROUGH = 0.75  # of the depth: a crack that reaches it has failed the beam
AFTER = 1e-4  # s that a run goes on then
TRANSITION = 0.77  # gamma_t, measured by John and Shah (1990)


def through(crack: CrackTracker) -> list[tuple[float, int, float]]:
    """Cracks that came through, the first first: time [s], number, place of the foot [m]."""
    log, found, cracks = crack.log, crack.branches(), []
    for number in {b.crack for b in found}:
        rows = np.concatenate([b.rows for b in found if b.crack == number])
        y = log["y"][rows]
        if y.min() < 0.5 * DEPTH and y.max() > THROUGH * DEPTH:
            time = float(log["time"][rows[y > THROUGH * DEPTH]].min())
            cracks.append((time, number, float(log["x"][rows[y.argmin()]])))
    return sorted(cracks)


class Through:
    """Ends a run soon after a crack came through: the halves crush what they turn about then."""

    every = 200

    def observe(self, sim: Simulation) -> None:
        """Look at the cracks."""
        crack = CrackTracker()
        crack.finish(sim)
        cracks = through(crack)
        if cracks and cracks[0][0] + AFTER < sim.time:
            sim.stop()

    def finish(self, sim: Simulation) -> None:
        """Nothing is left to do."""


@dataclass(frozen=True)
class JohnShah(FreeCrack):
    """What is simulated. SI units.

    A concrete beam 228.6 mm long and 76.2 mm deep on supports 203.2 mm apart, in plane stress,
    with a notch of 19 mm at gamma times half the span from midspan. A support is an element that is
    held in height; those on top within a spacing of midspan move down at a velocity that grows
    linearly, and then stays. A bond's stress falls linearly once its greatest principal stress
    exceeds the tensile strength, and it takes the fracture energy. The notch does not close. The
    run ends soon after a crack came through. Material and load are after Belytschko, Organ and
    Gerlach (2000), of the tests of John and Shah (1990).
    """

    spacing: Annotated[float, "Distance of elements, m."] = 1.5e-3
    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "voronoi"
    young: Annotated[float, "Young's modulus, Pa."] = 31.4e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.2
    density: Annotated[float, "Density, kg/m^3."] = 2400.0
    fracture_energy: Annotated[float, "G_c, J/m^2."] = 31.1
    duration: Annotated[float, "Time simulated, s."] = 1.7e-3
    gamma: Annotated[float, "Distance of the notch from midspan over half the span."] = 0.7
    strength: Annotated[float, "Tensile strength, Pa."] = 10.45e6
    speed: Annotated[float, "Of the hit place in the end, m/s."] = 0.065
    rise: Annotated[float, "Time in which it reaches that, s."] = 196e-6

    name = "john-shah"
    title = "John and Shah's beam"
    size = (LENGTH, DEPTH)
    plane = "stress"
    ends = (Through(),)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("strength", "speed", "rise"):
            positive(name, getattr(self, name), ())
        if not 0.0 <= self.gamma <= 0.95:
            raise InputError(
                f"gamma is {self.gamma:g}; a notch between midspan and the support has one from "
                "0 to 0.95."
            )

    @property
    def tip(self) -> tuple[float, float]:
        """Tip of the notch [m]."""
        return MIDSPAN - 0.5 * self.gamma * SPAN, NOTCH

    def build(self, beam: Packing) -> tuple[Scene, Body]:
        """The notched beam on its supports, hit at midspan."""
        law = LinearSoftening(Rankine(self.strength), self.fracture_energy)
        beam = beam.slit((self.tip[0], -NOTCH), self.tip)
        scene = Scene()
        body = scene.add(beam, self.material, fracture=law)
        x = beam.position[:, 0]
        hit = beam.top & (np.abs(x - MIDSPAN) < self.spacing)
        supports = np.zeros(len(beam), dtype=bool)
        for place in (MIDSPAN - 0.5 * SPAN, MIDSPAN + 0.5 * SPAN):
            # one element each, about which the beam turns freely
            supports[np.where(beam.bottom, np.abs(x - place), np.inf).argmin()] = True
        # forces on single elements are no test of the bonds there
        guard(body, hit | supports, 0)
        scene.hold(body, supports, axes="y", rotation=False)
        history = ([0.0, self.rise], [0.0, 1.0])
        scene.hold(body, hit, (0.0, -self.speed), axes="y", rotation=False, history=history)
        return scene, body

    @property
    def expected(self) -> Expected:
        """Where notches do not fail the beam, as published for the defaults."""
        notches = (((self.tip[0], 0.0), self.tip),)
        given = JohnShah(
            self.spacing, self.packing, self.rows, self.seed, duration=self.duration,
            gamma=self.gamma,
        )  # fmt: skip
        if self != given:  # of another material or load
            return Expected(notches)
        left, right = (MIDSPAN - 0.5 * g * SPAN for g in (1.0, TRANSITION))
        corners = np.array([[left, 0.0], [right, 0.0], [right, NOTCH], [left, NOTCH]])
        return Expected(notches, lines={f"beyond the published gamma_t = {TRANSITION}": corners})

    def measure(self, run: CrackRun) -> dict[str, Any]:
        """The first crack that came through, and its foot; the angle of the notch's."""
        own, cracks = run.own, through(run.crack)
        found: dict[str, Any] = {"angle_degrees": path_angle(own[0].path) if own else nan}
        if not cracks:
            nothing = {"fails_from": "nothing", "fails_at_gamma": nan, "failure_time": nan}
            return found | nothing
        time, number, foot = cracks[0]
        at_notch = bool(own) and own[0].crack == number
        return found | {
            "fails_from": "notch" if at_notch else "midspan",
            "fails_at_gamma": (MIDSPAN - foot) / (0.5 * SPAN),
            "failure_time": time,
        }


@dataclass
class JohnShahResult(FreeCrackResult):
    """What came out.

    fails_from: "notch", "midspan" (any other crack) or "nothing", by the first crack that came
    through, to a quarter of the depth from the top; fails_at_gamma: distance of its foot from
    midspan over half the span, which is gamma, about zero, or NaN; failure_time [s]: when it came
    through; angle_degrees: of the crack at the notch to the beam, by a robust fit to the whole of
    its path, NaN if there is none.
    """

    fails_from: str
    fails_at_gamma: float
    failure_time: float
    angle_degrees: float

    @property
    def told(self) -> list[str]:
        """The result in words."""
        if self.fails_from == "nothing":
            return [*super().told, "the beam did not fail; raise --duration"]
        place = "its notch" if self.fails_from == "notch" else self.fails_from
        failure = (
            f"the beam fails from {place} (at gamma {self.fails_at_gamma:.3f}) after "
            f"{self.failure_time * 1e6:.4g} µs"
        )
        return [*super().told, failure]


def john_shah(parameters: JohnShah | None = None, **options: Unpack[Options]) -> JohnShahResult:
    """Hit a notched concrete beam: does it fail from the notch or from midspan?

    options: `shared.Options`.
    """
    return free_crack(parameters or JohnShah(), JohnShahResult, **options)

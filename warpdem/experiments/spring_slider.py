"""Sliders of rate-and-state friction pulled through springs softer and stiffer than critical."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import log, nan, pi, sin
from typing import Annotated, ClassVar, Unpack

import numpy as np

from ..bond import EVMBond
from ..errors import Array, InputError, one_of, positive
from ..friction import LAWS, RateAndState
from ..material import Material
from ..packing import Packing
from ..scene import Scene
from ..simulation import Simulation
from ..write.chart import Chart, Line
from .shared import Options
from .trial import Reader, Run, Stage, Trial, TrialResult, run_trial

NAMES = ("soft", "stiff")
APART = 20.0  # radii between the sliders, and from each to the far end of its spring: 4
LOADING = 200.0  # times the rate: how fast the springs are stretched at first, on average
STEADY = 12.0  # times Dc over the rate, until the step


@dataclass(frozen=True)
class SpringSlider(Trial):
    """Two spheres pressed on a plane, which do not turn, drawn by springs whose far ends move.

    The springs are stretched quickly until they bear mu0 times the pressing force, then drawn at
    `rate`, and from the time of the velocity step on at `step` times it. Stiffnesses are those of
    spring and contact in series, over the critical one, N (b - a)/Dc (Ruina 1983). The defaults are
    granite of 10 mm across, fast enough (10 mm/s over 10 micrometres) for some 10^4 steps, slow
    enough that inertia, m V^2/(N a Dc), is 10^-4.
    """

    soft: Annotated[float, "Stiffness of the first over the critical one."] = 0.9
    stiff: Annotated[float, "Stiffness of the second over the critical one."] = 1.1
    rate: Annotated[float, "Speed of the far ends before the step, V0, m/s."] = 1e-2
    step: Annotated[float, "Their speed after the step over that before."] = 1.1
    swings: Annotated[float, "Length of the run after the step, in swings."] = 6.0
    law: Annotated[str, f"How the state evolves: {', '.join(LAWS)}."] = "aging"
    mu0: Annotated[float, "Friction in steady slip at V0."] = 0.6
    a: Annotated[float, "Direct effect."] = 0.010
    b: Annotated[float, "Effect of the state, above a."] = 0.015
    slip: Annotated[float, "Slip over which the state is renewed, Dc, m."] = 1e-5
    force: Annotated[float, "Pressing force N on each slider, N."] = 1e4
    radius: Annotated[float, "Radius of the sliders, m."] = 5e-3
    young: Annotated[float, "Young's modulus, Pa."] = 60e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.25
    density: Annotated[float, "Density, kg/m^3."] = 2700.0

    name = "spring-slider"
    title = "Spring sliders"

    def __post_init__(self) -> None:
        one_of("law", self.law, LAWS)
        for name in ("soft", "stiff", "rate", "step", "swings", "slip", "force", "radius"):
            positive(name, getattr(self, name), ())
        if not self.b > self.a:
            raise InputError(
                f"b is {self.b:g}, a {self.a:g}: friction that grows with the rate has no critical "
                "stiffness; give b above a."
            )
        if not max(self.soft, self.stiff) * self.critical_stiffness < self.contact_stiffness:
            raise InputError(
                "the springs would have to be stiffer than the contact itself; lower force, or "
                "raise slip or young."
            )

    @property
    def friction(self) -> RateAndState:
        """The law; its state has come to that of steady slip when the springs are stretched."""
        early = self.slip / self.rate
        if self.law == "aging":  # which ages without slip
            early -= self.loading_time
        return self._law(early)

    def _law(self, state: float) -> RateAndState:
        return RateAndState(self.mu0, self.a, self.b, self.rate, self.slip, self.law, state)

    @property
    def loading_time(self) -> float:
        """Until the springs bear mu0 N [s], the softer a little later than the stiffer."""
        stretch = self.mu0 * self.slip / (self.b - self.a)
        return stretch / (LOADING * self.rate)

    @property
    def critical_stiffness(self) -> float:
        """N (b - a)/Dc [N/m]."""
        return self._law(1.0).critical_stiffness(self.force)

    @property
    def material(self) -> Material:
        """Of the sliders."""
        return Material(self.young, self.poisson, self.density)

    @property
    def contact_stiffness(self) -> float:
        """Of a contact along the plane [N/m]: 2 G S/R with S = pi R^2 (equations, B11)."""
        return 2.0 * self.material.shear_modulus * pi * self.radius

    @property
    def sag(self) -> float:
        """Overlap at which the contact bears the force [m]."""
        m = self.material
        return self.force / ((m.lame() + 2.0 * m.shear_modulus) * pi * self.radius)

    def spring(self, share: float) -> float:
        """Stiffness of the spring alone [N/m]."""
        return 1.0 / (1.0 / (share * self.critical_stiffness) - 1.0 / self.contact_stiffness)

    @property
    def step_time(self) -> float:
        """Of the velocity step [s]."""
        return self.loading_time + STEADY * self.slip / self.rate

    def drive(self, time: float, share: float) -> float:
        """Speed of a spring's far end [m/s]."""
        if time < self.loading_time:
            # smooth, so that whole steps add up to the way of the integral
            return 2.0 * LOADING * self.rate / share * sin(pi * time / self.loading_time) ** 2
        return self.rate * (self.step if time >= self.step_time else 1.0)

    def _drive_over_rate(self, share: float, time: float) -> float:
        return self.drive(time, share) / self.rate

    def growth(self, share: float) -> float:
        """Of small swings from one to the next, without inertia."""
        real, turn = self._root(share)
        return float(np.exp(2.0 * pi * real / turn))

    def swing_time(self, share: float) -> float:
        """Period of small swings after the step [s]."""
        return 2.0 * pi / self._root(share)[1] * self.slip / (self.rate * self.step)

    def _root(self, share: float) -> tuple[float, float]:
        # a s^2 + (k - (b - a)) s + k = 0 of k Dc/N and s Dc/V (Ruina 1983)
        k = share * (self.b - self.a)
        root = np.roots([self.a, k - (self.b - self.a), k])[0]
        return float(root.real), abs(float(root.imag)) or nan

    def stage(self) -> Stage:
        """The scene."""
        r, scene = self.radius, Scene()
        volume = 4.0 / 3.0 * pi * r**3
        for share, z in ((self.soft, 0.0), (self.stiff, APART * r)):
            p = Packing(
                np.array([[0.0, 0.0, z], [4.0 * r, 0.0, z]]),
                np.full(2, volume),
                np.array([[1, 0]]),
                radius=np.array([r, 0.1 * r]),
            )
            k = self.spring(share)
            body = scene.add(p, self.material, bond=EVMBond(k, 0.0, 1e-2 * k * r**2))
            scene.hold(body, [0], axes="yz")
            scene.hold(
                body, [1], velocity=[self.rate, 0.0, 0.0],
                history=partial(self._drive_over_rate, share),
            )  # fmt: skip
        scene.contact(friction=self.friction)
        plane = scene.wall([0.0, self.sag - r, 0.0], [0.0, 1.0, 0.0])
        longest = max(self.swing_time(share) for share in (self.soft, self.stiff))
        columns: dict[str, Reader] = {"pressing_force": lambda sim: -0.5 * sim.wall_force(plane)[1]}
        for k, name in enumerate(NAMES):
            columns[f"{name}_spring_force"] = partial(_spring_force, spring=k)
            columns[f"{name}_speed"] = partial(_speed, slider=2 * k)
        return Stage(
            scene=scene,
            until=self.step_time + self.swings * longest,
            size=f"{self.soft:g} and {self.stiff:g} of the critical stiffness "
            f"{self.critical_stiffness:.4g} N/m, {self.law} law",
            columns=columns,
            units={"pressing_force": "N"}
            | {f"{n}_spring_force": "N" for n in NAMES}
            | {f"{n}_speed": "m/s" for n in NAMES},
            shows="velocity",
        )

    def integrated(self, share: float, times: Array) -> Array:
        """Force of the spring over N by SciPy, with the slider's mass and its contact's give."""
        from scipy.integrate import solve_ivp

        law, k, contact = self.friction, self.spring(share), self.contact_stiffness
        mass = self.density * 4.0 / 3.0 * pi * self.radius**3

        def change(time: float, y: Array) -> list[float]:
            stretch, v, give, theta = y
            psi = (law.mu0 + law.b * log(law.V0 * theta / law.Dc)) / law.a
            # both factors of the slip rate may overflow, not their product
            force = contact * give / (self.force * law.a)
            slips = law.V0 * (np.exp(force - psi) - np.exp(-force - psi))
            x = abs(slips) * theta / law.Dc
            aging = 1.0 - x if law.law == "aging" else -x * log(max(x, 1e-300))
            pull = (k * stretch - contact * give) / mass
            return [self.drive(time, share) - v, pull, v - slips, aging]

        edges = [0.0, self.loading_time, self.step_time, times[-1]]
        y, found = np.array([0.0, 0.0, 0.0, law.theta0 or 0.0]), [np.zeros(1)]
        for start, end in pairwise(edges):
            own = times[(times > start) & (times <= end)]

            # within an edge the drive is that of its middle, whose value at the edge is the next's
            def inner(t: float, y: Array, end: float = end) -> list[float]:
                return change(min(t, end * (1.0 - 1e-12)), y)

            with np.errstate(over="ignore", invalid="ignore"):  # where it tries too long a step
                solved = solve_ivp(
                    inner, (start, end), y, "Radau", np.unique(np.append(own, end)),
                    rtol=1e-8, atol=[1e-13, 1e-9, 1e-15, 1e-12],
                )  # fmt: skip
            y = solved.y[:, -1]
            found.append(k * solved.y[0, : len(own)] / self.force)
        return np.concatenate(found)

    def measure(self, run: Run) -> SpringSliderResult:
        """What came out."""
        series, time = run.stage.series, run.stage.series["time"]
        forces = {n: series[f"{n}_spring_force"] / self.force for n in NAMES}
        shares = dict(zip(NAMES, (self.soft, self.stiff), strict=True))
        wanted = {n: self.integrated(shares[n], time) for n in NAMES}
        growth = {n: _growth(time, forces[n], self.step_time) for n in NAMES}
        mass = run.sim.model.mass[0]
        return SpringSliderResult(
            **run.numbers,
            parameters=self,
            critical_stiffness=self.critical_stiffness,
            pressing_force=float(series["pressing_force"].mean()),
            soft_growth=growth["soft"],
            soft_expected_growth=self.growth(self.soft),
            stiff_growth=growth["stiff"],
            stiff_expected_growth=self.growth(self.stiff),
            soft_error=float(np.abs(forces["soft"] - wanted["soft"]).max()),
            stiff_error=float(np.abs(forces["stiff"] - wanted["stiff"]).max()),
            inertia=mass * self.rate**2 / (self.force * self.a * self.slip),
            integrated=wanted,
        )


def _spring_force(sim: Simulation, spring: int) -> float:
    return -float(sim.bond_force[spring, 0])


def _speed(sim: Simulation, slider: int) -> float:
    return float(sim.velocity[slider, 0])


def _growth(time: Array, force: Array, begin: float) -> float:
    """Mean growth of swings from one to the next, of half heights between turns after the step."""
    from scipy.signal import find_peaks

    late = time > begin
    f = force[late]
    turns = np.sort(np.concatenate([find_peaks(s * f, prominence=1e-6)[0] for s in (1.0, -1.0)]))
    height = np.abs(np.diff(f[turns]))
    if len(height) < 3:
        return nan
    return float(np.exp(2.0 * np.polyfit(np.arange(len(height)), np.log(height), 1)[0]))


@dataclass
class SpringSliderResult(TrialResult):
    """What came out of both sliders.

    growth: of swings of the spring's force from one to the next, beside that of small ones by
    Ruina's linear theory; error: greatest difference of spring force over N to SciPy's solution,
    which has mass and the contact's give; critical_stiffness [N/m]; pressing_force [N]: found;
    inertia: m V^2/(N a Dc).
    """

    critical_stiffness: float
    pressing_force: float
    soft_growth: float
    soft_expected_growth: float
    stiff_growth: float
    stiff_expected_growth: float
    soft_error: float
    stiff_error: float
    inertia: float
    integrated: dict[str, Array]

    objects: ClassVar[tuple[str, ...]] = (*TrialResult.objects, "integrated")

    @property
    def told(self) -> list[str]:
        """The result in words."""
        p = self.parameters
        return [
            f"at {share:g} of the critical stiffness each swing is {growth:.4g} of the last (small "
            f"ones {small:.4g}); friction differs from SciPy's by up to {error:.1e}"
            for share, growth, small, error in (
                (p.soft, self.soft_growth, self.soft_expected_growth, self.soft_error),
                (p.stiff, self.stiff_growth, self.stiff_expected_growth, self.stiff_error),
            )
        ]

    @property
    def charts(self) -> list[Chart]:
        """Spring forces and speeds."""
        p, s = self.parameters, self.series
        time = 1e3 * s["time"]
        late = s["time"] > p.loading_time + 0.5 * p.slip / p.rate
        pulls, speeds = [], []
        for name, share, color in (("soft", p.soft, "C3"), ("stiff", p.stiff, "C0")):
            force, label = s[f"{name}_spring_force"][late] / p.force, f"{share:g} of critical"
            pulls.append(Line(time[late], force, label, color=color))
            pulls.append(Line(time[late], self.integrated[name][late], "", ":", "k"))
            speeds.append(Line(time[late], 1e3 * s[f"{name}_speed"][late], label, color=color))
        pulls[-1].label = "the same by SciPy"
        ends = np.array([p.drive(t, 1.0) for t in s["time"][late]])
        speeds.append(Line(time[late], 1e3 * ends, "far ends of the springs", "--", "k"))
        return [
            Chart("Friction of both sliders", "time [ms]", "spring force / pressing force", pulls),
            Chart("Speed of the sliders", "time [ms]", "speed [mm/s]", speeds),
        ]


def spring_slider(
    parameters: SpringSlider | None = None, **options: Unpack[Options]
) -> SpringSliderResult:
    """Two sliders of rate-and-state friction on springs: stable above k_crit, unstable below.

    options: `shared.Options`.
    """
    result: SpringSliderResult = run_trial(parameters or SpringSlider(), **options)
    return result

"""A shear crack along a weak plane of a sheared plate (Shilko Figs. 5 and 6; theory C3, C6)."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, nan, pi
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np
from numpy.typing import NDArray

from ..criteria import DruckerPrager, equivalent_stress
from ..errors import Array, InputError, one_of, positive
from ..friction import checked_friction
from ..observe import CrackTracker, Snapshot
from ..observe.growth import Front, window_speeds
from ..packing import Packing
from ..scene import Scene
from ..toughness import Toughness
from ..write.log import UNITS
from ..write.whole import write_csv
from .shared import Conduct, Options, Result, run_numbers
from .weak_plane import (
    PACKINGS,
    RATIO,
    SIDES_HELP,
    SPACING,
    THICKNESS,
    WeakPlane,
    follow,
    write_front,
)

STARTS = ("surface", "bulk")
EDGE_FACTOR = 1.1215  # K of an edge crack over that of a buried one (Tada, Paris and Irwin)
WINDOW = 15.0  # spacings over which speeds are fitted
PLATEAU = (0.88, 1.02)  # speeds over Rayleigh's that are counted as its plateau


@dataclass(frozen=True)
class ModeII(WeakPlane):
    """What is simulated. SI units.

    A plate in plane strain under uniform shear tau_0, gripped above and below, with a weak plane.
    toughness gives the plane's strength at this spacing, and with it the shear tau_p that it bears
    where there is no crack; seismic_ratio is S = (tau_p - tau_0)/tau_0 (Andrews 1976), friction on
    the faces left out. The notch is as long as makes K_II in uniform shear `overload` times the
    toughness. start "surface": a notch from the left edge, the plate at rest under shear before,
    so that the shear is 0 at the edge and grows inwards; "bulk": a notch within, cut suddenly.
    """

    start: Annotated[str, f"Where the crack starts: {', '.join(STARTS)}."] = "surface"
    length: Annotated[float, "Length of the plate, m."] = 4e-3
    height: Annotated[float, "Height of the plate, m."] = 1.04e-3
    spacing: Annotated[float | None, SPACING] = None
    thickness: Annotated[float | None, THICKNESS] = None
    sides: Annotated[str, SIDES_HELP] = "periodic"
    toughness: Annotated[float, "K_IIc of the weak plane, Pa m^0.5."] = 0.3e6
    seismic_ratio: Annotated[float | None, "S; by default 0.7, in the bulk 0.95."] = None
    overload: Annotated[float | None, "K_II over K_IIc; by default 2.5, in the bulk 1.6."] = None
    friction: Annotated[float | None, "Of the crack's faces; by default they do not rub."] = None
    young: Annotated[float, "Young's modulus, Pa."] = 75e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.25
    density: Annotated[float, "Density, kg/m^3."] = 2500.0
    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "hexagonal"
    seed: Annotated[int, "Seed of the Voronoi packing."] = 0

    def __post_init__(self) -> None:
        one_of("start", self.start, STARTS)
        self.check_plate()
        for name in ("toughness", "seismic_ratio", "overload"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), ())
        if self.friction is not None:
            checked_friction(self.friction)
            if self.in_space and self.sides == "periodic":
                raise InputError(
                    "faces of a plate that repeats across its thickness do not rub; leave friction "
                    "out, or give sides free."
                )

    @property
    def files(self) -> tuple[str, ...]:
        """Names of what is written."""
        return (*super().files, "speeds.csv")

    @property
    def s(self) -> float:
        """S = (tau_p - tau_0)/tau_0."""
        bulk = self.start == "bulk"
        return (0.95 if bulk else 0.7) if self.seismic_ratio is None else self.seismic_ratio

    def law(self, plate: Packing) -> Toughness:
        """The weak plane's criterion."""
        return Toughness(DruckerPrager(RATIO, RATIO), self.toughness, mode="II")

    def shear(self, plate: Packing) -> tuple[float, float]:
        """tau_0 of the plate and tau_p that the weak plane bears [Pa]."""
        law = self.law(plate).at(plate, self.material)
        unit = np.zeros((3, 3))
        unit[0, 1] = unit[1, 0] = 1.0
        most = law.strength / equivalent_stress(law, unit, np.array([0.0, 1.0, 0.0]))
        return most / (1.0 + self.s), most

    def notch(self, plate: Packing) -> float:
        """Length of the notch from the edge, half the length of one in the bulk [m]."""
        over = self.overload or (1.6 if self.start == "bulk" else 2.5)
        factor = 1.0 if self.start == "bulk" else EDGE_FACTOR
        length = (over * self.toughness / (factor * self.shear(plate)[0])) ** 2 / pi
        if length > 0.25 * self.length:
            raise InputError(
                f"the notch would be {length:.3g} m, more than a quarter of the plate; lower "
                "overload or seismic_ratio, or give a longer plate or a finer spacing."
            )
        return length

    @property
    def centre(self) -> float:
        """Place of the notch's middle along the plate [m]."""
        return 0.0 if self.start == "surface" else 0.2 * self.length


@dataclass
class ModeIIResult(Result):
    """What came out: plain levels, and speeds over windows of crack length.

    plateau_over_rayleigh: median of all windows before the first above the speed of S waves, the
    very first left out; plateau_spacings: longest stretch of growth at 0.88 to 1.02 of Rayleigh's
    speed; final_over_p: median of the last quarter of windows over the speed of P waves;
    transition_spacings: growth at which two windows in a row first exceed the speed of S waves, in
    spacings, NaN if none do; rank_correlation: Spearman's of speed and length; forbidden_share: of
    windows in steady stretches (three in a row within 3 %) those between Rayleigh's speed and that
    of S waves. front: in space, with front_roughness_spacings: its r.m.s. distance from a straight
    one in spacings, NaN in the plane.
    """

    final_over_p: float
    plateau_over_rayleigh: float
    plateau_spacings: float
    final_over_rayleigh: float
    transition_spacings: float
    rank_correlation: float
    forbidden_share: float
    seismic_ratio: float
    shear: float
    peak_shear: float
    rayleigh_speed: float
    shear_speed: float
    pressure_speed: float
    window_length: NDArray = field(repr=False)
    window_speed: NDArray = field(repr=False)
    front_roughness_spacings: float
    crack: CrackTracker = field(repr=False)
    front: Front | None = field(repr=False)
    field: Snapshot = field(repr=False)

    objects = ("simulation", "crack", "front", "field")


def mode_ii(
    parameters: ModeII | None = None,
    **options: Unpack[Options],
) -> ModeIIResult:
    """Run a mode II crack and measure its speed.

    Writes `files` of its parameters; options: `shared.Options`. Raises InputError for parameters
    that cannot be run.
    """
    run, p = Conduct(**options), parameters or ModeII()
    run.say("building the packing")
    plate = p.fill(p.distance)
    shear, peak = p.shear(plate)
    notch = p.notch(plate)
    tip = p.centre + notch
    scene = Scene()
    body = scene.add(plate, p.material, fracture=p.law(plate))
    p.weaken(scene, body, inf)
    scene.cut(body, p.at(-p.distance if p.start == "surface" else p.centre - notch), p.at(tip))
    half = 0.5 * shear / p.material.shear_modulus
    p.strained(scene, body, [[0.0, half], [half, 0.0]])
    if p.friction is not None:
        scene.contact(friction=p.friction)

    sim = run.build(scene, p.told_size)
    if p.start == "surface" and not sim.steps:
        run.say("bringing the sheared plate to rest")
        sim.relax({"float64": 1e-5, "mixed": 1e-5, "float32": 1e-3}[sim.precision])
    rayleigh = p.material.rayleigh_speed("strain")
    pressure = p.material.pressure_speed("strain")
    # the last twelfth of the plate feels the free edge and is left out
    crack = CrackTracker(every=20, window=WINDOW * p.distance, stop_at=p.length * 11.0 / 12.0)
    picture, tip_place = follow(run, sim, crack, (tip, p.length), 1.3 * rayleigh)

    ahead = crack.log[crack.log["x"] >= tip - p.distance] if len(crack.log) else crack.log
    length, speed = np.zeros(0), np.zeros(0)
    if len(ahead):
        length, speed = window_speeds(ahead["x"] - tip, ahead["time"], WINDOW * p.distance, 0.0)
    front = p.front(crack)
    result = ModeIIResult(
        **run_numbers(sim),
        **_levels(length, speed, p),
        seismic_ratio=p.s,
        shear=shear,
        peak_shear=peak,
        rayleigh_speed=rayleigh,
        shear_speed=p.material.shear_speed(),
        pressure_speed=pressure,
        window_length=length,
        window_speed=speed,
        front_roughness_spacings=nan if front is None else front.roughness / p.distance,
        crack=crack,
        front=front,
        field=picture,
    )
    if run.where is not None:
        _write(run.where, p, result, sim.precision, tip_place)
    run.close("mode-ii", p, result)
    return result


def _levels(length: Array, speed: Array, p: ModeII) -> dict[str, Any]:
    """The plain numbers of `ModeIIResult`, NaN where the crack did not run far enough."""
    from scipy.stats import spearmanr

    names = (
        *("plateau_over_rayleigh", "final_over_p", "final_over_rayleigh", "rank_correlation"),
        *("forbidden_share", "transition_spacings"),
    )
    found: dict[str, Any] = dict.fromkeys(names, float("nan")) | {"plateau_spacings": 0.0}
    if len(speed) < 4:
        return found
    rayleigh = p.material.rayleigh_speed("strain")
    over = speed / rayleigh
    above = speed > p.material.shear_speed()
    fast, both = np.flatnonzero(above), np.flatnonzero(above[1:] & above[:-1])
    if len(both):
        found["transition_spacings"] = float(length[both[0]]) / p.distance
    before = over[1 : fast[0]] if len(fast) else over[1:]  # the first window is the start's
    if len(before):
        found["plateau_over_rayleigh"] = float(np.median(before))
    longest = run = 0
    for k, value in enumerate(over):
        follows = k > 0 and length[k] - length[k - 1] < 1.5 * WINDOW * p.distance
        inside = PLATEAU[0] <= value <= PLATEAU[1]
        run = (run + 1 if follows else 1) if inside else 0
        longest = max(longest, run)
    found["plateau_spacings"] = longest * WINDOW
    last = float(np.median(speed[-max(2, len(speed) // 4) :]))
    found["final_over_rayleigh"] = last / rayleigh
    found["final_over_p"] = last / p.material.pressure_speed("strain")
    found["rank_correlation"] = float(spearmanr(length, speed).statistic)
    steady = np.zeros(len(speed), dtype=bool)
    for k in range(len(speed) - 2):
        three = speed[k : k + 3]
        if np.ptp(three) <= 0.03 * three.mean():
            steady[k : k + 3] = True
    banned = (speed > rayleigh) & (speed < p.material.shear_speed())
    found["forbidden_share"] = float((steady & banned).sum() / max(steady.sum(), 1))
    return found


def _write(where: Path, p: ModeII, result: ModeIIResult, precision: str, tip: float) -> None:
    from ..write.picture import draw_shear_crack

    write_csv(where / "broken_bonds.csv", result.crack.log, UNITS)
    if result.front is not None:
        write_front(where, result.front)
    rows = np.zeros(len(result.window_length), dtype=[("length", float), ("speed", float)])
    rows["length"], rows["speed"] = result.window_length, result.window_speed
    write_csv(where / "speeds.csv", rows, {"length": "m", "speed": "m/s"})
    place = ("from the surface" if p.start == "surface" else "in the bulk") + p.told_space
    speeds = {
        "Rayleigh waves": result.rayleigh_speed,
        "S waves": result.shear_speed,
        "P waves": result.pressure_speed,
    }
    draw_shear_crack(
        where / "crack.png", result.window_length, result.window_speed, speeds, result.field,
        f"Mode II crack {place}, S = {p.s:g}, {result.elements} elements, {precision}",
        crack_line=(p.centre, p.plane_height), tip=tip, reach=0.12 * p.length, front=result.front,
    )  # fmt: skip

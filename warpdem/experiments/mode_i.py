"""A tensile crack along a weak plane of a pre-strained plate (Shilko Fig. 4; theory C6)."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, nan, sqrt
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np
from numpy.typing import NDArray

from ..criteria import Criterion, DruckerPrager, HuberMisesHencky, Rankine, Tensile
from ..errors import InputError, one_of, positive, positive_or_inf
from ..observe import CrackTracker, Snapshot
from ..observe.growth import Front
from ..observe.vortex import find_vortices, on_grid
from ..packing import Packing
from ..scene import Scene
from ..toughness import Toughness
from ..write.log import UNITS
from ..write.whole import write_csv
from .shared import Conduct, Options, Result, run_numbers
from .weak_plane import (
    GRIP_LAYERS,
    PACKINGS,
    RATIO,
    SIDES_HELP,
    SPACING,
    THICKNESS,
    WeakPlane,
    follow,
    griffith_strain,
    write_front,
)

CRITERIA = ("drucker-prager", "huber-mises-hencky", "rankine")
# in spacings: half the field about the tip that is searched for vortices, its smoothing, and the
# radius of the detector
FIELD, SMOOTH, VORTEX = 25.0, 2.0, 8.0


@dataclass(frozen=True)
class ModeI(WeakPlane):
    """What is simulated. SI units.

    A plate in plane strain, uniformly strained by `strain` across a weak plane and gripped above
    and below; at time zero a notch is cut into it suddenly, from its left edge along the plane.
    By default it is a glass plate of three millimetres, whose strength in the plane gives it a
    toughness of about 0.7 MPa sqrt(m) at this element size. Strain over strength is that of the run
    eps_yy = 0.0015 of theory C6, and so is every speed over c_R: at small strain only the ratio
    counts. Both are 0.4 times as large, because what the energy ledger leaves unexplained grows
    with the strain. Given toughness, strength follows from it and the spacing (`Toughness`); given
    overload as well, the strain is so many times that of the Griffith load, at which the strip's
    energy ahead of the crack, (lambda + 2G) strain^2 H/2, is K_Ic^2/E' (Rice 1968). In space
    (`WeakPlane`) toughness and overload are given by default.
    """

    length: Annotated[float, "Length of the plate, m."] = 3e-3
    height: Annotated[float, "Height of the plate, m."] = 1.05e-3
    spacing: Annotated[float | None, SPACING] = None
    thickness: Annotated[float | None, THICKNESS] = None
    sides: Annotated[str, SIDES_HELP] = "periodic"
    notch: Annotated[float, "Length of the notch, m."] = 0.25e-3
    strain: Annotated[float | None, "Strain across the crack; by default 0.0006."] = None
    overload: Annotated[
        float | None,
        "Load over Griffith's, in place of strain; needs toughness; in space by default 1.65.",
    ] = None
    young: Annotated[float, "Young's modulus, Pa."] = 75e9
    poisson: Annotated[float, "Poisson's ratio."] = 0.25
    density: Annotated[float, "Density, kg/m^3."] = 2500.0
    strength: Annotated[
        float | None, "Tensile strength of the weak plane at this spacing, Pa; by default 180e6."
    ] = None
    toughness: Annotated[
        float | None, "K_Ic, Pa m^0.5, in place of strength; in space by default 0.7e6."
    ] = None
    bulk_strength: Annotated[
        float, "Strength elsewhere over the weak plane's; inf: unbreakable."
    ] = inf
    criterion: Annotated[str, f"When a bond breaks: {', '.join(CRITERIA)}."] = "drucker-prager"
    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "hexagonal"
    refine: Annotated[int, "Divide the spacing by this; strength grows by its root."] = 1
    seed: Annotated[int, "Seed of the Voronoi packing."] = 0

    def __post_init__(self) -> None:
        one_of("criterion", self.criterion, CRITERIA)
        self.check_plate()
        self._settle()
        for name in ("notch", "strength", "strain", "toughness", "overload"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), ())
        positive_or_inf("bulk_strength", self.bulk_strength)
        if self.refine < 1:
            raise InputError(f"refine is {self.refine}; it must be 1 or more.")
        if self.notch >= 0.5 * self.length:
            raise InputError("the notch must be shorter than half the plate's length.")
        if self.overload is not None and self.toughness is None:
            raise InputError("an overload is of the Griffith load, which needs toughness: give it.")
        if not 0.0 < self.load < 0.05:
            raise InputError(f"strain is {self.load:g}; give a small one, above 0, below 0.05.")

    def _settle(self) -> None:
        """Fill in strength and load where none is given."""
        settle = object.__setattr__  # of what is frozen
        if self.strength is None and self.toughness is None:
            settle(self, *(("toughness", 0.7e6) if self.in_space else ("strength", 180e6)))
        if self.strain is None and self.overload is None:
            by_load = self.in_space and self.toughness is not None
            settle(self, *(("overload", 1.65) if by_load else ("strain", 0.0006)))

    @property
    def load(self) -> float:
        """Strain across the crack, given or by the overload."""
        if self.overload is None or self.toughness is None:
            assert self.strain is not None
            return self.strain
        m = self.material
        free = self.height - 2.0 * GRIP_LAYERS * self.layer * self.distance / self.refine
        energy = self.toughness**2 / m.plane_modulus()
        return self.overload * griffith_strain(m, energy, free)

    def fracture(self) -> Criterion | Toughness:
        """The criterion, its tensile strength scaled to the element size."""
        if self.toughness is not None:
            return Toughness(self._criterion(1.0), self.toughness)
        assert self.strength is not None
        return self._criterion(self.strength * sqrt(self.refine))

    def _criterion(self, tension: float) -> Tensile:
        if self.criterion == "drucker-prager":
            return DruckerPrager(compression=RATIO * tension, ratio=RATIO)
        if self.criterion == "rankine":
            return Rankine(tension)
        return HuberMisesHencky(tension)

    def build_packing(self) -> Packing:
        """The plate's elements."""
        return self.fill(self.distance / self.refine)


@dataclass
class ModeIResult(Result):
    """What came out. Speeds are over the Rayleigh speed of plane strain.

    vortices: of the velocity field near the tip at one instant (Shilko Fig. 4a), each with sign (1
    counterclockwise), place ahead of the tip and across the crack [m], swirl and circulation
    [m^2/s], as of `observe.vortex.find_vortices`. front: in space, with front_roughness_spacings:
    its r.m.s. distance from a straight one in spacings, NaN in the plane.
    """

    speed_over_rayleigh: float
    speed_spread: float
    rayleigh_speed: float
    vortices: list[dict[str, Any]]
    window_length: NDArray = field(repr=False)
    window_speed_over_rayleigh: NDArray = field(repr=False)
    front_roughness_spacings: float
    crack: CrackTracker = field(repr=False)
    front: Front | None = field(repr=False)
    field: Snapshot = field(repr=False)

    objects = ("simulation", "crack", "front", "field")


def mode_i(
    parameters: ModeI | None = None,
    **options: Unpack[Options],
) -> ModeIResult:
    """Run a mode I crack and measure its speed.

    Writes `files` of its parameters; options: `shared.Options`. Raises InputError for parameters
    that cannot be run.
    """
    run, p = Conduct(**options), parameters or ModeI()
    run.say("building the packing")
    plate = p.build_packing()
    scene = Scene()
    body = scene.add(plate, p.material, fracture=p.fracture())
    p.weaken(scene, body, p.bulk_strength)
    scene.cut(body, p.at(-p.distance), p.at(p.notch))
    p.strained(scene, body, [[0.0, 0.0], [0.0, p.load]])

    sim = run.build(scene, p.told_size)
    rayleigh = p.material.rayleigh_speed("strain")
    window = p.length / 12.0
    # the last twelfth of the plate feels the free edge and is left out
    crack = CrackTracker(every=20, window=window, stop_at=p.length - window)
    way, note = (p.notch, p.length), "; the notch opens suddenly"
    picture, tip_place = follow(run, sim, crack, way, 0.9 * rayleigh, note)
    front = p.front(crack)
    result = ModeIResult(
        **run_numbers(sim),
        speed_over_rayleigh=crack.speed / rayleigh,
        speed_spread=crack.spread / rayleigh,
        rayleigh_speed=rayleigh,
        vortices=_vortices(picture, tip_place, p),
        window_length=crack.length,
        window_speed_over_rayleigh=crack.window_speed / rayleigh,
        front_roughness_spacings=nan if front is None else front.roughness / p.distance,
        crack=crack,
        front=front,
        field=picture,
    )
    if run.where is not None:
        _write(run.where, p, result, sim.precision, tip_place)
    run.close("mode-i", p, result)
    return result


def _vortices(field: Snapshot, tip: float, p: ModeI) -> list[dict[str, Any]]:
    if not field.taken:
        return []
    d = p.distance / p.refine
    place = np.array([tip, p.plane_height])
    reach = min(FIELD * d, 0.45 * p.height)
    grid = on_grid(field.position, field.velocity, place - reach, place + reach, d, SMOOTH * d)
    return [
        {
            "sign": v.sign,
            "ahead": v.centre[0] - tip,
            "across": v.centre[1] - p.plane_height,
            "swirl": v.swirl,
            "circulation": v.circulation,
        }
        for v in find_vortices(grid, VORTEX * d)
    ]


def _write(where: Path, p: ModeI, result: ModeIResult, precision: str, tip: float) -> None:
    from ..write.picture import draw_crack

    write_csv(where / "broken_bonds.csv", result.crack.log, UNITS)
    if result.front is not None:
        write_front(where, result.front)
    draw_crack(
        where / "crack.png",
        result.crack,
        result.field,
        result.rayleigh_speed,
        f"Mode I crack{p.told_space}, strain {p.load:.3g}, {result.elements} elements, {precision}",
        crack_line=(0.0, p.plane_height),
        tip=tip,
        reach=0.16 * p.length,
        front=result.front,
    )

"""A crack along the interface of two materials, or across it: how fast, and which way it goes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, nan, sqrt
from typing import Annotated, Any, Unpack

import numpy as np
from numpy.typing import NDArray

from .. import packing
from ..criteria import MixedMode, Rankine
from ..errors import Array, InputError, one_of, positive
from ..material import Material
from ..observe.growth import window_speeds
from ..packing import Mask, Packing
from ..scene import Body, Scene
from ..toughness import Toughness, local_spacing
from .free_crack import (
    GRIP_LAYERS,
    PACKINGS,
    CrackRun,
    Expected,
    FreeCrack,
    FreeCrackResult,
    free_crack,
    grip,
)
from .shared import Options

PATHS = ("along", "across")
SIZE = (0.04, 0.02)  # m
STEEL = {"young": 208e9, "poisson": 0.3, "density": 7830.0}
FAR = 8.0  # spacings that a crack has gone along or beyond an interface when its way is told
END = SIZE[0] - 0.5 * SIZE[1]  # m: beyond it the free end of the strip is felt

NOTHING: dict[str, Any] = {  # of a crack that did not start
    "way": "stopped", "speed_over_rayleigh": nan, "debonded_spacings": 0.0,
    "penetrated_spacings": 0.0, "deflection": nan, "interface_energy": nan, "bulk_energy": nan,
    "energy_ratio": nan,
}  # fmt: skip


@dataclass(frozen=True)
class Bimaterial(FreeCrack):
    """What is simulated. SI units.

    A strip of 40 x 20 mm in plane strain, strained across a notch and gripped above and below. Its
    halves, below and above the line of the notch (`along`) or left and right of the middle
    (`across`), are of two materials that an interface of its own fracture energy joins. The first
    material is PMMA by its stiffness; the other one, unless given, is steel along an interface and
    PMMA again across one. Random cells are mirrored at the interface, so that it is flat. A bond
    breaks by its greatest principal stress, at the interface by the traction on the face, at
    strengths that fracture energies give (`Toughness`), the interface's the same in opening and
    sliding. The load is `overload` times that of Griffith, at which the energy ahead is the
    interface's (along) or the first material's (across).
    """

    path: Annotated[str, f"Of the notch to the interface: {', '.join(PATHS)}."] = "along"
    spacing: Annotated[float, "Distance of elements, m."] = 2.5e-4
    packing: Annotated[str, f"Arrangement of elements: {', '.join(PACKINGS)}."] = "voronoi"
    young: Annotated[float, "Young's modulus of the first material, Pa."] = 3.24e9
    poisson: Annotated[float, "Its Poisson's ratio."] = 0.35
    density: Annotated[float, "Its density, kg/m^3."] = 1190.0
    other_young: Annotated[float | None, "Young's modulus of the other one, Pa."] = None
    other_poisson: Annotated[float | None, "Its Poisson's ratio."] = None
    other_density: Annotated[float | None, "Its density, kg/m^3."] = None
    fracture_energy: Annotated[float, "G_c of both materials, J/m^2."] = 270.0
    interface_toughness: Annotated[float, "G_c of the interface over theirs."] = 0.1
    notch: Annotated[float, "Length of the notch, m."] = 0.01
    overload: Annotated[float, "Load over Griffith's."] = 1.15
    duration: Annotated[float, "Time simulated, s."] = 45e-6

    name = "bimaterial"
    title = "Crack at the interface of two materials"
    size = SIZE

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("path", self.path, PATHS)
        for name in ("interface_toughness", "overload", "notch"):
            positive(name, getattr(self, name), ())
        if self.notch > 0.4 * SIZE[0]:
            raise InputError(
                f"the notch may be up to {0.4 * SIZE[0]:g} m long, in front of the middle."
            )

    @property
    def is_along(self) -> bool:
        """Whether the notch is in the interface."""
        return self.path == "along"

    @property
    def other(self) -> Material:
        """The material above, or on the right."""
        own = STEEL if self.is_along else vars(self)
        names = ("young", "poisson", "density")
        given = {x: getattr(self, "other_" + x) for x in names}
        return Material(**{x: own[x] if given[x] is None else given[x] for x in names})

    @property
    def tip(self) -> tuple[float, float]:
        """Tip of the notch [m]."""
        return self.notch, 0.5 * SIZE[1]

    def fill(self) -> Packing:
        """The strip's elements; random ones mirrored at the interface."""
        if self.packing != "voronoi":
            return super().fill()
        axis = int(self.is_along)
        half = tuple(0.5 * x if k == axis else x for k, x in enumerate(SIZE))
        own = packing.voronoi(half, self.spacing, self.plane, seed=self.seed).position
        mirrored = own.copy()
        mirrored[:, axis] = SIZE[axis] - mirrored[:, axis]
        centres = np.concatenate([own, mirrored])
        plate = packing.laguerre(SIZE, centres, np.full(len(centres), self.spacing), self.plane)
        return replace(plate, arrangement="voronoi")  # as the cells of each half are

    def grain(self, position: Array) -> NDArray[np.int64]:
        """Which material is at places (n, 2) [m]: 1 above, or on the right."""
        axis = int(self.is_along)
        return (position[:, axis] > 0.5 * SIZE[axis]).astype(np.int64)

    def interface(self, plate: Packing) -> MixedMode:
        """The interface's criterion: of one fracture energy whether it opens or slides."""
        energy = self.interface_toughness * self.fracture_energy
        opens, slides = (  # with one strength for both
            Toughness(MixedMode(1.0, 1.0), energy=energy, mode=mode)
            .at(plate, self.material, self.other)
            .tension
            for mode in ("I", "II")
        )
        return MixedMode(opens, slides)

    @property
    def stress(self) -> float:
        """Normal stress across the crack [Pa] in the first material, of a uniform strain along y in
        each."""
        modulus = [m.lame("strain") + 2.0 * m.shear_modulus for m in (self.material, self.other)]
        free = SIZE[1] - GRIP_LAYERS * sqrt(3.0) * self.spacing
        give = free / modulus[0]
        energy = self.fracture_energy
        if self.is_along:
            give = 0.5 * free * (1.0 / modulus[0] + 1.0 / modulus[1])
            energy *= self.interface_toughness
        return self.overload * sqrt(2.0 * energy / give)

    def build(self, plate: Packing) -> tuple[Scene, Body]:
        """The notched strip under its strain."""
        plate = plate.slit((-self.notch, self.tip[1]), self.tip)
        grain = self.grain(plate.position)
        both = self.material, self.other
        scene = Scene()
        bulk = Toughness(Rankine(1.0), energy=self.fracture_energy)
        glue = self.interface(plate)
        if self.is_along and self.stress > 0.9 * glue.tension:
            raise InputError(
                f"at an overload of {self.overload:g} the whole interface bears {self.stress:.3g} "
                f"Pa of the {glue.tension:.3g} at which it breaks at this spacing; give less than "
                f"{0.9 * self.overload * glue.tension / self.stress:.3g}, or a finer spacing."
            )
        body = scene.add(plate, both, grain=grain, fracture=bulk, pairs={both: glue})
        joins = grain[plate.bonds[:, 0]] != grain[plate.bonds[:, 1]]
        body.strength_factor[joins] = np.sqrt(plate.spacing / local_spacing(plate))[joins]
        if self.is_along:  # a crack would start at the free end of the interface as well
            body.strength_factor[joins & (plate.position[plate.bonds[:, 0], 0] > END)] = inf
        strain = np.full(len(plate), self.stress / body.pressure_modulus[grain == 0][0])
        if self.is_along:
            strain = self.stress / body.pressure_modulus
        body.displacement[:, 1] = strain * (plate.position[:, 1] - self.tip[1])
        grip(scene, body)
        return scene, body

    @property
    def expected(self) -> Expected:
        """The notch and the interface."""
        line = np.array([[0.0, self.tip[1]], [SIZE[0], self.tip[1]]])
        if not self.is_along:
            line = np.array([[0.5 * SIZE[0], 0.0], [0.5 * SIZE[0], SIZE[1]]])
        notches = (((0.0, self.tip[1]), self.tip),)
        both = self.material, self.other
        levels = {"Rayleigh waves of the first material": 1.0} if self.is_along else {}
        sides = ("below", "above") if self.is_along else ("on the left", "on the right")
        each = (f"{m.young / 1e9:.3g} GPa {x}" for m, x in zip(both, sides, strict=True))
        return Expected(notches, {"interface: E " + ", ".join(each): line}, levels)

    def measure(self, run: CrackRun) -> dict[str, Any]:
        """How fast the crack was, which way it went, and what energy that took."""
        body, log = run.sim.scene.bodies[0], run.crack.log
        strip = self.fracture_energy * self.overload**2
        if self.is_along:
            strip *= self.interface_toughness
        found = NOTHING | {"strip_energy": strip}
        if not len(log):
            return found
        assert body.packing.area is not None
        joins = body.grain[log["i"]] != body.grain[log["j"]]
        if joins.any():
            area = body.packing.area[log["bond"][joins]]
            found["interface_energy"] = float(log["released_energy"][joins].sum() / area.sum())
        if self.is_along:
            speed = self._speed(log[joins]) / run.numbers["rayleigh_speed"]
            gone = float(joins.sum())
            return found | {"way": "along", "speed_over_rayleigh": speed, "debonded_spacings": gone}
        found |= self._across(log, joins)
        before = log["released_energy"][~joins & (log["x"] < 0.5 * SIZE[0])]
        reach = (0.5 * SIZE[0] - self.tip[0]) * body.packing.thickness
        found["bulk_energy"] = float(before.sum()) / reach
        return found | {"energy_ratio": found["interface_energy"] / found["bulk_energy"]}

    def _speed(self, log: NDArray[np.void]) -> float:
        """Along the interface [m/s], by a robust fit to its breaks in the last half of the way."""
        start = 0.5 * (self.tip[0] + END)
        window = 0.95 * (END - start)  # the last bond lies before the end
        _, speed = window_speeds(log["x"], log["time"], window, start)
        return float(speed[0]) if len(speed) else nan

    def _across(self, log: NDArray[np.void], joins: Mask) -> dict[str, Any]:
        """Which way a crack across the interface went, and how far along it and beyond it."""
        before = log[~joins & (log["x"] < 0.5 * SIZE[0])]
        met = before["y"][np.argmax(before["x"])] if len(before) else nan  # the nearest to it
        spacings = {
            "deflected": np.where(joins, np.abs(log["y"] - met), 0.0) / self.spacing,
            "through": np.where(joins, 0.0, log["x"] - 0.5 * SIZE[0]) / self.spacing,
        }
        when = {w: log["time"][x >= FAR].min(initial=inf) for w, x in spacings.items()}
        way = min(when, key=lambda w: when[w])
        along, beyond = (x.max(initial=0.0) for x in spacings.values())
        early = log["time"] <= when[way]
        then = [x.max(initial=0.0, where=early) for x in spacings.values()]
        return {
            "way": way if np.isfinite(when[way]) else "stopped",
            "debonded_spacings": float(along),
            "penetrated_spacings": float(beyond),
            "deflection": float(then[0] / max(sum(then), 1e-9)),
        }


@dataclass
class BimaterialResult(FreeCrackResult):
    """What came out. Speeds are over Rayleigh's of the first material.

    way: "along", "through", "deflected" or "stopped", by what the crack first does over 8 spacings
    beyond or along the interface; speed_over_rayleigh: along the interface, by all breaks of the
    last half of its way; debonded_spacings,
    penetrated_spacings: how far the interface broke, and how far beyond it a crack went (across);
    deflection: the former over the sum of both when the way is told; interface_energy, bulk_energy
    [J/m^2]: that broken bonds release as they break, without the waves this sends out, over the
    area of the interface, and over the distance from the notch to it; energy_ratio: of both;
    strip_energy [J/m^2]: stored ahead of the crack.
    """

    way: str
    speed_over_rayleigh: float
    debonded_spacings: float
    penetrated_spacings: float
    deflection: float
    interface_energy: float
    bulk_energy: float
    energy_ratio: float
    strip_energy: float

    @property
    def told(self) -> list[str]:
        """The result in words."""
        if self.way == "along":
            words = (
                f"speed along the interface {self.speed_over_rayleigh:.3f} of the first material's "
                f"Rayleigh speed; it took {self.interface_energy:.3g} of the strip's "
                f"{self.strip_energy:.3g} J/m^2"
            )
        else:
            words = (
                f"the crack went {self.way}: {self.debonded_spacings:.0f} spacings along the "
                f"interface, {self.penetrated_spacings:.0f} beyond it; the interface took "
                f"{self.interface_energy:.3g} J/m^2, the material before it {self.bulk_energy:.3g}"
            )
        return [*super().told, words]


def bimaterial(
    parameters: Bimaterial | None = None, **options: Unpack[Options]
) -> BimaterialResult:
    """Run a crack along the interface of two materials, or across it.

    options: `shared.Options`.
    """
    return free_crack(parameters or Bimaterial(), BimaterialResult, **options)

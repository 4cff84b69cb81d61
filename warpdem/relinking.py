"""When an unlinked pair is linked again: cold welding, sintering, healing (theory B11)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .errors import Array, InputError, checked, finite, positive


@checked
@dataclass(frozen=True)
class Healing:
    """A law by which unlinked facet bonds of a body, broken or cut, are linked again.

    A bond does so once its closed face has been pressed with at least `pressure` [Pa], without a
    break, for `time` [s], while slip on it took at least `work` [J/m^2], which needs friction
    (`Scene.contact`). strength: share of its strength that a bond has from then on.

    The link keeps the force and torques of the contact, so its rest state is the present one. It
    never takes more energy than the bond's own breaks have released, the surface energy of the
    face; a bond that would need more waits, see `Simulation.waiting_bonds`.
    """

    pressure: float = 0.0
    time: float = 0.0
    work: float = 0.0
    strength: float = 1.0

    def __post_init__(self) -> None:
        for name in ("pressure", "time", "work"):
            if float(finite(name, getattr(self, name), ())) < 0.0:
                raise InputError(f"{name} is {getattr(self, name):g}; give 0 or more.")
        if not 0.0 < float(finite("strength", self.strength, ())) <= 1.0:
            raise InputError(f"strength is {self.strength:g}; give a share, above 0 and up to 1.")


@checked
@dataclass(frozen=True)
class Welding:
    """A law by which elements that no bond joins weld (`Scene.contact`).

    A pair does so once it has been pressed with at least `pressure` [Pa] for `time` [s] without a
    break, while slip on it took at least `work` [J/m^2]. From then on its springs, along and across
    its normal, bear tension and do not slip, until sqrt(s^2 + t^2) of tension s and shear t is
    beyond `strength` [Pa]. It starts with the force and energy of the contact.
    """

    strength: float
    pressure: float = 0.0
    time: float = 0.0
    work: float = 0.0

    def __post_init__(self) -> None:
        for name in ("pressure", "time", "work"):
            if float(finite(name, getattr(self, name), ())) < 0.0:
                raise InputError(f"{name} is {getattr(self, name):g}; give 0 or more.")
        positive("strength", self.strength, ())


@dataclass
class WeldLog:
    """Rows of the log of pairs that welded and broke."""

    has_records = True  # that a checkpoint keeps

    # lower id, higher id, step, 1 for a weld or -1 for a break, normal stress, shear stress, energy
    rows: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, pairs: NDArray[np.int64], step: int, *columns: NDArray) -> None:
        """Note what happened to pairs in a step."""
        self.rows.append(np.column_stack([pairs, np.full(len(pairs), step), *columns]))


@dataclass
class RelinkLog:
    """Rows of the log of links made again, and of breaks that these would have overwritten."""

    has_records = True  # that a checkpoint keeps

    # listed bond, step, pressure, shear stress, energy released
    links: list[tuple[NDArray, ...]] = field(default_factory=list)
    # listed bond, step, normal stress, shear stress, energy released
    breaks: list[tuple[NDArray, ...]] = field(default_factory=list)

    def add(
        self, rows: NDArray[np.int64], step: int, link: dict[str, Array], last: dict[str, Array]
    ) -> None:
        """Note links of listed bonds `rows`; `last` holds what their last breaks left, or
        nothing."""
        self.links.append(
            (rows, np.full(len(rows), step), link["normal"], link["shear"], link["released"])
        )
        if last:
            broke = last["step"] >= 0
            energy = last["energy"] - self.booked(rows)
            columns = rows, last["step"], last["normal"], last["shear"], energy
            self.breaks.append(tuple(x[broke] for x in columns))

    def booked(self, rows: NDArray[np.int64]) -> Array:
        """Energy [J] that earlier breaks of listed bonds released, those noted here."""
        bond, _step, _normal, _shear, energy = joined(self.breaks)
        at = bond.astype(np.int64)
        size = int(max(at.max(initial=-1), rows.max(initial=-1))) + 1
        return np.asarray(np.bincount(at, energy, minlength=size)[rows], dtype=np.float64)


def joined(parts: list[tuple[NDArray, ...]]) -> tuple[NDArray, ...]:
    """Five columns of all parts, one after the other."""
    return tuple(np.concatenate([np.zeros(0), *(p[n] for p in parts)]) for n in range(5))

"""Looks at a simulation between steps: is every number finite, is nothing faster than it can be,
does no energy come from nowhere."""

import numpy as np
from numpy.typing import NDArray

from .errors import Array, NonFiniteError, UnstableError, first_ids
from .model import Model
from .step import Step

MOST = 1.0  # energy from nowhere, over what there was and was put in
TINY = 1e-3  # spacings a step: energy of such motion is always allowed
KEPT = ("displacement", "orientation", "velocity", "angular_velocity")


OF_BONDS = ("bond_", "branch_", "break_", "closing_", "evm_", "facet_", "healing_", "linked_")


class Guard:
    """Watches every array that steps may change and that was finite when the run began.

    `last`: KEPT as they were at the last look that found nothing, `last_step`: when that was.
    """

    def __init__(self, model: Model, state: dict[str, NDArray], spacing: float) -> None:
        self._model, self._spacing = model, spacing
        self._fixed = model.arrays().keys() - state.keys()
        self._infinite: set[str] | None = None
        self.last: dict[str, Array] = {}
        self.last_step = -1

    def check(self, step: Step) -> None:
        """Raises NonFiniteError or UnstableError with what, where, when."""
        self.check_finite(step)
        self.check_motion(step)

    def check_energy(self, step: Step, residual: float, before: float, work: float) -> None:
        """Refuse energy [J] that neither was there before nor was put in."""
        m = self._model
        floor = float(m.mass.sum()) * (TINY * self._spacing / step.dt) ** 2
        if residual > MOST * (abs(before) + abs(work)) + floor:
            speed = np.linalg.norm(step.download("velocity"), axis=1)
            raise self._told(
                UnstableError(
                    f"energy grew by {residual:.3g} J more than the {work:.3g} J put in, by step "
                    f"{step.count} (dt {step.dt:.4g} s); the fastest elements are "
                    f"{first_ids(speed >= np.partition(speed, -min(3, len(speed)))[-3:].min())}. "
                    "Take a smaller dt."
                )
            )

    def check_finite(self, step: Step) -> None:
        """Refuse numbers that are not finite."""
        changing = {n: a.numpy() for n, a in step.arrays.items() if n not in self._fixed}
        bad = {name: a for name, a in changing.items() if _is_suspect(a)}
        if self._infinite is None:  # some, such as strengths, may be infinite from the start
            self._infinite = {name for name, a in bad.items() if np.isinf(a).any()} - set(KEPT)
        bad = {name: np.isnan(a) | (np.isinf(a) & (name not in self._infinite))
               for name, a in bad.items()}  # fmt: skip
        counts = {name: int(a.sum()) for name, a in bad.items() if a.any()}
        if not counts:
            return
        name = next((x for x in KEPT if x in counts), next(iter(counts)))
        rest = ", ".join(f"{n} ({c})" for n, c in counts.items())
        raise self._told(
            NonFiniteError(
                f"{name} of {self._where(name, bad[name], step)} is not finite at step "
                f"{step.count} (time {step.count * step.dt:.4g} s, dt {step.dt:.4g} s); the last "
                f"look without fault was at step {self.last_step}. Numbers that are not finite: "
                f"{rest}. The run was stopped and nothing of it written."
            )
        )

    def check_motion(self, step: Step) -> None:
        """Refuse bonds that grow by more than a spacing in a step; else keep the state as sound."""
        v, m = step.download("velocity").astype(np.float64, copy=False), self._model
        if max(np.ptp(along) for along in v.T) * step.dt <= self._spacing:
            self._keep(step)  # no two elements are so quick, whichever bonds join
            return
        apart = np.abs(v[m.bond_i[: m.bonds]] - v[m.bond_j[: m.bonds]]).max(axis=1) * step.dt
        if m.listed_bonds is not None:
            apart = apart * (step.download("bond_linked")[: m.bonds] > 0.0)
        worst = np.flatnonzero(apart > self._spacing)
        if len(worst):
            ends = np.concatenate([m.bond_i[worst], m.bond_j[worst]])
            raise self._told(
                UnstableError(
                    f"elements {_ids(ends, m.elements)}, joined by bonds {_ids(worst, m.bonds)}, "
                    f"part or meet by up to {apart.max():.3g} m in a step, more than the spacing "
                    f"{self._spacing:.3g} m, at step {step.count} (dt {step.dt:.4g} s); take a "
                    "smaller dt."
                )
            )

        self._keep(step)

    def _keep(self, step: Step) -> None:
        self.last = {name: step.download(name) for name in KEPT}
        self.last_step = step.count

    def _where(self, name: str, flat: NDArray[np.bool_], step: Step) -> str:
        """Which elements or bonds a flat array's bad numbers belong to."""
        m, shape = self._model, step.arrays.shapes.get(name, flat.shape)
        rows = shape[0] if shape else 1
        bad = np.flatnonzero(flat.reshape(rows, -1).any(axis=1))
        listed = m.listed_bonds
        if rows in (m.elements, m.features.slots * m.elements) and not name.startswith(OF_BONDS):
            return "elements " + _ids(bad % m.elements, m.elements)
        if rows in (m.bonds, m.bonds + 1, m.facet_bonds):
            return "bonds " + _ids(bad, m.bonds + 1)
        if rows in (2 * m.bonds, 2 * m.bonds + 2, 2 * m.facet_bonds):
            return "bonds " + _ids(bad // 2, m.bonds + 1)
        if rows == m.evm_bonds:
            return "bonds " + _ids(bad + m.facet_bonds, m.bonds)
        if rows == 2 * m.evm_bonds:
            return "bonds " + _ids(bad // 2 + m.facet_bonds, m.bonds)
        if listed is not None and rows in (len(listed), m.facet_listed):
            return "bonds " + _ids(listed[bad], m.bonds)
        return "entries " + _ids(bad, rows)

    def _told(self, error: NonFiniteError) -> NonFiniteError:
        error.last, error.last_step = self.last, self.last_step
        return error


def _is_suspect(a: NDArray) -> bool:
    """A sum is not finite where a number is not, and is quicker than a look at each."""
    if a.dtype.kind != "f":
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        return not np.isfinite(a.sum())


def _ids(ids: NDArray, count: int) -> str:
    mask = np.zeros(count, dtype=bool)
    mask[ids] = True
    return first_ids(mask)

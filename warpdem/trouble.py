"""What is deformed beyond what its law or its time step stands for: told once, with ids.

EVM bonds (theory A5), slips of plastic flow and creep (B2a), elements at finite strain (B6).
"""

import warnings
from math import degrees, pi

import numpy as np
from numpy.typing import NDArray

from .errors import Array, ModelWarning, TroubledBondError, first_ids
from .kernels.evm import CRUSHED
from .kernels.finite import LEAST_JACOBIAN
from .model import Model, bond_ends
from .step import Step

TWIST = pi / 3.0  # torsion is 17 % soft here; its moment falls from pi/2 on
TURN = 0.95 * pi  # angles of bonds with large_rotation have a kink at pi
KINDS = ("twisted", "bent", "crushed")
SLIP = 0.3  # of a bond's length: beyond, its face is no longer the one it was (theory B2a)
DISTORTED = 25.0  # ratio of stretches up to which finite strain was validated
TYPE = [("bond", int), ("i", int), ("j", int), ("step", int), ("kind", "U8"), ("value", float)]
ADVICE = {
    "twisted": "take more bonds along the length, or EVMBond(large_rotation=True)",
    "bent": "take more bonds along the length, or EVMBond(large_rotation=True)",
    "crushed": "the bond has lost its direction; reduce the load or let such bonds break",
}


def bend_limit(stiffness: Array) -> Array:
    """Angle of both ends [rad] at which the moment of a bent bond is greatest, (b,).

    M = B2/2 sin(phi) + (B3 + B4/2) sin(2 phi) (Kuzkin 9), so cos(phi) is the root of
    4 h x^2 + B2/2 x - 2 h = 0, h = B3 + B4/2 = c_B - B2/4. Not below a small angle, so that bonds
    without any stiffness in bending are not told of.
    """
    _, b2, b3, b4 = stiffness.T
    h = b3 + 0.5 * b4
    root = np.sqrt(0.25 * b2**2 + 32.0 * h**2)
    scale = np.where(h == 0.0, 1.0, 8.0 * h)
    cosine = np.where(h == 0.0, 0.0, (-0.5 * b2 + root) / scale)
    has_moment = b2 + np.abs(h) > 0.0
    return np.where(has_moment, np.arccos(np.clip(cosine, -1.0, 1.0)), np.inf)


class Troubles:
    """Which EVM bonds of a simulation were found in trouble; each is told of once a kind."""

    def __init__(self, model: Model, ids: NDArray[np.int64], stops: bool) -> None:
        assert model.evm_stiffness is not None
        self._model, self._ids, self._stops = model, ids, stops
        stiffness = model.evm_stiffness
        shape = (len(KINDS), len(stiffness))
        self._limit = np.empty(shape)
        if model.features.large_rotation:
            self._limit[:2] = TURN
        else:
            self._limit[0], self._limit[1] = TWIST, bend_limit(stiffness)
        self._limit[0, stiffness[:, 3] == 0.0] = np.inf  # no torsion, no trouble
        self._limit[2] = 1.0 - CRUSHED
        self._told = np.zeros(shape, dtype=bool)
        self._rows: list[tuple] = []

    @property
    def log(self) -> NDArray[np.void]:
        """Bonds found so far: bond, i, j, step, kind, value (an angle [rad], or D/a)."""
        return np.array(self._rows, dtype=TYPE)

    def check(self, step: Step) -> None:
        """Look at all linked bonds; warn of new trouble, or raise if it is to stop the run."""
        found = step.evaluate_angles()
        m = self._model
        value = np.stack([found["evm_twist"], found["evm_bend"], -found["evm_elongation"]])
        new = (value > self._limit) & ~self._told
        if not new.any():
            return
        new &= step.download("evm_stiffness").any(axis=1)  # unlinked bonds are at rest
        self._told |= new
        for row, kind in enumerate(KINDS):
            bonds = np.flatnonzero(new[row])
            if len(bonds) == 0:
                continue
            size = np.where(kind == "crushed", 1.0 - value[row], value[row])
            ids = bonds + m.facet_bonds
            self._rows += [
                (m.own_facets + c, m.bond_i[b], m.bond_j[b], step.count, kind, size[c])
                for b, c in zip(ids, bonds, strict=True)
            ]
            message = self._sentence(kind, ids, size[bonds], step.count)
            if self._stops:
                raise TroubledBondError(message)
            warnings.warn(message, ModelWarning, stacklevel=5)

    def _sentence(self, kind: str, ids: NDArray[np.int64], size: Array, step: int) -> str:
        m = self._model
        shown = []
        for b, x in list(zip(ids, size, strict=True))[:5]:
            i, j = self._ids[[m.bond_i[b], m.bond_j[b]]]
            how = f"to {x:.2g} of its length" if kind == "crushed" else f"by {degrees(x):.0f} deg"
            shown.append(f"{b - m.facet_bonds + m.own_facets} (elements {i} and {j}) {how}")
        more = f" and {len(ids) - 5} more" if len(ids) > 5 else ""
        return (
            f"at step {step} these EVM bonds are {kind} beyond the range of their energy: "
            f"{', '.join(shown)}{more}; {ADVICE[kind]}."
        )


class Slips:
    """Bonds whose slips, of plastic flow or creep, have left the range of small strain.

    All are kept in the log; the first are told of, once for all, as what flows goes on flowing.
    """

    def __init__(self, model: Model, ids: NDArray[np.int64], stops: bool) -> None:
        self._model, self._ids, self._stops = model, ids, stops
        ends = bond_ends(model)
        self._length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        self._kind = "flowed" if model.yielding else "crept"
        self._found = np.zeros(len(model.own_bonds), dtype=bool)
        self._rows: list[tuple] = []

    @property
    def log(self) -> NDArray[np.void]:
        """Bonds found so far: bond, i, j, step, kind ("flowed", "crept"), value (slip over
        length)."""
        return np.array(self._rows, dtype=TYPE)

    def check(self, step: Step) -> None:
        """Look at the slips of all bonds; the first time that some are too long, warn, or raise if
        it is to stop the run."""
        share = self._shares(step)
        new = np.flatnonzero((share > SLIP) & ~self._found)
        if len(new) == 0:
            return
        is_first = not self._found.any()
        self._found[new] = True
        pairs = self._ids[self._model.own_pairs[new]]
        self._rows += [
            (b, *pair, step.count, self._kind, share[b]) for b, pair in zip(new, pairs, strict=True)
        ]
        if not is_first:
            return
        shown = ", ".join(
            f"{b} (elements {i} and {j}) by {share[b]:.2f}"
            for b, (i, j) in zip(new[:5], pairs, strict=False)
        )
        more = f" and {len(new) - 5} more" if len(new) > 5 else ""
        advice = (
            "load less, harden more, or let such bonds break"
            if self._kind == "flowed"
            else "load less, or for a shorter time"
        )
        message = (
            f"at step {step.count} bonds have {self._kind} by more than {SLIP:g} of their length: "
            f"{shown}{more}; their faces are no longer those between these elements, and results "
            f"are not to be trusted: {advice}."
        )
        if self._stops:
            raise TroubledBondError(message)
        warnings.warn(message, ModelWarning, stacklevel=5)

    def _shares(self, step: Step) -> Array:
        """Slip of every bond of the packings over its length, (b,)."""
        m = self._model
        share = np.zeros(m.bonds)
        if m.facet_bonds:
            slip = np.linalg.norm(step.download("bond_slip"), axis=1).reshape(-1, 2).sum(axis=1)
            share[: m.facet_bonds] = slip / self._length[: m.facet_bonds]
        if m.evm_bonds:
            # along the bond, and across it at the mean of what both ends have tilted by
            tilt = np.linalg.norm(step.download("evm_tilt"), axis=1).reshape(-1, 2).mean(axis=1)
            along = step.download("evm_slip") / m.evm_length
            share[m.facet_bonds :] = np.hypot(along, tilt)
        if m.node_bonds is not None:
            share[m.node_bonds] = np.maximum(share[m.node_bonds], share[m.second_bonds])
        return share[m.own_bonds]


def slid(step: Step) -> Array:
    """How far the centres of each bond have moved since its face was made, over their distance
    then, (b,): |r - R r0|/r0 with the mean turn R of what surrounds both elements.

    At finite strain, where elastic strains are small, it is the slip of the bond's face.
    """
    vector, now, gradient = _lines(step)
    left, _, right = np.linalg.svd(gradient)
    return _apart(step.model, vector, now, left @ right)


def strayed(step: Step) -> Array:
    """As `slid`, but from where the deformation gradients of both elements take the line, (b,): how
    far they have slid past each other as neighbours of one deforming body do not."""
    vector, now, gradient = _lines(step)
    return _apart(step.model, vector, now, gradient)


def _lines(step: Step) -> tuple[Array, Array, Array]:
    """Centre lines of bonds (b, dim) as faces were made and now, and F of elements since then."""
    m = step.model
    assert m.bond_weight is not None
    ends = bond_ends(m)
    vector = ends[:, 0] - ends[:, 1]
    moved = step.download("centre_opening")[: m.bonds].astype(np.float64)
    weight = np.where(m.bond_weight > 0.0, m.bond_weight, 1.0)
    gradient = step.download("displacement_gradient").astype(np.float64)
    return vector, vector + moved / weight[:, None], np.eye(m.features.dim) + gradient


def _apart(m: Model, vector: Array, now: Array, gradient: Array) -> Array:
    taken = np.einsum("bxy,by->bx", 0.5 * (gradient[m.bond_i] + gradient[m.bond_j]), vector)
    return np.linalg.norm(now - taken, axis=1) / np.linalg.norm(vector, axis=1)


class Distortion:
    """Elements at finite strain whose lattice is too distorted; each kind is told of once.

    Where the lattice is squeezed the volume energy pulls the harder, where it is stretched springs
    have longer arms: the greatest frequency grows up to 1/least and up to the greatest stretch.
    """

    def __init__(self, dt_limit: float) -> None:
        self._dt_limit = dt_limit
        self._told: set[str] = set()

    def restart(self, dt_limit: float) -> None:
        """From faces just renewed on, whose greatest stable time step is this [s]."""
        self._dt_limit = dt_limit

    @property
    def log(self) -> NDArray[np.void]:
        """No bonds: it is elements that are told of."""
        return np.zeros(0, dtype=TYPE)

    def check(self, step: Step) -> None:
        """Look at all elements; warn of new trouble."""
        h = step.download("displacement_gradient").astype(np.float64)
        gradient = np.eye(h.shape[1]) + h
        stretch = np.linalg.svd(gradient, compute_uv=False)
        share = np.minimum(stretch[:, -1], 1.0 / stretch[:, 0])
        limit = self._dt_limit * float(share.min())
        self._tell(
            "inverted",
            np.linalg.det(gradient) <= LEAST_JACOBIAN,
            step,
            "are squeezed to nothing or turned inside out; take a smaller dt or more elements",
        )
        self._tell(
            "unstable",
            step.dt > share * self._dt_limit,
            step,
            f"are stretched so much that the time step may no longer be stable; give a dt of "
            f"{limit:.2g} s or less",
        )
        self._tell(
            "distorted",
            stretch[:, 0] > DISTORTED * stretch[:, -1],
            step,
            f"are distorted beyond the ratio {DISTORTED:g} of their stretches, up to which "
            "finite strain is validated",
        )
        m = step.model
        far = np.zeros(m.elements, dtype=bool)
        if m.features.faces.has_slip and m.nodes == 0 and not m.features.renews:
            past = strayed(step) > SLIP
            far[m.bond_i[past]] = far[m.bond_j[past]] = True
        self._tell(
            "strayed",
            far,
            step,
            f"have slid past neighbours by more than {SLIP:g} of their distance, and the faces "
            "between them are no longer what they were; give renew_faces=0.3, more elements or "
            "less load",
        )

    def _tell(self, kind: str, bad: NDArray[np.bool_], step: Step, what: str) -> None:
        if bad.any() and kind not in self._told:
            self._told.add(kind)
            warnings.warn(
                f"at step {step.count} elements {first_ids(bad)} {what}.",
                ModelWarning,
                stacklevel=6,
            )

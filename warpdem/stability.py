"""The greatest stable time step: found by iteration, and bounded rigorously (theory A9, B8)."""

import numpy as np
from numpy.typing import NDArray

from .errors import Array, InputError
from .model import (
    Model,
    bond_ends,
    face_reach,
    inverse_inertia_root,
    retarded,
    volume_stiffness,
)
from .step import Step, gathered

HERTZ_OVERLAP = 0.05  # of a sphere over its radius, up to which dt is stable

TOO_FAR_APART = (
    "no stable time step was found for this scene: its masses, sizes and stiffnesses lie too far "
    "apart for float64; look at the smallest and the largest of each."
)


def largest_frequency(step: Step, spacing: float) -> float:
    """Greatest angular frequency [rad/s] of small motions about the reference state.

    Lanczos iteration on M^-1/2 K M^-1/2, K applied by the step's own force passes to small
    displacements: the well-converging form of power iteration. Overwrites the state.
    """
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

    m, n = step.model, step.model.elements
    dim = m.features.dim
    spins = 1 if dim == 2 else 3
    root, spin_root = np.sqrt(m.inverse_mass).ravel(), inverse_inertia_root(m)
    free = np.flatnonzero(np.concatenate([root, np.repeat(m.inverse_inertia, spins)]))
    if len(free) == 0 or m.bonds == 0:
        return 0.0
    small = 1e-6 if step.download("displacement").dtype == np.float64 else 1e-4
    rotation = np.zeros((n, 2 if dim == 2 else 4))
    rotation[:, -1] = 1.0
    reference = rotation.copy()

    step.upload("displacement", np.zeros((n, dim)))
    step.upload("orientation", reference)
    step.evaluate_forces()
    rest = gathered(step)  # of a periodic box that starts strained

    def spread(y: NDArray[np.float64]) -> NDArray[np.float64]:
        motion = np.zeros(n * (dim + spins))
        motion[free] = y
        return motion

    def weighted(motion: NDArray[np.float64]) -> NDArray[np.float64]:
        """M^-1/2 times a motion, or a force."""
        turn = np.einsum("nab,nb->na", spin_root, motion[n * dim :].reshape(n, spins))
        return np.concatenate([root * motion[: n * dim], turn.ravel()])

    def stiffness(y: NDArray[np.float64]) -> NDArray[np.float64]:
        motion = weighted(spread(y))
        size = np.abs(motion[: n * dim]).max() + spacing * np.abs(motion[n * dim :]).max()
        scale = small * spacing / size if size > 0.0 else 0.0
        u = (scale * motion[: n * dim]).reshape(n, dim)
        turn = (scale * motion[n * dim :]).reshape(n, spins)
        rotation[:, :spins] = 0.5 * turn
        rotation[:, -1] = np.sqrt(1.0 - 0.25 * (turn**2).sum(axis=1))
        step.upload("displacement", u)
        step.upload("orientation", rotation)
        step.evaluate_forces()
        back = np.concatenate(
            [(x - x0).ravel() for x, x0 in zip(gathered(step), rest, strict=True)]
        )
        return -weighted(back)[free] / scale if scale > 0.0 else np.zeros(len(free))

    operator = LinearOperator((len(free), len(free)), matvec=stiffness, dtype=np.float64)
    if len(free) < 12:
        matrix = np.stack([stiffness(e) for e in np.eye(len(free))])
        greatest = float(np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[-1])
    else:
        start = np.random.default_rng(0).normal(size=len(free))
        try:
            (greatest,) = eigsh(
                operator, k=1, which="LA", v0=start, tol=1e-3, return_eigenvectors=False
            )
        except ArpackError:
            raise InputError(TOO_FAR_APART) from None
    return float(np.sqrt(max(greatest, 0.0)))


def bound_frequency(model: Model) -> float:
    """An angular frequency [rad/s] that no small motion exceeds, from blocks of single elements.

    Every bond's energy is 1/2 (A_i x_i + A_j x_j)^T C (A_i x_i + A_j x_j), therefore
    K <= 2 blockdiag(K_ii) and omega^2 <= 2 max lambda(M_i^-1 K_ii) (theory A9). The volume energy
    is bounded by springs at the faces (Cauchy-Schwarz, theory B8). Bonds that may be unlinked count
    with the stiffer of their linked and closing stiffness.
    """
    blocks = _Blocks(model)
    if model.facet_bonds:
        assert model.facet_stiffness is not None
        stiffness = model.facet_stiffness + _volume_springs(model)[: model.facet_bonds]
        if model.listed_bonds is not None and model.facet_listed:
            assert model.closing_stiffness is not None
            facets = model.listed_bonds[: model.facet_listed]
            closing = model.closing_stiffness[: model.facet_listed]
            stiffness[facets] = np.maximum(stiffness[facets], closing)
        blocks.add_springs(slice(0, model.facet_bonds), stiffness)
        if model.facet_bending is not None:
            blocks.add_couples(model.facet_bending)
    if model.evm_bonds:
        evm = slice(model.facet_bonds, model.bonds)
        b1, b2, b3, b4 = _of(model.evm_stiffness).T
        bending = b2 / 4.0 + b3 + b4 / 2.0
        shear = b2 / _of(model.evm_length) ** 2
        if model.closing_shear is not None and model.listed_bonds is not None:
            beams = model.listed_bonds[model.first_beam :] - model.facet_bonds
            shear[beams] = np.maximum(shear[beams], model.closing_shear[model.first_beam :])
        blocks.add_beams(evm, b1, shear, bending, b4)
        if model.bond_weight is not None:
            blocks.add_springs(evm, _volume_springs(model)[evm])
    return float(np.sqrt(2.0 * blocks.greatest()))


def bound_contact(model: Model) -> float:
    """An angular frequency [rad/s] that contacts add at most to that of the bonds, in squares.

    Of elements that touch on all sides, 6 others of their size in the plane and 12 in space, by
    K <= 2 blockdiag(K_ii) as in `bound_frequency`; each of them by its own radius and moduli, to
    which a smaller or a softer neighbour would be softer.
    """
    if model.contact_elements is None:
        return 0.0
    dim, own = model.features.dim, model.contact_elements
    radius = _of(model.contact_radius)[own]
    normal, along = _contact_stiffness(model)
    shear = along if model.rubs else np.zeros(len(own))
    around = 12 if dim == 3 else 6
    moving = model.inverse_mass[own].max(axis=1)
    root = (inverse_inertia_root(model)[own] ** 2).max(axis=(1, 2))
    pushed = around / dim * (normal + (dim - 1) * shear) * moving
    across = 1.0 if dim == 2 else 2.0 / 3.0
    turned = around * across * shear * radius**2 * root
    if model.rolls:  # k_t R^2, R of rolling on an equal or on a wall
        turned += around * along * (radius if model.walls else 0.5 * radius) ** 2 * root
    return float(np.sqrt(2.0 * (pushed + turned).max(initial=0.0)))


def bound_contact_damping(model: Model) -> float:
    """A rate [1/s] that no damping of a motion by dashpots of contacts exceeds: as
    `bound_contact`, each dashpot with the mass of the element itself."""
    if model.contact is None or not model.touch.damps or model.contact_elements is None:
        return 0.0
    normal, _ = _contact_stiffness(model)
    moving = model.inverse_mass[model.contact_elements].max(axis=1)
    ratio = 2.0 * model.contact.damping_ratio
    if model.contact.is_hertz:  # k is the tangent, 3/2 k_n sqrt(h)
        ratio *= np.sqrt(5.0 / 6.0)
    around = 12 if model.features.dim == 3 else 6
    rate = around / model.features.dim * ratio * np.sqrt(normal * moving)
    return float(2.0 * rate.max(initial=0.0))


def _contact_stiffness(model: Model) -> tuple[Array, Array]:
    """Normal and tangential stiffness of a contact with an equal, or with a wall [N/m], of every
    element that may touch."""
    own = model.contact_elements
    assert own is not None
    radius, width = _of(model.contact_radius)[own], _of(model.contact_width)[own]
    area = np.pi * radius**2 if model.features.dim == 3 else 2.0 * radius * width
    # a wall is twice as stiff as another element
    half = 1.0 if model.walls else 0.5
    normal = half * area / _of(model.contact_compliance)[own]
    if model.contact is not None and model.contact.is_hertz:
        # 2 E* sqrt(R d): of like spheres R/2 and twice the overlap, so half of that of a wall
        normal = 2.0 * half * radius * np.sqrt(HERTZ_OVERLAP) / _of(model.contact_compliance)[own]
    return normal, half * area / _of(model.contact_shear)[own]


def bound_damping(model: Model) -> float:
    """A rate [1/s] that no damping of a motion by dashpots exceeds: as `bound_frequency`."""
    if not model.features.has_dashpots:
        return 0.0
    blocks = _Blocks(model)
    if model.evm_dashpot is not None:
        blocks.add_beams(slice(model.facet_bonds, model.bonds), *model.evm_dashpot.T)
    if model.features.has_retardation:  # of the whole opening: its deviator has less
        viscosity = _of(model.facet_stiffness) * _of(model.retardation)[model.bond_law]
        blocks.add_springs(slice(0, model.facet_bonds), viscosity)
    return 2.0 * blocks.greatest()


def link_states(model: Model) -> list[NDArray[np.bool_]]:
    """States of links whose frequencies stand for those that a run may meet, (b,) each.

    All linked; and, where bonds may be unlinked, all of those unlinked, and a random half.
    """
    states = [np.ones(model.bonds, dtype=bool)]
    if model.listed_bonds is not None:
        rng = np.random.default_rng(0)
        for share in (1.0, 0.5):
            linked = np.ones(model.bonds, dtype=bool)
            linked[model.listed_bonds] = rng.random(len(model.listed_bonds)) >= share
            if model.interface_halves is not None:  # which part together
                linked[model.interface_halves] = linked[model.interface_bonds, None]
            states.append(linked)
    return states


class _Blocks:
    """Diagonal blocks K_ii of the stiffness matrix, displacement first, then turning."""

    def __init__(self, model: Model) -> None:
        self.model, self.dim = model, model.features.dim
        self.spins = 1 if self.dim == 2 else 3
        size = self.dim + self.spins
        self.k = np.zeros((model.elements, size, size))

    def add_springs(self, bonds: slice, stiffness: Array) -> None:
        """Isotropic springs between facet points: delta = u_j + th_j x c_j - u_i - th_i x c_i."""
        ends = bond_ends(self.model)
        for side, element in enumerate((self.model.bond_i, self.model.bond_j)):
            gradient = np.concatenate(
                [np.broadcast_to(np.eye(self.dim), (len(stiffness), self.dim, self.dim)),
                 self._turning(ends[bonds, side])], axis=2,
            )  # fmt: skip
            k = stiffness[:, None, None] * np.swapaxes(gradient, 1, 2) @ gradient
            np.add.at(self.k, element[bonds], k)

    def add_couples(self, bending: Array) -> None:
        """Bending and twist of facets (theory B9), both bounded by the greater."""
        m, dim = self.model, self.dim
        both = bending.max(axis=1)
        for element in (m.bond_i, m.bond_j):
            total = np.bincount(element[: m.facet_bonds], both, minlength=m.elements)
            for spin in range(dim, dim + self.spins):
                self.k[:, spin, spin] += total

    def add_beams(
        self, bonds: slice, longitudinal: Array, shear: Array, bending: Array, torsion: Array
    ) -> None:
        """EVM bonds, linearised (theory A2): c_A, c_D along and across, c_B, c_T in turning."""
        m = self.model
        a, n, offset = _of(m.evm_length), _of(m.evm_direction), _of(m.evm_offset)
        along = n[:, :, None] * n[:, None, :]
        across = np.eye(self.dim) - along
        for side, element in enumerate((m.bond_i, m.bond_j)):
            reach = (offset[:, side] + 0.5 * a) * (1.0 if side == 0 else -1.0)
            turn = self._turning(reach[:, None] * n)
            turn_t = np.swapaxes(turn, 1, 2)
            c = longitudinal[:, None, None] * along + shear[:, None, None] * across
            k = np.zeros((len(a), self.dim + self.spins, self.dim + self.spins))
            k[:, : self.dim, : self.dim] = c
            k[:, : self.dim, self.dim :] = c @ turn
            k[:, self.dim :, : self.dim] = turn_t @ c
            k[:, self.dim :, self.dim :] = turn_t @ c @ turn
            if self.dim == 2:
                k[:, 2, 2] += bending
            else:
                k[:, 3:, 3:] += bending[:, None, None] * across + torsion[:, None, None] * along
            np.add.at(self.k, element[bonds], k)

    def greatest(self) -> float:
        """Greatest eigenvalue of M_i^-1 K_ii over all elements."""
        m, dim = self.model, self.dim
        root = np.zeros_like(self.k)
        root[:, range(dim), range(dim)] = np.sqrt(m.inverse_mass)
        root[:, dim:, dim:] = inverse_inertia_root(m)
        matrix = root @ self.k @ root
        if not np.isfinite(matrix).all():
            raise InputError(TOO_FAR_APART)
        return float(np.linalg.eigvalsh(matrix).max())

    def _turning(self, arm: Array) -> Array:
        """Matrix of th -> th x c, (b, dim, spins)."""
        if self.dim == 2:
            return np.stack([-arm[:, 1], arm[:, 0]], axis=1)[:, :, None]
        x, y, z = arm.T
        o = np.zeros_like(x)
        return np.stack([o, z, -y, -z, o, x, y, -x, o], axis=1).reshape(-1, 3, 3)


def _of(array: Array | None) -> Array:
    assert array is not None
    return array


def _volume_springs(model: Model) -> Array:
    """Stiffness of springs at the faces that hold no less energy than the volume term (B8)."""
    if model.bond_weight is None or model.bond_face is None or model.bond_area is None:
        return np.zeros(model.bonds)
    linked = np.append(np.ones(model.bonds), 0.0)
    a = volume_stiffness(model, linked)
    if model.features.has_retardation:
        a = a + retarded(model, linked)[1]
    a = np.maximum(a, 0.0)
    face, x = model.bond_face[:-2].reshape(-1, 2), face_reach(model)
    ends = np.stack([model.bond_i, model.bond_j], axis=1)
    ax = (a * x)[ends]
    # S/r0^2 (q_i A_i X_i + q_j A_j X_j), with S q and w = S/r0 at hand
    return (model.bond_weight / model.bond_area) ** 2 * (face * ax).sum(axis=1)

"""The greatest stable time step (theory A9, B8)."""

import numpy as np
from numpy.typing import NDArray

from .step import Step


def largest_frequency(step: Step, spacing: float) -> float:
    """Greatest angular frequency [rad/s] of small motions about the reference state.

    Lanczos iteration on M^-1/2 K M^-1/2, K applied by the step's own force passes to small
    displacements: the well-converging form of power iteration. Overwrites the state.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    m, n = step.model, step.model.elements
    dim = m.features.dim
    spins = 1 if dim == 2 else 3
    root = np.concatenate(
        [np.sqrt(m.inverse_mass).ravel(), np.repeat(np.sqrt(m.inverse_inertia), spins)]
    )
    free = np.flatnonzero(root)
    if len(free) == 0:
        return 0.0
    small = 1e-6 if step.download("displacement").dtype == np.float64 else 1e-4
    rotation = np.zeros((n, 2 if dim == 2 else 4))

    def stiffness(y: NDArray[np.float64]) -> NDArray[np.float64]:
        motion = np.zeros_like(root)
        motion[free] = root[free] * y
        size = np.abs(motion[: n * dim]).max() + spacing * np.abs(motion[n * dim :]).max()
        scale = small * spacing / size if size > 0.0 else 0.0
        u = (scale * motion[: n * dim]).reshape(n, dim)
        turn = (scale * motion[n * dim :]).reshape(n, spins)
        rotation[:, :spins] = 0.5 * turn
        rotation[:, -1] = np.sqrt(1.0 - 0.25 * (turn**2).sum(axis=1))
        step.upload("displacement", u)
        step.upload("orientation", rotation)
        step.evaluate_forces()
        force, torque = gathered(step)
        back = np.concatenate([force.ravel(), torque.ravel()])
        return -(root * back)[free] / scale if scale > 0.0 else np.zeros(len(free))

    operator = LinearOperator((len(free), len(free)), matvec=stiffness, dtype=np.float64)
    if len(free) < 12:
        matrix = np.stack([stiffness(e) for e in np.eye(len(free))])
        greatest = float(np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[-1])
    else:
        start = np.random.default_rng(0).normal(size=len(free))
        greatest = float(
            eigsh(operator, k=1, which="LA", v0=start, tol=1e-3, return_eigenvectors=False)[0]
        )
    return float(np.sqrt(max(greatest, 0.0)))


def gathered(step: Step) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Force [N] and torque [N m] that the bonds exert on every element, summed in float64."""
    m = step.model
    force = step.download("bond_force").astype(np.float64)
    torque = step.download("bond_torque").astype(np.float64)
    sign = 1.0 - 2.0 * (m.incidence & 1)[..., None]
    return (sign * force[m.incidence >> 1]).sum(axis=0), torque[m.incidence].sum(axis=0)

"""Fields derived from stresses: invariants, principal values, elastic strain."""

import numpy as np
from numpy.typing import ArrayLike

from .errors import Array


def stress_tensor(columns: ArrayLike) -> Array:
    """Tensors (n, 3, 3) from columns xx, yy, xy, zz (n, 4) or xx, yy, zz, xy, yz, xz (n, 6)."""
    c = np.asarray(columns, dtype=np.float64)
    t = np.zeros((len(c), 3, 3))
    if c.shape[1] == 4:
        t[:, 0, 0], t[:, 1, 1], t[:, 2, 2] = c[:, 0], c[:, 1], c[:, 3]
        t[:, 0, 1] = t[:, 1, 0] = c[:, 2]
    else:
        for column, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))):
            t[:, i, j] = t[:, j, i] = c[:, column]
    return t


def pressure(stress: Array) -> Array:
    """-tr(sigma)/3 [Pa], (n,): positive in compression."""
    return -np.trace(stress, axis1=1, axis2=2) / 3.0


def in_space(v: Array) -> Array:
    """Vectors (n, 2) or (n, 3) as (n, 3), plane ones at z = 0."""
    return v if v.shape[1] == 3 else np.column_stack([v, np.zeros(len(v))])


def von_mises(stress: Array) -> Array:
    """sqrt(3/2 s : s) of the deviator [Pa], (n,)."""
    deviator = stress + pressure(stress)[:, None, None] * np.eye(3)
    return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))


def principal(stress: Array) -> Array:
    """Principal values [Pa], greatest first, (n, 3)."""
    return np.linalg.eigvalsh(stress)[:, ::-1].astype(np.float64)


def elastic_strain(stress: Array, shear_modulus: Array, coupling: Array) -> Array:
    """Hooke's law solved for the strain: (sigma - D mean(sigma) 1)/2G, D = 3 nu/(1 + nu)."""
    mean = -coupling * pressure(stress)
    return (stress - mean[:, None, None] * np.eye(3)) / (2.0 * shear_modulus)[:, None, None]

"""NumPy float64 transcription of the papers, independent of the device code.

Written for clarity and with full rotation matrices; used to check, never to simulate.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..errors import Array
from ..material import Material
from ..packing import Packing


def rotation_matrices(orientation: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions (x, y, z, w) or of plane (sin, cos) halves."""
    q = np.asarray(orientation)
    if q.shape[1] == 2:
        q = np.stack([np.zeros(len(q)), np.zeros(len(q)), q[:, 0], q[:, 1]], axis=1)
    return Rotation.from_quat(q).as_matrix()


def in_space(v: Array) -> Array:
    """Vectors of the plane as vectors of space."""
    v = np.asarray(v)
    return v if v.shape[-1] == 3 else np.concatenate([v, np.zeros((*v.shape[:-1], 1))], axis=-1)


def triads(direction: Array, turn: Array) -> tuple[Array, Array]:
    """Vectors n_ik, n_jk of Kuzkin eq. 1 in the reference state, (b, 3, 3) each.

    direction: e_ij (b, 3); turn: angle (b,) by which n_2, n_3 are turned about it, arbitrary.
    The triad of j is left-handed, as eq. 1 has it.
    """
    e = in_space(direction)
    other = np.where(np.abs(e[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = np.cross(e, other)
    u /= np.linalg.norm(u, axis=1)[:, None]
    v = np.cross(e, u)
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    n2, n3 = c * u + s * v, -s * u + c * v
    return np.stack([e, n2, n3], axis=1), np.stack([-e, n2, n3], axis=1)


def evm(
    r: Array, ni: Array, nj: Array, ends: Array, a: Array, b: Array
) -> tuple[Array, Array, Array, Array]:
    """Kuzkin eqs 2 and 3, literally: U (b,), F_ij, M_ij, M_ji (b, 3).

    r: r_ij (b, 3); ni, nj: vectors n_ik, n_jk (b, 3, 3) now; ends: R_i, R_j (b, 2); a (b,);
    b: B_1..B_4 (b, 4).
    """
    b1, b2, b3, b4 = b.T
    ri, rj = ends[:, :1], ends[:, 1:]
    ni1, ni2, ni3 = np.moveaxis(ni, 1, 0)
    nj1, nj2, nj3 = np.moveaxis(nj, 1, 0)
    big = r + rj * nj1 - ri * ni1
    length = np.linalg.norm(big, axis=1)
    d = big / length[:, None]

    def dot(x: Array, y: Array) -> Array:
        return (x * y).sum(axis=1)

    energy = (
        b1 / 2 * (length - a) ** 2
        + b2 / 2 * dot(nj1 - ni1, d)
        + b3 * dot(ni1, nj1)
        - b4 / 2 * (dot(ni2, nj2) + dot(ni3, nj3))
    )
    force = (b1 * (length - a))[:, None] * d + (b2 / (2 * length))[:, None] * (
        nj1 - ni1 - dot(d, nj1 - ni1)[:, None] * d
    )
    both = b3[:, None] * np.cross(nj1, ni1)
    both -= (b4 / 2)[:, None] * (np.cross(nj2, ni2) + np.cross(nj3, ni3))
    half = (b2 / 2)[:, None]
    on_i = ri * np.cross(ni1, force) - half * np.cross(d, ni1) + both
    on_j = rj * np.cross(nj1, -force) + half * np.cross(d, nj1) - both
    return energy, force, on_i, on_j


def facet_energy(
    displacement: Array,
    orientation: Array,
    bonds: NDArray[np.int64],
    arms: Array,
    area: Array,
    volume: Array,
    young: float,
    poisson: float,
    plane: str | None,
) -> float:
    """U of theory B2a and B4 of a body of facet bonds, from full rotations [J]."""
    g = young / (2 * (1 + poisson))
    coupling = 3 * poisson / (1 + poisson)
    q = rotation_matrices(orientation)
    u, c0 = in_space(displacement), in_space(arms)
    i, j = bonds.T
    ci = np.einsum("bxy,by->bx", q[i], c0[:, 0])
    cj = np.einsum("bxy,by->bx", q[j], c0[:, 1])
    centre = c0[:, 0] - c0[:, 1]
    r0 = np.linalg.norm(centre, axis=1)
    delta = centre + u[j] - u[i] + cj - ci
    w = area / r0
    pair = (g * w * (delta**2).sum(axis=1)).sum()
    dilation, faces = np.zeros(len(volume)), np.zeros(len(volume))
    qij = (c0[:, 0] * centre).sum(axis=1) / r0
    np.add.at(dilation, i, w * (ci * delta).sum(axis=1))
    np.add.at(dilation, j, -w * (cj * delta).sum(axis=1))
    np.add.at(faces, i, area * qij)
    np.add.at(faces, j, area * (r0 - qij))
    dilation, faces = dilation / volume, faces / volume
    starred = faces + (plane == "strain")
    a = 2 * g * coupling / (3 - coupling * starred)
    return float(pair + (volume * a * dilation**2 / 2).sum())


def hooke(strain: Array, young: float, poisson: float, plane: str | None) -> Array:
    """Stress (3, 3) of a uniform strain (dim, dim): Hooke's law, eps_zz = 0 in plane strain."""
    g = young / (2 * (1 + poisson))
    full = np.zeros((3, 3))
    full[: len(strain), : len(strain)] = strain
    if plane == "stress":
        full[2, 2] = -poisson / (1 - poisson) * np.trace(strain)
    lame = 2 * g * poisson / (1 - 2 * poisson)
    return 2 * g * full + lame * np.trace(full) * np.eye(3)


def von_mises(stress: Array) -> float:
    """Stress intensity of a tensor (3, 3)."""
    deviator = stress - np.trace(stress) / 3 * np.eye(3)
    return float(np.sqrt(1.5 * (deviator**2).sum()))


def equivalent_stress(stress: Array, kind: str, ratio: float) -> float:
    """Left side of Shilko eq. 14, or the greatest principal stress (Rankine)."""
    mean = float(np.trace(stress)) / 3
    if kind == "rankine":
        return float(np.linalg.eigvalsh(stress)[-1])
    if kind == "huber_mises_hencky":
        return von_mises(stress)
    return 0.5 * (ratio + 1) * von_mises(stress) + 1.5 * (ratio - 1) * mean


def ricker(time: NDArray, frequency: float) -> NDArray:
    """Ricker's wavelet of a dominant frequency [Hz], its peak of 1 at time 0; entire in time."""
    square = (np.pi * frequency * time) ** 2
    return (1.0 - 2.0 * square) * np.exp(-square)


def line_load(
    distance: float, time: Array, frequency: float, material: Material, plane: str
) -> Array:
    """Displacement (t, 2) at the surface of a half-space y < 0 under a line load at x = 0 (Lamb).

    The load is Ricker's wavelet, of unit peak [N/m], downwards. distance x > 0 [m]; time [s] of its
    peak >= 0. Cagniard and de Hoop: at the surface an impulse gives Im G(t/x + i0)/(pi mu x), with
    G of `half_space_slowness` at the slowness t/x. G and the wavelet are analytic above the real
    axis, so the two are convolved on a line there, away from branch points and Rayleigh's pole.
    """
    s = np.linspace(-2.5, 2.5, 401) / frequency  # the wavelet is below 1e-24 beyond
    lifted = s - 0.15j / frequency
    slowness = (np.asarray(time)[:, None] - lifted) / distance
    wavelet = ricker(lifted, frequency) * (s[1] - s[0])
    across, down = half_space_slowness(slowness, material, plane)
    scale = 1.0 / (np.pi * material.shear_modulus * distance)
    return scale * np.stack([(across @ wavelet).imag, -(down @ wavelet).imag], axis=-1)


def half_space_slowness(p: NDArray, material: Material, plane: str) -> tuple[NDArray, NDArray]:
    """G_x and G_z (downwards) at complex slownesses p along the surface, Im p > 0.

    With a, b the slownesses of P and S waves, alpha = sqrt(a^2 - p^2), beta = sqrt(b^2 - p^2):
    G_x = p (b^2 - 2 p^2 - 2 alpha beta)/R, G_z = alpha b^2/R, R = (b^2 - 2 p^2)^2 + 4 p^2 alpha
    beta.
    """
    a, b = 1.0 / material.pressure_speed(plane), 1.0 / material.shear_speed()
    square = p * p
    alpha, beta = np.sqrt(a * a - square), np.sqrt(b * b - square)
    rayleigh = (b * b - 2.0 * square) ** 2 + 4.0 * square * alpha * beta
    return p * (b * b - 2.0 * square - 2.0 * alpha * beta) / rayleigh, alpha * b * b / rayleigh


def finite_energy(
    packing: Packing,
    displacement: Array,
    orientation: Array,
    slip: Array,
    plastic_dilation: Array,
    material: Material,
) -> float:
    """U of theory B6 at finite strain, from full rotations and present places [J].

    slip: how far the anchors of each bond are from its facet points, in the elements' frames
    (b, 2, dim); plastic_dilation: P of every element (n,).
    """
    dim, (i, j) = packing.dim, packing.bonds.T
    assert packing.area is not None and packing.arms is not None
    q = rotation_matrices(orientation)[:, :dim, :dim]
    x = packing.position + displacement
    arms, w = packing.arms, packing.area / packing.bond_length
    yi = x[i] + np.einsum("bxy,by->bx", q[i], arms[:, 0] + slip[:, 0])
    yj = x[j] + np.einsum("bxy,by->bx", q[j], arms[:, 1] + slip[:, 1])
    pair = material.shear_modulus * (w * ((yj - yi) ** 2).sum(axis=1)).sum()
    now, then = np.zeros((2, len(x), dim, dim))
    for side, (own, other) in enumerate(((i, j), (j, i))):
        across = np.einsum("b,bx,by->bxy", w, x[other] - x[own], arms[:, side])
        before = packing.position[other] - packing.position[own]
        np.add.at(now, own, across)
        np.add.at(then, own, np.einsum("b,bx,by->bxy", w, before, arms[:, side]))
    dilation = np.log(np.linalg.det(now) / np.linalg.det(then)) - plastic_dilation
    d = material.coupling
    a = 2.0 * material.shear_modulus * d / (3.0 - d * (dim + (packing.plane == "strain")))
    return float(pair + (0.5 * packing.volume * a * dilation**2).sum())

"""NumPy float64 transcription of the papers, independent of the device code.

Written for clarity and with full rotation matrices; used to check, never to simulate.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from ..errors import Array
from ..material import Material


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


def pair_tensor(mean: Array, traction: Array, normal: Array) -> Array:
    """Tensor on a face (3, 3): its own traction, and the tangential parts of a mean tensor.

    Component by component in a frame of the normal (Shilko eq. 13 with all tangential components).
    """
    frame, _ = np.linalg.qr(np.column_stack([normal, np.eye(3)]))
    frame[:, 0] = normal
    t = frame.T @ mean.reshape(3, 3) @ frame
    t[0] = t[:, 0] = frame.T @ traction
    return frame @ t @ frame.T


class FlowingPoint:
    """A point of a solid that flows, by backward Euler on full 3 x 3 tensors: strains in, stress
    out.

    flow: stress intensity of flow at a plastic strain and its rate; q + friction m reaches it.
    Plane stress is found by searching for the strain across the plane at which sigma_zz = 0, not by
    a return of its own.
    """

    def __init__(
        self,
        young: float,
        poisson: float,
        plane: str | None,
        flow: Callable[[float, float], float],
        friction: float = 0.0,
        dilatancy: float = 0.0,
    ) -> None:
        self.shear = young / (2 * (1 + poisson))
        self.bulk = young / (3 * (1 - 2 * poisson))
        self.plane, self.flow = plane, flow
        self.friction, self.dilatancy = friction, dilatancy
        self.plastic = np.zeros((3, 3))
        self.p = 0.0
        self._across = 0.0

    def strain_to(self, strain: Array, dt: float) -> Array:
        """Stress (3, 3) after going to a strain (dim, dim) within dt."""
        e = np.zeros((3, 3))
        e[: len(strain), : len(strain)] = strain
        if self.plane == "stress":

            def across(ezz: float) -> float:
                e[2, 2] = ezz
                return float(self._returned(e, dt)[0][2, 2])

            width = 1e-3
            while across(self._across - width) > 0.0 or across(self._across + width) < 0.0:
                width *= 2.0
            ends = self._across - width, self._across + width
            self._across = e[2, 2] = brentq(across, *ends, xtol=1e-19, rtol=1e-15)
        stress, self.plastic, self.p = self._returned(e, dt)
        return stress

    def _returned(self, e: Array, dt: float) -> tuple[Array, Array, float]:
        one, g, k = np.eye(3), self.shear, self.bulk
        elastic = e - self.plastic
        m = k * np.trace(elastic)
        deviator = 2 * g * (elastic - np.trace(elastic) / 3 * one)
        q = float(np.sqrt(1.5 * (deviator**2).sum()))
        a, b = self.friction, self.dilatancy

        def excess(dp: float) -> float:
            at = max(q - 3 * g * dp, 0.0) + a * (m - k * b * dp)
            return at - self.flow(self.p + dp, dp / dt)

        dp = 0.0
        if excess(0.0) > 0.0:
            far = (q + a * max(m, 0.0)) / (3 * g)
            while excess(far) > 0.0:
                far *= 2.0
            dp = brentq(excess, 0.0, far, xtol=1e-19, rtol=1e-15)
        left = max(1 - 3 * g * dp / q, 0.0) if q > 0.0 else 0.0
        flowed = (1 - left) * deviator / (2 * g) + b * dp / 3 * one
        return left * deviator + (m - k * b * dp) * one, self.plastic + flowed, self.p + dp


def equivalent_stress(stress: Array, kind: str, x: tuple[float, ...] = ()) -> float:
    """Shilko eq. 14, or the criteria of Rankine and of Mohr and Coulomb, on a tensor (3, 3).

    x: a of Drucker and Prager; sin(phi) and 2 c cos(phi) over the cut-off of Mohr and Coulomb.
    """
    mean = float(np.trace(stress)) / 3
    third, _, first = np.linalg.eigvalsh(stress)
    if kind == "rankine":
        return float(first)
    if kind == "mohr_coulomb":
        return float(max(first - third + (first + third) * x[0], first * x[1]))
    if kind == "huber_mises_hencky":
        return von_mises(stress)
    return 0.5 * (x[0] + 1) * von_mises(stress) + 1.5 * (x[0] - 1) * mean


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


class Creep:
    """Facet bonds of one Prony series, step by step from given places (theory B12).

    Full rotation matrices; branches are vectors in the mean frame of a bond.
    """

    def __init__(
        self,
        bonds: NDArray[np.int64],
        arms: Array,
        area: Array,
        volume: Array,
        material: Material,
        plane: str | None,
        shares: Array,
        lost: Array,
    ) -> None:
        self.i, self.j = bonds.T
        self.c0, self.volume, self.plane = in_space(arms), volume, plane
        self.g, self.lost = shares, lost  # lost: 1 - exp(-dt/T_k)
        self.shear, self.coupling = material.shear_modulus, material.coupling
        self.centre = self.c0[:, 0] - self.c0[:, 1]
        self.r0 = np.linalg.norm(self.centre, axis=1)
        self.w = area / self.r0
        q = np.einsum("bx,bx->b", self.c0[:, 0], self.centre) / self.r0
        faces = self._sums(area * q, -area * (self.r0 - q))
        self.soft = 3.0 - self.coupling * (faces + (plane == "strain"))
        self.p = np.zeros((len(shares), len(bonds), 3))
        self.anchors = np.zeros((2, len(bonds), 3))  # of the slip, half with each element
        self.z = np.zeros((len(shares), len(volume)))

    def start(self, displacement: Array, orientation: Array) -> None:
        """The first places, which are reached at once."""
        self._place(displacement, orientation)
        self.opening = np.einsum("bxy,bx->by", self.frame, self.delta)
        self.mean = self._mean()

    def step(self, displacement: Array, orientation: Array) -> tuple[Array, Array, Array]:
        """Move on by a step; force on i and torques on i and j of every bond, (b, 3) each."""
        before = self.mean
        self._place(displacement, orientation)
        mean = 0.5 * (before + self._mean())
        if self.plane is not None:
            mean = self._creep_across(mean)
        opening = np.einsum("bxy,bx->by", self.frame, self.delta)
        h = (1.0 - self.coupling) * mean / (2.0 * self.shear)
        spherical = h[self.i, None] * self.ci - h[self.j, None] * self.cj
        e = 0.5 * (opening + self.opening) - np.einsum("bxy,bx->by", self.frame, spherical)
        self.p += self.lost[:, None, None] * (e - self.p)
        self.opening = opening
        slip = np.einsum("bxy,by->bx", self.frame, np.tensordot(self.g, self.p, 1))
        for half, turned in zip(self.anchors, (self.q[self.i], self.q[self.j]), strict=True):
            half[:] = np.einsum("bxy,bx->by", turned, 0.5 * slip)
        self.mean = self._mean()
        return self._forces()

    def _place(self, displacement: Array, orientation: Array) -> None:
        q = rotation_matrices(orientation)
        u = in_space(displacement)
        self.ci = np.einsum("bxy,by->bx", q[self.i], self.c0[:, 0])
        self.cj = np.einsum("bxy,by->bx", q[self.j], self.c0[:, 1])
        self.delta = self.centre + u[self.j] - u[self.i] + self.cj - self.ci
        turn = Rotation.from_matrix(np.swapaxes(q[self.i], 1, 2) @ q[self.j])
        half = Rotation.from_rotvec(0.5 * turn.as_rotvec()).as_matrix()
        self.frame = q[self.i] @ half
        self.q = q

    def _slip(self) -> Array:
        turned = self.q[self.i], self.q[self.j]
        first, second = (
            np.einsum("bxy,by->bx", q, half) for q, half in zip(turned, self.anchors, strict=True)
        )
        return first + second

    def _dilation(self) -> Array:
        elastic = self.w[:, None] * (self.delta - self._slip())
        e = self._sums((self.ci * elastic).sum(axis=1), (self.cj * elastic).sum(axis=1))
        return e - (self.g @ self.z if self.plane == "strain" else 0.0)

    def _mean(self) -> Array:
        return 2.0 * self.shear * self._dilation() / self.soft

    def _creep_across(self, mean: Array) -> Array:
        """Creep of the strain across the plane; the mean stress in the middle of the step."""
        two = 2.0 * self.shear
        if self.plane == "strain":
            across = -(1.0 - self.coupling) * mean / two
            self.z += self.lost[:, None] * (across - self.z)
            return mean
        # sigma_zz = 0: e_zz = z - m/2G, and m rises by 2G/soft times half of what z does
        rate = self.g * self.lost
        across = np.empty_like(mean)
        for n in range(len(mean)):
            half = 0.5 / self.soft[n]
            # unknown e, dz, m: e = z + dz/2 - m/2G, dz = rate.(e - z_k), m = mean + 2G half dz
            a = np.array([[1.0, -0.5, 1.0 / two], [-rate.sum(), 1.0, 0.0], [0.0, -two * half, 1.0]])
            z = self.z[:, n]
            across[n], _, mean[n] = np.linalg.solve(a, [self.g @ z, -rate @ z, mean[n]])
        self.z += self.lost[:, None] * (across - self.z)
        return mean

    def _forces(self) -> tuple[Array, Array, Array]:
        p = self._slip()
        d = self.delta - p
        g = self.coupling * self.mean
        k = 2.0 * self.shear * self.w[:, None]
        fi = self.w[:, None] * g[self.i, None] * self.ci
        fj = -self.w[:, None] * g[self.j, None] * self.cj
        ai, aj = self.ci + 0.5 * p, self.cj - 0.5 * p  # to facet points, each with half of the slip
        f = k * d
        ti = np.cross(ai, f + fj) + np.cross(ai + d, fi)
        tj = -np.cross(aj, f + fi) - np.cross(aj - d, fj)
        return f + fi + fj, ti, tj

    def _sums(self, first: Array, second: Array) -> Array:
        n = len(self.volume)
        return (np.bincount(self.i, first, n) - np.bincount(self.j, second, n)) / self.volume

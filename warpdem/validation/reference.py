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


def finite_flow(
    packing: Packing,
    displacement: Array,
    orientation: Array,
    slip: Array,
    plastic: Array,
    dilation: Array,
    out: Array,
    material: Material,
    flow_stress: Callable[[float], float],
) -> tuple[Array, Array, Array, Array]:
    """One return of theory B6 at finite strain: slips (b, 2, dim), plastic strain, P, eps_zz after.

    plastic, dilation, out: plastic strain, P and plastic eps_zz of every element before.
    """
    from scipy.optimize import brentq

    dim, (i, j), n = packing.dim, packing.bonds.T, len(packing)
    assert packing.area is not None and packing.arms is not None
    plane, g2 = packing.plane, 2.0 * material.shear_modulus
    q = rotation_matrices(orientation)[:, :dim, :dim]
    x, arms = packing.position + displacement, packing.arms
    w = packing.area / packing.bond_length
    anchor = [np.einsum("bxy,by->bx", q[e], arms[:, s] + slip[:, s]) for s, e in ((0, i), (1, j))]
    spring = g2 * w[:, None] * (x[j] + anchor[1] - x[i] - anchor[0])
    own = ((i, j, 1.0, 0), (j, i, -1.0, 1))

    def summed(value: Array) -> Array:
        total = np.zeros((n, *value.shape[2:]))
        for side, (element, *_) in enumerate(own):
            np.add.at(total, element, value[:, side])
        return total / packing.volume.reshape(-1, *[1] * (value.ndim - 2))

    def over(pairs: list[Array]) -> Array:
        return summed(np.stack(pairs, axis=1))

    shape = over(
        [np.einsum("b,bx,by->bxy", w * f, packing.bond_vector, arms[:, s]) for _, _, f, s in own]
    )
    inverse = np.linalg.inv(shape)
    f = over([np.einsum("b,bx,by->bxy", w * f, x[j] - x[i], arms[:, s]) for _, _, f, s in own])
    f = f @ inverse
    d = material.coupling
    a = g2 * d / (3.0 - d * (dim + (plane == "strain")))
    elastic = np.log(np.linalg.det(f)) - dilation
    pull = np.einsum("n,nxy,nzy->nxz", a * elastic, np.linalg.inv(f).swapaxes(1, 2), inverse)
    force = spring + w[:, None] * (
        np.einsum("bxy,by->bx", pull[i], arms[:, 0]) - np.einsum("bxy,by->bx", pull[j], arms[:, 1])
    )
    nominal = over([np.einsum("bx,by->bxy", f * force, arms[:, s]) for _, _, f, s in own])
    springs = over([np.einsum("bx,by->bxy", f * spring, arms[:, s]) for _, _, f, s in own])
    springs = springs @ inverse
    rate, share, grown, widened = np.zeros((n, dim, dim)), np.ones(n), np.zeros(n), np.zeros(n)
    extra = np.zeros(n)
    for e in range(n):
        tau, b = np.zeros((3, 3)), np.eye(3)
        tau[:dim, :dim] = nominal[e] @ f[e].T
        tau = 0.5 * (tau + tau.T)
        b[:dim, :dim] = f[e] @ f[e].T
        volume = np.linalg.det(f[e])
        pulled = springs[e] @ f[e].T
        z = np.trace(pulled) - g2 * elastic[e]
        if plane == "strain":
            tau[2, 2] = a * elastic[e] - g2 * out[e]
            z -= g2 * out[e]
        if plane == "stress":
            b[2, 2] = 0.0
            volume *= np.exp(-a * elastic[e] / g2 - dilation[e])
        if von_mises(tau) <= volume * flow_stress(plastic[e]):
            continue
        mean = np.trace(tau) / 3.0 - z / 3.0

        def after(y: float, tau=tau, b=b, mean=mean) -> tuple[Array, Array]:
            """tau + G sym(D b)/.. = trial, D = y (tau - m)/2G, as one linear system."""
            unit = np.eye(9).reshape(9, 3, 3)
            plate = plane == "stress"

            def fallen(t: Array) -> Array:
                m = np.trace(t) / 3.0 if plate else 0.0
                flow = y * (t - m * np.eye(3))
                if plate:
                    flow[2], flow[:, 2] = 0.0, 0.0
                less = t + 0.5 * (flow @ b + b @ flow)
                if plate:
                    less[:2, :2] += y * a / g2 * m * np.eye(2)
                return less

            right = tau.copy()
            if not plate:
                right += y * mean * b
            system = np.stack([fallen(t).ravel() for t in unit], axis=1)
            t = np.linalg.solve(system, right.ravel()).reshape(3, 3)
            return t, t - (np.trace(t) / 3.0 if plate else mean) * np.eye(3)

        def excess(y: float, e=e, volume=volume) -> float:
            t, _ = after(y)
            p = plastic[e] + 2.0 / 3.0 * y / g2 * von_mises(t)
            return von_mises(t) - volume * flow_stress(p)

        top = 1.0
        while excess(top) > 0.0:
            top *= 2.0
        y = float(brentq(excess, 0.0, top, xtol=1e-15, rtol=1e-14))
        t, way = after(y)
        gain = (way[:dim, :dim] * pulled).sum() - (way[2, 2] * g2 * out[e] if dim == 2 else 0.0)
        if plane == "stress":
            gain = (way[:2, :2] * pulled).sum()
        y = max(min(y, gain / (0.5 * np.trace(way @ way @ b))), 0.0)
        rate[e], share[e] = (y / g2 * way)[:dim, :dim] @ f[e], 1.0 / (1.0 + y)
        grown[e] = 2.0 / 3.0 * y / g2 * von_mises(t)
        widened[e] = y / g2 * (np.trace(t) / 3.0 if plane == "stress" else way[2, 2])
        extra[e] = -y / (1.0 + y) * z / g2 if plane == "stress" else 0.0
    # slips, and plastic strains as the slips around an element
    across = arms[:, 0] - arms[:, 1]
    qi = (arms[:, 0] * across).sum(axis=1)
    wi = 1.0 - qi / (across**2).sum(axis=1)
    kept = wi * share[i] + (1.0 - wi) * share[j]
    shared = wi[:, None, None] * springs[i] + (1.0 - wi)[:, None, None] * springs[j]
    beside = spring - w[:, None] * np.einsum("bxy,by->bx", shared, across)
    relaxed = 0.5 * ((1.0 - kept) / (g2 * w))[:, None] * beside
    moved = slip.copy()
    for side, (element, _, sign, s) in enumerate(own):
        p = relaxed + sign * np.einsum("bxy,by->bx", rate[element], arms[:, s])
        moved[:, side] += sign * np.einsum("bxy,bx->by", q[element], p)

    def counted(value: Array) -> Array:
        parts = []
        for element, other, _, s in own:
            way = np.einsum("bxy,bx->by", inverse[element], arms[:, s]) * w[:, None] / dim
            parts.append(
                (way * arms[:, s]).sum(axis=1) * value[element]
                - (way * arms[:, 1 - s]).sum(axis=1) * value[other]
            )
        return over(parts)

    spread = counted(widened)
    zz = out + spread if plane == "strain" else out
    larger = dilation + extra + spread if plane == "stress" else dilation
    return moved, plastic + counted(grown), larger, zz

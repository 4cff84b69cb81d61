"""What a crack's tip draws and what lies before it: energy release rate, stresses, process zone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Array, InputError, finite, positive

if TYPE_CHECKING:
    from ..simulation import Simulation


def gradients(position: Array, bonds: NDArray[np.int64], values: Array) -> Array:
    """Gradient of values (n, k) at every element, (n, k, dim): least squares over bonded elements.

    Exact for linear fields. Zero for elements with fewer neighbours than it takes.
    """
    n, dim = position.shape
    i, j = bonds.T
    r = position[j] - position[i]
    weight = 1.0 / (r**2).sum(axis=1)
    moment = np.zeros((n, dim, dim))
    cross = np.zeros((n, values.shape[1], dim))
    rr = weight[:, None, None] * r[:, :, None] * r[:, None, :]
    dv = weight[:, None, None] * (values[j] - values[i])[:, :, None] * r[:, None, :]
    for ends in (i, j):
        np.add.at(moment, ends, rr)
        np.add.at(cross, ends, dv)
    inverse = np.linalg.pinv(moment, rcond=1e-6, hermitian=True)
    return cross @ inverse


def domain_integral(
    position: ArrayLike,
    volume: ArrayLike,
    displacement_gradient: ArrayLike,
    stress: ArrayLike,
    tip: ArrayLike,
    direction: ArrayLike,
    inner: float,
    outer: float,
    density: ArrayLike = 0.0,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    velocity_gradient: ArrayLike | None = None,
) -> float:
    """Energy release rate of a straight plane crack times its front's length [N], as an integral
    over elements.

        J = sum V { (s : grad u_1 - (W + T) grad 1) . grad q + rho (a . u_1 - v . v_1) q }

    with q = 1 nearer to the tip than `inner`, 0 beyond `outer`, linear between; u_1 is the
    derivative along `direction`, W and T the densities of elastic and kinetic energy, and the last
    term is the flux of kinetic energy (Moran and Shih 1987, Nakamura, Shih and Freund 1985).
    Places, volumes and stresses are of the reference state, stress (n, 2, 2) [Pa]; leave out the
    motion for statics. Over the thickness it is J [J/m^2]. Crack faces within must be free of
    traction and run along `direction`.
    """
    x = finite("position", position, (None, 2))
    n = len(x)
    v = finite("volume", volume, (n,))
    gradient = finite("displacement_gradient", displacement_gradient, (n, 2, 2))
    s = finite("stress", stress, (n, 2, 2))
    ahead = finite("direction", direction, (2,))
    ahead = ahead / np.linalg.norm(ahead)
    positive("inner", inner, ())
    if not outer > inner:
        raise InputError(f"outer is {outer:g} m; it must be greater than inner, {inner:g} m.")
    away = x - finite("tip", tip, (2,))
    r = np.linalg.norm(away, axis=1)
    slope = np.where((r > inner) & (r < outer), -1.0 / (outer - inner), 0.0)
    dq = slope[:, None] * away / np.maximum(r, 1e-12 * outer)[:, None]
    q = np.clip((outer - r) / (outer - inner), 0.0, 1.0)
    u1 = gradient @ ahead
    density_of_energy = 0.5 * (s * gradient).sum(axis=(1, 2))
    motion = (velocity, acceleration, velocity_gradient)
    if any(given is None for given in motion) and any(given is not None for given in motion):
        raise InputError(
            "give velocity, acceleration and velocity_gradient together, or none for statics."
        )
    flux = np.zeros(n)
    if velocity is not None and acceleration is not None and velocity_gradient is not None:
        v_ = finite("velocity", velocity, (n, 2))
        a = finite("acceleration", acceleration, (n, 2))
        v1 = finite("velocity_gradient", velocity_gradient, (n, 2, 2)) @ ahead
        rho = np.broadcast_to(finite("density", density), (n,))
        density_of_energy = density_of_energy + 0.5 * rho * (v_**2).sum(axis=1)
        flux = rho * ((a * u1).sum(axis=1) - (v_ * v1).sum(axis=1)) * q
    inner_part = np.einsum("nij,ni,nj->n", s, u1, dq) - density_of_energy * (dq @ ahead)
    return float((v * (inner_part + flux)).sum())


def energy_release_rate(
    sim: Simulation, tip: ArrayLike, inner: float, outer: float, direction: ArrayLike = (1.0, 0.0)
) -> float:
    """J of a plane crack with its tip at a place [m] now, by `domain_integral` [J/m^2].

    inner, outer [m]: radii about the tip between which it is taken; all of it must lie in bodies.
    """
    if sim.model.features.dim != 2:
        raise InputError("the domain integral is of plane scenes.")
    bodies = sim.scene.bodies
    u = sim.displacement
    x = sim.position - u
    bonds = sim.bonds[sim.linked]
    volume = np.concatenate([b.packing.volume for b in bodies])
    density = np.concatenate([b.density for b in bodies])
    v = sim.velocity
    total = domain_integral(
        x, volume, gradients(x, bonds, u), sim.stress[:, :2, :2], tip, direction, inner, outer,
        density, v, sim.force / (density * volume)[:, None], gradients(x, bonds, v),
    )  # fmt: skip
    return total / bodies[0].packing.thickness


def stress_ahead(
    sim: Simulation, tip: ArrayLike, direction: ArrayLike, reach: float
) -> tuple[Array, Array, Array]:
    """Distance ahead of a tip [m], and normal and shear stress [Pa] on the line of the crack.

    From the elements within a spacing of the line, up to `reach` [m], nearest first. In space the
    line is that through the tip, the plane across it the one spanned with z.
    """
    dim = sim.model.features.dim
    n1 = finite("direction", direction, (dim,))
    n1 = n1 / np.linalg.norm(n1)
    spacing = max(b.packing.spacing for b in sim.scene.bodies)
    away = sim.position - sim.displacement - finite("tip", tip, (dim,))
    distance = away @ n1
    side = np.linalg.norm(away - distance[:, None] * n1, axis=1)
    rows = np.flatnonzero((side < spacing) & (distance > 0.0) & (distance < reach))
    rows = rows[np.argsort(distance[rows])]
    n2 = np.zeros(3)
    n2[:2] = -n1[1], n1[0]
    along = np.zeros(3)
    along[:dim] = n1
    stress = sim.stress[rows]
    return distance[rows], stress @ n2 @ n2, stress @ n2 @ along


def process_zone(sim: Simulation, share: float = 0.5) -> float:
    """Size [m] of the zone ahead of all cracks in which bonds that hold have come near breaking.

    The greatest distance over which bonds whose criterion ratio exceeds `share` hang on a broken
    one: measured from the nearest broken bond, through bonded elements within two spacings.
    """
    from scipy.spatial import cKDTree

    log = sim.broken_bonds()
    if len(log) == 0:
        return 0.0
    if not 0.0 < share < 1.0:
        raise InputError(f"share is {share:g}; give one between 0 and 1.")
    dim = sim.model.features.dim
    spacing = max(b.packing.spacing for b in sim.scene.bodies)
    x = sim.position - sim.displacement
    high = np.flatnonzero((sim.criterion_ratio > share) & sim.linked)
    if len(high) == 0:
        return 0.0
    middle = x[sim.bonds[high]].mean(axis=1)
    broken = np.stack([log[c] for c in "xyz"[:dim]], axis=1)
    distance = cKDTree(broken).query(middle)[0]
    # outwards as far as there is no gap of more than two spacings
    order = np.sort(distance)
    gap = np.flatnonzero(np.diff(np.concatenate([[0.0], order])) > 2.0 * spacing)
    last = gap[0] - 1 if len(gap) else len(order) - 1
    return float(order[last]) if last >= 0 else 0.0

"""Scenes at rest: relaxation on the device, Newton's method with a sparse solver on the host."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .errors import Array, InputError, NotConvergedError, positive, whole_number
from .model import Model
from .step import Step, gathered

LOOK_EVERY = 32  # steps of relaxation between looks at the residual
DIFFERENCE = 5e-4  # of a spacing, and of a radian: central differences of fourth order
SMALLEST = 1e-3  # share of the loads below which a load step is not halved again
TURN_MOST = 0.3  # rad that Newton's method turns an element by at once
Telling = Callable[[int, float], None]


def residual(step: Step, spacing: float) -> float:
    """Greatest net force on a free axis over the greatest force of a bond or from outside.

    A torque counts as the force at an arm of one spacing.
    """
    m = step.model
    net = np.concatenate(_net(step), axis=1) * _free(m)
    sizes = [np.abs(step.download(x)).max(initial=0.0) for x in ("end_force", "end_torque")]
    for at, outer in enumerate(_outer(step)):
        sizes[at] = max(sizes[at], np.abs(outer).max(initial=0.0))
    net[:, m.features.dim :] /= spacing
    size = max(sizes[0], sizes[1] / spacing)
    return float(np.abs(net).max(initial=0.0) / size) if size > 0.0 else 0.0


def _refuse_flight(step: Step) -> None:
    """Raise if loads push a body along an axis on which nothing is held."""
    if step.model.walls:
        return
    outer = _outer(step)[0]
    free = (step.model.inverse_mass > 0.0).all(axis=0)
    push, size = np.abs(outer.sum(axis=0)), np.abs(outer).sum()
    if (free & (push > 1e-9 * size)).any():
        axes = ", ".join("xyz"[a] for a in np.flatnonzero(free & (push > 1e-9 * size)))
        raise NotConvergedError(
            f"the loads push the scene along {axes}, where nothing is held: it has no place of "
            "rest; hold some elements."
        )


def _net(step: Step) -> tuple[Array, Array]:
    """Force and torque on every element, those from outside included."""
    (force, torque), (outer_force, outer_torque) = gathered(step), _outer(step)
    return force + outer_force, torque + outer_torque


def _outer(step: Step) -> tuple[Array, Array]:
    """Force and torque on every element from outside, at this instant."""
    n, dim = step.model.elements, step.model.features.dim
    outer = np.zeros((n, dim)), np.zeros((n, 1 if dim == 2 else 3))
    for total, kind in zip(outer, ("force", "torque"), strict=True):
        if "external_" + kind in step.arrays:
            total += step.download("external_" + kind)
        if "timed_" + kind in step.arrays:
            each = step.download("timed_" + kind).reshape(-1, *total.shape)
            total += np.einsum("l,lnk->nk", step.download("load_factor"), each)
    return outer


def relax(
    step: Step, spacing: float, tolerance: float, max_steps: int, tell: Telling | None
) -> float:
    """Bring a scene to rest by FIRE; grips stand still, nothing breaks, no time passes.

    Returns the residual over the size of the bond forces; raises NotConvergedError.
    """
    whole_number("max_steps", max_steps)
    positive("tolerance", tolerance, ())
    _refuse_flight(step)
    held = {name: step.download(name) for name in ("velocity", "angular_velocity")}
    for name, value in held.items():
        step.upload(name, np.zeros_like(value))
    if "grip_factor" in step.arrays:
        step.upload("grip_factor", np.zeros(len(step.model.grip_histories)))
    step.evaluate_forces()
    step.start_relaxing()
    count = 0
    while True:
        worst = residual(step, spacing)
        if tell is not None:
            tell(count, worst)
        if worst <= tolerance or not np.isfinite(worst) or count >= max_steps:
            break
        steps = min(LOOK_EVERY, max_steps - count)
        step.relax(steps)
        count += steps
    step.set_factors()
    _stop(step, held)
    if not worst <= tolerance:
        raise NotConvergedError(
            f"after {max_steps} steps of relaxation the net force is {worst:.3g} of the bond "
            f"forces, above {tolerance:.3g}; allow more max_steps, or, in float64, use "
            "Simulation.equilibrate, which slender bodies need."
        )
    return worst


def _stop(step: Step, velocities: dict[str, NDArray]) -> None:
    """Free axes stand still; grips have their velocities."""
    dim, fixed = step.model.features.dim, ~_free(step.model)
    step.upload("velocity", velocities["velocity"] * fixed[:, :dim])
    step.upload("angular_velocity", velocities["angular_velocity"] * fixed[:, dim:])


def equilibrate(
    step: Step,
    spacing: float,
    tolerance: float,
    max_iterations: int,
    load_steps: int,
    tell: Telling | None,
) -> float:
    """Bring a scene to rest by Newton's method; outer loads grow in steps, at first 1/load_steps.

    A step that does not converge is halved, down to SMALLEST. Returns the residual over the size of
    the bond forces; raises NotConvergedError.
    """
    if step.real is not step.place or step.download("displacement").dtype != np.float64:
        raise InputError("equilibrate needs precision='float64'; relax works in all.")
    whole_number("load_steps", load_steps, 1)
    whole_number("max_iterations", max_iterations, 1)
    positive("tolerance", tolerance, ())
    m = step.model
    loads = ("external_force", "external_torque", "timed_force", "timed_torque")
    names = [x for x in loads if getattr(m, x) is not None]
    _refuse_flight(step)
    colours, reached, worst = _colours(m), 0.0, np.inf
    advance = 1.0 / load_steps if names else 1.0
    _stop(step, {name: step.download(name) for name in ("velocity", "angular_velocity")})
    try:
        while reached < 1.0:
            start = {name: step.download(name) for name in ("displacement", "orientation")}
            load = min(1.0, reached + advance)
            for name in names:
                step.upload(name, getattr(m, name) * load)
            worst = _find_rest(step, spacing, colours, tolerance, max_iterations, tell)
            if worst <= tolerance:
                reached, advance = load, 1.5 * advance
                continue
            advance *= 0.5
            if not names or advance < SMALLEST:
                raise NotConvergedError(
                    f"Newton's method stopped at a net force of {worst:.3g} of the bond forces, "
                    f"above {tolerance:.3g}, at {load:.2%} of the loads; hold the body where it "
                    "can move freely, take more load_steps, or a tolerance that rounding allows; "
                    "cut bonds in contact need Simulation.relax."
                )
            _displace(step, np.zeros_like(_free(m), dtype=float), start)
    finally:
        for name in names:
            step.upload(name, getattr(m, name))
    return worst


def _find_rest(
    step: Step,
    spacing: float,
    colours: NDArray[np.int64],
    tolerance: float,
    max_iterations: int,
    tell: Telling | None,
) -> float:
    """Newton's method under constant loads; the last residual."""
    step.evaluate_forces()
    for iteration in range(max_iterations + 1):
        worst = residual(step, spacing)
        if tell is not None:
            tell(iteration, worst)
        if worst <= tolerance or not np.isfinite(worst) or iteration == max_iterations:
            break
        _newton(step, spacing, colours)
    return worst


def tangent(step: Step, spacing: float):
    """Stiffness -dF/dx [N/m, N, N m] at the current state, a sparse (n d, n d) matrix.

    By central differences of the device's own forces; elements whose forces do not overlap are
    moved together. d = dim + spins; turns are about world axes.
    """
    return _tangent(step, spacing, _colours(step.model))


def natural_frequencies(step: Step, spacing: float, count: int) -> Array:
    """Lowest angular frequencies [rad/s] of small motions about the current state of rest,
    (count,) in order; negative ones stand for growing motions, exp(|omega| t)."""
    from scipy.linalg import block_diag, eigh
    from scipy.sparse import block_diag as sparse_diag
    from scipy.sparse.linalg import eigsh

    m = step.model
    free = np.flatnonzero(_free(m))
    if int(count) != count or count < 1 or len(free) == 0:
        raise InputError("nothing in this scene can move, or count is not a whole number above 0.")
    matrix = tangent(step, spacing)[free][:, free]
    matrix = 0.5 * (matrix + matrix.T)
    masses = _masses(m, step.download("orientation"))
    if len(free) <= max(400, 3 * count):
        whole = block_diag(*masses)[np.ix_(free, free)]
        square = eigh(matrix.toarray(), whole, eigvals_only=True)[:count]
    else:
        whole = sparse_diag(list(masses), format="csc")[free][:, free]
        # about a shift a little below zero, so that rigid motions do no harm
        shift = -1e-6 * abs(matrix.diagonal() / whole.diagonal()).max()
        square = eigsh(matrix.tocsc(), count, whole, sigma=shift, return_eigenvectors=False)
    square = np.sort(square)
    if _free(m).all():  # a free body's rigid motions, but for rounding
        rigid = 3 if m.features.dim == 2 else 6
        square[np.argsort(np.abs(square))[:rigid]] = 0.0
        square = np.sort(square)
    return np.sign(square) * np.sqrt(np.abs(square))


def _masses(m: Model, orientation: Array) -> Array:
    """Mass and inertia of every element about world axes, (n, d, d)."""
    dim, spins = m.features.dim, 1 if m.features.dim == 2 else 3
    blocks = np.zeros((m.elements, dim + spins, dim + spins))
    blocks[:, range(dim), range(dim)] = m.mass[:, None]
    if m.principal_moment is None or m.principal_axes is None:
        blocks[:, range(dim, dim + spins), range(dim, dim + spins)] = m.inertia[:, None]
        return blocks
    from scipy.spatial.transform import Rotation

    axes = (Rotation.from_quat(orientation) * Rotation.from_quat(m.principal_axes)).as_matrix()
    blocks[:, dim:, dim:] = axes * m.principal_moment[:, None, :] @ np.swapaxes(axes, 1, 2)
    return blocks


def _newton(step: Step, spacing: float, colours: NDArray[np.int64]) -> None:
    from scipy.sparse.linalg import splu

    m = step.model
    dim = m.features.dim
    free = np.flatnonzero(_free(m))
    net = np.concatenate(_net(step), axis=1).ravel()[free]
    matrix = _tangent(step, spacing, colours)[free][:, free]
    # rows and columns of like size, so that the solver's pivots mean something
    scale = 1.0 / np.sqrt(np.maximum(np.abs(matrix.diagonal()), 1e-300))
    try:
        found = splu(matrix.multiply(scale[:, None]).multiply(scale).tocsc()).solve(net * scale)
        change = np.zeros(m.elements * _free(m).shape[1])
        change[free] = found * scale
    except RuntimeError:  # exactly singular
        change = np.array([np.inf])
    if not np.isfinite(change).all():
        raise NotConvergedError(
            "the body can move at no cost, so it has no single place of rest; hold more of it."
        )
    change = change.reshape(m.elements, -1)
    most = np.abs(change[:, dim:]).max(initial=0.0)
    most = max(most, np.abs(change[:, :dim]).max(initial=0.0) / (50.0 * spacing))
    _displace(step, change * min(1.0, TURN_MOST / most if most > 0.0 else 1.0))


def _tangent(step: Step, spacing: float, colours: NDArray[np.int64]):
    from scipy.sparse import coo_array

    m = step.model
    n, dim = m.elements, m.features.dim
    width = _free(m).shape[1]
    start = {name: step.download(name) for name in ("displacement", "orientation")}
    sizes = np.full(width, DIFFERENCE)
    sizes[:dim] *= spacing
    reach = _reach(m)
    rows, columns, values = [], [], []
    for colour in range(colours.max() + 1):
        moved = np.flatnonzero(colours == colour)
        touched = reach[moved]
        owner = moved[np.repeat(np.arange(len(moved)), np.diff(touched.indptr))]
        for axis in range(width):
            difference = np.zeros((n, width))
            for steps, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
                change = np.zeros((n, width))
                change[moved, axis] = steps * sizes[axis]
                _displace(step, change, start)
                difference -= weight * np.concatenate(gathered(step), axis=1)
            block = difference[touched.indices] / (12.0 * sizes[axis])
            rows.append((touched.indices[:, None] * width + np.arange(width)).ravel())
            columns.append(np.repeat(owner * width + axis, width))
            values.append(block.ravel())
    for name, value in start.items():  # to the bit
        step.upload(name, value)
    step.evaluate_forces()
    return coo_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
        shape=(n * width, n * width),
    ).tocsr()


def _displace(step: Step, change: Array, start: dict[str, NDArray] | None = None) -> None:
    """Move and turn elements from a state, and evaluate the forces."""
    dim = step.model.features.dim
    if start is None:
        start = {name: step.download(name) for name in ("displacement", "orientation")}
    step.upload("displacement", start["displacement"] + change[:, :dim])
    step.upload("orientation", turned(start["orientation"], change[:, dim:]))
    step.evaluate_forces()


def turned(orientation: Array, turn: Array) -> Array:
    """Orientations after a further rotation vector [rad], (n, 1) in the plane, (n, 3) in space."""
    if turn.shape[1] == 1:
        half = 0.5 * turn[:, 0]
        s, c = orientation.T
        return np.stack(
            [s * np.cos(half) + c * np.sin(half), c * np.cos(half) - s * np.sin(half)], axis=1
        )
    half = 0.5 * np.sqrt((turn * turn).sum(axis=1, keepdims=True))
    p, c = 0.5 * np.sinc(half / np.pi) * turn, np.cos(half)
    q, d = orientation[:, :3], orientation[:, 3:]
    px, py, pz = p.T
    qx, qy, qz = q.T
    across = np.stack([py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx], axis=1)
    along = c * d - (p * q).sum(axis=1, keepdims=True)
    found = np.concatenate([c * q + d * p + across, along], axis=1)
    return found / np.sqrt((found * found).sum(axis=1, keepdims=True))


def _free(m: Model) -> NDArray[np.bool_]:
    """Axes that nothing holds, (n, dim + spins)."""
    spins = 1 if m.features.dim == 2 else 3
    turns = np.repeat(m.inverse_inertia[:, None] > 0.0, spins, axis=1)
    return np.concatenate([m.inverse_mass > 0.0, turns], axis=1)


def _reach(m: Model):
    """Which elements' forces an element's motion changes: one bond away, or two with volume."""
    from scipy.sparse import coo_array, eye_array

    n = m.elements
    bonds = coo_array((np.ones(m.bonds), (m.bond_i, m.bond_j)), shape=(n, n))
    near = (bonds + bonds.T + eye_array(n)).tocsr()
    return (near @ near if m.features.has_volume else near).tocsr()


def _colours(m: Model) -> NDArray[np.int64]:
    """A colour of every element; no element is reached by two of one colour."""
    reach = _reach(m)
    clash = (reach @ reach).tocsr()
    colours = np.full(m.elements, -1)
    for i in range(m.elements):
        taken = set(colours[clash.indices[clash.indptr[i] : clash.indptr[i + 1]]].tolist())
        colours[i] = next(c for c in range(len(taken) + 1) if c not in taken)
    return colours

"""Scenes at rest: relaxation on the device, Newton's method with a sparse solver on the host."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .errors import Array, InputError, NotConvergedError
from .model import Model
from .step import Step, gathered

# FIRE of Bitzek et al. 2006, at a constant time step
STEER, STEER_DECAY, PATIENCE = 0.1, 0.99, 5
LOOK_EVERY = 20  # steps between looks at the residual
DIFFERENCE = 1e-5  # of a spacing, and of a radian: central differences of forces
TURN_MOST = 0.3  # rad that Newton's method turns an element by at once
Telling = Callable[[int, float], None]


def residual(step: Step) -> tuple[Array, float]:
    """Net force and torque on every free axis, (n, dim + spins), and the size of bond forces.

    Torques are divided by the arm that makes them comparable: the greatest bond torque over the
    greatest bond force.
    """
    m = step.model
    force, torque = gathered(step)
    if m.external_force is not None:
        force += step.download("external_force")
    if m.external_torque is not None:
        torque += step.download("external_torque")
    net = np.concatenate([force, torque], axis=1) * _free(m)
    bonds = [np.abs(step.download(x)).max(initial=0.0) for x in ("end_force", "end_torque")]
    outer = [
        np.abs(x).max() if x is not None else 0.0 for x in (m.external_force, m.external_torque)
    ]
    size_force, size_torque = (float(max(x)) for x in zip(bonds, outer, strict=True))
    arm = size_torque / size_force if size_force > 0.0 and size_torque > 0.0 else 1.0
    net[:, m.features.dim :] /= arm
    return net, size_force if size_force > 0.0 else size_torque / arm


def relax(step: Step, tolerance: float, max_steps: int, tell: Telling | None) -> float:
    """Bring a scene to rest by FIRE; grips stand still, nothing breaks, no time passes.

    Returns the residual over the size of the bond forces; raises NotConvergedError.
    """
    m = step.model
    held = {name: step.download(name) for name in ("velocity", "angular_velocity")}
    for name, value in held.items():
        step.upload(name, np.zeros_like(value))
    step.evaluate_forces()
    steer, uphill_free, worst = STEER, 0, np.inf
    for count in range(max_steps + 1):
        if count % LOOK_EVERY == 0:
            net, size = residual(step)
            worst = float(np.abs(net).max(initial=0.0)) / size if size > 0.0 else 0.0
            if tell is not None:
                tell(count, worst)
            if worst <= tolerance or not np.isfinite(worst):
                break
        power, kinetic, force = step.relaxing_sums()
        if power > 0.0:
            uphill_free += 1
            keep = 1.0 - steer
            push = step.dt + steer * np.sqrt(kinetic / force) if force > 0.0 else step.dt
            if uphill_free > PATIENCE:
                steer *= STEER_DECAY
        else:
            keep, push, steer, uphill_free = 0.0, step.dt, STEER, 0
        step.relax(keep, push)
    fixed = ~_free(m)
    step.upload("velocity", held["velocity"] * fixed[:, : m.features.dim])
    step.upload("angular_velocity", held["angular_velocity"] * fixed[:, m.features.dim :])
    if not worst <= tolerance:
        raise NotConvergedError(
            f"after {max_steps} steps of relaxation the net force is {worst:.3g} of the bond "
            f"forces, above {tolerance:.3g}; allow more max_steps, or use "
            "Simulation.equilibrate, which slender bodies need."
        )
    return worst


def equilibrate(
    step: Step,
    spacing: float,
    tolerance: float,
    max_iterations: int,
    load_steps: int,
    tell: Telling | None,
) -> float:
    """Bring a scene to rest by Newton's method; outer loads grow in `load_steps` equal steps.

    Returns the residual over the size of the bond forces; raises NotConvergedError.
    """
    if step.real is not step.place or step.download("displacement").dtype != np.float64:
        raise InputError("equilibrate needs precision='float64'; relax works in all.")
    m = step.model
    outer = {
        name: getattr(m, name)
        for name in ("external_force", "external_torque")
        if getattr(m, name) is not None
    }
    if load_steps < 1 or max_iterations < 1:
        raise InputError("load_steps and max_iterations must be at least 1.")
    colours, worst, iteration = _colours(m), np.inf, 0
    for load in range(1, load_steps + 1):
        for name, value in outer.items():
            step.upload(name, value * (load / load_steps))
        step.evaluate_forces()
        for _ in range(max_iterations):
            net, size = residual(step)
            worst = float(np.abs(net).max(initial=0.0)) / size if size > 0.0 else 0.0
            if tell is not None:
                tell(iteration, worst)
            if worst <= tolerance:
                break
            iteration += 1
            _newton(step, spacing, colours)
        else:
            for name, value in outer.items():
                step.upload(name, value)
            raise NotConvergedError(
                f"Newton's method stopped at a net force of {worst:.3g} of the bond forces, above "
                f"{tolerance:.3g}, at load step {load} of {load_steps}; take more load_steps, or "
                "hold the body where it can move freely."
            )
    return worst


def tangent(step: Step, spacing: float):
    """Stiffness -dF/dx [N/m, N, N m] at the current state, a sparse (n d, n d) matrix.

    By central differences of the device's own forces; elements whose forces do not overlap are
    moved together. d = dim + spins; turns are about world axes.
    """
    return _tangent(step, spacing, _colours(step.model))


def _newton(step: Step, spacing: float, colours: NDArray[np.int64]) -> None:
    from scipy.sparse.linalg import splu

    m = step.model
    dim = m.features.dim
    free = np.flatnonzero(_free(m))
    force, torque = gathered(step)
    for total, name in ((force, "external_force"), (torque, "external_torque")):
        if name in step.arrays:
            total += step.download(name)
    net = np.concatenate([force, torque], axis=1).ravel()[free]
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
            for sign in (1.0, -1.0):
                change = np.zeros((n, width))
                change[moved, axis] = sign * sizes[axis]
                _displace(step, change, start)
                difference -= sign * np.concatenate(gathered(step), axis=1)
            block = difference[touched.indices] / (2.0 * sizes[axis])
            rows.append((touched.indices[:, None] * width + np.arange(width)).ravel())
            columns.append(np.repeat(owner * width + axis, width))
            values.append(block.ravel())
    _displace(step, np.zeros((n, width)), start)
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
    from scipy.spatial.transform import Rotation

    return (Rotation.from_rotvec(turn) * Rotation.from_quat(orientation)).as_quat()


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

"""Renewed faces: the cells of elements where they are now, and the stress carried over (B6).

At finite strain the faces of elements are those of the reference state. As elements change
neighbours these are no longer between them. A renewal takes the present places for the reference
state: new cells, bonds and arms; stresses, plastic strains, masses and velocities stay.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import Array, InputError, first_ids
from .model import Model, bond_ends
from .packing import Packing
from .packing.tessellation import Tessellation
from .step import Step

LEAST_FACE = 1e-9  # area over that of a square of the spacing, below which cells only touch
NEAREST = 0.75  # distance of an image from any element over that from its own
MOST_STRETCH = 1.5  # of the distance of an image over that in the packing
ROUNDS = 200  # of the search for the springs' forces, at most
CLOSE = 1e-11  # share of the greatest stress that these may leave unmatched


@dataclass
class RenewedFaces:
    """Cells at the present places: volume [m^3] (n,), and of the faces between them pair (b, 2),
    area [m^2] (b,), arms [m] (b, 2, dim), and image (b, dim): by how many periods the second
    element's is away."""

    volume: Array
    pair: NDArray[np.int64]
    area: Array
    arms: Array
    image: NDArray[np.int64]


def tessellate(packing: Packing, x: Array, gradient: Array, box: Array) -> RenewedFaces:
    """Voronoi cells of elements that moved to x (n, dim).

    gradient (n, dim, dim): F of every element since the packing was made; box (dim, dim): F of its
    period. Free surfaces move by F; beyond them mirror images bound the cells, as walls do. Cells
    at a surface keep the volume V det F, which the few images do not enclose exactly.
    """
    n, dim = x.shape
    images, origin, image = [x], [np.arange(n)], [np.zeros((n, dim), dtype=np.int64)]
    surface = np.zeros(n, dtype=bool)
    if packing.period is not None:
        steps = np.array(np.meshgrid(*[[-2, -1, 0, 1, 2]] * dim)).reshape(dim, -1).T
        edges = box * packing.period  # columns
        low, high = x.min(axis=0), x.max(axis=0)
        band = 3.0 * packing.spacing * np.linalg.norm(box, 2)
        for step in steps[steps.any(axis=1)]:
            there = x + edges @ step
            near = ((there > low - band) & (there < high + band)).all(axis=1)
            images.append(there[near])
            origin.append(np.flatnonzero(near))
            image.append(np.tile(step, (near.sum(), 1)))
    else:
        surface, beyond = _beyond(packing, x, gradient)
        images.append(beyond)
        origin.append(np.full(len(beyond), -1))
        image.append(np.zeros((len(beyond), dim), dtype=np.int64))
        # far generators bound what is left open
        size = 8.0 * np.ptp(x, axis=0).max() + packing.spacing
        signs = np.indices((2,) * dim).reshape(dim, -1).T * 2.0 - 1.0
        signs *= 1.0 + 0.01 * np.random.default_rng(0).random(signs.shape)
        images.append(x.mean(axis=0) + size * signs)
        origin.append(np.full(len(signs), -1))
        image.append(np.zeros((len(signs), dim), dtype=np.int64))
    every, of, shift = np.concatenate(images), np.concatenate(origin), np.concatenate(image)
    cells = Tessellation(every, n)
    faces = cells.faces()
    i, j = faces.pair.T
    keep = (of[j] >= 0) & ((j < n) | (i < of[j]))
    keep &= faces.area > LEAST_FACE * packing.spacing ** (dim - 1)
    if (keep & (of[j] == i)).any() or ((of[j] == i) & (j >= n)).any():
        raise InputError("the periodic cell has become so thin that elements meet themselves.")
    arms = faces.centroid[:, None] - every[faces.pair]
    volume = cells.measures()[0]
    volume[surface] = (packing.volume / packing.thickness * np.linalg.det(gradient))[surface]
    bad = ~(volume > 0.0)
    if bad.any():
        raise InputError(f"elements {first_ids(bad)} have no cell left; faces are not renewed.")
    return RenewedFaces(
        volume * packing.thickness,
        np.stack([i, of[j]], axis=1)[keep],
        faces.area[keep] * packing.thickness,
        arms[keep],
        shift[j][keep],
    )


def _beyond(packing: Packing, x: Array, gradient: Array) -> tuple[NDArray[np.bool_], Array]:
    """Elements with a free surface, and generators beyond it that bound their cells.

    These are mirror images: the vector area A of the surface and its height, from the volume that
    the other faces leave, are those of the packing; area vectors move by F^-T, points by F. And at
    edges and steps, where one plane is not enough, opposites of the first neighbours: on a lattice
    those that the surface cut off. None is nearer to another element than to its own.
    """
    from scipy.spatial import cKDTree

    assert packing.area is not None and packing.arms is not None
    n, dim = x.shape
    outward = packing.exposed_area
    size = np.linalg.norm(outward, axis=1)
    surface = size > 1e-6 * packing.volume / packing.spacing
    along = np.einsum("bsk,bk->bs", packing.arms, packing.bond_vector) * [1.0, -1.0]
    cone = along * (packing.area / packing.bond_length)[:, None] / dim
    left = packing.volume - np.bincount(packing.bonds.ravel(), cone.ravel(), minlength=n)
    gradient = _smoothed(packing, gradient)
    at = np.flatnonzero(surface)
    height = dim * left[at] / size[at]
    normal = outward[at] / size[at, None]
    moved = np.linalg.solve(np.swapaxes(gradient[at], 1, 2), normal[..., None])[..., 0]
    ways = [2.0 * height[:, None] * moved / (moved**2).sum(axis=1)[:, None]]
    owner, first_length = [at], [2.0 * height]
    for side, sign in ((0, -1.0), (1, 1.0)):
        own = packing.bonds[:, side]
        way = sign * packing.bond_vector
        out = surface[own] & (np.einsum("bk,bk->b", way, outward[own]) > 0.0)
        ways.append(np.einsum("bxy,by->bx", gradient[own[out]], way[out]))
        owner.append(own[out])
        first_length.append(packing.bond_length[out])
    way, of, length = (np.concatenate(a) for a in (ways, owner, first_length))
    distance = np.linalg.norm(way, axis=1)
    # what is squeezed or stretched much has other neighbours at about the old distance
    bounded = np.clip(distance, length / MOST_STRETCH, length * MOST_STRETCH)
    point, distance = x[of] + way * (bounded / distance)[:, None], bounded
    free = cKDTree(x).query(point)[0] > NEAREST * distance
    free[: len(at)] = cKDTree(x).query(point[: len(at)])[0] > 0.9 * distance[: len(at)]
    point = point[free]
    pairs = cKDTree(point).query_pairs(0.3 * packing.spacing, output_type="ndarray")
    first = np.ones(len(point), dtype=bool)
    first[pairs.max(axis=1)] = False
    return surface, point[first]


def _smoothed(packing: Packing, gradient: Array) -> Array:
    """F averaged over elements and their first neighbours: single ones are distorted most."""
    total, count = np.array(gradient), np.ones(len(gradient))
    for own, other in (packing.bonds.T, packing.bonds.T[::-1]):
        np.add.at(total, own, gradient[other])
        np.add.at(count, own, 1.0)
    return total / count[:, None, None]


def spring_stresses(model: Model, force: Array) -> Array:
    """(1/V) sum f (x) B^-T c of every element [Pa], (n, dim, dim), f (b, dim) on first elements."""
    assert model.inverse_shape is not None
    ends = bond_ends(model)
    total = np.zeros_like(model.inverse_shape)
    for side, (element, sign) in enumerate(((model.bond_i, 1.0), (model.bond_j, -1.0))):
        np.add.at(total, element, sign * force[:, :, None] * ends[:, side, None, :])
    return (total @ model.inverse_shape) / model.element_volume[:, None, None]


def spring_forces(model: Model, stress: Array) -> tuple[Array, float]:
    """Forces of springs (b, dim) whose elements' stresses are these (n, dim, dim), and the
    greatest stress that they leave unmatched, over the greatest.

    f = w L (c_i - c_j) with L interpolated between both elements: exact where stress is uniform.
    Elsewhere L is sought by Richardson's iteration, which from zero goes to the forces of least
    energy; what it does not match alternates from element to element.
    """
    assert model.bond_weight is not None
    ends = bond_ends(model)
    i, j = model.bond_i, model.bond_j
    vector = ends[:, 0] - ends[:, 1]
    along = np.einsum("bsk,bk->bs", ends, vector) * [1.0, -1.0]
    wi, wj = (along[:, ::-1] / along.sum(axis=1)[:, None]).T
    scale = float(np.abs(stress).max())
    lean = np.array(stress)
    best, least = np.zeros((len(i), stress.shape[1])), np.inf
    for _ in range(ROUNDS):
        shared = wi[:, None, None] * lean[i] + wj[:, None, None] * lean[j]
        force = model.bond_weight[:, None] * np.einsum("bxy,by->bx", shared, vector)
        lack = stress - spring_stresses(model, force)
        worst = float(np.abs(lack).max())
        if worst >= least:
            break
        best, least = force, worst
        if worst <= CLOSE * scale:
            break
        lean = lean + lack
    return best, least / scale if scale > 0.0 else 0.0


def carried(
    old: Model, step: Step, new: Model, gradient: Array
) -> tuple[dict[str, NDArray], float]:
    """State arrays of the new model that follow from the old step, and the unmatched stress.

    The Cauchy stress of every element stays: sigma = (sym P_s F^T + g 1)/det F, P_s of the
    springs. Springs take the first part, P the second (E starts at 0); out of the plane the
    plastic strain does. Anchors are in the frames of elements, whose turns go on.
    gradient (n, dim, dim): F since the old model's reference state.
    """
    ratio = np.linalg.det(gradient)
    springs = spring_stresses(old, step.download("spring_force").astype(np.float64))
    springs = springs @ np.swapaxes(gradient, 1, 2) / ratio[:, None, None]
    springs = 0.5 * (springs + np.swapaxes(springs, 1, 2))
    force, lack = spring_forces(new, springs)
    state: dict[str, NDArray] = {}
    kept = ("orientation", "velocity", "angular_velocity", "plastic_strain", "element_work")
    for name in (*kept, "plastic_strain_zz", "grip_factor", "load_factor", "damped_energy"):
        if name in step.arrays:
            state[name] = step.download(name)
    if "plastic_strain_zz" in state:
        state["plastic_strain_zz"] = state["plastic_strain_zz"] / ratio
    volume_stress = step.download("volume_stress").astype(np.float64)
    stiffness = step.download("volume_stiffness").astype(np.float64)
    stiff = np.where(stiffness > 0.0, stiffness, 1.0)
    state["plastic_dilation"] = -volume_stress / ratio / stiff
    assert new.facet_stiffness is not None
    ends, half = bond_ends(new), 0.5 * force / new.facet_stiffness[:, None]
    slip = np.stack([ends[:, 0] - half, ends[:, 1] + half], axis=1)
    turn = _matrices(state["orientation"].astype(np.float64))
    for side, element in enumerate((new.bond_i, new.bond_j)):
        slip[:, side] = np.einsum("byx,by->bx", turn[element], slip[:, side])
    state["bond_slip"] = (slip - ends).reshape(-1, ends.shape[2])
    return state, lack


def _matrices(orientation: Array) -> Array:
    """Rotation matrices (n, dim, dim) of quaternions, in the plane of (sin, cos) of the half."""
    from scipy.spatial.transform import Rotation

    if orientation.shape[1] == 4:
        return Rotation.from_quat(orientation).as_matrix()
    s, c = orientation.T
    sine, cosine = 2.0 * s * c, c * c - s * s
    return np.stack([np.stack([cosine, -sine], 1), np.stack([sine, cosine], 1)], axis=1)

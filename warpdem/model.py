"""A scene as arrays: what is fixed (Model), what changes (State), what is needed (Features)."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from .bond import EVMBond
from .errors import Array, InputError, first_ids
from .scene import Body, Scene

Ids = NDArray[np.int32]
# kept in the precision of places; everything else is in the precision of forces
PLACES = frozenset(
    {
        *("displacement", "orientation", "bond_arm", "principal_axes"),
        *("evm_direction", "evm_length", "evm_offset"),
    }
)


@dataclass(frozen=True)
class Features:
    """What a scene needs. Passes and arrays that nothing here asks for do not exist."""

    dim: int
    plane_strain: bool
    has_volume: bool
    external: tuple[bool, bool]  # whether forces, whether torques act from outside
    has_work: bool
    has_moments: bool  # some elements have three principal moments of inertia
    has_dashpots: bool
    large_rotation: bool
    slots: int
    central: bool  # every face lies in the middle of its centre line


@dataclass(frozen=True)
class Group:
    """Listed bonds of one body that break by one criterion: [first, first + count)."""

    kind: str
    ratio: float
    first: int
    count: int


@dataclass
class Model:
    """Fixed arrays of a scene, in float64; None where no pass needs them. SI units.

    Bonds are stored facet bonds first, then EVM bonds. Arrays over bonds or bond ends that elements
    gather from end with a row for missing bonds.
    """

    features: Features
    position: Array  # (n, dim) reference place
    facet_bonds: int
    evm_bonds: int
    criteria: tuple[Group, ...]
    facet_listed: int  # listed bonds that are facet bonds, stored first
    mass: Array  # (n,)
    inertia: Array  # (n,)
    inverse_mass: Array  # (n, dim), 0 on held axes
    inverse_inertia: Array  # (n,), 0 where turning is held
    element_volume: Array  # (n,)
    incidence: Ids  # (slots, n): 2 bond + side
    bond_place: Ids  # (2 b,): where incidence holds 2 bond + side
    bond_i: Ids
    bond_j: Ids
    bond_area: Array | None = None
    bond_arm: Array | None = None  # (2 b + 2, dim), or (b + 1, dim) if faces are central
    facet_stiffness: Array | None = None  # k = 2 G S / r0
    evm_direction: Array | None = None
    evm_length: Array | None = None
    evm_offset: Array | None = None
    evm_stiffness: Array | None = None  # B1..B4
    bond_weight: Array | None = None  # w = S / r0
    bond_face: Array | None = None  # (2 b + 2,): S q, that s_i sums
    element_two_shear: Array | None = None  # 2 G
    element_coupling: Array | None = None  # D
    evm_dashpot: Array | None = None  # eta along, across [N s/m], bending, torsion [N m s]
    external_force: Array | None = None
    external_torque: Array | None = None
    principal_moment: Array | None = None  # (n, 3)
    principal_axes: Array | None = None  # (n, 4) rotations from the principal axes to the world's
    listed_bonds: Ids | None = None  # bonds that are or may become unlinked
    closing_stiffness: Array | None = None  # of the listed bonds: k_c = (lambda + 2 G) S / r0 or B1
    listed_elements: Ids | None = None  # elements of the listed bonds
    bond_strength: Array | None = None  # of the listed bonds
    near_bonds: Ids | None = None  # all bonds of the listed elements
    near_elements: Ids | None = None  # all elements of the near bonds
    near_facets: int = 0  # near bonds that are facet bonds, stored first

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.position)

    @property
    def bonds(self) -> int:
        """Number of bonds."""
        return self.facet_bonds + self.evm_bonds

    def arrays(self) -> dict[str, NDArray]:
        """The arrays that exist, by name."""
        pairs = ((f.name, getattr(self, f.name)) for f in fields(self))
        return {name: value for name, value in pairs if isinstance(value, np.ndarray)}


def state_arrays(
    model: Model, scene: Scene, linked_bonds: NDArray[np.bool_] | None = None
) -> dict[str, NDArray]:
    """Arrays that change, at time zero; only those that the scene needs.

    An unlinked bond has no stiffness; `linked_bonds` (b,) overrides which are linked.
    """
    f, n, b = model.features, model.elements, model.bonds
    bodies = scene.bodies
    spins, rot = (1, 2) if f.dim == 2 else (3, 4)
    orientation = np.zeros((n, rot))
    orientation[:, -1] = 1.0
    state: dict[str, NDArray] = {
        "displacement": np.concatenate([x.displacement for x in bodies]),
        "orientation": orientation,
        "velocity": np.concatenate([x.velocity for x in bodies]),
        "angular_velocity": np.concatenate([x.angular_velocity for x in bodies]),
        "end_force": np.zeros((f.slots * n, f.dim)),
        "end_torque": np.zeros((f.slots * n, spins)),
    }
    if f.has_work:
        state["element_work"] = np.zeros(n)
    linked = np.zeros(b + 1)
    present = np.concatenate([x.linked for x in in_bond_order(bodies)])
    linked[:b] = present if linked_bonds is None else linked_bonds
    if model.facet_stiffness is not None:
        state["facet_stiffness"] = model.facet_stiffness * linked[: model.facet_bonds]
    if model.evm_dashpot is not None:
        state["evm_dashpot"] = model.evm_dashpot * linked[model.facet_bonds : -1, None]
        state["damping_force"] = np.zeros((f.slots * n, f.dim))
        state["damping_torque"] = np.zeros((f.slots * n, spins))
    if model.evm_stiffness is not None:
        state["evm_stiffness"] = model.evm_stiffness * linked[model.facet_bonds : -1, None]
    if model.listed_bonds is not None:
        state["bond_linked"] = linked
        state["closing_gap"] = np.zeros(len(model.listed_bonds))
        state["closing_debt"] = np.zeros(len(model.listed_bonds))
        state["closing_impulse"] = np.zeros((f.slots * n, f.dim))
        state["closing_twist"] = np.zeros((f.slots * n, spins))
        state["any_crossed"] = np.zeros(1, dtype=np.int32)
    if f.has_volume:
        assert model.bond_weight is not None
        state["bond_weight"] = model.bond_weight * linked[:-1]
        state["end_dilation"] = np.zeros(f.slots * n)
        state["volume_stress"] = np.zeros(n)
        state["volume_stiffness"] = volume_stiffness(model, linked)
    if model.criteria:
        assert model.listed_bonds is not None
        listed = len(model.listed_bonds)
        break_step = np.full(b + 1, -2, dtype=np.int32)
        break_step[:b][linked[:b] == 1.0] = -1  # -1: may break still; -2: never will
        state["stress"] = np.zeros((n, 4 if f.dim == 2 else 6))
        state["any_broken"] = np.zeros(1, dtype=np.int32)
        state["break_step"] = break_step
        for name in ("break_energy", "break_normal", "break_shear"):
            state[name] = np.zeros(listed)
        if f.has_volume:
            state["element_release"] = np.zeros(n)
    return state


def in_bond_order(bodies: list[Body]) -> list[Body]:
    """Bodies in the order in which their bonds are stored: facet bonds first."""
    return sorted(bodies, key=lambda body: isinstance(body.bond, EVMBond))


def volume_stiffness(model: Model, linked: Array) -> Array:
    """A_i = 2 G D / (3 - D s*) [Pa] for given links (theory B4)."""
    assert model.bond_face is not None and model.element_two_shear is not None
    assert model.element_coupling is not None
    face = model.bond_face * np.repeat(linked, 2)
    s = face[model.incidence].sum(axis=0) / model.element_volume
    d = model.element_coupling
    return model.element_two_shear * d / (3.0 - d * (s + model.features.plane_strain))


def bond_ends(model: Model) -> Array:
    """Arms from both elements to each face [m], (b, 2, dim)."""
    arm = model.bond_arm
    assert arm is not None
    if model.features.central:
        return np.stack([arm[:-1], -arm[:-1]], axis=1)
    return arm[:-2].reshape(-1, 2, model.features.dim)


def face_reach(model: Model) -> Array:
    """X_i = (1/V_i) sum S |c|^2/q over an element's faces with a volume term (theory B8)."""
    assert model.bond_area is not None and model.bond_face is not None
    face = model.bond_face[:-2].reshape(-1, 2)  # S q, zero where no volume term acts
    reach = np.zeros(2 * model.bonds + 2)
    square = (bond_ends(model) ** 2).sum(axis=2) * model.bond_area[:, None] ** 2
    np.divide(square, face, out=reach[:-2].reshape(-1, 2), where=face > 0.0)
    return reach[model.incidence].sum(axis=0) / model.element_volume


def build(scene: Scene) -> Model:
    """Arrays of a scene. Raises InputError where its energy would not be positive definite."""
    if not scene.bodies:
        raise InputError("the scene is empty; add a body with scene.add.")
    bodies = scene.bodies
    packing = bodies[0].packing
    dim = packing.dim
    sizes = [len(b.packing) for b in bodies]
    starts = dict(zip(map(id, bodies), np.cumsum([0, *sizes]), strict=False))
    position = np.concatenate([b.packing.position for b in bodies])
    n = len(position)
    stored = in_bond_order(bodies)
    pairs = np.concatenate([b.packing.bonds + starts[id(b)] for b in stored])
    counts = [len(b.packing.bonds) for b in stored]
    is_evm = [isinstance(b.bond, EVMBond) for b in stored]
    facet_bonds = sum(c for c, e in zip(counts, is_evm, strict=True) if not e)
    bonds = len(pairs)
    incidence = _incidence(pairs, n)

    def over_bodies(value) -> Array:
        return np.concatenate([np.broadcast_to(value(b), len(b.packing)) for b in bodies])

    volume = np.concatenate([b.packing.volume for b in bodies])
    radius = np.concatenate([b.packing.radius for b in bodies])
    mass = volume * over_bodies(lambda b: b.material.density)
    inertia = (0.5 if dim == 2 else 0.4) * mass * radius**2
    moments, axes = _principal(bodies, mass, inertia)
    if moments is not None:
        inertia = moments.mean(axis=1)
    held = np.concatenate([b.held for b in bodies])
    held_rotation = np.concatenate([b.held_rotation for b in bodies])
    velocity = np.concatenate([b.velocity for b in bodies])
    angular_velocity = np.concatenate([b.angular_velocity for b in bodies])
    force = np.concatenate([b.force for b in bodies])
    torque = np.concatenate([b.torque for b in bodies])
    grips = (held & (velocity != 0.0)).any() | (
        held_rotation[:, None] & (angular_velocity != 0.0)
    ).any()
    evm = [b.bond for b in bodies if isinstance(b.bond, EVMBond)]
    if len({b.large_rotation for b in evm}) > 1:
        raise InputError("all EVM bonds of a scene take large_rotation, or none does.")
    unlinked = [~b.linked | b.breakable for b in stored]
    features = Features(
        dim=dim,
        plane_strain=packing.plane == "strain",
        has_volume=any(b.has_volume for b in bodies),
        external=(bool(force.any()), bool(torque.any())),
        has_work=bool(grips or torque.any()),
        has_moments=moments is not None,
        has_dashpots=any(b.damping > 0.0 for b in evm),
        large_rotation=any(b.large_rotation for b in evm),
        slots=len(incidence),
        central=_is_central(bodies),
    )
    model = Model(
        features=features,
        position=position,
        facet_bonds=facet_bonds,
        evm_bonds=bonds - facet_bonds,
        criteria=(),
        facet_listed=0,
        mass=mass,
        inertia=inertia,
        inverse_mass=np.where(held, 0.0, 1.0 / mass[:, None]),
        inverse_inertia=np.where(held_rotation, 0.0, 1.0 / inertia),
        element_volume=volume,
        incidence=incidence,
        bond_place=np.argsort(incidence, axis=None, kind="stable")[: 2 * bonds].astype(np.int32),
        bond_i=pairs[:, 0].astype(np.int32),
        bond_j=pairs[:, 1].astype(np.int32),
        external_force=force if features.external[0] else None,
        external_torque=torque if features.external[1] else None,
        principal_moment=moments,
        principal_axes=axes,
    )
    _add_faces(model, stored)
    _add_laws(model, stored)
    if features.has_volume:
        _add_volume(model, stored, over_bodies)
    if any(mask.any() for mask in unlinked):
        _add_lists(model, stored, unlinked)
    return model


def _incidence(pairs: NDArray[np.int64], n: int) -> Ids:
    """Entries 2 bond + side of every element, padded with the missing bond's, (slots, n)."""
    ends = pairs.ravel()  # entry 2 b + side is position 2 b + side
    order = np.argsort(ends, kind="stable")
    degree = np.bincount(ends, minlength=n)
    slots = int(degree.max(initial=0))
    table = np.full((max(slots, 1), n), 2 * len(pairs), dtype=np.int32)
    slot = np.arange(len(ends)) - np.repeat(np.cumsum(degree) - degree, degree)
    table[slot, ends[order]] = order
    return table


def _principal(
    bodies: list[Body], mass: Array, inertia: Array
) -> tuple[Array | None, Array | None]:
    """Principal moments [kg m^2] and axes, if any element is not a sphere."""
    if all(b.packing.gyration is None for b in bodies):
        return None, None
    moments = np.repeat(inertia[:, None], 3, axis=1)
    axes = np.tile([0.0, 0.0, 0.0, 1.0], (len(mass), 1))
    at = 0
    for body in bodies:
        here = slice(at, at := at + len(body.packing))
        if body.packing.gyration is not None and body.packing.axes is not None:
            moments[here] = mass[here, None] * body.packing.gyration**2
            axes[here] = body.packing.axes
    return moments, axes


def inverse_inertia_root(model: Model) -> Array:
    """Square root of the inverse inertia tensor in the reference state, (n, spins, spins)."""
    if model.principal_moment is None or model.principal_axes is None:
        spins = 1 if model.features.dim == 2 else 3
        return np.sqrt(model.inverse_inertia)[:, None, None] * np.eye(spins)
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(model.principal_axes).as_matrix()
    free = np.where(model.inverse_inertia > 0.0, 1.0, 0.0)[:, None]
    return turn * (free / np.sqrt(model.principal_moment))[:, None, :] @ np.swapaxes(turn, 1, 2)


def _add_faces(model: Model, stored: list[Body]) -> None:
    """Arms and areas, if any body has faces that a pass uses."""
    facets = [b.packing for b in stored if b.packing.area is not None]
    if not facets:
        return
    dim, bonds = model.features.dim, model.bonds
    area = np.ones(bonds)  # a bond without faces is never divided by
    arm = np.zeros((bonds + 1, 2, dim))
    at = 0
    for body in stored:
        p = body.packing
        here = slice(at, at := at + len(p.bonds))
        if p.area is not None and p.arms is not None:
            area[here], arm[here] = p.area, p.arms
    model.bond_area = area
    model.bond_arm = arm[:, 0] if model.features.central else arm.reshape(-1, dim)


def _is_central(bodies: list[Body]) -> bool:
    arms = [b.packing.arms for b in bodies if b.packing.arms is not None]
    return all(
        np.abs(a.sum(axis=1)).max(initial=0.0) <= 1e-12 * np.abs(a).max(initial=0.0) for a in arms
    )


def _add_laws(model: Model, stored: list[Body]) -> None:
    facet = [b for b in stored if not isinstance(b.bond, EVMBond)]
    if facet:
        weight = [b.packing.area / b.packing.bond_length for b in facet]  # type: ignore[operator]
        two_shear = [2.0 * b.material.shear_modulus for b in facet]
        model.facet_stiffness = np.concatenate(
            [g * w for g, w in zip(two_shear, weight, strict=True)]
        )
    direction, length, offset, stiffness, dashpot = [], [], [], [], []
    for body in stored:
        if isinstance(body.bond, EVMBond):
            r0 = body.packing.bond_length
            ends = body.bond.ends(len(r0))
            a = r0 - ends.sum(axis=1)
            if (a <= 0.0).any():
                raise InputError(
                    f"bonds {first_ids(a <= 0.0)}: the offsets R_i + R_j leave no length between "
                    "the ends of the bond; they must be less than the centres' distance."
                )
            direction.append(body.packing.bond_vector / r0[:, None])
            length.append(a)
            offset.append(ends)
            stiffness.append(body.bond.parameters(a))
            dashpot.append(2.0 * body.bond.damping * np.sqrt(body.bond.stiffnesses(len(a))))
    if direction:
        model.evm_direction = np.concatenate(direction)
        model.evm_length = np.concatenate(length)
        model.evm_offset = np.concatenate(offset)
        model.evm_stiffness = np.concatenate(stiffness)
        if model.features.has_dashpots:
            # eta = 2 zeta sqrt(c m), m that of the two elements in series (theory A8)
            both = np.stack([model.bond_i, model.bond_j])[:, model.facet_bonds :]
            inertias = [1.0 / (1.0 / x[both]).sum(axis=0) for x in (model.mass, model.inertia)]
            root = np.sqrt(np.stack([inertias[0]] * 2 + [inertias[1]] * 2, axis=1))
            model.evm_dashpot = np.concatenate(dashpot) * root


def _add_volume(model: Model, stored: list[Body], over_bodies) -> None:
    assert model.bond_area is not None and model.bond_arm is not None
    if any(b.packing.arms is None for b in stored):
        raise InputError("a scene with volume terms takes only bodies with faces.")
    r0 = np.concatenate([b.packing.bond_length for b in stored])
    acts = np.concatenate([np.full(len(b.packing.bonds), b.has_volume) for b in stored])
    model.bond_weight = np.where(acts, model.bond_area / r0, 0.0)
    arm = bond_ends(model)
    x = arm[:, 0] - arm[:, 1]
    q = np.einsum("bsk,bk->bs", arm, x) * [1.0, -1.0] / r0[:, None]
    face = np.zeros(2 * model.bonds + 2)
    face[:-2] = (np.where(acts, model.bond_area, 0.0)[:, None] * q).ravel()
    model.bond_face = face
    model.element_two_shear = over_bodies(lambda b: 2.0 * b.material.shear_modulus)
    model.element_coupling = over_bodies(lambda b: b.material.coupling if b.has_volume else 0.0)
    if (model.element_coupling < 0.0).any():
        a = volume_stiffness(model, np.append(np.ones(model.bonds), 0.0))
        bad = (model.element_coupling < 0.0) & (-a * face_reach(model) > model.element_two_shear)
        if bad.any():
            raise InputError(
                f"elements {first_ids(bad)}: with a negative Poisson's ratio the energy of these "
                "cells is not positive definite (|A| sum S |c|^2/q > 2 G V); relax the packing "
                "towards centroidal cells or raise Poisson's ratio."
            )


def _add_lists(model: Model, stored: list[Body], unlinked: list[NDArray[np.bool_]]) -> None:
    listed: list[NDArray[np.int64]] = []
    strength: list[Array] = []
    closing: list[Array] = []
    groups: list[Group] = []
    at = first = 0
    for body, mask in zip(stored, unlinked, strict=True):
        breakable = np.flatnonzero(body.breakable)
        cut = np.flatnonzero(mask & ~body.breakable)
        if body.fracture is not None and len(breakable):
            criterion = body.fracture
            groups.append(Group(criterion.kind, criterion.ratio, first, len(breakable)))
            strength.append(criterion.strength * body.strength_factor[breakable])
        else:
            strength.append(np.zeros(len(breakable)))
        strength.append(np.full(len(cut), np.inf))
        listed += [breakable + at, cut + at]
        ids = np.concatenate([breakable, cut])
        if isinstance(body.bond, EVMBond):
            assert model.evm_stiffness is not None
            closing.append(model.evm_stiffness[ids + at - model.facet_bonds, 0])
        else:
            modulus = body.material.lame(body.packing.plane) + 2.0 * body.material.shear_modulus
            assert body.packing.area is not None
            closing.append(modulus * (body.packing.area / body.packing.bond_length)[ids])
        first += len(breakable) + len(cut)
        at += len(mask)
        if not isinstance(body.bond, EVMBond):
            model.facet_listed = first
    model.listed_bonds = np.concatenate(listed).astype(np.int32)
    model.closing_stiffness = np.concatenate(closing)
    touched = np.stack([model.bond_i, model.bond_j])[:, model.listed_bonds]
    model.listed_elements = np.unique(touched).astype(np.int32)
    if groups:
        model.criteria = tuple(groups)
        model.bond_strength = np.concatenate(strength)
        near = np.unique(model.incidence[:, model.listed_elements] >> 1)
        model.near_bonds = near[near < model.bonds].astype(np.int32)
        model.near_facets = int((model.near_bonds < model.facet_bonds).sum())
        both = np.stack([model.bond_i, model.bond_j])[:, model.near_bonds]
        model.near_elements = np.unique(both).astype(np.int32)

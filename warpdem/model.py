"""A scene as arrays: what is fixed (Model), what changes (State), what is needed (Features)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from .bond import EVMBond
from .contact import Contact, bonded_rows, has_free_surface, touching_radius
from .criteria import (
    NUMBERS,
    CustomCriterion,
    DamageRate,
    Fracture,
    Incubation,
    LinearSoftening,
    criterion_of,
)
from .errors import Array, InputError, first_ids
from .friction import Friction, RateAndState, coulomb, numbers
from .kernels.contact import Touch
from .kernels.face import Faces
from .kernels.fracture import Test
from .kernels.motion import Ends
from .kernels.plastic import Flow
from .kernels.wall import BOX, CYLINDER, FAR, MESH, PLANE, SPHERE
from .kernels.wall import NUMBERS as SHAPE_NUMBERS
from .material import Material
from .plasticity import Nikolaevsky, Table, YieldLaw
from .relinking import Healing
from .scene import Body, History, Scene, StrainHistory
from .viscoelasticity import ViscousLaw
from .wall import Box, Cylinder, Plane, Sphere, Wall

Ids = NDArray[np.int32]
LEAST_SPHERICAL = 0.9  # of (1 - D) on irregular elements with a viscous law
RENEWED_SLOTS = {2: 10, 3: 26}  # room for the neighbours that renewed faces may bring
# bodies of so many elements and kinds of bonds at most, alike to so much, most of which are there,
# are lattices
LEAST_LATTICE, MOST_KINDS, LIKE, LEAST_SHARE = 512, 13, 1e-12, 0.7
LEAST_SHAPE = 0.05  # smallest stretch of B, 1 where an element has all its faces
# kept in the precision of places; everything else is in the precision of forces
PLACES = frozenset(
    {
        *("displacement", "orientation", "bond_arm", "bond_jump", "principal_axes", "bond_slip"),
        "evm_tilt",
        *("contact_radius", "closing_slip"),
        *("box_shift", "box_strain", "contact_box", "contact_box_before"),
        *("evm_direction", "evm_length", "evm_offset"),
        *("lattice_direction", "lattice_length", "lattice_offset"),
    }
)


@dataclass(frozen=True)
class Features:
    """What a scene needs. Passes and arrays that nothing here asks for do not exist."""

    dim: int
    plane_strain: bool
    has_volume: bool
    # whether constant forces, constant torques act from outside; how many loads change with time
    external: tuple[bool, bool, int]
    has_work: bool
    has_bending: bool  # some facets resist bending and twist
    has_grips: bool  # some grips change their velocity with time
    absorbs: bool  # some sides let waves out
    has_moments: bool  # some elements have three principal moments of inertia
    has_evm_dashpots: bool
    large_rotation: bool
    has_evm: bool
    has_dilation: bool  # g is measured from a dilation that plastic flow or creep has left
    branches: int  # most branches of a viscous law; 0: none creeps
    has_retardation: bool  # some faces have Kelvin and Voigt's dashpots
    finite_strain: bool
    renews: bool  # faces are made anew as elements change neighbours
    slots: int
    faces: Faces
    bond_kinds: int = 0  # of a lattice, whose elements need no slots; 0: is none

    @property
    def ends(self) -> Ends:
        """Where elements find what their bonds do to them."""
        return Ends(self.slots, self.bond_kinds)

    @property
    def evaluates_anew(self) -> bool:
        """Whether forces are evaluated a second time in a step, after plastic flow."""
        return self.has_dilation or (self.faces.has_slip and self.has_evm)

    @property
    def has_offset(self) -> bool:
        """Whether the volume term at finite strain is measured from a dilation other than 0."""
        return self.has_dilation or self.renews

    @property
    def keeps_mean(self) -> bool:
        """Whether slips ask for the mean stress m_i of theory B6; of yield in plane stress for
        another."""
        own = self.plane != "stress" or self.faces.has_creep or self.finite_strain
        own &= not self.faces.has_rest  # links made again ask for none
        return self.faces.has_slip and own

    @property
    def has_dashpots(self) -> bool:
        """Whether dashpots of any kind act."""
        return self.has_evm_dashpots or self.has_retardation

    @property
    def plane(self) -> str | None:
        """Plane state: "strain", "stress", or None in space."""
        return None if self.dim == 3 else "strain" if self.plane_strain else "stress"


@dataclass(frozen=True)
class Group:
    """Listed bonds of one body that break by one criterion: [first, first + count)."""

    test: Test
    numbers: tuple[float, ...]  # four
    rate: tuple[float, float]  # time [s] and exponent of damage
    first: int
    count: int


@dataclass(frozen=True)
class HealingGroup:
    """Listed bonds of one body that heals: [first, first + count)."""

    law: Healing
    first: int
    count: int


@dataclass(frozen=True)
class Yielding:
    """Elements of one yield law: [first, first + count) of `flow_elements`."""

    flow: Flow
    numbers: tuple[float, ...]  # yield stress, three of hardening, two of rate, friction, dilatancy
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
    facet_listed: int  # listed facet bonds, stored first; halves of interfaces follow them
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
    bond_jump: Array | None = None  # (b, dim) strain . shift through a periodic side
    bond_arm: Array | None = None  # (2 b + 2, dim), or (b + 1, dim) if faces are central
    facet_stiffness: Array | None = None  # k = 2 G S / r0
    facet_bending: Array | None = None  # (f, 2): c_B, c_T of each face (theory B9)
    evm_direction: Array | None = None
    evm_length: Array | None = None
    evm_offset: Array | None = None
    evm_stiffness: Array | None = None  # B1..B4
    # of a lattice, kind after kind of its bonds: where those of each element end, itself if none is
    # there; entries of those that end at it, or one where none begins; and the numbers of each kind
    lattice_after: Ids | None = None  # (kinds, n)
    lattice_before: Ids | None = None  # (kinds, n) kind n + element
    lattice_place: Ids | None = None  # (b,) entry of each bond, likewise
    lattice_direction: Array | None = None
    lattice_length: Array | None = None
    lattice_offset: Array | None = None
    lattice_stiffness: Array | None = None
    bond_weight: Array | None = None  # w = S / r0
    bond_face: Array | None = None  # (2 b + 2,): S q, that s_i sums
    element_two_shear: Array | None = None  # 2 G
    element_coupling: Array | None = None  # D
    inverse_shape: Array | None = None  # (n, dim, dim) B^-1 of finite strain
    evm_dashpot: Array | None = None  # eta along, across [N s/m], bending, torsion [N m s]
    external_force: Array | None = None
    external_torque: Array | None = None
    timed_force: Array | None = None  # (loads n, dim), load after load
    timed_torque: Array | None = None
    load_histories: tuple[History, ...] = ()
    box_bonds: Ids | None = None  # bonds through the sides of a box whose strain changes
    box_shift: Array | None = None  # from their second elements to the images bonded [m]
    strain_history: StrainHistory | None = None
    grip: Ids | None = None  # (n,) which of the grips' histories held motion follows
    grip_velocity: Array | None = None
    grip_spin: Array | None = None
    grip_histories: tuple[History, ...] = ()
    absorbing_damping: Array | None = None  # (n, dim, dim) force over velocity [N s/m]
    principal_moment: Array | None = None  # (n, 3)
    principal_axes: Array | None = None  # (n, 4) rotations from the principal axes to the world's
    listed_bonds: Ids | None = None  # bonds that are or may become unlinked
    closing_shear: Array | None = None  # of the listed bonds: 2 G S/r0 or c_t, where faces rub
    closing_stiffness: Array | None = None  # of the listed bonds: k_c = (lambda + 2 G) S / r0 or B1
    listed_elements: Ids | None = None  # elements of the listed bonds
    bond_strength: Array | None = None  # of the listed bonds
    softening_end: Array | None = None  # of the listed bonds: ratio at which no stress is left
    interface_bonds: Ids | None = None  # (p,) that may break between unlike elements
    interface_halves: Ids | None = None  # (p, 2) bonds of the nodes that hold them together
    interface_place: Ids | None = None  # (2 listed,) where these have their forces
    point_stiffness: Array | None = None  # (p,) of the spring that keeps a node when they part
    healing: tuple[HealingGroup, ...] = ()
    healing_stiffness: Array | None = None  # of the listed facet bonds: k, linked again
    healing_weight: Array | None = None  # likewise w
    healing_strength: Array | None = None  # of the listed bonds
    yielding: tuple[Yielding, ...] = ()
    flow_elements: Ids | None = None  # elements that may yield, law after law
    hardening_strain: Array | None = None  # tables of hardening, one after the other
    hardening_stress: Array | None = None
    bond_law: Ids | None = None  # (f,) which viscous law a facet bond follows, 0: none
    element_law: Ids | None = None  # (n,) likewise
    branch_share: Array | None = None  # (laws, branches) of the shear modulus
    branch_time: Array | None = None  # (laws, branches) of relaxation [s]
    retardation: Array | None = None  # (laws,) viscosity over shear modulus [s]
    element_spherical: Array | None = None  # 1 - D, or less on irregular elements
    retarded_elements: Ids | None = None  # elements of Kelvin and Voigt's law
    # elements that touch what no bond joins them to; the last slot of every element is for that
    contact: Contact | None = None
    walls: tuple[Wall, ...] = ()
    contact_elements: Ids | None = None  # (m,) that may touch
    contact_position: Array | None = None  # (n, dim) from the middle of the scene, in float64
    contact_radius: Array | None = None  # (n,)
    contact_period: Array | None = None  # (dim,) edges of the periodic box, unstrained [m]
    contact_strain: Array | None = None  # (dim, dim) of that box, where it does not change
    listed_image: Ids | None = None  # (listed bonds, dim) edges from second elements to images
    contact_width: Array | None = None  # (n,) thickness in the plane
    contact_compliance: Array | None = None  # (n,) R/(lambda + 2 G) [m/Pa], Hertz (1 - nu^2)/E
    contact_shear: Array | None = None  # (n,) R/(2 G) [m/Pa]
    bonded_start: Ids | None = None  # (m + 1,) rows of elements that bonds join
    bonded: Ids | None = None
    bonded_listed: Ids | None = None  # of which listed bond, -1: of none
    contact_middle: Array | None = None  # (dim,) middle of the scene [m]
    contact_impedance: float = 0.0  # of plane waves in all elements that may touch [N s/m]
    wall_kind: Ids | None = None  # (walls,)
    wall_shape: Array | None = None  # (walls, 8) numbers of each shape
    wall_friction: Array | None = None  # (walls,)
    wall_rolling: Array | None = None  # (walls,) if any contact resists rolling
    wall_twisting: Array | None = None  # (walls,) likewise
    friction_numbers: Array | None = None  # (kinds^2 + walls kinds, 7) of all, if any has a state
    kinds: int = 1  # of elements, by what they are made of, where friction differs
    contact_kind: Ids | None = None  # (n,)
    friction_table: Array | None = None  # (kinds^2 + walls kinds,) Coulomb's, row after row
    wall_first_face: Ids | None = None  # (walls,) of a mesh among all
    face_place: Array | None = None  # (3 faces, 3) corners of all meshes, from their walls' places
    # Between unlike elements a face is a node, an element without turning, with a bond to each. The
    # second ones, then the first ones of faces that may part, are stored after all other facet
    # bonds; of faces that never part the first is the packing's own.
    nodes: int = 0  # stored after all other elements
    node_bonds: Ids | None = None  # (nodes,) their first bonds

    @property
    def rubs(self) -> bool:
        """Whether contacts have springs across their normals, of friction or of welds."""
        welds = self.contact is not None and self.contact.welding is not None
        return welds or any(side.rubs for side in self._sides)

    @property
    def rolls(self) -> bool:
        """Whether contacts resist rolling or twisting."""
        return any(x.rolling_friction > 0.0 or x.twisting_friction > 0.0 for x in self._sides)

    @property
    def _sides(self) -> list[Contact | Wall]:
        """What has friction of its own."""
        return [*([] if self.contact is None else [self.contact]), *self.walls]

    @property
    def touch(self) -> Touch:
        """What contacts have."""
        assert self.contact is not None
        return Touch(
            is_hertz=self.contact.is_hertz,
            rubs=self.rubs,
            ages=self.ages,
            bounces=self.contact.bounces,
            damps=self.contact.damping_ratio > 0.0,
            rolls=self.rolls,
            by_kind=self.contact_kind is not None,
            welds=self.contact.welding is not None,
            is_periodic=self.contact_period is not None,
        )

    @property
    def faces_rub(self) -> bool:
        """Whether closed faces of unlinked pairs have friction."""
        touches = self.contact is not None and self.contact.rubs
        return touches and self.listed_bonds is not None

    @property
    def ages(self) -> bool:
        """Whether some friction has a state, that of rate and state."""
        return self.friction_numbers is not None

    @property
    def softens(self) -> bool:
        """Whether some bonds soften before they break."""
        return self.softening_end is not None

    @property
    def breaks_beams(self) -> bool:
        """Whether some bonds break by what they carry as beams."""
        return any(not group.test.needs_stress for group in self.criteria)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.position)

    @property
    def bonds(self) -> int:
        """Number of bonds."""
        return self.facet_bonds + self.evm_bonds

    @property
    def own_elements(self) -> int:
        """Number of elements that the scene's packings have: all but nodes."""
        return self.elements - self.nodes

    @property
    def own_facets(self) -> int:
        """Number of facet bonds that the scene's packings have."""
        return self.facet_bonds - self.nodes - self.interfaces

    @property
    def interfaces(self) -> int:
        """Number of bonds that may break between unlike elements."""
        return 0 if self.interface_bonds is None else len(self.interface_bonds)

    @property
    def own_bonds(self) -> NDArray[np.int64]:
        """Bonds that the scene's packings have: all but those stored for nodes."""
        return np.delete(np.arange(self.bonds), slice(self.own_facets, self.facet_bonds))

    @property
    def second_bonds(self) -> slice:
        """The bonds on the far sides of nodes."""
        return slice(self.own_facets, self.own_facets + self.nodes)

    @property
    def first_beam(self) -> int:
        """Row of the first EVM bond among the listed ones."""
        return self.facet_listed + 2 * self.interfaces

    def rows_of(self, bonds: NDArray) -> NDArray[np.int64]:
        """Rows of listed bonds in the list."""
        assert self.listed_bonds is not None
        row = np.full(self.bonds, -1, dtype=np.int64)
        row[self.listed_bonds] = np.arange(len(self.listed_bonds))
        return row[bonds]

    def with_halves(self, value: NDArray, fill: float) -> NDArray:
        """Values of the packings' bonds (b, ...), and `fill` of those stored for nodes."""
        return np.insert(value, [self.own_facets] * (self.facet_bonds - self.own_facets), fill, 0)

    @property
    def own_pairs(self) -> NDArray[np.int64]:
        """Elements that the packings' bonds join, (b, 2)."""
        j = self.bond_j.astype(np.int64)
        if self.node_bonds is not None:  # of packings' own bonds that end at a node
            j[self.node_bonds] = np.where(
                self.node_bonds < self.own_facets,
                self.bond_j[self.second_bonds],
                j[self.node_bonds],
            )
        return np.stack([self.bond_i, j], axis=1)[self.own_bonds].astype(np.int64)

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
    orientation = np.zeros((model.own_elements, rot))
    orientation[:, -1] = 1.0
    places = np.concatenate([x.displacement for x in bodies]), orientation
    speeds = tuple(
        np.concatenate([getattr(x, name) for x in bodies])
        for name in ("velocity", "angular_velocity")
    )
    displacement, orientation = with_nodes(model, *places)
    velocity, angular_velocity = with_moving_nodes(model, *speeds)
    if model.grip_histories:
        share = np.array([history(0.0) for history in model.grip_histories])[model.grip, None]
        velocity = np.where(model.inverse_mass > 0.0, velocity, share * velocity)
        turns = model.inverse_inertia[:, None] > 0.0
        angular_velocity = np.where(turns, angular_velocity, share * angular_velocity)
    state: dict[str, NDArray] = {
        "displacement": displacement,
        "orientation": orientation,
        "velocity": velocity,
        "angular_velocity": angular_velocity,
        "end_force": np.zeros(((f.bond_kinds or f.slots) * n, f.dim)),
        "end_torque": np.zeros(((f.bond_kinds + 1 if f.bond_kinds else f.slots) * n, spins)),
    }
    if f.has_work:
        state["element_work"] = np.zeros(n)
    if model.load_histories:
        state["load_factor"] = np.zeros(len(model.load_histories))
    if model.grip_histories:
        state["grip_factor"] = np.zeros(len(model.grip_histories))
    if model.box_bonds is not None:
        state["box_strain"] = np.zeros((f.dim, f.dim))
        state["box_motion"] = np.zeros((len(model.box_bonds), f.dim))
        state["box_work"] = np.zeros(len(model.box_bonds))
    linked = np.zeros(b + 1)
    present = np.concatenate([x.linked for x in in_bond_order(bodies)])
    present = model.with_halves(present, True)
    linked[:b] = present if linked_bonds is None else linked_bonds
    if model.facet_stiffness is not None:
        state["facet_stiffness"] = model.facet_stiffness * linked[: model.facet_bonds]
        if model.interface_halves is not None:  # a node stays with its first element
            state["facet_stiffness"][model.interface_bonds] = 0.0
            state["facet_stiffness"][model.interface_halves[:, 0]] = model.point_stiffness
    if model.facet_bending is not None:
        state["facet_bending"] = model.facet_bending * linked[: model.facet_bonds, None]
    if model.evm_dashpot is not None:
        state["evm_dashpot"] = model.evm_dashpot * linked[model.facet_bonds : -1, None]
    if f.has_dashpots:
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
        if model.faces_rub:
            listed = len(model.listed_bonds)
            for name in ("closing_slip", "closing_spring"):
                state[name] = np.zeros((listed, f.dim))
            state["closing_slip_energy"] = np.zeros(listed)
            if model.ages:
                state["closing_theta"] = np.zeros(listed)
    if model.contact is not None:
        rows = len(model.contact_elements) if model.contact_elements is not None else 0
        state["contact_moment"] = np.zeros((n, 4 if f.dim == 2 else 6))
        state["any_touched"] = np.zeros(1, dtype=np.int32)
        state["settling_impulse"] = np.zeros((n, f.dim))
        state["settling_twist"] = np.zeros((n, spins))
        if model.contact_period is not None:
            state["contact_box"] = np.zeros((f.dim, f.dim))
            state["contact_box_before"] = np.zeros((f.dim, f.dim))
            state["contact_box_work"] = np.zeros(rows)
        if model.contact.restitution < 1.0:
            state["restitution_energy"] = np.zeros(rows)
        if model.rubs or model.rolls:
            state["slip_energy"] = np.zeros(rows)
        if model.contact.welding is not None:
            state["weld_energy"] = np.zeros(rows)
            state["any_welded"] = np.zeros(1, dtype=np.int32)
        if model.walls:
            walls = len(model.walls)
            spin, place = np.zeros((walls, spins)), np.zeros((walls, f.dim))
            turn = np.zeros((walls, rot))
            for name in ("wall_place", "wall_place_before", "wall_velocity"):
                state[name] = place
            for name in ("wall_turn", "wall_turn_before"):
                state[name] = turn
            state["wall_spin"] = spin
            state["wall_torque"] = np.zeros((walls, rows, spins))
            state["wall_debt"] = np.zeros((walls, rows))
            state["wall_impulse"] = np.zeros((walls, rows))
            state["wall_reaction"] = np.zeros((walls, rows, f.dim))
            state["wall_work"] = np.zeros(rows)
            if model.rubs:
                state["wall_spring"] = np.zeros((walls, rows, f.dim))
            if model.ages:
                state["wall_theta"] = np.zeros((walls, rows))
            if model.rolls:
                state["wall_roll"] = np.zeros((walls, rows, spins))
            if model.touch.bounces:
                state["wall_opened"] = np.zeros((walls, rows), dtype=np.int32)
            if model.touch.damps:
                state["wall_dashpot"] = np.zeros((walls, rows))
    if f.faces.has_rest:
        state |= _healing_arrays(model)
    if f.has_volume:
        assert model.bond_weight is not None
        state["bond_weight"] = model.bond_weight * linked[:-1]
        if f.finite_strain:
            state["centre_opening"] = np.zeros((b + 1, f.dim))
            for name in ("displacement_gradient", "volume_pull"):
                state[name] = np.zeros((n, f.dim, f.dim))
        else:
            state["end_dilation"] = np.zeros(f.slots * n)
        state["volume_stress"] = np.zeros(n)
        state["volume_stiffness"] = volume_stiffness(model, linked)
    if f.keeps_mean:
        state["mean_stiffness"] = mean_stiffness(model, linked)
        state["mean_stress"] = np.zeros(n)
    if f.branches:
        state |= _branch_arrays(model)
    if f.has_retardation:
        state |= _retarded_arrays(model, linked)
    if model.yielding:
        assert model.flow_elements is not None
        if not f.keeps_mean:
            state["return_mean"] = np.zeros(n)
        state["plastic_strain"] = np.zeros(n)
        if f.plane == "strain":
            state["plastic_strain_zz"] = np.zeros(n)
        if f.finite_strain:
            state["return_factor"] = np.ones(n)
            state["trial_force"] = np.zeros((b + 1, f.dim))
            for name in ("kirchhoff_stress", "spring_stress", "plastic_gradient"):
                state[name] = np.zeros((n, f.dim, f.dim))
            state["plastic_growth"] = np.zeros(n)
            if f.plane is not None:
                state["plastic_growth_zz"] = np.zeros(n)
        else:
            state["return_loss"] = np.zeros(n)
        if f.renews and not f.has_dilation:
            state["plastic_dilation"] = np.zeros(n)
        state["spring_force"] = np.zeros((b, f.dim))
        state["bond_dissipation"] = np.zeros(b)
        if model.facet_bonds:
            state["bond_slip"] = np.zeros((2 * model.facet_bonds, f.dim))
        if model.evm_bonds:
            state["spring_pull"] = np.zeros(model.evm_bonds)
            state["evm_slip"] = np.zeros(model.evm_bonds)
            state["evm_tilt"] = np.zeros((2 * model.evm_bonds, f.dim))
        if f.has_dilation:
            for name in ("plastic_dilation", "last_dilation", "last_volume_stress"):
                state[name] = np.zeros(n)
            if not f.finite_strain:
                state["return_growth"] = np.zeros(n)
            state["element_dissipation"] = np.zeros(n)
    if model.criteria:
        assert model.listed_bonds is not None
        listed = len(model.listed_bonds)
        break_step = np.full(b + 1, -2, dtype=np.int32)
        break_step[:b][linked[:b] == 1.0] = -1  # -1: may break still; -2: never will
        if any(group.test.needs_stress for group in model.criteria):
            state["stress"] = np.zeros((n, 4 if f.dim == 2 else 6))
        state["any_broken"] = np.zeros(1)
        state["break_step"] = break_step
        for name in ("break_energy", "break_normal", "break_shear", "criterion_ratio"):
            state[name] = np.zeros(listed)
        if any(group.test.damage or group.test.softens for group in model.criteria):
            state["break_damage"] = np.ones(listed)  # the greatest ratio of bonds that soften
            for group in model.criteria:
                if not group.test.softens:
                    state["break_damage"][group.first : group.first + group.count] = 0.0
        if model.softens:
            state["bond_keep"] = np.ones(b + 1)
        if model.breaks_beams:
            state["beam_load"] = np.zeros((model.evm_bonds, 4))
        if f.has_volume:
            state["element_release"] = np.zeros(n)
    return state


def _healing_arrays(model: Model) -> dict[str, NDArray]:
    """State of bonds that link again, and of what their links start from."""
    dim, facets = model.features.dim, model.facet_listed
    state: dict[str, NDArray] = {"bond_slip": np.zeros((2 * model.facet_bonds, dim))}
    if model.features.has_volume:
        state["rest_dilation"] = np.zeros(2 * model.bonds)
    if model.evm_bonds:  # these do not heal
        state["evm_slip"] = np.zeros(model.evm_bonds)
        state["evm_tilt"] = np.zeros((2 * model.evm_bonds, dim))
    names = ("healing_time", "healing_start", "relink_energy", "relink_released")
    for name in (*names, "relink_normal", "relink_shear"):
        state[name] = np.zeros(facets)
    state["healing_state"] = np.zeros(facets, dtype=np.int32)
    state["any_healed"] = np.zeros(1, dtype=np.int32)
    return state


def _branch_arrays(model: Model) -> dict[str, NDArray]:
    """State of bonds that creep, and of what creeps across the plane."""
    f, n, facets = model.features, model.elements, model.facet_bonds
    state: dict[str, NDArray] = {
        "viscous_mean": np.zeros(n),
        "branch_slip": np.zeros((f.branches * facets, f.dim)),
        "bond_slip": np.zeros((2 * model.bonds, f.dim)),
        "last_opening": np.zeros((facets, f.dim)),
        "last_force": np.zeros((facets, f.dim)),
        "slip_step": np.zeros((facets, f.dim)),
        "bond_dissipation": np.zeros(facets),
    }
    if f.plane is not None:
        state["branch_zz"] = np.zeros((f.branches, n))
        state["element_dissipation"] = np.zeros(n)
    if f.plane == "strain":  # the creep across it is a dilation
        state["plastic_strain_zz"] = np.zeros(n)
        state |= _dilation_arrays(n)
    if model.evm_bonds:  # these do not creep
        state["evm_slip"] = np.zeros(model.evm_bonds)
        state["evm_tilt"] = np.zeros((2 * model.evm_bonds, f.dim))
    return state


def _retarded_arrays(model: Model, linked: Array) -> dict[str, NDArray]:
    """State of Kelvin and Voigt's dashpots."""
    f, n, facets = model.features, model.elements, model.facet_bonds
    rate, stiffness, time = retarded(model, linked)
    state: dict[str, NDArray] = {
        "opening_rate": np.zeros((facets, f.dim)),
        "end_rate": np.zeros(f.slots * n),
        "mean_rate": np.zeros(n),
        "trial_velocity": np.zeros((n, f.dim)),
        "trial_spin": np.zeros((n, 1 if f.dim == 2 else 3)),
        "rate_viscosity": rate,
        "retarded_stiffness": stiffness,
        "retarded_time": time,
        "retarded_dilation": np.zeros(n),
        "last_element_dilation": np.zeros(n),
        "volume_stiffness": volume_stiffness(model, linked) + stiffness,
    }
    if model.box_bonds is not None:
        state["jump_rate"] = np.zeros((model.bonds, f.dim))
        state["dashpot_work"] = np.zeros(facets)
    return state | _dilation_arrays(n)


def _dilation_arrays(n: int) -> dict[str, NDArray]:
    """State of elements whose volume stress is measured from another dilation than 0."""
    names = "plastic_dilation", "last_dilation", "last_volume_stress", "element_dissipation"
    return {name: np.zeros(n) for name in names}


def with_nodes(
    model: Model,
    displacement: Array,
    orientation: Array,
    parted: NDArray[np.bool_] | None = None,
) -> tuple[Array, Array]:
    """Displacement and orientation of the packings' elements, and of nodes between them.

    parted: (nodes,) those that stay with their first element.
    """
    if model.node_bonds is None:
        return displacement, orientation
    points = []
    for element, arm in _node_sides(model):
        q = orientation[element]
        if model.features.dim == 2:
            s, c = 2.0 * q[:, 0] * q[:, 0], 2.0 * q[:, 0] * q[:, 1]
            turn = np.stack([-s * arm[:, 0] - c * arm[:, 1], c * arm[:, 0] - s * arm[:, 1]], axis=1)
        else:
            cross = np.cross(q[:, :3], arm)
            turn = 2.0 * np.cross(q[:, :3], q[:, 3:] * arm + cross)
        points.append(displacement[element] + turn)
    rest = np.zeros((model.nodes, orientation.shape[1]))
    rest[:, -1] = 1.0
    nodes = _between(model, points, parted)
    return np.concatenate([displacement, nodes]), np.concatenate([orientation, rest])


def with_moving_nodes(
    model: Model,
    velocity: Array,
    angular_velocity: Array,
    parted: NDArray[np.bool_] | None = None,
) -> tuple[Array, Array]:
    """Velocity and spin of the packings' elements, and of nodes between them, as `with_nodes`."""
    if model.node_bonds is None:
        return velocity, angular_velocity
    points = []
    for element, arm in _node_sides(model):
        w = angular_velocity[element]
        if model.features.dim == 2:
            turn = w * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        else:
            turn = np.cross(w, arm)
        points.append(velocity[element] + turn)
    still = np.zeros((model.nodes, angular_velocity.shape[1]))
    nodes = _between(model, points, parted)
    return np.concatenate([velocity, nodes]), np.concatenate([angular_velocity, still])


def _node_sides(model: Model) -> list[tuple[Ids, Array]]:
    """The element on each side of every node, and the arm from its centre."""
    ends, second = bond_ends(model), model.second_bonds
    return [
        (model.bond_i[model.node_bonds], ends[model.node_bonds, 0]),
        (model.bond_j[second], ends[second, 1]),
    ]


def _between(model: Model, points: list[Array], parted: NDArray[np.bool_] | None) -> Array:
    """Mean of both sides' points, each weighted with its stiffness; the first where parted."""
    assert model.facet_stiffness is not None
    stiffness = model.facet_stiffness
    weight = stiffness[model.node_bonds], stiffness[model.second_bonds]
    share = (weight[0] / (weight[0] + weight[1]))[:, None]
    if parted is not None:
        share[parted] = 1.0
    return share * points[0] + (1.0 - share) * points[1]


def in_bond_order(bodies: list[Body]) -> list[Body]:
    """Bodies in the order in which their bonds are stored: facet bonds first."""
    return sorted(bodies, key=lambda body: isinstance(body.bond, EVMBond))


def volume_stiffness(model: Model, linked: Array) -> Array:
    """A_i = 2 G D / (3 - D s*) [Pa] for given links (theory B4)."""
    assert model.element_coupling is not None
    return model.element_coupling * mean_stiffness(model, linked)


def mean_stiffness(model: Model, linked: Array) -> Array:
    """m_i/(E_i - P_i) = 2 G / (3 - D s*) [Pa] for given links (theory B4)."""
    assert model.element_coupling is not None and model.element_two_shear is not None
    return model.element_two_shear / (3.0 - model.element_coupling * face_sum(model, linked))


def face_sum(model: Model, linked: Array) -> Array:
    """s* of given links (theory B4): 3 where no face is missing, in plane stress 2.

    At finite strain dilations are whole at free surfaces too.
    """
    assert model.bond_face is not None
    if model.features.finite_strain:
        whole = float(model.features.dim + model.features.plane_strain)
        return np.full(model.elements, whole)
    face = model.bond_face * np.repeat(linked, 2)
    s = face[model.incidence].sum(axis=0) / model.element_volume
    return s + model.features.plane_strain


def retarded(model: Model, linked: Array) -> tuple[Array, Array, Array]:
    """What Kelvin and Voigt's law adds to elements for given links, (n,) each (theory B12).

    The viscosity [Pa s] of the rate of E that the deviator leaves out; stiffness [Pa] and time [s]
    of relaxation of a branch of E, which has some where faces are missing or in plane stress.
    """
    assert model.element_two_shear is not None and model.element_coupling is not None
    assert model.element_law is not None and model.retardation is not None
    assert model.element_spherical is not None
    time, d = model.retardation[model.element_law], model.element_coupling
    s = face_sum(model, linked)
    acts = (time > 0.0) & (s > 1e-9)
    time, s = np.where(acts, time, 0.0), np.where(acts, s, 3.0)
    share, left = model.element_spherical / (1.0 - d), 3.0 - d * s
    missing = np.maximum(3.0 - s, 0.0) * acts
    stiffness = 3.0 * model.element_two_shear * missing / (s**2 * (1.0 - d) * left)
    viscosity = time * model.element_two_shear / s * share
    return viscosity, stiffness, s * (1.0 - d) * time / left


def bond_ends(model: Model) -> Array:
    """Arms from both elements to each face [m], (b, 2, dim)."""
    arm = model.bond_arm
    assert arm is not None
    if model.features.faces.central:
        return np.stack([arm[:-1], -arm[:-1]], axis=1)
    return arm[:-2].reshape(-1, 2, model.features.dim)


def face_arms(model: Model) -> Array:
    """Arms from the first element to each face, or to the middle of a bond without one."""
    arms = np.zeros((model.bonds, model.features.dim))
    if model.bond_arm is not None:
        arms[:] = bond_ends(model)[:, 0]
    if model.evm_direction is not None:
        assert model.evm_length is not None and model.evm_offset is not None
        reach = model.evm_offset[:, 0] + 0.5 * model.evm_length
        beams = arms[model.facet_bonds :]
        bare = ~beams.any(axis=1)
        beams[bare] = (reach[:, None] * model.evm_direction)[bare]
    return arms


def face_reach(model: Model) -> Array:
    """X_i = (1/V_i) sum S |c|^2/q over an element's faces with a volume term (theory B8)."""
    assert model.bond_area is not None and model.bond_face is not None
    face = model.bond_face[:-2].reshape(-1, 2)  # S q, zero where no volume term acts
    reach = np.zeros(2 * model.bonds + 2)
    ends = bond_ends(model)
    if model.inverse_shape is not None:  # the arms that dilations are made with
        both = np.stack([model.bond_i, model.bond_j], axis=1)
        ends = np.einsum("bsxy,bsx->bsy", model.inverse_shape[both], ends)
    square = (ends**2).sum(axis=2) * model.bond_area[:, None] ** 2
    np.divide(square, face, out=reach[:-2].reshape(-1, 2), where=face > 0.0)
    return reach[model.incidence].sum(axis=0) / model.element_volume


def _inverse_shape(model: Model, linked: Array) -> Array:
    """B^-1 of every element (n, dim, dim), B = (1/V) sum w r (x) c over linked faces (theory B6).

    r, from the element's centre to the other's; 0 for what has no faces of its own.
    """
    assert model.bond_weight is not None
    n, dim = model.elements, model.features.dim
    ends = bond_ends(model)
    across = (model.bond_weight * linked)[:, None] * (ends[:, 0] - ends[:, 1])
    shape = np.zeros((n, dim, dim))
    for side, (element, sign) in enumerate(((model.bond_i, 1.0), (model.bond_j, -1.0))):
        np.add.at(shape, element, sign * across[:, :, None] * ends[:, side, None, :])
    shape /= model.element_volume[:, None, None]
    size = np.linalg.svd(shape, compute_uv=False)
    alone = size[:, 0] == 0.0
    bad = ~alone & (size[:, -1] < LEAST_SHAPE)
    if bad.any():
        raise InputError(
            f"elements {first_ids(bad)} have too few faces, or all near one plane, to have a "
            "deformation gradient; leave them out (Packing.without) or finite_strain."
        )
    shape[alone] = np.eye(dim)
    inverse = np.asarray(np.linalg.inv(shape), dtype=np.float64)
    inverse[alone] = 0.0
    return inverse


def build(scene: Scene) -> Model:
    """Arrays of a scene. Raises InputError where its energy would not be positive definite."""
    if not scene.bodies:
        raise InputError("the scene is empty; add a body with scene.add.")
    bodies = scene.bodies
    packing = bodies[0].packing
    dim = packing.dim
    sizes = [len(b.packing) for b in bodies]
    starts = dict(zip(map(id, bodies), np.cumsum([0, *sizes]), strict=False))
    stored = in_bond_order(bodies)
    pairs = np.concatenate([b.packing.bonds + starts[id(b)] for b in stored])
    counts = [len(b.packing.bonds) for b in stored]
    is_evm = [isinstance(b.bond, EVMBond) for b in stored]
    facet_bonds = sum(c for c, e in zip(counts, is_evm, strict=True) if not e)
    each = _elements(bodies, dim)
    faces = _Faces(stored, dim)
    viscous = _viscous_laws(bodies, each)
    unlike, parting = _unlike(stored, pairs[:facet_bonds], each)
    node_bonds, parting_halves = np.zeros(0, dtype=np.int64), None
    if len(unlike):
        pairs, node_bonds = _put_nodes(unlike, parting, pairs, facet_bonds, each, faces)
        if parting.any():
            second = facet_bonds + np.flatnonzero(parting)
            parting_halves = np.stack([node_bonds[parting], second], axis=1).astype(np.int32)
        facet_bonds += len(unlike) + int(parting.sum())
    n, bonds = len(each["position"]), len(pairs)
    incidence = _incidence(pairs, n)
    if scene.contacts is not None:  # what touches has a slot of its own, of no bond
        incidence = np.vstack([incidence, np.full((1, n), 2 * bonds, dtype=np.int32)])
    renews = _renews(scene, bool(len(node_bonds)))
    if renews:
        incidence = _roomy(incidence, bonds, RENEWED_SLOTS[dim])
    mass, held, held_rotation = each["mass"], each["held"] > 0.0, each["held_rotation"] > 0.0
    moments, axes = _principal(bodies, mass, each["inertia"])
    inertia = each["inertia"] if moments is None else moments.mean(axis=1)
    turning = held_rotation[:, None] & (each["angular_velocity"] != 0.0)
    unlinked = [~b.linked | b.breakable for b in stored]
    evm = [b.bond for b in bodies if isinstance(b.bond, EVMBond)]
    if len({b.large_rotation for b in evm}) > 1:
        raise InputError("all EVM bonds of a scene take large_rotation, or none does.")
    if scene.gravity is not None:
        if scene.gravity.shape != (dim,):
            raise InputError(f"gravity has {len(scene.gravity)} components; give {dim}.")
        each["force"] += mass[:, None] * scene.gravity
    if len({b.finite_strain for b in bodies}) > 1:
        raise InputError("all bodies of a scene take finite_strain, or none does.")
    has_box = any(b.strain_history is not None for b in bodies)
    has_jump = has_box or any((b.shift @ b.mean_strain).any() for b in bodies)
    timed = [(b, load) for b in bodies for load in b.timed_loads]
    laws = [law for b in bodies for law in b.yielding if law is not None]
    grows = packing.plane == "stress" or any(isinstance(law, Nikolaevsky) for law in laws)
    branches = max((len(law.series()[0]) for law in viscous), default=0)
    external = bool(each["force"].any()), bool(each["torque"].any()), len(timed)
    has_grips = len(scene.grip_histories) > 1
    heals = any(b.healing is not None for b in bodies)
    if heals:
        _check_healing(scene, bool(laws), bool(viscous))
    features = Features(
        dim=dim,
        plane_strain=packing.plane == "strain",
        has_volume=any(b.has_volume for b in bodies),
        external=external,
        has_work=bool(
            (held & (each["velocity"] != 0.0)).any() or turning.any() or any(external) or has_grips
        ),
        has_grips=has_grips,
        absorbs=any(b.absorbing.any() for b in bodies),
        has_bending=any(b.facet_bending for b in bodies),
        has_moments=moments is not None,
        has_evm_dashpots=any(b.damping > 0.0 for b in evm),
        large_rotation=any(b.large_rotation for b in evm),
        has_evm=bool(evm),
        has_dilation=(bool(laws) and grows)
        or (branches > 0 and packing.plane == "strain")
        or any(law.retardation > 0.0 for law in viscous),
        branches=branches,
        has_retardation=any(law.retardation > 0.0 for law in viscous),
        finite_strain=any(b.finite_strain for b in bodies),
        renews=renews,
        slots=len(incidence),
        faces=Faces(
            faces.is_central and not renews,
            has_jump=has_jump,
            has_slip=bool(laws) or branches > 0 or heals,
            has_creep=branches > 0,
            has_rest=heals,
        ),
    )
    model = Model(
        features=features,
        position=each["position"],
        facet_bonds=facet_bonds,
        evm_bonds=bonds - facet_bonds,
        criteria=(),
        facet_listed=0,
        mass=mass,
        inertia=inertia,
        inverse_mass=np.where(held, 0.0, 1.0 / mass[:, None]),
        inverse_inertia=np.where(held_rotation, 0.0, 1.0 / inertia),
        element_volume=each["volume"],
        incidence=incidence,
        bond_place=np.argsort(incidence, axis=None, kind="stable")[: 2 * bonds].astype(np.int32),
        bond_i=pairs[:, 0].astype(np.int32),
        bond_j=pairs[:, 1].astype(np.int32),
        external_force=each["force"] if features.external[0] else None,
        external_torque=each["torque"] if features.external[1] else None,
        principal_moment=moments,
        principal_axes=axes,
        nodes=len(node_bonds),
        node_bonds=node_bonds.astype(np.int32) if len(node_bonds) else None,
    )
    if parting_halves is not None:
        model.interface_bonds = unlike[parting].astype(np.int32)
        model.interface_halves = parting_halves
    if has_jump:
        _add_box(model, stored)
    if timed:
        model.load_histories = tuple(load.history for _, load in timed)
        for name in ("force", "torque"):
            whole = np.zeros((len(timed), *each[name].shape))
            for row, (body, load) in zip(whole, timed, strict=True):
                at = starts[id(body)]
                row[at : at + len(body.packing)] = getattr(load, name)
            setattr(model, "timed_" + name, whole.reshape(-1, whole.shape[2]))
    if has_grips:
        model.grip_histories = tuple(scene.grip_histories)
        model.grip = np.concatenate([*(b.grip for b in bodies), np.zeros(model.nodes)]).astype(
            np.int32
        )
        model.grip_velocity, model.grip_spin = each["velocity"], each["angular_velocity"]
    if features.absorbs:
        model.absorbing_damping = each["absorbing"]
    if faces.any:
        model.bond_area = faces.area
        model.bond_arm = faces.arm[:, 0] if features.faces.central else faces.arm.reshape(-1, dim)
    _add_laws(model, stored, each["two_shear"], faces)
    if features.has_volume:
        _add_volume(model, stored, each, faces)
    if features.finite_strain:
        linked = np.concatenate([b.linked for b in stored])
        model.inverse_shape = _inverse_shape(model, model.with_halves(linked, True))
    if laws:
        _add_yielding(model, bodies)
    if viscous:
        _add_viscous(model, viscous, each)
    if any(mask.any() for mask in unlinked):
        _add_lists(model, stored, unlinked, each["pressure_modulus"], faces)
    if scene.contacts is not None:
        _add_contact(model, scene, each)
    else:
        _add_lattice(model)
    return model


def _check_healing(scene: Scene, has_yield: bool, has_creep: bool) -> None:
    """Refuse what links made again do not know of."""
    if has_yield or has_creep:
        raise InputError(
            "healing is for elastic bodies: links made again do not know of slips that flow or "
            "creep has left; leave yielding and viscous, or healing, out of the scene."
        )
    touching = scene.contacts is not None and scene.contacts.rubs
    if not touching and any(b.healing is not None and b.healing.work > 0.0 for b in scene.bodies):
        raise InputError(
            "healing after work of slip needs friction: call scene.contact(friction=...), or "
            "leave work at 0."
        )


def _renews(scene: Scene, has_nodes: bool) -> bool:
    """Whether faces are renewed; refuses what cannot be carried over."""
    if all(b.renew_faces is None for b in scene.bodies):
        return False
    if len(scene.bodies) > 1 or has_nodes:
        raise InputError(
            "renew_faces is for a scene of one body of one stiffness; leave the others out, or "
            "renew_faces."
        )
    body = scene.bodies[0]
    if not body.linked.all():
        raise InputError("renew_faces is not for bodies with cuts: new faces would heal them.")
    if body.packing.period is not None and not np.isfinite(body.packing.period).all():
        raise InputError("renew_faces is for bodies that repeat along all axes or none.")
    if body.mean_strain.any() and body.strain_history is None:
        raise InputError("renew_faces takes a periodic strain as a function of time.")
    return True


def _roomy(incidence: Ids, bonds: int, slots: int) -> Ids:
    """Incidence with at least so many slots, the further ones of no bond."""
    more = max(slots - len(incidence), 0)
    return np.vstack([incidence, np.full((more, incidence.shape[1]), 2 * bonds, dtype=np.int32)])


def with_faces(
    model: Model, position: Array, volume: Array, pairs: NDArray[np.int64], area: Array,
    arms: Array, shift: Array, past: Array,
    whole: StrainHistory | None,
) -> Model:  # fmt: skip
    """The model of a body whose elements have moved to `position` and have other faces there.

    volume (n,); pairs (b, 2), area (b,) and arms (b, 2, dim) of the faces; shift (b, dim): of a
    periodic body, from the second elements to their images at zero strain; whole: the
    history of the box's strain, past (dim, dim) so far. Masses, inertias, loads and grips stay with
    the elements.
    """
    n, dim = position.shape
    vector = arms[:, 0] - arms[:, 1]
    length = np.linalg.norm(vector, axis=1)
    distance = np.einsum("bsk,bk->bs", arms, vector) * [1.0, -1.0] / length[:, None]
    incidence = _roomy(_incidence(pairs, n), len(pairs), model.features.slots)
    assert model.element_two_shear is not None
    modulus = _series(model.element_two_shear, pairs, distance)
    face = np.zeros(2 * len(pairs) + 2)
    face[:-2] = (area[:, None] * distance).ravel()
    new = replace(
        model,
        features=replace(model.features, slots=len(incidence)),
        position=position,
        facet_bonds=len(pairs),
        element_volume=volume,
        incidence=incidence,
        bond_place=np.argsort(incidence, axis=None, kind="stable")[: 2 * len(pairs)].astype(
            np.int32
        ),
        bond_i=pairs[:, 0].astype(np.int32),
        bond_j=pairs[:, 1].astype(np.int32),
        bond_area=area,
        bond_arm=np.concatenate([arms.reshape(-1, dim), np.zeros((2, dim))]),
        facet_stiffness=modulus * area / length,
        bond_weight=area / length,
        bond_face=face,
    )
    if model.bond_jump is not None:
        new.bond_jump = np.zeros((len(pairs), dim))
    if model.box_bonds is not None and whole is not None:
        box = np.flatnonzero(shift.any(axis=1))
        new.box_bonds, new.box_shift = box.astype(np.int32), shift[box]
        new.strain_history = lambda t: np.asarray(whole(t)) - past
    new.inverse_shape = _inverse_shape(new, np.ones(len(pairs)))
    return new


def _add_box(model: Model, stored: list[Body]) -> None:
    """Bonds through the sides of a periodic box, and how far the images beyond move."""

    def of_bonds(value: Callable[[Body], Array]) -> Array:
        whole = model.with_halves(np.concatenate([value(b) for b in stored]), 0.0)
        if model.interface_halves is not None:
            whole[model.interface_halves[:, 0]] = whole[model.interface_bonds]
        return whole

    model.bond_jump = of_bonds(lambda b: b.shift @ b.mean_strain)
    moving = [b for b in stored if b.strain_history is not None]
    if any(not _shares_strain(b, moving[0]) for b in moving):
        raise InputError(
            "periodic bodies of a scene may have one strain that changes with time; give them the "
            "same function."
        )
    if moving:
        shift = of_bonds(lambda b: b.shift if b in moving else np.zeros_like(b.shift))
        box = np.flatnonzero(shift.any(axis=1))
        model.box_bonds, model.box_shift = box.astype(np.int32), shift[box]
        model.strain_history = moving[0].strain_history


def _elements(bodies: list[Body], dim: int) -> dict[str, Array]:
    """Arrays over the elements of all bodies, in float64."""

    def joined(value) -> Array:
        return np.concatenate([np.asarray(value(b), dtype=np.float64) for b in bodies])

    each = {
        "position": joined(lambda b: b.packing.position),
        "volume": joined(lambda b: b.packing.volume),
        "mass": joined(lambda b: b.packing.volume * b.density * b.mass_share),
        "two_shear": joined(lambda b: 2.0 * b.shear_modulus),
        "coupling": joined(lambda b: b.coupling),
        "pressure_modulus": joined(lambda b: b.pressure_modulus),
    }
    for name in (
        "held",
        "held_rotation",
        "velocity",
        "angular_velocity",
        "force",
        "torque",
        "absorbing",
    ):
        each[name] = joined(lambda b, name=name: getattr(b, name))
    radius = joined(lambda b: b.packing.radius)
    each["inertia"] = (0.5 if dim == 2 else 0.4) * each["mass"] * radius**2
    return each


class _Faces:
    """Faces of all bonds: area (b,), arm (b + 1, 2, dim) and distance (b, 2) from both centres.

    A bond without a face has area and distances 1, which nothing is divided by, and no arms.
    """

    def __init__(self, stored: list[Body], dim: int) -> None:
        bonds = sum(len(b.packing.bonds) for b in stored)
        self.area, self.distance = np.ones(bonds), np.ones((bonds, 2))
        self.arm = np.zeros((bonds + 1, 2, dim))
        at = 0
        for body in stored:
            p = body.packing
            here = slice(at, at := at + len(p.bonds))
            if p.area is not None and p.arms is not None:
                self.area[here], self.arm[here] = p.area, p.arms
                along = np.einsum("bsk,bk->bs", p.arms, p.bond_vector)
                self.distance[here] = along * [1.0, -1.0] / p.bond_length[:, None]
        self.any = any(b.packing.area is not None for b in stored)

    @property
    def is_central(self) -> bool:
        """Whether each face is in the middle of its bond."""
        size = np.abs(self.arm).max(initial=0.0)
        return bool(np.abs(self.arm.sum(axis=1)).max(initial=0.0) <= 1e-12 * size)

    @property
    def length(self) -> Array:
        """Distance of the centres, or of a centre and a node (b,)."""
        return self.distance.sum(axis=1)


def _unlike(
    stored: list[Body], pairs: NDArray[np.int64], each: dict[str, Array]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Linked facet bonds between elements of unlike stiffness (theory B4), and which may break."""
    facets = [b for b in stored if not isinstance(b.bond, EVMBond)]
    linked, breakable, heals = (
        np.concatenate([*(getattr(b, x) for b in facets), np.zeros(0, dtype=bool)])
        for x in ("linked", "breakable", "heals")
    )
    differ = np.zeros(len(pairs), dtype=bool)
    for name in ("two_shear", "coupling", "viscous"):
        x = each[name][pairs]
        differ |= np.abs(x[:, 0] - x[:, 1]) > 1e-12 * np.abs(x).max(axis=1)
    if (differ & heals).any():
        raise InputError(
            f"bonds {first_ids(differ & heals)} join unlike materials and would heal, which they "
            "cannot: leave healing out, or give the whole body one material."
        )
    parting = differ & linked & breakable
    flows = any(law is not None for b in stored for law in (*b.yielding, *b.viscous))
    if parting.any() and flows:
        raise InputError(
            f"bonds {first_ids(parting)} join unlike materials and may break; where bodies yield "
            "or creep such bonds do not break: give them an infinite strength "
            "(scene.set_strength), or leave yielding and viscous out of the scene."
        )
    nodes = np.flatnonzero(differ & linked)
    return nodes, parting[nodes]


def _put_nodes(
    unlike: NDArray[np.int64],
    parting: NDArray[np.bool_],
    pairs: NDArray[np.int64],
    facet_bonds: int,
    each: dict[str, Array],
    faces: _Faces,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Put a node on each of these faces; the new pairs, and the first bond of each node.

    A node takes the share 1/(2 z) of the mass of an element of z bonds, so that it vibrates no
    faster than elements do. It does not turn, and has no volume energy. Faces that may part keep
    their own bond beside both of the node's: it has no stiffness until they have, and then is as
    any bond that broke.
    """
    n, m = len(each["position"]), len(unlike)
    i, j = pairs[unlike].T
    share = 0.5 / np.maximum(np.bincount(pairs.ravel(), minlength=n), 1)
    given = (share * each["mass"])[pairs[unlike]]
    position = each["position"][i] + faces.arm[unlike, 0]
    mass = each["mass"] - np.bincount(pairs[unlike].ravel(), given.ravel(), minlength=n)
    own = {
        "position": position,
        "mass": given.sum(axis=1),
        "volume": np.ones(m),
        "inertia": np.ones(m),
        "held_rotation": np.ones(m),
        "velocity": 0.5 * (each["velocity"][i] + each["velocity"][j]),
    }
    each["mass"] = mass
    for name, value in each.items():
        each[name] = np.concatenate([value, own.get(name, np.zeros((m, *value.shape[1:])))])
    node = np.arange(n, n + m)
    halves = np.concatenate([np.stack([node, j], 1), np.stack([i, node], 1)[parting]])
    # arms and distances of the halves: those of the element, and none of the node
    arm = faces.arm[np.append(unlike, unlike[parting])]
    distance = faces.distance[np.append(unlike, unlike[parting])]
    arm[:m, 0], distance[:m, 0] = 0.0, 0.0
    arm[m:, 1], distance[m:, 1] = 0.0, 0.0
    whole = unlike[~parting]
    pairs[whole, 1] = node[~parting]
    faces.arm[whole, 1] = 0.0
    faces.distance[whole, 1] = 0.0
    at = [facet_bonds] * len(halves)
    area = faces.area[np.append(unlike, unlike[parting])]
    for name, value in (("area", area), ("arm", arm), ("distance", distance)):
        setattr(faces, name, np.insert(getattr(faces, name), at, value, axis=0))
    first = unlike.copy()
    first[parting] = facet_bonds + m + np.arange(parting.sum())
    return np.insert(pairs, at, halves, axis=0), first


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


def _series(value: Array, pairs: NDArray[np.int64], distance: Array) -> Array:
    """Mean of a modulus over the two parts of each bond, as springs in series; of a node the
    other's."""
    return distance.sum(axis=1) / (distance / np.where(value > 0.0, value, 1.0)[pairs]).sum(axis=1)


def _bending(model: Model, stored: list[Body], faces: _Faces) -> Array:
    """c_B = E* I/r0 and c_T = 2 G I_p/r0 [N m] of every facet (theory B9), none at nodes.

    I is that of the face's length in the plane, of a circle of its area in space.
    """
    assert model.facet_stiffness is not None
    bending = np.zeros((model.facet_bonds, 2))
    at = 0
    for body in stored:
        if isinstance(body.bond, EVMBond):
            continue
        here = slice(at, at := at + len(body.packing.bonds))
        if not body.facet_bending:
            continue
        # k S/r0 is 2 G I/r0 over I/S
        k, area = model.facet_stiffness[here], faces.area[here]
        nu = np.array([m.poisson for m in body.materials])[body.grain][body.packing.bonds].mean(1)
        if model.features.dim == 2:
            square = (area / body.packing.thickness) ** 2 / 12.0
            modulus = (1.0 + nu) if body.packing.plane == "stress" else 1.0 / (1.0 - nu)
        else:
            square = area / (4.0 * np.pi)
            modulus = 1.0 + nu
            bending[here, 1] = 2.0 * k * square
        bending[here, 0] = modulus * k * square
    if model.node_bonds is not None:
        bending[model.node_bonds] = 0.0
    if model.interface_bonds is not None:
        bending[model.interface_bonds] = 0.0
    return bending


def _add_laws(model: Model, stored: list[Body], two_shear: Array, faces: _Faces) -> None:
    facet = slice(0, model.facet_bonds)
    pairs = np.stack([model.bond_i, model.bond_j], axis=1).astype(np.int64)
    if model.facet_bonds:
        modulus = _series(two_shear, pairs[facet], faces.distance[facet])
        model.facet_stiffness = modulus * faces.area[facet] / faces.length[facet]
        if model.interface_halves is not None:
            model.point_stiffness = model.facet_stiffness[model.interface_halves[:, 0]]
        if model.features.has_bending:
            model.facet_bending = _bending(model, stored, faces)
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
        if model.features.has_evm_dashpots:
            # eta = 2 zeta sqrt(c m), m that of the two elements in series (theory A8)
            both = np.stack([model.bond_i, model.bond_j])[:, model.facet_bonds :]
            arm = model.evm_offset.T + 0.5 * model.evm_length
            mass, turning = 1.0 / model.mass[both], 1.0 / model.inertia[both]
            # across the bond an end also yields by turning
            yielding = [mass, mass + arm**2 * turning, turning, turning]
            root = np.sqrt(1.0 / np.stack([y.sum(axis=0) for y in yielding], axis=1))
            model.evm_dashpot = np.concatenate(dashpot) * root


def _add_lattice(model: Model) -> None:
    """Kinds of bonds, where they are few, and elastic EVM bonds are all that acts."""
    f, n = model.features, model.elements
    is_other = model.facet_bonds > 0 or f.has_volume or f.has_evm_dashpots or f.faces.has_slip
    if is_other or model.listed_bonds is not None or n < LEAST_LATTICE or not model.evm_bonds:
        return
    names = ("direction", "length", "offset", "stiffness")
    numbers = [getattr(model, "evm_" + name) for name in names]
    rows = np.column_stack(numbers)
    near = LIKE * np.abs(rows).max(axis=0)
    kind, firsts = np.full(len(rows), -1, dtype=np.int32), np.zeros(0, dtype=np.int64)
    left = np.arange(len(rows))
    while len(left) and len(firsts) < MOST_KINDS:
        alike = (np.abs(rows[left] - rows[left[0]]) <= near).all(axis=1)
        kind[left[alike]] = len(firsts)
        firsts = np.append(firsts, left[0])
        left = left[~alike]
    kinds = len(firsts)
    if len(left) or len(rows) < LEAST_SHARE * kinds * n:
        return
    begins, ends = kind * n + model.bond_i, kind * n + model.bond_j
    if max(np.bincount(x).max() for x in (begins, ends)) > 1:
        return
    after = np.tile(np.arange(n, dtype=np.int32), kinds)
    after[begins] = model.bond_j
    is_empty = np.ones(kinds * n, dtype=bool)
    is_empty[begins] = False
    before = np.full(kinds * n, is_empty.argmax(), dtype=np.int32)
    before[ends] = begins
    model.features = replace(f, bond_kinds=kinds)
    model.lattice_after, model.lattice_before = after.reshape(kinds, n), before.reshape(kinds, n)
    model.lattice_place = begins.astype(np.int32)
    for name, value in zip(names, numbers, strict=True):
        setattr(model, "lattice_" + name, value[firsts])


def _add_volume(model: Model, stored: list[Body], each: dict[str, Array], faces: _Faces) -> None:
    if any(b.packing.arms is None for b in stored):
        raise InputError("a scene with volume terms takes only bodies with faces.")
    acts = np.concatenate([np.full(len(b.packing.bonds), b.has_volume) for b in stored])
    acts = model.with_halves(acts, True)
    if model.interface_bonds is not None:  # their halves act
        acts[model.interface_bonds] = False
    model.bond_weight = np.where(acts, faces.area / faces.length, 0.0)
    face = np.zeros(2 * model.bonds + 2)
    face[:-2] = (np.where(acts, faces.area, 0.0)[:, None] * faces.distance).ravel()
    model.bond_face = face
    model.element_two_shear, model.element_coupling = each["two_shear"], each["coupling"]
    if (model.element_coupling < 0.0).any():
        a = volume_stiffness(model, np.append(np.ones(model.bonds), 0.0))
        bad = (model.element_coupling < 0.0) & (-a * face_reach(model) > model.element_two_shear)
        if bad.any():
            raise InputError(
                f"elements {first_ids(bad)}: with a negative Poisson's ratio the energy of these "
                "cells is not positive definite (|A| sum S |c|^2/q > 2 G V); relax the packing "
                "towards centroidal cells or raise Poisson's ratio."
            )


def _add_yielding(model: Model, bodies: list[Body]) -> None:
    """Elements by yield law, and what the laws' device form takes."""
    members: dict[YieldLaw, list[NDArray[np.int64]]] = {}
    at = 0
    for body in bodies:
        for material, law in enumerate(body.yielding):
            if law is not None:
                members.setdefault(law, []).append(at + np.flatnonzero(body.grain == material))
        at += len(body.packing)
    groups: list[Yielding] = []
    strain, stress = np.zeros(0), np.zeros(0)
    first = 0
    for law, ids in members.items():
        assert not isinstance(law.hardening, int | float)
        if isinstance(law.hardening, Table):
            hardening = float(len(strain)), float(len(law.hardening.growth)), 0.0
            strain = np.append(strain, law.hardening.plastic_strain)
            stress = np.append(stress, law.hardening.growth)
        else:
            hardening = law.hardening.numbers
        rate = (0.0, 0.0) if law.rate is None else law.rate.numbers
        flow = Flow(
            law.hardening.kind,
            "" if law.rate is None else law.rate.kind,
            isinstance(law, Nikolaevsky),
        )
        numbers = (law.yield_stress, *hardening, *rate, law.friction, law.dilatancy)
        count = sum(map(len, ids))
        groups.append(Yielding(flow, numbers, first, count))
        first += count
    flowing = np.concatenate([i for ids in members.values() for i in ids])
    if model.features.plane == "stress":
        # a slip asks for a mean stress of both its elements, also of one that never flows
        flows = np.zeros(model.elements, dtype=bool)
        flows[flowing] = True
        i, j = model.bond_i, model.bond_j
        beside = np.unique(np.concatenate([i[~flows[i] & flows[j]], j[~flows[j] & flows[i]]]))
        beside = beside[beside < model.own_elements]
        groups.append(Yielding(Flow("linear", "", False), (np.inf, *[0.0] * 7), first, len(beside)))
        flowing = np.concatenate([flowing, beside])
    model.yielding = tuple(g for g in groups if g.count)
    model.flow_elements = flowing.astype(np.int32)
    if len(strain):
        model.hardening_strain, model.hardening_stress = strain, stress


def _viscous_laws(bodies: list[Body], each: dict[str, Array]) -> list[ViscousLaw]:
    """Laws of the scene, each once; every element is given the number of its own, 0: none."""
    laws: list[ViscousLaw] = []
    each["viscous"] = np.zeros(len(each["position"]))
    at = 0
    for body in bodies:
        here = slice(at, at := at + len(body.packing))
        numbers = np.zeros(len(body.materials))
        for material in np.unique(body.grain):
            law = body.viscous[material]
            if law is not None:
                if law not in laws:
                    laws.append(law)
                numbers[material] = 1.0 + laws.index(law)
        each["viscous"][here] = numbers[body.grain]
    return laws


def _add_viscous(model: Model, laws: list[ViscousLaw], each: dict[str, Array]) -> None:
    """Laws of bonds and elements, and their numbers; a bond of a node has that of its element."""
    facet = slice(0, model.facet_bonds)
    ends = np.stack([model.bond_i, model.bond_j])[:, facet]
    model.element_law = each["viscous"].astype(np.int32)
    model.bond_law = model.element_law[ends].max(axis=0, initial=0)
    branches = model.features.branches
    model.branch_share = np.zeros((1 + len(laws), branches))
    model.branch_time = np.full((1 + len(laws), branches), np.inf)
    for row, law in enumerate(laws, 1):
        shares, times = law.series()
        model.branch_share[row, : len(shares)] = shares
        model.branch_time[row, : len(times)] = times
    model.retardation = np.array([0.0, *(law.retardation for law in laws)])
    model.retarded_elements = np.flatnonzero(model.retardation[model.element_law]).astype(np.int32)
    if model.features.has_dilation:
        model.flow_elements = np.flatnonzero(model.element_law).astype(np.int32)
    model.element_spherical = _spherical(model)
    if (each["coupling"][model.retarded_elements] < 0.0).any():
        raise InputError(
            "Kelvin and Voigt's law needs a Poisson's ratio of 0 or above; give the material "
            "one, or take a StandardLinearSolid."
        )


def _spherical(model: Model) -> Array:
    """1 - D of every element: the share of its mean stress that neither the volume term nor the
    deviator has (theory B12).

    The deviator's energy is positive if R = E H E^T/k has no eigenvalue above 1, H the moduli
    (1 - D) m/E, or for rates 2G/s*. Like elements of a packing that is not too irregular have none;
    sums of rows bound it. Where there are some, as on elements with many faces to unlike ones, the
    share is less.
    """
    from scipy.sparse import csr_matrix, diags
    from scipy.sparse.linalg import eigsh

    assert model.element_coupling is not None and model.facet_stiffness is not None
    assert model.bond_weight is not None and model.bond_law is not None
    assert model.element_two_shear is not None and model.element_law is not None
    assert model.retardation is not None
    n, creeps = model.elements, np.flatnonzero(model.bond_law)
    i, j = model.bond_i[creeps], model.bond_j[creeps]
    arm = bond_ends(model)[creeps]
    linked = np.append(np.ones(model.bonds), 0.0)
    share = 1.0 - model.element_coupling
    each = model.bond_weight[creeps] ** 2 / model.facet_stiffness[creeps]
    own = each[:, None] * (arm**2).sum(axis=2)
    both = -each * (arm[:, 0] * arm[:, 1]).sum(axis=1)
    rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
    value = np.concatenate([own[:, 0], own[:, 1], both, both])
    matrix = csr_matrix((value, (rows, columns)), shape=(n, n))
    rates = model.retardation[model.element_law] > 0.0
    modulus = share * mean_stiffness(model, linked)
    modulus[rates] = model.element_two_shear[rates] / face_sum(model, linked)[rates]
    scale = modulus / model.element_volume
    if model.features.plane == "strain":  # and of a spring across the plane
        stiff = np.where(model.element_two_shear > 0.0, model.element_two_shear, np.inf)
        matrix += diags(np.where(rates, 0.0, model.element_volume / stiff))
    bound = abs(matrix).sum(axis=1).A1 * scale
    if bound.max() <= 1.0 + 1e-9:
        return share
    root = np.sqrt(scale)
    if n > 3:
        even = diags(root) @ matrix @ diags(root)
        start = np.random.default_rng(0).normal(size=n)
        if eigsh(even, k=1, which="LA", v0=start, tol=1e-4, return_eigenvectors=False) < 1 + 1e-6:
            return share
    bad = bound > 1.0 / LEAST_SPHERICAL
    if bad.any():
        raise InputError(
            f"the cells of elements {first_ids(bad)} are too irregular for a viscous law: the "
            "energy of their deviators is not positive (theory B12); relax the packing towards "
            "centroidal cells, one sweep is enough."
        )
    return share / np.maximum(bound, 1.0)


def _add_lists(
    model: Model,
    stored: list[Body],
    unlinked: list[NDArray[np.bool_]],
    pressure_modulus: Array,
    faces: _Faces,
) -> None:
    pairs = np.stack([model.bond_i, model.bond_j], axis=1).astype(np.int64)
    listed: list[NDArray[np.int64]] = []
    strength: list[Array] = []
    closing: list[Array] = []
    groups: list[Group] = []
    at = first = 0
    facet_bodies = [b for b in stored if not isinstance(b.bond, EVMBond)]
    ends: list[Array] = []
    healing: list[HealingGroup] = []
    share: list[Array] = []
    for body, mask in zip(stored, unlinked, strict=True):
        cut = np.flatnonzero(mask & ~body.breakable)
        start = first
        for law, ids, is_interface in _by_criterion(model, body, at):
            groups.append(_group(law, first, len(ids), is_interface))
            strength.append(criterion_of(law).strength * body.strength_factor[ids])
            ends.append(np.ones(len(ids)))
            if isinstance(law, LinearSoftening):
                ends[-1] = _softening_end(body, law, ids, faces.distance[ids + at])
            listed.append(ids + at)
            first += len(ids)
        strength.append(np.full(len(cut), np.inf))
        ends.append(np.ones(len(cut)))
        listed.append(cut + at)
        first += len(cut)
        count = first - start
        share.append(np.full(count, 1.0 if body.healing is None else body.healing.strength))
        if body.healing is not None and count:
            healing.append(HealingGroup(body.healing, start, count))
        ids = np.concatenate(listed)[start:]
        if isinstance(body.bond, EVMBond):
            assert model.evm_stiffness is not None
            closing.append(model.evm_stiffness[ids - model.facet_bonds, 0])
        else:
            modulus = _series(pressure_modulus, pairs[ids], faces.distance[ids])
            closing.append(modulus * (faces.area / faces.length)[ids])
        at += len(mask)
        if not isinstance(body.bond, EVMBond):
            model.facet_listed = first
            if body is facet_bodies[-1]:
                at += model.facet_bonds - model.own_facets  # bonds of nodes
                if model.interface_halves is not None:  # which part as the faces do
                    halves = np.sort(model.interface_halves.ravel()).astype(np.int64)
                    listed.append(halves)
                    for parts, value in ((strength, np.inf), (closing, 0.0), (ends, 1.0)):
                        parts.append(np.full(len(halves), value))
                    share.append(np.ones(len(halves)))
                    first += len(halves)
    model.listed_bonds = np.concatenate(listed).astype(np.int32)
    model.closing_stiffness = np.concatenate(closing)
    if model.interface_halves is not None:
        _add_interfaces(model)
    touched = np.stack([model.bond_i, model.bond_j])[:, model.listed_bonds]
    model.listed_elements = np.unique(touched).astype(np.int32)
    if healing:
        model.healing = tuple(healing)
        facets = model.listed_bonds[: model.facet_listed]
        assert model.facet_stiffness is not None
        model.healing_stiffness = model.facet_stiffness[facets]
        if model.bond_weight is not None:
            model.healing_weight = model.bond_weight[facets]
        if groups:
            model.healing_strength = np.concatenate(share) * np.concatenate(strength)
    if groups:
        model.criteria = tuple(groups)
        model.bond_strength = np.concatenate(strength)
        if any(group.test.softens for group in groups):
            model.softening_end = np.concatenate(ends)


def _add_contact(model: Model, scene: Scene, each: dict[str, Array]) -> None:
    """Elements that may touch: all of several bodies; of one, those with a free surface or with
    bonds that are or may be unlinked. Pairs that bonds join do not."""
    bodies, own = scene.bodies, model.own_elements
    is_periodic = any(b.packing.period is not None for b in bodies)
    if is_periodic:
        _check_box(scene)
    if model.features.finite_strain:
        raise InputError(
            "contact is not for bodies at finite strain, whose stress does not count it; leave "
            "finite_strain or contact out, or hold the face that would touch."
        )
    may_touch = np.concatenate([has_free_surface(b.packing) for b in bodies])
    may_touch |= len(bodies) > 1
    starts = dict(
        zip(map(id, bodies), np.cumsum([0, *(len(b.packing) for b in bodies)]), strict=False)
    )
    for body in bodies:
        may_touch[body.packing.bonds[~body.linked | body.breakable] + starts[id(body)]] = True
    elements = np.flatnonzero(may_touch)
    assert scene.contacts is not None
    if not len(elements):  # whole periodic bodies have no surface
        return
    model.contact, model.walls = scene.contacts, tuple(scene.walls)
    model.contact_elements = elements.astype(np.int32)
    radius = np.ones(model.elements)
    radius[:own] = np.concatenate([touching_radius(b.packing) for b in bodies])
    width = np.concatenate([np.full(len(b.packing), b.packing.thickness) for b in bodies])
    model.contact_radius = radius
    model.contact_width = np.append(width, np.ones(model.nodes))
    for name, modulus in (("compliance", "pressure_modulus"), ("shear", "two_shear")):
        stiff = np.where(each[modulus] > 0.0, each[modulus], 1.0)
        setattr(model, "contact_" + name, radius / stiff)
    if model.contact is not None and model.contact.is_hertz:
        if model.features.dim == 2:
            raise InputError(
                "Hertz's law is of spheres: in the plane the approach of two discs depends on what "
                "surrounds them, so that there is no law of a pair; take law='linear'."
            )
        yielded = [
            np.array([(1.0 - m.poisson**2) / m.young for m in b.materials])[b.grain]
            / b.stiffness_factor
            for b in bodies
        ]
        model.contact_compliance = np.append(np.concatenate(yielded), np.ones(model.nodes))
    if model.features.dim == 2 and any(x.twisting_friction > 0.0 for x in model._sides):
        raise InputError("in the plane nothing twists; leave twisting_friction out.")
    if model.contact.welding is not None:
        _check_welding(model)
    low, high = model.position[:own].min(axis=0), model.position[:own].max(axis=0)
    model.contact_middle = 0.5 * (low + high)
    model.contact_position = model.position - model.contact_middle
    laws = _friction_laws(model, bodies)
    if any(isinstance(law, RateAndState) for law in laws):
        if model.contact.welding is not None:
            raise InputError(
                "welding is for Coulomb's friction: leave RateAndState out, of pairs and walls, or "
                "welding."
            )
        model.friction_numbers = np.array([numbers(law) for law in laws])
    if model.faces_rub:
        model.closing_shear = _closing_shear(model, each)
    model.bonded_start, model.bonded, which = bonded_rows(model.own_pairs, elements, own)
    if model.listed_bonds is not None:
        place = np.full(model.bonds, -1, dtype=np.int32)
        place[model.listed_bonds] = np.arange(len(model.listed_bonds))
        model.bonded_listed = place[model.own_bonds[which]]
    if is_periodic:
        body = bodies[0]
        assert body.packing.period is not None
        model.contact_period, model.contact_strain = body.packing.period, body.mean_strain
        if model.listed_bonds is not None:
            shift = np.concatenate([b.shift for b in in_bond_order(bodies)])
            whole = np.zeros((model.bonds, model.features.dim))
            whole[model.own_bonds] = shift
            image = np.rint(whole[model.listed_bonds] / body.packing.period)
            model.listed_image = image.astype(np.int32)
    if model.walls:
        _add_walls(model)
        width = np.pi * radius if model.features.dim == 3 else 2.0 * model.contact_width
        density = model.mass / model.element_volume
        impedance = radius * width * np.sqrt(density * each["pressure_modulus"])
        model.contact_impedance = float(impedance[elements].sum())


def _friction_laws(model: Model, bodies: list[Body]) -> list[Friction]:
    """Laws of all pairs of kinds of elements, then of each wall with each kind. A scene that tells
    no materials apart has one kind."""
    contact, walls = model.contact, model.walls
    assert contact is not None
    if not contact.pairs and not any(w.pairs for w in walls):
        return [contact.friction, *(w.friction for w in walls)]
    kinds: list[Material] = list(dict.fromkeys(m for b in bodies for m in b.materials))
    for side in (
        *(m for pair in contact.pairs for m in pair),
        *(m for w in walls for m in w.pairs),
    ):
        if side not in kinds:
            raise InputError(f"friction is given for {side}, which no body is of.")
    kind = [np.array([kinds.index(m) for m in b.materials])[b.grain] for b in bodies]
    model.contact_kind = np.append(np.concatenate(kind), np.zeros(model.nodes)).astype(np.int32)
    model.kinds = len(kinds)
    laws = [contact.pairs.get(frozenset((a, b)), contact.friction) for a in kinds for b in kinds]
    laws += [w.pairs.get(m, w.friction) for w in walls for m in kinds]
    model.friction_table = np.array([coulomb(law) for law in laws])
    return laws


def _closing_shear(model: Model, each: dict[str, Array]) -> Array:
    """Stiffness along the faces of listed bonds [N/m]: k of facet bonds; of EVM bonds, which may
    have none across, B1 2 G/(lambda + 2 G), as of elements that touch."""
    assert model.listed_bonds is not None and model.closing_stiffness is not None
    shear = model.closing_stiffness.copy()
    facets = model.listed_bonds[: model.facet_listed]
    if model.facet_stiffness is not None:
        shear[: model.facet_listed] = model.facet_stiffness[facets]
    beams = model.listed_bonds[model.first_beam :]
    both = np.stack([model.bond_i, model.bond_j])[:, beams]
    give = [(1.0 / each[x][both]).sum(axis=0) for x in ("pressure_modulus", "two_shear")]
    shear[model.first_beam :] *= give[0] / give[1]
    return shear


def _check_welding(model: Model) -> None:
    """Refuse welds that would leave the list of neighbours before they break."""
    contact, ids = model.contact, model.contact_elements
    assert contact is not None and contact.welding is not None and ids is not None
    assert model.contact_compliance is not None and model.contact_radius is not None
    stretch = 2.0 * contact.welding.strength * float(model.contact_compliance[ids].max())
    skin = contact.skin * float(np.median(model.contact_radius[ids]))
    if stretch > 0.5 * skin:
        raise InputError(
            f"welds of this strength stretch by up to {stretch:.3g} m before they break, more than "
            f"half the skin of the list of neighbours, {skin:.3g} m: give a strength below "
            f"{0.5 * skin / stretch * contact.welding.strength:.3g} Pa, or a greater skin."
        )


def _check_box(scene: Scene) -> None:
    """Refuse bodies that touch in different periodic boxes, or a wall across one."""
    first = scene.bodies[0]
    for body in scene.bodies:
        periods = first.packing.period, body.packing.period
        if any(p is None for p in periods) or not np.array_equal(*periods):  # type: ignore[arg-type]
            raise InputError(
                "bodies that touch in a periodic box share its period; give all packings the same."
            )
        if not _shares_strain(body, first):
            raise InputError(
                "bodies that touch in a periodic box share its strain; strain all of them alike."
            )
    if scene.walls:
        raise InputError("walls would cut a periodic box; leave out the walls or the period.")
    assert first.packing.period is not None
    if not np.isfinite(first.packing.period).all():
        raise InputError(
            "bodies that repeat along some axes alone have no contact: give packings that repeat "
            "along all axes or none, or leave scene.contact out."
        )


def _shares_strain(body: Body, other: Body) -> bool:
    """Whether the boxes of two periodic bodies are strained alike."""
    same = getattr(body.strain_history, "__wrapped__", None) is getattr(
        other.strain_history, "__wrapped__", None
    )
    return same and np.array_equal(body.mean_strain, other.mean_strain)


def _add_walls(model: Model) -> None:
    """Walls' shapes as the device knows them."""
    walls, dim = model.walls, model.features.dim
    model.wall_friction = np.array([coulomb(w.friction) for w in walls])
    if model.rolls:
        model.wall_rolling = np.array([w.rolling_friction for w in walls])
        model.wall_twisting = np.array([w.twisting_friction for w in walls])
    model.wall_kind = np.zeros(len(walls), dtype=np.int32)
    model.wall_shape = np.zeros((len(walls), SHAPE_NUMBERS))
    first, corners = np.zeros(len(walls), dtype=np.int32), [np.zeros((0, 3))]
    for w, shape in enumerate(wall.shape for wall in walls):
        row = model.wall_shape[w]
        if isinstance(shape, Sphere | Cylinder):
            row[3:6] = shape.radius, FAR, -1.0 if shape.hollow else 1.0
        if isinstance(shape, Plane):
            kind, row[:dim] = PLANE, shape.normal
        elif isinstance(shape, Sphere):
            kind = SPHERE
        elif isinstance(shape, Cylinder):
            kind, row[:3], row[4] = CYLINDER, shape.axis, min(0.5 * shape.length, FAR)
        elif isinstance(shape, Box):
            kind, row[:dim], row[3] = BOX, 0.5 * shape.size, shape.rounding
        else:
            kind = MESH
            first[w] = sum(map(len, corners)) // 3
            corners.append((shape.vertices - shape.place)[shape.faces].reshape(-1, 3))
        model.wall_kind[w] = kind
    if len(corners) > 1:
        model.wall_first_face, model.face_place = first, np.concatenate(corners)


def _by_criterion(
    model: Model, body: Body, at: int
) -> Iterator[tuple[Fracture, NDArray[np.int64], bool]]:
    """Bonds of a body that may break, criterion after criterion, those of unlike elements apart;
    at: where the body's bonds are stored."""
    is_interface = np.zeros(len(body.linked), dtype=bool)
    if model.interface_bonds is not None:
        here = model.interface_bonds - at
        is_interface[here[(here >= 0) & (here < len(is_interface))]] = True
    for row, law in enumerate(body.fractures):
        for apart in (False, True):
            mask = body.breakable & (body.fracture_law == row) & (is_interface == apart)
            if mask.any():
                yield law, np.flatnonzero(mask), apart


def _add_interfaces(model: Model) -> None:
    """Where the halves of the faces between unlike elements have their forces: of listed bonds."""
    assert model.listed_bonds is not None and model.interface_bonds is not None
    assert model.interface_halves is not None
    place = np.zeros((len(model.listed_bonds), 2), dtype=np.int32)
    place[model.rows_of(model.interface_bonds)] = model.bond_place[2 * model.interface_halves]
    model.interface_place = place.ravel()


def _group(fracture: Fracture, first: int, count: int, is_interface: bool) -> Group:
    """Bonds of one criterion and the device's form of what breaks them."""
    criterion = criterion_of(fracture)
    function = criterion.function if isinstance(criterion, CustomCriterion) else None
    damage, rate = "", (0.0, 0.0)
    if isinstance(fracture, Incubation | DamageRate):
        damage, rate = fracture.damage, fracture.rate
    softens = isinstance(fracture, LinearSoftening)
    test = Test(criterion.kind, function, damage, softens, is_interface)
    given = tuple(criterion.numbers)
    return Group(test, (*given, *[0.0] * (NUMBERS - len(given))), rate, first, count)


def _softening_end(
    body: Body, fracture: LinearSoftening, ids: NDArray[np.int64], distance: Array
) -> Array:
    """Ratio of the elastic stress to the strength at which softening bonds have no stress left.

    2 G_c/s_t over the opening s_t h/(lambda + 2G) at the strength s_t, h being the height of the
    layer of bonds that a crack breaks: r0 times the mean cosine of their inclination. distance: of
    their faces from both centres, (b, 2).
    """
    p = body.packing
    strength = fracture.criterion.tension * body.strength_factor[ids]
    modulus = _series(body.pressure_modulus, p.bonds[ids], distance)
    height = p.bond_length[ids] * p.flatness
    end = 2.0 * fracture.fracture_energy * modulus / (strength**2 * height)
    bad = np.zeros(len(body.linked), dtype=bool)
    bad[ids] = end <= 1.0
    if bad.any():
        worst = float(end.min())
        raise InputError(
            f"bonds {first_ids(bad)} are too long to soften over this fracture energy: they would "
            f"snap. Take a spacing below {worst:.3g} of this one, a greater fracture energy or a "
            "lower strength."
        )
    return end

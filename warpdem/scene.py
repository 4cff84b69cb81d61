"""What the user says: bodies and how their elements are bonded, cut, held, strained and loaded."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .bond import EVMBond
from .contact import Contact
from .criteria import (
    BeamLimit,
    Fracture,
    LinearSoftening,
    PlasticStrainLimit,
    criterion_of,
    weaker,
)
from .errors import (
    Array,
    InputError,
    ModelWarning,
    checked,
    entries,
    finite,
    first_ids,
    first_value,
    not_negative,
    one_of,
    positive,
    whole_number,
)
from .friction import Friction, RateAndState, checked_friction, checked_pairs
from .material import Material
from .packing import Mask, Packing
from .plasticity import Nikolaevsky, VonMises, YieldLaw, softening
from .relinking import Healing, Welding
from .toughness import Toughness, local_spacing
from .viscoelasticity import ViscousLaw
from .wall import Cylinder, Mesh, Path, Plane, Shape, Steering, Wall

Breaking = Fracture | Toughness | None  # by what bonds break
LEAST_DASHPOT = 0.01  # restitution that dashpots of contacts give
History = Callable[[float], float]  # factor at a time [s]
StrainHistory = Callable[[float], ArrayLike]  # strain (dim, dim) at a time [s]


@dataclass(eq=False)
class TimedLoad:
    """A load that changes with time: forces (n, dim) [N] and torques [N m] times history(t)."""

    history: History
    force: Array
    torque: Array


@dataclass(eq=False)
class Body:
    """One packing in a scene, with what was said about it. Made by `Scene.add`."""

    packing: Packing
    materials: tuple[Material, ...]
    grain: NDArray[np.int64]  # (n,) which of the materials an element is of
    bond: str | EVMBond
    fractures: tuple[Fracture, ...]  # criteria, each once
    fracture_law: NDArray[np.int64]  # (b,) which of them a bond breaks by, or -1
    has_volume: bool
    facet_bending: bool
    yielding: tuple[YieldLaw | None, ...]  # of each material
    viscous: tuple[ViscousLaw | None, ...]  # likewise
    finite_strain: bool = False
    renew_faces: float | None = None  # slip over length beyond which faces are renewed
    healing: Healing | None = None
    linked: Mask = field(init=False)
    stiffness_factor: Array = field(init=False)
    strength_factor: Array = field(init=False)
    mean_strain: Array = field(init=False)  # (dim, dim) of a periodic box at the start
    strain_history: StrainHistory | None = field(init=False)
    displacement: Array = field(init=False)
    velocity: Array = field(init=False)
    angular_velocity: Array = field(init=False)
    force: Array = field(init=False)
    torque: Array = field(init=False)
    timed_loads: list[TimedLoad] = field(init=False)
    grip: NDArray[np.int64] = field(init=False)  # (n,) which history held motion follows, or 0
    mass_share: Array = field(init=False)
    absorbing: Array = field(init=False)  # (n, dim, dim) force over velocity [N s/m]
    held: Mask = field(init=False)
    held_rotation: Mask = field(init=False)

    def __post_init__(self) -> None:
        n, dim = self.packing.position.shape
        bonds = len(self.packing.bonds)
        self.linked = np.ones(bonds, dtype=bool)
        self.stiffness_factor = np.ones(n)
        self.strength_factor = np.ones(bonds)
        self.mean_strain = np.zeros((dim, dim))
        self.strain_history = None
        self.displacement = np.zeros((n, dim))
        self.velocity = np.zeros((n, dim))
        self.angular_velocity = np.zeros((n, 1 if dim == 2 else 3))
        self.force = np.zeros((n, dim))
        self.torque = np.zeros_like(self.angular_velocity)
        self.timed_loads = []
        self.grip = np.zeros(n, dtype=np.int64)
        self.mass_share = np.ones(n)
        self.absorbing = np.zeros((n, dim, dim))
        self.held = np.zeros((n, dim), dtype=bool)
        self.held_rotation = np.zeros(n, dtype=bool)

    @property
    def density(self) -> Array:
        """Density of every element [kg/m^3], (n,)."""
        return np.array([m.density for m in self.materials])[self.grain]

    @property
    def shear_modulus(self) -> Array:
        """G of every element [Pa], (n,)."""
        return (
            self.stiffness_factor * np.array([m.shear_modulus for m in self.materials])[self.grain]
        )

    @property
    def coupling(self) -> Array:
        """D = 3 nu/(1 + nu) of every element, 0 where no volume term acts, (n,)."""
        return self.has_volume * np.array([m.coupling for m in self.materials])[self.grain]

    @property
    def pressure_modulus(self) -> Array:
        """lambda + 2 G of every element [Pa], (n,)."""
        plane = self.packing.plane
        each = [m.lame(plane) + 2.0 * m.shear_modulus for m in self.materials]
        return self.stiffness_factor * np.array(each)[self.grain]

    @property
    def shift(self) -> Array:
        """From every bond's second element to the image of it that is bonded [m], (b, dim)."""
        x, (i, j) = self.packing.position, self.packing.bonds.T
        shift = self.packing.bond_vector - (x[j] - x[i])
        return np.where(np.abs(shift) > 1e-9 * self.packing.spacing, shift, 0.0)

    @property
    def breakable(self) -> Mask:
        """Bonds that may break, (b,)."""
        may = (self.fracture_law >= 0) & np.isfinite(self.strength_factor)
        return may & (self.linked | self.heals)

    @property
    def heals(self) -> Mask:
        """Bonds that are linked again by a law of healing, once they are unlinked, (b,)."""
        return np.full(len(self.linked), self.healing is not None)


@dataclass(eq=False)
class Servo:
    """A gripped side that moves so that its mean traction follows a wanted one.

    Made by `Scene.servo`; while a simulation runs, `measured` [Pa] is the traction it last saw.
    """

    body: Body
    ids: NDArray[np.int64]
    axis: int
    outward: float
    area: float
    traction: float
    history: History
    grip: int
    speed: float
    impedance: float
    measured: float = 0.0

    def wanted(self, time: float) -> float:
        """Traction to be held at a time [s], [Pa]."""
        return self.traction * self.history(time)


class Scene:
    """Bodies and loads, from which a Simulation is made."""

    def __init__(self) -> None:
        self.bodies: list[Body] = []
        self.grip_histories: list[History] = [_always]
        self.servos: list[Servo] = []
        self.gravity: Array | None = None
        self.contacts: Contact | None = None
        self.walls: list[Wall] = []

    @checked
    def add(
        self,
        packing: Packing,
        material: Material | Sequence[Material],
        bond: str | EVMBond = "facet",
        fracture: Breaking | Sequence[Breaking] = None,
        volume: bool | None = None,
        grain: ArrayLike | None = None,
        facet_bending: bool = False,
        yielding: YieldLaw | Sequence[YieldLaw | None] | None = None,
        viscous: ViscousLaw | Sequence[ViscousLaw | None] | None = None,
        finite_strain: bool = False,
        renew_faces: float | None = None,
        healing: Healing | None = None,
        pairs: Mapping[tuple[Material, Material], Breaking] | None = None,
    ) -> Body:
        """Add a body.

        material: one, or several with grain (n,): which of them each element is of, from 0. Where
        unlike elements meet, a face has a displacement of its own (theory B4).
        bond: "facet" (the pair part of the second paper; needs a packing with faces) or an EVMBond.
        fracture: the criterion by which its bonds break, or a Toughness from which its strength
        follows, or one for each material; None: none ever breaks. A bond between two materials
        breaks by the weaker of both criteria.
        pairs: other criteria of bonds between two materials, in either order, or between like ones
        that are given twice.
        volume: whether the many-body volume term acts; by default where facet bonds need it
        (Poisson's ratio other than 0). On EVM bonds with faces it gives the hybrid of both papers.
        facet_bending: faces also resist bending and twist (theory B9), which cures gear modes.
        yielding: the law by which elements flow, or one (or None) for each material; None: elastic.
        viscous: the law by which shear stress relaxes (theory B12), or one (or None) for each
        material; None: elastic. Of branches (Prony, Maxwell, StandardLinearSolid) the material's
        moduli are the instantaneous ones, of KelvinVoigt those of the spring.
        finite_strain: volumes, stresses and flow follow the elements' deformation gradients, for
        plastic strains beyond a few per cent (theory B6); of all bodies of a scene or of none.
        renew_faces: with finite_strain and a yield law, the slip of a bond over its length, usually
        0.3, beyond which all faces of the body are made anew from the places that its elements
        then have (theory B6); None: faces stay those between the first neighbours.
        healing: the law by which its unlinked bonds, broken or cut, are linked again (theory B11).
        """
        materials: tuple[Material, ...] = (
            tuple(material) if isinstance(material, Sequence) else (material,)
        )
        if (
            not isinstance(packing, Packing)
            or not materials
            or not all(isinstance(m, Material) for m in materials)
        ):
            raise InputError("scene.add takes a Packing and a Material, or several.")
        grains = _grains(packing, materials, grain)
        if packing.period is not None and isinstance(bond, EVMBond):
            raise InputError(
                "periodic bodies take facet bonds; with EVM bonds such a packing is for calibrate."
            )
        faces = packing.area is not None
        if isinstance(bond, EVMBond):
            has_volume = bool(volume)
            if bond.plane_only and packing.dim == 3:
                raise InputError(
                    "this bond's section bends differently about its two axes; an EVM bond has one "
                    "bending stiffness. In space take a circle, a tube or a square, or several "
                    "bonds side by side; in the plane any rectangle will do."
                )
        elif isinstance(bond, str) and bond == "facet":
            if not faces:
                raise InputError("facet bonds need a packing with faces; this one has none.")
            has_volume = any(m.poisson != 0.0 for m in materials) and volume is not False
        else:
            raise InputError(f"bond is {bond!r}; give 'facet' or an EVMBond.")
        if not faces and has_volume:
            raise InputError("the volume term needs a packing with faces.")
        if len(packing.bonds) == 0 and len(packing) > 1:
            raise InputError("the packing has no bonds; its elements would fly apart unbound.")
        for other in self.bodies:
            if (other.packing.dim, other.packing.plane) != (packing.dim, packing.plane):
                raise InputError(
                    "all bodies of a scene share the dimension and the plane state: one is "
                    f"{_space(other.packing)}, this one is {_space(packing)}."
                )
        _tell(packing, bond, facet_bending)
        if facet_bending and bond != "facet":
            raise InputError("facet_bending is of facet bonds; EVM bonds have their own bending.")
        laws = _yield_laws(packing, materials, bond, volume, yielding)
        creep = _viscous_laws(materials, bond, volume, viscous)
        for other in self.bodies:
            _no_mixture((*laws, *other.yielding), (*creep, *other.viscous))
        _no_mixture(laws, creep)
        fractures, which, is_tough = _fractures(packing, materials, grains, bond, fracture, pairs)
        for criterion in fractures:
            _check_fracture(packing, bond, laws, creep, criterion)
        has_volume |= any(law is not None for law in (*laws, *creep))
        if healing is not None:
            _check_healing(bond, fractures, facet_bending, finite_strain, healing)
        if finite_strain:
            _check_finite(materials, bond, fractures, volume, laws, creep)
            has_volume = True
        if renew_faces is not None:
            _check_renewal(packing, finite_strain, laws, facet_bending, renew_faces)
        body = Body(
            packing, materials, grains, bond, fractures, which, has_volume, facet_bending, laws,
            creep, finite_strain, renew_faces, healing,
        )  # fmt: skip
        if is_tough.any():
            size = np.sqrt(packing.spacing / local_spacing(packing))
            body.strength_factor[is_tough] *= size[is_tough]
        self.bodies.append(body)
        return body

    @checked
    def cut(
        self, body: Body, start: ArrayLike, end: ArrayLike, depth: ArrayLike | None = None
    ) -> NDArray[np.int64]:
        """Unlink the bonds that cross a segment [m] (see `Packing.crossing`); return their ids."""
        ids = self._crossing(body, start, end, depth)
        body.linked[ids] = False
        return ids

    def scale_stiffness(self, body: Body, factor: ArrayLike) -> None:
        """Multiply the elastic moduli of elements by a factor, a number or (n,), as scatter does.

        Poisson's ratio stays. Of EVM bonds it scales the volume term only: their stiffnesses are
        their own.
        """
        self._own(body)
        f = positive("factor", factor)
        if f.shape not in ((), (len(body.packing),)):
            raise InputError(
                f"factor has shape {f.shape}; give a number or ({len(body.packing)},)."
            )
        body.stiffness_factor *= f

    @checked
    def set_strength(
        self,
        body: Body,
        factor: float,
        start: ArrayLike | None = None,
        end: ArrayLike | None = None,
        depth: ArrayLike | None = None,
    ) -> None:
        """Set the strength of bonds to `factor` times the criterion's.

        Of the bonds that cross the segment from start to end [m], or of the whole body. A factor of
        infinity makes them unbreakable, and no time is spent on testing them.
        """
        self._own(body)
        if not factor > 0.0:
            raise InputError(f"the strength factor is {factor}; it must be greater than zero.")
        if not body.fractures:
            raise InputError("this body has no fracture criterion to scale; give one to scene.add.")
        if (start is None) != (end is None):
            raise InputError("give both start and end of the segment, or neither.")
        if start is None or end is None:
            body.strength_factor[:] = factor
        else:
            body.strength_factor[self._crossing(body, start, end, depth)] = factor

    @checked
    def scatter_strength(self, body: Body, modulus: float, seed: int = 0, by: str = "bond") -> None:
        """Multiply the strengths of bonds by random factors of Weibull's distribution.

        modulus: m; the criterion's strength is that which 1 - 1/e of them do not reach. by: "bond"
        draws a factor for every bond, "element" one for every element, of which a bond has the
        lesser of both. The same seed draws the same factors.
        """
        self._own(body)
        positive("modulus", modulus, ())
        one_of("by", by, ("bond", "element"))
        if not body.fractures:
            raise InputError("this body has no fracture criterion to scatter; give one first.")
        rng = np.random.default_rng(whole_number("seed", seed))
        if by == "bond":
            factor = rng.weibull(modulus, len(body.packing.bonds))
        else:
            factor = rng.weibull(modulus, len(body.packing))[body.packing.bonds].min(axis=1)
        # a strength of 0 would break at once and for no load
        body.strength_factor *= np.maximum(factor, 1e-6)

    @checked
    def strain(
        self, body: Body, strain: ArrayLike | StrainHistory, origin: ArrayLike | None = None
    ) -> None:
        """Start the body from a uniform strain: displacement = strain . (position - origin).

        strain: symmetric, shape (dim, dim), a small strain; origin [m]: the point that stays, by
        default the body's centre. A periodic body keeps its mean strain, or follows a function of
        time [s] that gives it (start its elements with the velocities of that, by set_velocity).
        """
        self._own(body)
        dim = body.packing.dim
        if not callable(strain):
            e = _strain(strain, dim)
        elif body.packing.period is None:
            raise InputError("only the strain of a periodic body is a function of time.")
        else:
            history = strain

            @wraps(history)
            def at(time: float) -> Array:
                return _strain(history(time), dim)

            e = _strain(first_value("strain", history), dim)
            body.strain_history = at
        x = body.packing.position
        low, high = x.min(axis=0), x.max(axis=0)
        centre = 0.5 * (low + high) if origin is None else finite("origin", origin, (x.shape[1],))
        body.displacement[:] = (x - centre) @ e
        body.mean_strain[:] = e

    @checked
    def hold(
        self,
        body: Body,
        where: ArrayLike,
        velocity: ArrayLike | None = None,
        axes: str | None = None,
        rotation: bool = True,
        angular_velocity: ArrayLike | None = None,
        history: History | tuple[ArrayLike, ArrayLike] | None = None,
    ) -> None:
        """Grip elements: they keep still, or move at a velocity [m/s], (dim,) or one a row.

        where: mask or ids; axes: which of "xyz" are held (default: all; "" for none); rotation:
        whether turning is held as well, still or at an angular_velocity [rad/s]. history: a
        function of time [s], or (times, values) between which is interpolated, that both
        velocities are multiplied by.
        """
        ids = self._selected(body, where)
        dim = body.packing.dim
        names = "xyz"[:dim]
        chosen = names if axes is None else axes
        if set(chosen) - set(names) or not (chosen or rotation):
            raise InputError(f"axes is {axes!r}; choose from {names!r}.")
        v = np.zeros(dim) if velocity is None else finite("velocity", velocity)
        if v.shape not in ((dim,), (len(ids), dim)):
            raise InputError(f"velocity has shape {v.shape}; give ({dim},) or ({len(ids)}, {dim}).")
        for axis in (names.index(c) for c in chosen):
            body.held[ids, axis] = True
            body.velocity[ids, axis] = v[..., axis]
        if angular_velocity is not None and not rotation:
            raise InputError("an angular velocity needs turning to be held; leave rotation=True.")
        if rotation:
            spins = body.angular_velocity.shape[1]
            w = np.zeros(spins) if angular_velocity is None else np.atleast_1d(angular_velocity)
            w = finite("angular_velocity", w, (spins,))
            body.held_rotation[ids] = True
            body.angular_velocity[ids] = w
        if history is not None:
            body.grip[ids] = len(self.grip_histories)
            self.grip_histories.append(_history(history))

    @checked
    def pull(
        self,
        body: Body,
        where: ArrayLike,
        traction: ArrayLike,
        history: History | tuple[ArrayLike, ArrayLike] | None = None,
    ) -> None:
        """Load a side with a traction [Pa], shape (dim,), that keeps its direction.

        It acts on the free surface of the chosen elements, projected on their common side.
        history: as of `hold`; by default constant.
        """
        ids, area, _ = self._surface(body, where)
        t = finite("traction", traction, (body.packing.dim,))
        self._add_load(body, ids, area[:, None] * t, None, history)

    @checked
    def press(
        self,
        body: Body,
        where: ArrayLike,
        pressure: float,
        axes: str | None = None,
        history: History | tuple[ArrayLike, ArrayLike] | None = None,
    ) -> None:
        """Press on all free surface of the chosen elements with a pressure [Pa], inwards if > 0.

        Each element is pressed along its own exposed area as it is in the reference state, at the
        middle of its free faces: a dead load, as of `pull`, on a surface of any shape. axes: which
        of "xyz" the pressure has components along (default: all); history: as of `hold`; by default
        constant.
        """
        ids = self._selected(body, where)
        p = float(finite("pressure", pressure, ()))
        area = body.packing.exposed_area
        bare = np.linalg.norm(area[ids], axis=1) > 1e-9 * np.linalg.norm(area, axis=1).max()
        if not bare.any():
            raise InputError("the chosen elements have no free surface to press on.")
        names = "xyz"[: body.packing.dim]
        if axes is not None and (not axes or set(axes) - set(names)):
            raise InputError(f"axes is {axes!r}; choose from {names!r}.")
        acts = np.array([axes is None or name in axes for name in names])
        ids = ids[bare]
        torque = -p * body.packing.exposed_moment[ids]
        self._add_load(body, ids, -p * area[ids] * acts, torque, history)

    def absorb(self, body: Body, where: ArrayLike) -> None:
        """Let waves leave through the free surface of these elements, as if the solid went on.

        Dashpots rho c_P across and rho c_S along the surface (Lysmer and Kuhlemeyer 1969): exact
        for waves that meet it at a right angle; of others a part comes back. Of these elements the
        half of the mass that lies outwards of the centre is left out.
        """
        ids = self._selected(body, where)
        vector = body.packing.exposed_area[ids]
        total, size = vector.sum(axis=0), np.linalg.norm(vector, axis=1)
        if not (size > 1e-9 * np.linalg.norm(body.packing.exposed_area, axis=1).max()).any():
            raise InputError("the chosen elements have no free surface through which waves leave.")
        if np.linalg.norm(total) > 0.5 * size.sum():  # one side; corners belong to others as well
            n = np.tile(total / np.linalg.norm(total), (len(ids), 1))
            area = np.maximum((vector * n).sum(axis=1), 0.0)
        else:
            n, area = vector / np.maximum(size, 1e-300)[:, None], size
        press, shear = (
            np.sqrt(body.density * x)[ids, None, None]
            for x in (body.pressure_modulus, body.shear_modulus)
        )
        along = n[:, :, None] * n[:, None, :]
        across = np.eye(n.shape[1]) - along
        # a velocity at the surface is that of the centre a little earlier, which amounts to leaving
        # out the half of the cell beyond the centre
        body.mass_share[ids] *= 0.5
        body.absorbing[ids] += area[:, None, None] * (press * along + shear * across)

    def set_gravity(self, acceleration: ArrayLike) -> None:
        """A body force: this acceleration [m/s^2], (dim,), of every element of the scene."""
        self.gravity = finite("acceleration", acceleration, (None,))

    @checked
    def contact(
        self,
        friction: Friction = 0.0,
        restitution: float = 1.0,
        skin: float = 0.5,
        law: str = "linear",
        restitution_by: str = "opening",
        rolling_friction: float = 0.0,
        twisting_friction: float = 0.0,
        pairs: Mapping[tuple[Material, Material], Friction] | None = None,
        welding: Welding | None = None,
    ) -> None:
        """Let elements touch that no bond joins (theory B11); without this they pass through.

        They touch as spheres, in the plane discs, of the distance to their nearest face, with a
        stiffness as that of bonds. friction: Coulomb's number or a `RateAndState`, between all of
        them but those of the materials in pairs: {(a, b): friction}, in either order. restitution:
        speed along the normal after two elements have touched over that before, 0 to 1 (elastic).
        skin: of the list of neighbours over the median radius; a matter of speed alone. law:
        "linear", or in space "hertz", of elastic spheres of these radii (friction's springs are the
        same); its time step is for overlaps up to a twentieth of the radius. restitution_by:
        "opening" takes what restitution asks for where a contact opens, at any time step, and
        nothing while it lasts; "dashpot" takes it while the contact lasts, by a dashpot that never
        pulls, so that heaps come to rest, and needs a restitution above 0. rolling_friction: the
        greatest moment against rolling over R N, N being the normal force and 1/R the sum of both
        curvatures, as elements that are not round would bear it; twisting_friction: likewise about
        the normal, in space. Springs act below both.

        welding: the law by which pairs weld that are pressed on each other; linear law, Coulomb's
        friction or none.

        Pairs that a bond joined close and rub on their own face until they have parted.
        """
        mu = checked_friction(friction)
        e = float(finite("restitution", restitution, ()))
        if not 0.0 <= e <= 1.0:
            raise InputError(f"restitution is {e:g}; give 0 (none) to 1 (elastic).")
        one_of("law", law, ("linear", "hertz"))
        one_of("restitution_by", restitution_by, ("opening", "dashpot"))
        if restitution_by == "dashpot" and e < LEAST_DASHPOT:
            raise InputError(
                f"restitution is {e:g}; dashpots that give it would need ever smaller time steps: "
                f"give {LEAST_DASHPOT:g} to 1, or restitution_by='opening'."
            )
        if welding is not None:
            if not isinstance(welding, Welding):
                raise InputError(f"welding is {welding!r}; give a Welding.")
            if law != "linear" or isinstance(mu, RateAndState):
                raise InputError(
                    "welding is for the linear law of contact and Coulomb's friction: leave "
                    "law='hertz' and RateAndState, or welding, out."
                )
        self.contacts = Contact(
            mu, e, float(positive("skin", skin, ())), law, restitution_by,
            not_negative("rolling_friction", rolling_friction),
            not_negative("twisting_friction", twisting_friction), checked_pairs(pairs), welding,
        )  # fmt: skip

    @checked
    def wall(
        self,
        shape: Shape | ArrayLike,
        normal: ArrayLike | None = None,
        friction: Friction | Mapping[Material, Friction] | None = None,
        velocity: ArrayLike | None = None,
        spin: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
        angle: ArrayLike | None = None,
        path: Path | tuple[ArrayLike, ArrayLike] | None = None,
        rolling_friction: float | None = None,
        twisting_friction: float | None = None,
    ) -> Wall:
        """A rigid wall that elements touch: a plane by a point [m] and the normal of the side that
        they are on, or a shape of `warpdem.wall`.

        friction, rolling_friction, twisting_friction: by default those of `contact`, which a scene
        with walls needs; friction may be given by materials, {a: friction}. velocity [m/s] and spin
        [rad/s], (1,) in the plane or (3,): the wall's own, by default none; pivot [m]: the point it
        turns about, which moves with it, by default the shape's centre; angle [rad]: a rotation
        vector by which it is turned at the start. path: a function of time [s], or (times, values)
        between which is interpolated, that gives displacement and then rotation vector, (dim + 1,)
        or (dim + 3,), on top of velocity and spin. Returns the wall, on which
        `Simulation.wall_force` and `wall_torque` tell.
        """
        if self.contacts is None:
            raise InputError("walls touch elements as these touch each other; call contact first.")
        if not self.bodies:
            raise InputError("add bodies to the scene before its walls.")
        dim = self.bodies[0].packing.dim
        spins = 1 if dim == 2 else 3
        if not isinstance(shape, Shape):
            if normal is None:
                raise InputError("give a plane a point and a normal, or another shape.")
            finite("point", shape, (dim,))
            finite("normal", normal, (dim,))
            shape = Plane(shape, normal)
        elif normal is not None:
            raise InputError("a normal is given with the point of a plane, not with a shape.")
        if len(shape.place) != dim:
            hint = "; in the plane take a Sphere or a Box" * isinstance(shape, Cylinder | Mesh)
            raise InputError(f"the wall's shape has dimension {len(shape.place)}, not {dim}{hint}.")
        mu, pairs = self.contacts.friction, {}
        if isinstance(friction, Mapping):
            if not all(isinstance(m, Material) for m in friction):
                raise InputError("friction of a wall by materials is {material: friction}.")
            pairs = {m: checked_friction(law) for m, law in friction.items()}
        elif friction is not None:
            mu = checked_friction(friction)

        def own(name: str, given: float | None) -> float:
            share: float = getattr(self.contacts, name)
            return share if given is None else not_negative(name, given)

        wall = Wall(
            shape,
            mu,
            np.zeros(dim) if velocity is None else finite("velocity", velocity, (dim,)),
            np.zeros(spins) if spin is None else finite("spin", np.atleast_1d(spin), (spins,)),
            shape.place if pivot is None else finite("pivot", pivot, (dim,)),
            np.zeros(spins) if angle is None else finite("angle", np.atleast_1d(angle), (spins,)),
            own("rolling_friction", rolling_friction),
            own("twisting_friction", twisting_friction),
            pairs,
            _path(path, dim + spins),
        )
        self.walls.append(wall)
        return wall

    @checked
    def steer(
        self,
        wall: Wall,
        force: float,
        direction: ArrayLike,
        speed: float,
        history: History | tuple[ArrayLike, ArrayLike] | None = None,
    ) -> None:
        """Move a wall along a direction so that it presses with a force [N] that way.

        speed [m/s]: the most it moves at; history: as of `hold`, multiplies the force. The wall's
        velocity is what the force lacks over an impedance: of plane waves in all elements that may
        touch it, so that it is never too quick to be stable, however many do.
        """
        if not any(wall is mine for mine in self.walls):
            raise InputError("this wall is not in the scene; use what scene.wall returned.")
        d = finite("direction", direction, wall.velocity.shape)
        if not np.linalg.norm(d) > 0.0:
            raise InputError("the direction is zero; give the one the wall presses in.")
        wall.steering = Steering(
            d / np.linalg.norm(d),
            float(finite("force", force, ())),
            float(positive("speed", speed, ())),
            _history(history),
        )

    @checked
    def servo(
        self,
        body: Body,
        where: ArrayLike,
        traction: float,
        axis: str,
        speed: float,
        history: History | tuple[ArrayLike, ArrayLike] | None = None,
    ) -> "Servo":
        """Grip a side along one axis and move it so that its mean traction [Pa] is kept.

        traction: normal to the side, tension positive; axis: "x", "y" or "z"; speed [m/s]: the
        most it moves at; history: as of `hold`, multiplies the traction. The grip's elements move
        together along the axis and are free across it. Returns the servo, which reads its traction.
        """
        ids, area, direction = self._surface(body, where)
        dim = body.packing.dim
        if axis not in "xyz"[:dim] or len(axis) != 1:
            raise InputError(f"axis is {axis!r}; choose one of {', '.join('xyz'[:dim])}.")
        at = "xyz".index(axis)
        if not abs(direction[at]) > 0.5:
            raise InputError(f"the chosen side does not face along {axis}.")
        positive("speed", speed, ())
        motion = np.zeros(dim)
        motion[at] = speed * np.sign(direction[at])
        self.hold(body, ids, motion, axes=axis, rotation=False, history=_still)
        servo = Servo(
            body, ids, at, float(np.sign(direction[at])), float(area.sum()),
            float(finite("traction", traction, ())), _history(history),
            len(self.grip_histories) - 1, float(speed),
            float(np.sqrt(body.density * body.pressure_modulus)[ids].mean()),
        )  # fmt: skip
        self.servos.append(servo)
        return servo

    def _surface(self, body: Body, where: ArrayLike) -> tuple[NDArray[np.int64], Array, Array]:
        """Elements, the area [m^2] of each projected on their common side, and its direction."""
        ids = self._selected(body, where)
        exposed = body.packing.exposed_area[ids]
        total = exposed.sum(axis=0)
        size = np.linalg.norm(total)
        if not size > 1e-9 * np.linalg.norm(body.packing.exposed_area, axis=1).sum():
            raise InputError("the chosen elements have no free surface on one side to pull at.")
        return ids, np.maximum(exposed @ (total / size), 0.0), total / size

    def _add_load(
        self,
        body: Body,
        ids: NDArray[np.int64],
        force: Array | None,
        torque: Array | None,
        history: History | tuple[ArrayLike, ArrayLike] | None,
    ) -> None:
        target_force, target_torque = body.force, body.torque
        if history is not None:
            timed = TimedLoad(
                _history(history), np.zeros_like(body.force), np.zeros_like(body.torque)
            )
            body.timed_loads.append(timed)
            target_force, target_torque = timed.force, timed.torque
        if force is not None:
            target_force[ids] += force
        if torque is not None:
            target_torque[ids] += torque

    @checked
    def load(
        self,
        body: Body,
        where: ArrayLike,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        history: History | tuple[ArrayLike, ArrayLike] | None = None,
    ) -> None:
        """Load every chosen element with a force [N], (dim,), and torque [N m], (1,) in the plane
        or (3,), that keep their direction. history: as of `hold`; by default constant."""
        ids = self._selected(body, where)
        if force is None and torque is None:
            raise InputError("give a force, a torque or both.")
        f, t = (
            None if value is None else finite(name, np.atleast_1d(finite(name, value)), shape)
            for name, value, shape in (
                ("force", force, body.force.shape[1:]),
                ("torque", torque, body.torque.shape[1:]),
            )
        )
        self._add_load(body, ids, f, t, history)

    @checked
    def set_velocity(
        self,
        body: Body,
        velocity: ArrayLike,
        angular_velocity: ArrayLike | None = None,
        where: ArrayLike | None = None,
    ) -> None:
        """Initial velocity [m/s], (dim,) or (n, dim), and spin [rad/s], (1 or 3,) or one a row.

        Gripped elements keep what their grip gives them.
        """
        ids = np.arange(len(body.packing)) if where is None else self._selected(body, where)
        for name, value, target, held in (
            ("velocity", velocity, body.velocity, body.held),
            (
                "angular_velocity",
                angular_velocity,
                body.angular_velocity,
                body.held_rotation[:, None],
            ),
        ):
            if value is not None:
                v = finite(name, value)
                try:
                    given = np.broadcast_to(v, (len(ids), target.shape[1]))
                except ValueError:
                    raise InputError(
                        f"{name} has shape {v.shape}; give ({target.shape[1]},) or "
                        f"({len(ids)}, {target.shape[1]})."
                    ) from None
                target[ids] = np.where(held[ids], target[ids], given)

    def _own(self, body: Body) -> None:
        if not any(body is mine for mine in self.bodies):
            raise InputError("this body is not in the scene; use what scene.add returned.")

    def _crossing(
        self, body: Body, start: ArrayLike, end: ArrayLike, depth: ArrayLike | None
    ) -> NDArray[np.int64]:
        self._own(body)
        ids = body.packing.crossing(start, end, depth)
        if len(ids) == 0:
            raise InputError(f"no bond crosses the segment from {start!r} to {end!r}.")
        return ids

    def _selected(self, body: Body, where: ArrayLike) -> NDArray[np.int64]:
        self._own(body)
        n = len(body.packing)
        chosen = np.atleast_1d(entries("where", where))
        if chosen.dtype == bool:
            if chosen.shape != (n,):
                raise InputError(f"the mask has shape {chosen.shape}; give one of shape ({n},).")
            chosen = np.flatnonzero(chosen)
        elif chosen.size and chosen.dtype.kind not in "iu":
            raise InputError("where must be a mask or integer ids of elements.")
        if chosen.size == 0:
            raise InputError("the selection is empty; choose at least one element.")
        bad = (chosen < 0) | (chosen >= n)
        if bad.any():
            wrong = ", ".join(map(str, np.unique(chosen[bad])[:5]))
            raise InputError(f"selected ids {wrong} lie outside 0..{n - 1}.")
        return chosen.astype(np.int64)


def _strain(strain: ArrayLike, dim: int) -> Array:
    e = finite("strain", strain, (dim, dim))
    if np.abs(e - e.T).max() > 1e-12 * np.abs(e).max():
        raise InputError("strain must be symmetric: a rotation would leave elements behind.")
    return e


def _always(_time: float) -> float:
    return 1.0


def _still(_time: float) -> float:
    return 0.0


def _history(given: History | tuple[ArrayLike, ArrayLike] | None) -> History:
    """A function of time from what a user gives."""
    if given is None:
        return _always
    if callable(given):
        finite("history at time 0", first_value("history", given), ())
        return given
    try:
        times, values = given
    except (TypeError, ValueError):
        raise InputError("history must be a function of time, or (times, values).") from None
    t = finite("times of the history", times, (None,))
    v = finite("values of the history", values, (None,))
    if len(t) != len(v) or len(t) == 0 or (np.diff(t) <= 0.0).any():
        raise InputError("the history's times must grow, with one value each.")
    return lambda time: float(np.interp(time, t, v))


def _path(given: Path | tuple[ArrayLike, ArrayLike] | None, width: int) -> Path | None:
    """A function of time from what a user gives."""
    if given is None:
        return None
    if callable(given):
        first_value("path", given)
        return given
    try:
        times, values = given
    except (TypeError, ValueError):
        raise InputError("path must be a function of time, or (times, values).") from None
    t, v = finite("times of the path", times, (None,)), finite("values of the path", values)
    if v.shape != (len(t), width) or len(t) == 0 or (np.diff(t) <= 0.0).any():
        raise InputError(
            f"the path's times must grow, with a row of {width} values each: displacement, turn."
        )
    return lambda time: np.array([np.interp(time, t, column) for column in v.T])


def _grains(
    packing: Packing, materials: tuple[Material, ...], grain: ArrayLike | None
) -> NDArray[np.int64]:
    n = len(packing)
    if grain is None:
        if len(materials) > 1:
            raise InputError(
                f"{len(materials)} materials need grain: which one each element is of."
            )
        return np.zeros(n, dtype=np.int64)
    g = entries("grain", grain)
    if g.shape != (n,) or g.dtype.kind not in "iub":
        raise InputError(f"grain has shape {g.shape}; give ({n},) whole numbers.")
    bad = (g < 0) | (g >= len(materials))
    if bad.any():
        raise InputError(f"grain of elements {first_ids(bad)} is outside 0..{len(materials) - 1}.")
    return g.astype(np.int64)


def _yield_laws(
    packing: Packing,
    materials: tuple[Material, ...],
    bond: str | EVMBond,
    volume: bool | None,
    yielding: YieldLaw | Sequence[YieldLaw | None] | None,
) -> tuple[YieldLaw | None, ...]:
    if yielding is None or not isinstance(yielding, Sequence):
        laws: tuple[YieldLaw | None, ...] = (yielding,) * len(materials)
    else:
        laws = tuple(yielding)
    if len(laws) != len(materials) or not all(
        law is None or isinstance(law, VonMises | Nikolaevsky) for law in laws
    ):
        raise InputError(
            f"yielding is one law, VonMises or Nikolaevsky, or one or None for each of the "
            f"{len(materials)} materials."
        )
    if all(law is None for law in laws):
        return laws
    if packing.area is None:
        raise InputError("a yield law needs a packing with faces.")
    if volume is False or (isinstance(bond, EVMBond) and not volume):
        raise InputError(
            "a yield law needs the volume term: leave volume out with facet bonds, and say "
            "volume=True with EVM bonds (the hybrid of both papers)."
        )
    if isinstance(bond, EVMBond) and bond.large_rotation:
        raise InputError("EVM bonds with large_rotation do not yield; leave large_rotation out.")
    for law, material in zip(laws, materials, strict=True):
        if law is not None and softening(law) >= 0.25 * material.young:
            raise InputError(
                f"the flow stress falls by {softening(law):g} Pa per unit of plastic strain; it "
                f"must fall less than a quarter of Young's modulus, {0.25 * material.young:g} Pa, "
                "or stresses would jump."
            )
    if packing.plane == "stress" and any(isinstance(law, Nikolaevsky) for law in laws):
        raise InputError("Nikolaevsky's flow is for plane strain and space, not plane stress.")
    return laws


def _fractures(
    packing: Packing,
    materials: tuple[Material, ...],
    grain: NDArray[np.int64],
    bond: str | EVMBond,
    fracture: Breaking | Sequence[Breaking],
    pairs: Mapping[tuple[Material, Material], Breaking] | None,
) -> tuple[tuple[Fracture, ...], NDArray[np.int64], Mask]:
    """Criteria, each once; which of them every bond breaks by, or -1; where a Toughness gave it."""
    given: tuple[Any, ...] = (fracture,) * len(materials)
    if isinstance(fracture, list | tuple):
        given = tuple(fracture)
    if len(given) != len(materials):
        raise InputError(
            f"fracture has {len(given)} criteria; give one, or one or None for each of the "
            f"{len(materials)} materials."
        )
    between = _checked_pairs(materials, pairs)
    laws = (*given, *between.values())
    for wanted in laws:
        if not isinstance(wanted, Breaking):
            raise InputError(
                f"fracture is {wanted!r}; give a criterion such as DruckerPrager, one within "
                "Incubation, DamageRate or LinearSoftening, a Toughness, or None."
            )
    if bond != "facet" and any(isinstance(law, Toughness) for law in laws):
        raise InputError("a Toughness is for facet bonds; give a criterion its strength.")

    def made(law: Breaking, *of: Material) -> Fracture | None:
        return law.at(packing, *of) if isinstance(law, Toughness) else law

    own = [made(law, m) for law, m in zip(given, materials, strict=True)]
    found: list[Fracture] = []
    which = np.full(len(packing.bonds), -1)
    is_tough = np.zeros(len(packing.bonds), dtype=bool)
    ends = np.sort(grain[packing.bonds], axis=1)
    for a, b in np.unique(ends, axis=0):
        pair = frozenset((materials[a], materials[b]))
        here = (ends == (a, b)).all(axis=1)
        law: Fracture | None
        if a != b and pair in between:
            law = made(between[pair], materials[a], materials[b])
            is_made = isinstance(between[pair], Toughness)
        else:
            law = weaker(own[a], own[b])
            is_made = any(isinstance(given[x], Toughness) for x in (a, b))
        if law is None:
            continue
        if law not in found:
            found.append(law)
        which[here] = found.index(law)
        is_tough[here] = is_made
    return tuple(found), which, is_tough


def _checked_pairs(
    materials: tuple[Material, ...], pairs: Mapping[tuple[Material, Material], Breaking] | None
) -> dict[frozenset[Material], Breaking]:
    """Criteria between pairs of a body's materials, in either order."""
    laws: dict[frozenset[Material], Breaking] = {}
    if not isinstance(pairs, Mapping | None):
        raise InputError("pairs must map pairs of materials, (a, b), to criteria.")
    for pair, law in () if pairs is None else pairs.items():
        left = list(materials)
        try:
            one, other = pair
            left.remove(one)
            left.remove(other)
        except (TypeError, ValueError):
            raise InputError(
                f"pairs has the key {pair!r}; give pairs of two of the body's materials, (a, b)."
            ) from None
        if laws.setdefault(frozenset(pair), law) is not law:
            raise InputError("pairs has two criteria for one pair of materials; give it once.")
    return laws


def _check_fracture(
    packing: Packing,
    bond: str | EVMBond,
    laws: tuple[YieldLaw | None, ...],
    creep: tuple[ViscousLaw | None, ...],
    fracture: Fracture,
) -> None:
    criterion = criterion_of(fracture)
    if isinstance(criterion, BeamLimit):
        if not isinstance(bond, EVMBond):
            raise InputError("a BeamLimit is for EVM bonds; facet bonds take criteria of stress.")
    elif packing.area is None:
        raise InputError(
            "criteria of stress need a packing with faces; bonds without faces break by a "
            "BeamLimit."
        )
    if isinstance(criterion, PlasticStrainLimit) and all(law is None for law in laws):
        raise InputError("a limit of plastic strain needs a yield law: give yielding as well.")
    if isinstance(fracture, LinearSoftening) and any(law is not None for law in (*laws, *creep)):
        raise InputError(
            "bonds that yield or creep do not soften: their slips would keep the stiffness of the "
            "whole bond; leave one of both out."
        )


def _viscous_laws(
    materials: tuple[Material, ...],
    bond: str | EVMBond,
    volume: bool | None,
    viscous: ViscousLaw | Sequence[ViscousLaw | None] | None,
) -> tuple[ViscousLaw | None, ...]:
    if viscous is None or not isinstance(viscous, Sequence):
        laws: tuple[ViscousLaw | None, ...] = (viscous,) * len(materials)
    else:
        laws = tuple(viscous)
    if len(laws) != len(materials) or not all(
        law is None or isinstance(law, ViscousLaw) for law in laws
    ):
        raise InputError(
            "viscous is one law, Prony, Maxwell, StandardLinearSolid or KelvinVoigt, or one or "
            f"None for each of the {len(materials)} materials."
        )
    if all(law is None for law in laws):
        return laws
    if isinstance(bond, EVMBond):
        raise InputError(
            "viscous laws are of facet bonds; EVM bonds have dashpots, EVMBond(damping=...)."
        )
    if volume is False:
        raise InputError(
            "a viscous law needs the volume term, which tells its deviator; leave volume out."
        )
    return laws


def _no_mixture(laws: tuple[YieldLaw | None, ...], creep: tuple[ViscousLaw | None, ...]) -> None:
    if any(law is not None for law in laws) and any(law is not None for law in creep):
        raise InputError(
            "a scene has bodies that yield or bodies that are viscous, not both: how a slip is "
            "shared between the two is not known here. For flow that depends on the rate give the "
            "yield law a rate, Perzyna or JohnsonCook."
        )


def _check_healing(
    bond: str | EVMBond,
    fractures: tuple[Fracture, ...],
    facet_bending: bool,
    finite_strain: bool,
    healing: Healing,
) -> None:
    if not isinstance(healing, Healing):
        raise InputError(f"healing is {healing!r}; give a Healing.")
    if isinstance(bond, EVMBond) or facet_bending:
        raise InputError(
            "healing is for facet bonds without facet_bending: bonds that resist bending would "
            "have to be linked again with a turned rest state, which they do not have."
        )
    if any(isinstance(fracture, LinearSoftening) for fracture in fractures):
        raise InputError(
            "bonds that soften do not heal; take the criterion without LinearSoftening."
        )
    if finite_strain:
        raise InputError("healing is not for bodies at finite strain; leave one of both out.")


def _check_finite(
    materials: tuple[Material, ...],
    bond: str | EVMBond,
    fractures: tuple[Fracture, ...],
    volume: bool | None,
    laws: tuple[YieldLaw | None, ...],
    creep: tuple[ViscousLaw | None, ...],
) -> None:
    if bond != "facet" or volume is False:
        raise InputError("finite_strain is of facet bonds with their volume term.")
    if fractures:
        raise InputError(
            "finite_strain is not for bonds that break: a deformation gradient needs its element's "
            "faces; leave fracture or finite_strain out."
        )
    if any(law is not None for law in creep):
        raise InputError("finite_strain is not for viscous laws; leave one of both out.")
    if any(isinstance(law, Nikolaevsky) for law in laws):
        raise InputError("finite_strain takes von Mises' flow; Nikolaevsky's is of small strain.")
    if any(m.poisson < 0.0 for m in materials):
        raise InputError("finite_strain needs Poisson's ratios of 0 or more.")


def _check_renewal(
    packing: Packing,
    finite_strain: bool,
    laws: tuple[YieldLaw | None, ...],
    facet_bending: bool,
    share: float,
) -> None:
    positive("renew_faces", share, ())
    if not finite_strain or any(law is None for law in laws):
        raise InputError(
            "renew_faces is of bodies at finite strain that yield everywhere; give finite_strain "
            "and a yield law, or leave renew_faces out."
        )
    if packing.plane == "stress":
        raise InputError(
            "renew_faces is for plane strain and space: in plane stress each element has a "
            "thickness of its own; leave renew_faces out."
        )
    if facet_bending:
        raise InputError("renewed faces do not know how far they were bent; leave one of both out.")


def _tell(packing: Packing, bond: str | EVMBond, facet_bending: bool) -> None:
    """Warn of what makes a body behave in ways that its user may not expect."""
    if packing.pieces > 1:
        bonded = np.bincount(packing.bonds.ravel(), minlength=len(packing)) > 0
        message = f"the body is in {packing.pieces} pieces that no bond joins"
        if not bonded.all():
            message += f"; elements {first_ids(~bonded)} have no bond at all"
        warnings.warn(message + ".", ModelWarning, stacklevel=4)
    if isinstance(bond, EVMBond) and np.all(np.asarray(bond.bending) > 0.0):
        return
    if packing.has_gears and not facet_bending:
        warnings.warn(
            "neighbours of this packing can turn in opposite senses at no energy (gear modes), so "
            "spins may grow unnoticed; take facet_bending=True, another packing, or EVM bonds with "
            "bending stiffness.",
            ModelWarning,
            stacklevel=4,
        )


def _space(packing: Packing) -> str:
    return "in space" if packing.dim == 3 else f"in plane {packing.plane}"

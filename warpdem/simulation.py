"""A scene in motion: stable time step, runs, observers, guards."""

import signal
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from . import cache, fields
from .arrays import PRECISIONS
from .bond import EVMBond
from .checkpoint import Checkpoint, hand_over, noted_signals, read, restore, save
from .errors import (
    Array,
    InputError,
    ModelWarning,
    TooFastError,
    checked,
    finite,
    first_ids,
    one_of,
    whole_number,
)
from .guard import Guard
from .model import Model, build, face_arms, state_arrays, with_faces, with_moving_nodes, with_nodes
from .passes import BATCH, team_of
from .relinking import joined
from .renewal import carried, tessellate
from .scene import Body, Scene, Servo
from .stability import (
    HERTZ_OVERLAP,
    bound_contact,
    bound_contact_damping,
    bound_damping,
    bound_frequency,
    largest_frequency,
    link_states,
)
from .statics import Telling, equilibrate, natural_frequencies, relax
from .step import Step, gathered
from .trouble import TYPE as TROUBLE_TYPE
from .trouble import Distortion, Slips, Troubles, slid
from .wall import Wall

SAFETY = 0.8  # share of the stability limit taken by default
# energies held at an instant, and what damping, flow, viscous branches and renewals took
HELD = (
    *("kinetic", "pair", "volume", "contact", "integrator"),
    *("friction", "damping", "plastic", "viscous", "renewal", "healing"),
)
SERVO_EVERY = 5  # steps between looks of a servo at its traction
SERVO_GAIN = 0.5  # share of the lacking traction that it makes good for at a look
GUARD_EVERY = 100  # steps between checks for non-finite numbers


class Observer(Protocol):
    """Reads a simulation every so many steps; never touches it."""

    every: int

    def observe(self, sim: "Simulation") -> None:
        """Called at the start, then every `every` steps, velocities and places at one time."""

    def finish(self, sim: "Simulation") -> None:
        """Called at the end of every run."""


@dataclass(frozen=True)
class Renewal:
    """One renewal of all faces: step and time [s]; energy [J] that it took; the greatest change of
    an element's stress, over the greatest stress; and the part that springs left unmatched."""

    step: int
    time: float
    energy: float
    stress_change: float
    unmatched: float


class Simulation:
    """A scene in motion under velocity Verlet (theory A10, B13).

    device: "cpu" or "cuda" (as Warp names them); precision: "float64", "float32" or "mixed" (places
    in float64, forces in float32); dt [s]: by default 0.8 of the stability limit, found by
    iteration on the scene itself; a larger one than the limit is refused unless `force_dt`.
    local_damping: Cundall's, a share of each net force, only for quasi-static scenes (theory A8).
    trouble: what happens when an EVM bond is twisted, bent or crushed beyond what its energy stands
    for (theory A5), or slips of plastic flow or creep go beyond 0.3 of a bond's length (theory
    B2a): "warn" once a bond, of slips once, or "stop" with a TroubledBondError.
    simd: vectorise the CPU's loops where this Warp allows it. threads: of the CPU, for scenes of
    many elements; results do not depend on their number.

    Raises InputError for an empty scene, an unknown device or precision, or a bad dt.
    """

    not_saved = ("device", "_awaited")  # a checkpoint leaves these to whoever goes on from it

    @checked
    def __init__(
        self,
        scene: Scene,
        device: str = "cpu",
        precision: str = "float64",
        dt: float | None = None,
        force_dt: bool = False,
        local_damping: float = 0.0,
        trouble: str = "warn",
        simd: bool = True,
        threads: int = 1,
    ) -> None:
        if not isinstance(scene, Scene):
            raise InputError(f"Simulation takes a Scene, not {type(scene).__name__}.")
        one_of("precision", precision, PRECISIONS)
        one_of("trouble", trouble, ("warn", "stop"))
        if not 0.0 <= finite("local_damping", local_damping, ()) < 1.0:
            raise InputError(
                f"local_damping is {local_damping:g}; give 0 (none) to below 1, usually 0.7."
            )
        if dt is not None and not finite("dt", dt, ()) > 0.0:
            raise InputError(f"dt is {dt:g} s; it must be greater than zero.")
        self.device = _device(device)
        self.precision, self.scene = precision, scene
        self.options: dict[str, Any] = {  # with which `resume` makes it anew
            "precision": precision,
            "force_dt": force_dt,
            "local_damping": local_damping,
            "trouble": trouble,
            "simd": simd,
        }
        self.model = build(scene)
        starts = np.cumsum([0, *(len(b.packing) for b in scene.bodies)])
        self._elements = {
            id(b): slice(*ab) for b, *ab in zip(scene.bodies, starts, starts[1:], strict=False)
        }
        self._spacing = max(b.packing.spacing for b in scene.bodies)
        frequency = 0.0
        for linked in link_states(self.model):
            trial = state_arrays(self.model, scene, linked)
            found = largest_frequency(  # the trial's memory is free again at once
                Step(self.model, trial, 1.0, precision, self.device, simd, np.inf, touches=False),
                self._spacing,
            )
            frequency = max(frequency, found)
        touch = bound_contact(self.model)
        frequency = float(np.hypot(frequency, touch))
        bound = float(np.hypot(bound_frequency(self.model), touch))
        # contacts' dashpots know velocities of half a step ago: omega^2 dt^2 + 2 gamma dt < 4
        lag = 0.5 * bound_contact_damping(self.model)
        frequency, bound = (lag + float(np.hypot(lag, x)) for x in (frequency, bound))
        rate = bound_damping(self.model)
        self.dt_limit = 2.0 / max(frequency, rate) if frequency > 0.0 else np.inf
        self.dt_bound = 2.0 / bound if bound > 0.0 else np.inf
        if dt is None:
            if not np.isfinite(self.dt_limit):
                raise InputError("nothing in this scene vibrates, so dt has no default; give dt.")
            dt = SAFETY * self.dt_limit
        elif dt > self.dt_limit and not force_dt:
            raise InputError(
                f"dt is {dt:.4g} s, above the stability limit {self.dt_limit:.4g} s; give a "
                "smaller one, leave it out, or pass force_dt=True to go on regardless."
            )
        self.dt = self.options["dt"] = float(dt)
        self._team = team_of(threads, self.device)
        # before the last renewal of faces: how elements deformed, what books held
        self._first_model = self.model
        self._past_gradient: Array | None = None
        self._past_books = {"plastic": 0.0, "work": 0.0, "renewal": 0.0}
        self._renewals: list[tuple] = []
        self._renewed: dict[str, Any] = {}  # faces that the model has instead of the scene's
        self._told_of_faces = False
        self._told_of_speed = False
        self._adopt(self.model, state_arrays(self.model, scene))
        self._check_speed(InputError)
        self._step.evaluate_forces()
        self._step.remember_springs()
        self._troubles: list[Troubles | Slips | Distortion] = []
        if self.model.evm_bonds:
            self._troubles.append(Troubles(self.model, self._ids(), stops=trouble == "stop"))
        if self.model.features.finite_strain:
            self._troubles.append(Distortion(self.dt_limit))
        elif self.model.features.faces.has_slip and not self.model.healing:
            self._troubles.append(Slips(self.model, self._ids(), stops=trouble == "stop"))
        if self.model.features.branches:
            self._tell_of_times()
        self._guarded.check(self._step)
        self._observers: list[Observer] = []
        self._observed: list[int] = []  # the step at which each was called last
        self._checkpoints: list[Checkpoint] = []
        self._awaited: list[tuple] = []  # records of a checkpoint, for observers still to come
        self._stopped = self._told_of_overlap = False
        self.seconds = 0.0
        self.initial_energies = self._measure()

    # -- running ----------------------------------------------------------------------------------

    def observe(self, observer: Observer) -> Observer:
        """Hand over an observer, called from now on; returns it."""
        whole_number("every", observer.every, 1)
        if isinstance(observer, Checkpoint):
            self._checkpoints.append(observer)
            return observer
        if self._awaited:
            hand_over(self._awaited.pop(0), observer)
        if len(self._observed) == len(self._observers):
            self._observed.append(-1)
        self._observers.append(observer)
        return observer

    @checked
    def run(
        self,
        *,
        until: float | None = None,
        steps: int | None = None,
        checkpoint: str | Path | None = None,
        checkpoint_every: int = 1000,
    ) -> None:
        """Run until a time [s] or for a number of steps, or until an observer calls `stop`.

        checkpoint: where to save the state, every `checkpoint_every` steps, at the end, and before
        SIGTERM or SIGINT end the run; as `observe(Checkpoint(...))`, for this run.

        Raises NonFiniteError naming element, step and dt if numbers stop being finite; nothing
        non-finite reaches an observer.
        """
        if (until is None) == (steps is None):
            raise InputError("give either until (a time in seconds) or steps.")
        if until is not None:
            steps = max(0, round((float(finite("until", until, ())) - self.time) / self.dt))
        count = whole_number("steps", steps, most=2**62)
        kept = list(self._checkpoints)
        if checkpoint is not None:
            kept.append(Checkpoint(checkpoint, checkpoint_every))
        for each in kept:
            each.start(self)
        self._stopped = False
        with noted_signals(bool(kept)) as noted:
            self._run(self._step.count + count, kept, noted)
        if noted:
            self._interrupt(noted[0], kept)

    def _run(self, end: int, kept: list[Checkpoint], noted: list[int]) -> None:
        """Steps until `end`, a call of `stop` or a signal; looks are at multiples of their
        intervals, so that a run in parts is the run in one."""
        servos = self.scene.servos
        every = SERVO_EVERY if servos else GUARD_EVERY
        self._call_observers()
        while self._step.count < end and not self._stopped and not noted:
            nexts = (self._next_call(o.every) for o in (*self._observers, *kept))
            target = min(end, self._next_call(every), *nexts)
            began = time.perf_counter()
            if self._step.count % every == 0:
                for servo in servos:
                    self._steer(servo)
            while self._step.count < target and not noted:
                self._step.advance(min(BATCH, target - self._step.count))
            wp.synchronize_device(self.device)
            self.seconds += time.perf_counter() - began
            self._step.synchronise()
            self._guard()
            self._guard_energy()
            if self._step.count % GUARD_EVERY == 0 and self.model.features.renews:
                self._renew_if_due()
            self._call_observers()
            for each in kept:
                if self._step.count % each.every == 0:
                    each.observe(self)
        if noted:
            for each in kept:
                each.write(self)
            return
        for observer in (*kept, *self._observers):
            observer.finish(self)

    def save(self, path: str | Path) -> None:
        """Write all of the state to a file from which `resume` goes on to the same bits.

        path: ends in .npz; what had this name before is kept as NAME.previous.npz. Raises
        InputError if it cannot be written, and then leaves both as they were.
        """
        self._step.synchronise()
        save(self, Checkpoint(path).path)

    @checked
    def relax(
        self, tolerance: float | None = None, max_steps: int = 100_000, tell: Telling | None = None
    ) -> float:
        """Bring the scene to rest by steered motion (FIRE), on the device.

        Grips stand still, no bond breaks, nothing flows and no time passes: slips stay as they are,
        and what is beyond the flow stress then returns in the next step of a run. tolerance:
        greatest net force over the greatest bond force, by default 1e-6, 1e-5 in mixed and 1e-3 in
        float32; tell: called with the step and that residual from time to time. Returns the
        residual; the energy ledger starts anew. Raises NotConvergedError.
        """
        if tolerance is None:
            tolerance = {"float64": 1e-6, "mixed": 1e-5, "float32": 1e-3}[self.precision]
        self._step.synchronise()
        try:
            with self._step.at_rest():
                return relax(self._step, self._spacing, tolerance, max_steps, tell)
        finally:
            self._start_anew()

    @checked
    def equilibrate(
        self,
        tolerance: float = 1e-8,
        max_iterations: int = 20,
        load_steps: int = 1,
        tell: Telling | None = None,
    ) -> float:
        """Bring the scene to rest by Newton's method with a sparse solver on the host, in float64.

        For slender bodies and exact answers; outer loads grow in steps of 1/load_steps, halved
        where the method does not converge in max_iterations. The rest as `relax`.
        """
        self._refuse_contact("equilibrate")
        self._step.synchronise()
        try:
            with self._step.at_rest():
                return equilibrate(
                    self._step, self._spacing, tolerance, max_iterations, load_steps, tell
                )
        finally:
            self._start_anew()

    @checked
    def natural_frequencies(self, count: int = 6) -> Array:
        """Lowest angular frequencies [rad/s] of small motions about the current state, (count,).

        The state should be one of rest. A negative one stands for a motion that grows as
        exp(|omega| t): the state is unstable, as a column above its buckling load.
        """
        self._refuse_contact("natural_frequencies")
        self._step.synchronise()
        try:
            with self._step.at_rest():
                return natural_frequencies(self._step, self._spacing, count)
        finally:  # what looking about left in the books of unlinked pairs
            self._step.forget_gaps()
            self._step.evaluate_forces()

    def renew_faces(self) -> "Renewal":
        """Make all faces anew from where the elements are (theory B6); see `Scene.add`.

        Stresses, plastic strains, masses, inertias, velocities and turns of elements stay; `bonds`
        are others from now on. What energy that costs is booked as "renewal".
        """
        if not self.model.features.renews:
            raise InputError("faces are renewed of a body added with renew_faces.")
        self._step.synchronise()
        before, stress = self._measure(), self.stress
        old, step, body = self.model, self._step, self.scene.bodies[0]
        dim = old.features.dim
        since = np.eye(dim) + self._own("displacement_gradient")
        gradient, position = self.deformation_gradient, self.position
        past, box = np.zeros((dim, dim)), np.eye(dim)
        if body.strain_history is not None:
            past = np.asarray(body.strain_history(self.time))
            box = box + past
        faces = tessellate(body.packing, position, gradient, box)
        shift = np.zeros((len(faces.pair), dim))
        if body.packing.period is not None:
            shift = faces.image * body.packing.period
        renewed: dict[str, Any] = {
            "position": position,
            "volume": faces.volume,
            "pairs": faces.pair,
            "area": faces.area,
            "arms": faces.arms,
            "shift": shift,
            "past": past,
            "slots": old.features.slots,
        }
        new = self._with_faces(**renewed)
        kept, lack = carried(old, step, new, since)
        linked = np.ones(new.bonds, dtype=bool)
        trial = state_arrays(new, self.scene, linked)
        trial["displacement"] = np.zeros_like(position)
        self._renewed, self._past_gradient = renewed, gradient
        simd = self.options["simd"]
        free = Step(new, dict(trial), 1.0, self.precision, self.device, simd, slack=np.inf)
        self.dt_limit = 2.0 / largest_frequency(free, self._spacing)
        self._adopt(new, trial | kept)
        self._step.count = step.count
        self._step.servo_factors = step.servo_factors
        self._step.set_factors()
        if "damped_energy" in kept:
            self._step.upload("damped_energy", kept["damped_energy"])
        self._step.evaluate_forces()
        self._step.remember_springs()
        for troubles in self._troubles:
            if isinstance(troubles, Distortion):
                troubles.restart(self.dt_limit)
        # books go on: what flowed and worked so far, and the jump of everything held
        own, after = self._past_books, self._measure()
        for name in ("plastic", "work"):
            own[name] += before[name] - after[name]
        jump = sum(before[k] - after[k] for k in HELD if k != "plastic")
        own["renewal"] += jump
        size = float(np.abs(stress).max())
        change = float(np.abs(self.stress - stress).max()) / size if size > 0.0 else 0.0
        self._renewals.append((step.count, self.time, jump, change, lack))
        self._guarded.check(self._step)
        return self.renewals[-1]

    @property
    def renewals(self) -> list[Renewal]:
        """Renewals of faces so far."""
        return [Renewal(*numbers) for numbers in self._renewals]

    def stop(self) -> None:
        """End the run after the current call of observers."""
        self._stopped = True

    @property
    def steps(self) -> int:
        """Steps made so far."""
        return self._step.count

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._step.count * self.dt

    @property
    def rate(self) -> float:
        """Element-steps a second so far, observers not counted."""
        return self.steps * self.model.elements / self.seconds if self.seconds else 0.0

    @property
    def bytes(self) -> int:
        """Device memory in use [B]."""
        return self._step.bytes

    @property
    def memory(self) -> dict[str, int]:
        """Device memory of every array by name [B], the largest first."""
        return dict(sorted(self._step.memory().items(), key=lambda item: -item[1]))

    @property
    def kernels(self) -> list[str]:
        """Names of the kernels that a step launches, in order; the rare passes of steps in which
        bonds break or contacts close are not among them."""
        return self._step.kernels

    def seconds_per_step(self) -> float:
        """Wall time of one step [s], estimated from the force passes of this scene."""
        samples = []
        for _ in range(5):
            began = time.perf_counter()
            self._step.evaluate_forces()
            wp.synchronize_device(self.device)
            samples.append(time.perf_counter() - began)
        return 1.5 * float(np.median(samples))  # motion takes about half as long as the forces

    # -- reading ----------------------------------------------------------------------------------

    @property
    def displacement(self) -> Array:
        """Displacement of every element from its reference place [m], (n, dim)."""
        own = slice(0, self.model.own_elements)
        return self._own("displacement") + (self.model.position - self._first_model.position)[own]

    @property
    def position(self) -> Array:
        """Place of every element [m], (n, dim)."""
        return self.model.position[: self.model.own_elements] + self._own("displacement")

    @property
    def orientation(self) -> Array:
        """Turn since the reference state: quaternion (x, y, z, w), in the plane (sin, cos) of half
        the angle, (n, 4) or (n, 2)."""
        return self._own("orientation")

    @property
    def velocity(self) -> Array:
        """Velocity [m/s], (n, dim)."""
        return self._own("velocity")

    @property
    def angular_velocity(self) -> Array:
        """Angular velocity in the world frame [rad/s], (n, 1) in the plane or (n, 3)."""
        return self._own("angular_velocity")

    @property
    def stress(self) -> Array:
        """Average stress of every element [Pa], (n, 3, 3), tension positive; zero without faces.

        At finite strain the true (Cauchy) stress.
        """
        return fields.stress_tensor(self._step.evaluate_stress())[: self.model.own_elements]

    @property
    def von_mises(self) -> Array:
        """Von Mises stress of every element [Pa], (n,)."""
        return fields.von_mises(self.stress)

    @property
    def pressure(self) -> Array:
        """Mean stress with its sign turned, positive in compression [Pa], (n,)."""
        return fields.pressure(self.stress)

    @property
    def principal_stress(self) -> Array:
        """Principal stresses of every element [Pa], greatest first, (n, 3)."""
        return fields.principal(self.stress)

    @property
    def strain(self) -> Array:
        """Elastic strain of every element, (n, 3, 3), in axes that the stress is given in.

        Hooke's law solved for the element's average stress; of bodies with facet bonds.
        """
        bodies = self.scene.bodies
        if any(isinstance(b.bond, EVMBond) for b in bodies):
            raise InputError(
                "the strain of elements is known with facet bonds; EVM bonds have none."
            )
        shear = np.concatenate([b.shear_modulus for b in bodies])
        coupling = np.concatenate([b.coupling for b in bodies])
        return fields.elastic_strain(self.stress, shear, coupling)

    @property
    def rotation(self) -> Array:
        """Turn of every element since the reference state as a vector [rad], (n, 1) or (n, 3)."""
        q = self.orientation
        half = np.linalg.norm(q[:, :-1], axis=1)
        sign = np.where(q[:, -1] < 0.0, -1.0, 1.0)
        angle = 2.0 * np.arctan2(half, np.abs(q[:, -1]))
        share = np.divide(angle, half, out=np.full(len(q), 2.0), where=half > 0.0)
        return (sign * share)[:, None] * q[:, :-1]

    @property
    def deformation_gradient(self) -> Array:
        """F of every element at finite strain, (n, dim, dim): how its surroundings deformed."""
        if not self.model.features.finite_strain:
            raise InputError("deformation gradients are known of bodies with finite_strain.")
        gradient = np.eye(self.model.features.dim) + self._own("displacement_gradient")
        return gradient if self._past_gradient is None else gradient @ self._past_gradient

    @property
    def plastic_strain(self) -> Array:
        """Equivalent plastic strain of every element, the sum of sqrt(2/3 de:de), (n,)."""
        if not self.model.yielding:
            return np.zeros(self.model.own_elements)
        return self._own("plastic_strain")

    @property
    def energy_density(self) -> Array:
        """Elastic energy of every element over its volume [J/m^3], (n,): its own and half that of
        its bonds."""
        m, own = self.model, self.model.own_elements
        half = np.repeat(0.5 * self.bond_energy, 2)
        total = np.bincount(self.bonds.ravel(), half, minlength=own)
        for name in ("volume_energy", "locked_energy"):
            if name in self._step.arrays:
                total += self._step.download(name)[:own]
        return total / m.element_volume[:own]

    @property
    def force(self) -> Array:
        """Force of the bonds on every element [N], (n, dim)."""
        return gathered(self._step)[0][: self.model.own_elements]

    @property
    def torque(self) -> Array:
        """Torque of the bonds on every element [N m], (n, 1) in the plane or (n, 3)."""
        return gathered(self._step)[1][: self.model.own_elements]

    @property
    def bond_force(self) -> Array:
        """Force of every bond on its first element [N], (b, dim)."""
        m, force = self.model, self._step.bond_forces()
        if m.interface_halves is not None:  # linked ones act by their halves
            acts = self._step.download("bond_linked")[m.interface_bonds, None] > 0.0
            force[m.interface_bonds] += acts * force[m.interface_halves[:, 0]]
        return force[m.own_bonds]

    @property
    def bond_energy(self) -> Array:
        """Energy that every linked bond holds [J], (b,)."""
        m, energy = self.model, self._step.bond_energy()
        if m.node_bonds is not None:
            energy[m.node_bonds] += energy[m.second_bonds]
        if m.interface_halves is not None:
            energy[m.interface_bonds] = energy[m.interface_halves[:, 0]]
        return energy[m.own_bonds]

    @property
    def bonds(self) -> NDArray[np.int64]:
        """Element ids of every bond, (b, 2)."""
        return self.model.own_pairs

    @property
    def linked(self) -> NDArray[np.bool_]:
        """Whether each bond is linked, (b,)."""
        if self.model.listed_bonds is None:
            return np.ones(len(self.model.own_bonds), dtype=bool)
        return self._step.download("bond_linked")[self.model.own_bonds] > 0.0

    @property
    def integrity(self) -> Array:
        """Share of its stiffness that each bond has, (b,): 1 whole, 0 unlinked, between them
        softening."""
        if self.model.listed_bonds is None:
            return np.ones(len(self.model.own_bonds))
        return self._step.download("bond_linked")[self.model.own_bonds].astype(np.float64)

    @property
    def criterion_ratio(self) -> Array:
        """Greatest ratio of equivalent stress to strength that each bond has seen so far, (b,).

        A whole bond breaks, or starts to soften, above 1; 0 where a bond cannot break.
        """
        m = self.model
        ratio = np.zeros(m.bonds)
        if m.criteria:
            ratio[m.listed_bonds] = self._step.download("criterion_ratio")
        return ratio[m.own_bonds]

    @property
    def damage(self) -> Array:
        """Share of each element's bonds that are unlinked, (n,)."""
        n, bonds = self.model.own_elements, self.bonds
        broken = np.bincount(bonds[~self.linked].ravel(), minlength=n)
        return broken / np.maximum(np.bincount(bonds.ravel(), minlength=n), 1)

    @property
    def contacts(self) -> NDArray[np.int64]:
        """Pairs of elements that touch now without a bond, (c, 2), the lower id first."""
        if self._step.neighbours is None or self.model.contact_radius is None:
            return np.zeros((0, 2), dtype=np.int64)
        pairs = self._step.neighbours.pairs().astype(np.int64)
        return pairs[self._apart(pairs) < self.model.contact_radius[pairs].sum(axis=1)]

    def _apart(self, pairs: NDArray[np.int64]) -> Array:
        """Distances [m] of pairs of elements, in a periodic box of their nearest images."""
        i, j = pairs.T
        d = self.position[j] - self.position[i]
        if self.model.contact_period is not None:
            strain = self._step.box_strains[0]
            edges = (np.eye(len(strain)) + strain) * self.model.contact_period
            d -= np.rint(d @ np.linalg.inv(edges).T) @ edges.T
        return np.linalg.norm(d, axis=1)

    def wall_force(self, wall: Wall) -> Array:
        """Force of all elements on a wall [N], (dim,)."""
        return self.wall_forces(wall).sum(axis=0)

    def wall_forces(self, wall: Wall) -> Array:
        """Force of every element on a wall [N], (n, dim)."""
        row = self._row(wall)
        force = np.zeros((self.model.elements, self.model.features.dim))
        force[self.model.contact_elements] = self._step.download("wall_reaction")[row]
        return force[: self.model.own_elements]

    def wall_torque(self, wall: Wall) -> Array:
        """Torque of all elements on a wall about its shape's place [N m], (1,) or (3,)."""
        row = self._row(wall)
        return self._step.download("wall_torque")[row].sum(axis=0, dtype=np.float64)

    def wall_pose(self, wall: Wall) -> tuple[Array, Array]:
        """Place of a wall's shape now [m], (dim,), and its orientation, as `orientation`."""
        return wall.pose(self.time, self._step.wall_way[self._row(wall)])

    def _row(self, wall: Wall) -> int:
        for row, mine in enumerate(self.model.walls):
            if mine is wall:
                return row
        raise InputError("this wall is not in the simulation's scene.")

    def elements(self, body: Body) -> slice:
        """The elements of a body among those of the simulation."""
        if id(body) not in self._elements:
            raise InputError("this body is not in the simulation's scene.")
        return self._elements[id(body)]

    def broken_bonds(self) -> NDArray[np.void]:
        """Log of broken bonds in order of time, a structured array with the fields

        bond, i, j, step, time [s], x, y, z [m] (reference place of the face), normal_stress and
        shear_stress [Pa] at the break, mode ("normal" or "shear", whichever is greater) and
        released_energy [J] (of the bond and of both elements; may be slightly negative).
        """
        kinds: list[tuple[str, type | str]] = [
            ("bond", int),
            ("i", int),
            ("j", int),
            ("step", int),
            ("time", float),
        ]
        kinds += [("x", float), ("y", float), ("z", float), ("normal_stress", float)]
        kinds += [("shear_stress", float), ("mode", "U6"), ("released_energy", float)]
        m = self.model
        if not m.criteria or m.listed_bonds is None:
            return np.zeros(0, dtype=kinds)
        step = self._step.download("break_step")[m.listed_bonds]
        step[m.facet_listed : m.first_beam] = -1  # halves of bonds between unlike elements
        rows = np.flatnonzero(step >= 0)
        normal, shear, energy = (
            self._step.download("break_" + x) for x in ("normal", "shear", "energy")
        )
        if m.interface_halves is not None and m.interface_bonds is not None:
            # whose energy is that of the bonds themselves
            halves = energy[m.rows_of(m.interface_halves)].sum(axis=1)
            energy[m.rows_of(m.interface_bonds)] += halves
        normal, shear, energy = normal[rows], shear[rows], energy[rows]
        columns: tuple[NDArray, ...] = (rows, step[rows], normal, shear, energy)
        if m.healing:  # breaks of bonds that were linked again come from their own log
            columns = (*columns[:4], energy - self._step.relinks.booked(rows))
            columns = joined([columns, *self._step.relinks.breaks])
        log = self._log_of(kinds, columns, "normal_stress")
        log["mode"] = np.where(log["normal_stress"] >= log["shear_stress"], "normal", "shear")
        return log

    def relinked_bonds(self) -> NDArray[np.void]:
        """Log of bonds linked again (`Healing`) in order of time, a structured array with the
        fields

        bond, i, j, step, time [s], x, y, z [m] (reference place of the face), pressure and
        shear_stress [Pa] of the contact then, and released_energy [J]: negative where the link took
        some of what the bond's breaks had released.
        """
        kinds: list[tuple[str, type | str]] = [(x, int) for x in ("bond", "i", "j", "step")]
        names = "time", "x", "y", "z", "pressure", "shear_stress", "released_energy"
        kinds += [(x, float) for x in names]
        return self._log_of(kinds, joined(self._step.relinks.links), "pressure")

    @property
    def welded(self) -> NDArray[np.int64]:
        """Pairs of elements that are welded now (`Welding`), (p, 2), the lower id first."""
        return self._step.welded()

    def welded_pairs(self) -> NDArray[np.void]:
        """Log of pairs that welded, and of welds that broke, in order of time, a structured array
        with the fields

        i, j, step, time [s], kind ("welded" or "broken"), normal_stress (tension positive) and
        shear_stress [Pa], of a break those just before it, and released_energy [J], 0 of a weld.
        """
        kinds: list[tuple[str, type | str]] = [("i", int), ("j", int), ("step", int)]
        kinds += [("time", float), ("kind", "U6"), ("normal_stress", float)]
        kinds += [("shear_stress", float), ("released_energy", float)]
        rows = np.concatenate([np.zeros((0, 7)), *self._step.welds.rows])
        log = np.zeros(len(rows), dtype=kinds)
        i, j, step, kind, normal, shear, energy = rows.T
        log["i"], log["j"], log["step"], log["time"] = i, j, step, step * self.dt
        log["kind"] = np.where(kind > 0.0, "welded", "broken")
        log["normal_stress"], log["shear_stress"], log["released_energy"] = normal, shear, energy
        return log

    def waiting_bonds(self) -> NDArray[np.int64]:
        """Bonds whose law of healing is met now, and that stay unlinked because the link would
        need more energy than their breaks have released."""
        m = self.model
        if not m.healing or m.listed_bonds is None:
            return np.zeros(0, dtype=np.int64)
        return np.searchsorted(m.own_bonds, m.listed_bonds[self._step.waiting()])

    def _log_of(
        self, kinds: list[tuple[str, type | str]], columns: tuple[NDArray, ...], stress: str
    ) -> NDArray[np.void]:
        """A log in order of time from listed bonds, steps, two stresses and energies."""
        m = self.model
        log = np.zeros(len(columns[0]), dtype=kinds)
        if not len(log) or m.listed_bonds is None:
            return log
        rows, step = (np.asarray(x, dtype=np.int64) for x in columns[:2])
        order = np.lexsort((m.listed_bonds[rows], step))
        rows, step = rows[order], step[order]
        bond = m.listed_bonds[rows]
        log["bond"] = np.searchsorted(m.own_bonds, bond)
        log["i"], log["j"] = m.bond_i[bond], m.bond_j[bond]
        log["step"], log["time"] = step, step * self.dt
        place = m.position[m.bond_i[bond]] + face_arms(m)[bond]
        for axis, name in zip(range(m.features.dim), "xyz", strict=False):
            log[name] = place[:, axis]
        log[stress], log["shear_stress"], log["released_energy"] = (x[order] for x in columns[2:])
        return log

    def troubled_bonds(self) -> NDArray[np.void]:
        """Bonds found beyond what their energy stands for, a structured array with the fields

        bond, i, j, step (when it was found), kind ("twisted", "bent" or "crushed" EVM bonds,
        "flowed" or "crept" ones) and value: the angle [rad], the bond's length over that at rest,
        or the slip over the length.
        """
        return np.concatenate([np.zeros(0, dtype=TROUBLE_TYPE), *(t.log for t in self._troubles)])

    def energy(self) -> dict[str, float]:
        """The energy ledger [J].

        kinetic, pair (linked bonds and their branches), volume, contact (closed unlinked pairs and
        whatever touches): held now; friction: taken by slip, rolling, twisting; fracture: released
        by breaking bonds and welds; damping: taken by dashpots, local damping, absorbing sides and
        restitution; plastic: dissipated by plastic flow; viscous: by branches; healing: released by
        links made again, negative where these took from what their breaks had released; work: done
        by moving grips and walls, outer loads and a periodic box; integrator: velocity Verlet's own
        term (theory B13), its jumps at breaking bonds included; renewal: lost with old faces;
        residual: what is missing from their balance.
        """
        ledger = self._measure()
        before, now = (
            sum(x[k] for k in (*HELD, "fracture")) for x in (self.initial_energies, ledger)
        )
        ledger["residual"] = now - before - (ledger["work"] - self.initial_energies["work"])
        return ledger

    @property
    def energy_error(self) -> float:
        """Residual of the energy ledger over the greatest of its entries."""
        ledger = self.energy()
        size = max(
            [abs(v) for k, v in ledger.items() if k != "residual"]
            + [self.initial_energies["pair"] + self.initial_energies["volume"]]
        )
        return ledger["residual"] / size if size > 0.0 else 0.0

    def set_state(self, **arrays: ArrayLike) -> None:
        """Overwrite displacement, orientation, velocity or angular_velocity of all elements.

        Orientations must be of unit length. The energy ledger starts anew.
        """
        self._step.synchronise()
        given = {}
        for name, value in arrays.items():
            one_of("state", name, ("displacement", "orientation", "velocity", "angular_velocity"))
            now, own = self._own(name), slice(0, self.model.own_elements)
            given[name] = finite(name, value, now.shape)
            if name == "displacement":
                moved = self.model.position - self._first_model.position
                given[name] = given[name] - moved[own]
            if name == "velocity":  # grips keep theirs
                held = self.model.inverse_mass[own] == 0.0
                given[name] = np.where(held, now, given[name])
            if name == "angular_velocity":
                held = self.model.inverse_inertia[own, None] == 0.0
                given[name] = np.where(held, now, given[name])
            if name == "orientation":
                bad = np.abs(np.linalg.norm(given[name], axis=1) - 1.0) > 1e-6
                if bad.any():
                    raise InputError(f"orientation is not of unit length at {first_ids(bad)}.")
        for names, completed in (
            (("displacement", "orientation"), with_nodes),
            (("velocity", "angular_velocity"), with_moving_nodes),
        ):
            if not given.keys().isdisjoint(names):
                place, turn = (given.get(x, self._own(x)) for x in names)
                whole = completed(self.model, place, turn, self._parted)
                for name, value in zip(names, whole, strict=True):
                    self._step.upload(name, value)
        self._start_anew()

    # -- within -----------------------------------------------------------------------------------

    def _adopt(self, model: Model, state: dict[str, NDArray]) -> None:
        """Go on with this model and state: the passes of a step, and the looks at them."""
        self.model = model
        self._step = Step(
            model,
            state,
            self.dt,
            self.precision,
            self.device,
            self.options["simd"],
            local_damping=self.options["local_damping"],
            team=self._team,
        )
        self._guarded = Guard(model, state, self._spacing)

    def _with_faces(self, slots: int, **faces: Any) -> Model:
        """The scene's model with faces made anew; slots: that elements had before."""
        first = self._first_model
        roomy = replace(first, features=replace(first.features, slots=slots))
        return with_faces(roomy, **faces, whole=self.scene.bodies[0].strain_history)

    def _renew_if_due(self) -> None:
        """Renew faces where a bond's centres have slid by more than the body's share of its length
        since the last renewal."""
        share = self.scene.bodies[0].renew_faces
        if share is None or float(slid(self._step).max(initial=0.0)) <= share:
            return
        try:
            self.renew_faces()
        except InputError as why:  # nothing has changed yet
            if not self._told_of_faces:
                self._told_of_faces = True
                warnings.warn(
                    f"at step {self._step.count} faces were not renewed, and the old ones stay "
                    f"until they can be: {why}",
                    ModelWarning,
                    stacklevel=4,
                )

    def _refuse_contact(self, what: str) -> None:
        if self.model.contact is not None:
            raise InputError(
                f"{what} does not know of contact; take relax, or a scene without contact."
            )

    def _steer(self, servo: Servo) -> None:
        """Move a servo's grip as an absorbing side under the wanted traction would: by the lack of
        traction over the impedance rho c, which neither overshoots nor sends waves back."""
        at = self.elements(servo.body).start + servo.ids
        pull = -self.force[at, servo.axis].sum() * servo.outward  # the grip's on the body
        servo.measured = float(pull / servo.area)
        speed = (servo.wanted(self.time) - servo.measured) / servo.impedance
        share = SERVO_GAIN * speed / servo.speed
        self._step.servo_factors[servo.grip] = float(np.clip(share, -1.0, 1.0))
        self._step.set_factors()

    def _tell_of_times(self) -> None:
        """Warn of branches that relax within a step."""
        assert self.model.branch_time is not None
        least = float(self.model.branch_time.min())
        if least < self.dt:
            warnings.warn(
                f"the shortest time of relaxation, {least:.3g} s, is below the time step "
                f"{self.dt:.3g} s; its branch acts as a viscosity of half a step's time instead.",
                ModelWarning,
                stacklevel=4,
            )

    def _ids(self) -> NDArray[np.int64]:
        """The packings' own ids, or the order of elements where these clash."""
        ids = np.concatenate([b.packing.ids for b in self.scene.bodies])
        return ids if len(np.unique(ids)) == len(ids) else np.arange(len(ids))

    def _own(self, name: str) -> Array:
        """A state array of the packings' elements, without nodes."""
        return self._step.download(name)[: self.model.own_elements].astype(np.float64)

    @property
    def _parted(self) -> NDArray[np.bool_] | None:
        """Nodes whose faces have parted, which stay with their first element."""
        m = self.model
        if m.interface_halves is None:
            return None
        parted = np.zeros(m.nodes, dtype=bool)
        unlinked = self._step.download("bond_linked")[m.interface_bonds] == 0.0
        parted[m.bond_j[m.interface_halves[unlinked, 0]] - m.own_elements] = True
        return parted

    def _start_anew(self) -> None:
        """Forces, books and checks of a state that was not reached by steps."""
        self._step.forget_gaps()
        self._step.evaluate_forces()
        self._step.remember_springs()
        self._guard()
        self.initial_energies = self._measure()

    def _measure(self) -> dict[str, float]:
        ledger = self._step.energies()
        ledger["fracture"] = 0.0
        if self.model.criteria:
            ledger["fracture"] = float(self._step.download("break_energy").sum(dtype=np.float64))
        if "weld_energy" in self._step.arrays:
            ledger["fracture"] += float(self._step.download("weld_energy").sum())
        ledger["work"] = self._step.work
        ledger["renewal"] = 0.0
        for name, past in self._past_books.items():
            ledger[name] += past
        return ledger

    def _next_call(self, every: int) -> int:
        return (self._step.count // every + 1) * every

    def _call_observers(self) -> None:
        for place, observer in enumerate(self._observers):
            due = self._step.count % observer.every == 0
            if due and self._observed[place] != self._step.count:
                self._observed[place] = self._step.count
                observer.observe(self)

    def _interrupt(self, number: int, kept: list[Checkpoint]) -> None:
        """End the process as a signal asked for, now that the state is saved."""
        names = ", ".join(str(each.path) for each in kept)
        handler = signal.getsignal(number)
        if callable(handler) and handler is not signal.default_int_handler:
            handler(number, None)
        if number == signal.SIGINT:
            raise KeyboardInterrupt(f"step {self.steps} is saved in {names}")
        raise SystemExit(128 + number)

    def _guard(self) -> None:
        self._guarded.check_finite(self._step)
        self._check_speed(TooFastError)
        self._guarded.check_motion(self._step)
        self._check_overlap()
        for troubles in self._troubles:
            troubles.check(self._step)

    def _guard_energy(self) -> None:
        """Not at every observer's look, as it costs as much as a step."""
        if self._step.count % GUARD_EVERY:
            return
        ledger, before = self.energy(), self.initial_energies
        held = sum(before[k] for k in HELD)
        work = ledger["work"] - before["work"]
        self._guarded.check_energy(self._step, ledger["residual"], held, work)

    def _check_overlap(self) -> None:
        """Warn, once, of Hertz's contacts deeper than the time step is stable for."""
        m = self.model
        if m.contact is None or not m.contact.is_hertz or self._told_of_overlap:
            return
        assert m.contact_radius is not None and m.contact_compliance is not None
        assert m.contact_elements is not None
        radius, pairs = m.contact_radius, self.contacts
        share = [1.0 - self._apart(pairs) / radius[pairs].sum(axis=1)]
        if m.walls:  # by the force of each on each element
            own = m.contact_elements
            force = np.linalg.norm(self._step.download("wall_reaction"), axis=2)
            stiffness = 4.0 / 3.0 * np.sqrt(radius[own]) / m.contact_compliance[own]
            share.append(((force / stiffness) ** (2.0 / 3.0) / radius[own]).ravel())
        worst = float(np.concatenate(share).max(initial=0.0))
        if worst > HERTZ_OVERLAP:
            self._told_of_overlap = True
            warnings.warn(
                f"elements overlap by {worst:.3g} of their radius; Hertz's law stiffens, and the "
                f"time step is known to be stable up to {HERTZ_OVERLAP:g}. Take a smaller dt, or "
                "law='linear'.",
                ModelWarning,
                stacklevel=4,
            )

    def _check_speed(self, error: type[Exception]) -> None:
        """Refuse elements that would pass through others, or through a wall, within a step."""
        m = self.model
        if m.contact_elements is None or m.contact_radius is None:
            return
        own = m.contact_elements
        v = self._step.download("velocity").astype(np.float64)[own]
        speed = v - np.average(v, axis=0, weights=m.mass[own])
        self._refuse_fast(speed, "others", error)
        self._tell_of_speed(speed)
        x = m.position[own] + self._step.download("displacement")[own]
        for row, wall in enumerate(m.walls):
            by_wall = wall.motion(x, self.time, self.dt, self._step.wall_way[row]) / self.dt
            self._refuse_fast(v - by_wall, f"wall {row}", error)

    def _tell_of_speed(self, speed: Array) -> None:
        """Warn, once, of elements faster than waves, which contact may be too soft to stop."""
        m = self.model
        if self._told_of_speed or m.contact_elements is None:
            return
        bodies = self.scene.bodies
        wave = np.concatenate([np.sqrt(b.pressure_modulus / b.density) for b in bodies])
        share = np.linalg.norm(speed, axis=1) / wave[m.contact_elements]
        if share.max() > 1.0:
            self._told_of_speed = True
            fast = np.zeros(m.elements, dtype=bool)
            fast[m.contact_elements] = share > 1.0
            warnings.warn(
                f"elements {first_ids(fast)} move at up to {share.max():.3g} times the speed of "
                "waves in them; the springs of contact may be too soft to stop them, so that they "
                "pass through others.",
                ModelWarning,
                stacklevel=4,
            )

    def _refuse_fast(self, speed: Array, what: str, error: type[Exception]) -> None:
        """Refuse elements that move against something by more than half the least radius."""
        m = self.model
        assert m.contact_elements is not None and m.contact_radius is not None
        least = float(m.contact_radius[m.contact_elements].min())
        far = np.linalg.norm(speed, axis=1) * self.dt
        if far.max() > 0.5 * least:
            fast = np.zeros(m.elements, dtype=bool)
            fast[m.contact_elements] = far > 0.5 * least
            raise error(
                f"elements {first_ids(fast)} move by up to {far.max():.3g} m in a step, more than "
                f"half the least radius, {least:.3g} m, and would pass through {what}; take dt "
                f"below {0.5 * least / far.max() * self.dt:.3g} s."
            )


def resume(
    path: str | Path, scene: Scene, device: str | None = None, threads: int = 1
) -> Simulation:
    """A simulation that goes on from a checkpoint, on the same device to the same bits.

    scene: built as for the run, by the same script: functions (histories, criteria, observers)
    cannot be kept in a file. It is compared with the checkpoint's. Observers are handed over anew,
    in the same order, and get their records back; then `run` goes on. threads: of the CPU; results
    do not depend on their number.

    Raises DamagedFileError for a file that is not whole, InputError for another scene.
    """
    header, arrays = read(Path(path))
    where = device or header["device"]
    sim = Simulation(scene, device=where, threads=threads, **header["options"])
    restore(sim, header, arrays)
    return sim


def _device(name: str) -> str:
    cache.start()
    names = [str(d) for d in wp.get_devices()]
    if name == "cuda" and any(n.startswith("cuda") for n in names):
        return "cuda:0"
    if name not in names:
        raise InputError(f"device is {name!r}; this machine has {', '.join(names)}.")
    return name

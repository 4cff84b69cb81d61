"""One step of the method: its passes in order, each a kernel over bonds or elements."""

from collections.abc import Iterator
from contextlib import contextmanager
from inspect import signature
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .arrays import DISSIPATION, OPTIONAL, PRECISIONS, Arrays
from .errors import InputError
from .friction import coulomb
from .kernels.algebra import space
from .kernels.box import strain_box
from .kernels.closing import UNKNOWN
from .kernels.contact import contact_energies, contact_forces, contact_settle
from .kernels.damping import damp, evm_dashpots
from .kernels.evm import (
    evm_angles,
    evm_closing,
    evm_closing_energies,
    evm_energies,
    evm_forces,
    evm_settle,
    evm_unlink,
)
from .kernels.facet import (
    facet_closing,
    facet_closing_energies,
    facet_energies,
    facet_forces,
    facet_settle,
    facet_unlink,
)
from .kernels.finite import (
    centre_openings,
    deformations,
    finite_forces,
    finite_return,
    finite_slip,
    kirchhoff_stresses,
    share_growth,
    true_stress,
)
from .kernels.fracture import break_beams, break_bonds, keep_nodes, log_breaks, part_interfaces
from .kernels.friction import HOLDS
from .kernels.lattice import lattice_angles, lattice_energies, lattice_forces
from .kernels.motion import NO_LOADS, Ends, element_energies, integrator_energies, move
from .kernels.plastic import dilation_books, evm_slips, facet_slip, numbers_type, radial_return
from .kernels.relaxation import PIECE, STEER, fire, fire_power, fire_steer, fire_sums
from .kernels.relink import LINKS, WAITS, drop_rest, heal_bonds, join_faces, link_bonds
from .kernels.stress import element_stress
from .kernels.viscous import (
    box_rates,
    branch_energies,
    branch_zz_energies,
    creep_books,
    facet_creep,
    facet_dashpots,
    mean_creep,
    mean_rates,
    opening_rates,
    remember_openings,
    retarded_energies,
    retarded_release,
    retarded_volume,
    trial_kick,
)
from .kernels.volume import face_dilation, volume_release, volume_stresses
from .kernels.wall import wall_energies, wall_forces, wall_settle
from .model import Model
from .neighbours import Neighbours
from .passes import Launched, Part, Passes, Team, Varying
from .patch import Patch
from .relinking import RelinkLog, WeldLog
from .wall import Mesh, turn_between

STEERING = 0.5  # share of the lacking force that a steered wall makes good for in a step
WELD_NUMBERS = "weld_pressure", "weld_time", "weld_work", "weld_strength"
SETTLEMENTS = 3  # rounds in which pairs that share an element pay what closing left over


class Step:
    """A model's arrays on a device and the passes over them.

    Between steps forces belong to the current places; velocities lag by a finishing half kick
    unless `synchronous`. A bond that breaks at the end of a step does so at that instant: the
    half kick before it has the old forces, the one after it the new.
    """

    # what a checkpoint leaves out of a step's own numbers: arrays have their place in it, these
    # are views of them
    not_saved = (
        *("arrays", "_views", "_nothings"),
        *("_energies", "_angles", "_stress_everywhere", "_relax", "_settle"),  # made when needed
    )
    addresses = ("wall_mesh",)  # arrays that hold no numbers but where things are on this device

    def __init__(
        self,
        model: Model,
        state: dict[str, NDArray],
        dt: float,
        precision: str = "float64",
        device: str = "cpu",
        simd: bool = True,
        slack: float = 0.0,
        local_damping: float = 0.0,
        touches: bool = True,
        team: Team | None = None,
    ) -> None:
        self.model, self.device, self.dt, self._slack = model, device, dt, slack
        self.local_damping = local_damping
        self.real, self.place = PRECISIONS[precision]
        self.count = 0
        self.synchronous = True
        self.integrator_released = 0.0
        self.servo_factors: dict[int, float] = {}  # of grips that a servo moves
        self.arrays = Arrays(self.real, self.place, device)
        self.arrays.waits = model.arrays() | state
        del self.arrays.waits["position"]  # places are displacements from it
        self.arrays.check_room(model.elements)
        if model.branch_time is not None:
            self.upload("branch_lost", -np.expm1(-dt / model.branch_time))
        if "retarded_time" in state:
            time = np.maximum(state["retarded_time"], 1e-300)
            self.upload("retarded_lost", -np.expm1(-dt / time))
        self._simd, self._team = simd, team
        self._space = space(model.features.dim, self.real), space(model.features.dim, self.place)
        self._energies: Passes | None = None
        self._angles: wp.Launch | None = None
        self._stress_everywhere: Passes | None = None
        self._relax: Passes | None = None
        self._patch = Patch(model, self.real, device)
        if model.interface_halves is not None and model.interface_bonds is not None:
            self._interface_rows = model.rows_of(model.interface_bonds)
            self._half_rows = model.rows_of(model.interface_halves)
        self._views: dict[str, tuple[wp.array, NDArray]] = {}
        self._settle: Passes | None = None
        self._nothings: dict[type, wp.array] = {}
        self.relinks, self.welds = RelinkLog(), WeldLog()
        self.neighbours: Neighbours | None = None
        self.wall_way = np.zeros(len(model.walls))  # that steered ones have gone [m]
        self._walls_posed = False
        self._meshes = self._build_meshes()
        # of a periodic box: now, and at the end of the next step
        fixed = model.contact_strain
        self.box_strains = np.zeros((2, model.features.dim, model.features.dim))
        if fixed is not None:
            self.box_strains[:] = fixed
        if model.contact is not None and touches:
            self.neighbours = Neighbours(model, self.arrays, *self._space, self.device)
        self.forget_gaps()
        self._bind_step()
        self._move_sides()
        self.set_factors()

    # -- the outline ------------------------------------------------------------------------------

    def advance(self, steps: int = 1) -> None:
        """From t to t + steps dt."""
        if self._needs_no_host and not self.synchronous:
            self._finish_and_start.launch(steps)
            self.count += steps
            return
        for _ in range(steps):
            self._advance()

    @property
    def _needs_no_host(self) -> bool:
        """Whether a step is its passes and nothing else: no pair to look for, no bond that may
        break or close, nothing that follows a history."""
        m = self.model
        follows = m.load_histories or m.grip_histories or m.strain_history is not None
        return self.neighbours is None and m.listed_bonds is None and not follows

    def _advance(self) -> None:
        """From t to t + dt (theory B13)."""
        # damp, move, evaluate forces, return stresses beyond yield, test for fracture
        (self._start if self.synchronous else self._finish_and_start).launch()
        if self.neighbours is not None:
            self._touch(moves=True)
            self._evaluate.launch()
        self.synchronous = False
        self.count += 1
        self.set_factors()
        if self.model.listed_bonds is not None and self._raised("any_crossed"):
            if self._settle is None:  # bound, compiled and given memory by the first step with it
                self._settle = self._bind_settle()
            self._settle.launch()
        if self.neighbours is not None and self._raised("any_touched"):
            self._settle_contact.launch()
        if "any_welded" in self.arrays and self._raised("any_welded"):
            self._note_welds()
        if self.model.criteria and self._raised("any_broken"):
            self.break_bonds()
        elif self.model.healing and self._raised("any_healed"):
            self.relink_bonds()

    def set_factors(self, time: float | None = None) -> None:
        """Loads as at this instant, grips' velocities as in the middle of the next step, and the
        strain of a periodic box as at its end."""
        now = self.count * self.dt if time is None else time
        if self.model.strain_history is not None:
            self.box_strains[0] = self.model.strain_history(now)
            self.box_strains[1] = self.model.strain_history(now + self.dt)
            self._write("box_strain", self.box_strains[1].ravel())
            self._move_sides()
        for name, histories, at in (
            ("load_factor", self.model.load_histories, now),
            ("grip_factor", self.model.grip_histories, now + 0.5 * self.dt),
        ):
            if histories:
                values = np.array([history(at) for history in histories], dtype=np.float64)
                if name == "grip_factor":
                    for grip, factor in self.servo_factors.items():
                        values[grip] = factor
                self._write(name, values)

    def _move_sides(self) -> None:
        """How far the edges of a periodic box have moved by its strains."""
        if self.neighbours is not None and self.model.contact_period is not None:
            for strain, name in zip(
                self.box_strains, ("contact_box_before", "contact_box"), strict=True
            ):
                self._write(name, (strain * self.model.contact_period).ravel())

    def evaluate_forces(self) -> None:
        """Forces and torques of all bonds at the current places."""
        self._forces.launch()
        if self.neighbours is not None:
            self._touch(moves=False)

    def _touch(self, moves: bool) -> None:
        """Forces of contacts, from a list of neighbours that holds for the current places.

        moves: whether this is the end of a step, and friction's springs go with it.
        """
        assert self.neighbours is not None
        if self.model.walls:
            self._pose_walls(moves)
        builds = self.neighbours.builds
        if self.neighbours.refresh(self.box_strains[int(moves)]):
            self._bind_contact()
        if self.neighbours.builds != builds:
            self._clear_contact()
        (self._contact if moves else self._contact_still).launch()

    def _clear_contact(self) -> None:
        """Nothing touches but what a new list will tell."""
        slots = self.model.features.slots
        for name in ("end_force", "end_torque"):
            array = self.arrays[name]
            array[array.size // slots * (slots - 1) :].zero_()  # the last slot is theirs
        self.arrays["contact_moment"].zero_()

    def _pose_walls(self, moves: bool) -> None:
        """Poses of walls at this instant, or at the end of a step and how they came there."""
        if self._walls_posed and all(w.stands for w in self.model.walls):
            return
        self._walls_posed = True
        before, dt = self.wall_poses(self.count), self.dt
        now = before
        if moves:
            self._steer_walls()
            now = self.wall_poses(self.count + 1)
        for name, poses in (("_before", before), ("", now)):
            self._write("wall_place" + name, np.ravel([p for p, _ in poses]))
            self._write("wall_turn" + name, np.ravel([q for _, q in poses]))
        pairs = list(zip(before, now, strict=True))
        self._write("wall_velocity", np.ravel([(b[0] - a[0]) / dt for a, b in pairs]))
        self._write("wall_spin", np.ravel([turn_between(a[1], b[1]) / dt for a, b in pairs]))

    def wall_poses(self, step: int) -> list[tuple[NDArray, NDArray]]:
        """Place [m], from the middle of the scene, and orientation of every wall at a step."""
        middle, pairs = self.model.contact_middle, zip(self.model.walls, self.wall_way, strict=True)
        if middle is None:
            return []
        poses = (wall.pose(step * self.dt, way) for wall, way in pairs)
        return [(place - middle, turn) for place, turn in poses]

    def _steer_walls(self) -> None:
        """Move steered walls by the force they lack over an impedance (docs/equations.md)."""
        for row, wall in enumerate(self.model.walls):
            steering = wall.steering
            if steering is not None:
                reaction = self.download("wall_reaction")[row].sum(axis=0, dtype=np.float64)
                wanted = steering.force * steering.history(self.count * self.dt)
                lack = wanted + float(reaction @ steering.direction)
                speed = STEERING * lack / self.model.contact_impedance
                speed = float(np.clip(speed, -steering.speed, steering.speed))
                self.wall_way[row] += speed * self.dt

    def _build_meshes(self) -> list[wp.Mesh]:
        """Walls' meshes, which Warp searches in float32; the walls' array of their ids."""
        meshes, ids = [], []
        for wall in self.model.walls:
            ids.append(0)
            if isinstance(wall.shape, Mesh):
                shape = wall.shape
                points = (shape.vertices - shape.place).astype(np.float32)
                mesh = wp.Mesh(
                    wp.array(points, dtype=wp.vec3, device=self.device),
                    wp.array(shape.faces.astype(np.int32).ravel(), dtype=int, device=self.device),
                )
                meshes.append(mesh)
                ids[-1] = mesh.id
        if meshes:
            self.arrays["wall_mesh"] = wp.array(ids, dtype=wp.uint64, device=self.device)
        return meshes

    def forget_gaps(self) -> None:
        """Start the books of unlinked pairs anew, after the state was overwritten."""
        for name in ("contact_dashpot", "wall_dashpot"):
            if name in self.arrays:
                self.arrays[name].zero_()
        if self.model.listed_bonds is not None:
            for name, value in (("closing_gap", UNKNOWN), ("closing_debt", 0.0)):
                self.arrays[name].fill_(value)

    def remember_springs(self) -> None:
        """Start the books of flow and creep anew, after forces were evaluated for a given state."""
        if self.model.yielding:
            for name in ("return_loss", "return_growth", "plastic_gradient"):
                if name in self.arrays:
                    self.arrays[name].zero_()
            if "return_factor" in self.arrays:
                self.arrays["return_factor"].fill_(1.0)
        if self.model.yielding or self.model.element_law is not None:
            self._remember.launch()

    @contextmanager
    def at_rest(self) -> Iterator[None]:
        """While it lasts, Kelvin and Voigt's dashpots are taken to have come to rest."""
        ids = self.model.retarded_elements
        if ids is None or not len(ids):
            yield
            return
        kept = {name: self.download(name) for name in ("volume_stiffness", "plastic_dilation")}
        relaxed = {name: value.copy() for name, value in kept.items()}
        relaxed["volume_stiffness"] -= self.download("retarded_stiffness")
        relaxed["plastic_dilation"][ids] = 0.0
        for name, value in relaxed.items():
            self.upload(name, value)
        try:
            yield
        finally:
            for name, value in kept.items():
                self.upload(name, value)

    def break_bonds(self) -> None:
        """Account for the bonds that broke at this instant, and go on without them.

        Only their neighbourhood is touched. Its finishing half kick is made with the old forces
        and, so that it can be made again later, unmade with the new ones.
        """
        self._fill_patch(self._broken())
        before = self._near_integrator_energy()
        assert isinstance(self._log, Varying)
        self._log.launched.set_param_by_name("step", self.count)
        for launch in self._break:
            launch.launch()
        self.integrator_released += before - self._near_integrator_energy()

    def _fill_patch(self, rows: NDArray[np.intp]) -> None:
        """Lists of what changes with these rows of the listed bonds, for the passes over them."""
        if self._patch.fill(rows):
            self._bind_patch()

    def _broken(self) -> NDArray[np.intp]:
        """Rows of the listed bonds that broke or softened just now."""
        listed = self.model.listed_bonds
        kept = self.look("bond_keep" if self.model.softens else "bond_linked")
        broken = (kept[listed] < 1.0) & (self.look("break_step")[listed] == -1)
        if self.model.interface_halves is not None:  # part as the face between them
            parts = kept[self.model.interface_bonds] < 1.0
            broken[self._half_rows[parts]] |= broken[self._interface_rows[parts], None]
        return np.flatnonzero(broken)

    def relink_bonds(self) -> None:
        """Link the bonds that were found to, at this instant, with the forces they have.

        As at a break, the finishing half kick is made before it and unmade after it.
        """
        rows = np.flatnonzero(self.arrays["healing_state"].numpy() == LINKS)
        self._note_links(rows)
        self._fill_patch(rows)
        before = self._near_integrator_energy()
        for launch in self._relink:
            launch.launch()
        self.integrator_released += before - self._near_integrator_energy()

    def _note_links(self, rows: NDArray[np.intp]) -> None:
        """Write down the links about to be made, and the breaks that these bonds come from."""
        link = {x: self.download("relink_" + x)[rows] for x in ("normal", "shear", "released")}
        last = {}
        if self.model.criteria:
            assert self.model.listed_bonds is not None
            last = {x: self.download("break_" + x)[rows] for x in ("normal", "shear", "energy")}
            last["step"] = self.download("break_step")[self.model.listed_bonds[rows]]
        self.relinks.add(rows, self.count, link, last)

    def _note_welds(self) -> None:
        """Write down which pairs have welded or broken at this instant."""
        assert self.neighbours is not None
        event = self.arrays["weld_event"]
        kinds = event.numpy()
        at, pairs = self.neighbours.entries(kinds != 0)
        columns = (self.arrays["weld_" + x].numpy()[at] for x in ("normal", "shear", "released"))
        self.welds.add(pairs, self.count, kinds[at], *columns)
        event.zero_()

    def welded(self) -> NDArray[np.int64]:
        """Pairs of elements that are welded now, (p, 2), the lower id first."""
        if self.neighbours is None or "contact_welded" not in self.arrays:
            return np.zeros((0, 2), dtype=np.int64)
        return self.neighbours.entries(self.arrays["contact_welded"].numpy() != 0)[1]

    def waiting(self) -> NDArray[np.int64]:
        """Listed bonds that meet their law of healing and lack the energy to link."""
        return np.flatnonzero(self.arrays["healing_state"].numpy() == WAITS)

    def start_relaxing(self) -> None:
        """Before steps of relaxation, with the forces at hand."""
        if self._relax is None:
            self._relax, self._relax_power = self._bind_relax()
        self._write("relaxing_state", np.array([STEER, 0.0]))
        self._relax_power.launch()

    def relax(self, steps: int) -> None:
        """So many steps of relaxation: v <- keep v + push M^-1 F, drift, evaluate forces."""
        assert self._relax is not None
        if self.neighbours is None:
            self._relax.launch(steps)
            return
        for _ in range(steps):
            self._relax.launch()
            self._touch(moves=False)
            self._relax_power.launch()

    def synchronise(self) -> None:
        """Bring velocities to the time of the places."""
        if not self.synchronous:
            self._finish.launch()
            self.synchronous = True

    def evaluate_stress(self) -> NDArray[np.float64]:
        """Average stress [Pa] of every element, (n, 4): xx, yy, xy, zz or (n, 6): xx, yy, zz, xy,
        yz, xz."""
        if self.model.bond_arm is None:
            return np.zeros((self.model.elements, 4 if self.model.features.dim == 2 else 6))
        if self._stress_everywhere is None:
            self.upload("all_elements", np.arange(self.model.elements, dtype=np.int32))
            if "stress" not in self.arrays:
                width = 4 if self.model.features.dim == 2 else 6
                self.upload("stress", np.zeros((self.model.elements, width)))
            self._stress_everywhere = self._passes(self._stress_passes("all_elements"))
        self._stress_everywhere.launch()
        return self.download("stress").astype(np.float64)

    def energies(self) -> dict[str, float]:
        """Kinetic, pair, volume, contact energy, what damping took, and the integrator's own
        term [J].

        Summed in float64. Call `synchronise` first.
        """
        if self._energies is None:
            self._energies = self._bind_energies()
        self._energies.launch()
        # of what slips took, plane strain keeps a part in the strain out of the plane
        locked = self._sum("locked_energy") if "locked_energy" in self.arrays else 0.0
        dissipated = self._taken(*DISSIPATION)
        volume = self._sum("volume_energy") if self.model.features.has_volume else 0.0
        contact = 0.0
        if self.model.listed_bonds is not None:
            linked = self.arrays["bond_linked"].numpy()[self.model.listed_bonds] > 0.0
            closing = self.arrays["closing_energy"].numpy()
            contact = float(closing.sum(where=~linked, dtype=np.float64))
        if self.neighbours is not None:
            self._contact_energies.launch()
            contact += self._sum("contact_energy")
        return {
            "kinetic": self._sum("kinetic_energy"),
            "pair": self._sum("linked_energy"),
            "volume": volume + locked,
            "contact": contact,
            "friction": self._taken("slip_energy", "closing_slip_energy"),
            "damping": self._taken("damped_energy", "dashpot_work", "restitution_energy"),
            "plastic": dissipated - locked if self.model.yielding else 0.0,
            "healing": self._taken("relink_energy"),
            "viscous": 0.0 if self.model.yielding else dissipated,
            "integrator": self._sum("integrator_energy") + self.integrator_released,
        }

    @property
    def work(self) -> float:
        """Work done so far by grips, loads and a periodic box [J]."""
        names = "element_work", "box_work", "contact_box_work", "dashpot_work", "wall_work"
        return self._taken(*names)

    def evaluate_angles(self) -> dict[str, NDArray[np.float64]]:
        """Twist and bend [rad] of every EVM bond, and its elongation over its length, (b,) each."""
        names = ("evm_twist", "evm_bend", "evm_elongation")
        if self._angles is None:
            (s, k), m, kinds = self._space, self.model, self.model.features.bond_kinds
            for name in names:
                self.upload(name, np.zeros(kinds * m.elements or m.evm_bonds))
            if kinds:
                law = lattice_angles(s, k, kinds, self._simd)
                self._angles = self._bind(law, m.elements, elements=m.elements)
            else:
                law = evm_angles(s, k, self._simd)
                self._angles = self._bind(law, m.evm_bonds, first_evm=m.facet_bonds)
        self._angles.launch()
        return {name: self._of_bonds(name) for name in names}

    def _of_bonds(self, name: str) -> NDArray[np.float64]:
        """Values of all bonds, (b,), in their order."""
        value, place = self.download(name).astype(np.float64), self.model.lattice_place
        return value if place is None else value[place]

    def bond_energy(self) -> NDArray[np.float64]:
        """Energy of every linked bond [J], (b,)."""
        self.energies()
        return self._of_bonds("linked_energy")

    def bond_forces(self) -> NDArray[np.float64]:
        """Force of every bond on its first element [N], (b, dim)."""
        place = self.model.lattice_place
        if place is None:
            place = self.model.bond_place[::2]
        return self.download("end_force")[place].astype(np.float64)

    # -- arrays -----------------------------------------------------------------------------------

    def upload(self, name: str, value: NDArray) -> None:
        """Put an array on the device under its name, or overwrite the one that is there."""
        self.arrays.put(name, value)

    def download(self, name: str) -> NDArray:
        """A copy of a device array in its shape."""
        return self.arrays.take(name)

    def memory(self) -> dict[str, int]:
        """Device memory of every array by name [B]."""
        patch = {f"patch_{name}": a for name, a in self._patch.items()}
        return {name: a.capacity for name, a in (self.arrays | patch).items()}

    @property
    def bytes(self) -> int:
        """Device memory of all arrays [B]."""
        return sum(self.memory().values())

    @property
    def kernels(self) -> list[str]:
        """Names of the kernels that a step launches, in order."""
        launches = list(self._finish_and_start.launches)
        if self.neighbours is not None:
            launches += self._contact.launches + self._evaluate.launches
        return [x.kernel.key.split("__")[-1] for x in launches]

    def restore(self, name: str, value: NDArray, shape: tuple[int, ...]) -> None:
        """Overwrite an array, bit by bit, by one that was kept; one that is not there is made."""
        if name not in self.arrays:
            self.arrays.shapes[name] = shape
            dtype = wp.dtype_from_numpy(value.dtype)
            self.arrays[name] = wp.array(value, dtype=dtype, device=self.device)
            return
        now = self.arrays[name].numpy()
        if now.dtype != value.dtype or now.shape != value.shape:
            raise InputError(
                f"{name} of the checkpoint is {value.dtype} {value.shape}, of this simulation "
                f"{now.dtype} {now.shape}; another warpdem, or another precision, wrote it."
            )
        self.arrays[name].assign(value)

    # -- passes -----------------------------------------------------------------------------------

    def _bind_step(self) -> None:
        half, forces, fracture = 0.5 * self.dt, self._force_passes(dt=self.dt), []
        # in an evaluation at given places time stands still
        self._forces = self._passes(self._force_passes() if self.model.ages else forces)
        flow = self._flow_passes()
        if self.model.element_law is not None:
            forces, flow = self._creep_passes()
        if self.model.criteria:
            fracture = self._fracture_passes()
        if self.model.healing:
            fracture += self._healing_passes()
        if self.model.criteria or self.model.healing:
            self._bind_patch()
        damping = self._damping_passes()
        box, boxed = self._box_passes()
        drift = self._move(0.0, half, drifts=True)
        evaluate = [*forces, *flow, *boxed, *fracture]
        if self.neighbours is not None:  # contacts are found between the drift and the forces
            self._bind_contact()
            self._evaluate, evaluate = self._passes(evaluate), []
        start = [*box, drift, *evaluate]
        self._finish = self._move(half, 0.0)
        self._start = self._passes([*damping, *start])
        if damping:
            self._finish_and_start = self._passes([self._finish, *damping, *start])
        else:
            self._finish_and_start = self._passes(
                [*box, self._move(half, half, drifts=True), *evaluate]
            )

    def _bind_contact(self) -> None:
        """Passes over the list of neighbours: forces as a step ends, forces of a given state, what
        closing and opening left over, energies."""
        (s, k), m = self._space, self.model
        assert self.neighbours is not None and m.contact is not None
        rows, walls = self.neighbours.rows, len(m.walls)
        restitution, touch = m.contact.restitution, m.touch
        given: dict[str, Any] = {"rows": rows, "walls": walls}
        kinds = frozenset() if m.wall_kind is None else frozenset(m.wall_kind.tolist())
        welding = m.contact.welding
        weld_numbers = dict.fromkeys(WELD_NUMBERS, 0.0)
        if welding is not None:
            weld_numbers = {x: getattr(welding, x.removeprefix("weld_")) for x in WELD_NUMBERS}
        law, on_walls = contact_forces(s, k, touch, walls > 0), wall_forces(s, k, kinds, touch)
        place = {"first_place": (m.features.slots - 1) * m.elements, "kinds": m.kinds}
        mu, both = coulomb(m.contact.friction), []
        own = {"rolling": m.contact.rolling_friction, "twisting": m.contact.twisting_friction}
        # at the end of a step the box is where it was to go, but else where it was before
        after = {"contact_box_after": self.arrays.get("contact_box")}
        still = {"contact_box": self.arrays.get("contact_box_before")}
        # at given places nothing moves that a dashpot would resist
        for dt, damping, sides in ((self.dt, m.contact.damping_ratio, {}), (0.0, 0.0, still)):
            numbers = {"dt": dt, "damping": damping, **place}
            more = {"friction": mu, **own, **weld_numbers}
            passes = [self._bind(law, rows, **more, **numbers, **sides)]
            if walls:
                passes.append(self._bind(on_walls, rows, **numbers, **given))
            both.append(self._passes(passes))
        self._contact, self._contact_still = both
        impulses = {
            "end_force": self.arrays["settling_impulse"],
            "end_torque": self.arrays["settling_twist"],
        }

        def settle(share: float) -> list[Launched]:
            numbers = {"restitution": restitution, "share": share}
            law = contact_settle(s, k, touch)
            paid = [self._bind(law, rows, dt=self.dt, **numbers, **still, **after)]
            if walls:
                law = wall_settle(s, k, kinds, touch)
                paid.append(self._bind(law, rows, **numbers, **given))
            return paid

        half = 0.5 * self.dt
        passes = [self._move(half, 0.0, elements="contact_elements")]
        for _ in range(SETTLEMENTS):
            passes += settle(1.0)
            passes.append(
                self._move(1.0, 0.0, elements="contact_elements", loads=impulses, ends=Ends(1))
            )
        passes += settle(0.0)
        passes.append(self._move(-half, 0.0, elements="contact_elements"))
        self._settle_contact = self._passes(passes)
        if "contact_energy" not in self.arrays:
            self.upload("contact_energy", np.zeros(rows))
        law = contact_energies(s, k, touch)
        passes = [self._bind(law, rows, **still)]
        if walls:
            passes.append(self._bind(wall_energies(s, k, kinds, touch), rows, **given))
        self._contact_energies = self._passes(passes)

    def _damping_passes(self) -> list[Launched]:
        (s, k), m, f = self._space, self.model, self.model.features
        is_local = self.local_damping > 0.0
        if not (f.has_dashpots or is_local or f.absorbs):
            return []
        self.upload("damped_energy", np.zeros(m.elements))
        law = damp(
            s,
            k,
            f.ends,
            f.external,
            f.has_moments,
            f.has_work,
            f.has_dashpots,
            is_local,
            f.absorbs,
            self._simd,
        )
        numbers: dict[str, Any] = {
            "local_damping": self.local_damping,
            "dt": self.dt,
            "elements": m.elements,
        }
        passes = [self._bind(law, m.elements, **numbers)]
        if f.has_evm_dashpots:
            law = evm_dashpots(s, k, self._simd)
            passes.insert(0, self._bind(law, m.evm_bonds, first_evm=m.facet_bonds))
        return [*self._dashpot_passes(), *passes]

    def _dashpot_passes(self) -> list[Launched]:
        """Forces of the dashpots beside the springs of facet bonds."""
        (s, k), m, f = self._space, self.model, self.model.features
        if not f.has_retardation:
            return []
        has_box = m.box_bonds is not None
        rates = opening_rates(s, k, f.faces, has_box, self._simd)
        means = self._bind(mean_rates(s, f.slots, self._simd), m.elements, elements=m.elements)
        first, second = (
            self._bind(
                facet_dashpots(s, k, f.faces, has_box, is_second, self._simd),
                m.facet_bonds,
                dt=self.dt,
            )
            for is_second in (False, True)
        )
        law = trial_kick(s, k, Ends(f.slots), f.has_moments, self._simd)
        trial = self._bind(law, m.elements, dt=self.dt, elements=m.elements)
        tried = {
            "velocity": self.arrays["trial_velocity"],
            "angular_velocity": self.arrays["trial_spin"],
        }
        passes = [self._bind(rates, m.facet_bonds), means, first, trial]
        passes += [self._bind(rates, m.facet_bonds, **tried), means, second]
        if m.box_bonds is not None:
            law = box_rates(s, k, self._simd)
            passes.insert(0, self._bind(law, len(m.box_bonds), dt=self.dt))
        return passes

    def _creep_passes(self) -> tuple[list[Launched], list[Launched]]:
        """Forces at new places, to which branches have crept, and the books of that."""
        (s, k), m, f = self._space, self.model, self.model.features
        trial = face_dilation(s, k, f.faces, False, self._simd)
        forces = [self._bind(trial, m.bonds, listed=None, first=0)]
        openings: list[Launched] = []
        books: list[Launched] = []
        changes: list[Launched] = []
        if f.branches:
            means = mean_creep(s, f.slots, f.plane, f.branches, self._simd)
            creep = facet_creep(s, k, f.faces, f.branches, self._simd)
            forces.append(self._bind(means, m.elements, elements=m.elements))
            forces.append(self._bind(creep, m.facet_bonds, facets=m.facet_bonds))
            openings.append(self._bind(remember_openings(s, k, f.faces, self._simd), m.facet_bonds))
            for passes, share in ((books, 1.0), (changes, 0.0)):
                law = creep_books(s, self._simd)
                passes.append(self._bind(law, m.facet_bonds, share=share))
        if f.has_retardation:
            forces.append(self._retarded(is_at_rest=False))
            openings += [self._retarded(is_at_rest=True), *self._force_passes()]
        if f.has_dilation:
            across = self._bind(dilation_books(s, self._simd), len(self._flowing))
            books.append(across)
            changes.append(across)
        self._creep_changes = changes
        self._remember = self._passes([*openings, *changes])
        return [*forces, *self._force_passes(has_dilations=True, dt=self.dt)], books

    def _retarded(self, is_at_rest: bool) -> Launched:
        m = self.model
        assert m.retarded_elements is not None
        law = retarded_volume(self._space[0], m.features.slots, is_at_rest, self._simd)
        return self._bind(law, len(m.retarded_elements), elements=m.elements)

    def _box_passes(self) -> tuple[list[Launched], list[Launched]]:
        """Motion of the sides of a periodic box before elements move, and its work after."""
        if self.model.box_bonds is None:
            return [], []
        count = len(self.model.box_bonds)
        before, after = (
            self._bind(strain_box(*self._space, is_after, self._simd), count)
            for is_after in (False, True)
        )
        return [before], [after]

    def _flow_passes(self) -> list[Launched]:
        """Return of stresses beyond yield, the slips that this leaves, forces after them."""
        (s, k), m, f = self._space, self.model, self.model.features
        passes, numbers = [], numbers_type(s)
        if not m.yielding:
            return []
        if f.finite_strain:
            law = kirchhoff_stresses(s, k, f.faces, f.slots, self._simd)
            passes.append(self._bind(law, m.elements, elements=m.elements))
        for group in m.yielding:
            if f.finite_strain:
                law = finite_return(s, k, f.plane, group.flow, self._simd)
            else:
                law = radial_return(s, k, f.faces, f.slots, f.plane, group.flow, self._simd)
            given: dict[str, Any] = {"elements": m.elements, "first": group.first, "dt": self.dt}
            given["numbers"] = numbers(*group.numbers)
            passes.append(self._bind(law, group.count, **given))
        if f.finite_strain:
            law = share_growth(s, k, f.faces, f.slots, f.plane, self._simd)
            numbers_given: dict[str, Any] = {"bonds": m.bonds, "elements": m.elements}
            passes.append(self._bind(law, len(self._flowing), **numbers_given))
        books = []
        mean = {"return_mean": self.arrays["mean_stress" if f.keeps_mean else "return_mean"]}
        if m.facet_bonds:
            if f.finite_strain:
                law = finite_slip(s, k, f.faces, f.evaluates_anew, self._simd)
            else:
                law = facet_slip(s, k, f.faces, f.has_dilation, f.evaluates_anew, self._simd)
            books.append(self._bind(law, m.facet_bonds, **mean))
        if m.evm_bonds:
            law = evm_slips(s, k, f.faces, f.has_dilation, self._simd)
            books.append(self._bind(law, m.evm_bonds, first_evm=m.facet_bonds, **mean))
        passes += books
        if f.evaluates_anew:
            passes += self._force_passes(has_dilations=True)
        if f.has_dilation:
            books.append(self._bind(dilation_books(s, self._simd), len(self._flowing)))
            passes.append(books[-1])
        self._remember = self._passes(books)
        return passes

    @property
    def _flowing(self) -> NDArray[np.int32]:
        assert self.model.flow_elements is not None
        return self.model.flow_elements

    def _bind_settle(self) -> Passes:
        """Passes that pay what closing and opening pairs left over, at synchronous velocities."""
        (s, k), f, half = self._space, self.model.features, 0.5 * self.dt
        impulses = {
            "end_force": self.arrays["closing_impulse"],
            "end_torque": self.arrays["closing_twist"],
        }
        laws = (
            facet_settle(s, k, f.faces),
            evm_settle(s, k, f.faces.has_slip),
        )
        passes = [self._move(half, 0.0, elements="listed_elements")]
        for _ in range(SETTLEMENTS):
            passes += self._over_listed(*laws, share=1.0)
            passes.append(self._move(1.0, 0.0, elements="listed_elements", loads=impulses))
        passes += self._over_listed(*laws, share=0.0)
        passes.append(self._move(-half, 0.0, elements="listed_elements"))
        return self._passes(passes)

    def _fracture_passes(self) -> list[Launched]:
        """Stress of the elements whose bonds may break, and the test of each criterion."""
        (s, k), m = self._space, self.model
        passes = []
        if any(group.test.needs_stress for group in m.criteria):
            passes.append(self._stress("listed_elements"))
        for group in m.criteria:
            time, exponent = group.rate
            given: dict[str, Any] = {"time": time, "exponent": exponent, "dt": self.dt}
            given |= {f"number_{n + 1}": x for n, x in enumerate(group.numbers)}
            given |= {"first": group.first, "listed": self.arrays["listed_bonds"]}
            assert m.listed_bonds is not None
            ids = m.listed_bonds[group.first : group.first + group.count]
            given["first_bond"], is_contiguous = int(ids[0]), bool((np.diff(ids) == 1).all())
            if group.test.needs_stress:
                law = break_bonds(s, k, m.features.faces, group.test, is_contiguous, self._simd)
            else:
                law = break_beams(s, group.test, is_contiguous, self._simd)
                given["first_evm"] = m.facet_bonds
            passes.append(self._bind(law, group.count, **given))
        return passes

    def _bind_break(self) -> None:
        """Passes of a step in which bonds broke, over the neighbourhood of these."""
        (s, _), m, f, half = self._space, self.model, self.model.features, 0.5 * self.dt
        patch = self._patch
        passes = [
            self._move(half, 0.0, near=True),
            *self._interfaces(part_interfaces(s, m.softens, self._simd)),
            *self._pair_energies(near=True),
            *self._drop_rest(),
            *self._closing_energies(near=True),
        ]
        if f.has_volume:
            release = volume_release(
                s, f.slots, f.keeps_mean, f.has_dilation, m.softens, self._simd
            )
            plane_strain = float(f.plane_strain)
            laws: list[tuple[wp.Kernel, dict[str, Any]]] = [
                (release, {"plane_strain": plane_strain})
            ]
            if f.has_retardation:
                out, back = (retarded_release(s, f.slots, x, self._simd) for x in (False, True))
                laws = [(out, {}), *laws, (back, {})]
            for law, numbers in laws:
                numbers |= {"elements": m.elements, "listed": self._patch["elements"]}
                passes.append(self._bind(law, patch.elements, **numbers))
        self._log = self._bind(
            log_breaks(s, f.has_volume, m.softens, self._simd),
            patch.bonds,
            rows=self._patch["rows"],
            listed=self.arrays["listed_bonds"],
            linked_energy=self._patch["linked_energy"],
            step=0,
        )
        passes += [self._log, *self._unlink()]
        passes += self._interfaces(keep_nodes(*self._space, f.faces, self._simd))
        passes += self._force_passes(near=True)
        # stresses after the break are what the next flow starts from
        if m.element_law is not None:
            passes += self._creep_changes
        elif f.has_dilation:
            passes.append(self._bind(dilation_books(s, self._simd), len(self._flowing)))
        self._break = [*passes, self._move(-half, 0.0, near=True)]

    def _interfaces(self, law: wp.Kernel) -> list[Launched]:
        """A pass over the bonds that may break between unlike elements."""
        return [self._bind(law, self.model.interfaces)] if self.model.interfaces else []

    def _bind_patch(self) -> None:
        """Passes over what a break or a link touches."""
        self._near_integrator = self._integrator_energies(near=True)
        if self.model.criteria:
            self._bind_break()
        if self.model.healing:
            self._bind_relink()

    def _healing_passes(self) -> list[Launched]:
        """The test of each law of healing."""
        (s, k), tests = self._space, []
        for group in self.model.healing:
            law = group.law
            numbers = {"pressure": law.pressure, "time": law.time, "work": law.work, "dt": self.dt}
            given: dict[str, Any] = {"listed": self.arrays["listed_bonds"], "first": group.first}
            kernel = heal_bonds(s, k, *self._healing_kind)
            tests.append(self._bind(kernel, group.count, **numbers, **given))
        return tests

    @property
    def _healing_kind(self) -> tuple[Any, ...]:
        m, f = self.model, self.model.features
        return f.faces, f.has_volume, m.faces_rub, bool(m.criteria)

    def _bind_relink(self) -> None:
        """Passes of a step in which bonds linked, over the neighbourhood of these."""
        (s, k), m, f, half = self._space, self.model, self.model.features, 0.5 * self.dt
        law = link_bonds(s, k, *self._healing_kind, "break_damage" in self.arrays)
        relink = [
            self._move(half, 0.0, near=True),
            self._bind(law, m.facet_listed, listed=self.arrays["listed_bonds"]),
        ]
        if f.has_volume:
            sizes: dict[str, Any] = {"listed": self._patch["elements"]}
            sizes |= {"plane_strain": float(f.plane_strain), "elements": m.elements}
            relink.append(self._bind(join_faces(s, f.slots), self._patch.elements, **sizes))
        self._relink = [
            *relink,
            *self._force_passes(near=True),
            self._move(-half, 0.0, near=True),
        ]

    def _drop_rest(self) -> list[Launched]:
        """Bonds that broke just now lose the rest state that a link made again had."""
        m, f = self.model, self.model.features
        if not m.healing:
            return []
        law = drop_rest(*self._space, f.has_volume)
        return [self._bind(law, self._patch.facets, listed=self._patch["bonds"])]

    def _bind_energies(self) -> Passes:
        (s, k), m, f = self._space, self.model, self.model.features
        for name in ("kinetic_energy", "integrator_energy"):
            self.upload(name, np.zeros(m.elements))
        self.upload("linked_energy", np.zeros(f.bond_kinds * m.elements or m.bonds))
        if f.has_volume:
            self.upload("volume_energy", np.zeros(m.elements))
        has_zz = bool(m.yielding) and f.plane_strain
        if has_zz:
            self.upload("locked_energy", np.zeros(m.elements))
        law = element_energies(s, k, f.has_moments, f.has_volume, has_zz, self._simd)
        passes = [
            self._bind(law, m.elements),
            self._integrator_energies(),
            *self._pair_energies(),
            *self._closing_energies(),
        ]
        if f.branches and f.plane is not None:
            law = branch_zz_energies(s, f.plane, f.branches, self._simd)
            passes.append(self._bind(law, m.elements, elements=m.elements))
        if m.retarded_elements is not None and f.has_retardation:
            law = retarded_energies(s, self._simd)
            passes.append(self._bind(law, len(m.retarded_elements)))
        return self._passes(passes)

    def _bind_relax(self) -> tuple[Passes, wp.Launch]:
        (s, k), m, f = self._space, self.model, self.model.features
        for name in ("power", "kinetic", "force"):
            self.upload("relaxing_" + name, np.zeros(m.elements))
        pieces = -(-m.elements // PIECE)
        self.upload("relaxing_mix", np.zeros(2))
        self.upload("relaxing_state", np.zeros(2))
        self.upload("relaxing_sums", np.zeros((pieces, 3)))
        sums = self._bind(fire_sums(s), pieces, elements=m.elements)
        steer = self._bind(fire_steer(s), 1, pieces=pieces, dt=self.dt)
        push, power = (
            self._bind(
                law(s, k, f.ends, f.external, f.has_moments, self._simd),
                m.elements,
                elements=m.elements,
            )
            for law in (fire, fire_power)
        )
        drift = self._move(0.0, 0.0, drifts=True)
        passes = [sums, steer, push, drift, *self._force_passes()]
        if self.neighbours is None:
            passes.append(power)
        return self._passes(passes), power

    def _force_passes(
        self, near: bool = False, has_dilations: bool = False, dt: float = 0.0
    ) -> list[Launched]:
        """Forces of all bonds, or of those near bonds that changed.

        has_dilations: the faces' dilations are at hand, as nothing has moved since; dt: the step
        that ends there, 0 at given places.
        """
        (s, k), m, f = self._space, self.model, self.model.features
        if f.finite_strain:
            return self._finite_passes(has_dilations, dt)
        if f.bond_kinds:
            law = lattice_forces(s, k, f.bond_kinds, f.large_rotation, self._simd)
            return [self._bind(law, m.elements, elements=m.elements)]
        bonds: int | Part = m.bonds
        facets: int | Part = m.facet_bonds
        evm: int | Part = m.evm_bonds
        elements: int | Part = m.elements
        changed, listed, listed_elements = (None, None, None)
        if near:
            bonds, elements = self._patch.bonds, self._patch.elements
            facets, evm = self._patch.near_facets, self._patch.near_evm
            names = "bonds", "near_bonds", "elements"
            changed, listed, listed_elements = (self._patch[x] for x in names)
        passes = []
        if f.has_volume:
            if not has_dilations:
                law = face_dilation(s, k, f.faces, near, self._simd)
                passes.append(self._bind(law, bonds, listed=changed, first=0))
            law = volume_stresses(s, f.slots, f.keeps_mean, f.has_dilation, near, self._simd)
            numbers: dict[str, Any] = {"elements": m.elements, "first": 0}
            passes.append(self._bind(law, elements, listed=listed_elements, **numbers))
        has_facets, has_evm = self._laws(near)
        if has_facets:
            law = facet_forces(s, k, f.faces, f.has_volume, f.has_bending, near, self._simd)
            passes.append(self._bind(law, facets, listed=listed, first=0))
        if has_evm:
            law = evm_forces(
                s, k, f.faces, f.has_volume, f.large_rotation, m.breaks_beams, near, self._simd
            )
            numbers = {"first": m.facet_bonds, "first_evm": m.facet_bonds}
            passes.append(self._bind(law, evm, listed=listed, **numbers))
        return passes + self._closing(dt)

    def _finite_passes(self, has_openings: bool, dt: float) -> list[Launched]:
        """Forces of all bonds, of facets alone, at finite strain."""
        (s, k), m, f = self._space, self.model, self.model.features
        passes = []
        if not has_openings:
            passes.append(self._bind(centre_openings(s, k, f.faces, self._simd), m.bonds))
        law = deformations(s, k, f.faces, f.slots, f.has_offset, self._simd)
        passes.append(self._bind(law, m.elements, elements=m.elements))
        passes.append(self._bind(finite_forces(s, k, f.faces, f.has_bending, self._simd), m.bonds))
        return passes + self._closing(dt)

    def _closing(self, dt: float) -> list[Launched]:
        """Unlinked pairs resist closing, and rub where the scene has friction.

        dt: in which faces that have a state slide; 0 holds them.
        """
        (s, k), m, f = self._space, self.model, self.model.features
        friction = 0.0 if m.contact is None else coulomb(m.contact.friction)
        if self._slack > 0.0:  # faces that friction holds are the stiffest
            friction = HOLDS
        ages = m.faces_rub and m.ages and self._slack == 0.0
        by_kind = m.faces_rub and m.contact_kind is not None and self._slack == 0.0
        return self._over_listed(
            facet_closing(s, k, f.faces, m.faces_rub, ages, by_kind, self._touch_law),
            evm_closing(s, k, f.faces.has_slip, m.faces_rub, ages, by_kind),
            kinds=m.kinds,
            slack=self._slack,
            friction=friction,
            dt=dt,
        )

    @property
    def _touch_law(self) -> str | None:
        """By which law elements touch, or None."""
        contact = self.model.contact
        return None if self.neighbours is None or contact is None else contact.law

    def _over_listed(
        self, facet_law: wp.Kernel, evm_law: wp.Kernel, near: bool = False, **given: Any
    ) -> list[Launched]:
        """A pass of each law over the listed bonds that follow it, or those of them that changed.

        The latter are rows of the list, and bonds, in order.
        """
        m = self.model
        if m.listed_bonds is None:
            return []
        facets: int | Part = m.facet_listed
        evm: int | Part = len(m.listed_bonds) - m.first_beam
        given = {"listed": self.arrays["listed_bonds"], "rows": None} | given
        if near:
            facets, evm = self._patch.facets, self._patch.evm
        passes = []
        if m.facet_listed:
            passes.append(self._bind(facet_law, facets, **given))
        if len(m.listed_bonds) > m.first_beam:
            numbers: dict[str, Any] = {"first": m.first_beam, "first_evm": m.facet_bonds}
            passes.append(self._bind(evm_law, evm, **numbers, **given))
        return passes

    def _unlink(self) -> list[Launched]:
        (s, _), f, softens = self._space, self.model.features, self.model.softens
        return self._over_listed(
            facet_unlink(s, f.has_volume, f.has_bending, softens, self._simd),
            evm_unlink(s, f.has_volume, f.has_evm_dashpots, softens, self._simd),
            near=True,
            listed=self._patch["bonds"],
        )

    def _closing_energies(self, near: bool = False) -> list[Launched]:
        (s, k), m = self._space, self.model
        if m.listed_bonds is not None and "closing_energy" not in self.arrays:
            self.upload("closing_energy", np.zeros(len(m.listed_bonds)))
        return self._over_listed(
            facet_closing_energies(
                s, k, m.features.faces, m.faces_rub, self._touch_law, near, self._simd
            ),
            evm_closing_energies(s, k, m.features.faces.has_slip, m.faces_rub, near, self._simd),
            near=near,
            rows=self._patch["rows"] if near else None,
        )

    def _move(
        self,
        finish: float,
        start: float,
        drifts: bool = False,
        elements: str | None = None,
        loads: dict[str, wp.array] | None = None,
        ends: Ends | None = None,
        near: bool = False,
    ) -> Launched:
        (s, k), m, f = self._space, self.model, self.model.features
        external = f.external if loads is None else NO_LOADS  # impulses come without them
        law = move(
            s,
            k,
            ends or f.ends,
            external,
            f.has_moments,
            f.has_work,
            f.has_grips,
            drifts,
            elements is not None or near,
            self._simd,
        )
        numbers: dict[str, Any] = {
            "finish": finish,
            "start": start,
            "dt": self.dt,
            "elements": m.elements,
        }
        numbers |= {"first": 0, **(loads or {})}
        if near:
            listed = self._patch["near_elements"]
            return self._bind(law, self._patch.near_elements, listed=listed, **numbers)
        listed = None if elements is None else self.arrays[elements]
        count = m.elements if listed is None else listed.size
        return self._bind(law, count, listed=listed, **numbers)

    def _stress_passes(self, listed: str) -> list[Launched]:
        """Stress of elements, by the forces in their slots; on a lattice worked out into such."""
        m, f = self.model, self.model.features
        if not f.bond_kinds:
            return [self._stress(listed)]
        (s, k), slots, spins = self._space, f.slots * m.elements, 1 if f.dim == 2 else 3
        self.upload("slot_force", np.zeros((slots, f.dim)))
        self.upload("slot_torque", np.zeros((slots, spins)))
        ends = {"end_force": self.arrays["slot_force"], "end_torque": self.arrays["slot_torque"]}
        law = evm_forces(s, k, f.faces, False, f.large_rotation, False, False, self._simd)
        forces = self._bind(law, m.bonds, listed=None, first=0, first_evm=0, **ends)
        return [forces, self._stress(listed, **ends)]

    def _stress(self, listed: str, **ends: wp.array) -> Launched:
        (s, k), m, f = self._space, self.model, self.model.features
        if f.finite_strain:
            law = true_stress(s, k, f.faces, f.slots, f.plane, self._simd)
        else:
            touches = m.contact is not None
            law = element_stress(
                s, k, f.faces, f.slots, f.has_volume, f.plane_strain, touches, self._simd
            )
        ids = self.arrays[listed]
        return self._bind(law, ids.size, listed=ids, elements=m.elements, **ends)

    def _pair_energies(self, near: bool = False) -> list[Launched]:
        """Energies of all bonds, or of those that changed."""
        (s, k), m, f = self._space, self.model, self.model.features
        if f.bond_kinds:
            energies = lattice_energies(s, k, f.bond_kinds, f.large_rotation, self._simd)
            return [self._bind(energies, m.elements, elements=m.elements)]
        facets: int | Part = m.facet_bonds
        evm: int | Part = m.evm_bonds
        given: dict[str, Any] = {"listed": None}
        if near:
            facets, evm = self._patch.facets, self._patch.evm
            given["linked_energy"] = self._patch["linked_energy"]
            given["listed"] = self._patch["bonds"]
        has_facets, has_evm = self._laws(near)
        passes = []
        if has_facets:
            law = facet_energies(s, k, f.faces, f.has_bending, near, self._simd)
            passes.append(self._bind(law, facets, **given))
            if f.branches:
                law = branch_energies(s, f.branches, near, self._simd)
                passes.append(self._bind(law, facets, facets=m.facet_bonds, **given))
        if has_evm:
            law = evm_energies(s, k, f.faces.has_slip, f.large_rotation, near, self._simd)
            numbers: dict[str, Any] = {"first": m.facet_bonds, "first_evm": m.facet_bonds}
            passes.append(self._bind(law, evm, **numbers, **given))
        return passes

    def _laws(self, near: bool) -> tuple[bool, bool]:
        """Whether there are facet bonds and EVM bonds; near: that are or may be unlinked."""
        m = self.model
        if not near or m.listed_bonds is None:
            return m.facet_bonds > 0, m.evm_bonds > 0
        return m.facet_listed > 0, len(m.listed_bonds) > m.first_beam

    def _integrator_energies(self, near: bool = False) -> Launched:
        (s, k), m, f = self._space, self.model, self.model.features
        law = integrator_energies(s, k, f.ends, f.external, f.has_moments, near, self._simd)
        given: dict[str, Any] = {"dt": self.dt, "elements": m.elements, "listed": None}
        if not near:
            return self._bind(law, m.elements, **given)
        given["listed"] = self._patch["near_elements"]
        given["integrator_energy"] = self._patch["integrator_energy"]
        return self._bind(law, self._patch.near_elements, **given)

    def _near_integrator_energy(self) -> float:
        self._near_integrator.launch()
        return self._patch.integrator_energy()

    def _raised(self, name: str) -> bool:
        """Whether a pass raised a flag; lowers it."""
        flag = self.arrays[name]
        if not flag.device.is_cpu:
            raised = bool(flag.numpy()[0])
            flag.zero_()
            return raised
        view = self._view(name)
        raised, view[0] = bool(view[0]), 0
        return raised

    def _write(self, name: str, values: NDArray) -> None:
        """Overwrite a small array, without a detour on a CPU."""
        array = self.arrays[name]
        if not array.device.is_cpu:
            self.upload(name, values)
            return
        self._view(name)[:] = values

    def _taken(self, *names: str) -> float:
        return sum(self._sum(name) for name in names if name in self.arrays)

    def _sum(self, name: str) -> float:
        return float(self.look(name).sum(dtype=np.float64))

    def look(self, name: str) -> NDArray:
        """An array's flat values to be read at once: its memory itself on a CPU, else a copy."""
        return self._view(name) if self.device == "cpu" else self.arrays[name].numpy()

    def _view(self, name: str) -> NDArray:
        """An array's memory itself, on a CPU."""
        array, known = self.arrays[name], self._views.get(name)
        if known is None or known[0] is not array:
            known = self._views[name] = array, array.numpy()
        return known[1]

    def _nothing(self, array_type: wp.array) -> wp.array:
        """An array that stands for one that a kernel does not use.

        Given None instead, a vectorised CPU kernel runs at half its speed (Warp 1.19).
        """
        dtype = array_type.dtype
        if dtype not in self._nothings:
            self._nothings[dtype] = wp.zeros(1, dtype=dtype, device=self.device)
        return self._nothings[dtype]

    def _passes(self, launches: list[Launched]) -> Passes:
        return Passes(list(launches), self.device, self._team)

    def _bind(self, kernel, dim: int | Part, **given: Any) -> Launched:
        """A recorded launch whose arguments are found by name; over a part, one that varies.

        Kernel argument, model or state array and exported field are one word.
        """
        inputs = []
        for name, parameter in signature(kernel.func).parameters.items():
            value = given.get(name)
            if name not in given and (name in self.arrays or name not in OPTIONAL):
                value = self.arrays[name]
            inputs.append(self._nothing(parameter.annotation) if value is None else value)
        size = 1 if isinstance(dim, Part) else dim
        launch = wp.launch(kernel, dim=size, inputs=inputs, device=self.device, record_cmd=True)
        return Varying(launch, dim) if isinstance(dim, Part) else launch


def gathered(step: Step) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Force [N] and torque [N m] that the bonds exert on every element, summed in float64."""
    n, before = step.model.elements, step.model.lattice_before
    names = "end_force", "end_torque"
    ends = (step.look(x).reshape(-1, n, step.arrays.shapes[x][-1]) for x in names)
    force, torque = (x.astype(np.float64) for x in ends)
    if before is None:
        return force.sum(axis=0), torque.sum(axis=0)
    far = (x.reshape(-1, x.shape[-1])[before].sum(axis=0) for x in (force, torque))
    return force.sum(axis=0) - next(far), torque[-1] + next(far)

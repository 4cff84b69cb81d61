"""One step of the method: its passes in order, each a kernel over bonds or elements."""

from inspect import signature

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .kernels.algebra import space
from .kernels.evm import evm_closing, evm_energies, evm_forces
from .kernels.facet import facet_closing, facet_energies, facet_forces
from .kernels.fracture import break_bonds, log_breaks
from .kernels.motion import element_energies, move
from .kernels.stress import element_stress
from .kernels.volume import face_dilation, volume_release, volume_stresses
from .model import PLACES, Model

# arithmetic of forces, arithmetic of places
PRECISIONS = {
    "float64": (wp.float64, wp.float64),
    "float32": (wp.float32, wp.float32),
    "mixed": (wp.float32, wp.float64),
}


class Step:
    """A model's arrays on a device and the passes over them.

    Between steps forces belong to the current places; velocities lag by a finishing half kick
    unless `synchronous`. A bond that breaks at the end of a step does so at that instant: the
    half kick before it has the old forces, the one after it the new.
    """

    def __init__(
        self,
        model: Model,
        state: dict[str, NDArray],
        dt: float,
        precision: str = "float64",
        device: str = "cpu",
        simd: bool = True,
    ) -> None:
        self.model, self.device, self.dt = model, device, dt
        self.real, self.place = PRECISIONS[precision]
        self.count = 0
        self.synchronous = True
        self.integrator_released = 0.0
        self._shapes: dict[str, tuple[int, ...]] = {}
        self.arrays: dict[str, wp.array] = {}
        for name, value in (model.arrays() | state).items():
            if name != "position" and name != "body":
                self.upload(name, value)
        self._bind_passes(simd)
        self._broken = self.arrays["any_broken"].numpy() if model.criteria else np.zeros(1)

    # -- the outline ------------------------------------------------------------------------------

    def advance(self) -> None:
        """From t to t + dt (theory B13)."""
        (self._start if self.synchronous else self._finish_and_start).launch()
        self.synchronous = False
        self.count += 1
        self.evaluate_forces()
        if self._fracture:
            for a_pass in self._fracture:
                a_pass.launch()
            if self._any_broken():
                self._break_now()

    def evaluate_forces(self) -> None:
        """Forces and torques of all bonds at the current places."""
        for a_pass in self._forces:
            a_pass.launch()

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
        if "all_elements" not in self.arrays:
            self.upload("all_elements", np.arange(self.model.elements, dtype=np.int32))
            if "stress" not in self.arrays:
                width = 4 if self.model.features.dim == 2 else 6
                self.upload("stress", np.zeros((self.model.elements, width)))
            self._stress_everywhere = self._stress("all_elements")
        self._stress_everywhere.launch()
        return self.download("stress").astype(np.float64)

    def energies(self) -> dict[str, float]:
        """Kinetic, pair, volume energy and the integrator's own term [J], summed in float64.

        Call `synchronise` first.
        """
        self._measure_elements()
        pair = self._pair_energies()
        total = {"kinetic": self._sum("kinetic_energy"), "pair": float(pair.sum())}
        total["volume"] = self._sum("volume_energy") if self.model.features.has_volume else 0.0
        total["integrator"] = self._sum("integrator_energy")
        return total

    # -- arrays -----------------------------------------------------------------------------------

    def upload(self, name: str, value: NDArray) -> None:
        """Put an array on the device under its name, or overwrite the one that is there."""
        if value.dtype.kind in "iu":
            dtype = wp.int32
        else:
            dtype = self.place if name in PLACES else self.real
        flat = np.ascontiguousarray(value, dtype=wp.dtype_to_numpy(dtype)).ravel()
        if name in self.arrays:
            self.arrays[name].assign(flat)
        else:
            self._shapes[name] = value.shape
            self.arrays[name] = wp.array(flat, dtype=dtype, device=self.device)

    def download(self, name: str) -> NDArray:
        """A copy of a device array in its shape."""
        return np.array(self.arrays[name].numpy()).reshape(self._shapes[name])

    @property
    def bytes(self) -> int:
        """Device memory of all arrays [B]."""
        return sum(a.capacity for a in self.arrays.values())

    # -- passes -----------------------------------------------------------------------------------

    def _bind_passes(self, simd: bool) -> None:
        m, f = self.model, self.model.features
        s, k = space(f.dim, self.real), space(f.dim, self.place)
        n, evm = m.elements, {"first": m.facet_bonds, "first_evm": m.facet_bonds}
        links = () if f.has_unlinked else ("bond_linked",)
        volumes = () if f.has_volume else ("volume_stress",)
        weights = () if f.has_volume else ("bond_weight",)

        self._forces = []
        if f.has_volume:
            dilation = face_dilation(s, k, f.has_unlinked, simd)
            gather = volume_stresses(s, f.slots, simd)
            self._forces += [
                self._bind(dilation, m.bonds, links, first=0),
                self._bind(gather, n, elements=n, first=0),
            ]
        if m.facet_bonds:
            law = facet_forces(s, k, f.has_volume, f.has_unlinked, simd)
            unused = (*links, *volumes, *weights)
            self._forces.append(self._bind(law, m.facet_bonds, unused, first=0))
        if m.evm_bonds:
            law = evm_forces(s, k, f.has_volume, f.has_unlinked, simd)
            unused = (*links, *volumes, *weights, *(() if f.has_volume else ("bond_arm",)))
            self._forces.append(self._bind(law, m.evm_bonds, unused, **evm))
        if m.listed_bonds is not None:
            listed = {"listed": self.arrays["listed_bonds"]}
            if m.facet_listed:
                law = facet_closing(s, k)
                self._forces.append(self._bind(law, m.facet_listed, **listed, first=0))
            evm_listed = len(m.listed_bonds) - m.facet_listed
            if evm_listed:
                law = evm_closing(s, k)
                at = listed | evm | {"first": m.facet_listed}
                self._forces.append(self._bind(law, evm_listed, **at))

        half = 0.5 * self.dt
        moves = {
            drifts: move(s, k, f.slots, f.has_external, f.has_work, drifts, simd)
            for drifts in (True, False)
        }
        absent = () if f.has_external else ("external_force",)
        absent += () if f.has_work else ("element_work",)

        def bind_move(finish: float, start: float, drifts: bool) -> wp.Launch:
            numbers = {"finish": finish, "start": start, "dt": self.dt, "elements": n, "first": 0}
            return self._bind(moves[drifts], n, absent, **numbers)

        self._start = bind_move(0.0, half, True)
        self._finish_and_start = bind_move(half, half, True)
        self._finish = bind_move(half, 0.0, False)
        self._space = s, k
        self._fracture = []
        if m.criteria:
            self._bind_fracture()

    def _bind_fracture(self) -> None:
        (s, k), m, f = self._space, self.model, self.model.features
        listed = self.arrays["listed_bonds"]
        self._fracture = [self._stress("listed_elements")]
        for group in m.criteria:
            test = break_bonds(s, k, group.kind)
            numbers = {"ratio": group.ratio, "first": group.first, "listed": listed}
            self._fracture.append(self._bind(test, group.count, **numbers))
        self._release = None
        if f.has_volume:
            elements = self.arrays["listed_elements"]
            self._release = self._bind(
                volume_release(s, f.slots),
                elements.size,
                listed=elements,
                plane_strain=float(f.plane_strain),
                elements=m.elements,
            )
        self._pair_energies()  # allocates and binds what the log of breaks reads
        unused = () if f.has_volume else ("element_release",)
        numbers = {"listed": listed, "step": 0}
        self._log = self._bind(log_breaks(s, f.has_volume), listed.size, unused, **numbers)

    def _break_now(self) -> None:
        """Account for the bonds that broke at this instant, then go on without them."""
        self._finish.launch()
        self.synchronous = True
        self._measure_elements()
        before = self._sum("integrator_energy")
        self._pair_energies()
        if self._release is not None:
            self._release.launch()
        self._log.set_param_by_name("step", self.count)
        self._log.launch()
        self.evaluate_forces()
        self._measure_elements()
        self.integrator_released += before - self._sum("integrator_energy")

    def _any_broken(self) -> bool:
        flag = self.arrays["any_broken"]
        if flag.device.is_cpu:  # the NumPy view shares the memory
            broken, self._broken[0] = bool(self._broken[0]), 0
            return broken
        broken = bool(flag.numpy()[0])
        flag.zero_()
        return broken

    def _stress(self, listed: str) -> wp.Launch:
        (s, k), m, f = self._space, self.model, self.model.features
        law = element_stress(s, k, f.slots, f.has_volume, f.plane_strain)
        unused = () if f.has_volume else ("volume_stress",)
        ids = self.arrays[listed]
        return self._bind(law, ids.size, unused, listed=ids, elements=m.elements)

    def _pair_energies(self) -> NDArray[np.float64]:
        """Energy of every bond in its present state, linked or unlinked [J]."""
        (s, k), m, f = self._space, self.model, self.model.features
        if "linked_energy" not in self.arrays:
            self.upload("linked_energy", np.zeros(m.bonds))
            unused: tuple[str, ...] = ()
            if f.has_unlinked:
                self.upload("unlinked_energy", np.zeros(m.bonds))
            else:
                unused = ("unlinked_energy", "facet_closing_stiffness")
            self._energies = []
            if m.facet_bonds:
                law = facet_energies(s, k, f.has_unlinked)
                self._energies.append(self._bind(law, m.facet_bonds, unused, first=0))
            if m.evm_bonds:
                law = evm_energies(s, k, f.has_unlinked)
                at = {"first": m.facet_bonds, "first_evm": m.facet_bonds}
                self._energies.append(self._bind(law, m.evm_bonds, unused, **at))
        for a_pass in self._energies:
            a_pass.launch()
        energy = self.arrays["linked_energy"].numpy().astype(np.float64)
        if f.has_unlinked:
            linked = self.arrays["bond_linked"].numpy()[: m.bonds] == 1.0
            energy = np.where(linked, energy, self.arrays["unlinked_energy"].numpy())
        return energy

    def _measure_elements(self) -> None:
        (s, _), m, f = self._space, self.model, self.model.features
        if "kinetic_energy" not in self.arrays:
            for name in ("kinetic_energy", "integrator_energy"):
                self.upload(name, np.zeros(m.elements))
            unused: tuple[str, ...] = () if f.has_external else ("external_force",)
            if f.has_volume:
                self.upload("volume_energy", np.zeros(m.elements))
            else:
                unused += ("volume_energy", "volume_stiffness", "volume_stress")
            law = element_energies(s, f.slots, f.has_volume, f.has_external)
            numbers = {"dt": self.dt, "elements": m.elements}
            self._elements = self._bind(law, m.elements, unused, **numbers)
        self._elements.launch()

    def _sum(self, name: str) -> float:
        return float(self.arrays[name].numpy().sum(dtype=np.float64))

    def _bind(self, kernel, dim: int, unused: tuple[str, ...] = (), **given) -> wp.Launch:
        """A recorded launch whose arguments are found by name; `unused` ones are left out.

        Kernel argument, model or state array and exported field are one word.
        """
        inputs = []
        for name in signature(kernel.func).parameters:
            if name in given:
                inputs.append(given[name])
            else:
                inputs.append(None if name in unused else self.arrays[name])
        return wp.launch(kernel, dim=dim, inputs=inputs, device=self.device, record_cmd=True)

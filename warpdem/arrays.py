"""Arrays of a step on a device: which there may be, in which precision, and in how much memory."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .errors import InputError
from .model import PLACES
from .room import host_memory

# arrays that kernels name and only some scenes have
OPTIONAL = frozenset(
    {
        *("bond_arm", "bond_jump", "bond_weight", "facet_bending", "element_two_shear"),
        *("volume_stress", "volume_stiffness", "volume_energy", "element_release"),
        *("element_work", "evm_dashpot", "damping_force", "damping_torque", "absorbing_damping"),
        *("external_force", "external_torque", "timed_force", "timed_torque", "load_factor"),
        *("grip", "grip_velocity", "grip_spin", "grip_factor"),
        *("principal_moment", "principal_axes"),
        *("bond_slip", "evm_slip", "evm_tilt", "return_growth", "return_mean"),
        *("mean_stiffness", "mean_stress"),
        *("plastic_dilation", "plastic_strain_zz", "locked_energy"),
        *("hardening_strain", "hardening_stress", "plastic_strain"),
        *("bond_keep", "break_damage", "softening_end", "beam_load"),
        *("interface_place", "lattice_before"),
        *("branch_zz", "element_dissipation", "jump_rate", "dashpot_work"),
        *("trial_force", "plastic_growth_zz"),
        *("closing_shear", "closing_slip", "closing_spring", "closing_slip_energy"),
        *("any_moved", "contact_radius", "contact_width", "contact_compliance", "contact_image"),
        *("contact_box", "contact_box_before", "contact_box_after"),
        *("contact_welded", "contact_pressed", "contact_worked", "weld_event", "weld_normal"),
        *("weld_shear", "weld_released", "weld_energy", "any_welded"),
        *("contact_box_work", "contact_moment", "contact_spring", "contact_opened", "slip_energy"),
        *("friction_numbers", "contact_theta", "wall_theta", "closing_theta"),
        *("contact_kind", "friction_table"),
        *("restitution_energy", "contact_dashpot", "wall_dashpot"),
        *("contact_roll", "wall_roll", "wall_rolling", "wall_twisting"),
        *("rest_dilation", "break_energy", "break_step", "bond_strength", "bond_face"),
        *("healing_weight", "healing_strength"),
        *("wall_mesh", "wall_first_face", "face_place", "wall_opened", "wall_spring"),
    }
)
# sums over many steps, what flows by little in one, and walls' places, in float64 always
DISSIPATION = ("bond_dissipation", "element_dissipation")
SUMS = frozenset(
    {
        *("element_work", "box_work", "damped_energy", "dashpot_work", *DISSIPATION),
        *("branch_slip", "branch_zz", "branch_share", "branch_lost", "last_opening"),
        *("retarded_dilation", "retarded_lost", "last_element_dilation"),
        *("weld_energy", "relaxing_sums", "relaxing_state"),
        *("contact_position", "contact_box_work", "slip_energy", "restitution_energy", "wall_work"),
        *("closing_slip_energy", "relink_energy", "healing_start"),
        *("wall_shape", "face_place"),
        *("wall_place", "wall_place_before", "wall_turn", "wall_turn_before"),
        *("friction_numbers", "contact_theta", "wall_theta", "closing_theta"),
    }
)
# arithmetic of forces, arithmetic of places
PRECISIONS = {
    "float64": (wp.float64, wp.float64),
    "float32": (wp.float32, wp.float32),
    "mixed": (wp.float32, wp.float64),
}


def free_memory(device: str) -> int | None:
    """Memory that a device has left [B], or None where the system does not tell."""
    found = wp.get_device(device)
    if not found.is_cpu:
        return int(found.free_memory)
    return host_memory()


class Arrays(dict[str, wp.array]):
    """Arrays on a device by name; one that `waits` is put there when it is first asked for.

    real, place: types of the arithmetic of forces and of places.
    """

    def __init__(self, real: type, place: type, device: str) -> None:
        super().__init__()
        self._real, self._place, self._device = real, place, device
        self.waits: dict[str, NDArray] = {}
        self.shapes: dict[str, tuple[int, ...]] = {}

    def __missing__(self, name: str) -> wp.array:
        self.put(name, self.waits.pop(name))
        return self[name]

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or name in self.waits

    def get(self, name: str, default: Any = None) -> Any:
        """The array, or `default` if there is none."""
        return self[name] if name in self else default  # noqa: SIM401

    def put(self, name: str, value: NDArray) -> None:
        """Put an array on the device, or overwrite the one that is there."""
        if name in self.waits:
            self.waits[name] = value
        elif name in self and self[name].device.is_cpu:
            self[name].numpy()[:] = self.flat(name, value)
        elif name in self:
            self[name].assign(self.flat(name, value))
        else:
            self.shapes[name] = value.shape
            flat, dtype = self.flat(name, value), self._dtype(name, value)
            self[name] = wp.array(flat, dtype=dtype, device=self._device)

    def take(self, name: str) -> NDArray:
        """A copy of an array in its shape."""
        if name in self.waits:
            value = self.waits[name]
            return np.array(self.flat(name, value)).reshape(value.shape)
        return np.array(self[name].numpy()).reshape(self.shapes[name])

    def flat(self, name: str, value: NDArray) -> NDArray:
        """A value as it is on the device."""
        dtype = wp.dtype_to_numpy(self._dtype(name, value))
        return np.ascontiguousarray(value, dtype=dtype).ravel()

    def _dtype(self, name: str, value: NDArray) -> type:
        if value.dtype.kind in "iu":
            return wp.int32
        if name in SUMS:
            return wp.float64
        return self._place if name in PLACES else self._real

    def check_room(self, elements: int) -> None:
        """Raise InputError if the device has not the memory for all that waits."""
        needed = 0
        for name, value in self.waits.items():
            needed += value.size * wp.types.type_size_in_bytes(self._dtype(name, value))
        free = free_memory(self._device)
        if free is not None and needed > free:
            raise InputError(
                f"this scene of {elements} elements needs up to {needed / 1e9:.3g} GB on "
                f"{self._device!r}, which has {free / 1e9:.3g} GB free: take fewer elements, "
                "precision='float32', which halves it, or another device."
            )

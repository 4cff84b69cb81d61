"""What a change of some bonds touches, as lists on the device."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .model import Model
from .passes import Part

LISTS = ("rows", "bonds", "elements", "near_bonds", "near_elements")
ENERGIES = {"bonds": "linked_energy", "near_elements": "integrator_energy"}  # beside lists
LEAST = 256  # entries of a list that has grown


class Patch(dict[str, wp.array]):
    """The neighbourhood of bonds that break, soften or link at an instant.

    Lists by name, as long as any has had to be: `rows` and `bonds`, those bonds as rows of the
    listed ones and as bonds; `elements`, theirs; `near_bonds`, all bonds whose forces change with
    them; `near_elements`, the elements of these. Beside them `linked_energy` of `bonds` and
    `integrator_energy` of `near_elements`. A `Part` tells how much of a list is filled.
    """

    def __init__(self, model: Model, real: type, device: str) -> None:
        super().__init__()
        self._views: dict[str, NDArray] = {}  # on a CPU, of the same memory
        self._model, self._real, self._device = model, real, device
        f = model.features
        # forces on an element's other bonds change as well where its volume has an energy
        self._spreads = f.has_volume or f.finite_strain
        self.facets, self.evm, self.bonds, self.elements = Part(), Part(), Part(), Part()
        self.near_facets, self.near_evm, self.near_elements = Part(), Part(), Part()
        if model.listed_bonds is not None:
            self._grow(dict.fromkeys(LISTS, 1))

    def _grow(self, sizes: dict[str, int]) -> bool:
        """Make room; whether any list is another array now, which passes are to be bound to."""
        short = [name for name, size in sizes.items() if name not in self or self[name].size < size]
        for name in short:
            size = max(2 * sizes[name], LEAST)
            self[name] = wp.zeros(size, dtype=wp.int32, device=self._device)
            energy = ENERGIES.get(name)
            if energy is not None:
                self[energy] = wp.zeros(size, dtype=self._real, device=self._device)
        if short and wp.get_device(self._device).is_cpu:
            self._views = {name: array.numpy() for name, array in self.items()}
        return bool(short)

    def integrator_energy(self) -> float:
        """Of the elements near the bonds [J]."""
        name = "integrator_energy"
        energy = self._views[name] if name in self._views else self[name].numpy()
        return float(energy[: self.near_elements.count].sum(dtype=np.float64))

    def fill(self, rows: NDArray[np.intp]) -> bool:
        """Of the bonds of these rows of the listed ones, in order; whether arrays had to grow."""
        m = self._model
        assert m.listed_bonds is not None
        bonds = m.listed_bonds[rows]
        elements = self._ends(bonds)
        near, near_elements = self._near(bonds, elements)
        lists: dict[str, NDArray] = {"rows": rows, "bonds": bonds, "elements": elements}
        lists |= {"near_bonds": near, "near_elements": near_elements}
        has_grown = self._grow({name: len(ids) for name, ids in lists.items()})
        for name, ids in lists.items():
            self._write(name, ids)
        for facets, evm, ids in (
            (self.facets, self.evm, bonds),
            (self.near_facets, self.near_evm, near),
        ):
            facets.count = evm.first = int((ids < m.facet_bonds).sum())
            evm.count = len(ids) - facets.count
        self.bonds.count, self.elements.count = len(bonds), len(elements)
        self.near_elements.count = len(near_elements)
        return has_grown

    def _ends(self, bonds: NDArray[np.int32]) -> NDArray[np.int32]:
        """Elements of bonds."""
        return np.unique(np.concatenate([self._model.bond_i[bonds], self._model.bond_j[bonds]]))

    def _near(self, bonds: NDArray, elements: NDArray) -> tuple[NDArray, NDArray]:
        """Bonds whose forces change with these bonds of these elements, and their elements."""
        if not self._spreads:
            return bonds, elements
        near = np.unique(self._model.incidence[:, elements] >> 1)
        near = near[near < self._model.bonds]
        return near, self._ends(near)

    def _write(self, name: str, ids: NDArray) -> None:
        if name in self._views:
            self._views[name][: len(ids)] = ids
        elif len(ids):
            given = wp.array(ids.astype(np.int32), device=self._device)
            wp.copy(self[name], given, count=len(ids))

"""What a change of some bonds touches, as lists on the device."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .model import Model
from .passes import Part


class Patch:
    """The neighbourhood of bonds that break, soften or link at an instant.

    Arrays among those of the step, as long as they can get: `patch_rows` and `patch_bonds`, those
    bonds as rows of the listed ones and as bonds; `patch_elements`, theirs; `patch_near_bonds`, all
    bonds whose forces change with them; `patch_near_elements`, the elements of these. A scene that
    has a part of a list tells how much of it is filled.
    """

    def __init__(self, model: Model, arrays: dict[str, wp.array], device: str) -> None:
        assert model.listed_bonds is not None and model.listed_elements is not None
        self._model, self._arrays, self._device = model, arrays, device
        f, listed = model.features, len(model.listed_bonds)
        # forces on an element's other bonds change as well where its volume has an energy
        self._spreads = f.has_volume or f.finite_strain
        most = {"rows": listed, "bonds": listed, "elements": len(model.listed_elements)}
        near, near_elements = self._near(model.listed_bonds, model.listed_elements)
        most |= {"near_bonds": len(near), "near_elements": len(near_elements)}
        for name, size in most.items():
            arrays["patch_" + name] = wp.zeros(size, dtype=wp.int32, device=device)
        # on a CPU, views of the same memory
        names = most if wp.get_device(device).is_cpu else ()
        self._views = {x: arrays["patch_" + x].numpy() for x in names}
        self.facets, self.evm, self.bonds, self.elements = Part(), Part(), Part(), Part()
        self.near_facets, self.near_evm, self.near_elements = Part(), Part(), Part()

    def fill(self, rows: NDArray[np.intp]) -> None:
        """Of the bonds of these rows of the listed ones, in order."""
        m = self._model
        assert m.listed_bonds is not None
        bonds = m.listed_bonds[rows]
        elements = self._ends(bonds)
        near, near_elements = self._near(bonds, elements)
        lists: dict[str, NDArray] = {"rows": rows, "bonds": bonds, "elements": elements}
        lists |= {"near_bonds": near, "near_elements": near_elements}
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
            wp.copy(self._arrays["patch_" + name], given, count=len(ids))

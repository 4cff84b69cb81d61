"""The list of elements near each other: when it is built anew, and in how much memory."""

from typing import Any

import numpy as np
import warp as wp

from .errors import NonFiniteError, first_ids
from .kernels.algebra import Laws
from .kernels.neighbours import (
    carry_over,
    list_neighbours,
    part_pairs,
    place_elements,
    watch_motion,
)
from .model import Model

ROOM = 1.3  # of the list's memory over what it needs when it is made
FARTHEST = 1e8  # places over the size of a cell that the grid can count
CELLS = {2: 512, 3: 64}  # most along an axis; the grid wraps round


class Neighbours:
    """Pairs of elements nearer than their radii and a skin, but those that bonds join (B11),
    or joined and have not parted since.

    The arrays it makes live among those of the step: `contact_start` (m + 1,), the rows of the
    elements that may touch; over the rows' entries `contact_neighbour`, `contact_reference` (from
    element to neighbour in the reference state), `contact_debt`, `contact_impulse`, and, where they
    are asked for, `contact_spring`, `contact_theta` and `contact_opened`. They grow as the list
    does.
    """

    def __init__(
        self, model: Model, arrays: dict[str, wp.array], s: Laws, k: Laws, device: str
    ) -> None:
        assert model.contact is not None and model.contact_elements is not None
        assert model.contact_radius is not None
        self._model, self._arrays, self._device = model, arrays, device
        self._s, self._k = s, k
        self.rows = len(model.contact_elements)
        radius = model.contact_radius[model.contact_elements]
        self.skin = model.contact.skin * float(np.median(radius))
        self._greatest = float(radius.max())
        self._has_friction = model.rubs
        self._ages = model.ages
        self._has_restitution = model.contact.restitution < 1.0
        self._has_parting = model.listed_bonds is not None
        dim = model.features.dim
        most = int(min(CELLS[dim], max(4, 2 * self.rows ** (1.0 / dim))))
        self._grid = wp.HashGrid(
            most, most, most if dim == 3 else 1, device=device, dtype=wp.float64
        )
        self._new("contact_place", self.rows, wp.vec3d)
        self._new("listed_displacement", dim * self.rows, k.real)
        for name in ("any_moved", "any_lost"):
            self._new(name, 1, wp.int32)
        for name in ("contact_start", "neighbour_count"):
            self._new(name, self.rows + 1, wp.int32)
        self.capacity = 0
        self.builds = 0
        self._grow(0)
        arrays["any_moved"].fill_(1)  # there is no list yet
        names = "contact_elements", "displacement", "listed_displacement", "any_moved"
        inputs: list[Any] = [*(arrays[name] for name in names), 0.5 * self.skin]
        law = watch_motion(k)
        self._watch = wp.launch(law, self.rows, inputs, device=device, record_cmd=True)

    def refresh(self) -> bool:
        """Build the list anew if something has moved too far for it; whether its arrays are new
        ones, to which launches have to be bound again."""
        if self.builds:
            self._watch.launch()
        moved = self._arrays["any_moved"]
        if not moved.numpy()[0]:
            return False
        moved.zero_()
        return self.build()

    def build(self) -> bool:
        """Build the list for the places as they are; whether its arrays are new ones."""
        a, k = self._arrays, self._k
        reach = 2.0 * self._greatest + self.skin
        inputs: list[Any] = [a["contact_elements"], a["contact_position"], a["displacement"]]
        inputs += [a["contact_place"], a["listed_displacement"], a["any_lost"], FARTHEST * reach]
        self._launch(place_elements(k), inputs)
        if a["any_lost"].numpy()[0]:
            self._refuse(FARTHEST * reach)
        self._grid.build(a["contact_place"], reach)
        if self._has_parting:
            names = (
                *("listed_bonds", "bond_i", "bond_j", "contact_position", "contact_radius"),
                *("displacement", "bond_linked", "closing_gap", "closing_stiffness"),
            )
            inputs = [*(a[name] for name in names), self.skin]
            law = part_pairs(self._s, k)
            wp.launch(law, dim=a["listed_bonds"].size, inputs=inputs, device=self._device)
        old = {
            name: wp.clone(a["contact_" + name])
            for name in ("start", "neighbour", "debt", "spring", "theta")
            if "contact_" + name in a
        }
        self._list(fills=False)
        wp.utils.array_scan(a["neighbour_count"], a["contact_start"], inclusive=False)
        needed = int(a["contact_start"].numpy()[-1])
        grows = needed > self.capacity
        if grows:
            self._grow(int(ROOM * needed) + 16)
        self._list(fills=True)
        law = carry_over(self._s, self._has_friction, self._has_restitution, self._ages)
        inputs = [a["contact_start"], a["contact_neighbour"]]
        inputs += [old["start"], old["neighbour"], old["debt"], old.get("spring"), old.get("theta")]
        inputs += [a["contact_debt"], a["contact_impulse"]]
        inputs += [a.get("contact_opened"), a.get("contact_spring"), a.get("contact_theta")]
        self._launch(law, inputs)
        self.builds += 1
        return grows

    def reserve(self, capacity: int) -> None:
        """Make new arrays for so many entries; launches have to be bound to them."""
        self._grow(capacity)

    def pairs(self) -> np.ndarray:
        """Element ids of the listed pairs, (p, 2), lower id first, sorted."""
        start = self._arrays["contact_start"].numpy()
        neighbour = self._arrays["contact_neighbour"].numpy()[: start[-1]]
        assert self._model.contact_elements is not None
        own = np.repeat(self._model.contact_elements, np.diff(start))
        pairs = np.stack([own, neighbour], axis=1)[own < neighbour]
        return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]

    def _list(self, fills: bool) -> None:
        a = self._arrays
        names = ("elements", "place", "position", "radius")
        inputs: list[Any] = [self._grid.id, *(a["contact_" + x] for x in names)]
        inputs += [a["bonded_start"], a["bonded"], a.get("bonded_listed")]
        inputs += [a.get("closing_stiffness"), self._greatest, self.skin]
        inputs += [a["neighbour_count"]]
        inputs += [a["contact_" + x] for x in ("start", "neighbour", "reference")]
        law = list_neighbours(self._s, self._k, self._has_parting, fills)
        self._launch(law, inputs)

    def _grow(self, capacity: int) -> None:
        self.capacity = capacity
        dim, most = self._model.features.dim, max(capacity, 1)
        self._new("contact_neighbour", most, wp.int32)
        self._new("contact_reference", dim * most, self._k.real)
        self._new("contact_debt", most, self._s.real)
        self._new("contact_impulse", most, self._s.real)
        if self._has_friction:
            self._new("contact_spring", dim * most, self._s.real)
        if self._ages:
            self._new("contact_theta", most, wp.float64)
        if self._has_restitution:
            self._new("contact_opened", most, wp.int32)

    def _new(self, name: str, size: int, dtype: type) -> None:
        self._arrays[name] = wp.zeros(size, dtype=dtype, device=self._device)

    def _launch(self, kernel: wp.Kernel, inputs: list[Any]) -> None:
        wp.launch(kernel, dim=self.rows, inputs=inputs, device=self._device)

    def _refuse(self, limit: float) -> None:
        self._arrays["any_lost"].zero_()
        place = self._arrays["contact_place"].numpy()
        bad = ~(np.abs(place) <= limit).all(axis=1)
        assert self._model.contact_elements is not None
        lost = np.zeros(self._model.elements, dtype=bool)
        lost[self._model.contact_elements[bad]] = True
        raise NonFiniteError(
            f"elements {first_ids(lost)} are nowhere near the others (not finite, or beyond "
            f"{limit:.3g} m from their middle); the list of neighbours was not built."
        )

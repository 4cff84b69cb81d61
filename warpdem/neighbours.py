"""The list of elements near each other: when it is built anew, and in how much memory."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .errors import Array, InputError, NonFiniteError, first_ids
from .kernels.algebra import Laws
from .kernels.neighbours import (
    carry_over,
    find_neighbours,
    hand_over,
    list_neighbours,
    part_pairs,
    place_elements,
    sort_places,
    watch_motion,
)
from .model import Model

ROOM = 1.3  # of the list's memory over what it needs when it is made
SPARE = 4  # neighbours that a row may have more of than in the last list, before it is sought twice
FARTHEST = 1e8  # places over the size of a cell that the grid can count
MOST = {2: 1024, 3: 128}  # cells along an axis; they wrap round
# what a pair knows of itself, which goes over to a new list
HISTORY = ("debt", "spring", "theta", "dashpot", "roll", "welded", "pressed", "worked")
PER_ROW = 4  # cells for an element at most


class Neighbours:
    """Pairs of elements nearer than their radii and a skin, but those that bonds join (B11),
    or joined and have not parted since.

    The arrays it makes live among those of the step: `contact_start` (m + 1,), the rows of the
    elements that may touch; over the rows' entries `contact_neighbour`, `contact_reference` (from
    element to neighbour in the reference state), `contact_debt`, `contact_impulse`, and, where they
    are asked for, `contact_image` (of a periodic box), `contact_spring`, `contact_theta`,
    `contact_dashpot`, `contact_roll`, `contact_opened`, and of welds `contact_welded`,
    `contact_pressed`, `contact_worked` and what has just happened to them, `weld_event` and so on.
    They grow as the list does.
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
        self._reach = 2.0 * self._greatest + self.skin
        self._touch = model.touch
        self._has_parting = model.listed_bonds is not None
        self._is_periodic = model.contact_period is not None
        self._is_strained = self._is_periodic and model.strain_history is not None
        dim = model.features.dim
        self._strain = np.zeros((dim, dim))  # of the box for which the list was built
        self._new("contact_place", self.rows, wp.vec3d)
        self._new("cell_place", self.rows, wp.vec3d)
        self._new("listed_displacement", dim * self.rows, k.real)
        for name in ("any_moved", "any_lost", "any_over"):
            self._new(name, 1, wp.int32)
        for name in ("contact_start", "neighbour_count", "found_start"):
            self._new(name, self.rows + 1, wp.int32)
        for name in ("cell_of", "cell_row"):  # the sort takes twice the room
            self._new(name, 2 * self.rows, wp.int32)
        self._new("cell_start", 1, wp.int32)
        self._shape_cells(self._strain)
        self._make_room(np.zeros(self.rows, dtype=np.int64))
        self.capacity = 0
        self.builds = self.searches = 0
        self._grow(0)
        arrays["any_moved"].fill_(1)  # there is no list yet
        names = "contact_elements", "contact_place", "displacement", "listed_displacement"
        inputs: list[Any] = [*(arrays[name] for name in (*names, "any_moved"))]
        inputs += [0.5 * self.skin, wp.mat33d()]
        law = watch_motion(k, self._is_strained)
        self._watch = wp.launch(law, self.rows, inputs, device=device, record_cmd=True)

    def refresh(self, strain: Array) -> bool:
        """Build the list anew if something has moved too far for it; whether its arrays are new
        ones, to which launches have to be bound again. strain: of a periodic box now."""
        if self.builds:
            if self._is_strained:
                # of places; images beyond a side move with the box, which goes by as much
                first = np.eye(len(strain)) + self._strain
                change = (strain - self._strain) @ np.linalg.inv(first)
                stretch = float(np.linalg.norm(change, 2)) * self._reach
                self._watch.set_param_by_name("limit", 0.5 * max(self.skin - stretch, 0.0))
                self._watch.set_param_by_name("strain", _solid(change))
            self._watch.launch()
        moved = self._arrays["any_moved"]
        if not moved.numpy()[0]:
            return False
        moved.zero_()
        return self.build(strain)

    def build(self, strain: Array | None = None) -> bool:
        """Build the list for the places as they are; whether its arrays are new ones. strain: of a
        periodic box, by default that of the last list."""
        a, k = self._arrays, self._k
        if strain is not None and self._is_periodic:
            self._strain = np.array(strain)
            self._shape_cells(self._strain)
        inputs: list[Any] = [a["contact_elements"], a["contact_position"], a["displacement"]]
        inputs += [a["contact_place"], a["listed_displacement"], a["cell_of"], a["cell_row"]]
        limit = FARTHEST * self._reach
        inputs += [a["any_lost"], limit, self._to_cells, wp.vec3i(*self._cells)]
        self._launch(place_elements(k), inputs)
        if a["any_lost"].numpy()[0]:
            self._refuse(limit)
        wp.utils.radix_sort_pairs(a["cell_of"], a["cell_row"], self.rows)
        self._launch(
            sort_places(),
            [
                *(a["cell_" + x] for x in ("of", "row")), a["contact_place"],
                *(a["cell_" + x] for x in ("place", "start")), self.rows, int(np.prod(self._cells)),
            ],
        )  # fmt: skip
        if self._has_parting:
            given = (
                *("listed_bonds", "bond_i", "bond_j", "contact_position", "contact_radius"),
                *("displacement", "bond_linked", "listed_image", "closing_gap"),
            )
            inputs = [*(a.get(name) for name in given), a["closing_stiffness"]]
            inputs += [self.skin, self._edges]
            law = part_pairs(self._s, k, self._is_periodic)
            wp.launch(law, dim=a["listed_bonds"].size, inputs=inputs, device=self._device)
        old = {
            name: wp.clone(a["contact_" + name])
            for name in ("start", "neighbour", *HISTORY)
            if "contact_" + name in a
        }
        self._find()
        wp.utils.array_scan(a["neighbour_count"], a["contact_start"], inclusive=False)
        needed = int(a["contact_start"].numpy()[-1])
        grows = needed > self.capacity
        if grows:
            self._grow(int(ROOM * needed) + 16)
        inputs = [a["contact_elements"], a["contact_position"], a["displacement"]]
        inputs += [a["found_start"], a["found"], a["contact_start"], a["contact_neighbour"]]
        inputs += [a["contact_reference"], a.get("contact_image"), self._period, self._to_shares]
        self._launch(list_neighbours(k, self._is_periodic), inputs)
        inputs = [a["contact_start"], a["contact_neighbour"], old["start"], old["neighbour"]]
        inputs += [*(old.get(x) for x in HISTORY), a["contact_impulse"], a.get("contact_opened")]
        inputs += [*(a.get("contact_" + x) for x in HISTORY), a.get("weld_event")]
        self._launch(carry_over(self._s, self._touch), inputs)
        if self._has_parting:
            names = "bonded_start", "bonded", "bonded_listed", "closing_gap", "closing_debt"
            inputs = [a["contact_start"], a["contact_neighbour"], *(a[x] for x in names)]
            self._launch(hand_over(self._s), [*inputs, a["contact_debt"]])
        self.builds += 1
        return grows

    def reserve(self, kept: Mapping[str, NDArray]) -> None:
        """Make room for the arrays of a list that was kept; launches have to be bound to them."""
        self._grow(len(kept["contact_neighbour"]))
        for name in ("found", "cell_start"):
            self._new(name, len(kept[name]), wp.int32)

    def reshape(self) -> None:
        """Cells for the box as it was when the list was built that has been brought back."""
        self._shape_cells(self._strain)

    def _find(self) -> None:
        """Note the neighbours of each element; a second time, with more room, where some have many
        more than they had in the last list."""
        a = self._arrays
        names = (
            *("cell_of", "cell_row", "cell_place", "cell_start", "contact_elements"),
            *("contact_radius", "bonded_start", "bonded", "bonded_listed", "closing_stiffness"),
        )
        law = find_neighbours(self._s, self._k, self._has_parting, self._is_periodic)
        while True:
            inputs: list[Any] = [a.get(name) for name in names]
            inputs += [a["found_start"], a["found"], a["neighbour_count"], a["any_over"]]
            inputs += [self._greatest, self.skin, wp.vec3i(*self._cells)]
            self._launch(law, [*inputs, self._edges, self._to_shares])
            self.searches += 1
            if not a["any_over"].numpy()[0]:
                return
            a["any_over"].zero_()
            self._make_room(a["neighbour_count"].numpy()[:-1])

    def _make_room(self, count: NDArray[np.integer]) -> None:
        """Room for as many neighbours of each row, and some more."""
        start = np.concatenate([[0], np.cumsum(count.astype(np.int64) + SPARE)])
        self._arrays["found_start"].assign(start.astype(np.int32))
        self._new("found", int(start[-1]), wp.int32)

    def _shape_cells(self, strain: Array) -> None:
        """Cells no smaller than the reach: of a periodic box parts of it, else of space."""
        period, dim = self._model.contact_period, self._model.features.dim
        edges = np.eye(dim)
        if period is None:
            assert self._model.contact_elements is not None
            x = self._model.position[self._model.contact_elements]
            wanted = np.ceil(np.ptp(x, axis=0) / self._reach) + 1.0
        else:
            edges = (np.eye(dim) + strain) * period
            heights = 1.0 / np.linalg.norm(np.linalg.inv(edges), axis=1)
            if heights.min() < 2.0 * self._reach:
                raise InputError(
                    f"the periodic box is {heights.min():.4g} m across, less than twice the reach "
                    f"of contact, {2.0 * self._reach:.4g} m, so that two elements would touch "
                    "through several sides; take a larger box, or a smaller skin of contact."
                )
            wanted = np.floor(heights / self._reach)
        cells = np.ones(3, dtype=np.int64)
        cells[:dim] = np.minimum(wanted, MOST[dim])
        while np.prod(cells) > PER_ROW * self.rows and cells.max() > 1:
            cells[cells.argmax()] //= 2
        to_shares = np.asarray(np.linalg.inv(edges), dtype=np.float64)
        per_cell = cells[:dim, None] * to_shares
        to_cells = np.eye(dim) / self._reach if period is None else per_cell
        self._cells = cells.tolist()
        self._period = wp.vec3d(*([0.0] * dim if period is None else period), *[0.0] * (3 - dim))
        self._edges, self._to_shares = _solid(edges), _solid(to_shares)
        self._to_cells = _solid(to_cells)
        if self._arrays["cell_start"].size <= np.prod(cells):
            self._new("cell_start", int(np.prod(cells)) + 1, wp.int32)

    def pairs(self) -> np.ndarray:
        """Element ids of the listed pairs, (p, 2), lower id first, sorted."""
        start = self._arrays["contact_start"].numpy()
        neighbour = self._arrays["contact_neighbour"].numpy()[: start[-1]]
        assert self._model.contact_elements is not None
        own = np.repeat(self._model.contact_elements, np.diff(start))
        pairs = np.stack([own, neighbour], axis=1)[own < neighbour]
        return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]

    def entries(self, mask: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Of the list's entries at which a mask is set those of the lower ids, and the pairs."""
        start = self._arrays["contact_start"].numpy()
        at = np.flatnonzero(mask[: start[-1]])
        assert self._model.contact_elements is not None
        own = self._model.contact_elements[np.searchsorted(start, at, side="right") - 1]
        pairs = np.stack([own, self._arrays["contact_neighbour"].numpy()[at]], axis=1)
        lower = pairs[:, 0] < pairs[:, 1]
        return at[lower], pairs[lower].astype(np.int64)

    def _grow(self, capacity: int) -> None:
        self.capacity = capacity
        dim, most = self._model.features.dim, max(capacity, 1)
        self._new("contact_neighbour", most, wp.int32)
        self._new("contact_reference", dim * most, self._k.real)
        if self._is_periodic:
            self._new("contact_image", dim * most, wp.int32)
        self._new("contact_debt", most, self._s.real)
        self._new("contact_impulse", most, self._s.real)
        if self._touch.rubs:
            self._new("contact_spring", dim * most, self._s.real)
        if self._touch.ages:
            self._new("contact_theta", most, wp.float64)
        if self._touch.damps:
            self._new("contact_dashpot", most, self._s.real)
        if self._touch.rolls:
            self._new("contact_roll", (1 if dim == 2 else 3) * most, self._s.real)
        if self._touch.bounces:
            self._new("contact_opened", most, wp.int32)
        if self._touch.welds:
            for name in ("contact_welded", "weld_event"):
                self._new(name, most, wp.int32)
            for name in ("contact_pressed", "contact_worked"):
                self._new(name, most, self._s.real)
            for name in ("weld_normal", "weld_shear", "weld_released"):
                self._new(name, most, self._s.real)

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


def _solid(matrix: Array) -> wp.mat33d:
    """A matrix of the plane or of space as the device's of space."""
    whole, dim = np.zeros((3, 3)), len(matrix)
    whole[:dim, :dim] = matrix
    return wp.mat33d(*whole.ravel())

"""A periodic box whose mean strain changes with time: its bonds through the sides move."""

from functools import cache

import warp as wp

from .algebra import Laws, narrow
from .memory import get, kernel, nn


@cache
def strain_box(s: Laws, k: Laws, is_after: bool, simd: bool = True):
    """Pass over bonds through the sides: half of the work of the box's motion [J].

    Before the elements move, the images beyond the sides do, under the old force; the other half is
    done after, by the new one, as velocity Verlet has it.
    """
    real, narrowed = s.real, narrow(s, k)
    square = wp.types.matrix((s.dim, s.dim), k.real)

    def strain_box(
        # model
        box_bonds: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        box_shift: wp.array(dtype=k.real),
        # state read
        box_strain: wp.array(dtype=k.real),
        end_force: wp.array(dtype=real),
        # written
        bond_jump: wp.array(dtype=k.real),
        box_motion: wp.array(dtype=real),
        box_work: wp.array(dtype=wp.float64),
    ):
        t = wp.tid()
        b = nn(box_bonds[t])
        if wp.static(not is_after):
            e = square()
            for row in range(wp.static(s.dim)):
                for column in range(wp.static(s.dim)):
                    e[row, column] = get(box_strain, wp.static(s.dim) * row + column)
            jump = e * k.load(box_shift, t)
            s.store(box_motion, t, narrowed(jump - k.load(bond_jump, b)))
            k.store(bond_jump, b, jump)
        f = s.load(end_force, nn(get(bond_place, 2 * b)))
        done = real(0.5) * wp.dot(f, s.load(box_motion, t))
        box_work[t] = box_work[t] + wp.float64(done)

    return kernel(strain_box, simd)

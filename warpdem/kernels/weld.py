"""Pairs of a list that have welded: two-sided springs from the force of their contact (B11)."""

from functools import cache

import warp as wp

from .algebra import Laws

HOLDS = 1.0e20  # a friction that lets nothing slide


@cache
def weld(s: Laws, pressing: Laws) -> Laws:
    """Laws of a pair by whether it has welded: its spring along n bears tension too, the one across
    n does not slip. Pressed it is as it was, so welding changes neither force nor energy."""
    real, vec = s.real, s.vec

    @wp.func
    def energy(stiffness: real, gap: real, welded: bool) -> real:
        """U = k/2 g^2 welded, else that of the contact."""
        return wp.where(welded, real(0.5) * stiffness * gap * gap, pressing.energy(stiffness, gap))

    @wp.func
    def pull(stiffness: real, gap: real, welded: bool) -> real:
        """k g welded, else that of the contact."""
        return wp.where(welded, stiffness * gap, pressing.pull(stiffness, gap, real(0.0)))

    @wp.func
    def breaks(pull: real, across: vec, area: real, strength: real) -> bool:
        """Whether sqrt(<s>^2 + t^2) of tension s and shear t exceeds the strength [Pa]."""
        tension = wp.max(pull, real(0.0))
        return tension * tension + wp.dot(across, across) > strength * strength * area * area

    return Laws(energy=energy, pull=pull, breaks=breaks)

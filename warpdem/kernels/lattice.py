"""EVM bonds of a lattice: few kinds of bonds, alike in all their elements.

An element works out the bonds that begin at it, kind after kind, which all have the same numbers.
It leaves their forces on itself, and their torques on the elements where they end, at its own
index, where those look for them (`motion.gather`); the torques on itself are one sum. So nothing is
scattered, and a bond takes no more memory than where it ends.
"""

from functools import cache

import warp as wp

from .algebra import Laws
from .evm import angles, evm, evm_kinematics
from .memory import get, kernel, nn, put


@cache
def lattice_bond(s: Laws, k: Laws):
    """Measures of the bond of a kind that begins at an element."""
    kinematics = evm_kinematics(s, k)

    @wp.func
    def load_bond(
        kind: int,
        i: int,
        j: int,
        qi: k.rot,
        lattice_direction: wp.array(dtype=k.real),
        lattice_length: wp.array(dtype=k.real),
        lattice_offset: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ):
        return kinematics.measured(
            k.load(displacement, j) - k.load(displacement, i),
            qi,
            k.load_rot(orientation, j),
            k.load(lattice_direction, kind),
            get(lattice_length, kind),
            get(lattice_offset, 2 * kind),
            get(lattice_offset, 2 * kind + 1),
        )

    return load_bond


@cache
def lattice_forces(s: Laws, k: Laws, kinds: int, large_rotation: bool, simd: bool = True):
    """Pass over elements: forces and torques of the bonds that begin there (Kuzkin eq. 3)."""
    law, load_bond, real = evm(s, large_rotation), lattice_bond(s, k), s.real

    def lattice_forces(
        # model
        lattice_after: wp.array(dtype=int),
        lattice_direction: wp.array(dtype=k.real),
        lattice_length: wp.array(dtype=k.real),
        lattice_offset: wp.array(dtype=k.real),
        lattice_stiffness: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        qi = k.load_rot(orientation, i)
        total = s.no_spin()
        for kind in range(wp.static(kinds)):
            own = nn(kind * elements + i)
            j = nn(get(lattice_after, own))
            x = load_bond(
                kind, i, j, qi, lattice_direction, lattice_length, lattice_offset, displacement,
                orientation,
            )  # fmt: skip
            ri = real(get(lattice_offset, 2 * kind))
            rj = real(get(lattice_offset, 2 * kind + 1))
            f, ti, tj = law.force(law.load_stiffness(lattice_stiffness, kind), ri, rj, x)
            is_bond = wp.where(j == i, real(0.0), real(1.0))
            s.store(end_force, own, is_bond * f)
            s.store_spin(end_torque, own, is_bond * tj)
            total += is_bond * ti
        s.store_spin(end_torque, nn(wp.static(kinds) * elements + i), total)

    return kernel(lattice_forces, simd)


@cache
def lattice_energies(s: Laws, k: Laws, kinds: int, large_rotation: bool, simd: bool = True):
    """Per element and kind: the energy of the bond that begins there [J]."""
    law, load_bond, real = evm(s, large_rotation), lattice_bond(s, k), s.real

    def lattice_energies(
        # model
        lattice_after: wp.array(dtype=int),
        lattice_direction: wp.array(dtype=k.real),
        lattice_length: wp.array(dtype=k.real),
        lattice_offset: wp.array(dtype=k.real),
        lattice_stiffness: wp.array(dtype=real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        linked_energy: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        qi = k.load_rot(orientation, i)
        for kind in range(wp.static(kinds)):
            own = nn(kind * elements + i)
            j = nn(get(lattice_after, own))
            x = load_bond(
                kind, i, j, qi, lattice_direction, lattice_length, lattice_offset, displacement,
                orientation,
            )  # fmt: skip
            energy = law.energy(law.load_stiffness(lattice_stiffness, kind), x)
            put(linked_energy, own, wp.where(j == i, real(0.0), energy))

    return kernel(lattice_energies, simd)


@cache
def lattice_angles(s: Laws, k: Laws, kinds: int, simd: bool = True):
    """Per element and kind, of the bond that begins there: as `evm.evm_angles`."""
    angle, load_bond, real = angles(s), lattice_bond(s, k), s.real

    def lattice_angles(
        # model
        lattice_after: wp.array(dtype=int),
        lattice_direction: wp.array(dtype=k.real),
        lattice_length: wp.array(dtype=k.real),
        lattice_offset: wp.array(dtype=k.real),
        # state read
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        # written
        evm_twist: wp.array(dtype=real),
        evm_bend: wp.array(dtype=real),
        evm_elongation: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        qi = k.load_rot(orientation, i)
        for kind in range(wp.static(kinds)):
            own = nn(kind * elements + i)
            j = nn(get(lattice_after, own))
            x = load_bond(
                kind, i, j, qi, lattice_direction, lattice_length, lattice_offset, displacement,
                orientation,
            )  # fmt: skip
            put(evm_bend, own, angle.bend(x))
            put(evm_elongation, own, x.elongation / real(get(lattice_length, kind)))
            if wp.static(s.dim == 3):
                put(evm_twist, own, angle.twist(x))

    return kernel(lattice_angles, simd)

"""Macroscopic moduli of bonded packings, and the bonds that give wanted ones (theory A7).

Lattices: in closed form. Disordered packings: by relaxing a periodic cell under each strain.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bond import EVMBond
from .errors import Array, InputError, ModelWarning, positive
from .material import Material
from .packing import Packing

PAIRS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}
OUTSIDE = (
    "bonds between pairs cannot reach it whatever their stiffness; facet bonds with the volume "
    "term (bond='facet') have any Poisson's ratio below 1/2"
)


@dataclass(frozen=True)
class Moduli:
    """Elastic stiffness C [Pa], shape (dim, dim, dim, dim); plane: as of the packing.

    In the plane C relates stresses and strains in the plane.
    """

    stiffness: Array
    plane: str | None

    @property
    def matrix(self) -> Array:
        """Voigt's matrix [Pa], (3, 3): xx, yy, xy or (6, 6): xx, yy, zz, yz, xz, xy."""
        pairs = PAIRS[len(self.stiffness)]
        return np.array([[self.stiffness[*ab, *cd] for cd in pairs] for ab in pairs])

    @property
    def c11(self) -> float:
        """C_xxxx [Pa]."""
        return float(self.stiffness[0, 0, 0, 0])

    @property
    def c12(self) -> float:
        """C_xxyy [Pa]."""
        return float(self.stiffness[0, 0, 1, 1])

    @property
    def c44(self) -> float:
        """C_xyxy [Pa]."""
        return float(self.stiffness[0, 1, 0, 1])

    @property
    def anisotropy(self) -> float:
        """Greatest deviation of C from its isotropic part, over that part's greatest entry."""
        lame, shear = self._isotropic()
        part = _isotropic_stiffness(lame, shear, len(self.stiffness))
        return float(np.abs(self.stiffness - part).max() / np.abs(part).max())

    @property
    def shear_modulus(self) -> float:
        """G [Pa] of the isotropic part."""
        return self._isotropic()[1]

    @property
    def poisson(self) -> float:
        """Poisson's ratio of the isotropic part, that of the solid (not of the plane)."""
        lame, shear = self._isotropic()
        if self.plane == "stress":
            return lame / (lame + 2.0 * shear)
        return lame / (2.0 * (lame + shear))

    @property
    def young(self) -> float:
        """Young's modulus [Pa] of the isotropic part."""
        return 2.0 * self.shear_modulus * (1.0 + self.poisson)

    def _isotropic(self) -> tuple[float, float]:
        """Lame's lambda (in plane stress that of the plane) and G [Pa] nearest to C."""
        dim = len(self.stiffness)
        traces = np.einsum("aabb", self.stiffness), np.einsum("abab", self.stiffness)
        # of lambda d_ab d_cd + G (d_ac d_bd + d_ad d_bc)
        matrix = [[dim * dim, 2 * dim], [dim, dim * dim + dim]]
        lame, shear = np.linalg.solve(matrix, traces)
        return float(lame), float(shear)


def lattice_moduli(packing: Packing, bond: EVMBond) -> Moduli:
    """Moduli of a lattice of EVM bonds in closed form (theory A7).

    C = 1/(2 V) sum over an inner element's bonds of
    L^2 [(c_A - c_D) nnnn + c_D/4 (d_ac n_b n_d + d_ad n_b n_c + d_bc n_a n_d + d_bd n_a n_c)].
    Bending and torsion do not enter. Raises InputError unless all inner elements are alike, with
    neighbours on opposite sides.
    """
    c_a, c_d, _, _ = bond.stiffnesses(len(packing.bonds)).T
    _, ids, x = _inner(packing)
    length = np.linalg.norm(x, axis=1)
    n, a, d = x / length[:, None], c_a[ids], c_d[ids]
    four = np.einsum("k,ka,kb,kc,kd->abcd", length**2 * (a - d), n, n, n, n)
    two = np.einsum("k,ka,kb->ab", length**2 * d / 4.0, n, n)
    unit = np.eye(packing.dim)
    mixed = sum(
        np.einsum(f"{p},{q}->abcd", unit, two)
        for p, q in (("ac", "bd"), ("ad", "bc"), ("bc", "ad"), ("bd", "ac"))
    )
    volume = packing.volume[_inner(packing)[0]]
    return Moduli((four + mixed) / (2.0 * volume), packing.plane)


def lattice_bond(
    packing: Packing, material: Material, bond_radius: float | None = None, **more: float
) -> EVMBond:
    """The EVM bond with which a lattice has a material's Young's modulus and Poisson's ratio.

    Of further shells of neighbours the stiffnesses stand in the ratio that makes the lattice
    isotropic, shear to longitudinal in one ratio in all. bond_radius [m]: of circular bonds, sets
    bending and torsion, which moduli do not depend on (theory A6: c_B = c_A r^2/4,
    c_T = c_D r^2/2), by default half the spacing. more: offset, damping, large_rotation.

    Raises InputError where no stiffness c_A > 0, c_D >= 0 gives it: Poisson's ratio above 1/4
    (above 1/3 in plane stress), or not 0 on a lattice that is isotropic at 0 alone.
    """
    limit = 1.0 / 3.0 if packing.plane == "stress" else 0.25
    if material.poisson > limit * (1.0 + 1e-12):
        raise InputError(
            f"Poisson's ratio {material.poisson:g} is above {limit:.3g}, the most that pairs reach "
            f"{'in plane stress' if packing.plane == 'stress' else 'in the solid'}: {OUTSIDE}."
        )
    _, ids, _ = _inner(packing)
    share = _shells(packing, ids)
    unit = [
        lattice_moduli(packing, EVMBond(share, share * ratio, 0.0))._isotropic()
        for ratio in (0.0, 1.0)
    ]
    # C is linear in c_A and c_D
    wanted = [material.lame(packing.plane), material.shear_modulus]
    alone = np.array([unit[0], np.subtract(unit[1], unit[0])]).T
    c_a, c_d = np.linalg.solve(alone, wanted)
    c_d = 0.0 if abs(c_d) < 1e-12 * abs(c_a) else c_d
    r = 0.5 * packing.spacing if bond_radius is None else bond_radius
    positive("bond_radius", r, ())
    bond = EVMBond(
        c_a * share,
        c_d * share,
        c_a * share * r**2 / 4.0,
        c_d * share * r**2 / 2.0,
        **more,  # type: ignore[arg-type]
    )
    if lattice_moduli(packing, bond).anisotropy > 1e-6:
        if material.poisson == 0.0:
            raise InputError(
                "this lattice is isotropic at no stiffness of its bonds; take another."
            )
        raise InputError(
            f"this lattice of nearest neighbours is isotropic at Poisson's ratio 0 alone, not at "
            f"{material.poisson:g}: take bonds to second neighbours (neighbours=2) or another "
            f"lattice; or facet bonds, which have any Poisson's ratio below 1/2."
        )
    return bond


def periodic_moduli(packing: Packing, bond: EVMBond) -> Moduli:
    """Moduli of a periodic packing of EVM bonds, small strains, every element at rest.

    One sparse factorisation, one solution for every independent strain. The energy of a relaxed
    cell is 1/2 strain : C : strain times its volume, so C is exact for this cell.
    """
    if packing.period is None or not np.isfinite(packing.period).all():
        raise InputError("this packing is not periodic all round; build it with periodic=True.")
    return _Cell(packing).moduli(bond.stiffnesses(len(packing.bonds)))


@dataclass(frozen=True)
class Calibration:
    """What `calibrate` found: every bond is a short rod of modulus E_b [Pa] and its face's area S,
    c_A = E_b S/L, c_D = ratio c_A, c_B = c_A r^2/4, c_T = c_D r^2/2 (theory A6)."""

    modulus: float
    ratio: float
    bond_radius: float
    moduli: Moduli

    def bond(self, packing: Packing, **more: float) -> EVMBond:
        """The bonds of a packing of the calibrated kind; more: offset, damping, large_rotation."""
        c = _rods(packing, self.modulus, self.ratio, self.bond_radius)
        return EVMBond(*c.T, **more)  # type: ignore[arg-type]


def calibrate(
    packing: Packing,
    material: Material,
    bond_radius: float | None = None,
    tell: Callable[[str], None] | None = print,
) -> Calibration:
    """The EVM bonds with which a disordered periodic packing has a material's E and nu.

    The cell is relaxed under the independent strains for some ten ratios of shear to longitudinal
    stiffness. bond_radius [m]: r of all bonds, by default half the spacing; tell: called with a
    line for every relaxation, None for silence.

    Raises InputError if no ratio gives the wanted Poisson's ratio.
    """
    from scipy.optimize import brentq

    if packing.period is None or not np.isfinite(packing.period).all():
        raise InputError("this packing is not periodic all round; build it with periodic=True.")
    cell = _Cell(packing)
    r = 0.5 * packing.spacing if bond_radius is None else bond_radius
    positive("bond_radius", r, ())
    found: dict[float, Moduli] = {}

    def excess(ratio: float) -> float:
        if ratio not in found:
            found[ratio] = cell.moduli(_rods(packing, 1.0, ratio, r))
            if tell is not None:
                tell(
                    f"relaxation {len(found)}: shear over longitudinal {ratio:.6g} gives Poisson's "
                    f"ratio {found[ratio].poisson:.6g} (wanted {material.poisson:g})"
                )
        return found[ratio].poisson - material.poisson

    low, high = 1e-3, 4.0
    most, least = excess(low), excess(high)
    if most < 0.0 or least > 0.0:
        raise InputError(
            f"this packing reaches Poisson's ratios from {least + material.poisson:.3g} to "
            f"{most + material.poisson:.3g} with EVM bonds, not {material.poisson:g}: {OUTSIDE}."
        )
    ratio = brentq(excess, low, high, xtol=1e-9, rtol=1e-9)
    excess(ratio)
    unit = found[ratio]
    if unit.anisotropy > 0.05:
        warnings.warn(
            f"the cell is {unit.anisotropy:.0%} anisotropic; take a larger one.",
            ModelWarning,
            stacklevel=2,
        )
    modulus = material.young / unit.young
    return Calibration(modulus, ratio, r, Moduli(unit.stiffness * modulus, unit.plane))


def _rods(packing: Packing, modulus: float, ratio: float, radius: float) -> Array:
    """c_A, c_D, c_B, c_T of every bond, (b, 4)."""
    area = packing.spacing ** (packing.dim - 1) if packing.area is None else packing.area
    c_a = modulus * area / packing.bond_length
    return np.stack(
        [c_a, ratio * c_a, c_a * radius**2 / 4.0, ratio * c_a * radius**2 / 2.0], axis=1
    )


class _Cell:
    """A periodic packing of EVM bonds in small motions about its reference state (theory A2).

    Energy of a bond: c_A, c_D along and across of the opening u_j - u_i + n x (h_i th_i + h_j th_j)
    + strain.x_ij, and c_B, c_T across and along of th_j - th_i.
    """

    def __init__(self, packing: Packing) -> None:
        from scipy.sparse import coo_array

        self.packing, dim = packing, packing.dim
        spins = 1 if dim == 2 else 3
        width, n, b = dim + spins, len(packing), len(packing.bonds)
        self.length = packing.bond_length
        half = np.repeat(0.5 * self.length[:, None], 2, axis=1)  # whatever equal offsets are
        normal = packing.bond_vector / self.length[:, None]
        self.normal = normal
        rows, columns, values = [], [], []
        opening = np.arange(b * dim).reshape(b, dim)
        turning = b * dim + np.arange(b * spins).reshape(b, spins)

        def put(row: NDArray, column: NDArray, value: Array) -> None:
            rows.append(np.broadcast_to(row, value.shape).ravel())
            columns.append(np.broadcast_to(column, value.shape).ravel())
            values.append(value.ravel())

        for side, sign in ((0, -1.0), (1, 1.0)):
            at = packing.bonds[:, side] * width
            for axis in range(dim):
                put(opening[:, axis], at + axis, np.full(b, sign))
            for spin in range(spins):
                put(turning[:, spin], at + dim + spin, np.full(b, sign))
                # n x th
                axis_of = np.eye(3)[spin if spins == 3 else 2]
                n3 = normal if dim == 3 else np.pad(normal, ((0, 0), (0, 1)))
                lever = half[:, side, None] * np.cross(n3, axis_of)[:, :dim]
                put(opening, (at + dim + spin)[:, None], lever)
        self._b = coo_array(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
            shape=(b * width, n * width),
        ).tocsr()

    def moduli(self, stiffnesses: Array) -> Moduli:
        """Relax under every independent strain."""
        from scipy.sparse import block_diag, bsr_array
        from scipy.sparse.linalg import splu

        p, dim = self.packing, self.packing.dim
        assert p.period is not None
        c_a, c_d, c_b, c_t = stiffnesses.T
        along = self.normal[:, :, None] * self.normal[:, None, :]
        across = np.eye(dim) - along
        b = len(along)
        blocks = c_a[:, None, None] * along + c_d[:, None, None] * across
        turns = c_b[:, None, None] * across + c_t[:, None, None] * along
        if dim == 2:
            turns = c_b[:, None, None]

        def diagonal(value: Array):
            return bsr_array((value, np.arange(b), np.arange(b + 1)))

        c = block_diag([diagonal(blocks), diagonal(turns)], format="csr")
        k = (self._b.T @ c @ self._b).tocsc()
        pairs = PAIRS[dim]
        opening = np.zeros((self._b.shape[0], len(pairs)))
        for column, (i, j) in enumerate(pairs):
            strain = np.zeros((dim, dim))
            strain[i, j] += 0.5
            strain[j, i] += 0.5
            opening[: b * dim, column] = (p.bond_vector @ strain).ravel()
        free = np.arange(dim, k.shape[0])  # the first element does not move: no rigid motion
        motion = np.zeros((k.shape[0], len(pairs)))
        load = -(self._b.T @ (c @ opening))
        motion[free] = splu(k[free][:, free].tocsc()).solve(load[free])
        total = opening + self._b @ motion
        matrix = total.T @ (c @ total) / (p.period.prod() * p.thickness)
        tensor = np.zeros((dim,) * 4)
        for (i, j), row in zip(pairs, matrix, strict=True):
            for (k_, l_), value in zip(pairs, row, strict=True):
                for ab in ((i, j), (j, i)):
                    for cd in ((k_, l_), (l_, k_)):
                        tensor[*ab, *cd] = value
        return Moduli(tensor, p.plane)


def _inner(packing: Packing) -> tuple[int, NDArray[np.int64], Array]:
    """An inner element of a lattice, the ids of its bonds and the vectors to its neighbours."""
    bonds, n = packing.bonds, len(packing)
    degree = np.bincount(bonds.ravel(), minlength=n)
    inside = degree == degree.max(initial=0)
    two = np.zeros((n, packing.dim, packing.dim))
    four = np.zeros((n,) + (packing.dim,) * 4)
    one = np.zeros((n, packing.dim))
    x = packing.bond_vector
    for side, sign in ((0, 1.0), (1, -1.0)):
        np.add.at(one, bonds[:, side], sign * x)
        np.add.at(two, bonds[:, side], x[:, :, None] * x[:, None, :])
        np.add.at(four, bonds[:, side], np.einsum("ka,kb,kc,kd->kabcd", x, x, x, x))
    size = np.linalg.norm(x, axis=1).max(initial=0.0)
    unlike = max(
        float(np.abs(fabric[inside] - fabric[inside][0]).max(initial=0.0)) / size**power
        for fabric, power in ((two, 2), (four, 4))
    )
    if degree.max(initial=0) == 0 or np.abs(one[inside]).max() > 1e-9 * size or unlike > 1e-9:
        raise InputError(
            "this is no lattice whose inner elements are alike, with neighbours on opposite sides: "
            "enlarge the box, or use calibrate on a periodic packing."
        )
    element = int(np.flatnonzero(inside)[0])
    ids = np.flatnonzero((bonds == element).any(axis=1))
    return element, ids, x[ids]


def _shells(packing: Packing, ids: NDArray[np.int64]) -> Array:
    """Share of every bond's stiffness by the shell it belongs to, 1 in the first.

    The anisotropic part of sum L^2 (c_A - c_D) nnnn must vanish over the shells (theory A7).
    """
    length = packing.bond_length
    first = length.min()
    second = length > 1.01 * first
    if not second.any():
        return np.ones(len(length))

    def anisotropy(chosen: NDArray[np.int64]) -> float:
        x = packing.bond_vector[chosen]
        n = x / np.linalg.norm(x, axis=1)[:, None]
        weight = (x**2).sum(axis=1)
        return float((weight * (n[:, 0] ** 4 - 3.0 * (n[:, 0] * n[:, 1]) ** 2)).sum())

    one, two = (anisotropy(ids[second[ids] == is_second]) for is_second in (False, True))
    share = np.ones(len(length))
    if abs(two) > 1e-9 * first**2:
        share[second] = -one / two
    return share


def _isotropic_stiffness(lame: float, shear: float, dim: int) -> Array:
    unit = np.eye(dim)
    return lame * np.einsum("ab,cd->abcd", unit, unit) + shear * (
        np.einsum("ac,bd->abcd", unit, unit) + np.einsum("ad,bc->abcd", unit, unit)
    )

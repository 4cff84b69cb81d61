"""Stiffness of bonds from beams, cylinders and parallel bonds, and cross sections."""

from math import pi

import numpy as np
import pytest

import warpdem as wd

STEEL = wd.Material(young=200e9, poisson=0.3, density=7800)


def literal(e, g, s, j, jp, a, b2, b3):
    """B1..B4 as Kuzkin prints them."""
    return np.array([e * s / a, b2, b3, g * jp / a])


def test_bernoulli_euler_is_kuzkin_14():
    section, a = wd.Circle(0.01), np.array([0.1, 0.25])
    e, g = STEEL.young, STEEL.shear_modulus
    s, j = pi * 1e-4, pi * 1e-8 / 4
    jp = 2 * j
    b = wd.EVMBond.bernoulli_euler(STEEL, section, a).parameters(a)
    for row, length in zip(b, a, strict=True):
        exact = literal(
            e, g, s, j, jp, length, 12 * e * j / length, -2 * e * j / length - g * jp / (2 * length)
        )
        assert row == pytest.approx(exact, rel=1e-14)


def test_timoshenko_is_kuzkin_13():
    section, a, k = wd.Tube(0.02, 0.01), 0.05, 0.6
    e, g, nu = STEEL.young, STEEL.shear_modulus, 0.3
    s, j = pi * (4e-4 - 1e-4), pi * (1.6e-7 - 1e-8) / 4
    jp = 2 * j
    b2 = 12 * k * a * e * j * s / (k * s * a**2 + 24 * j * (1 + nu))
    exact = literal(e, g, s, j, jp, a, b2, e * j / a - b2 / 4 - g * jp / (2 * a))
    bond = wd.EVMBond.timoshenko(STEEL, section, a, shear_coefficient=k)
    assert bond.parameters(np.array([a]))[0] == pytest.approx(exact, rel=1e-13)


def test_short_cylinder_is_kuzkin_16():
    section, a, nu = wd.Circle(0.01), 0.004, 0.3
    e, g = STEEL.young, STEEL.shear_modulus
    s, j = pi * 1e-4, pi * 1e-8 / 4
    stiff = (1 - nu) / ((1 + nu) * (1 - 2 * nu)) * e
    b2, b4 = g * s * a, g * 2 * j / a
    exact = [stiff * s / a, b2, stiff * j / a - b2 / 4 - b4 / 2, b4]
    bond = wd.EVMBond.short_cylinder(STEEL, section, a)
    assert bond.parameters(np.array([a]))[0] == pytest.approx(exact, rel=1e-13)


def test_parallel_bond_constants():
    bond = wd.EVMBond.parallel_bond(3e12, 1e12, wd.Circle(0.01))
    s, j = pi * 1e-4, pi * 1e-8 / 4  # theory A6
    assert bond.stiffnesses(1)[0] == pytest.approx([3e12 * s, 1e12 * s, 3e12 * j, 1e12 * 2 * j])


def test_sections():
    # Roark: 0.1406 b^4 for a square; b h^3/3 for a thin strip
    assert wd.Rectangle(2.0, 2.0).torsion_constant == pytest.approx(0.1406 * 16, rel=3e-4)
    assert wd.Rectangle(1000.0, 1.0).torsion_constant == pytest.approx(1000 / 3, rel=1e-3)
    assert wd.Rectangle(1.0, 3.0).torsion_constant == wd.Rectangle(3.0, 1.0).torsion_constant
    assert wd.Rectangle(2.0, 3.0).second_moment == pytest.approx(2 * 27 / 12)
    assert wd.Circle(1.0).shear_coefficient(0.3) == pytest.approx(6 * 1.3 / 8.8)
    # a thin tube: 2 (1 + nu)/(4 + 3 nu), Cowper 1966
    assert wd.Tube(1.0, 0.9999).shear_coefficient(0.3) == pytest.approx(2.6 / 4.9, rel=1e-4)
    assert wd.Rectangle(1.0, 2.0).shear_coefficient(0.3) == pytest.approx(13 / 15.3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: wd.EVMBond(1.0, -1.0, 1.0), "shear must not be negative.*takes any"),
        (lambda: wd.EVMBond(0.0, 1.0, 1.0), "longitudinal must be greater than zero"),
        (lambda: wd.EVMBond(1.0, 1.0, 1.0, damping=-0.1), "damping must not be negative"),
        (
            lambda: wd.EVMBond.timoshenko(STEEL, wd.Circle(1.0), 1.0, shear_coefficient=1.5),
            "above 0 and not above 1.*bernoulli_euler",
        ),
        (
            lambda: wd.EVMBond.short_cylinder(wd.Material(1, 0.4999, 1), wd.Circle(1), 1),
            "timoshenko",
        ),
        (lambda: wd.EVMBond.bernoulli_euler(STEEL, wd.Circle(1.0), 0.0), "length must be greater"),
        (lambda: wd.Tube(1.0, 1.0), "not below its outer radius"),
    ],
)
def test_out_of_range_is_refused_with_a_way_out(make, words):
    with pytest.raises(wd.InputError, match=words):
        make()


def test_a_flat_section_is_for_the_plane_only():
    section = wd.Rectangle(width=0.1, height=0.02)
    for dim, refused in ((2, False), (3, True)):
        rod = wd.packing.filament([[0] * dim, [1] + [0] * (dim - 1)], 4, section)
        bond = wd.EVMBond.bernoulli_euler(STEEL, section, rod.bond_length)
        if refused:
            with pytest.raises(wd.InputError, match="circle, a tube or a square"):
                wd.Scene().add(rod, STEEL, bond=bond)
        else:
            wd.Scene().add(rod, STEEL, bond=bond)

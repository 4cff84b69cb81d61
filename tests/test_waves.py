"""The exact solution of Lamb's problem, against a direct integration over slownesses."""

import numpy as np
import pytest
from scipy.integrate import quad

import warpdem as wd
from warpdem.validation.reference import half_space_slowness, line_load, ricker

SOLID = wd.Material(1.0, 0.25, 1.0)


@pytest.mark.parametrize("time", [8.2, 10.2, 12.2])
def test_line_load_by_direct_integration(time):
    distance, frequency, above = 6.0, 0.5, 1e-12j
    c_p, c_s, c_r = SOLID.pressure_speed(), SOLID.shear_speed(), SOLID.rayleigh_speed()

    def slowness(at):
        return np.array(half_space_slowness(np.array([at / distance + above]), SOLID, "strain"))

    def record(at, component):
        return slowness(at)[component, 0].imag * ricker(time - at, frequency)

    first, second, third = distance / c_p, distance / c_s, distance / c_r
    # Rayleigh's pole: a delta in the horizontal component, a principal value in the vertical one
    near = 1e-5
    left, right = slowness(third - near)[:, 0], slowness(third + near)[:, 0]
    across = quad(record, first, second, args=(0,), limit=200)[0]
    across -= np.pi * 0.5 * near * (right - left)[0].real * ricker(time - third, frequency)
    down = quad(record, first, second, args=(1,), limit=200)[0]
    down += quad(record, second, third - 0.1, args=(1,), limit=200)[0]
    # about the pole the odd part cancels: sum both sides
    down += quad(lambda s: record(third - s, 1) + record(third + s, 1), 1e-4, 0.1, limit=200)[0]
    down += quad(record, third + 0.1, time + 4.0, args=(1,), limit=200)[0]
    scale = np.pi * SOLID.shear_modulus * distance
    found = line_load(distance, np.array([time]), frequency, SOLID, "strain")[0]
    assert found * scale == pytest.approx([across, -down], rel=1e-3, abs=1e-4)

import numpy as np
import pytest

import warpdem as wd


@pytest.mark.parametrize(
    ("poisson", "strain", "stress"),
    # roots of Rayleigh's equation, c_R / c_S, in plane strain and plane stress (theory C)
    [
        (0.20, 0.9110, 0.9052),
        (0.22, 0.9144, 0.9076),
        (0.25, 0.9194, 0.9110),
        (0.30, 0.9274, 0.9162),
        (0.35, 0.9350, 0.9209),
        (0.40, 0.9422, 0.9252),
    ],
)
def test_rayleigh_speed(poisson, strain, stress):
    m = wd.Material(1.0, poisson, 1.0)
    assert m.rayleigh_speed("strain") / m.shear_speed() == pytest.approx(strain, abs=6e-5)
    assert m.rayleigh_speed("stress") / m.shear_speed() == pytest.approx(stress, abs=6e-5)


def test_wave_speeds_are_those_of_the_moduli():
    m = wd.Material(72e9, 0.22, 2440)
    bulk = m.pressure_speed() ** 2 - 4 / 3 * m.shear_speed() ** 2
    assert bulk * m.density == pytest.approx(m.bulk_modulus, rel=1e-12)
    plate = np.sqrt(m.young / (1 - m.poisson**2) / m.density)
    assert m.pressure_speed("stress") == pytest.approx(plate, rel=1e-12)


@pytest.mark.parametrize("change", [{"poisson": 0.5}, {"poisson": -1.0}, {"young": 0.0},
                                    {"density": -1.0}, {"young": np.nan}])  # fmt: skip
def test_out_of_range_is_refused(change):
    with pytest.raises(wd.InputError):
        wd.Material(**({"young": 1.0, "poisson": 0.2, "density": 1.0} | change))

"""Virtual tests of rock (docs/rock_tests.md); their physics is validated in validation/rock.py."""

import csv
import json
import subprocess
import sys
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from pxr import UsdGeom
from stages import opened

import warpdem as wd
from warpdem.experiments import (
    Brazilian,
    Compression,
    Confined,
    Specimen,
    Tension,
    brazilian,
    compression,
    confined,
    material_strength,
    strength_envelope,
    tension,
)
from warpdem.experiments.material_point import principal_strain, side_factors
from warpdem.experiments.shared import read_criterion, write_criterion

SMALL = {"width": 12e-3, "height": 20e-3}
ROCK = wd.Material(20e9, 0.2, 2300.0)
RNG = np.random.default_rng(1)


def warpdem(*arguments, cwd=None):
    command = [sys.executable, "-c", "from warpdem.cli import main; main()", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)


# -- observers ------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 28.0, 90.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_fracture_plane_finds_a_band_in_a_cloud(angle, dim):
    body = RNG.uniform(0.0, 1.0, (4000, dim)) * [40.0, 40.0, 80.0][-dim:]
    middle, axis = np.array([20.0, 20.0, 40.0][-dim:]), np.eye(dim)[-1]
    turn = np.radians(angle)
    normal = np.sin(turn) * axis + np.cos(turn) * np.eye(dim)[0]
    band = body[np.abs((body - middle) @ normal) < 1.5]
    noise = body[RNG.permutation(len(body))[: len(band)]]
    plane = wd.fracture_plane(np.concatenate([band, noise]), body, 4.0)
    assert plane.angle_to(axis) == pytest.approx(angle, abs=1.5)
    assert 0.5 < plane.share < 0.65
    assert abs((plane.point - middle) @ normal) < 0.5
    assert np.linalg.norm(plane.normal) == pytest.approx(1.0)


def test_fracture_plane_needs_bonds():
    body = RNG.uniform(size=(100, 2))
    assert wd.fracture_plane(body[:5], body, 0.1) is None
    with pytest.raises(wd.InputError, match="same dimension"):
        wd.fracture_plane(np.ones((9, 3)), body, 0.1)


def strained(exx, eyy):
    """A plate that is held in a uniform strain, and its StressStrain."""
    p = wd.packing.voronoi((12e-3, 16e-3), 1e-3, "stress")
    scene = wd.Scene()
    body = scene.add(p, ROCK)
    scene.strain(body, np.diag([exx, eyy]))
    scene.hold(body, np.arange(len(p)))
    sim = wd.Simulation(scene, dt=1e-9)
    core = ~p.boundary(2)
    return body, sim, wd.StressStrain(body, p.bottom, p.top, "y", 12e-3, core, every=1)


def test_stress_strain_of_a_uniform_strain():
    _, sim, reading = strained(-2e-5, 1e-4)
    sim.observe(reading)
    sim.run(steps=2)
    # Hooke's law in plane stress
    stress = 20e9 / (1.0 - 0.04) * np.array([-2e-5 + 0.2e-4, 1e-4 - 0.4e-5])
    assert reading.time == pytest.approx([0.0, 1e-9, 2e-9])
    assert reading.strain == pytest.approx(1e-4)
    assert reading.gauge_strain == pytest.approx(np.tile([-2e-5, 1e-4], (3, 1)))
    assert reading.core_stress == pytest.approx(np.tile(stress, (3, 1)), abs=20.0)
    # the elements at the grips lack faces, so that their pull is a little off
    assert reading.stress == pytest.approx(stress[1], rel=0.1)
    assert not reading.broken.any()


def test_stress_strain_refuses_nonsense():
    body, _, _ = strained(0.0, 1e-5)
    everything = np.arange(len(body.packing))
    for change, says in (
        ({"stop": 1.0}, "stop is 1"),
        ({"past": 1.0}, "past is 1"),
        ({"area": 0.0}, "area must be"),
        ({"core": [0]}, "too few elements"),
        ({"low": []}, "is empty"),
        ({"high": [10_000]}, "not there"),
    ):
        given = {"low": [0], "high": [1], "axis": "y", "area": 1.0, "core": everything} | change
        with pytest.raises(wd.InputError, match=says):
            wd.StressStrain(body, **given)


def test_when_calls_only_if_due():
    class Count:
        every, calls, ends = 1, 0, 0

        def observe(self, sim):
            self.calls += 1

        def finish(self, sim):
            self.ends += 1

    _, sim, _ = strained(0.0, 0.0)
    counted = Count()
    sim.observe(wd.When(counted, lambda s: s.steps % 3 == 0, every=1))
    sim.run(steps=7)
    assert (counted.calls, counted.ends) == (3, 1)


# -- material point -------------------------------------------------------------------------------


def test_a_criterion_that_never_breaks_has_no_strength():
    # (a+1)/2 q + 3(a-1)/2 m < 0 in plane strain: q = .917 s, m = -.4 s at nu .2
    criterion = wd.DruckerPrager(50e6, 10.0)
    assert material_strength(criterion, ROCK, "strain", (0.0, -1.0)) == inf
    with pytest.raises(wd.InputError, match="never breaks under this load in plane strain"):
        compression(Compression(plane="strain", criterion=criterion, **SMALL))


def test_principal_strains_are_hookes():
    # E e_1 = s_1 - nu (s_2 + s_3), with s_3 = nu (s_1 + s_2) in plane strain
    s1, s2 = 3e6, -5e6
    assert 20e9 * principal_strain(ROCK, "stress", (s1, s2))[0] == pytest.approx(s1 - 0.2 * s2)
    out = 0.2 * (s1 + s2)
    assert 20e9 * principal_strain(ROCK, "strain", (s1, s2))[1] == pytest.approx(
        s2 - 0.2 * (s1 + out)
    )
    assert 20e9 * principal_strain(ROCK, None, (s1, s2, 1e6))[2] == pytest.approx(
        1e6 - 0.2 * (s1 + s2)
    )


def test_side_factors_make_up_for_what_the_criterion_does_not_see():
    criterion, state = wd.DruckerPrager(50e6, 5.0), np.array([0.0, -50e6])
    for kind, is_even in (("voronoi", True), ("hexagonal", False)):
        p = getattr(wd.packing, kind)((12e-3, 12e-3), 1e-3, "stress")
        sides = (p.left | p.right) & ~(p.side("bottom", 3) | p.side("top", 3))
        factor = side_factors(p, ROCK, criterion, 0.999 * state, sides)
        # the free side of a box of Voronoi cells is exact, a lattice's zigzag is not
        assert factor.min() == 1.0
        assert (factor.max() < 1.001) == is_even
        assert not (factor[~sides[p.bonds].any(axis=1)] != 1.0).any()


@pytest.mark.parametrize("dim", [2, 3])
def test_a_pressure_balances_the_stress_it_stands_for(dim):
    # without a volume term the tractions of a uniform strain are exact at the surface too
    p = wd.packing.voronoi((6e-3,) * dim, 1e-3, "stress" if dim == 2 else None, seed=2)
    scene = wd.Scene()
    hard = wd.Material(20e9, 0.0, 2300.0)
    body = scene.add(p, hard)
    scene.strain(body, -1e-6 * np.eye(dim))
    axis = dim - 1
    sides = [n for n in p.sides if n not in {2: ("bottom", "top"), 3: ("back", "front")}[dim]]
    lateral = np.any([p.sides[n] for n in sides], axis=0)
    ends = np.any([p.sides[n] for n in p.sides if n not in sides], axis=0)
    across = "xyz"[:dim].replace("xyz"[axis], "")
    scene.press(body, lateral, 20e9 * 1e-6, axes=across)
    sim = wd.Simulation(scene)
    inner = lateral & ~ends
    size = np.abs(sim.bond_force).max()
    assert np.abs(sim.force + body.force)[inner].max() < 1e-5 * size
    assert np.abs(sim.torque + body.torque)[inner].max() < 1e-5 * size * p.spacing


# -- tests of rock --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """A small compression test and its folder."""
    out = tmp_path_factory.mktemp("compression")
    said = []
    result = compression(Compression(**SMALL), out=out, say=said.append)
    return result, out, "\n".join(said)


@pytest.mark.parametrize("precision", ["float64", "float32", "mixed"])
def test_tension_in_every_precision(precision):
    result = tension(Tension(**SMALL), precision=precision)
    assert result.young == pytest.approx(20e9, rel=0.01)
    assert result.poisson == pytest.approx(0.2, rel=0.01)
    assert abs(result.energy_error) < (1e-4 if precision == "float64" else 1e-3)
    assert 0.5 < result.strength / result.criterion_strength < 1.0
    assert result.first_break_stress <= result.strength
    assert result.tensile_breaks > result.shear_breaks
    assert result.fracture_angle > 60.0
    assert result.tensile_breaks + result.shear_breaks == result.broken_bonds == len(result.log)


def test_compression_has_its_numbers(pressed):
    result, _, said = pressed
    assert result.young == pytest.approx(20e9, rel=0.01)
    assert result.poisson == pytest.approx(0.2, rel=0.01)
    assert abs(result.energy_error) < 1e-4
    # the criterion's 50 MPa, less what scatter takes
    assert result.criterion_strength == pytest.approx(50e6, rel=1e-3)
    assert 0.5 < result.strength / 50e6 < 1.0
    assert result.shear_breaks > result.tensile_breaks
    # in plane stress the slope of Drucker-Prager at a = 5 is 3.5 (eq. 14, differentiated)
    assert result.expected_angle == pytest.approx(45 - 0.5 * np.degrees(np.arcsin(2.5 / 4.5)), 0.01)
    assert (np.diff(result.break_strain) >= 0.0).all()
    assert result.break_strain[-1] > result.strain_at_strength
    assert result.volumetric_strain[result.history.peak] < 0.0
    assert result.history.stress[-1] > -result.strength
    for words in ("building the packing", "compiling kernels", "criterion breaks at 50 MPa"):
        assert words in said


def test_compression_writes_whole_files(pressed):
    result, out, _ = pressed
    assert sorted(f.name for f in out.iterdir()) == [
        "broken_bonds.csv", "run.json", "scene.usd", "stress_strain.csv", "test.png",
    ]  # fmt: skip
    record = json.loads((out / "run.json").read_text())
    assert record["experiment"] == "compression"
    assert record["strength"] == result.strength
    criterion = record["parameters"]["criterion"]
    assert criterion == {"class": "DruckerPrager", "compression": 50e6, "ratio": 5.0}
    assert {"work", "kinetic", "residual"} <= set(record["energy"])
    with (out / "stress_strain.csv").open() as file:
        rows = list(csv.DictReader(file))
    stress = np.array([float(r["axial_stress [Pa]"]) for r in rows])
    assert -stress.min() == pytest.approx(result.strength)
    assert int(rows[-1]["broken_bonds"]) == result.broken_bonds
    with (out / "broken_bonds.csv").open() as file:
        assert len(list(csv.DictReader(file))) == result.broken_bonds
    assert (out / "test.png").read_bytes().startswith(b"\x89PNG")


def test_scene_of_a_test_is_valid_and_shows_its_breaking(pressed):
    result, out, _ = pressed
    stage = opened(out / "scene.usd")
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/broken_bonds"))
    counts = [
        len(curves.GetCurveVertexCountsAttr().Get(frame))
        for frame in range(int(stage.GetEndTimeCode()) + 1)
    ]
    # frames are spent on the breaking, not on the long way to it
    assert counts[0] == 0
    assert sum(c > 0 for c in counts) >= 5
    assert counts[-1] > 0.8 * result.broken_bonds


@pytest.mark.slow
def test_a_confined_specimen_bears_more_than_an_unconfined_one(pressed):
    p = Confined(**SMALL)
    result = confined(p)
    # at least the pressure more, at most what the criterion gains by it
    gain = result.strength - pressed[0].strength
    assert 5e6 < gain < 1.3 * (result.criterion_strength - 50e6)
    assert result.history.stress[0] == pytest.approx(-5e6, rel=0.05)
    assert abs(result.energy_error) < 1e-4
    servo = confined(replace(p, jacket="servo"))
    assert servo.strength == pytest.approx(result.strength, rel=0.1)


def test_strain_rate_can_be_given():
    rate = 2.0 * tension(Tension(**SMALL)).strain_rate
    result = tension(Tension(strain_rate=rate, **SMALL))
    assert result.strain_rate == pytest.approx(rate)
    h = result.history
    assert np.polyfit(h.time, h.strain, 1)[0] == pytest.approx(rate, rel=1e-6)


def test_brazilian_splits_along_the_load():
    result = brazilian(Brazilian(diameter=24e-3))
    # 2P/(pi D t) at which Drucker-Prager breaks under (s, -3 s): 3 sqrt(13) - 4 = 6.817 s
    assert result.criterion_strength == pytest.approx(50e6 / (3 * np.sqrt(13) - 4), rel=1e-3)
    assert 0.6 < result.strength / result.criterion_strength < 1.1
    assert result.young == pytest.approx(20e9, rel=0.03)
    assert result.fracture_angle < 20.0
    assert abs(result.energy_error) < 1e-4
    # Hondros: (sin 2a - a)/a at a = 10 degrees
    assert Brazilian().arc_factor == pytest.approx(0.9596, abs=1e-4)


@pytest.mark.parametrize(
    "change",
    [
        {},
        pytest.param({"shape": "cylinder"}, marks=pytest.mark.slow),
        pytest.param({"packing": "fcc"}, marks=pytest.mark.slow),
    ],
)
def test_tests_in_space(change, tmp_path):
    p = Compression(plane="space", width=7e-3, height=13e-3, **change)
    result = compression(p, out=tmp_path)
    assert result.young == pytest.approx(20e9, rel=0.02)
    assert result.poisson == pytest.approx(0.2, rel=0.03)
    assert abs(result.energy_error) < 1e-4
    assert 0.5 < result.strength / result.criterion_strength < 1.1
    assert (tmp_path / "test.png").stat().st_size > 10_000


def test_a_new_criterion_needs_nothing_here():
    result = tension(Tension(criterion=wd.Rankine(8e6), weibull=inf, **SMALL))
    assert result.criterion_strength == pytest.approx(8e6, rel=1e-3)
    assert result.strength == pytest.approx(8e6, rel=0.05)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Tension(plane="bent"), "plane is 'bent'"),
        (lambda: Tension(packing="fcc"), "packing in plane stress is 'fcc'"),
        (lambda: Tension(shape="cylinder"), "cylinders are Voronoi packings in space"),
        (lambda: Tension(width=1e-3), "must be at least 0.006 x 0.012 m"),
        (lambda: Tension(strain_rate=-1.0), "strain_rate must be greater"),
        (lambda: Tension(weibull=0.0), "weibull must be greater"),
        (lambda: Tension(stop=1.0), "stop is 1"),
        (lambda: Confined(pressure=0.0), "pressure must be greater"),
        (lambda: Confined(jacket="sleeve"), "jacket is 'sleeve'"),
        (lambda: Confined(jacket="servo", plane="space", shape="cylinder"), "flat sides"),
        (lambda: Brazilian(arc=80.0), "arc is 80 degrees"),
        (lambda: Brazilian(packing="hexagonal"), "packing of a disc is 'hexagonal'"),
        (lambda: Brazilian(diameter=5e-3), "the disc is 5 elements across"),
    ],
)
def test_parameters_that_cannot_be_are_refused(make, says):
    with pytest.raises(wd.InputError, match=says):
        make()


# -- envelope and calibration ---------------------------------------------------------------------


@pytest.mark.slow
def test_strength_envelope(tmp_path):
    found = strength_envelope(Specimen(**SMALL), (0.0, 10e6), out=tmp_path)
    assert found.confining == pytest.approx([0.0, 10e6])
    assert found.line_strength[0] == pytest.approx(50e6, rel=1e-3)
    assert found.slope == pytest.approx(np.diff(found.strength)[0] / 10e6)
    sine = np.sin(np.radians(found.friction_angle))
    # Mohr and Coulomb: strength = 2 c cos/(1 - sin) + (1 + sin)/(1 - sin) pressure
    assert (1 + sine) / (1 - sine) == pytest.approx(found.slope)
    cosine = np.sqrt(1 - sine**2)
    assert 2 * found.cohesion * cosine / (1 - sine) == pytest.approx(found.strength[0])
    record = json.loads((tmp_path / "envelope.json").read_text())
    assert [t["test"] for t in record["tests"]] == ["tension", "compression", "confined"]
    assert (tmp_path / "envelope.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(wd.InputError, match="at least two different pressures"):
        strength_envelope(pressures=(1e6, 1e6))


@pytest.mark.slow
def test_calibration_finds_what_was_wanted():
    said = []
    found = wd.calibrate_strength(6e6, 40e6, Specimen(**SMALL), tolerance=0.1, tell=said.append)
    assert found.error <= 0.1
    assert len(said) == len(found.rounds) > 1
    again = tension(Tension(criterion=found.criterion, **SMALL))
    assert again.strength == pytest.approx(6e6, rel=0.1)
    # specimens bear less than their bonds
    assert found.criterion.tension > 6e6
    assert found.criterion.compression > 40e6


def test_calibration_refuses_and_gives_up():
    with pytest.raises(wd.InputError, match="not above the tensile one"):
        wd.calibrate_strength(5e6, 4e6)
    with pytest.raises(wd.InputError, match="rounds is 0"):
        wd.calibrate_strength(5e6, 50e6, rounds=0)
    with pytest.raises(wd.NotConvergedError, match="after 1 rounds a strength is"):
        wd.calibrate_strength(5e6, 50e6, Specimen(**SMALL), rounds=1, tell=None)


# -- command line ---------------------------------------------------------------------------------


def test_criteria_are_read_as_they_are_written():
    for criterion in (wd.DruckerPrager(50e6, 5.0), wd.Rankine(1e7), wd.HuberMisesHencky(3e7)):
        assert read_criterion(write_criterion(criterion)) == criterion
    assert read_criterion("drucker-prager:5e7,ratio=4") == wd.DruckerPrager(5e7, 4.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("wish:1", "criterion is 'wish'; choose one of"),
        ("rankine:strong", "rankine takes numbers: write rankine:tension=..."),
        ("rankine:1,2", "rankine takes numbers"),
        ("drucker-prager:1e6", "drucker-prager takes numbers"),
        ("drucker-prager:1e6,0.5", "ratio is 0.5"),
    ],
)
def test_criteria_that_cannot_be_read(text, says):
    with pytest.raises(wd.InputError, match=says):
        read_criterion(text)


def test_command_runs_and_says_what_it_found(tmp_path):
    done = warpdem(
        "run", "tension", "--width", "0.012", "--height", "0.02", "--criterion", "rankine:8e6",
        "--precision", "float32", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for words in (
        "direct tension", "elements", "in float32", "MPa at the peak", "of the criterion's 8 MPa",
        "Young's modulus 20", "degrees to the load (expected 90)", "energy error", "test.png",
    ):  # fmt: skip
        assert words in done.stdout, words
    record = json.loads((tmp_path / "out" / "tension" / "run.json").read_text())
    assert record["parameters"]["criterion"] == {"class": "Rankine", "tension": 8e6}


@pytest.mark.parametrize("name", ["compression", "confined", "brazilian"])
def test_commands_refuse_with_one_sentence(name, tmp_path):
    done = warpdem("run", name, "--criterion", "wish", cwd=tmp_path)
    assert done.returncode == 2
    (line,) = [x for x in done.stderr.splitlines() if "CUDA driver" not in x]
    assert line.startswith("error: criterion is 'wish'")
    assert not list(tmp_path.iterdir())

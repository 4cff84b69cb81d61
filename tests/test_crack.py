"""The crack instrument against cracks, vortices and fields that are known."""

import json
from math import pi, sqrt
from types import SimpleNamespace

import numpy as np
import pytest

import warpdem as wd
from warpdem.observe.growth import (
    find_branches,
    find_front,
    front_speeds,
    released_energy_rate,
    window_speeds,
)
from warpdem.observe.release import (
    domain_integral,
    energy_release_rate,
    gradients,
    process_zone,
    stress_ahead,
)
from warpdem.observe.vortex import PlaneField, find_vortices, on_grid

DT = 0.2  # of break times, which are whole steps


def breaks(speed, length=200.0, jitter=0.0, late=0.0, seed=0):
    """Places every half spacing and times of a crack whose speed is a function of its length."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.0, length, 0.5)
    fine = np.linspace(0.0, length, 20001)
    slowness = 1.0 / speed(fine)
    t = np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(fine))])
    time = np.interp(x, fine, t) + rng.normal(0.0, jitter, len(x))
    outliers = rng.random(len(x)) < late
    time[outliers] += 40.0
    return x, np.round(time / DT) * DT


@pytest.mark.parametrize(("jitter", "late"), [(0.0, 0.0), (1.0, 0.0), (0.5, 0.1)])
def test_constant_speed(jitter, late):
    x, t = breaks(lambda x: 0.5 + 0.0 * x, jitter=jitter, late=late)
    middle, speed = window_speeds(x, t, 25.0)
    assert len(middle) >= 7
    assert speed == pytest.approx(0.5, rel=0.03)


def test_accelerating_crack():
    x, t = breaks(lambda x: 0.2 + 0.004 * x, jitter=0.5)
    middle, speed = window_speeds(x, t, 20.0)
    assert len(middle) == 9
    assert speed == pytest.approx(0.2 + 0.004 * middle, rel=0.06)


def test_branches_of_a_forked_crack():
    """A crack that forks at 100: two arms at 30 degrees, one faster; and a crack apart from it."""
    stem = np.stack([np.arange(0.0, 100.0, 0.5), np.zeros(200)], axis=1)
    s = np.arange(0.5, 60.0, 0.5)
    arms = [np.stack([99.5 + s * np.cos(a), s * np.sin(a)], axis=1) for a in (pi / 6.0, -pi / 6.0)]
    apart = np.stack([np.arange(0.0, 30.0, 0.5), np.full(60, 50.0)], axis=1)
    time = [2.0 * stem[:, 0], 199.0 + s / 0.5, 199.0 + s[:80] / 0.25, 10.0 + apart[:, 0] / 0.4]
    place = np.concatenate([stem, arms[0], arms[1][:80], apart])
    rng = np.random.default_rng(4)
    order = rng.permutation(len(place))
    found = find_branches(place[order], np.concatenate(time)[order], 1.6, 8.0)
    assert [b.crack for b in found] == [0, 0, 1]
    assert [b.parent for b in found] == [None, 0, None]
    assert found[0].length == pytest.approx(99.5 + 59.5, abs=1.0)
    assert found[1].length == pytest.approx(40.0, abs=2.5)
    assert found[2].length == pytest.approx(29.5, abs=1e-9)
    assert found[0].tip == pytest.approx(arms[0][-1])
    assert found[1].tip == pytest.approx(arms[1][79])
    for branch, exact in zip(found, (0.5, 0.25, 0.4), strict=True):
        assert branch.speeds(10.0)[1] == pytest.approx(exact, rel=0.02)
    assert sorted(np.concatenate([b.rows for b in found])) == list(range(len(place)))


def test_a_crack_that_runs_both_ways_has_two_tips():
    x = np.arange(-40.0, 50.0, 0.5)
    place = np.stack([x, 0.1 * np.sin(x)], axis=1)
    found = find_branches(place, np.abs(x) / 0.5, 1.6, 8.0)
    assert sorted(round(float(b.tip[0])) for b in found) == [-40, 50]
    for branch in found:
        assert branch.speeds(10.0)[1] == pytest.approx(0.5, rel=0.02)


def test_front_in_space():
    y, z = np.meshgrid(np.arange(0.0, 100.0, 0.5), np.arange(0.0, 20.0))
    place = np.stack([y.ravel(), np.zeros(y.size), z.ravel()], axis=1)
    speed = 0.4 + 0.01 * place[:, 2]
    slices = front_speeds(place, place[:, 0] / speed, [1, 0, 0], [0, 0, 1], 20, 20.0)
    for where, middle, found in slices:
        assert len(middle) >= 4
        assert found == pytest.approx(0.4 + 0.01 * np.floor(where / 0.95), rel=1e-6)


def test_where_a_front_is_in_space():
    """A front that is behind on one side, its places at two instants."""
    x, z = np.meshgrid(np.arange(0.0, 50.0, 0.5), np.arange(0.5, 10.0))
    place = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    time = (place[:, 0] + 0.8 * np.floor(place[:, 2] / 2.5)) / 0.5
    front = find_front(place, time, [1, 0, 0], [0, 0, 1], 4, 30)
    assert front.ahead.shape == (30, 4)
    lag = front.ahead[5:25] - front.ahead[5:25, :1]
    assert np.abs(lag + 0.8 * np.arange(4)).max() <= 0.5
    assert front.roughness == pytest.approx(0.8 * np.std(np.arange(4)), rel=0.2)
    nothing = find_front(np.zeros((0, 3)), [], [1, 0, 0], [0, 0, 1], 4, 30)
    assert np.isnan(nothing.roughness)


def test_many_breaks_in_a_window():
    x, t = breaks(lambda x: 0.5 + 0.0 * x, length=4000.0, jitter=0.5)
    assert window_speeds(x, t, 3900.0)[1] == pytest.approx(0.5, rel=0.01)


def test_released_energy_over_area():
    x = np.arange(0.0, 100.0, 0.5)
    _, found = released_energy_rate(x, np.full(len(x), 3e-3), 10.25, 0.2)
    assert found == pytest.approx(3e-3 / (0.5 * 0.2), rel=0.03)  # 20 or 21 breaks in a window


# -- vortices -------------------------------------------------------------------------------------


def swirl(x, centre, circulation, core, kind):
    """Velocity of a vortex: Rankine's, or Lamb's and Oseen's."""
    away = x - np.asarray(centre)
    r2 = np.maximum((away**2).sum(axis=-1), 1e-300)
    share = np.minimum(r2 / core**2, 1.0) if kind == "rankine" else 1.0 - np.exp(-r2 / core**2)
    speed = circulation / (2.0 * pi * r2) * share
    return speed[..., None] * np.stack([-away[..., 1], away[..., 0]], axis=-1)


@pytest.mark.parametrize("kind", ["rankine", "lamb"])
def test_a_pair_of_vortices(kind):
    """Between elements of a packing, as beside a mode I crack."""
    p = wd.packing.hexagonal((80.0, 80.0), 1.0)
    pair = [((40.0, 52.0), 5.0), ((40.0, 28.0), -5.0)]
    v = sum(swirl(p.position, c, g, 4.0, kind) for c, g in pair)
    field = on_grid(p.position, v, (5.0, 5.0), (75.0, 75.0), 0.5)
    found = find_vortices(field, 6.0)
    assert [v.sign for v in found] in ([1, -1], [-1, 1])
    for centre, circulation in pair:
        (one,) = (v for v in found if v.sign == np.sign(circulation))
        assert one.centre == pytest.approx(centre, abs=1.0)
        # circles about one vortex do not feel the other
        assert one.circulation == pytest.approx(circulation, rel=0.02)
        assert np.sign(one.vorticity) == one.sign
        assert abs(one.swirl) > 0.9


def test_no_vortex_in_strain_or_streams():
    x = np.linspace(-20.0, 20.0, 81)
    grid = np.stack(np.meshgrid(x, x), axis=-1)
    for velocity in (
        np.stack([grid[..., 0], -grid[..., 1]], axis=-1),
        np.ones_like(grid),
        np.stack([grid[..., 1], 0.0 * grid[..., 0]], axis=-1),  # shear alone is no vortex
    ):
        assert not find_vortices(PlaneField(x, x, velocity), 6.0, 0.8)


def test_bad_input_is_a_sentence():
    for call, says in (
        (lambda: window_speeds([0.0, 1.0], [0.0], 1.0), "2 coordinates and 1 times"),
        (lambda: window_speeds([0.0], [0.0], -1.0), "window"),
        (lambda: find_branches([[0.0, 0.0]], [0.0], 0.0, 1.0), "reach"),
        (lambda: on_grid([[0.0, 0.0]] * 5, [[0.0, 0.0]] * 5, (1, 1), (0, 2), 0.1), "corner"),
    ):
        with pytest.raises(wd.InputError, match=says):
            call()


# -- energy release rate --------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["I", "II"])
@pytest.mark.parametrize("kind", ["hexagonal", "voronoi"])
@pytest.mark.parametrize(("inner", "outer"), [(6.0, 18.0), (12.0, 25.0)])
def test_domain_integral_of_the_near_field(mode, kind, inner, outer):
    """K^2/E' of Westergaard's field, its gradients taken from displacements of elements."""
    from warpdem.validation.tip import near_field

    size = 60.0
    make = {"hexagonal": wd.packing.hexagonal, "voronoi": wd.packing.voronoi}[kind]
    p = make((size, size), 1.0)
    tip = np.array([0.5 * size, 0.5 * size])
    glass = wd.Material(1.0, 0.25, 1.0)
    u, _ = near_field(p.position - tip, mode, glass.shear_modulus, 3.0 - 4.0 * glass.poisson)
    whole = np.ones(len(p.bonds), dtype=bool)
    whole[p.crossing((-1.0, tip[1]), tip)] = False
    grad = gradients(p.position, p.bonds[whole], u)
    strain = 0.5 * (grad + grad.transpose(0, 2, 1))
    trace = np.trace(strain, axis1=1, axis2=2)
    lame = glass.lame("strain")
    stress = 2.0 * glass.shear_modulus * strain + lame * trace[:, None, None] * np.eye(2)
    found = domain_integral(p.position, p.volume, grad, stress, tip, (1.0, 0.0), inner, outer)
    assert found == pytest.approx(1.0 / glass.plane_modulus(), rel=0.03)


def test_domain_integral_of_a_moving_field():
    """A steady screw-like pulse: kinetic terms of a field u(x - v t) without a crack give nothing.

    A travelling P wave u_1 = f(x - c_P t) carries energy, but no tip draws any.
    """
    p = wd.packing.hexagonal((60.0, 60.0), 1.0)
    glass = wd.Material(1.0, 0.25, 1.0)
    c, x = glass.pressure_speed("strain"), p.position[:, 0] - 30.0
    w = 8.0
    f = np.exp(-((x / w) ** 2))
    df, ddf = -2.0 * x / w**2 * f, (4.0 * x**2 / w**4 - 2.0 / w**2) * f
    zero = np.zeros((len(p), 2, 2))
    grad, rate = zero.copy(), zero.copy()
    grad[:, 0, 0], rate[:, 0, 0] = df, -c * ddf
    v, a = np.zeros((2, len(p), 2))
    v[:, 0], a[:, 0] = -c * df, c**2 * ddf
    stress = zero.copy()
    stress[:, 0, 0] = (glass.lame("strain") + 2.0 * glass.shear_modulus) * df
    stress[:, 1, 1] = glass.lame("strain") * df
    found = domain_integral(
        p.position, p.volume, grad, stress, (30.0, 30.0), (1.0, 0.0), 8.0, 20.0, 1.0, v, a, rate
    )
    static = domain_integral(
        p.position, p.volume, grad, stress, (34.0, 30.0), (1.0, 0.0), 8.0, 20.0
    )
    moved = domain_integral(
        p.position, p.volume, grad, stress, (34.0, 30.0), (1.0, 0.0), 8.0, 20.0, 1.0, v, a, rate
    )
    size = (stress[:, 0, 0] * df * p.volume).sum()
    assert abs(found) < 1e-3 * size
    assert abs(moved) < 1e-2 * abs(static)


def test_a_strip_crack_draws_the_strips_energy():
    """J of a crack at rest in a gripped strip: the energy of a length far ahead (Rice 1968)."""
    height = 60.0
    p = wd.packing.hexagonal((200.0, height), 1.0)
    glass = wd.Material(1.0, 0.25, 1.0)
    scene = wd.Scene()
    body = scene.add(p, glass, fracture=wd.Rankine(1.0))
    rows = np.unique(np.round(p.position[:, 1], 6))
    y = rows[len(rows) // 2 - 1 : len(rows) // 2 + 1].mean()
    scene.cut(body, (-1.0, y), (100.0, y))
    strain = 1e-4
    scene.strain(body, [[0.0, 0.0], [0.0, strain]])
    for side in ("top", "bottom"):
        scene.hold(body, p.side(side, 1))
    sim = wd.Simulation(scene)
    sim.relax(1e-6)
    modulus = glass.lame("strain") + 2.0 * glass.shear_modulus
    exact = 0.5 * modulus * strain**2 * (rows[-1] - rows[0])
    for inner, outer in ((8.0, 18.0), (14.0, 26.0)):
        found = energy_release_rate(sim, (100.0, y), inner, outer)
        assert found == pytest.approx(exact, rel=0.03)
    assert sqrt(found * glass.plane_modulus()) < 1.0


def test_stress_ahead_in_a_uniform_state():
    """Normal and shear stress on a line through a plate in uniform plane strain: Hooke's law."""
    rock = wd.Material(1.0, 0.25, 1.0)
    p = wd.packing.hexagonal((20.0, 15.0), 1.0)
    scene = wd.Scene()
    body = scene.add(p, rock)
    strain = np.array([[1e-5, 4e-6], [4e-6, -2e-5]])
    scene.strain(body, strain)
    sim = wd.Simulation(scene)
    tip, ahead = np.array([8.0, 7.0]), np.array([3.0, 1.0]) / np.sqrt(10.0)
    distance, normal, shear = stress_ahead(sim, tip, ahead, 6.0)
    stress = 2.0 * rock.shear_modulus * strain + rock.lame("strain") * np.trace(strain) * np.eye(2)
    across = np.array([-ahead[1], ahead[0]])
    assert len(distance) >= 6
    assert (np.diff(distance) >= 0.0).all() and distance[0] > 0.0 and distance[-1] < 6.0
    assert normal == pytest.approx(across @ stress @ across, rel=1e-3)
    assert shear == pytest.approx(across @ stress @ ahead, rel=1e-3)


def test_process_zone_ends_at_the_first_gap():
    """A row of elements, its first bond broken: bonds 1..6 are near breaking, then 12 alone."""
    x = np.stack([np.arange(20.0), np.zeros(20)], axis=1)
    ratio = np.zeros(19)
    ratio[1:7] = 0.8
    ratio[12] = 0.9
    linked = np.ones(19, dtype=bool)
    linked[0] = False
    log = np.zeros(1, dtype=[("x", float), ("y", float)])
    log["x"] = 0.5
    sim = SimpleNamespace(
        broken_bonds=lambda: log,
        model=SimpleNamespace(features=SimpleNamespace(dim=2)),
        scene=SimpleNamespace(bodies=[SimpleNamespace(packing=SimpleNamespace(spacing=1.0))]),
        position=x, displacement=np.zeros_like(x), criterion_ratio=ratio, linked=linked,
        bonds=np.stack([np.arange(19), np.arange(1, 20)], axis=1),
    )  # fmt: skip
    assert process_zone(sim) == pytest.approx(6.0)
    assert process_zone(sim, share=0.85) == 0.0


def test_mode_i_by_toughness_and_overload():
    """The Griffith load of a strip: its energy ahead, integrated over the height, is G_c."""
    p = wd.experiments.ModeI(toughness=0.7e6, overload=1.0)
    glass = p.material
    free = p.height - 2.0 * sqrt(3.0) * p.distance  # two rows are gripped on either side
    stress = (glass.lame("strain") + 2.0 * glass.shear_modulus) * p.load
    assert 0.5 * stress * p.load * free == pytest.approx(0.7e6**2 / glass.plane_modulus())
    twice = wd.experiments.ModeI(toughness=0.7e6, overload=2.0)
    assert twice.load == pytest.approx(2.0 * p.load)
    small = {"length": 8e-4, "height": 3.7e-4, "notch": 1.5e-4, "toughness": 0.7e6}
    # below the Griffith load nothing runs, well above it the crack does
    for overload, runs in ((0.7, False), (1.6, True)):
        found = wd.experiments.mode_i(wd.experiments.ModeI(**small, overload=overload))
        assert np.isfinite(found.speed_over_rayleigh) == runs
    with pytest.raises(wd.InputError, match="needs toughness"):
        wd.experiments.ModeI(overload=1.5)


def test_mode_i_in_space(tmp_path):
    """A plate of fcc that repeats across its thickness: the front stays straight, at the speed of
    the plane; the free sides of random cells, the files, and what is refused."""
    small = {"length": 8e-4, "height": 4e-4, "notch": 1.2e-4}
    fcc = wd.experiments.ModeI(packing="fcc", thickness=6e-5, **small)
    found = wd.experiments.mode_i(fcc, out=tmp_path, frames=2)
    assert found.simulation.model.features.dim == 3
    assert 0.85 < found.speed_over_rayleigh < 1.0
    assert found.front_roughness_spacings < 1e-9
    assert found.field.position.shape[1] == 2
    rows = (tmp_path / "front.csv").read_text().splitlines()
    assert rows[0] == "time [s],z [m],x [m]" and len(rows) == 1 + found.front.ahead.size
    told = json.loads((tmp_path / "run.json").read_text())
    assert told["parameters"]["spacing"] == 2e-5 and told["parameters"]["overload"] == 1.65
    assert told["speed_over_rayleigh"] == found.speed_over_rayleigh
    for wrong, says in (
        ({"thickness": 1e-4}, "hexagonal packings are of the plane"),
        ({"packing": "fcc", "sides": "glued"}, "sides is 'glued'"),
    ):
        with pytest.raises(wd.InputError, match=says):
            wd.experiments.ModeI(**wrong)
    with pytest.raises(wd.InputError, match="do not rub"):
        wd.experiments.ModeII(packing="fcc", friction=0.3)


@pytest.mark.slow
def test_free_sides_in_space():
    """A front between free sides runs, too, on random cells."""
    small = {"length": 8e-4, "height": 4e-4, "notch": 1.2e-4}
    p = wd.experiments.ModeI(packing="voronoi", thickness=8e-5, sides="free", **small)
    found = wd.experiments.mode_i(p)
    assert 0.8 < found.speed_over_rayleigh < 1.0
    assert found.front_roughness_spacings < 1.0

import numpy as np
import pytest

import warpdem as wd

STEEL = wd.Material(200e9, 0.3, 7800)


@pytest.fixture
def plate():
    return wd.packing.hexagonal((8, 7), 1.0)


@pytest.fixture
def scene():
    return wd.Scene()


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda s, b: s.hold(b, []), "selection is empty"),
        (lambda s, b: s.hold(b, [0, 1000]), "selected ids 1000 lie outside"),
        (lambda s, b: s.hold(b, np.zeros(3, bool)), "the mask has shape"),
        (lambda s, b: s.hold(b, [0], axes="q"), "axes is 'q'"),
        (lambda s, b: s.hold(b, [0], velocity=(np.inf, 0)), "velocity is not finite"),
        (lambda s, b: s.cut(b, (0, 0), (0, 0)), "coincide"),
        (lambda s, b: s.cut(b, (100, 0), (101, 0)), "no bond crosses"),
        (lambda s, b: s.strain(b, [[0, 1], [0, 0]]), "symmetric"),
        (lambda s, b: s.strain(b, [[0, np.nan], [0, 0]]), "not finite"),
        (lambda s, b: s.set_strength(b, 0.0), "greater than zero"),
        (lambda s, b: s.set_strength(b, 2.0), "no fracture criterion"),
        (lambda s, b: s.pull(b, [20], (0, 1.0)), "no free surface"),
        (lambda s, b: s.set_velocity(b, (1.0, 2.0, 3.0)), "velocity has shape"),
        (lambda s, b: s.add(wd.packing.fcc((3, 3, 3), 1.0), STEEL), "share the dimension"),
        (lambda s, b: wd.Scene().hold(b, [0]), "not in the scene"),
        (lambda s, b: s.add(b.packing, STEEL, bond="glue"), "'facet' or an EVMBond"),
    ],
)
def test_what_cannot_be_done_is_refused(scene, plate, act, says):
    body = scene.add(plate, STEEL)
    with pytest.raises(wd.InputError, match=says):
        act(scene, body)


def test_facets_are_needed_for_facet_bonds(scene):
    net = wd.packing.network([[0, 0], [1, 0]], [[0, 1]], 1.0, plane="strain")
    with pytest.raises(wd.InputError, match="packing with faces"):
        scene.add(net, STEEL)


def test_an_empty_scene_is_refused(scene):
    with pytest.raises(wd.InputError, match="scene is empty"):
        wd.Simulation(scene)


def test_negative_poisson_on_raw_cells_is_refused(scene):
    # random, not relaxed cells: 3 of 3 packings are indefinite at nu = -0.5 (theory B8)
    scene.add(wd.packing.voronoi((10, 10), 1.0, relaxations=0), wd.Material(1.0, -0.5, 1.0))
    with pytest.raises(wd.InputError, match="not positive definite"):
        wd.Simulation(scene)


def test_traction_adds_up_to_stress_times_side(scene, plate):
    body = scene.add(plate, STEEL)
    scene.pull(body, plate.top, (0.0, 5.0))
    # eight columns of spacing 1: the side's projected length, corners with their halves
    assert body.force[:, 1].sum() == pytest.approx(5.0 * 8.0, rel=0.07)


@pytest.mark.parametrize(
    "make",
    [
        lambda: wd.EVMBond(0.0, 1.0, 1.0),
        lambda: wd.EVMBond(1.0, -1.0, 1.0),
        lambda: wd.DruckerPrager(1.0, 0.5),
        lambda: wd.Rankine(-1.0),
        lambda: wd.HuberMisesHencky(np.nan),
    ],
)
def test_bad_laws_are_refused(make):
    with pytest.raises(wd.InputError):
        make()


def test_offsets_must_leave_a_bond(scene):
    net = wd.packing.network([[0, 0], [1, 0]], [[0, 1]], 1.0, plane="strain")
    scene.add(net, STEEL, bond=wd.EVMBond(1.0, 1.0, 1.0, offset=0.5))
    with pytest.raises(wd.InputError, match="bonds 0: the offsets"):
        wd.Simulation(scene)


def test_pieces_and_lone_elements_are_told():
    two = wd.packing.network([[0, 0], [1, 0], [3, 0], [4, 0], [9, 9]], [[0, 1], [2, 3]], 1.0,
                             plane="strain")  # fmt: skip
    bond = wd.EVMBond(1.0, 1.0, 1.0)
    with pytest.warns(wd.ModelWarning, match="in 3 pieces .* elements 4 have no bond"):
        wd.Scene().add(two, STEEL, bond=bond)


GEARS = {
    "square": lambda: wd.packing.square((4, 4), 1.0),
    "simple cubic": lambda: wd.packing.simple_cubic((3, 3, 3), 1.0),
    "bcc": lambda: wd.packing.bcc((4, 4, 4), 1.0),
}


@pytest.mark.parametrize("name", GEARS)
def test_gear_modes_are_told_and_cost_nothing(name):
    shape = GEARS[name]()
    scene = wd.Scene()
    with pytest.warns(wd.ModelWarning, match="gear modes"):
        scene.add(shape, STEEL)
    # neighbours turned in opposite senses: which sense is which follows from the bonds
    sense = np.zeros(len(shape))
    sense[0] = 1.0
    while not sense.all():
        for i, j in shape.bonds:
            sense[j] = sense[j] or -sense[i]
            sense[i] = sense[i] or -sense[j]
    sim = wd.Simulation(scene, dt=1e-9)
    angle = 1e-3 * sense
    q = np.zeros((len(shape), 2 if shape.dim == 2 else 4))
    q[:, -2 if shape.dim == 3 else 0], q[:, -1] = np.sin(angle / 2), np.cos(angle / 2)
    sim.set_state(orientation=q)
    held = sim.energy()["pair"]
    q[:, -2 if shape.dim == 3 else 0] = np.sin(5e-4)  # the same turns, all in one sense
    sim.set_state(orientation=q)
    assert held < 1e-5 * sim.energy()["pair"]


@pytest.mark.parametrize("make", [lambda: wd.packing.hexagonal((4, 4), 1.0),
                                  lambda: wd.packing.fcc((3, 3, 3), 1.0),
                                  lambda: wd.packing.voronoi((4, 4), 1.0)])  # fmt: skip
def test_frustrated_packings_have_no_gears(make):
    assert not make().has_gears


def test_bending_stiffness_cures_gears(recwarn):
    wd.Scene().add(wd.packing.square((4, 4), 1.0), STEEL, bond=wd.EVMBond(1.0, 1.0, 0.1))
    assert not recwarn


def test_grips_keep_their_velocity(scene, plate):
    body = scene.add(plate, STEEL)
    scene.hold(body, plate.bottom)
    scene.hold(body, plate.top, velocity=(0.0, 2.0))
    scene.set_velocity(body, (5.0, 5.0), angular_velocity=[1.0])
    assert not body.velocity[plate.bottom].any()
    assert (body.velocity[plate.top] == [0.0, 2.0]).all()
    assert not body.angular_velocity[plate.top].any()
    assert (body.velocity[~(plate.top | plate.bottom)] == 5.0).all()

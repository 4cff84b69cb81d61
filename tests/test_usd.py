import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Usd, UsdGeom
from stages import opened

import warpdem as wd
from warpdem.validation import core
from warpdem.write.film import write_film


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory):
    """A body that breaks, written every 40 steps, and the arrays of its last frame."""
    path = tmp_path_factory.mktemp("usd") / "body.usd"
    p = core.small_packing("voronoi strain")
    scene = wd.Scene()
    body = scene.add(p, wd.Material(1.0, 0.3, 1.0), fracture=wd.Rankine(2e-3))
    scene.set_velocity(body, 0.01 * np.sign(p.position - p.position.mean(axis=0)))
    sim = wd.Simulation(scene)
    sim.observe(wd.UsdWriter(path, every=40))
    sim.run(steps=120)
    return path, sim


def test_validator_finds_nothing(scene_file):
    opened(scene_file[0])


def test_reading_back_gives_the_simulation(scene_file):
    path, sim = scene_file
    stage = Usd.Stage.Open(str(path))
    end = stage.GetEndTimeCode()
    assert (stage.GetStartTimeCode(), end) == (0, 3)
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements"))
    place = np.array(points.GetPointsAttr().Get(end))
    assert place[:, :2] == pytest.approx(sim.position, rel=1e-6)
    assert not place[:, 2].any()
    api = UsdGeom.PrimvarsAPI(points)
    stress = sim.stress
    mean = np.trace(stress, axis1=1, axis2=2) / 3
    deviator = stress - mean[:, None, None] * np.eye(3)
    fields = {
        "mean_stress": mean,
        "von_mises": np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))),
        "damage": sim.damage,
    }
    for name, value in fields.items():
        found = np.array(api.GetPrimvar(name).Get(end))
        assert np.abs(found - value).max() <= 1e-6 * np.abs(value).max(), name
    velocity = np.array(api.GetPrimvar("velocity").Get(end))
    assert np.abs(velocity[:, :2] - sim.velocity).max() < 1e-6 * np.abs(sim.velocity).max()
    assert list(points.GetIdsAttr().Get()) == list(range(len(place)))
    time = stage.GetDefaultPrim().GetAttribute("warpdem:time").Get(end)
    assert time == pytest.approx(sim.time)


def test_broken_bonds_are_curves(scene_file):
    path, sim = scene_file
    stage = Usd.Stage.Open(str(path))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/broken_bonds"))
    counts = curves.GetCurveVertexCountsAttr().Get(stage.GetEndTimeCode())
    assert len(counts) == len(sim.broken_bonds()) > 10
    assert len(curves.GetPointsAttr().Get(0)) == 0


def test_stage_says_what_it_is(scene_file):
    stage = Usd.Stage.Open(str(scene_file[0]))
    assert stage.GetDefaultPrim().GetPath() == "/World"
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements"))
    for frame in range(4):
        low, high = np.array(points.GetExtentAttr().Get(frame))
        place = np.array(points.GetPointsAttr().Get(frame))
        assert (low <= place.min(axis=0)).all()
        assert (high >= place.max(axis=0)).all()


def test_nothing_is_left_under_another_name(scene_file):
    assert [f.name for f in scene_file[0].parent.iterdir()] == ["body.usd"]


def test_the_camera_sees_all_elements(scene_file):
    stage = Usd.Stage.Open(str(scene_file[0]))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/camera"))
    frustum = camera.GetCamera(0).frustum
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements"))
    assert all(frustum.Intersects(Gf.Vec3d(*map(float, x))) for x in points.GetPointsAttr().Get(0))
    assert not frustum.Intersects(Gf.Vec3d(1e3, 0.0, 0.0))


def test_a_film_shows_elements_and_cracks(scene_file, tmp_path):
    """Colours at the places of elements, and red where bonds broke, in the last frame."""
    path, sim = scene_file
    assert write_film(path, tmp_path / "film.gif", 200) == 4
    assert write_film(path, tmp_path / "film.png", 200) == 4
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 4
    assert len(list(tmp_path.glob("film_*.png"))) == 4
    stage = Usd.Stage.Open(str(path))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/camera"))
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements"))
    colors = np.array(points.GetDisplayColorPrimvar().Get(0))
    middle = np.array(camera.ComputeLocalToWorldTransform(0).ExtractTranslation())[:2]
    width = 0.1 * camera.GetHorizontalApertureAttr().Get()
    first = np.array(Image.open(tmp_path / "film_0000.png"))
    last = np.array(Image.open(tmp_path / "film_0003.png"))
    step = width / first.shape[1]
    for k in (0, 7, len(colors) - 1):
        x, y = (np.array(points.GetPointsAttr().Get(0))[k, :2] - middle) / step
        found = first[int(0.5 * first.shape[0] - y), int(0.5 * first.shape[1] + x)]
        assert found == pytest.approx(255.0 * colors[k], abs=1.0)
    red = (217, 26, 26)
    assert not (first == red).all(axis=2).any()
    assert (last == red).all(axis=2).any() and len(sim.broken_bonds())
    with pytest.raises(wd.InputError, match=r"must end in \.gif"):
        write_film(path, tmp_path / "film.mp4")
    with pytest.raises(wd.InputError, match="there is no file"):
        write_film(tmp_path / "none.usd", tmp_path / "film.gif")


def test_bad_targets_are_refused(tmp_path):
    with pytest.raises(wd.InputError, match=r"must end in \.usd"):
        wd.UsdWriter(tmp_path / "scene.obj")
    with pytest.raises(wd.InputError, match="color is 'pressure'"):
        wd.UsdWriter(tmp_path / "scene.usd", color="pressure")
    (tmp_path / "file").touch()
    with pytest.raises(wd.InputError, match="cannot write into the folder"):
        wd.UsdWriter(tmp_path / "file" / "scene.usd")


def test_a_run_that_fails_leaves_its_sound_frames(tmp_path):
    scene = wd.Scene()
    body = scene.add(core.small_packing("hex strain"), wd.Material(1.0, 0.3, 1.0))
    scene.set_velocity(body, (1e-3, 0.0), where=[3])
    sim = wd.Simulation(scene, dt=100.0, force_dt=True)
    sim.observe(wd.UsdWriter(tmp_path / "body.usd", every=1000))
    with pytest.raises(wd.NonFiniteError):
        sim.run(steps=20_000)
    assert [f.name for f in tmp_path.iterdir()] == ["body.take"]
    stage = Usd.Stage.Open(str(tmp_path / "body.take" / "root.usda"))
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements"))
    for frame in range(int(stage.GetEndTimeCode()) + 1):
        assert np.isfinite(np.array(points.GetPointsAttr().Get(frame))).all()


def test_a_take_shows_what_its_single_file_does(scene_file, tmp_path):
    sim = wd.Simulation(scene_file[1].scene)
    film = sim.observe(wd.UsdWriter(tmp_path / "body.usd", every=40, single=False))
    sim.run(steps=120)
    assert [f.name for f in tmp_path.iterdir()] == ["body.take"]
    take = opened(film.take / "root.usda")
    single = Usd.Stage.Open(str(scene_file[0]))
    assert take.GetEndTimeCode() == single.GetEndTimeCode() == 3
    compared = 0
    for prim in single.Traverse():
        for attribute in prim.GetAttributes():
            shown = take.GetAttributeAtPath(attribute.GetPath())
            assert shown.GetNumTimeSamples() in (attribute.GetNumTimeSamples(), 0)
            for frame in range(4):
                assert shown.Get(frame) == attribute.Get(frame), attribute.GetPath()
                compared += attribute.GetNumTimeSamples() > 0
    assert compared > 40


def test_bonds_of_a_network_are_curves(tmp_path):
    rod = wd.packing.helix(1.0, 0.3, 2, 12, wd.Circle(0.05))
    steel = wd.Material(1.0, 0.3, 1.0)
    scene = wd.Scene()
    bond = wd.EVMBond.timoshenko(steel, wd.Circle(0.05), rod.bond_length)
    scene.set_velocity(scene.add(rod, steel, bond=bond), (0.0, 0.0, 1e-3))
    sim = wd.Simulation(scene)
    sim.observe(wd.UsdWriter(tmp_path / "rod.usd", every=10))
    sim.run(steps=20)
    stage = opened(tmp_path / "rod.usd")
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/bonds"))
    assert list(curves.GetCurveVertexCountsAttr().Get(2)) == [2] * len(rod.bonds)
    ends = np.array(curves.GetPointsAttr().Get(2)).reshape(-1, 2, 3)
    assert ends == pytest.approx(sim.position[rod.bonds], rel=1e-6, abs=1e-6)
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/World/camera")).GetCamera(0).frustum
    assert all(frustum.Intersects(Gf.Vec3d(*x)) for x in sim.position.tolist())


def test_a_crack_in_a_slab_that_repeats(tmp_path):
    """Its faces are squares of the bonds' area on either side, bonds through sides end at images,
    and the camera looks at the large side."""
    p = wd.packing.fcc((8.0, 6.0, 2.9), 1.0, periodic="z")
    scene = wd.Scene()
    body = scene.add(p, wd.Material(1.0, 0.3, 1.0), fracture=wd.Rankine(1.0))
    cut = scene.cut(body, (-1.0, 3.0 * np.sqrt(0.5), 0.0), (4.0, 3.0 * np.sqrt(0.5), 0.0))
    scene.set_velocity(body, 1e-3 * np.sign(p.position - p.position.mean(axis=0)))
    sim = wd.Simulation(scene)
    sim.observe(wd.UsdWriter(tmp_path / "slab.usd", every=10))
    sim.run(steps=20)
    stage = opened(tmp_path / "slab.usd")
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/broken_bonds"))
    ends = np.array(curves.GetPointsAttr().Get(2)).reshape(-1, 2, 3)
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == pytest.approx(1.0, abs=0.1)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/crack_faces"))
    corners = np.array(mesh.GetPointsAttr().Get(2)).reshape(2, -1, 4, 3)
    assert corners.shape[1] == len(cut) > 40
    edge = np.diff(corners, axis=2)
    size = np.linalg.norm(np.cross(edge[..., 0, :], edge[..., 1, :]), axis=-1)
    assert size == pytest.approx(p.area[0], rel=1e-5)
    gap = corners[1].mean(axis=1) - corners[0].mean(axis=1)
    gap[:, 2] -= p.period[2] * np.rint(gap[:, 2] / p.period[2])  # through a side
    assert np.linalg.norm(gap, axis=1).max() < 0.1
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/camera"))
    sight = np.array(camera.ComputeLocalToWorldTransform(0))[2, :3]
    assert sight == pytest.approx([0.0, 0.0, 1.0])

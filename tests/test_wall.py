import numpy as np
import pytest
from pxr import UsdGeom
from stages import opened

import warpdem as wd
from warpdem.validation.contact import SOFT, ball
from warpdem.validation.wall import SIDES, box_mesh


def scene_with_ball(dim=3):
    scene = wd.Scene()
    scene.add(ball(np.zeros(dim), 0.5), SOFT)
    scene.contact()
    return scene


def test_planes_are_what_they_were():
    scene = scene_with_ball(2)
    one = scene.wall([0.0, -0.4], [0.0, 1.0])
    two = scene.wall(wd.wall.Plane([0.0, -0.4], [0.0, 2.0]))
    sim = wd.Simulation(scene)
    assert sim.wall_force(one)[1] < 0.0
    assert np.array_equal(sim.wall_force(one), sim.wall_force(two))


def test_a_path_is_followed():
    scene = scene_with_ball(2)
    times, values = [0.0, 1.0], [[0.0, 0.0, 0.0], [0.5, 0.2, np.pi]]
    wall = scene.wall(wd.wall.Sphere([3.0, 0.0], 1.0), pivot=[2.0, 0.0], path=(times, values))
    turning = scene.wall(wd.wall.Sphere([0.0, 5.0], 1.0), spin=0.5, pivot=[0.0, 6.0])
    sim = wd.Simulation(scene, dt=0.01, force_dt=True)
    sim.run(steps=50)
    place, turn = sim.wall_pose(wall)
    assert place == pytest.approx([2.25, 1.1], abs=1e-12)  # half the way, a quarter turn
    assert turn == pytest.approx([np.sin(np.pi / 4), np.cos(np.pi / 4)], abs=1e-12)
    sim.run(steps=50)
    assert sim.wall_pose(wall)[0] == pytest.approx([1.5, 0.2], abs=1e-12)
    assert sim.wall_pose(turning)[0] == pytest.approx([np.sin(0.5), 6.0 - np.cos(0.5)], abs=1e-12)


@pytest.mark.parametrize("precision", ["float32", "mixed"])
def test_single_precision_holds(precision):
    scene = wd.Scene()
    body = scene.add(ball(np.array([100.3, 1.9, 0.2]), 0.5), SOFT)
    scene.contact(friction=0.2)
    scene.wall(box_mesh(np.array([100.0, 0.0, 0.0]), np.full(3, 2.0)), spin=[0.0, 0.0, 0.01])
    scene.set_velocity(body, [0.0, -0.02, 0.0])
    sim = wd.Simulation(scene, precision=precision)
    sim.run(until=60.0)
    assert sim.velocity[0, 1] > 0.0
    assert abs(sim.energy_error) < 2e-3


def test_wall_arrays_are_those_a_scene_needs():
    scene = scene_with_ball()
    scene.wall([0.0, -1.0, 0.0], [0.0, 1.0, 0.0])
    arrays = wd.Simulation(scene)._step.arrays
    assert not {"wall_mesh", "face_place", "wall_spring", "wall_opened"} & set(arrays)
    assert "wall_place" not in wd.Simulation(scene_with_ball())._step.arrays


def test_bad_shapes_are_refused():
    corners = np.eye(3)
    with pytest.raises(wd.InputError, match=r"faces 0 name vertices outside 0\.\.2"):
        wd.wall.Mesh(corners, [[0, 1, 3]])
    with pytest.raises(wd.InputError, match="faces 1 have no area"):
        wd.wall.Mesh(corners, [[0, 1, 2], [0, 1, 1]])
    with pytest.raises(wd.InputError, match="vertices"):
        wd.wall.Mesh([[np.nan, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0, 1, 2]])
    with pytest.raises(wd.InputError, match=r"give \(f, 3\) whole numbers"):
        wd.wall.Mesh(corners, [[0.0, 1.0, 2.0]])
    with pytest.raises(wd.InputError, match="hollow cylinder is infinite"):
        wd.wall.Cylinder(np.zeros(3), [0, 0, 1], 1.0, length=2.0, hollow=True)
    with pytest.raises(wd.InputError, match=r"half the least side, 0\.5 m"):
        wd.wall.Box([0.0, 0.0], [1.0, 2.0], rounding=0.6)
    with pytest.raises(wd.InputError, match="axis is zero"):
        wd.wall.Cylinder(np.zeros(3), np.zeros(3), 1.0)
    scene = scene_with_ball(2)
    with pytest.raises(wd.InputError, match="take a Sphere or a Box"):
        scene.wall(wd.wall.Cylinder(np.zeros(3), [0, 0, 1], 1.0))
    with pytest.raises(wd.InputError, match="give a plane a point and a normal"):
        scene.wall([0.0, 0.0])
    with pytest.raises(wd.InputError, match="not with a shape"):
        scene.wall(wd.wall.Sphere([0.0, 0.0], 1.0), [0.0, 1.0])
    with pytest.raises(wd.InputError, match="a row of 3 values each"):
        scene.wall([0.0, -2.0], [0.0, 1.0], path=([0.0, 1.0], [[0.0], [1.0]]))
    with pytest.raises(wd.InputError, match="not in the scene"):
        scene.steer(scene_with_ball(2).wall([0.0, -2.0], [0.0, 1.0]), 1.0, [0.0, 1.0], 1.0)


def test_walls_are_in_the_picture(tmp_path):
    scene = scene_with_ball()
    o = np.array([0.0, 3.0, 0.0])
    scene.wall([0.0, -1.0, 0.0], [0.0, 1.0, 0.0])
    scene.wall(wd.wall.Sphere(o, 1.0), velocity=[0.0, 0.1, 0.0])
    scene.wall(wd.wall.Cylinder(o, [0.0, 0.0, 1.0], 1.0), spin=[0.0, 0.0, 1.0])
    scene.wall(wd.wall.Box(o, [1.0, 1.0, 1.0]))
    scene.wall(box_mesh(o, np.ones(3)))
    sim = wd.Simulation(scene, dt=0.01, force_dt=True)
    sim.observe(wd.UsdWriter(tmp_path / "walls.usd", every=5))
    sim.run(steps=10)
    stage = opened(tmp_path / "walls.usd")
    ball_place = UsdGeom.Xformable(stage.GetPrimAtPath("/World/wall_1"))
    moved = ball_place.ComputeLocalToWorldTransform(2).ExtractTranslation()
    assert list(moved) == pytest.approx([0.0, 3.01, 0.0])
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/wall_4"))
    assert list(mesh.GetFaceVertexIndicesAttr().Get()) == SIDES.ravel().tolist()


def test_hertz_is_of_spheres_and_warns_of_deep_overlaps():
    scene = wd.Scene()
    scene.add(ball(np.zeros(2), 0.5), SOFT)
    scene.contact(law="hertz")
    with pytest.raises(wd.InputError, match="Hertz's law is of spheres"):
        wd.Simulation(scene)
    with pytest.raises(wd.InputError, match="law"):
        scene.contact(law="hard")
    for gap, deep in ((-0.01, False), (-0.1, True)):
        for other in ("wall", "element"):
            scene = wd.Scene()
            scene.add(ball(np.zeros(3), 0.5), SOFT)
            scene.contact(law="hertz")
            if other == "wall":
                scene.wall([0.0, -0.5 - 0.5 * gap, 0.0], [0.0, 1.0, 0.0])
            else:
                scene.add(ball(np.array([0.0, 1.0 + gap, 0.0]), 0.5), SOFT)
            sim = wd.Simulation(scene)
            if deep:
                with pytest.warns(wd.ModelWarning, match=r"overlap by 0\.1 of their radius"):
                    sim.set_state(velocity=sim.velocity)
            else:
                sim.run(steps=1)

"""USD scenes for visual review: elements as points, broken bonds as curves."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from ..errors import Array, InputError, one_of
from ..fields import in_space
from ..wall import Box, Mesh, Plane, Shape, Sphere, rotated
from .frame import FIELDS, element_fields, element_ids, element_periods, element_widths
from .whole import folder, whole

if TYPE_CHECKING:
    from ..simulation import Simulation

FRAMES_PER_SECOND = 24.0
WORLD = "/World"
RED = Gf.Vec3f(0.85, 0.1, 0.1)


class UsdWriter:
    """Writes a frame every `every` steps; the file appears when the run is over.

    Until then a folder beside it, NAME.take, has a file for each frame, whole on the disk, and
    root.usda, which shows all frames so far by value clips. A killed run leaves it, and a resumed
    one goes on with it. single: False keeps the folder, for takes that memory cannot hold, and
    writes no file of all frames.

    Elements are one `UsdGeom.Points`, /World/elements, with widths, ids (the packing's) and the
    fields velocity [m/s], mean_stress [Pa], von_mises [Pa], damage and, where bodies may flow,
    plastic_strain as primvars; broken bonds are linear curves, /World/broken_bonds, and so are the
    linked bonds of bodies without faces, /World/bonds. Walls are /World/wall_0 and so on, with
    their motion; infinite ones end beyond the scene. /World/camera looks at all of it, along z at a
    plane scene and at slabs that are thin along z, else along y. In space, both faces of every
    broken bond with faces are squares of its area, /World/crack_faces. Lengths are in metres, z is
    up, a plane scene lies at z = 0. One time code is one frame; the simulated time [s] of each is
    the attribute `warpdem:time` of /World.

    color: the field shown as displayColor, scaled by its values in the first frame that has any.
    """

    # made anew from the scene
    not_saved = ("_width", "_rods", "_period", "_crack")

    def __init__(
        self, path: str | Path, every: int = 100, color: str = "von_mises", single: bool = True
    ) -> None:
        one_of("color", color, FIELDS)
        self.path, self.every, self.color, self.single = Path(path), every, color, single
        if self.path.suffix not in (".usd", ".usda", ".usdc"):
            raise InputError(f"{self.path.name} must end in .usd, .usda or .usdc.")
        folder(self.path.parent)
        self.take = self.path.with_suffix(".take")
        self._stage: Usd.Stage | None = None
        self._frame = 0
        self._range = self._size = 0.0

    def observe(self, sim: Simulation) -> None:
        """Add a frame."""
        stage = self._stage or self._open(sim)
        frame = Sdf.Layer.CreateAnonymous(".usdc")
        stage.GetSessionLayer().subLayerPaths.append(frame.identifier)
        stage.SetEditTarget(frame)
        self._write_frame(sim, stage, Usd.TimeCode(self._frame))
        stage.GetSessionLayer().subLayerPaths.clear()
        if self._frame == 0:
            _export(
                Usd.ClipsAPI.GenerateClipManifestFromLayers([frame], WORLD), self._file("manifest")
            )
        _export(frame, self._file(f"frame.{self._frame:06}"))
        _export(self._root(self._frame), self.take / "root.usda")
        self._frame += 1

    def finish(self, sim: Simulation) -> None:
        """Save the file under its own name; a later run starts it anew."""
        if self._stage is None:
            return
        if self.single:
            all_frames = Sdf.Layer.CreateAnonymous(".usdc")
            all_frames.TransferContent(self._stage.GetRootLayer())
            for number in range(self._frame):
                frame = Sdf.Layer.OpenAsAnonymous(str(self._file(f"frame.{number:06}")))
                UsdUtils.StitchLayers(all_frames, frame)
            all_frames.startTimeCode, all_frames.endTimeCode = 0, self._frame - 1
            _export(all_frames, self.path)
            shutil.rmtree(self.take)
        self._stage, self._frame = None, 0

    def _file(self, name: str) -> Path:
        return self.take / f"{name}.usdc"

    def _root(self, last: int) -> Sdf.Layer:
        """What shows all frames up to the last."""
        root = Sdf.Layer.CreateAnonymous(".usda")
        stage = Usd.Stage.Open(root)
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(FRAMES_PER_SECOND)
        root.startTimeCode, root.endTimeCode, root.defaultPrim = 0, last, WORLD[1:]
        clips = Usd.ClipsAPI(stage.OverridePrim(WORLD))
        clips.SetClipPrimPath(WORLD)
        clips.SetClipManifestAssetPath("./manifest.usdc")
        clips.SetClipTemplateAssetPath("./frame.######.usdc")
        clips.SetClipTemplateStartTime(0)
        clips.SetClipTemplateEndTime(last)
        clips.SetClipTemplateStride(1)
        del clips, stage  # which would look for the next at once
        root.subLayerPaths.append("./still.usdc")
        return root

    def _write_frame(self, sim: Simulation, stage: Usd.Stage, time: Usd.TimeCode) -> None:
        stage.GetDefaultPrim().GetAttribute("warpdem:time").Set(sim.time, time)
        place = in_space(sim.position)
        self._write_elements(sim, place, time)
        pairs, linked = sim.bonds, sim.linked
        self._write_curves(self._broken, self._ends(place, pairs[~linked]), time)
        if self._crack is not None:
            self._write_faces(self._crack, sim, np.flatnonzero(~linked), time)
        if self._rods.any():
            self._write_curves(self._bonds, place[pairs[linked & self._rods]], time)
        for wall, (move, turn) in zip(sim.scene.walls, self._wall_moves, strict=True):
            at, q = sim.wall_pose(wall)
            move.Set(Gf.Vec3d(*in_space(at[None])[0].tolist()), time)
            x, y, z, w = (0.0, 0.0, *q) if len(q) == 2 else q
            turn.Set(Gf.Quatf(float(w), float(x), float(y), float(z)), time)

    def _open(self, sim: Simulation) -> Usd.Stage:
        """A stage of what does not change; an empty folder, or that of the run that goes on."""
        missing = [n for n in range(self._frame) if not self._file(f"frame.{n:06}").exists()]
        if missing:
            raise InputError(
                f"{self.take} lacks frames {missing[:5]} that were there at the checkpoint; put "
                "them back, or hand over a writer of another name."
            )
        if self._frame == 0:
            self._size = float(np.ptp(sim.position))
            shutil.rmtree(self.take, ignore_errors=True)
        folder(self.take)
        stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(FRAMES_PER_SECOND)
        stage.SetStartTimeCode(0)
        world = UsdGeom.Xform.Define(stage, WORLD).GetPrim()
        stage.SetDefaultPrim(world)
        world.CreateAttribute("warpdem:time", Sdf.ValueTypeNames.Double)
        packings = [b.packing for b in sim.scene.bodies]
        self._width, self._period = element_widths(sim), element_periods(sim)

        points = UsdGeom.Points.Define(stage, "/World/elements")
        points.CreateWidthsAttr(Vt.FloatArray.FromNumpy(self._width.astype(np.float32)))
        points.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
        points.CreateIdsAttr(Vt.Int64Array.FromNumpy(element_ids(sim)))
        api = UsdGeom.PrimvarsAPI(points)
        kinds = {"velocity": Sdf.ValueTypeNames.Vector3fArray}
        self._primvars = {
            name: api.CreatePrimvar(
                name, kinds.get(name, Sdf.ValueTypeNames.FloatArray), UsdGeom.Tokens.vertex
            )
            for name in FIELDS
            if name != "plastic_strain" or sim.model.yielding
        }
        self._points = points
        self._colors = points.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)

        faceless = [np.full(len(p), p.area is None) for p in packings]
        self._rods = np.concatenate(faceless)[sim.bonds[:, 0]]
        self._broken = self._define_curves(stage, "broken_bonds", 0.2, RED)
        self._crack: UsdGeom.Mesh | None = None
        if sim.model.features.dim == 3 and sim.model.facet_bonds:
            self._crack = UsdGeom.Mesh.Define(stage, "/World/crack_faces")
            self._crack.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
            self._crack.CreateDoubleSidedAttr(True)
            self._crack.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([RED])
        if self._rods.any():
            self._bonds = self._define_curves(stage, "bonds", 0.3, Gf.Vec3f(0.5, 0.5, 0.55))
        # of the reference state, so that a resumed run has the same
        start = np.concatenate([p.position for p in packings])
        _define_camera(stage, in_space(start), sim.model.features.dim)
        self._wall_moves = [
            _define_wall(stage, f"/World/wall_{n}", wall.shape, self._size)
            for n, wall in enumerate(sim.scene.walls)
        ]
        _export(stage.GetRootLayer(), self._file("still"))
        self._stage = stage
        return stage

    def _ends(self, place: Array, pairs: NDArray[np.int64]) -> Array:
        """Both ends of bonds (b, 2, 3), of those through a side of a periodic body at its image."""
        ends = place[pairs]
        if self._period is not None:
            edges = self._period[pairs[:, 0]]
            image = np.rint((ends[:, 1] - ends[:, 0]) / edges)
            ends[:, 1] -= np.where(np.isfinite(edges), edges, 0.0) * image
        return ends

    def _define_curves(
        self, stage: Usd.Stage, name: str, share: float, color: Gf.Vec3f
    ) -> UsdGeom.BasisCurves:
        curves = UsdGeom.BasisCurves.Define(stage, f"/World/{name}")
        curves.CreateTypeAttr(UsdGeom.Tokens.linear)
        curves.CreateWidthsAttr([float(share * self._width.mean())])
        curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
        curves.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([color])
        return curves

    def _write_elements(self, sim: Simulation, place: Array, time: Usd.TimeCode) -> None:
        fields = element_fields(sim, sim.stress)
        self._points.GetPointsAttr().Set(_vectors(place), time)
        self._points.GetExtentAttr().Set(_extent(place, self._width), time)
        for name, primvar in self._primvars.items():
            value = fields[name]
            array = _vectors(value) if value.ndim == 2 else Vt.FloatArray.FromNumpy(_single(value))
            primvar.Set(array, time)
        shown = fields.get(self.color, np.zeros(len(place)))  # nothing flows
        shown = np.linalg.norm(shown, axis=1) if shown.ndim == 2 else np.abs(shown)
        if self._range == 0.0:
            self._range = 2.0 * float(np.percentile(shown, 99.0))
        share = shown / self._range if self._range > 0.0 else np.zeros_like(shown)
        self._colors.Set(_vectors(colormaps["viridis"](np.clip(share, 0, 1))[:, :3]), time)

    def _write_faces(
        self, mesh: UsdGeom.Mesh, sim: Simulation, broken: NDArray[np.int64], time: Usd.TimeCode
    ) -> None:
        """Both faces of broken facet bonds: squares of their area, moving with their elements."""
        packings = [b.packing for b in sim.scene.bodies if b.bond == "facet"]  # stored first
        bonds = broken[broken < sum(len(p.bonds) for p in packings)]
        arms = np.concatenate([p.arms for p in packings])[bonds]  # type: ignore[misc]
        area = np.concatenate([p.area for p in packings])[bonds]  # type: ignore[misc]
        normal = arms[:, 0] - arms[:, 1]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        one = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
        one /= np.linalg.norm(one, axis=1, keepdims=True)
        half = 0.5 * np.sqrt(area)[:, None]
        one, other = half * one, half * np.cross(normal, one)
        corners = np.stack([one + other, other - one, -one - other, one - other], axis=1)
        pairs, place, turn = sim.bonds[bonds], sim.position, sim.orientation
        points = np.concatenate(
            [
                place[own][:, None] + rotated(turn[own][:, None], arms[:, side, None] + corners)
                for side, own in enumerate(pairs.T)
            ]
        ).reshape(-1, 3)
        mesh.GetPointsAttr().Set(_vectors(points), time)
        counts = np.full(2 * len(bonds), 4, dtype=np.int32)
        mesh.GetFaceVertexCountsAttr().Set(Vt.IntArray.FromNumpy(counts), time)
        corner = np.arange(8 * len(bonds), dtype=np.int32)
        mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(corner), time)
        mesh.GetExtentAttr().Set(_extent(points, np.zeros(len(points))), time)

    def _write_curves(self, curves: UsdGeom.BasisCurves, ends: Array, time: Usd.TimeCode) -> None:
        """Straight pieces from `ends` (b, 2, 3)."""
        curves.GetPointsAttr().Set(_vectors(ends), time)
        counts = np.full(len(ends), 2, dtype=np.int32)
        curves.GetCurveVertexCountsAttr().Set(Vt.IntArray.FromNumpy(counts), time)
        width = np.full(2 * len(ends), curves.GetWidthsAttr().Get()[0])
        curves.GetExtentAttr().Set(_extent(ends.reshape(-1, 3), width), time)


def _define_camera(stage: Usd.Stage, place: Array, dim: int) -> None:
    """A camera without perspective that sees all elements, with a tenth around them."""
    low, high = place.min(axis=0), place.max(axis=0)
    middle, size = 0.5 * (low + high), high - low
    reach = float(np.linalg.norm(size))
    camera = UsdGeom.Camera.Define(stage, "/World/camera")
    camera.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
    # it looks along its own -z, its y is up; apertures are tenths of the scene's unit
    flat = dim == 2 or size[2] < 0.5 * size[:2].min()
    up = 1 if flat else 2
    camera.CreateHorizontalApertureAttr(12.0 * float(size[0]))
    camera.CreateVerticalApertureAttr(12.0 * float(size[up]))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * reach, 4.0 * reach))
    back = np.array([0.0, 0.0, 2.0 * reach] if flat else [0.0, -2.0 * reach, 0.0])
    camera.AddTranslateOp().Set(Gf.Vec3d(*(middle + back).tolist()))
    if not flat:
        camera.AddRotateXOp().Set(90.0)


def _export(layer: Sdf.Layer, path: Path) -> None:
    """Write a layer under its name when it is whole and on the disk."""
    with whole(path) as part:
        try:
            done = layer.Export(str(part))
        except Tf.ErrorException as error:
            raise OSError(str(error).strip().splitlines()[-1]) from None
        if not done:
            raise OSError("the USD library could not")


def _define_wall(
    stage: Usd.Stage, path: str, shape: Shape, size: float
) -> tuple[UsdGeom.XformOp, UsdGeom.XformOp]:
    """A wall's shape about its place, infinite ones of a size; what moves and turns it."""
    prim: UsdGeom.Gprim
    if isinstance(shape, Sphere):
        prim = UsdGeom.Sphere.Define(stage, path)
        prim.CreateRadiusAttr(shape.radius)
        reach = np.full((1, 3), shape.radius)
        prim.CreateExtentAttr(_vectors(np.concatenate([-reach, reach])))
    else:
        points, faces = _surface(shape, size)
        prim = UsdGeom.Mesh.Define(stage, path)
        prim.CreatePointsAttr(_vectors(points))
        prim.CreateFaceVertexCountsAttr([len(f) for f in faces])
        prim.CreateFaceVertexIndicesAttr([int(i) for f in faces for i in f])
        prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        prim.CreateDoubleSidedAttr(True)
        prim.CreateExtentAttr(_extent(points, np.zeros(len(points))))
    prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([Gf.Vec3f(0.6, 0.6, 0.65)])
    return prim.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble), prim.AddOrientOp()


def _surface(shape: Shape, size: float) -> tuple[Array, list[list[int]]]:
    """Corners (p, 3) of a shape from its place, and its faces, against the clock from outside."""
    if isinstance(shape, Mesh):
        return shape.vertices - shape.place, shape.faces.tolist()
    assert not isinstance(shape, Sphere)
    if isinstance(shape, Box):
        half = np.append(0.5 * shape.size, np.full(3 - len(shape.size), 1e-3 * size))
        corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
        faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        return half * corners, faces
    axis = in_space((shape.normal if isinstance(shape, Plane) else shape.axis)[None])[0]
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    other = np.cross(axis, across)
    if isinstance(shape, Plane):
        ends = [across + other, other - across, -across - other, across - other]
        return size * np.array(ends), [[0, 1, 2, 3]]
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ring = shape.radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * other)
    end = min(0.5 * shape.length, size) * axis
    n = len(angle)
    faces = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    if not shape.hollow:
        faces += [[*range(n)][::-1], [*range(n, 2 * n)]]
    return np.concatenate([ring - end, ring + end]), faces


def _single(v: NDArray) -> NDArray[np.float32]:
    return np.ascontiguousarray(v, dtype=np.float32)


def _vectors(v: NDArray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(_single(v).reshape(-1, 3))


def _extent(place: Array, width: Array) -> Vt.Vec3fArray:
    if len(place) == 0:
        return Vt.Vec3fArray([Gf.Vec3f(0.0), Gf.Vec3f(0.0)])
    # from the rounded points, as a reader sees them
    points, half = _single(place), _single(0.5 * width)[:, None]
    return _vectors(np.stack([(points - half).min(axis=0), (points + half).max(axis=0)]))

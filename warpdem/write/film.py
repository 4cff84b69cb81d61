"""Films made from USD scenes read back: what an eye at the scene's camera sees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, Usd, UsdGeom

from ..errors import Array, InputError
from .whole import folder, whole

BACKGROUND, CRACK = (255, 255, 255), (217, 26, 26)
FILMS = (".gif", ".png")


def write_film(scene: str | Path, path: str | Path, pixels: int = 640) -> int:
    """Draw every frame of a scene that `UsdWriter` wrote, from its camera; return their number.

    path: a .gif that plays them at ten a second, or a .png, whose name gets the number of each
    frame. pixels: along the longer edge. Elements are their displayColor, broken bonds are red;
    what lies nearest to the camera is seen. Raises InputError for other files.
    """
    from PIL import Image
    from scipy.spatial import cKDTree

    out = Path(path)
    if out.suffix not in FILMS:
        raise InputError(f"{out.name} must end in .gif or .png.")
    if not Path(scene).is_file():
        raise InputError(f"there is no file {scene}.")
    folder(out.parent)
    try:
        stage = Usd.Stage.Open(str(scene))
    except Tf.ErrorException:
        raise InputError(f"{scene} is no USD file.") from None
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/elements"))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/camera"))
    if not points or not camera:
        raise InputError(f"{scene} has no /World/elements and /World/camera; write it anew.")
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/broken_bonds"))
    color = points.GetDisplayColorPrimvar()
    to_camera = np.array(camera.ComputeLocalToWorldTransform(Usd.TimeCode.Default()).GetInverse())
    # without perspective, an aperture is in tenths of the scene's unit
    width = 0.1 * camera.GetHorizontalApertureAttr().Get()
    height = 0.1 * camera.GetVerticalApertureAttr().Get()
    step = max(width, height) / pixels
    x = np.arange(-0.5 * width + 0.5 * step, 0.5 * width, step)
    y = np.arange(0.5 * height - 0.5 * step, -0.5 * height, -step)
    eye = np.stack(np.meshgrid(x, y), axis=-1)

    def seen(place: Array) -> Array:
        """Places [m] as the camera has them: right, up, towards it."""
        return (np.column_stack([place, np.ones(len(place))]) @ to_camera)[:, :3]

    frames = []
    for frame in range(int(stage.GetEndTimeCode()) + 1):
        place = seen(np.array(points.GetPointsAttr().Get(frame)))
        radius = 0.5 * np.array(points.GetWidthsAttr().Get(frame))
        front = place[:, 2] >= place[:, 2].max() - 2.0 * radius.max()
        shown = np.round(255.0 * np.array(color.Get(frame))[front]).astype(np.uint8)
        away, nearest = cKDTree(place[front, :2]).query(eye)
        image: NDArray[np.uint8] = shown[nearest]
        image[away > 1.2 * radius[front][nearest]] = BACKGROUND
        ends = np.array(curves.GetPointsAttr().Get(frame)).reshape(-1, 2, 3)
        if len(ends):
            middle = seen(ends.mean(axis=1))[:, :2]
            image[cKDTree(middle).query(eye)[0] < max(0.6 * radius.max(), 0.7 * step)] = CRACK
        frames.append(Image.fromarray(image))
    if out.suffix == ".gif":
        with whole(out) as part:
            frames[0].save(part, save_all=True, append_images=frames[1:], duration=100, loop=0)
        return len(frames)
    for number, one in enumerate(frames):
        with whole(out.with_name(f"{out.stem}_{number:04d}.png")) as part:
            one.save(part)
    return len(frames)

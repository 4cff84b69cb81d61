"""A plate with a hole is pulled: three times the stress beside the hole (Kirsch)."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/plate_with_hole")
WIDTH, RADIUS, PULL = 0.4, 10e-3, 50e6

steel = wd.Material(young=210e9, poisson=0.3, density=7850)
middle = WIDTH / 2


def spacing(x: np.ndarray) -> np.ndarray:
    """Fine elements at the hole, coarse ones far away [m]."""
    distance = np.linalg.norm(np.atleast_2d(x) - middle, axis=1) - RADIUS
    return np.clip(0.7e-3 + 0.12 * (distance - 3e-3), 0.7e-3, 12e-3)


hole = wd.packing.Disc(RADIUS, centre=(middle, middle))
shape = wd.packing.Plate((WIDTH, WIDTH), holes=[hole])
plate = wd.packing.voronoi(shape, spacing, plane="stress", thickness=5e-3)
scene = wd.Scene()
body = scene.add(plate, steel)
scene.pull(body, plate.top, (0, PULL))
scene.pull(body, plate.bottom, (0, -PULL))
left = np.argmin(plate.position[:, 0] + abs(plate.position[:, 1] - middle))
right = np.argmax(plate.position[:, 0] - abs(plate.position[:, 1] - middle))
scene.hold(body, [left], rotation=False)
scene.hold(body, [right], axes="y", rotation=False)

sim = wd.Simulation(scene)
sim.equilibrate()
x = plate.position - middle
edge = plate.side("hole") & (abs(x[:, 1]) < 0.1 * RADIUS)
share = (RADIUS / np.linalg.norm(x[edge], axis=1)) ** 2
theory = 0.5 * (2 + share + 3 * share**2).mean()
found = sim.stress[edge, 1, 1].mean() / PULL
print(f"{len(plate)} elements; beside the hole the stress is {found:.3f} times the pull")
print(f"difference {found / theory - 1:.1%} to Kirsch at these elements ({theory:.3f})")

wd.draw_field(
    OUT / "plate_with_hole.png",
    plate,
    sim.stress[:, 1, 1] / 1e6,
    label="stress along the pull [MPa]",
    limits=(-PULL / 1e6, 3 * PULL / 1e6),
    title=f"Plate pulled up and down by {PULL / 1e6:g} MPa",
    window=((middle - 4 * RADIUS, middle - 4 * RADIUS), (middle + 4 * RADIUS, middle + 4 * RADIUS)),
)
print(f"picture in {OUT / 'plate_with_hole.png'}")

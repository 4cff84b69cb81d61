"""A disc of rock is pressed between two narrow plates; tension at its centre (Brazilian test)."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/brazilian_disc")
RADIUS, THICKNESS, FORCE = 25e-3, 20e-3, 10e3

granite = wd.Material(young=60e9, poisson=0.25, density=2650)
disc = wd.packing.voronoi(
    wd.packing.Disc(RADIUS), spacing=0.7e-3, plane="stress", thickness=THICKNESS
)
scene = wd.Scene()
body = scene.add(disc, granite)
x, y = disc.position.T
for sign in (1, -1):
    plate = disc.side("outer") & (sign * y > 0) & (abs(x) < 2e-3)
    scene.load(body, plate, force=(0, -sign * FORCE / plate.sum()))
# held far from the centre, against moving and turning as a whole
scene.hold(body, [np.argmin(x + abs(y))], rotation=False)
scene.hold(body, [np.argmax(x - abs(y))], axes="y", rotation=False)

sim = wd.Simulation(scene)
sim.equilibrate(tolerance=1e-7)
near = x**2 + y**2 < (0.08 * RADIUS) ** 2
tension, pressure = sim.stress[near].mean(axis=0)[[0, 1], [0, 1]]
theory = 2 * FORCE / (np.pi * 2 * RADIUS * THICKNESS)
print(f"tension at the centre {tension / 1e6:.3f} MPa, 2P/(pi D t) is {theory / 1e6:.3f} MPa")
print(f"compression there: difference {pressure / (-3 * theory) - 1:.1%} to 6P/(pi D t)")

wd.draw_field(
    OUT / "brazilian_disc.png",
    disc,
    sim.stress[:, 0, 0] / 1e6,
    label="stress across the load [MPa]",
    title=f"Granite disc of 50 mm, {FORCE / 1e3:g} kN from above and below",
    limits=(-2 * theory / 1e6, 2 * theory / 1e6),
)
print(f"picture in {OUT / 'brazilian_disc.png'}")

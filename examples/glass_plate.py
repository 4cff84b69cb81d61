"""A notched glass plate is pulled apart, with no weak plane to guide the crack."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/glass_plate")

glass = wd.Material(young=72e9, poisson=0.22, density=2440)
plate = wd.packing.voronoi((0.1, 0.04), spacing=1e-3, plane="stress", seed=1)
scene = wd.Scene()
body = scene.add(plate, glass, fracture=wd.DruckerPrager(compression=150e6, ratio=3))
scene.cut(body, start=(0, 0.02), end=(0.05, 0.02))
scene.pull(body, where=plate.top, traction=(0, 12e6))
scene.pull(body, where=plate.bottom, traction=(0, -12e6))

sim = wd.Simulation(scene)
crack = sim.observe(wd.CrackTracker(every=20, window=5e-3))
sim.observe(wd.UsdWriter(OUT / "crack.usd", every=100))
sim.run(until=50e-6)
log = crack.log
print(f"{len(log)} bonds broke, {np.mean(log['mode'] == 'normal'):.0%} of them in tension")
print(f"crack speed: {crack.speed / glass.rayleigh_speed('stress'):.2f} c_R")
print(f"energy error {sim.energy_error:.1e}; scene written to {OUT / 'crack.usd'}")

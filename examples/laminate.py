"""Layers of glass and epoxy: the stiffness across them, exact at two elements a layer."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/laminate")
LAYER, STRAIN = 2, 1e-4  # elements a layer

glass = wd.Material(young=72e9, poisson=0.22, density=2440)
epoxy = wd.Material(young=3e9, poisson=0.38, density=1200)
block = wd.packing.square((60e-4, 24e-4), spacing=1e-4, plane="strain")
layer = np.floor(block.position[:, 1] / (LAYER * 1e-4) + 1e-6).astype(int) % 2
scene = wd.Scene()
body = scene.add(block, [glass, epoxy], grain=layer, facet_bending=True)
scene.strain(body, np.diag([0.0, STRAIN]))
scene.hold(body, np.arange(len(block)), axes="x", rotation=False)  # a wide laminate
scene.hold(body, block.top | block.bottom)

sim = wd.Simulation(scene)
sim.equilibrate()
column = np.flatnonzero(abs(block.position[:, 0] - 30.5e-4) < 1e-6)
low, high = column[2 * LAYER], column[10 * LAYER]
rise = block.position[high, 1] - block.position[low, 1]
strain = (sim.displacement[high, 1] - sim.displacement[low, 1]) / rise
modulus = sim.stress[column[6 * LAYER], 1, 1] / strain
series = 2 / sum(1 / (m.lame("strain") + 2 * m.shear_modulus) for m in (glass, epoxy))
print(f"modulus across the layers {modulus / 1e9:.4f} GPa, difference {modulus / series - 1:.2%}")

wd.draw_field(
    OUT / "laminate.png",
    block,
    sim.stress[:, 0, 0] / 1e6,
    label="stress along the layers [MPa]",
    title=f"Glass and epoxy, {LAYER} elements a layer, pulled across by {STRAIN:.2%}",
)
print(f"picture in {OUT / 'laminate.png'}")

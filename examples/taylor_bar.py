"""A copper bar meets a rigid wall at 227 m/s and mushrooms (Taylor 1948): plastic strains of 2."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import warpdem as wd

OUT = Path("out/taylor_bar")
RADIUS, LENGTH, SPEED, ACROSS = 3.2e-3, 32.4e-3, 227.0, 8

d = 2 * RADIUS / ACROSS
box = wd.packing.fcc((2 * RADIUS + 2 * d, 2 * RADIUS + 2 * d, LENGTH), d)
x, y, _ = (box.position - (box.position.min(axis=0) + box.position.max(axis=0)) / 2).T
bar = box.without(np.hypot(x, y) > RADIUS)

copper = wd.Material(young=117e9, poisson=0.35, density=8930)
law = wd.VonMises(yield_stress=400e6, hardening=100e6)
scene = wd.Scene()
body = scene.add(bar, copper, yielding=law, finite_strain=True)
z = bar.position[:, 2]
foot, top = z < z.min() + 0.3 * d, z > z.max() - 0.3 * d
scene.hold(body, foot, axes="z")  # a wall without friction
scene.set_velocity(body, (0, 0, -SPEED))

# the foot is squeezed to an eighth, and so is the stable time step
limit = wd.Simulation(scene, precision="mixed").dt_limit
sim = wd.Simulation(scene, precision="mixed", dt=0.15 * limit)
sim.run(until=80e-6)

length = LENGTH + sim.displacement[top, 2].mean()
print(f"length {1e3 * length:.2f} mm, difference {length / 21.45e-3 - 1:.1%} to other codes' 21.45")
print(f"greatest plastic strain {sim.plastic_strain.max():.1f}, other codes' about 3")
print(f"plastic work {sim.energy()['plastic']:.0f} J, ledger's error {sim.energy_error:.1e}")

OUT.mkdir(parents=True, exist_ok=True)
fig = Figure(figsize=(8.5, 5.0), layout="constrained")
axes = fig.subplots(1, 2, sharey=True)
centre = bar.position.mean(axis=0)
middle = np.abs(bar.position[:, 1] - centre[1]) < 0.6 * d
for ax, at, value, title in (
    (axes[0], bar.position, 0 * z, "before"),
    (axes[1], sim.position, sim.plastic_strain, "80 microseconds later"),
):
    place = 1e3 * (at - [*centre[:2], z.min()])[middle]
    dots = ax.scatter(place[:, 0], place[:, 2], c=value[middle], s=14, vmin=0, vmax=2.5)
    ax.set(title=title, aspect="equal", xlabel="x [mm]", xlim=(-9, 9))
axes[0].set_ylabel("z [mm]")
fig.colorbar(dots, ax=axes, label="plastic strain")
fig.savefig(OUT / "taylor_bar.png", dpi=130)
print(f"picture in {OUT / 'taylor_bar.png'}")

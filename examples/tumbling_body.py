"""A free body thrown about its middle axis turns over and over (Dzhanibekov)."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import warpdem as wd

OUT = Path("out/tumbling_body")
MOMENTS, SPIN, PERIOD = np.array([1.0, 2.0, 3.0]), np.array([0.01, 1.0, 0.01]), 39.1057

body = wd.packing.network([[0, 0, 0]], [], volume=1.0, gyration=np.sqrt([MOMENTS]))
scene = wd.Scene()
thrown = scene.add(body, wd.Material(young=1, poisson=0, density=1), bond=wd.EVMBond(1, 0, 0))
scene.set_velocity(thrown, [0, 0, 0], angular_velocity=SPIN)

sim = wd.Simulation(scene, dt=PERIOD / 1000)
time, middle, size = [], [], []
while sim.time < 2.2 * PERIOD:
    x, y, z, w = sim.orientation[0]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    own = turn.T @ sim.angular_velocity[0]
    time.append(sim.time)
    middle.append(own)
    size.append(np.linalg.norm(MOMENTS * own))
    sim.run(steps=5)

time, middle = np.array(time), np.array(middle)
flips = time[1:][np.diff(np.sign(middle[:, 1])) != 0]
period = 2 * np.diff(flips).mean()
print(f"period {period:.2f} s, theory {PERIOD:.2f} s")
print(f"angular momentum kept to {np.ptp(size) / size[0]:.0e}, energy error {sim.energy_error:.1e}")

OUT.mkdir(parents=True, exist_ok=True)
fig = Figure(figsize=(9, 4.5), layout="constrained")
ax = fig.subplots()
for axis, moment in enumerate(MOMENTS):
    ax.plot(time, middle[:, axis], label=f"axis of moment {moment:g} kg m²")
for flip in np.arange(flips[0], time[-1], 0.5 * PERIOD):
    ax.axvline(flip, color="0.7", ls="--", lw=1)
ax.set(
    xlabel="time [s]",
    ylabel="spin about own axis [rad/s]",
    title="A free body spun about its middle axis (dashed: theory's half periods)",
)
fig.legend(loc="outside lower center", ncols=3)
fig.savefig(OUT / "tumbling_body.png", dpi=130)
print(f"picture in {OUT / 'tumbling_body.png'}")

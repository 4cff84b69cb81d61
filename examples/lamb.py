"""A blow on the surface of a half-space (Lamb's problem): seismograms against the exact ones.

The blow is Ricker's wavelet in time. What a constant load does is recorded at every step; as all is
linear, the wavelet's increments times that, each from its own time on, add up to what it does.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import warpdem as wd
from warpdem.validation.reference import line_load, ricker

OUT = Path("out/lamb")
SIZE, SPACING, WAVELENGTH = (300.0, 110.0), 1.0, 20.0  # m; of Rayleigh waves
SOURCE, DISTANCES = 110.0, (40.0, 60.0, 80.0)
LOAD = 1e6  # N/m

granite = wd.Material(young=60e9, poisson=0.25, density=2650)
speeds = {
    "P": granite.pressure_speed(),
    "S": granite.shear_speed(),
    "Rayleigh": granite.rayleigh_speed(),
}
frequency = speeds["Rayleigh"] / WAVELENGTH
delay, until = 1.3 / frequency, max(DISTANCES) / speeds["Rayleigh"] + 2.6 / frequency

ground = wd.packing.voronoi(SIZE, SPACING, seed=1, relaxations=5)
scene = wd.Scene()
body = scene.add(ground, granite)
surface = np.flatnonzero(ground.top)


def nearest(x):
    """The element of the surface nearest to a place along it."""
    return surface[np.argmin(np.abs(ground.position[surface, 0] - x))]


source = nearest(SOURCE)
start = ground.position[source, 0]
receivers = [nearest(start + d) for d in DISTANCES]
distance = ground.position[receivers, 0] - start
scene.load(body, [source], force=(0, -LOAD))

sim = wd.Simulation(scene)
steps = round(until / sim.dt)
pictured = round(0.6 * steps)
time = np.arange(steps) * sim.dt - delay
rise = ricker(time + sim.dt / 2, frequency) - ricker(time - sim.dt / 2, frequency)
response, field = np.zeros((steps, len(receivers), 2)), np.zeros_like(ground.position)
for step in range(steps):
    u = sim.displacement
    response[step] = u[receivers]
    if step <= pictured:
        field += rise[pictured - step] * u
    sim.run(steps=1)
found = np.array(
    [np.convolve(rise, line)[:steps] for line in response.reshape(steps, -1).T]
).T.reshape(response.shape)
exact = [LOAD * line_load(x, time, frequency, granite, "strain") for x in distance]

trough = [time[np.argmin(record[:, 1])] for record in (found[:, -1], exact[-1])]
print(f"{len(ground)} elements, {steps} steps of {sim.dt:.2e} s")
print(
    f"Rayleigh wave {distance[-1]:.1f} m away: {1e3 * trough[0]:.2f} ms after the blow, "
    f"difference {trough[0] / trough[1] - 1:.2%} to the exact solution"
)

OUT.mkdir(parents=True, exist_ok=True)
fig = Figure(figsize=(12, 5), layout="constrained")
left, right = fig.subplots(1, 2, gridspec_kw={"width_ratios": [1, 1.4]})
scale = 0.6 * np.diff(DISTANCES).min() / np.abs(exact).max()
after = time > 0
for n, x in enumerate(distance):
    left.plot(1e3 * time[after], x + scale * exact[n][after, 1], color="C3", lw=3, alpha=0.5)
    left.plot(1e3 * time[after], x + scale * found[after, n, 1], color="k", lw=1)
for name, speed in speeds.items():
    left.plot(1e3 * distance / speed, distance, "--", lw=1, label=f"{name} waves")
left.plot([], [], color="k", lw=1, label="warpdem")
left.plot([], [], color="C3", lw=3, alpha=0.5, label="exact")
left.legend(loc="upper left", ncols=2, fontsize=8)
left.set(
    xlabel="time after the blow [ms]",
    ylabel="distance [m], and vertical displacement",
    ylim=(25, 108),
    title="Seismograms at the surface",
)
height = 1e6 * field[:, 1]
most = np.percentile(np.abs(height), 99.0)
image = right.scatter(
    *ground.position.T, c=height, s=1.5, cmap="RdBu_r", vmin=-most, vmax=most, rasterized=True
)
fig.colorbar(image, ax=right, label="vertical displacement [µm]", shrink=0.7)
right.plot(start, SIZE[1], "kv", ms=9, clip_on=False)
right.plot(ground.position[receivers, 0], np.full(len(receivers), SIZE[1]), "k^", clip_on=False)
right.set(
    xlabel="x [m]",
    ylabel="y [m]",
    aspect="equal",
    title=f"{1e3 * time[pictured]:.1f} ms after the blow (source ▼, receivers ▲)",
)
fig.savefig(OUT / "lamb.png", dpi=130)
print(f"picture in {OUT / 'lamb.png'}")

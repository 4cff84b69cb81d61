"""A cracked plate of given toughness breaks at one stress, however fine its elements are.

The stress at which a crack in a pulled plate starts to grow, at three spacings: with the toughness
given, and with a strength that was right for the coarsest of them.
"""

from math import sqrt

import numpy as np
from matplotlib.figure import Figure

import warpdem as wd

GLASS = wd.Material(young=72e9, poisson=0.22, density=2440)
TOUGHNESS = 0.7e6  # K_Ic [Pa m^0.5]
HALF_LENGTH, WIDTH, HEIGHT = 0.01, 0.06, 0.07  # [m]
SPACINGS = 1.25e-3, 1e-3, 0.75e-3
LAW = wd.Toughness(wd.Rankine(1.0), stress_intensity=TOUGHNESS)


def fracture_stress(spacing: float, fracture: object) -> float:
    """Remote stress at which the first bond breaks [Pa]."""
    plate = wd.packing.hexagonal((WIDTH, HEIGHT), spacing, plane="stress")
    scene = wd.Scene()
    body = scene.add(plate, GLASS, fracture=fracture)
    heights = np.unique(np.round(plate.position[:, 1], 9))
    y = heights[len(heights) // 2 - 1 : len(heights) // 2 + 1].mean()
    scene.cut(body, (WIDTH / 2 - HALF_LENGTH, y), (WIDTH / 2 + HALF_LENGTH, y))
    scene.pull(body, plate.top, (0, 1e6))
    scene.pull(body, plate.bottom, (0, -1e6))
    x = plate.position - [WIDTH / 2, y]
    scene.hold(body, [np.argmin(x[:, 0] + abs(x[:, 1]))], rotation=False)
    scene.hold(body, [np.argmax(x[:, 0] - abs(x[:, 1]))], axes="y", rotation=False)
    sim = wd.Simulation(scene)
    sim.relax(tolerance=1e-5)
    sim.run(steps=1)
    return 1e6 / sim.criterion_ratio.max()


coarse = wd.packing.hexagonal((WIDTH, HEIGHT), SPACINGS[0], plane="stress")
by_toughness = np.array([fracture_stress(d, LAW) for d in SPACINGS]) / 1e6
by_strength = np.array([fracture_stress(d, LAW.at(coarse, GLASS)) for d in SPACINGS]) / 1e6
print(f"toughness given: fracture stress {', '.join(f'{s:.3f}' for s in by_toughness)} MPa")
print(f"strength given:  fracture stress {', '.join(f'{s:.3f}' for s in by_strength)} MPa")
for name, stress, exact in (
    ("toughness: constant", by_toughness, np.ones(len(SPACINGS))),
    ("strength: as sqrt(spacing)", by_strength, np.sqrt(np.array(SPACINGS) / SPACINGS[0])),
):
    kept = stress / exact
    print(f"{name}, error {100 * (kept.max() / kept.min() - 1):.1f}%")

fig = Figure(figsize=(6.5, 4.2), layout="constrained")
ax = fig.subplots()
cells = HALF_LENGTH / np.array(SPACINGS)
ax.plot(cells, by_toughness, "o-", label="toughness given (wd.Toughness)")
ax.plot(cells, by_strength, "s-", label="strength given, that of the coarsest")
griffith = TOUGHNESS / sqrt(np.pi * HALF_LENGTH) / 1e6
ax.axhline(griffith, color="0.5", ls="--", lw=1)
ax.text(
    cells[0], griffith, r" $K_{Ic}/\sqrt{\pi a}$ of an infinite plate", va="bottom", color="0.4"
)
ax.set(
    xlabel="half-length of the crack in spacings",
    ylabel="remote stress at fracture [MPa]",
    ylim=(0.0, 1.15 * griffith),
    title="A cracked glass plate at three resolutions",
)
ax.legend(loc="lower left")
fig.savefig("toughness.png", dpi=110)

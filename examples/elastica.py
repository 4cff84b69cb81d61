"""Rods bent far beyond small deflections: the elastica, and a rod rolled up into a circle."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import warpdem as wd

OUT = Path("out/elastica")
BONDS = 48
# tip deflection w/L and shortening u/L for P L^2/EI, from the elastica's differential equation
EXACT = {1: (0.301721, 0.056433), 3: (0.603253, 0.254420), 10: (0.810609, 0.554996)}

rubber = wd.Material(young=1.0, poisson=0.45, density=1.0)
section = wd.Circle(radius=5e-3)
stiffness = rubber.young * section.second_moment
rod = wd.packing.filament([[0, 0], [1, 0]], BONDS, section)


def bent(force: float = 0.0, moment: float = 0.0, load_steps: int = 8) -> np.ndarray:
    """Positions of a rod of length 1 m under loads at its tip."""
    scene = wd.Scene()
    bond = wd.EVMBond.bernoulli_euler(rubber, section, rod.bond_length, large_rotation=True)
    body = scene.add(rod, rubber, bond=bond)
    scene.hold(body, rod.side("start"))
    scene.load(body, rod.side("end"), force=[0, force * stiffness], torque=moment * stiffness)
    sim = wd.Simulation(scene)
    sim.equilibrate(load_steps=load_steps)
    return sim.position


OUT.mkdir(parents=True, exist_ok=True)
fig = Figure(figsize=(11, 5), layout="constrained")
left, right = fig.subplots(1, 2)
for load, (w, u) in EXACT.items():
    x = bent(force=load)
    error = max(abs(x[-1, 1] - w), abs(1 - x[-1, 0] - u))
    print(f"P L^2/EI = {load}: tip at ({x[-1, 0]:.5f}, {x[-1, 1]:.5f}) L, error {error:.0e} L")
    left.plot(*x.T, label=f"$PL^2/EI$ = {load}")
    left.plot(1 - u, w, "k+", ms=12)
left.plot([], [], "k+", ms=12, label="tip, exact")
left.set(title="Load across the tip", xlabel="x/L", ylabel="y/L", aspect="equal")
left.legend()
for share in (0.25, 0.5, 0.75, 1.0):
    x = bent(moment=2 * np.pi * share, load_steps=20)
    right.plot(*x.T, label=f"$ML/EI$ = {2 * share:g} π")
print(f"M L/EI = 2 pi: the ends are {np.linalg.norm(x[-1] - x[0]):.0e} L apart")
right.set(title="Moment at the tip", xlabel="x/L", ylabel="y/L", aspect="equal")
right.legend()
fig.suptitle(f"A clamped rod of {BONDS} EVM bonds at rest")
fig.savefig(OUT / "elastica.png", dpi=130, bbox_inches="tight")
print(f"picture in {OUT / 'elastica.png'}")

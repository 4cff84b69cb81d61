"""A ceramic of grains of scattered stiffness: the more pores, the softer it is."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/porous_ceramic")
SIZE, SPACING, STRAIN = (1.2e-3, 1.2e-3), 20e-6, 1e-4

alumina = wd.Material(young=380e9, poisson=0.23, density=3950)
full = wd.packing.voronoi(SIZE, SPACING, plane="strain", seed=1)
rng = np.random.default_rng(2)


def modulus(pores: int) -> tuple[float, float, wd.Packing, np.ndarray]:
    """Porosity, stiffness along y [Pa], the body and its stress along y."""
    gone = np.zeros(len(full), dtype=bool)
    for centre in rng.uniform(0.15, 0.85, (pores, 2)) * SIZE:
        gone |= np.linalg.norm(full.position - centre, axis=1) < 3 * SPACING
    body = full.without(gone)
    scene = wd.Scene()
    ceramic = scene.add(body, alumina)
    scene.scale_stiffness(ceramic, rng.weibull(12.0, len(body)))  # grain by grain
    scene.strain(ceramic, np.diag([0.0, STRAIN]))
    scene.hold(ceramic, body.top | body.bottom, axes="y", rotation=False)
    scene.hold(ceramic, [int(np.argmin(np.linalg.norm(body.position - [6e-4, 6e-4], axis=1)))])
    sim = wd.Simulation(scene)
    sim.equilibrate(tolerance=1e-6)
    mean = -sim.force[body.top, 1].sum() / SIZE[0]  # what the grip pulls with, over the width
    return float(gone.mean()), mean / STRAIN, body, sim.stress[:, 1, 1]


porosity, stiffness, body, stress = [], [], full, np.zeros(0)
for pores in (0, 4, 10):
    share, value, body, stress = modulus(pores)
    porosity.append(share)
    stiffness.append(value)
    print(f"porosity {share:.1%}: stiffness {value / 1e9:.0f} GPa")
solid = stiffness[0] / (alumina.plane_modulus("strain") * 0.96)  # mean of the scatter: 0.958
print(f"without pores: difference {solid - 1:.1%} to E/(1 - nu^2) of the mean grain")

wd.draw_field(
    OUT / "porous_ceramic.png",
    body,
    stress / 1e6,
    label="stress along the pull [MPa]",
    title=f"Alumina with {porosity[-1]:.0%} pores, pulled up and down by {STRAIN:.2%}",
    limits=(0.0, 2.5 * STRAIN * stiffness[0] / 1e6),
)
print(f"picture in {OUT / 'porous_ceramic.png'}")

"""A sheet of hexagonal rings, bonds as in graphene (c_A/c_D about 2), is twisted and let go."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/graphene_sheet")
BOND = 0.142e-9  # length of a bond [m]
LONGITUDINAL = 730.0  # c_A [N/m]
TURN = np.radians(50.0)  # of one end against the other

sheet = wd.packing.honeycomb(size=(6e-9, 2.5e-9), spacing=BOND, thickness=0.335e-9)
carbon = wd.Material(young=1e12, poisson=0.16, density=2270)
bond = wd.EVMBond(
    longitudinal=LONGITUDINAL,
    shear=LONGITUDINAL / 2,
    bending=LONGITUDINAL * BOND**2 / 12,
    torsion=LONGITUDINAL * BOND**2 / 24,
    damping=0.05,
)
ends = sheet.side("left") | sheet.side("right")


def twisted(x: np.ndarray) -> np.ndarray:
    """Displacement of a twist about the x axis that grows along it."""
    low, high = x[:, 0].min(), x[:, 0].max()
    middle = 0.5 * (x[:, 1].min() + x[:, 1].max())
    angle = TURN * (x[:, 0] - low) / (high - low)
    y = x[:, 1] - middle
    return np.stack([0 * y, y * np.cos(angle) - y, y * np.sin(angle)], axis=1)


scene = wd.Scene()
body = scene.add(sheet, carbon, bond=bond)
scene.hold(body, ends, rotation=False)
sim = wd.Simulation(scene)
sim.set_state(displacement=twisted(sheet.position))
sim.relax(tolerance=1e-4)
print(f"{len(sheet)} atoms, {len(sheet.bonds)} bonds, twisted by {np.degrees(TURN):.0f} degrees")
print(f"elastic energy {sim.energy()['pair'] / 1.602e-19:.1f} eV")
shape, energy = sim.position, sim.bond_energy

free = wd.Scene()
loose = free.add(sheet, carbon, bond=bond)
free.hold(loose, sheet.side("left"))
motion = wd.Simulation(free)
motion.set_state(displacement=sim.displacement, orientation=sim.orientation)
motion.observe(wd.UsdWriter(OUT / "sheet.usd", every=100, color="velocity"))
motion.run(until=1.5e-12)
taken = motion.energy()["damping"] / motion.initial_energies["pair"]
print(f"let go for 1.5 ps: dashpots took {taken:.0%}, energy error {motion.energy_error:.1e}")

wd.draw_structure(
    OUT / "graphene_sheet.png",
    [("flat", sheet.position), ("twisted, at rest", shape)],
    sheet.bonds,
    value=energy / 1.602e-19,
    label="elastic energy of a bond [eV]",
    title="A sheet of 6 nm of hexagonal rings, one end turned against the other",
    view=(25, -65),
)
print(f"picture in {OUT / 'graphene_sheet.png'}, scene in {OUT / 'sheet.usd'}")

"""A thick steel cylinder is widened from inside until it flows throughout (Hill)."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/thick_cylinder")
INNER, OUTER, SPACING, YIELD = 20e-3, 40e-3, 1e-3, 300e6

steel = wd.Material(young=210e9, poisson=0.3, density=7850)
ring = wd.packing.voronoi(wd.packing.Ring(INNER - SPACING, OUTER), SPACING, plane="strain")
wall = ring.side("inner")  # one layer, that a mandrel moves outwards
scene = wd.Scene()
body = scene.add(ring, steel, yielding=wd.VonMises(YIELD))

# as the elastic cylinder moves (Lame), slowly against the waves in it, so that nothing swings
radius = np.linalg.norm(ring.position, axis=1)
outwards = ring.position / radius[:, None]
shape = (1 - 2 * steel.poisson) * radius / OUTER**2 + 1 / radius
time = 60 * INNER / steel.shear_speed()
speed = 1.6 / 3**0.5 * YIELD / (2 * steel.shear_modulus) * OUTER**2 / time
velocity = speed * shape[:, None] * outwards
scene.set_velocity(body, velocity)
scene.hold(body, wall, velocity[wall])

sim = wd.Simulation(scene)
across = wall[sim.bonds].sum(axis=1) == 1
middle = ring.position[sim.bonds[across]].mean(axis=1)
normal = middle / np.linalg.norm(middle, axis=1)[:, None]
normal *= np.where(wall[sim.bonds[across, 0]], -1, 1)[:, None]
inner = np.sqrt(ring.volume[wall].sum() / np.pi + (INNER - SPACING) ** 2)


def pressure() -> float:
    """Of the mandrel on the rest of the cylinder [Pa]."""
    return (sim.bond_force[across] * normal).sum() / (2 * np.pi * inner)


def zone() -> float:
    """Outer radius of the part that has flowed [m]."""
    return np.sqrt(inner**2 + ring.volume[(sim.plastic_strain > 0) & ~wall].sum() / np.pi)


while zone() < 1.5 * inner:
    sim.run(steps=50)
found, c = pressure(), zone()
theory = YIELD / 3**0.5 * (1 - (c / OUTER) ** 2 + 2 * np.log(c / inner))
print(f"plastic to {c / inner:.3f} of the inner radius at {found / 1e6:.1f} MPa")
print(f"error {found / theory - 1:.2%} of the pressure")
wd.draw_field(
    OUT / "thick_cylinder.png",
    ring,
    sim.von_mises / 1e6,
    label="von Mises stress [MPa]",
    limits=(0, YIELD / 1e6),
    title=f"Steel cylinder, plastic to {1e3 * c:.1f} mm at {found / 1e6:.0f} MPa inside",
)

sim.run(until=time)
collapse = 2 * YIELD / 3**0.5 * np.log(OUTER / inner)
print(f"plastic throughout: {pressure() / 1e6:.1f} MPa, error {pressure() / collapse - 1:.2%}")
print(f"picture in {OUT / 'thick_cylinder.png'}")

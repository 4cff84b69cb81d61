"""A cantilever of EVM bonds under a tip load: at rest, and its first natural frequencies."""

from pathlib import Path

import numpy as np

import warpdem as wd

OUT = Path("out/cantilever")
LENGTH, BONDS, LOAD = 0.5, 32, 40.0

steel = wd.Material(young=210e9, poisson=0.3, density=7850)
section = wd.Circle(radius=5e-3)
rod = wd.packing.filament([[0, 0, 0], [LENGTH, 0, 0]], BONDS, section)
scene = wd.Scene()
body = scene.add(rod, steel, bond=wd.EVMBond.timoshenko(steel, section, rod.bond_length))
scene.hold(body, rod.side("start"))
scene.load(body, rod.side("end"), force=[0, -LOAD, 0])

sim = wd.Simulation(scene)
frequency = sim.natural_frequencies(2)[0]
sim.equilibrate()
tip = -sim.displacement[-1, 1]

bending = steel.young * section.second_moment
shear = section.shear_coefficient(steel.poisson) * steel.shear_modulus * section.area
theory = LOAD * LENGTH**3 / (3 * bending) + LOAD * LENGTH / shear
slender = 1.875104**2 * np.sqrt(bending / (steel.density * section.area)) / LENGTH**2
print(f"tip deflection {1e3 * tip:.4f} mm, difference {tip / theory - 1:.2%} to Timoshenko's beam")
print(f"first frequency {frequency / (2 * np.pi):.3f} Hz, Euler's {slender / (2 * np.pi):.3f} Hz")

wd.draw_structure(
    OUT / "cantilever.png",
    [
        ("unloaded", rod.position[:, :2]),
        ("loaded, deflection x 5", (rod.position + 5 * sim.displacement)[:, :2]),
    ],
    rod.bonds,
    value=1e3 * sim.bond_energy,
    label="elastic energy of a bond [mJ]",
    title=f"Steel cantilever of 10 mm diameter, {LOAD:g} N at its tip",
)
print(f"picture in {OUT / 'cantilever.png'}")

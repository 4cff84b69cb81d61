"""A close-coiled spring of EVM bonds is pulled; its stiffness against the textbook's."""

from pathlib import Path

import warpdem as wd

OUT = Path("out/helical_spring")
COIL, WIRE, TURNS, FORCE = 10e-3, 0.5e-3, 8, 2.0

steel = wd.Material(young=210e9, poisson=0.3, density=7850)
section = wd.Circle(radius=WIRE)
spring = wd.packing.helix(COIL, pitch=3 * WIRE, turns=TURNS, bonds_per_turn=32, section=section)
scene = wd.Scene()
body = scene.add(spring, steel, bond=wd.EVMBond.timoshenko(steel, section, spring.bond_length))
scene.hold(body, spring.side("start"))
scene.hold(body, spring.side("end"), axes="xy")  # the upper end moves along the axis
scene.load(body, spring.side("end"), force=[0, 0, FORCE])

sim = wd.Simulation(scene)
sim.equilibrate(load_steps=4)
stretch = sim.displacement[-1, 2]
theory = steel.shear_modulus * (2 * WIRE) ** 4 / (8 * (2 * COIL) ** 3 * TURNS)
stiffness = FORCE / stretch
print(f"stiffness {stiffness:.1f} N/m, difference {stiffness / theory - 1:.1%} to the textbook's")

wd.draw_structure(
    OUT / "helical_spring.png",
    [("unloaded", spring.position), (f"under {FORCE:g} N", sim.position)],
    spring.bonds,
    value=1e6 * sim.bond_energy,
    label="elastic energy of a bond [µJ]",
    title=f"Steel spring, wire of 1 mm, {TURNS} turns of 20 mm",
    view=(12, -60),
)
print(f"picture in {OUT / 'helical_spring.png'}")

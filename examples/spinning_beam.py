"""A free beam of EVM bonds spins and bends for a hundred turns and keeps its energy."""

import numpy as np

import warpdem as wd

LENGTH, BONDS, SPIN, TURNS = 10.0, 10, 0.5, 100

x = np.zeros((BONDS + 1, 3))
x[:, 0] = np.linspace(-LENGTH / 2, LENGTH / 2, BONDS + 1)
beam = wd.packing.network(x, [[i, i + 1] for i in range(BONDS)], volume=1.0, radius=0.5)
scene = wd.Scene()
body = scene.add(
    beam,
    wd.Material(young=1.0, poisson=0.0, density=1.0),
    bond=wd.EVMBond(longitudinal=1000.0, shear=270.0, bending=22.5, torsion=18.0),
)
velocity = np.cross([0.0, 0.0, SPIN], x)
velocity[:, 2] += np.cos(2 * np.pi * np.linspace(0, 1, BONDS + 1))
velocity[:, 2] -= velocity[:, 2].mean()
scene.set_velocity(body, velocity, angular_velocity=[0.0, 0.0, SPIN])

sim = wd.Simulation(scene)
sim.run(until=TURNS * 2 * np.pi / SPIN)
energy = sim.energy()
print(f"{sim.steps} steps, energy error {sim.energy_error:.1e}")
print(f"bending energy now {energy['pair']:.3f} J of {energy['pair'] + energy['kinetic']:.3f} J")

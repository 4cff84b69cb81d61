"""What the guards cost, in shares of a step's time: `python benchmarks/guards.py`."""

import time

import warpdem as wd
from warpdem.simulation import GUARD_EVERY


def least(act, times=9):
    """The shortest of some wall times [s]."""
    found = []
    for _ in range(times):
        began = time.perf_counter()
        act()
        found.append(time.perf_counter() - began)
    return min(found)


def steps(sim):
    for _ in range(GUARD_EVERY):
        sim._step.advance()


for spacing in (1e-3, 4e-4):
    glass = wd.Material(young=72e9, poisson=0.22, density=2440)
    plate = wd.packing.hexagonal(size=(0.1, 0.04), spacing=spacing, plane="stress")
    scene = wd.Scene()
    body = scene.add(plate, glass, fracture=wd.DruckerPrager(compression=150e6, ratio=3))
    scene.pull(body, plate.top, (0, 12e6))
    scene.pull(body, plate.bottom, (0, -12e6))
    sim = wd.Simulation(scene)
    sim.run(steps=2 * GUARD_EVERY)
    between = least(lambda: steps(sim), 3)
    sim._step.synchronise()
    look = least(lambda: sim._guarded.check(sim._step))
    energy = least(sim.energy)
    print(
        f"{len(plate)} elements: looks {look / between:.2%}, energy {energy / between:.2%} "
        f"of {GUARD_EVERY} steps"
    )

"""Bars of polymer pulled for a while and let go: creep and recovery, against the closed form."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import warpdem as wd

OUT = Path("out/creep_and_recovery")
TRACTION = 1e6
TIME = 4e-4  # of relaxation: long against the bar's own period, or it would swing
RAMP = 4e-4  # the load comes and goes in this time, smoothly
RELEASE = 2 * TIME

polymer = wd.Material(young=3e9, poisson=0.35, density=1200)  # at once, before anything has relaxed
laws = {
    "elastic": None,
    "standard linear solid": wd.StandardLinearSolid(share=0.6, time=TIME),
    "Maxwell": wd.Maxwell(TIME),
}


def compliance(law: object, time: np.ndarray) -> np.ndarray:
    """Strain over traction: 1/(9 K) + J(t)/3, J the shear compliance; 0 before time 0."""
    t = np.maximum(time, 0.0)
    creep = np.zeros_like(t)
    if isinstance(law, wd.Maxwell):
        creep = t / law.time
    elif isinstance(law, wd.StandardLinearSolid):
        left = 1 - law.share
        creep = law.share / left * -np.expm1(-left * t / law.time)
    once = 1 / (9 * polymer.bulk_modulus) + (1 + creep) / (3 * polymer.shear_modulus)
    return np.where(time > 0, once, 0.0)


def load(time: float) -> float:
    """Share of the traction that acts at a time."""
    up, down = (np.clip(t / RAMP, 0, 1) for t in (time, time - RELEASE))
    return np.sin(0.5 * np.pi * up) ** 2 - np.sin(0.5 * np.pi * down) ** 2


def exact(law: object, time: float) -> float:
    """Strain under that load: small steps one after the other."""
    ends = np.arccos(1 - 2 * (np.arange(400) + 0.5) / 400) / np.pi * RAMP  # of equal steps
    steps = compliance(law, time - ends) - compliance(law, time - RELEASE - ends)
    return TRACTION * steps.mean()


bar = wd.packing.square((4e-3, 24e-3), 1e-3, plane="stress")
scene = wd.Scene()
bodies = {}
for name, law in laws.items():
    bodies[name] = body = scene.add(bar, polymer, facet_bending=True, viscous=law)
    for side, sign in ((bar.top, 1), (bar.bottom, -1)):
        scene.pull(body, side, (0, sign * TRACTION), history=load)

sim = wd.Simulation(scene)
height = bar.position[:, 1]
middle = abs(height - 12e-3) < 6e-3
times = np.linspace(0, 2 * RELEASE, 61)[1:]
found = {name: [] for name in laws}
for time in times:
    sim.run(until=time)
    for name, body in bodies.items():
        u = sim.displacement[sim.elements(body), 1]
        found[name].append(np.polyfit(height[middle], u[middle], 1)[0])

fig = Figure(figsize=(8, 5), layout="constrained")
axes = fig.subplots()
for name, law in laws.items():
    known = np.array([exact(law, t) for t in times])
    error = abs(np.array(found[name]) - known).max() / known.max()
    print(f"{name}: greatest strain {max(found[name]):.3e}, error {error:.1e} of it")
    (line,) = axes.plot(times * 1e3, np.array(found[name]) * 1e3, label=name)
    axes.plot(times[::3] * 1e3, known[::3] * 1e3, "o", mfc="none", color=line.get_color())
axes.plot([], [], "ko", mfc="none", label="closed form")
axes.set(
    xlabel="time [ms]",
    ylabel="strain [1e-3]",
    title="Bars of polymer pulled for 0.8 ms, then let go",
)
axes.legend()
OUT.mkdir(parents=True, exist_ok=True)
fig.savefig(OUT / "creep.png", dpi=130)
print(f"picture in {OUT / 'creep.png'}")

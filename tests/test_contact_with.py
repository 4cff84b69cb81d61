"""Contact of bodies that yield, creep, meet at unlike grains, or are no spheres (theory B11)."""

from dataclasses import replace

import numpy as np
import pytest

import warpdem as wd
from warpdem.validation.contact import SOFT

HEX = wd.packing.hexagonal((4.0, 3.0), 1.0, "strain")
CUBE = wd.packing.simple_cubic((2.0, 2.0, 2.0), 1.0)
STIFF = wd.Material(3.0, 0.2, 1.0)
N = len(CUBE)
# bricks: principal radii of gyration about turned axes
BRICKS = replace(
    CUBE,
    gyration=np.tile([0.2, 0.3, 0.35], (N, 1)),
    axes=np.tile([0.1, 0.3, 0.2, np.sqrt(0.86)], (N, 1)),
)
GRAINS = {"grain": (HEX.position[:, 0] > HEX.position[:, 0].mean()).astype(int)}


def momenta(sim):
    """Momentum and angular momentum of everything that moves, nodes too; and their size."""
    m, step = sim.model, sim._step
    x = m.position + step.download("displacement")
    p = m.mass[:, None] * step.download("velocity")
    w = step.download("angular_velocity")
    spin = m.inertia[:, None] * w
    if m.principal_moment is not None:
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_quat(step.download("orientation")) * Rotation.from_quat(
            m.principal_axes
        )
        spin = turn.apply(m.principal_moment * turn.inv().apply(w))
    free = m.inverse_inertia[:, None] > 0.0
    orbit = np.cross(x, p) if x.shape[1] == 3 else x[:, :1] * p[:, 1:] - x[:, 1:] * p[:, :1]
    return p.sum(axis=0), (orbit + free * spin).sum(axis=0), np.abs(orbit).sum()


@pytest.mark.parametrize(
    ("packing", "material", "options", "taken"),
    [
        (HEX, SOFT, {"yielding": wd.VonMises(2e-3, 0.1)}, "plastic"),
        (HEX, SOFT, {"viscous": wd.Maxwell(30.0)}, "viscous"),
        (HEX, SOFT, {"viscous": wd.KelvinVoigt(0.3)}, "damping"),
        (HEX, [SOFT, STIFF], GRAINS, "friction"),
        (BRICKS, SOFT, {"facet_bending": True}, "friction"),
    ],
    ids=["yield", "Maxwell", "Kelvin-Voigt", "nodes", "bricks"],
)
def test_bodies_collide_with_all_of_contact(packing, material, options, taken):
    scene = wd.Scene()
    dim = packing.dim
    for number in range(2):
        body = scene.add(packing, material, **options)
        wide = np.ptp(packing.position[:, 0]) + 1.02
        body.displacement[:, :2] = number * np.array([wide, 0.3])
        scene.set_velocity(body, -0.01 * number * np.eye(dim)[0])
    scene.contact(friction=0.3, restitution=0.6, restitution_by="dashpot", rolling_friction=0.1)
    sim = wd.Simulation(scene)
    before, held = momenta(sim), sim.energy()["kinetic"]
    first, touched = 0.01 * sim.model.mass.sum(), 0
    for _ in range(20):
        sim.run(steps=20)
        touched += len(sim.contacts)
    after, ledger = momenta(sim), sim.energy()
    assert touched > 0
    assert np.abs(after[0] - before[0]).max() < 1e-13 * first
    assert np.abs(after[1] - before[1]).max() < 1e-12 * before[2]
    assert abs(ledger["residual"]) < 1e-4 * held
    for name in (taken, "friction", "damping"):
        assert ledger[name] > 1e-4 * held, name

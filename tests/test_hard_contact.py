import numpy as np
import pytest

import warpdem as wd


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["facet", "EVM"])
def test_every_bond_may_break_in_one_step(dim, kind):
    size = (6.0, 5.0, 4.0)[:dim]
    p = wd.packing.voronoi(size, 1.0, "strain" if dim == 2 else None, seed=1)
    scene = wd.Scene()
    bond = "facet" if kind == "facet" else wd.EVMBond(1.0, 0.4, 0.1, 0.1)
    body = scene.add(p, wd.Material(1.0, 0.3, 1.0), bond=bond, fracture=wd.Rankine(1e-9))
    scene.strain(body, np.diag([2e-2, 1e-2, 3e-2][:dim]))
    scene.contact(friction=0.3)
    sim = wd.Simulation(scene)
    before = sim.energy()
    held = before["pair"] + before["volume"]
    sim.run(steps=1)
    assert not sim.linked.any()
    sim.run(steps=500)  # numbers that are not finite would end it
    ledger = sim.energy()
    now = ledger["kinetic"] + ledger["contact"]
    assert now <= held and ledger["fracture"] > 0.0
    assert abs(ledger["residual"]) < 1e-3 * held

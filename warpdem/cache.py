"""Compiled kernels on disk: as they were written, or compiled anew."""

import os
import shutil
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from types import MethodType
from typing import Any, NoReturn

import warp as wp

from .errors import UnwritableError

SEAL = "warpdem.sha256"  # beside the files of a module: digests of those that are loaded
LOADED = (".o", ".ptx", ".cubin", ".meta")


def start() -> None:
    """Start Warp; raises UnwritableError where compiled kernels cannot be kept."""
    try:
        wp.init()
    except OSError as error:
        _refuse(os.environ.get("WARP_CACHE_PATH", "its folder"), error)


def sealed(kernel: wp.Kernel) -> wp.Kernel:
    """The kernel, whose module is loaded from disk only if its files are as they were written.

    Warp keeps no digest of them. Those that a full disk or a killed process left are removed and
    compiled again.
    """
    kernel.module.load = MethodType(_load, kernel.module)
    return kernel


def _load(module: Any, device: Any, block_dim: int | None = None, *more: Any, **named: Any) -> Any:
    def load() -> Any:
        return type(module).load(module, device, block_dim, *more, **named)

    size = module.options["block_dim"] if block_dim is None else block_dim
    if (wp.get_device(device).context, size) in module.execs:  # as Warp itself keys it
        return load()
    where = Path(wp.config.kernel_cache_dir) / module.get_module_identifier(size)
    there, known = where.is_dir(), _read(where)
    if any(_digest(where / name) != digest for name, digest in known.items()):
        shutil.rmtree(where, ignore_errors=True)
        there = False
    try:
        found = load()
    except OSError as error:
        if not there:
            _refuse(wp.config.kernel_cache_dir, error)
        found = None
    except Exception:  # of files that it cannot load Warp raises whatever their reader does
        if not there:
            raise
        found = None  # built anew below, where what is not the files' fault is raised again
    if found is None:
        shutil.rmtree(where, ignore_errors=True)
        found = load()
    _seal(where)
    return found


def _read(where: Path) -> dict[str, str]:
    """Digests of the files as they were written, by name."""
    try:
        lines = (where / SEAL).read_text().splitlines()
    except OSError:
        return {}
    return {name: digest for digest, _, name in (line.partition("  ") for line in lines)}


def _seal(where: Path) -> None:
    files = [x.name for x in where.iterdir() if x.suffix in LOADED]
    if _read(where).keys() >= set(files):
        return
    lines = [f"{_digest(where / name)}  {name}\n" for name in sorted(files)]
    with suppress(OSError):  # a cache that others keep may be for reading alone
        part = where / f".{SEAL}.{os.getpid()}"
        part.write_text("".join(lines))
        os.replace(part, where / SEAL)


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest() if path.exists() else ""


def _refuse(where: str, error: OSError) -> NoReturn:
    raise UnwritableError(
        f"cannot keep compiled kernels in {where}: {error.strerror or error}. Free some space, or "
        "set WARP_CACHE_PATH to a folder that can be written to."
    ) from None

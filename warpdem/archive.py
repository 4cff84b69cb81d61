"""Files of arrays that are whole or refused: what a checkpoint is stored in.

A NumPy .npz, uncompressed, that `numpy.load` reads. Its first member, header.json, names every
array with its dtype and shape; the archive's comment, at the very end of the file, is the SHA-256
of all bytes before it.
"""

import json
import os
import re
import zipfile
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from .errors import DamagedFileError, InputError
from .write.whole import whole

VERSION = 1
SEAL = b"warpdem sha256 "
DIGEST = 64  # hexadecimal digits
MOST_HEADER = 1 << 28  # bytes that a header may take
BLOCK = 1 << 20
# what the readers of zip files, JSON and NumPy's format raise for bytes that are none of theirs:
# RuntimeError also of an encrypted member, and of JSON that is nested without end
UNREADABLE = (
    zipfile.BadZipFile, AttributeError, KeyError, RuntimeError, TypeError, ValueError,
)  # fmt: skip
DTYPE = re.compile(r"[|<][biufUS]\d+")


def write_archive(path: Path, header: dict[str, Any], arrays: dict[str, NDArray]) -> None:
    """Write a file under its name when it is whole and on the disk; what had that name before is
    kept as `previous(path)`.

    header: plain data for JSON; arrays: of numbers or texts, structured ones as well.
    """
    told = {name: [_dtype_told(a.dtype), list(a.shape)] for name, a in arrays.items()}
    text = json.dumps({"version": VERSION, "arrays": told, **header}, allow_nan=True)
    with whole(path) as part:
        with part.open("w+b") as file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
                archive.writestr(_member("header.json"), text)
                for name, array in arrays.items():
                    with archive.open(_member(name + ".npy"), "w", force_zip64=True) as member:
                        npy.write_array(member, np.ascontiguousarray(array).reshape(array.shape),
                                        allow_pickle=False)  # fmt: skip
                archive.comment = SEAL + b"0" * DIGEST
            file.seek(0)
            digest = _digest(file, os.fstat(file.fileno()).st_size - DIGEST)
            file.seek(-DIGEST, os.SEEK_END)
            file.write(digest)
            file.flush()
            os.fsync(file.fileno())  # before the file of this name gets its second one
        if path.exists():
            _keep(path)


def previous(path: Path) -> Path:
    """Where the file that had this name before is kept."""
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def read_archive(path: Path) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Header and arrays of a file, after its digest, sizes and shapes were found right.

    Raises DamagedFileError that says what is wrong, before memory is taken for the arrays.
    """
    try:
        with path.open("rb") as file:
            _check_seal(file)
            with zipfile.ZipFile(file) as archive:
                header = _header(archive)
                arrays = {
                    name: _array(archive, name, *told) for name, told in header["arrays"].items()
                }
    except FileNotFoundError:
        raise DamagedFileError(f"there is no file {path}{_advice(path)}.") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}.") from None
    except _WrongError as wrong:
        raise DamagedFileError(f"{path} is damaged: {wrong}{_advice(path)}.") from None
    except UNREADABLE as error:
        raise DamagedFileError(
            f"{path} is damaged: not a file as warpdem writes them ({error}){_advice(path)}."
        ) from None
    return header, arrays


class _WrongError(Exception):
    """What is wrong with a file, as the end of a sentence."""


def _keep(path: Path) -> None:
    """Give a file its second name, so that there is one whole file under `path` at all times."""
    second, part = previous(path), path.with_name(f".{path.name}.{os.getpid()}.kept")
    try:
        os.link(path, part)
        os.replace(part, second)
    except OSError:  # a file system without links
        os.replace(path, second)
    finally:
        part.unlink(missing_ok=True)


def _member(name: str) -> zipfile.ZipInfo:
    return zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # the same state gives the same bytes


def _advice(path: Path) -> str:
    return f"; the one before it is {previous(path)}" if previous(path).exists() else ""


def _digest(file: BinaryIO, size: int) -> bytes:
    """SHA-256 of the next bytes, in hexadecimal digits."""
    found = sha256()
    while size > 0:
        block = file.read(min(BLOCK, size))
        if not block:
            raise _WrongError("it ends too early")
        found.update(block)
        size -= len(block)
    return found.hexdigest().encode()


def _check_seal(file: BinaryIO) -> None:
    size = file.seek(0, os.SEEK_END)
    tail = len(SEAL) + DIGEST
    if size < tail:
        raise _WrongError("it ends too early")
    file.seek(-tail, os.SEEK_END)
    seal = file.read(tail)
    if not seal.startswith(SEAL):
        raise _WrongError("it does not end with a digest, as if cut off")
    file.seek(0)
    if _digest(file, size - DIGEST) != seal[len(SEAL) :]:
        raise _WrongError("its bytes are not those that were written (SHA-256 differs)")
    file.seek(0)


def _header(archive: zipfile.ZipFile) -> dict[str, Any]:
    members = archive.infolist()
    if any(m.compress_type != zipfile.ZIP_STORED or m.compress_size != m.file_size
           for m in members):  # fmt: skip
        raise _WrongError("it holds compressed members, which warpdem does not write")
    if archive.getinfo("header.json").file_size > MOST_HEADER:
        raise _WrongError("its header is too long")
    header = json.loads(archive.read("header.json"))
    if header["version"] != VERSION:
        raise _WrongError(f"it has version {header['version']}, this warpdem reads {VERSION}")
    names = {m.filename for m in members} - {"header.json"}
    if names != {name + ".npy" for name in header["arrays"]} or len(names) + 1 != len(members):
        raise _WrongError("its arrays are not those that its header names")
    return header


def _array(archive: zipfile.ZipFile, name: str, told: Any, shape: list[int]) -> NDArray:
    dtype, info = _dtype_read(told), archive.getinfo(name + ".npy")
    if any(not isinstance(n, int) or n < 0 for n in shape):
        raise _WrongError(f"the shape of {name} is {shape}")
    size = dtype.itemsize
    for n in shape:  # of Python's integers, which do not overflow
        size *= n
    with archive.open(info) as member:
        major = npy.read_magic(member)[0]
        read = {1: npy.read_array_header_1_0, 2: npy.read_array_header_2_0}[major]
        found, in_columns, own = read(member)
        if own.hasobject or own != dtype or list(found) != shape or in_columns:
            raise _WrongError(f"{name} is not what its header says")
        if size != info.file_size - member.tell():
            raise _WrongError(f"{name} should have {size} bytes and has another number")
        data = member.read()
        if len(data) != size:
            raise _WrongError(f"{name} ends too early")
    return np.frombuffer(data, dtype).reshape(shape).copy() if size else np.zeros(shape, dtype)


def _dtype_told(dtype: np.dtype) -> Any:
    if dtype.hasobject:
        raise TypeError("arrays of objects are not written")
    if dtype.names:
        return [[n, _dtype_told(dtype[n])] for n in dtype.names]
    return dtype.str


def _dtype_read(told: Any) -> np.dtype:
    if isinstance(told, list):
        return np.dtype([(str(n), _dtype_read(d)) for n, d in told])
    if not DTYPE.fullmatch(str(told)):
        raise _WrongError(f"it has numbers of the kind {told!r}")
    return np.dtype(told)

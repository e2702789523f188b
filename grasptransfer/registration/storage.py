"""Fields and shape spaces on disk: npz with a checksum, written whole, never executed."""

import hashlib
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from grasptransfer.errors import FieldFileError
from grasptransfer.files import replacing, writing

VERSION = 1
# What zip and numpy raise where bytes are wrong.
UNREADABLE = (ValueError, OSError, EOFError, KeyError, NotImplementedError, RuntimeError, TypeError)
UNREADABLE += (MemoryError, zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError, SyntaxError)


def save_arrays(path: str | Path, kind: str, arrays: dict[str, np.ndarray]):
    """Write named arrays under a temporary name, then rename."""
    path = Path(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    # Not ascontiguousarray, which makes a number an array of one.
    arrays = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            kind=np.array(kind),
            version=np.array(VERSION),
            sha256=np.array(_checksum(arrays)),
            allow_pickle=False,
            **arrays,
        )


def load_arrays(path: str | Path, kind: str) -> dict[str, np.ndarray]:
    """Read arrays that `save_arrays` wrote.

    Raises:
        FieldFileError: missing, not such a file, of another kind or version, or corrupt.
    """
    path = Path(path)
    if not path.is_file():
        raise FieldFileError("does not exist", path=path)
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    except UNREADABLE as error:
        raise FieldFileError(f"cannot be read as npz: {error}", path=path) from error
    header = {name: arrays.pop(name, None) for name in ("kind", "version", "sha256")}
    if any(value is None for value in header.values()):
        raise FieldFileError("was not written by grasptransfer", path=path, choices=[kind])
    if str(header["kind"]) != kind:
        raise FieldFileError(
            "holds something else", path=path, key="kind", value=str(header["kind"]), choices=[kind]
        )
    if int(header["version"]) != VERSION:
        raise FieldFileError(
            "is of another version",
            path=path,
            key="version",
            value=int(header["version"]),
            choices=[VERSION],
        )
    if str(header["sha256"]) != _checksum(arrays):
        raise FieldFileError("is corrupt: its checksum differs", path=path, fix="Write the file again")
    return arrays


def _checksum(arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()

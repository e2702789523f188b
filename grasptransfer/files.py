"""Files: checksums and content keys; what is written is there whole or not at all."""

import contextlib
import dataclasses
import enum
import hashlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from grasptransfer.errors import SettingsError


def sha256(path: Path) -> str:
    """Checksum of a file's bytes, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def content_key(*parts: object) -> str:
    """A checksum, hexadecimal, that changes whenever any part does: what names a result by all that made it.

    Args:
        parts: numbers, texts, arrays, dataclasses, and lists, sets and mappings of them. A `Path` counts with
            what it holds: the bytes of its file, or of every file below its folder and their names there.

    Raises:
        FileNotFoundError: a path that does not exist.
    """
    digest = hashlib.sha256()
    for piece in _pieces(parts):
        digest.update(len(piece).to_bytes(8, "little") + piece)
    return digest.hexdigest()


def _pieces(value: object) -> Iterator[bytes]:
    """The value as bytes, in an order of its own; what it is comes first."""
    if isinstance(value, Path):
        yield from _files(value)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        yield type(value).__name__.encode()
        yield from _pieces(fields)
    elif isinstance(value, dict):
        yield f"mapping of {len(value)}".encode()
        for key in sorted(value, key=repr):
            yield repr(key).encode()
            yield from _pieces(value[key])
    elif isinstance(value, (list, tuple)):
        yield f"list of {len(value)}".encode()
        for item in value:
            yield from _pieces(item)
    elif isinstance(value, (set, frozenset)):
        yield from _pieces(sorted(value))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape}".encode()
        yield value.tobytes()
    else:
        plain = value.item() if isinstance(value, np.generic) else value
        assert isinstance(plain, (str, bytes, int, float, enum.Enum, type(None))), value
        yield repr(plain).encode()


def _files(path: Path) -> Iterator[bytes]:
    names = sorted(below for below in path.rglob("*") if below.is_file()) if path.is_dir() else [path]
    yield f"{len(names)} files".encode()
    for name in names:
        yield name.relative_to(path).as_posix().encode()
        yield hashlib.sha256(name.read_bytes()).digest()


def write_whole(path: str | Path, content: bytes) -> None:
    """Write `content` so that it is there whole or not at all; folders above it are made.

    Raises:
        SettingsError: the file cannot be written.
    """
    path = Path(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`, of the same ending, that takes its place when the block ends well.

    Raises:
        SettingsError: the folder does not exist, or the file cannot be written.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        with writing(path):
            temporary.touch(exist_ok=False)
            yield temporary
            os.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):  # it never was, or the folder is gone: what matters is raised
            temporary.unlink()


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turns the system's refusal to write `path`, or below it, into one sentence that names it.

    Raises:
        SettingsError: an OSError came up in the block.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)  # without the name, which may be a temporary one
        raise SettingsError("cannot be written", path=path, fix=reason) from error

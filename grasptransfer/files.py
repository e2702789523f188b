"""Files: checksums, YAML with its mistakes named, writing that leaves the old file or the new one, whole."""

import contextlib
import hashlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

import yaml

from grasptransfer.errors import GraspTransferError, SettingsError

MESHES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")  # suffixes of mesh files that are read


def sha256(path: Path) -> str:
    """Checksum of a file's bytes, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


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


class _Loader(yaml.SafeLoader):
    """Safe loader that refuses a key given twice, where YAML would silently keep the last."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} is given twice", key_node.start_mark
                )
            seen.add(str(key))
        return super().construct_mapping(node, deep)


def read_yaml(path: str | Path, *, error: type[GraspTransferError]) -> dict:
    """Mapping of a YAML file.

    Raises:
        error: unreadable, not YAML (with the line), or not a mapping.
    """
    path = Path(path)
    try:
        data = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except FileNotFoundError as cause:
        raise error("does not exist", path=path) from cause
    except UnicodeDecodeError as cause:
        raise error("is not a text file", path=path) from cause
    except OSError as cause:
        raise error("cannot be read", path=path, fix=str(cause)) from cause
    except yaml.YAMLError as cause:
        mark = getattr(cause, "problem_mark", None)
        line = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        what = getattr(cause, "problem", None) or "cannot be parsed"
        raise error(f"is not valid YAML{line}: {what}", path=path) from cause
    if isinstance(data, list):
        raise error("holds a list where a mapping is wanted", path=path, value=data, fix="Give one entry")
    if not isinstance(data, dict):
        raise error("must hold a mapping of keys to values", path=path, value=data)
    return data

"""Files: checksums, YAML and JSON with their mistakes named; what is written is there whole or not at all."""

import contextlib
import dataclasses
import enum
import hashlib
import json
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml
from jaxtyping import Float

from grasptransfer.errors import GraspTransferError, SettingsError


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


class _Loader(yaml.SafeLoader):
    """Safe loader for the core schema of YAML 1.2, without its surprises for people who write by hand.

    Keys are always text, so that grasps may be called 1 or no. Only `true` and `false` are booleans, `6.9e2`
    is a number, and `1:30` and `2026-01-01` are text. A key given twice is refused, where YAML would silently
    keep the last; merge keys (`<<`) work.
    """

    yaml_implicit_resolvers: ClassVar[dict] = {}

    def compose_mapping_node(self, anchor):
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, "a key must be text", key.start_mark)
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key.value!r} is given twice", key.start_mark
                )
            seen.add(key.value)
            if key.tag != MERGE:
                key.tag = "tag:yaml.org,2002:str"
        return node


MERGE = "tag:yaml.org,2002:merge"
for _tag, _pattern, _first in (
    ("bool", "true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", "~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", "[-+]?[0-9]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
    ("merge", "<<", "<"),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first))


# YAML 1.1 reads 010 as eight; the core schema, like everybody who types it, reads ten.
def _integer(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    return int(loader.construct_scalar(node))


# OpenCV's cv::FileStorage marks its matrices so: rows, cols, dt and data.
def _opencv_matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:int", _integer)
_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _opencv_matrix)


def read_text(path: str | Path, *, error: type[GraspTransferError]) -> str:
    """Text of a UTF-8 file.

    Raises:
        error: it does not exist, cannot be read, or is not text.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as cause:
        raise error("does not exist", path=path) from cause
    except UnicodeDecodeError as cause:
        raise error("is not a text file", path=path) from cause
    except OSError as cause:
        raise error("cannot be read", path=path, fix=cause.strerror or str(cause)) from cause
    if "\0" in text:
        raise error("is not a text file", path=path)
    return text


def read_data(path: str | Path, *, error: type[GraspTransferError]) -> Any:
    """Content of a JSON or YAML file: mappings, lists, numbers, text.

    A file that ends in `.json`, or that starts as JSON does and is JSON, is read as JSON (tabs, `6.9e2`).

    Raises:
        error: unreadable, neither JSON nor YAML (with the line), or with a key given twice.
    """
    text = read_text(path, error=error)
    if text.lstrip()[:1] in ("{", "["):
        try:
            return json.loads(text, object_pairs_hook=_pairs)
        except _TwiceError as cause:
            raise error(f"is not valid JSON: key {cause.args[0]!r} is given twice", path=path) from cause
        except (json.JSONDecodeError, RecursionError) as cause:
            if Path(path).suffix.lower() == ".json":
                raise error("is not valid JSON", path=path, fix=str(cause)) from cause
    return _parse_yaml(text, path, error)


def read_array(path: str | Path, *, error: type[GraspTransferError]) -> Float[np.ndarray, "..."] | None:
    """Numbers of a `.npy` file, or of a text file of nothing but numbers in rows; None for other text.

    Raises:
        error: unreadable, or rows of different lengths.
    """
    path = Path(path)
    if path.suffix.lower() == ".npy":
        try:
            return np.load(path, allow_pickle=False).astype(float)
        except FileNotFoundError as cause:
            raise error("does not exist", path=path) from cause
        except (OSError, ValueError, EOFError) as cause:
            raise error("is no readable npy array of numbers", path=path, fix=str(cause)) from cause
    lines = (
        line.partition("#")[0].replace(",", " ").split() for line in read_text(path, error=error).splitlines()
    )
    rows = [line for line in lines if line]
    try:
        numbers = [[float(word) for word in row] for row in rows]
    except ValueError:
        return None
    if not numbers:
        return None
    if len({len(row) for row in numbers}) > 1:
        lengths = [len(row) for row in numbers]
        raise error("has rows of different lengths", path=path, value=lengths)
    return np.array(numbers)


class _TwiceError(ValueError):
    """A key of a JSON object is there twice."""


def _pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise _TwiceError(next(name for name in names if names.count(name) > 1))
    return found


def _parse_yaml(text: str, path: str | Path, error: type[GraspTransferError]) -> Any:
    if text.startswith("%YAML:"):  # OpenCV's cv::FileStorage writes a directive that YAML does not know
        text = "#" + text
    try:
        documents = [found for found in yaml.load_all(text, Loader=_Loader) if found is not None]
    except (yaml.YAMLError, RecursionError, ValueError) as cause:
        mark = getattr(cause, "problem_mark", None)
        line = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        what = getattr(cause, "problem", None) or "cannot be parsed"
        fix = "YAML is indented by spaces, not by tabs" if r"'\t'" in what else None
        raise error(f"is not valid YAML{line}: {what}", path=path, fix=fix) from cause
    if len(documents) > 1:  # `rostopic echo` ends one document with the start of an empty one: that is fine
        raise error(f"holds {len(documents)} documents, parted by ---", path=path, fix="Leave one of them")
    return documents[0] if documents else None


def read_yaml(path: str | Path, *, error: type[GraspTransferError]) -> dict:
    """Mapping of a YAML or JSON file.

    Raises:
        error: unreadable, neither YAML nor JSON (with the line), or not a mapping.
    """
    data = read_data(path, error=error)
    if isinstance(data, list):
        raise error("holds a list where a mapping is wanted", path=path, value=data, fix="Give one entry")
    if not isinstance(data, dict):
        raise error("must hold a mapping of keys to values", path=path, value=data)
    return data

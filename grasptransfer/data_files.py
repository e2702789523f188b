"""Text, YAML, JSON and number files, read without surprises, with their mistakes named."""

import json
import re
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml
from jaxtyping import Float

from grasptransfer.errors import GraspTransferError

MOST_LINES, MOST_CHARACTERS = 40_000, 8_000_000  # of a YAML file; reading takes a second for 10,000 lines
MOST_ENTRIES = 1_000_000


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
    if text.count("\n") > MOST_LINES or len(text) > MOST_CHARACTERS:
        raise error(f"is longer than {MOST_LINES:,} lines, which YAML takes too long to read", path=path)
    if text.lstrip().startswith("<"):
        raise error("is XML, which is not read", path=path, fix="Save it as YAML or JSON")
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
    try:
        if _entries(documents, {}) > MOST_ENTRIES:
            raise error(
                f"holds more than {MOST_ENTRIES:,} entries once its aliases are written out", path=path
            )
    except RecursionError as cause:
        raise error("is not valid YAML: an alias stands inside what it means", path=path) from cause
    if len(documents) > 1:  # `rostopic echo` ends one document with the start of an empty one: that is fine
        raise error(f"holds {len(documents)} documents, parted by ---", path=path, fix="Leave one of them")
    return documents[0] if documents else None


def _entries(value: Any, known: dict[int, int]) -> int:
    """How many entries a value has once every alias in it is written out.

    Args:
        known: the same of values met before, by their identity; -1 of those that are being counted.

    Raises:
        RecursionError: a value holds itself.
    """
    if not isinstance(value, dict | list):
        return 1
    if known.get(id(value)) == -1:
        raise RecursionError
    if id(value) not in known:
        known[id(value)] = -1
        inner = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_entries(one, known) for one in inner)
    return known[id(value)]


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

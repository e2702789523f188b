"""A grasp file changed in place: comments, order and style of what a person wrote stay."""

import io
from collections.abc import Mapping
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

LINE = 110  # characters, as in the files that this package writes


def changed_text(
    text: str, *, block: Mapping[str, Any], grasps: Mapping[str, Mapping | None], renamed: Mapping[str, str]
) -> str:
    """The text of a grasp file with other grasps in it.

    Args:
        text: text of the file as it is, a valid grasp file.
        block: wanted content of its `grasptransfer` block.
        grasps: wanted entries by name; None leaves an entry as it is. Only values that differ change.
        renamed: for each grasp whose name has changed, its former name, by its present name.
    """
    yaml = YAML(typ="rt")
    yaml.preserve_quotes, yaml.width = True, LINE
    yaml.indent(mapping=2, sequence=4, offset=2)
    data = yaml.load(text)
    _update(data["grasptransfer"], block)
    entries = data["grasps"]
    for name, former in renamed.items():
        _rename(entries, former, name)
    for name in [name for name in entries if str(name) not in grasps]:
        del entries[name]
    for name, wanted in grasps.items():
        if wanted is None:
            continue
        if name in entries:
            _update(entries[name], wanted)
        else:
            entries[name] = _styled(wanted)
    written = io.StringIO()
    yaml.dump(data, written)
    return written.getvalue()


def _update(mapping: CommentedMap, wanted: Mapping[str, Any]) -> None:
    """Give a mapping these keys and values, touching only what differs."""
    for key in [key for key in mapping if key not in wanted]:
        del mapping[key]
    for key, value in wanted.items():
        if key not in mapping:
            mapping[key] = _styled(value)
        elif isinstance(value, Mapping) and isinstance(mapping[key], CommentedMap):
            _update(mapping[key], value)
        elif not _same(mapping[key], value):
            mapping[key] = _styled(value)


def _same(old: Any, new: Any) -> bool:
    if isinstance(old, list) and isinstance(new, list | tuple):
        return len(old) == len(new) and all(_same(a, b) for a, b in zip(old, new, strict=True))
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (old, new))
    return abs(old - new) < 1e-9 if numbers else old == new


def _rename(entries: CommentedMap, former: str, name: str) -> None:
    """Change a key; its value, its place and its comments stay."""
    place, value = list(entries).index(former), entries.pop(former)
    entries.insert(place, name, value)
    if former in entries.ca.items:
        entries.ca.items[name] = entries.ca.items.pop(former)


def _styled(value: Any) -> Any:
    """Plain data as it is written by hand: short lists and mappings on one line."""
    if isinstance(value, Mapping):
        mapping = CommentedMap({key: _styled(inner) for key, inner in value.items()})
        if not any(isinstance(inner, Mapping) for inner in value.values()) and len(value) <= 4:
            mapping.fa.set_flow_style()
        return mapping
    if isinstance(value, list | tuple):
        sequence = CommentedSeq(_styled(inner) for inner in value)
        sequence.fa.set_flow_style()
        return sequence
    return round(value, 9) if isinstance(value, float) else value

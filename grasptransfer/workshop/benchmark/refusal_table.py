"""Rates of `bench refusal`: of every kind of input how many were noticed, named, and given a usable grasp."""

from collections.abc import Iterable, Sequence

from grasptransfer.perception.estimate import EstimateStatus

OK = EstimateStatus.OK.value
WITHOUT_OBJECT = ("blank picture", "noise", "empty scene")
FOREIGN = ("object of another category", "object of no category", "photograph of something else")
COLOURS = "BGR for RGB"  # the networks do not depend on it: right answers are right


def is_right(row: dict) -> bool:
    """Whether nothing is wrong with the input."""
    return row["verdict"] == OK and row["input"] != COLOURS


def rates(rows: Sequence[dict]) -> list[dict]:
    """A line for each kind of input of pictures, then of photographs; right ones first.

    `noticed` of a right input is a false alarm.
    """
    kinds = dict.fromkeys((row["shown"], not is_right(row), row["input"]) for row in rows)
    lines = []
    for shown, wrong, name in sorted(kinds, key=lambda kind: (kind[0] != "picture", kind[1])):
        own = [row for row in rows if (row["shown"], row["input"]) == (shown, name)]
        lines.append(
            {
                "shown": shown,
                "input": name,
                "right": not wrong,
                "tried": len(own),
                "noticed": sum(row["noticed"] for row in own),
                "named": sum(row["named"] for row in own),
                "usable": sum(row["usable"] > 0 for row in own),
            }
        )
    return lines


def summarise(rows: Sequence[dict]) -> dict:
    """Shares of the inputs of each family; refused of right ones: noticed, or left without a usable grasp."""
    summary: dict[str, float | int] = {}
    for shown in dict.fromkeys(row["shown"] for row in rows):
        own = [row for row in rows if row["shown"] == shown]
        families = {
            "right": [row for row in own if is_right(row)],
            "without_object": [row for row in own if row["input"] in WITHOUT_OBJECT],
            "foreign": [row for row in own if row["input"] in FOREIGN],
            "turned": [row for row in own if row["input"].startswith("turned ")],
        }
        for family, members in families.items():
            if members:
                name = f"{shown}_{family}"
                summary[name] = len(members)
                summary[f"{name}_noticed"] = _share(row["noticed"] for row in members)
                summary[f"{name}_usable"] = _share(row["usable"] > 0 for row in members)
    right = [row for row in rows if is_right(row)]
    for category in dict.fromkeys(row["category"] for row in rows):
        own = [row["noticed"] for row in right if row["category"] == category]
        summary[f"right_noticed_{category}"] = _share(own)
    return summary


def _share(flags: Iterable[bool]) -> float:
    flags = list(flags)
    return sum(flags) / max(len(flags), 1)

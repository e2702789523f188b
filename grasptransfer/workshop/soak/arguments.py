"""Arguments of transfers and settings of commands, drawn at random by Hypothesis.

Each ends in an answer of finite numbers, or in an error that names the argument.
"""

import dataclasses
import functools
import traceback
import typing
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from rich.table import Table

from grasptransfer.category import Category, load_category
from grasptransfer.errors import GraspTransferError, SettingsError
from grasptransfer.grasping import Scene
from grasptransfer.result import TransferResult
from grasptransfer.transfer import transfer_grasps
from grasptransfer.workshop.soak import argument_values as values

QUICK = ("rigid", "rigid", "similarity")  # estimators; what is tried is how arguments are checked


@dataclass(frozen=True)
class ArgumentSettings:
    """What is tried.

    Args:
        examples: calls of `transfer_grasps`, and values of the settings of each command.
        seed: of everything random.
    """

    examples: int = 20_000
    seed: int = 0

    def __post_init__(self):
        if self.examples < 1:
            raise SettingsError("must be at least 1", key="examples", value=self.examples)


@dataclass(frozen=True)
class ArgumentRow:
    """What became of one subject.

    Args:
        subject: a function or settings class.
        answered, refused: how many calls ended so.
        failed: 1 where a call ended otherwise; Hypothesis then stops with the smallest one.
        detail: of the failure.
    """

    subject: str
    answered: int
    refused: int
    failed: int
    detail: str = ""


def try_transfers(chosen: ArgumentSettings) -> ArgumentRow:
    """Call `transfer_grasps` with arguments of all kinds."""
    category = load_category("mug")
    return _tried("transfer_grasps", transfers(), functools.partial(_transfer, category), chosen)


def try_settings(kind: type, chosen: ArgumentSettings) -> ArgumentRow:
    """Make a settings dataclass of values of all kinds."""
    return _tried(kind.__name__, settings_values(kind), functools.partial(_made, kind), chosen)


def arguments_table(rows: Sequence[ArgumentRow]) -> Table:
    """A row for each subject."""
    table = Table("arguments of", "tried", "refused by name", "answered", "failed")
    for row in rows:
        counts = (row.answered + row.refused + row.failed, row.refused, row.answered, row.failed)
        table.add_row(row.subject, *(str(count) for count in counts))
    return table


def settings_of(places: Sequence[str]) -> list[type]:
    """The settings dataclasses of commands, each given as `module:function`."""
    found: dict[type, None] = {}
    for place in places:
        module, name = place.split(":")
        for kind in typing.get_type_hints(getattr(import_module(module), name)).values():
            if isinstance(kind, type) and dataclasses.is_dataclass(kind):
                found[kind] = None
    return list(found)


def settings_values(kind: type) -> st.SearchStrategy[dict[str, Any]]:
    """Values of the fields of a settings dataclass, those with a default now and then."""
    hints = typing.get_type_hints(kind, include_extras=True)
    fields = [field for field in dataclasses.fields(kind) if field.init]
    drawn = {field.name: values.values_of(hints[field.name]) for field in fields}
    required = {
        field.name
        for field in fields
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    }
    optional = {name: one for name, one in drawn.items() if name not in required and not one.is_empty}
    return st.fixed_dictionaries({name: drawn[name] for name in required}, optional=optional)


@st.composite
def transfers(draw: Callable) -> dict[str, Any]:
    """Arguments of `transfer_grasps`, of several pictures now and then; up to three may be anything."""
    count = draw(st.sampled_from([0, 0, 0, 0, 2]))
    of_each = dict(values.OF_PICTURE)
    anything = draw(st.sets(st.sampled_from([*of_each, *values.OF_ALL]), max_size=3))
    for name, one in of_each.items():
        drawn = one if name in anything else st.just(values.RIGHT[name])
        of_each[name] = [draw(drawn) for _ in range(count)] if count else draw(drawn)
    others = {name: draw(one) for name, one in values.OF_ALL.items() if name in anything}
    return of_each | others | {"estimator": draw(st.sampled_from(QUICK)), "strict": draw(st.booleans())}


def _made(kind: type, given: dict[str, Any]) -> None:
    kind(**given)


def _transfer(category: Category, call: dict[str, Any]) -> None:
    call, scene = dict(call), call.get("scene")
    if isinstance(scene, tuple) and len(scene) == 3:
        call["scene"] = Scene(scene[0], scene[1], stands=scene[2])
    _check_finite(transfer_grasps(call.pop("image"), call.pop("pose"), category, **call))


def _check_finite(result: TransferResult) -> None:
    assert np.isfinite(result.mesh.vertices).all(), "vertices"
    assert np.isfinite(result.camera_from_object).all(), "pose"
    for grasp in result.grasps:
        assert 0 <= grasp.score <= 1, grasp.score
        assert np.isfinite(grasp.camera_from_gripper).all(), grasp.name
        assert np.isfinite(grasp.width), grasp.name
        assert grasp.reason, grasp.name


def _tried(
    name: str, drawn: st.SearchStrategy, call: Callable[[Any], object], chosen: ArgumentSettings
) -> ArgumentRow:
    outcomes: Counter[str] = Counter()

    @seed(chosen.seed)
    @settings(
        max_examples=chosen.examples,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),  # pyright: ignore[reportArgumentType]  an enum of its own kind
        phases=[Phase.generate, Phase.shrink],
    )
    @given(drawn)
    def every(given: Any) -> None:
        try:
            call(given)
        except GraspTransferError:
            outcomes["refused"] += 1
        else:
            outcomes["answered"] += 1

    try:
        every()
    except Exception as error:  # Any foreign exception is the fault that this run is to find.
        return ArgumentRow(name, outcomes["answered"], outcomes["refused"], 1, _described(error))
    return ArgumentRow(name, outcomes["answered"], outcomes["refused"], 0)


def _described(error: Exception) -> str:
    errors = list(_leaves(error))
    texts = []
    for one in errors:
        inside = [
            frame for frame in traceback.extract_tb(one.__traceback__) if "hypothesis" not in frame.filename
        ]
        where = f"{inside[-1].filename}:{inside[-1].lineno}" if inside else "?"
        notes = " ".join(getattr(one, "__notes__", []))
        texts.append(f"{type(one).__name__}: {one} ({where}) {notes}"[:1500])
    return "\n".join(texts)


def _leaves(error: BaseException) -> Iterator[BaseException]:
    """The errors of a group, or the error itself."""
    inner = getattr(error, "exceptions", None)
    if inner is None:
        yield error
    else:
        for one in inner:
            yield from _leaves(one)

"""Options that the settings of several benchmarks share, each explained once."""

import math
from pathlib import Path
from typing import Annotated

from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from grasptransfer.perception.estimators import ESTIMATORS
from grasptransfer.perception.weights import trained_categories

Categories = Annotated[tuple[str, ...], arg(help="names; none given: all that have weights.")]
Meshes = Annotated[
    Path | None, arg(help="folder of <category>/<name>/mesh.*; none: the shipped test instances.")
]
Views = Annotated[int, arg(help="of the 74 viewpoints, spread evenly.")]
ViewsOfEach = Annotated[int, arg(help="of each object, spread over the 74 viewpoints.")]
Methods = Annotated[
    tuple[str, ...], arg(name="estimators", help=f"which of gt (the truth), {', '.join(ESTIMATORS)}.")
]
Weights = Annotated[Path | None, arg(help="file for rgb instead of the shipped ones.")]
Repeats = Annotated[int, arg(help="of each measurement; their median counts.")]
Translation = Annotated[
    float, arg(name="translation", help="half-width of the given pose's uniform error on each axis [m].")
]
# Radians in the settings, degrees in the command.
Told = Annotated[str, arg(help="poses that are given: exact, estimator or wide; photos: also a set on file.")]
Said = Annotated[
    tuple[str, ...],
    arg(help="how sure they are said to be: unsaid, 0, or metres and degrees; default: exact ones are."),
]
Rotation = Annotated[
    float,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="DEGREES",
        instance_from_str=lambda values: math.radians(float(values[0])),
        is_instance=lambda value: isinstance(value, float),
        str_from_instance=lambda value: [f"{math.degrees(value):g}"],
    ),
    arg(name="rotation", help="largest turn of the given pose about a random axis [degrees]."),
]


def name_trained(settings: object) -> None:
    """Put all categories that have weights where a benchmark's settings name none."""
    object.__setattr__(settings, "categories", vars(settings)["categories"] or trained_categories())

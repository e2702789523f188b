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
Views = Annotated[int, arg(help="number of viewpoints, spread evenly over the 74.")]
ViewsOfEach = Annotated[int, arg(help="number of views of each object, spread over the 74 viewpoints.")]
Together = Annotated[
    int, arg(help="pictures of one object that are seen together, 45 degrees apart, in each view.")
]
Methods = Annotated[
    tuple[str, ...], arg(name="estimators", help=f"which of gt (the truth), {', '.join(ESTIMATORS)}.")
]
Weights = Annotated[Path | None, arg(help="weight file for rgb; none: the shipped one.")]
Repeats = Annotated[int, arg(help="how often each measurement is repeated; the median counts.")]
Translation = Annotated[
    float, arg(name="translation", help="half-width of the given pose's uniform error on each axis [m].")
]
Told = Annotated[str, arg(help="given poses: exact, estimator or wide; for photos also a set on file.")]
Said = Annotated[
    tuple[str, ...],
    arg(help="stated uncertainty of these poses: unsaid, 0, or metres and degrees; default: 0 for exact."),
]
# The settings hold radians; the command takes degrees.
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
    """Fill in all categories that have weights if a benchmark's settings name none."""
    object.__setattr__(settings, "categories", vars(settings)["categories"] or trained_categories())

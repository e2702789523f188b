"""Options that several benchmarks share, each explained once; a command's docstring explains its own."""

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from grasptransfer.perception.estimators import ESTIMATORS

Json = Annotated[Path, arg(help="file for the results.")]
ResumedJson = Annotated[Path, arg(help="file for the results; a killed run goes on from the file beside it.")]
Categories = Annotated[tuple[str, ...], arg(help="names; none given: all that have weights.")]
Meshes = Annotated[
    Path | None, arg(help="folder of <category>/<name>/mesh.*; none: the shipped test instances.")
]
Views = Annotated[int, arg(help="of the 74 viewpoints, spread evenly.")]
ViewsOfEach = Annotated[int, arg(help="of each object.")]
Estimators = Annotated[
    tuple[str, ...],
    arg(help=f"gt (the truth), {', '.join(ESTIMATORS)}; none given: all but rgbd, and gt with true poses."),
]
Weights = Annotated[Path | None, arg(help="file for rgb instead of the shipped ones.")]
Repeats = Annotated[int, arg(help="of each measurement; their median counts.")]
Workers = Annotated[int, arg(help="processes.")]
Gripper = Annotated[str, arg(help="name.")]
Translation = Annotated[float, arg(help="half-width of the told pose's uniform error on each axis [m].")]
Rotation = Annotated[float, arg(help="largest turn of the told pose about a random axis [degrees].")]


def trained(categories: tuple[str, ...]) -> tuple[str, ...]:
    """The named categories; none named: all that have weights."""
    from grasptransfer.perception.weights import trained_categories

    return categories or trained_categories()

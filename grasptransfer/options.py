"""Options that the settings of several commands share, each explained once.

The settings of a command are a frozen dataclass: it is the argument of the Python function that does the
work, tyro makes the command's flags of its fields, and its `__post_init__` refuses wrong values.
"""

from typing import Annotated

from tyro.conf import Positional, arg

from grasptransfer.errors import SettingsError, check_seed
from grasptransfer.perception.estimators import ESTIMATORS

EstimatorName = Annotated[
    str, arg(help="; ".join(f"{name}: {spec.sentence}" for name, spec in ESTIMATORS.items()) + ".")
]
CategoryName = Annotated[str, arg(help="name or folder of the category.")]
CategoryArgument = Positional[Annotated[CategoryName, arg(metavar="CATEGORY")]]
GripperName = Annotated[str, arg(help="name, or YAML of your own.")]
Device = Annotated[str, arg(help="auto, cpu (PyTorch), openvino or cuda, of networks.")]
Precision = Annotated[str, arg(help="auto (float32), float32 or bfloat16, of networks.")]
RefinePose = Annotated[
    bool, arg(help="fit the pose together with the shape; without, the pose is taken as exact.")
]
Protocol = Annotated[str, arg(help="named and versioned execution protocol.")]
Seed = Annotated[int, arg(help="of everything random.")]
Workers = Annotated[int, arg(help="processes.")]


def check_counts(settings: object, *names: str, least: int = 1) -> None:
    """Refuse counts that are too small, and a seed that no random generator takes.

    Args:
        settings: the settings whose fields are checked, and their `seed`, where they have one.
        names: names of the fields.

    Raises:
        SettingsError: a count below 1, with name and value of the field.
    """
    for name in names:
        value = getattr(settings, name)
        if value < least:
            raise SettingsError(f"must be at least {least}", key=name, value=value)
    if "seed" in vars(settings):
        check_seed(vars(settings)["seed"])

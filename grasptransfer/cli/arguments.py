"""Options that commands of several groups share, each explained once."""

from typing import Annotated

from tyro.conf import arg

from grasptransfer.perception.estimators import ESTIMATORS

EstimatorName = Annotated[
    str, arg(help="; ".join(f"{name}: {spec.sentence}" for name, spec in ESTIMATORS.items()) + ".")
]

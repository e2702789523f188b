"""`grasptransfer bench …`: each benchmark prints its summary and writes the JSON of `document.py`."""

from collections.abc import Callable
from typing import Any

from grasptransfer.cli.bench.clouds import cpd, latent_fit
from grasptransfer.cli.bench.grasps import calibration, engines, grasp
from grasptransfer.cli.bench.pictures import (
    glass,
    latency,
    photos,
    pose_noise,
    refusal,
    registration,
)

COMMANDS: dict[str, Callable[..., Any]] = {
    "cpd": cpd,
    "latent-fit": latent_fit,
    "registration": registration,
    "pose-noise": pose_noise,
    "glass": glass,
    "latency": latency,
    "grasp": grasp,
    "engines": engines,
    "photos": photos,
    "refusal": refusal,
    "calibration": calibration,
}

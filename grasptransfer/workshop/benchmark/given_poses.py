"""Which poses a benchmark gives its methods, and which uncertainty it states with them.

| `--told` | given pose | stated uncertainty |
| --- | --- | --- |
| exact | the true one | zero |
| estimator | with errors as real estimators make them (`perception/pose_prior.py`) | nothing |
| wide | wrong by up to 5 cm on each axis and 10 degrees | 3 cm, 5 degrees: their standard deviations |

`--pose-sigma` states another uncertainty with the same poses: `unsaid`, or numbers as `transfer` takes them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import SettingsError
from grasptransfer.poses import PoseSigma, covariance_of
from grasptransfer.workshop.training.scenes import WIDE_NOISE, as_estimated

EXACT, ESTIMATOR, WIDE = "exact", "estimator", "wide"
REGIMES = (EXACT, ESTIMATOR, WIDE)
UNSAID = "unsaid"
STATED: dict[str, PoseSigma] = {EXACT: 0, WIDE: (0.03, 5.0)}  # m, degrees


@dataclass(frozen=True)
class GivenPoses:
    """Draws given poses around true ones.

    Args:
        told: one of `REGIMES`, or the name of a set of poses on file.
        pose_sigma: stated uncertainty of the poses, as for `transfer_grasps`.
    """

    told: str = ESTIMATOR
    pose_sigma: PoseSigma | None = None

    @classmethod
    def of(cls, told: str, said: tuple[str, ...] = (), *, names: tuple[str, ...] = ()) -> "GivenPoses":
        """Given poses from the options of the command line.

        Args:
            told: one of `REGIMES` or of `names`.
            said: stated uncertainty: `UNSAID`, one number or two; if empty, what the regime states.
            names: names of the sets of poses on file.

        Raises:
            SettingsError: an unknown regime.
            PoseError: `said` is no uncertainty.
        """
        if told not in (*REGIMES, *names):
            raise SettingsError("unknown poses", key="told", value=told, choices=(*REGIMES, *names))
        if not said:
            return cls(told, STATED.get(told))
        if said == (UNSAID,):
            return cls(told, None)
        try:
            numbers = tuple(float(one) for one in said)
        except ValueError as error:
            choices = (UNSAID, "0", "metres degrees")
            raise SettingsError("is no uncertainty", key="pose_sigma", value=said, choices=choices) from error
        sigma = numbers[0] if len(numbers) == 1 else numbers
        covariance_of(sigma)
        return cls(told, sigma)  # pyright: ignore[reportArgumentType]

    def apply(
        self, camera_from_object: Float[np.ndarray, "4 4"], rng: np.random.Generator
    ) -> Float[np.ndarray, "4 4"]:
        """The pose that is given in place of the true one."""
        if self.told == ESTIMATOR:
            return as_estimated(camera_from_object, rng)
        return WIDE_NOISE.apply(camera_from_object, rng) if self.told == WIDE else camera_from_object


ESTIMATED = GivenPoses()

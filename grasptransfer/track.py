"""One object followed from picture to picture: what each picture leaves known is the prior of the next.

Carried on are latent and pose with their joint covariance. With `views="moved camera"` the object stands
still
and the differences of the given poses say how the camera moved: the refined pose moves with it, and its
covariance grows by `pose_noise` for each picture. With `views="separate"` each pose errs by itself, and the
latent alone is carried on. The shape does not change, so that nothing is added to the latent's covariance.

Pictures from nearby err together. So a picture counts for the latent by what it adds to the directions from
which the object was seen before (`perception/several_pictures.py`): a camera that stands still does not make
the shape surer with every frame.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import SettingsError
from grasptransfer.perception.several_pictures import MOVED_CAMERA, check_views
from grasptransfer.poses import covariance_of

if TYPE_CHECKING:
    from grasptransfer.perception.earlier_pictures import ObjectPosterior
    from grasptransfer.result import TransferResult

# From each picture to the next [m, degrees]: an arm and its hand-eye calibration are known about as well.
POSE_NOISE = (0.001, 0.2)


class Track:
    """Made by `GraspTransfer.track`; one object, whose pictures come in the order in which they were taken.

    Args:
        answer: `GraspTransfer.answer`.
        views: how the poses go together, one of `several_pictures.VIEWS`.
        pose_noise: as of `GraspTransfer.track`.

    Raises:
        SettingsError: unknown `views`.
        PoseError: `pose_noise` is no uncertainty.
    """

    def __init__(self, answer: "Callable[..., TransferResult]", *, views: str, pose_noise):
        self.views = check_views(views)
        covariance = covariance_of(pose_noise, key="pose_noise")
        self._noise: Float[np.ndarray, "6 6"] = np.zeros((6, 6)) if covariance is None else covariance
        self._answer = answer
        self.posterior: ObjectPosterior | None = None

    def transfer(
        self,
        image,
        pose,
        *,
        camera=None,
        box=None,
        mask=None,
        depth=None,
        **how,
    ) -> "TransferResult":
        """Transfer the grasps to the object in the next picture, or in several that were taken together.

        Args:
            image, pose, camera, box, mask, depth: as of `transfer_grasps`.
            how: `pose_sigma`, `scene`, `world_from_camera` and `strict`, as of `transfer_grasps`.

        Raises:
            GraspTransferError: wrong input, by argument, value and choices; the track stays as it was.
        """
        from grasptransfer.perception.picture_lists import observe_all

        seen = {"camera": camera, "box": box, "mask": mask, "depth": depth}
        observation = observe_all(
            image, pose, views=self.views, pose_sigma=how.pop("pose_sigma", None), **seen
        )
        if self.posterior is not None:
            carried = self.posterior.carried(
                observation.camera_from_object, self._noise, pose_known=self.views == MOVED_CAMERA
            )
            observation = replace(observation, earlier=carried)
        result = self._answer(observation, **how)
        if result.estimate.posterior is None:
            raise SettingsError("this estimator leaves nothing known for the next picture", key="track")
        self.posterior = result.estimate.posterior
        return result

"""Signs of a wrong input: numbers in which right pictures, poses, boxes and categories differ from others.

| sign | measures |
| --- | --- |
| match | logit that the object is of the category |
| cover | intersection over union of the predicted mask and of the model as assumed |
| flow | how far the model's points have to move in the picture: logarithm of the mean [px] |
| flow_scale, offset_scale | how large the network states the errors of its flow and offsets: mean logarithm |
| latent_scale | the same of the latent |
| flow_spread, mask_spread | how far the members of the ensemble differ: logarithms |
| overlap | intersection over union of the predicted mask and of the reconstruction |
| far | distance of the shape from its category's mean: logarithm of the standard deviations |
| size | how much larger or smaller than the model the shape is: absolute logarithm of the mean extent |
| drift | how far the fit moved the pose: logarithm, in deviations of its prior; 1 where it was kept |
| offset_misfit, flow_misfit | what the fit leaves of predicted offsets and flow: logarithm, in their scales |
| latent_deviation | how unsure the fitted latent is: mean logarithm of its variances |

Those of `OF_PASS` are taken in the first pass of the network, which compares the picture with the canonical
model at the given pose, and in the last one, which compares it with what was fitted.
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from grasptransfer.drawing.boxes import Box
from grasptransfer.frames import drift, transform_points
from grasptransfer.perception.pose_prior import PosePrior
from grasptransfer.perception.zoom import MASK_STRIDE

if TYPE_CHECKING:
    from grasptransfer.perception.canonical_view import CanonicalView
    from grasptransfer.perception.picture_evidence import LatentPrior, Motion, PictureEvidence
    from grasptransfer.perception.pose_and_shape import PoseAndShape

OF_PASS = (
    "match",
    "cover",
    "flow",
    "flow_scale",
    "offset_scale",
    "latent_scale",
    "flow_spread",
    "mask_spread",
)
OF_FIT = ("overlap", "far", "size", "drift", "offset_misfit", "flow_misfit", "latent_deviation")
SIGNS = (*(f"first_{name}" for name in OF_PASS), *(f"last_{name}" for name in OF_PASS), *OF_FIT)
ROWS = 64  # of a part of a picture are enough to tell noise
LEAST = 0.05  # added below logarithms: smaller numbers all say the same

PassSigns = Float[np.ndarray, "8"]
Signs = Float[np.ndarray, "23"]


def signs_of_pass(
    view: "CanonicalView",
    motion: "Motion",
    prior: "LatentPrior",
    *,
    match_logit: float,
    mask: Float[np.ndarray, "hm wm"],
    flow_spread: Float[np.ndarray, "c"],
    mask_spread: Float[np.ndarray, "hm wm"],
) -> PassSigns:
    """What one pass of the network shows, in the order of `OF_PASS`.

    Args:
        view: the model as assumed.
        motion: predicted motion of its visible cells.
        prior: what the network says of the latent.
        match_logit: logit that the object is of the category.
        mask: predicted probability of the object, whatever mask was given.
        flow_spread: standard deviation among the ensemble's members of the flow of each visible cell [px].
        mask_spread: standard deviation of the mask's probability among them.
    """
    shown = np.any(view.coordinates, axis=-1)[
        MASK_STRIDE // 2 :: MASK_STRIDE, MASK_STRIDE // 2 :: MASK_STRIDE
    ]
    seen = mask > 0.5
    flow = np.linalg.norm(motion.pixels - view.cell_pixels, axis=1)
    return np.array(
        [
            np.clip(match_logit, -10, 10),
            overlap_of(shown, seen),
            _log(float(flow.mean())),
            np.log(motion.pixel_scale).mean(),
            np.log(motion.offset_scale).mean(),
            np.log(prior.deviation).mean(),
            _log(float(flow_spread.mean())),
            _log(float(mask_spread.sum()) / max(int(seen.sum()), 1)),
        ]
    )


def signs_of_fit(
    said: "PictureEvidence",
    pose: Float[np.ndarray, "4 4"],
    fit: "PoseAndShape",
    *,
    overlap: float,
    sides: Float[np.ndarray, "3"],
    drifted: float,
) -> Float[np.ndarray, "7"]:
    """What the last fit shows in one picture, in the order of `OF_FIT`.

    Args:
        said: what the last pass said of the picture.
        pose: fitted `camera_from_object` in this picture.
        fit: the fit, with its latent.
        overlap: intersection over union of the predicted mask and the reconstruction.
        sides: sides of the reconstruction's bounding box over those of the canonical model's.
        drifted: what `drift_of` gives.
    """
    motion = said.motion
    offset_misfit = np.linalg.norm(said.model.at(fit.latent) - motion.offsets, axis=1) / motion.offset_scale
    placed = transform_points(pose, said.model.displaced(said.points, fit.latent))
    flow_misfit = np.linalg.norm(said.camera.project(placed) - motion.pixels, axis=1) / motion.pixel_scale
    return np.array(
        [
            overlap,
            _log(float(np.sqrt(np.mean(fit.latent**2)))),
            np.abs(np.log(np.maximum(sides, 1e-3)).mean()),
            _log(drifted),
            _log(float(offset_misfit.mean())),
            _log(float(flow_misfit.mean())),
            np.log(np.diag(fit.covariance)[6:]).mean(),
        ]
    )


def drift_of(
    start: Float[np.ndarray, "4 4"], pose: Float[np.ndarray, "4 4"], prior: PosePrior | None
) -> float:
    """How far the fit moved a pose, in standard deviations of its prior; 1 where it was kept."""
    if prior is None:
        return 1.0
    moved = drift(start, pose)
    return float(np.sqrt(moved @ np.linalg.solve(prior.covariance, moved)))


def structure_of(image: UInt8[np.ndarray, "h w 3"], crop: Box) -> float:
    """How alike neighbouring pixels in a part of a picture are: 0 in noise and in one colour, else near 1.

    Correlation of the green of neighbours in some rows of the picture's own resolution. What varies by less
    than a step of 255 does not vary.
    """
    u0, v0, u1, v1 = (max(int(side), 0) for side in crop)
    part = image[v0 : v1 + 1 : max((v1 - v0) // ROWS, 1), u0 : u1 + 1, 1].astype(np.float32)
    if part.size == 0 or part.shape[1] < 2:
        return 0.0
    part -= part.mean()
    return float((part[:, 1:] * part[:, :-1]).mean() / (np.square(part).mean() + 1))


def overlap_of(first: np.ndarray, second: np.ndarray) -> float:
    """Intersection over union of two masks; 0 of two empty ones."""
    return float((first & second).sum() / max((first | second).sum(), 1))


def _log(value: float) -> float:
    return float(np.log(value + LEAST))

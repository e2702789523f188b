"""Why an input seems wrong: which other reading of its pose or box would explain the picture far better.

It is asked only where the verdict calls for it: every reading costs a pass of the network, the best a fit.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from scipy.special import expit

from grasptransfer.drawing.boxes import Box, overlap
from grasptransfer.errors import PoseError
from grasptransfer.frames import OPENGL_FROM_OPENCV, invert
from grasptransfer.perception.confidence import Confidence
from grasptransfer.perception.estimate import EstimateStatus, ShapeEstimate
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.signs import Signs
from grasptransfer.poses import check_in_view

CLEARLY = 2.0  # by so much another reading must be preferred: odds of 7 to 1, as a dozen are tried
LIKELY = 0.5  # and the chance of a right input that it must have itself
ASKED = 0.75  # chance of a right input below which other readings are tried although it is accepted
UPSIDE_DOWN = (
    -0.4
)  # cosine between up in the object and up as a robot's camera sees it: such poses are asked, too
FINALISTS = 2  # so many readings, the best by one pass of the network, are fitted
TURNS = ((2, 90), (2, 180), (2, -90), (0, 180), (0, 90), (0, -90), (1, 90), (1, -90), (1, 180))
FITS, MISSES, APART = 0.5, 0.3, 0.02  # overlap of a box and the model: as it should be, hardly, not at all
OTHER_SIZE = 0.4  # overlap of a box with what was found: of a box of half or twice its sides it is 0.25


@runtime_checkable
class Assessor(Protocol):
    """What judges readings: the estimator."""

    confidence: Confidence

    def assess(self, observation: Observation) -> tuple[ShapeEstimate, Signs]:
        """The estimate, and the signs that its status rests on."""
        ...

    def preference(self, observation: Observation) -> float:
        """How well the observation's pose explains its picture, by one pass of the network."""
        ...


@dataclass(frozen=True)
class Reading:
    """Another reading of an input.

    Args:
        status: status of an estimate whose input should have been read so.
        sentence: a sentence that says so to the user.
        observation: the input as read so.
    """

    status: EstimateStatus
    sentence: str
    observation: Observation


def reconsider(
    estimate: ShapeEstimate,
    signs: Signs,
    observation: Observation,
    *,
    assessor: Assessor,
    boxes: tuple[Box, Box],
) -> ShapeEstimate:
    """The estimate, with the likely cause of a wrong input and the status that the cause calls for.

    Args:
        estimate: the estimate, with status and score by `signs`.
        boxes: boxes of the canonical model at the given pose, and of the reconstruction [px].
    """
    score = estimate.category_score
    assert score is not None
    settled = not estimate.status.refused
    warning, contradicts = _box_warning(observation, *boxes)
    by_box = replace(estimate, warning=warning)
    if contradicts or (warning and not settled):
        by_box = replace(by_box, status=EstimateStatus.BOX_MISPLACED)
    several = bool(observation.further) or observation.earlier is not None
    if several or (settled and score >= ASKED and not _upside_down(observation.camera_from_object)):
        return by_box
    confidence = assessor.confidence
    readings = _other_readings(
        observation, boxes[0], turned=estimate.status is not EstimateStatus.NOTHING_SEEN
    )
    for reading in _finalists(readings, assessor):
        try:
            other, signs_of_other = assessor.assess(reading.observation)
        except PoseError:
            continue
        better = confidence.preference(signs_of_other) - confidence.preference(signs)
        likely = other.category_score is not None and other.category_score > max(score, LIKELY)
        if better > CLEARLY and likely:
            chance = min(score, float(expit(-better)))
            return replace(estimate, status=reading.status, warning=reading.sentence, category_score=chance)
    return by_box


def _finalists(readings: Iterator[Reading], assessor: Assessor) -> list[Reading]:
    found: list[tuple[float, Reading]] = []
    for reading in readings:
        try:
            found.append((assessor.preference(reading.observation), reading))
        except PoseError:
            continue
    return [reading for _, reading in sorted(found, key=lambda one: -one[0])[:FINALISTS]]


def _upside_down(camera_from_object: Float[np.ndarray, "4 4"]) -> bool:
    """Whether the object stands on its head, for a camera that looks level or down at it."""
    up = camera_from_object[:3, 2]
    return bool((-up[1] - up[2]) / np.sqrt(2) < UPSIDE_DOWN)


def _other_readings(observation: Observation, around: Box, *, turned: bool) -> Iterator[Reading]:
    pose = observation.camera_from_object
    better = "The picture fits far better"
    for axis, degrees in TURNS if turned else ():
        turn = Rotation.from_rotvec(np.deg2rad(degrees) * np.eye(3)[axis]).as_matrix()
        wrong = pose.copy()
        wrong[:3, :3] = pose[:3, :3] @ turn
        sentence = f"{better} with the object turned by {degrees} degrees about its {'xyz'[axis]} axis."
        yield Reading(EstimateStatus.POSE_TURNED, sentence, replace(observation, camera_from_object=wrong))
    conventions = {
        "inverted: is it object_from_camera?": invert(pose),
        "in OpenGL's axes: flip y and z.": OPENGL_FROM_OPENCV @ pose,
        "inverted, in OpenGL's axes.": invert(pose @ OPENGL_FROM_OPENCV),
    }
    for name, wrong in conventions.items():
        if _in_box(wrong, observation):
            sentence = f"{better} if the pose is {name}"
            read = replace(observation, camera_from_object=wrong)
            yield Reading(EstimateStatus.POSE_TURNED, sentence, read)
    if observation.box is not None and observation.mask is None:
        for name, box in _box_readings(observation.box).items():
            if overlap(box, around) > FITS:
                read = replace(observation, box=box)
                yield Reading(EstimateStatus.BOX_MISPLACED, f"{better} if the box is {name}.", read)


def _box_readings(box: Box) -> dict[str, Box]:
    """What the four numbers of a box may mean."""
    a, b, c, d = box
    return {
        "(u, v, width, height)": (a, b, a + c, b + d),
        "(centre u, centre v, width, height)": (a - c / 2, b - d / 2, a + c / 2, b + d / 2),
        "(v0, u0, v1, u1)": (b, a, d, c),
    }


def _box_warning(observation: Observation, around: Box, found: Box) -> tuple[str | None, bool]:
    """How a box contradicts the pose or what was found, or None; and whether one of them must be wrong.

    Args:
        around: the canonical model at the given pose [px].
        found: the reconstruction [px].
    """
    if observation.box is None:
        return None, False
    # Detectors cut boxes at the picture's border.
    box, around, found = (_in_picture(one, observation) for one in (observation.box, around, found))
    met = overlap(box, around)
    if met < MISSES:
        for name, read in _box_readings(observation.box).items():
            if overlap(read, around) > FITS:
                return f"The box would fit the pose if it is {name}.", True
    if met < APART:
        return "The box does not hold the object at the given pose: one of them is wrong.", True
    # The box of a mask goes round what is seen, which may be a small part.
    if observation.mask is None and overlap(box, found) < OTHER_SIZE:
        times = np.sqrt((box[2] - box[0]) * (box[3] - box[1]) / _area(found))
        return f"The sides of the box are {times:.1f} times those of the object that was found.", False
    return None, False


def _in_picture(box: Box, observation: Observation) -> Box:
    right, bottom = observation.camera.width - 1.0, observation.camera.height - 1.0
    u0, u1 = np.clip([box[0], box[2]], 0, right)
    v0, v1 = np.clip([box[1], box[3]], 0, bottom)
    return float(u0), float(v0), float(u1), float(v1)


def _area(box: Box) -> float:
    return max((box[2] - box[0]) * (box[3] - box[1]), 1.0)


def _in_box(pose: Float[np.ndarray, "4 4"], observation: Observation) -> bool:
    """Whether the object is in view at a pose, and its origin in the box, if one was given."""
    try:
        check_in_view(pose, observation.camera)
    except PoseError:
        return False
    if observation.box is None:
        return True
    u, v = observation.camera.project(pose[:3, 3])
    return bool(observation.box[0] < u < observation.box[2] and observation.box[1] < v < observation.box[3])

"""Inputs that are right and inputs that are wrong, each with the verdict it deserves.

From one picture with a known object come right inputs, with the errors of real detectors and pose estimators,
and every wrong use that a picture can tell. The confidence is fitted to them, `bench refusal` counts them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, UInt8
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.drawing.boxes import Box, projected_box
from grasptransfer.drawing.views import towards
from grasptransfer.frames import OPENGL_FROM_OPENCV, invert
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.observation import Observation, observe
from grasptransfer.workshop.training.backgrounds import draw_backdrop
from grasptransfer.workshop.training.scenes import WIDE_NOISE, as_estimated

OK, NOTHING, STRANGER = EstimateStatus.OK, EstimateStatus.NOTHING_SEEN, EstimateStatus.OUT_OF_CATEGORY
TURNED, SIZE = EstimateStatus.POSE_TURNED, EstimateStatus.IMPOSSIBLE_SIZE
BOX = EstimateStatus.BOX_MISPLACED
TURNS = ((2, 90), (2, 180), (2, 270), (0, 90), (0, 180), (1, 90), (1, 270))  # axis of the object, degrees
SYMMETRIC = 0.02  # of the model's size: a turn that moves its surface by less shows the same object
ASIDE = 0.3  # m
EXACT_ALONE = "exact pose, no box"
CAUSES = {  # words of the sentences that name the cause of an input, beside its verdict
    "pose: inverted": ("object_from_camera",),
    "pose: OpenGL's camera": ("OpenGL",),
    "pose: inverted, in OpenGL's": ("in OpenGL", "object_from_camera"),
    "pose: millimetres": ("millimetres",),
    "intrinsics of another resolution": ("of a picture of", "another size"),
    "box as (u, v, width, height)": ("width",),
    "box as (centre, width, height)": ("width",),
}


@dataclass(frozen=True)
class Pictured:
    """A picture of an object, and what is true of it.

    Args:
        pose: (4, 4) true `camera_from_object` [m].
        box: around the whole object [px].
    """

    image: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    pose: Float[np.ndarray, "4 4"]
    box: Box

    @staticmethod
    def of(image, camera: Camera, pose, points_object: Float[np.ndarray, "m 3"]) -> "Pictured":
        """A picture of an object with these surface points, in its own frame [m]."""
        return Pictured(image, camera, pose, projected_box(points_object, camera, pose))


@dataclass(frozen=True)
class Given:
    """One input of an estimator.

    Args:
        name: what is right or wrong with it.
        verdict: status that the estimate should have.
        arguments: of `observe`.
        fitted: whether the confidence may be fitted to it: a picture always tells it, and its verdict is one.
    """

    name: str
    verdict: EstimateStatus
    arguments: dict[str, Any] = field(repr=False)
    fitted: bool = True

    def names(self, sentence: str) -> bool:
        """Whether a sentence names what is wrong."""
        return any(cause in sentence for cause in CAUSES.get(self.name, ()))

    def observation(self) -> Observation:
        """What an estimator gets.

        Raises:
            GraspTransferError: the input is refused at once.
        """
        return observe(**self.arguments)


def right_inputs(seen: Pictured, rng: np.random.Generator) -> Iterator[Given]:
    """As real pose estimators and detectors give them, and exact, and rough."""
    given = _as_given(seen, rng)
    yield Given("box", OK, given)
    yield Given("no box", OK, given | {"box": None})
    yield Given("exact pose", OK, given | {"pose": seen.pose, "pose_sigma": 0})
    yield Given(EXACT_ALONE, OK, given | {"pose": seen.pose, "pose_sigma": 0, "box": None})
    yield Given("rough pose", OK, given | {"pose": WIDE_NOISE.apply(seen.pose, rng)})


def without_object(seen: Pictured, rng: np.random.Generator) -> Iterator[Given]:
    """Pictures that do not show what they are said to show, with and without box."""
    given, shape = _as_given(seen, rng), seen.image.shape
    pictures = {
        "blank picture": np.broadcast_to(rng.integers(0, 256, 3).astype(np.uint8), shape).copy(),
        "noise": _noise(shape, rng),
        "empty scene": draw_backdrop(rng, shape[1], shape[0]),
    }
    for name, image in pictures.items():
        yield Given(name, NOTHING, given | {"image": image})
        yield Given(f"{name}, no box", NOTHING, given | {"image": image, "box": None})
    aside = _shifted(given["pose"], towards(given["pose"][:3, 3]) @ _on_circle(rng) * ASIDE)
    yield Given("pose 30 cm aside, no box", NOTHING, given | {"pose": aside, "box": None})


def foreign_object(seen: Pictured, name: str, rng: np.random.Generator) -> Iterator[Given]:
    """A picture of something else, under the name of what it shows."""
    given = _as_given(seen, rng)
    yield Given(name, STRANGER, given)
    yield Given(f"{name}, no box", STRANGER, given | {"box": None})


def wrong_poses(seen: Pictured, category: Category, rng: np.random.Generator) -> Iterator[Given]:
    """Turned, misplaced, in other conventions; turns that show the same object are left out."""
    given = _as_given(seen, rng)
    pose = given["pose"]
    for axis, degrees in TURNS:
        if not _looks_the_same(category, axis, degrees):
            wrong = {"pose": turned(pose, axis, degrees)}
            yield Given(f"turned {degrees} about {'xyz'[axis]}", TURNED, given | wrong)
    if not _looks_the_same(category, 2, 180):
        wrong = {"pose": turned(pose, 2, int(rng.choice([90, 180, 270]))), "box": None}
        yield Given("turned about z, no box", TURNED, given | wrong)
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    factor = rng.uniform(1.6, 2.5)
    yield Given("too far", SIZE, given | {"pose": _shifted(pose, (factor - 1) * pose[:3, 3])})
    yield Given("too near", SIZE, given | {"pose": _shifted(pose, (1 / factor - 1) * pose[:3, 3])})
    yield Given("30 cm farther", SIZE, given | {"pose": _shifted(pose, ASIDE * ray)}, fitted=False)
    if pose[2, 3] > 2 * ASIDE:
        yield Given("30 cm nearer", SIZE, given | {"pose": _shifted(pose, -ASIDE * ray)}, fitted=False)
    aside = _shifted(pose, towards(pose[:3, 3]) @ _on_circle(rng) * ASIDE)
    yield Given("30 cm aside", BOX, given | {"pose": aside}, fitted=False)
    conventions = {
        "inverted": invert(pose),
        "OpenGL's camera": OPENGL_FROM_OPENCV @ pose,
        "inverted, in OpenGL's": invert(OPENGL_FROM_OPENCV @ pose),
        "millimetres": _shifted(pose, 999 * pose[:3, 3]),
    }
    for name, wrong in conventions.items():
        yield Given(f"pose: {name}", TURNED, given | {"pose": wrong}, fitted=False)


def wrong_cameras_and_boxes(seen: Pictured, rng: np.random.Generator) -> Iterator[Given]:
    """Intrinsics of another lens or resolution, colours in another order, boxes of another kind."""
    given, camera, box = _as_given(seen, rng), seen.camera, np.array(seen.box)
    factor = float(rng.choice([0.5, 2.0]))
    lens = Camera(camera.fx * factor, camera.fy * factor, camera.cx, camera.cy, camera.width, camera.height)
    yield Given("focal length of another lens", SIZE, given | {"camera": lens})
    scaled = camera.matrix * [[factor], [factor], [1]]
    yield Given("intrinsics of another resolution", SIZE, given | {"camera": scaled}, fitted=False)
    yield Given(
        "BGR for RGB", OK, given | {"image": np.ascontiguousarray(seen.image[..., ::-1])}, fitted=False
    )
    middle, half = (box[:2] + box[2:]) / 2, (box[2:] - box[:2]) / 2
    aside = rng.choice([-1, 1], 2) * rng.uniform(2.2, 3.6, 2) * half
    boxes = {
        "box of half the size": (middle - half / 2, middle + half / 2),
        "box of twice the size": (middle - 2 * half, middle + 2 * half),
        "box beside the object": (middle - half + aside, middle + half + aside),
        "box as (u, v, width, height)": (box[:2], 2 * half),
        "box as (centre, width, height)": (middle, 2 * half),
    }
    for name, corners in boxes.items():
        fitted = name in ("box of half the size", "box beside the object")
        yield Given(name, BOX, given | {"box": tuple(np.concatenate(corners))}, fitted=fitted)


def turned(pose: Float[np.ndarray, "4 4"], axis: int, degrees: float) -> Float[np.ndarray, "4 4"]:
    """The pose with the object turned about one of its own axes."""
    wrong = pose.copy()
    wrong[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(np.deg2rad(degrees) * np.eye(3)[axis]).as_matrix()
    return wrong


def _as_given(seen: Pictured, rng: np.random.Generator) -> dict[str, Any]:
    """Arguments of `observe` with a pose as an estimator gives it, and a box as a detector does."""
    u0, v0, u1, v1 = seen.box
    sides = np.array([u1 - u0, v1 - v0, u1 - u0, v1 - v0])
    box = np.array(seen.box) + rng.normal(0, rng.choice([0.005, 0.03]), 4) * sides
    return {
        "image": seen.image,
        "pose": as_estimated(seen.pose, rng),
        "camera": seen.camera,
        "box": tuple(box),
    }


def _noise(shape: tuple[int, ...], rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    if rng.random() < 0.3:
        return rng.integers(0, 256, shape).astype(np.uint8)
    grey = rng.random() < 0.5
    values = rng.normal(rng.uniform(40, 200), rng.uniform(5, 60), (*shape[:2], 1 if grey else 3))
    return np.clip(np.broadcast_to(values, shape), 0, 255).astype(np.uint8)


def _on_circle(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _shifted(pose: Float[np.ndarray, "4 4"], shift: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    wrong = pose.copy()
    wrong[:3, 3] += shift
    return wrong


def _looks_the_same(category: Category, axis: int, degrees: int) -> bool:
    points = trimesh.sample.sample_surface(category.canonical, 1500, seed=0)[0]
    moved = points @ turned(np.eye(4), axis, degrees)[:3, :3].T
    return bool(KDTree(points).query(moved)[0].mean() < SYMMETRIC * np.ptp(points, axis=0).max())

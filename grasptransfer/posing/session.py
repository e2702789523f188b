"""What the page of a pose knows, without a browser: proposals, the pose as it is now, and its outline.

Every pose comes with its uncertainty: of a proposal, and of a pose set by hand, what right proposals err by,
as size and distance cannot be told apart by eye either; of a fitted pose, the fit's posterior.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import binary_dilation
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.drawing.boxes import overlap, projected_box
from grasptransfer.drawing.visible import visible_faces
from grasptransfer.errors import PoseError, SettingsError
from grasptransfer.files import write_whole
from grasptransfer.frames import check_rigid
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.pose_prior import PoseDeviation
from grasptransfer.perception.pose_search import FoundPose, PoseFinder
from grasptransfer.perception.pose_search.finder import uncertainty_of
from grasptransfer.poses import check_in_view, pose_as_yaml

LARGEST_SHOWN = 900  # px: the longer side of the picture as the page shows it
OUTLINE = (40, 205, 190)
TINT = 0.18  # how much of the outline's colour the model's inside takes
FARTHEST, NEAREST = 20.0, 0.05  # m
MOST_UNDONE = 100


@dataclass(frozen=True)
class PlacedModel:
    """Where the model is now.

    Args:
        camera_from_object: (4, 4) [m].
        pose_sigma: (6, 6) covariance of its error: turn [rad], then shift [m], camera axes.
        latent: (k,) its shape.
        origin: one phrase: where this pose comes from.
        status: of the fit; None where there was none.
    """

    camera_from_object: Float[np.ndarray, "4 4"]
    pose_sigma: Float[np.ndarray, "6 6"]
    latent: Float[np.ndarray, "k"]
    origin: str
    status: EstimateStatus | None = None

    @property
    def deviation(self) -> PoseDeviation:
        """Along the ray, across it, and of the turn."""
        return PoseDeviation.of(self.camera_from_object, self.pose_sigma)


class PoseSession:
    """The pose of one object in one photograph while it is looked for.

    Args:
        finder: of the category.
        image: path, PIL picture or uint8 (h, w, 3) RGB.
        camera, box: as of `find_pose`.
        camera_from_table: as of `find_pose`.

    Raises:
        GraspTransferError: wrong input, or no view fits the picture.
    """

    def __init__(self, finder: PoseFinder, image, *, camera=None, box=None, camera_from_table=None):
        self.finder = finder
        self.category = finder.category
        seen = finder.see(image, camera=camera, box=box)
        self.observation, self.box = seen.observation, seen.box
        self.proposals = finder.find_in(seen, camera_from_table=camera_from_table)
        self._history: list[PlacedModel] = []
        self._last_edit: str | None = None
        self.now = self._proposed(0)

    @property
    def camera(self) -> Camera:
        """Of the photograph."""
        return self.observation.camera

    @property
    def vertices(self) -> Float[np.ndarray, "v 3"]:
        """Of the model with its shape now, object frame [m]."""
        rest = np.asarray(self.category.canonical.vertices)
        return self.category.vertices_by_latent.displaced(rest, self.now.latent)

    def choose(self, number: int) -> None:
        """Take a proposal, 0 the likeliest.

        Raises:
            SettingsError: there is none of that number.
        """
        if not 0 <= number < len(self.proposals):
            choices = [str(one) for one in range(len(self.proposals))]
            raise SettingsError("is no proposal", key="proposal", value=number, choices=choices)
        self._set(self._proposed(number), "choose")

    def move(self, camera_from_object: Float[np.ndarray, "4 4"]) -> None:
        """Put the model elsewhere [m].

        Raises:
            PoseError: no rigid transform, or out of the picture.
        """
        pose = check_rigid(camera_from_object, "pose")
        check_in_view(pose, self.camera)
        self._set(self._by_hand(pose, "set by hand"), "move")

    def turn(self, axis: Sequence[float], degrees: float) -> None:
        """Turn the model about an axis of its own through its origin."""
        vector = np.array(axis, float) / np.linalg.norm(axis)
        pose = self.now.camera_from_object.copy()
        pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(np.deg2rad(degrees) * vector).as_matrix()
        self.move(pose)

    def place_at_distance(self, metres: float) -> None:
        """Move the model along its ray, so that it stays where it is in the picture."""
        pose = self.now.camera_from_object.copy()
        pose[:3, 3] *= float(np.clip(metres, NEAREST, FARTHEST)) / np.linalg.norm(pose[:3, 3])
        self.move(pose)

    @property
    def distance(self) -> float:
        """From the camera to the model's origin [m]."""
        return float(np.linalg.norm(self.now.camera_from_object[:3, 3]))

    def fit(self) -> EstimateStatus:
        """Fit pose and shape to the picture, from where the model is now.

        Raises:
            PoseError: the model is too near, or not in the picture.
        """
        given = replace(
            self.observation,
            camera_from_object=self.now.camera_from_object,
            pose_covariance=self.now.pose_sigma,
            box=self.box,
        )
        estimate = self.finder.estimator(given)
        if estimate.covariance is None or estimate.latent is None:
            raise PoseError("was not fitted: the estimator keeps poses as given", key="pose")
        sigma = estimate.covariance[:6, :6]
        self._set(
            PlacedModel(estimate.camera_from_object, sigma, estimate.latent, "fitted", estimate.status), "fit"
        )
        return estimate.status

    def undo(self) -> None:
        """Back to what was there before the last change; a drag is one change."""
        if self._history:
            self.now = self._history.pop()
        self._last_edit = None

    def end_of_move(self) -> None:
        """The next move is a change of its own: a drag has ended."""
        self._last_edit = None

    def overlay(self, *, longest: int = LARGEST_SHOWN) -> UInt8[np.ndarray, "h w 3"]:
        """The photograph with the model's outline, its longer side at most so many pixels."""
        camera, picture = self._shown(longest)
        mask = self.silhouette(camera)
        shown = picture.astype(np.float32)
        colour = np.array(OUTLINE, np.float32)
        shown[mask] += TINT * (colour - shown[mask])
        width = max(1, round(max(mask.shape) / 450))
        edge = binary_dilation(mask, iterations=width) & ~mask
        shown[edge] = colour
        return shown.round().astype(np.uint8)

    def silhouette(self, camera: Camera | None = None) -> Bool[np.ndarray, "h w"]:
        """Pixels of the model; of the photograph, or of another camera at the same place."""
        faces = np.asarray(self.category.canonical.faces)
        return visible_faces(self.vertices, faces, camera or self.camera, self.now.camera_from_object).mask

    @property
    def sentence(self) -> str:
        """What is known of the pose now, for a person."""
        now, deviation = self.now, self.now.deviation
        text = (
            f"{now.origin}: {self.distance:.2f} m away (± {deviation.along_ray:.2f}), "
            f"± {deviation.turn:.0f} degrees; {seen_from(now.camera_from_object)}"
        )
        if now.status not in (None, EstimateStatus.OK):
            assert now.status is not None
            text += f". {now.status.advice}"
        return text

    @property
    def box_overlap(self) -> float:
        """How well the model's box covers the object's: intersection over union."""
        return overlap(projected_box(self.vertices, self.camera, self.now.camera_from_object), self.box)

    def save(self, path: Path) -> Path:
        """Write the pose file, with its uncertainty.

        Raises:
            SettingsError: it cannot be written.
        """
        data = pose_as_yaml(self.now.camera_from_object, self.now.pose_sigma)
        lines = [f"# {self.category.name}: {self.sentence}"]
        lines += [f"# proposal {number + 1}: {describe(one)}" for number, one in enumerate(self.proposals)]
        text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)
        write_whole(path, ("\n".join(lines) + "\n" + text).encode())
        return path

    def _shown(self, longest: int) -> tuple[Camera, UInt8[np.ndarray, "h w 3"]]:
        from PIL import Image

        share = min(1.0, longest / max(self.camera.width, self.camera.height))
        size = max(1, round(self.camera.width * share)), max(1, round(self.camera.height * share))
        picture = Image.fromarray(self.observation.image).resize(size, Image.Resampling.BILINEAR)
        return self.camera.resized(*size), np.asarray(picture)

    def _proposed(self, number: int) -> PlacedModel:
        found = self.proposals[number]
        origin = f"proposal {number + 1} of {len(self.proposals)}, {found.chance:.0%} likely"
        latent = found.estimate.latent
        assert latent is not None
        return PlacedModel(found.camera_from_object, found.pose_sigma, latent, origin, found.estimate.status)

    def _by_hand(self, pose: Float[np.ndarray, "4 4"], origin: str) -> PlacedModel:
        return PlacedModel(pose, uncertainty_of(pose), self.now.latent, origin)

    def _set(self, placed: PlacedModel, edit: str) -> None:
        if edit != "move" or self._last_edit != "move":
            self._history = [*self._history, self.now][-MOST_UNDONE:]
        self.now, self._last_edit = placed, edit


def describe(found: FoundPose) -> str:
    """A proposal in one phrase."""
    deviation = found.deviation
    distance = float(np.linalg.norm(found.camera_from_object[:3, 3]))
    return (
        f"{found.chance:.0%} likely, {distance:.2f} m away (± {deviation.along_ray:.2f}), "
        f"{seen_from(found.camera_from_object)}"
    )


def seen_from(camera_from_object: Float[np.ndarray, "4 4"]) -> str:
    """From which side a camera sees the object, in words."""
    to_camera = -camera_from_object[:3, :3].T @ camera_from_object[:3, 3]
    to_camera /= np.linalg.norm(to_camera)
    around = float(np.rad2deg(np.arctan2(to_camera[1], to_camera[0])))
    above = float(np.rad2deg(np.arcsin(np.clip(to_camera[2], -1, 1))))
    side = "left" if around > 0 else "right"  # the object's own left is +y
    return f"seen from {abs(around):.0f} degrees to the {side} of its front, {above:.0f} above"

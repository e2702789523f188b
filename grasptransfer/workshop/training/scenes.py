"""Random cameras, poses, pose errors and lights for training pictures."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.drawing.lighting import Lighting
from grasptransfer.drawing.views import VIEWPOINTS, look_at, sphere_views, towards
from grasptransfer.frames import moved
from grasptransfer.perception.pose_prior import FREEDOM, PosePrior

PICTURE = (640, 480)  # px: the virtual camera before the zoom


@dataclass(frozen=True)
class PoseNoise:
    """Error of the pose that the network is given.

    Args:
        translation: half-width of the uniform error on each camera axis [m].
        rotation: largest turn about a random axis [rad].
    """

    translation: float
    rotation: float

    def apply(
        self, camera_from_object: Float[np.ndarray, "4 4"], rng: np.random.Generator
    ) -> Float[np.ndarray, "4 4"]:
        """A wrong pose near the true one."""
        noisy = camera_from_object.copy()
        axis = rng.normal(size=3)
        turn = axis / np.linalg.norm(axis) * rng.uniform(0, self.rotation)
        noisy[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ noisy[:3, :3]
        noisy[:3, 3] += rng.uniform(-self.translation, self.translation, 3)
        noisy[2, 3] = max(noisy[2, 3], camera_from_object[2, 3] * 0.7)
        return noisy


NO_NOISE = PoseNoise(0.0, 0.0)
# Such errors come with a box only, on which the pose is then centred.
WIDE_NOISE = PoseNoise(0.05, np.deg2rad(10))
TRAINING_NOISES = (NO_NOISE, PoseNoise(0.01, np.deg2rad(3)), WIDE_NOISE)
TRAINING_NOISE_SHARES = (0.4, 0.35, 0.25)


def as_estimated(
    camera_from_object: Float[np.ndarray, "4 4"], rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """A pose as an RGB estimator gives it: an error drawn from the prior's Student t distribution."""
    prior = PosePrior.of(camera_from_object, None)
    assert prior is not None
    normal = rng.multivariate_normal(np.zeros(6), prior.covariance, method="eigh")
    return moved(camera_from_object, normal / np.sqrt(rng.chisquare(FREEDOM) / FREEDOM))


def draw_camera(rng: np.random.Generator) -> Camera:
    """A camera with 30 to 75 degrees horizontal field of view."""
    return Camera.from_fov(*PICTURE, rng.uniform(np.deg2rad(30), np.deg2rad(75)))


def draw_pose(camera: Camera, radius: float, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """A pose whose object of this radius [m] covers a plausible part of the picture.

    Of all poses, 30 % are the paper's 74 views, and 55 % are seen from about level to steeply above, as a
    robot sees objects. The rest are arbitrary.
    """
    size = np.exp(rng.uniform(np.log(70), np.log(400)))  # px across
    distance = camera.fx * 2 * radius / size
    kind = rng.random()
    if kind < 0.3:
        rotation = sphere_views(1.0)[rng.integers(VIEWPOINTS)][:3, :3]
    elif kind < 0.85:
        elevation = rng.uniform(np.deg2rad(-5), np.deg2rad(75))
        rotation = look_at(1.0, rng.uniform(0, 2 * np.pi), elevation, roll=rng.normal(0, np.deg2rad(8)))[
            :3, :3
        ]
    else:
        rotation = Rotation.random(random_state=rng).as_matrix()  # pyright: ignore[reportCallIssue]
    margin = min(size / 2, 200)
    pixel = np.array([rng.uniform(margin, PICTURE[0] - margin), rng.uniform(margin, PICTURE[1] - margin)])
    pose = np.eye(4)
    pose[:3, 3] = camera.unproject(pixel, np.array(distance))
    pose[:3, :3] = towards(pose[:3, 3]) @ rotation
    return pose


def draw_lighting(rng: np.random.Generator) -> Lighting:
    """One to four lights, from dim and flat to one harsh lamp, slightly coloured."""
    count = rng.integers(1, 5)
    directions = rng.normal(size=(count, 3))
    # Most lights come from behind the camera.
    directions[:, 2] = -np.abs(directions[:, 2]) * rng.choice([1, 1, 1, -0.3], count)
    directions[:, 1] -= 0.8  # Most lights come from above.
    tint = 1 + rng.normal(0, 0.06, (count, 3))
    strength = rng.dirichlet(np.ones(count))[:, None] * rng.uniform(1.5, 6.0)
    return Lighting(rng.uniform(0.1, 0.8), directions, np.clip(tint * strength, 0.01, None))

"""One trial to run: a grasp, and the errors drawn for it."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.errors import GraspFileError
from grasptransfer.frames import rigid
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.placed_grasp import Executable, PlacedGrasp, placed
from grasptransfer.simulation.protocol import Perturbation


@dataclass(frozen=True)
class Conditions:
    """Friction, mass and force of one trial.

    Args:
        friction: Coulomb coefficient between pad and object.
        mass: mass of the object [kg].
        force: largest force of each pad [N].
    """

    friction: float
    mass: float
    force: float


@dataclass(frozen=True)
class Job:
    """One trial to execute, with its errors already added.

    Args:
        grasp, trial: name of the grasp, and number of the trial.
        object_from_tcp: (4, 4) [m].
        width: distance between the pads when they touch, or None where not known [m].
        opening: distance between the pads on the way in [m].
        approach_distance: straight way along +z that ends at the grasp [m].
        conditions: friction, mass and force of this trial.
        frames_per_second: frame rate of the recording; 0: none.
    """

    grasp: str
    trial: int
    object_from_tcp: Float[np.ndarray, "4 4"]
    width: float | None
    opening: float
    approach_distance: float
    conditions: Conditions
    frames_per_second: float = 0.0


def make_jobs(
    grasps: Sequence[PlacedGrasp | Grasp | Executable | np.ndarray],
    gripper: Gripper,
    conditions: Conditions,
    *,
    trials: int,
    perturb: Perturbation | None,
    seed: int,
    frames: float,
) -> list[Job]:
    """Every trial of every grasp, with its errors drawn from the seed, the grasp's name and the trial.

    Args:
        grasps: the grasps, as for `simulate`.
        gripper: the gripper that executes them; it decides openings that are not given.
        conditions: friction, mass and force without errors.
        trials: number of trials of one grasp.
        perturb: errors to draw; None executes the grasps exactly.
        seed: seed of the errors.
        frames: recorded frames in a second of simulated time; 0 records none.

    Raises:
        GraspFileError: two grasps of one name, or a length that is none in metres.
    """
    jobs, names = [], set()
    for i, given in enumerate(grasps):
        grasp = placed(given, i)
        name, pose = grasp.name, grasp.object_from_gripper
        if name in names:
            raise GraspFileError("two grasps share a name", key="grasps", value=name)
        names.add(name)
        width = None if grasp.width is None else float(grasp.width)
        opening, approach = _on_the_way_in(grasp, gripper), float(grasp.approach_distance)
        for trial in range(trials):
            moved, met = pose, conditions
            if perturb is not None:
                # The errors follow the grasp's name, so that leaving a grasp out does not change the others.
                rng = np.random.default_rng([seed, zlib.crc32(name.encode()), trial])
                moved, met = perturbed(pose, conditions, perturb, rng)
            jobs.append(Job(name, trial, moved, width, opening, approach, met, frames))
    return jobs


def perturbed(
    object_from_tcp: Float[np.ndarray, "4 4"],
    conditions: Conditions,
    perturb: Perturbation,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "4 4"], Conditions]:
    """The pose and the conditions with random errors.

    Args:
        object_from_tcp: (4, 4) exact pose [m].
        conditions: exact conditions.
        perturb: standard deviations of the errors.
        rng: source of the errors.
    """
    shift = rng.normal(0.0, 1.0, 3) * perturb.position
    axis = rng.normal(0.0, 1.0, 3)
    angle = np.radians(perturb.degrees) * rng.normal()
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    share = perturb.friction * float(np.clip(rng.normal(), -2, 2))
    friction = max(conditions.friction * (1 + share), 0.0)
    mass = conditions.mass * perturb.mass ** rng.uniform(-1, 1)
    return object_from_tcp @ rigid(turn, shift), Conditions(friction, float(mass), conditions.force)


def _on_the_way_in(grasp: PlacedGrasp, gripper: Gripper) -> float:
    """Distance between the pads on the way in [m]; refuses lengths that cannot be metres.

    Raises:
        GraspFileError: width, opening or approach distance beyond a metre, negative or not finite.
    """
    opening, width = grasp.opening, grasp.width
    if opening is None:
        opening = gripper.max_width if width is None else gripper.approach_opening(float(width))
    for key, value in (
        ("opening", opening),
        ("width", width),
        ("approach_distance", grasp.approach_distance),
    ):
        if value is not None and not (np.isfinite(value) and 0 <= value <= 1):
            raise GraspFileError("must be a length in metres", key=f"{grasp.name}.{key}", value=value)
    return float(np.clip(opening, *gripper.opening))

"""Execute grasps in physics: many trials, in this process, in several, or on a cluster."""

import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.errors import GraspFileError, SettingsError, check_seed
from grasptransfer.frames import rigid
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.grasping.gripper import Gripper, load_gripper
from grasptransfer.grasping.placed_grasp import Executable, PlacedGrasp, placed
from grasptransfer.simulation.body import body_of
from grasptransfer.simulation.engines import choose_engine
from grasptransfer.simulation.hand import hand_of
from grasptransfer.simulation.ledger import Ledger, read_results
from grasptransfer.simulation.outcome import TrialResult
from grasptransfer.simulation.protocol import Perturbation, Protocol, load_protocol
from grasptransfer.simulation.setup import Setup, execute, job_key
from grasptransfer.simulation.trial import Job

if TYPE_CHECKING:
    import trimesh


def simulate(
    grasps: Sequence[PlacedGrasp | Grasp | Executable | np.ndarray],
    mesh: "trimesh.Trimesh | trimesh.Scene",
    gripper: str | Path | Gripper = "panda",
    protocol: str | Protocol = "lift-shake-v1",
    *,
    engine: str | None = None,
    trials: int = 1,
    perturb: Perturbation | None = None,
    friction: float | None = None,
    seed: int = 0,
    workers: int = 1,
    cluster: str | None = None,
    results_path: str | Path | None = None,
    frames: float | None = None,
    trial_limit: float = 60.0,
    on_trial: Callable[[int, int], None] | None = None,
) -> list[TrialResult]:
    """Execute each grasp on `mesh` in a physics engine, by a named protocol.

    A trial depends on its own inputs only: the same seed gives the same results in any process, order
    and number of workers.

    Args:
        grasps: `PlacedGrasp`s; transferred or warped ones; annotated ones, on the canonical model itself; or
            bare (4, 4) arrays `object_from_gripper` [m], approached fully open.
        mesh: the object, object frame [m], z up as it stands.
        gripper: a name, a YAML file, or a loaded one.
        protocol: a name, or a protocol of your own.
        engine: `pybullet` or `mujoco`; None: PyBullet where it is installed.
        trials: of each grasp. One trial executes it exactly; several are perturbed.
        perturb: errors added to every trial; None: the protocol's where there are several trials.
        friction: of pad on object; None: the protocol's.
        seed: of the perturbations.
        workers: processes; one means this process.
        cluster: address of a Dask scheduler, instead of `workers`.
        results_path: JSON lines to append to; trials that are in it already do not run again.
        frames: per second of simulated time, of `TrialResult.recording`; None: no recording.
        trial_limit: seconds of computing after which a trial in another process is given up.
        on_trial: called with the number of trials done and of all.

    Returns:
        `trials` results of each grasp, in the order of the grasps.

    Raises:
        SettingsError, GripperError, GraspFileError, PoseError, MeshError: wrong input.
    """
    chosen, engine = load_protocol(protocol), choose_engine(engine)
    check_seed(seed)
    _check_numbers(trials, workers, frames, friction)
    loaded = gripper if isinstance(gripper, Gripper) else load_gripper(gripper)
    perturb = perturb if perturb is not None or trials == 1 else chosen.perturbation
    jobs = make_jobs(
        grasps,
        loaded,
        chosen,
        trials=trials,
        perturb=perturb,
        friction=chosen.friction if friction is None else friction,
        seed=seed,
        frames=frames,
    )
    if not jobs:
        return []
    setup = Setup(body_of(mesh, chosen), hand_of(loaded), chosen, engine)
    keys = [job_key(setup, job) for job in jobs]
    known = {} if results_path is None or frames else read_results(results_path)
    results = {i: known[key] for i, key in enumerate(keys) if key in known}
    rest = [i for i in range(len(jobs)) if i not in results]
    ledger = None if results_path is None else Ledger(results_path)
    try:
        for i, result in _run(setup, [jobs[i] for i in rest], workers, cluster, trial_limit):
            index = rest[i]
            results[index] = result
            if ledger is not None:
                ledger.add(keys[index], result)
            if on_trial is not None:
                on_trial(len(results), len(jobs))
    finally:
        if ledger is not None:
            ledger.close()
    return [results[i] for i in range(len(jobs))]


def _run(
    setup: Setup, jobs: Sequence[Job], workers: int, cluster: str | None, limit: float
) -> Iterator[tuple[int, TrialResult]]:
    if not jobs:
        return iter(())
    if cluster is not None:
        from grasptransfer.simulation.cluster import run_on_cluster

        return run_on_cluster(setup, jobs, cluster)
    if workers > 1:
        from grasptransfer.simulation.pool import run_in_processes

        return run_in_processes(setup, jobs, min(workers, len(jobs)), limit=limit)
    return ((i, execute(setup, job)) for i, job in enumerate(jobs))


def make_jobs(
    grasps: Sequence[PlacedGrasp | Grasp | Executable | np.ndarray],
    gripper: Gripper,
    protocol: Protocol,
    *,
    trials: int,
    perturb: Perturbation | None,
    friction: float,
    seed: int,
    frames: float | None,
) -> list[Job]:
    """Every trial of every grasp, with its errors drawn from the seed, the grasp's name and the trial."""
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
            moved, rubbed = pose, friction
            if perturb is not None:
                # By name, not by place: leaving a grasp out does not change the others.
                rng = np.random.default_rng([seed, zlib.crc32(name.encode()), trial])
                moved, rubbed = perturbed(pose, friction, perturb, rng)
            jobs.append(Job(name, trial, moved, width, opening, approach, rubbed, frames or 0.0))
    return jobs


def perturbed(
    object_from_tcp: Float[np.ndarray, "4 4"],
    friction: float,
    perturb: Perturbation,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "4 4"], float]:
    """The pose [m] and the friction with random errors."""
    shift = rng.normal(0.0, 1.0, 3) * perturb.position
    axis = rng.normal(0.0, 1.0, 3)
    angle = np.radians(perturb.degrees) * rng.normal()
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    share = perturb.friction * float(np.clip(rng.normal(), -2, 2))
    return object_from_tcp @ rigid(turn, shift), max(friction * (1 + share), 0.0)


def _on_the_way_in(grasp: PlacedGrasp, gripper: Gripper) -> float:
    """Distance between the pads on the way in [m]; refuses lengths that are none in metres.

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


def _check_numbers(trials: int, workers: int, frames: float | None, friction: float | None) -> None:
    for key, value in (("trials", trials), ("workers", workers)):
        if not isinstance(value, (int, np.integer)) or value < 1:
            raise SettingsError("must be a whole number of at least 1", key=key, value=value)
    if frames is not None and not 0 < frames <= 240:
        raise SettingsError("must lie above 0 and up to 240 per second", key="frames", value=frames)
    if friction is not None and not 0 <= friction <= 5:
        raise SettingsError("must lie between 0 and 5", key="friction", value=friction)

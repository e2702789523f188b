"""Execute grasps in physics: many trials, in this process, in several, or on a cluster."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grasptransfer.errors import SettingsError, check_seed
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.grasping.gripper import Gripper, load_gripper
from grasptransfer.grasping.placed_grasp import Executable, PlacedGrasp
from grasptransfer.jobs import Record
from grasptransfer.simulation.body import body_of
from grasptransfer.simulation.engines import choose_engine
from grasptransfer.simulation.engines.bullet_files import remove_orphans
from grasptransfer.simulation.hand import hand_of
from grasptransfer.simulation.job import Conditions, Job, make_jobs
from grasptransfer.simulation.ledger import line_of, read_results
from grasptransfer.simulation.outcome import TrialResult, TrialStatus
from grasptransfer.simulation.pool import run_trials
from grasptransfer.simulation.protocol import Perturbation, Protocol, check_perturbation, load_protocol
from grasptransfer.simulation.setup import Setup, job_key

if TYPE_CHECKING:
    import trimesh

BOUNDS = {
    "trials": (1, 1_000_000),
    "workers": (1, 1000),
    "frames": (0.1, 240),  # per second
    "friction": (0, 5),
    "mass": (1e-3, 100),  # kg
    "density": (1, 30_000),  # kg/m3
    "force": (0.1, 10_000),  # N
    "trial_limit": (0.1, 86_400),  # s
}


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
    mass: float | None = None,
    density: float | None = None,
    force: float | None = None,
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
        trials: number of trials of each grasp. A single trial executes the grasp exactly; several trials are
            perturbed.
        perturb: errors added to every trial; None takes the protocol's if there are several trials.
        friction: friction of pad on object; None takes the protocol's.
        mass: mass of the object [kg]; None takes volume times density.
        density: density of the object, kg/m3 of its solid; None takes the protocol's, and its limits of mass.
        force: force of each pad [N], at most the gripper's own limit; None takes the protocol's.
        seed: seed of the perturbations.
        workers: processes; one means this process.
        cluster: address of a Dask scheduler, instead of `workers`.
        results_path: JSON lines to append to; trials that are in it already do not run again.
        frames: frames of `TrialResult.recording` in a second of simulated time; None records nothing.
        trial_limit: seconds of computing after which a trial in another process is given up.
        on_trial: called with the number of trials done and of all.

    Returns:
        `trials` results of each grasp, in the order of the grasps.

    Raises:
        SettingsError, GripperError, GraspFileError, PoseError, MeshError: wrong input.
    """
    chosen, engine = load_protocol(protocol), choose_engine(engine)
    check_seed(seed)
    _check_numbers(trials=trials, workers=workers, frames=frames, friction=friction)
    _check_numbers(mass=mass, density=density, force=force, trial_limit=trial_limit)
    _check_one_of(mass, density)
    if perturb is not None:
        check_perturbation(perturb)
    if len(grasps) == 0:
        return []
    gripper = gripper if isinstance(gripper, Gripper) else load_gripper(gripper)
    hand = hand_of(gripper)
    setup = Setup(body_of(mesh, chosen, density=density), hand, chosen, engine)
    conditions = _conditions(setup, friction, mass, force)
    perturb = chosen.perturbation if perturb is None and trials > 1 else perturb
    jobs = make_jobs(
        grasps, gripper, conditions, trials=trials, perturb=perturb, seed=seed, frames=frames or 0.0
    )
    run = partial(run_trials, setup, workers=workers, cluster=cluster, limit=trial_limit)
    return _resumed(setup, jobs, run, results_path=results_path, anew=bool(frames), on_trial=on_trial)


def _conditions(setup: Setup, friction: float | None, mass: float | None, force: float | None) -> Conditions:
    """Conditions as given, or else as protocol, body and hand say."""
    protocol = setup.protocol
    return Conditions(
        friction=protocol.friction if friction is None else float(friction),
        mass=setup.body.mass if mass is None else float(mass),
        force=min(protocol.grip_force if force is None else float(force), setup.hand.force_limit),
    )


def _resumed(
    setup: Setup,
    jobs: Sequence[Job],
    run: Callable[[Sequence[Job]], Iterator[tuple[int, TrialResult]]],
    *,
    results_path: str | Path | None,
    anew: bool,
    on_trial: Callable[[int, int], None] | None,
) -> list[TrialResult]:
    """The results of all jobs: those that are recorded, unless all are to run anew, and those of a run.

    Args:
        run: yields index and result of each job that it is given.
        results_path: record of the results; None keeps none.
        anew: leave what is recorded aside.
        on_trial: called with the number of trials done and of all.
    """
    keys = [job_key(setup, job) for job in jobs]
    known = {} if anew else read_results(results_path)
    results = {i: known[key] for i, key in enumerate(keys) if key in known}
    rest = [i for i in range(len(jobs)) if i not in results]
    with Record(results_path) as record:
        for i, result in run([jobs[i] for i in rest]):
            index = rest[i]
            results[index] = result
            record.add(line_of(keys[index], result))
            if on_trial is not None:
                on_trial(len(results), len(jobs))
    if any(result.status is TrialStatus.CRASHED for result in results.values()):
        remove_orphans()  # Crashed processes leave their folders behind.
    return [results[i] for i in range(len(jobs))]


def _check_one_of(mass: float | None, density: float | None) -> None:
    if mass is not None and density is not None:
        raise SettingsError("is given beside mass", key="density", value=density, fix="Give one of them")


def _check_numbers(**numbers: float | None) -> None:
    for key, value in numbers.items():
        if value is None:
            continue
        low, high = BOUNDS[key]
        whole = key in ("trials", "workers")
        kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
        if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
            kind = "a whole number" if whole else "a number"
            raise SettingsError(f"must be {kind} from {low:g} to {high:g}", key=key, value=value)

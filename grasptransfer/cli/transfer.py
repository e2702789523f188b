"""`grasptransfer demo | transfer | simulate`: from files to grasps, a report and executed trials."""

from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import Positional, arg

from grasptransfer.cli.arguments import EstimatorName
from grasptransfer.cli.progress import progress_bar

console = Console(markup=False)


def demo(*, out: Path = Path("demo_out"), seed: int = 0) -> int:
    """Transfer grasps to a mug that no training saw, execute them, and write a report.

    Args:
        out: folder for report.html, grasps.yaml and reconstruction.glb.
        seed: of everything random.
    """
    from grasptransfer.report.demo import run_demo

    with progress_bar(console) as progress:
        outcome = run_demo(out, seed=seed, on_stage=lambda text: progress.console.print(f"  {text}"))
    console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def transfer(
    image: Positional[Annotated[Path, arg(metavar="IMAGE")]],
    *,
    category: str,
    pose: Path,
    out: Path,
    camera: Path | None = None,
    gripper: str = "panda",
    scene: Path | None = None,
    mask: Path | None = None,
    box: tuple[float, float, float, float] | None = None,
    execute: Path | None = None,
    pose_sigma: tuple[float, ...] | None = None,
    refine_pose: bool = True,
    estimator: EstimatorName = "rgb",
    depth: Path | None = None,
    device: str = "auto",
    precision: str = "auto",
    seed: int = 0,
) -> int:
    """Transfer the annotated grasps of a category to the instance in a picture.

    Args:
        image: RGB picture.
        category: name or folder of the category.
        pose: YAML with camera_from_object (4x4, OpenCV, metres); also of BOP, ROS, MegaPose, and 4x4 text.
        out: folder for report.html, grasps.yaml and reconstruction.glb.
        camera: YAML with fx fy cx cy width height; also camera_info, calibrations, 3x3 text; without it the
            photograph's EXIF data count, else 60 degrees are assumed.
        gripper: name, or YAML of your own.
        scene: YAML with obstacles and a support plane.
        mask: picture that is white on the object.
        box: u0 v0 u1 v1 around the object [px], as any detector gives it.
        execute: true mesh of the instance [m], standing at the given pose; the grasps are executed on it.
        pose_sigma: how sure the pose is: 0, exact; or standard deviations in metres and degrees; without it,
            the pose file's pose_sigma counts, or else the errors of real pose estimators.
        refine_pose: fit the pose together with the shape; without, the pose is taken as exact.
        depth: 16-bit picture in millimetres, 0 = missing, for the estimators that use depth.
        device: auto, cpu or cuda.
        precision: auto (float32), float32 or bfloat16, of networks.
        seed: of everything random.
    """
    from grasptransfer.report.transfer_files import run_transfer

    outcome = run_transfer(
        image,
        pose,
        category,
        camera=camera,
        gripper=gripper,
        scene=scene,
        mask=mask,
        box=box,
        depth=depth,
        execute=execute,
        estimator=estimator,
        pose_sigma=pose_sigma[0] if pose_sigma is not None and len(pose_sigma) == 1 else pose_sigma,
        refine_pose=refine_pose,
        device=device,
        precision=precision,
        seed=seed,
        out=out,
    )
    console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def simulate(
    *,
    grasps: Path,
    mesh: Path,
    gripper: str | None = None,
    pose: Path | None = None,
    scale: float | None = None,
    protocol: str = "lift-shake-v1",
    engine: str | None = None,
    trials: int = 1,
    workers: int = 1,
    results: Path | None = None,
    movies: Path | None = None,
    seed: int = 0,
) -> int:
    """Execute grasps on a mesh in a physics engine.

    Args:
        grasps: grasp file in any format `convert` reads.
        mesh: the object.
        gripper: name, or YAML of your own; default: the one that the grasp file names, or panda.
        pose: pose file of the object, for grasps that are in a camera's frame.
        scale: metres in one unit of the mesh; default: what the grasp file says, else 1.
        protocol: named and versioned execution protocol.
        engine: pybullet or mujoco; default: PyBullet where it is installed.
        trials: perturbed trials of each grasp; 1 executes it exactly.
        workers: processes.
        results: JSON lines that an interrupted run resumes from.
        movies: folder for a GIF of each trial.
        seed: of the perturbations.
    """
    from grasptransfer.report.execution_table import run_simulation

    table, held = run_simulation(
        grasps,
        mesh,
        gripper,
        pose=pose,
        scale=scale,
        protocol=protocol,
        engine=engine,
        trials=trials,
        workers=workers,
        results=results,
        seed=seed,
        movies=movies,
    )
    console.print(table)
    return 0 if held else 1

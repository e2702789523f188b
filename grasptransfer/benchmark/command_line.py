"""`grasptransfer bench …`: each benchmark prints its summary and writes the JSON of the contract."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from grasptransfer.report.progress import progress_bar

console = Console()


def cpd(
    *,
    json: Path,
    sizes: tuple[int, ...] = (500, 1000, 2000, 4000, 8000),
    repeats: int = 3,
    longest: float = 100.0,
    seed: int = 0,
) -> int:
    """Speed, memory and error of CPD against the peers that are installed (pycpd, cycpd, probreg).

    Args:
        json: file for the results.
        sizes: points of each cloud.
        repeats: of each measurement; their median counts.
        longest: a peer that would take more seconds than this is extrapolated.
        seed: of the clouds.
    """
    from grasptransfer.benchmark.cpd import run_cpd_benchmark

    return _bench(
        lambda tick: run_cpd_benchmark(sizes, repeats=repeats, longest=longest, seed=seed, progress=tick),
        json,
    )


def latent_fit(*, data: Path, json: Path, modes: int = 5, repeats: int = 3) -> int:
    """Error and time of shape-space fits to whole clouds, against the predecessor's objective.

    Args:
        data: folder of clouds (pcd, xyz) in one frame, metres: train/ and test/.
        json: file for the results.
        modes: of the shape space.
        repeats: of each measurement; their median counts.
    """
    from grasptransfer.benchmark.latent_fit import LatentFitSettings, run_latent_fit_benchmark

    settings = LatentFitSettings(data, modes, repeats=repeats)
    return _bench(lambda tick: run_latent_fit_benchmark(settings, progress=tick), json)


def registration(
    *,
    json: Path,
    categories: tuple[str, ...] = (),
    meshes: Path | None = None,
    views: int = 74,
    estimators: tuple[str, ...] = (),
    weights: Path | None = None,
    refine_pose: bool = False,
    maps: Path | None = None,
    workers: int = 2,
    seed: int = 0,
) -> int:
    """Errors of rgb, cls, cpd, rigid, similarity and true offsets on the same views (the paper's table I).

    Args:
        json: file for the results; a killed run goes on from the file beside it.
        categories: names; none given: all that have weights.
        meshes: folder of <category>/<name>/mesh.*; none: the shipped test instances.
        views: of the 74 viewpoints, spread evenly.
        estimators: gt, cls, cpd, rgb, rgbd, rigid, similarity; none given: all but rgbd.
        weights: file for rgb instead of the shipped ones.
        refine_pose: let rgb and cls refine the (true) pose.
        maps: PNG for predicted and true deformations of one instance a category (the paper's figure 7).
        workers: processes.
        seed: of lights and backgrounds.
    """
    from grasptransfer.benchmark.deformation_maps import draw_deformation_maps
    from grasptransfer.benchmark.estimators import NAMES
    from grasptransfer.benchmark.registration import RegistrationSettings, run_registration_benchmark

    settings = RegistrationSettings(
        _trained(categories),
        meshes,
        views,
        seed,
        refine_pose=refine_pose,
        methods=estimators or NAMES,
        weights=weights,
    )
    code = _bench(
        lambda tick: run_registration_benchmark(
            settings, workers=workers, ledger=_ledger(json), progress=tick
        ),
        json,
    )
    if maps is not None:
        method = "rgb" if "rgb" in settings.methods else settings.methods[0]
        draw_deformation_maps(
            settings.categories, maps, method=method, meshes=meshes, weights=weights, seed=seed
        )
        console.print(f"Deformation maps of {method}: {maps}")
    return code


def pose_noise(
    *,
    json: Path,
    categories: tuple[str, ...] = (),
    meshes: Path | None = None,
    views: int = 74,
    translation: float = 0.05,
    rotation: float = 0.0,
    estimators: tuple[str, ...] = ("cpd", "cls", "rgb", "rigid", "similarity"),
    weights: Path | None = None,
    workers: int = 2,
    seed: int = 0,
) -> int:
    """The same with a wrong pose told to every method (the paper's table II); rgb and cls refine it.

    Args:
        json: file for the results; a killed run goes on from the file beside it.
        categories: names; none given: all that have weights.
        meshes: folder of <category>/<name>/mesh.*; none: the shipped test instances.
        views: of the 74 viewpoints, spread evenly.
        translation: half-width of the uniform error on each axis [m].
        rotation: largest turn about a random axis [degrees].
        estimators: gt, cls, cpd, rgb, rgbd, rigid, similarity.
        weights: file for rgb instead of the shipped ones.
        workers: processes.
        seed: of lights, backgrounds and pose errors.
    """
    import math

    from grasptransfer.benchmark.registration import RegistrationSettings, run_pose_noise_benchmark

    settings = RegistrationSettings(
        _trained(categories),
        meshes,
        views,
        seed,
        translation,
        math.radians(rotation),
        refine_pose=True,
        methods=estimators,
        weights=weights,
    )
    return _bench(
        lambda tick: run_pose_noise_benchmark(settings, workers=workers, ledger=_ledger(json), progress=tick),
        json,
    )


def glass(
    *,
    json: Path,
    categories: tuple[str, ...] = ("bottle", "spray_bottle"),
    views: int = 20,
    through: float = 0.5,
    gate: bool = True,
    weights: Path | None = None,
    workers: int = 2,
    seed: int = 0,
) -> int:
    """See-through instances: rgb, and rgbd, cls and cpd on true depth and on what a depth camera reports.

    Args:
        json: file for the results; a killed run goes on from the file beside it.
        categories: names; instances without see-through parts are left out.
        views: of the 74 viewpoints, spread evenly.
        through: share of the unmeasured glass where the camera reports what lies behind, not a hole.
        gate: leave out depth that is too far from the told position to be the object's.
        weights: file for rgb instead of the shipped ones.
        workers: processes.
        seed: of lights, backgrounds and the camera's noise.
    """
    from grasptransfer.benchmark.glass import GlassSettings, run_glass_benchmark
    from grasptransfer.perception.depth_sensor import DepthSensor

    settings = GlassSettings(categories, views, seed, DepthSensor(through=through), gate, weights=weights)
    return _bench(
        lambda tick: run_glass_benchmark(settings, workers=workers, ledger=_ledger(json), progress=tick), json
    )


def latency(
    *,
    json: Path,
    categories: tuple[str, ...] = (),
    views: int = 20,
    estimator: str = "rgb",
    refine_pose: bool = True,
    gripper: str = "panda",
    device: str = "auto",
    seed: int = 0,
) -> int:
    """Milliseconds of every stage of a transfer: median and 95th percentile; a cold start apart; memory.

    Args:
        json: file for the results.
        categories: names, each in a fresh process; none given: all that have weights.
        views: pictures after the first one.
        estimator: rgb, rgbd, cls, cpd, similarity or rigid.
        refine_pose: fit the pose together with the shape.
        gripper: name.
        device: auto, cpu or cuda.
        seed: of pictures.
    """
    from grasptransfer.benchmark.latency import LatencySettings, run_latency_benchmark

    settings = LatencySettings(_trained(categories), views, estimator, refine_pose, gripper, device, seed)
    return _bench(lambda tick: run_latency_benchmark(settings, progress=tick), json)


def grasp(
    *,
    json: Path,
    categories: tuple[str, ...] = (),
    meshes: Path | None = None,
    views: int = 12,
    gripper: str = "panda",
    protocol: str = "lift-shake-v1",
    translation: float = 0.0,
    rotation: float = 0.0,
    workers: int = 2,
    seed: int = 0,
) -> int:
    """Grasp success in PyBullet, on the true mesh, of rgb and the baselines.

    Args:
        json: file for the results.
        categories: names; none given: all that have weights.
        meshes: folder of <category>/<name>/mesh.*; none: the shipped test instances.
        views: of the 74 viewpoints, spread evenly.
        gripper: name.
        protocol: named and versioned execution protocol.
        translation: half-width of the told pose's uniform error on each axis [m].
        rotation: largest turn of the told pose about a random axis [degrees].
        workers: processes.
        seed: of lights, backgrounds, pose errors and trials.
    """
    import math

    from grasptransfer.benchmark.grasp import GraspSettings, run_grasp_benchmark

    settings = GraspSettings(
        _trained(categories), meshes, views, gripper, protocol, seed, translation, math.radians(rotation)
    )
    return _bench(lambda tick: run_grasp_benchmark(settings, workers=workers, progress=tick), json)


def photos(
    *,
    json: Path,
    photos: Path,
    categories: tuple[str, ...] = (),
    refine_pose: bool = True,
    told_box: bool = True,
    depth: bool = False,
    weights: Path | None = None,
    workers: int = 2,
) -> int:
    """Errors of rgb, rigid and similarity on real photographs with known poses (the paper's table III).

    Args:
        json: file for the results; a killed run goes on from the file beside it.
        photos: folder with pictures and photos.yaml.
        categories: names; none given: all that have weights.
        refine_pose: let rgb refine the given pose.
        told_box: tell rgb the object's box, as a detector would.
        depth: also measure rgbd, cls and cpd on photographs that come with depth.
        weights: file for rgb instead of the shipped ones.
        workers: processes.
    """
    from grasptransfer.benchmark.photos import PhotoSettings, run_photo_benchmark

    settings = PhotoSettings(photos, _trained(categories), refine_pose, told_box, depth, weights)
    return _bench(
        lambda tick: run_photo_benchmark(settings, workers=workers, ledger=_ledger(json), progress=tick), json
    )


def calibration(
    *,
    json: Path,
    categories: tuple[str, ...] = (),
    objects: int = 12,
    views: int = 3,
    translation: float = 0.0,
    rotation: float = 0.0,
    workers: int = 2,
    seed: int = 0,
) -> int:
    """Whether a grasp's score is its chance to hold; prints the ranking's weights that make it so.

    Args:
        json: file for the results.
        categories: names; none given: all that have weights.
        objects: random shapes of each category.
        views: of each object.
        translation: half-width of the told pose's uniform error on each axis [m].
        rotation: largest turn of the told pose about a random axis [degrees].
        workers: processes.
        seed: of lights, backgrounds, pose errors and trials.
    """
    import math

    from grasptransfer.benchmark.calibration import CalibrationSettings, run_calibration

    settings = CalibrationSettings(
        _trained(categories),
        objects,
        views,
        translation_noise=translation,
        rotation_noise=math.radians(rotation),
        seed=seed,
    )
    return _bench(lambda tick: run_calibration(settings, workers=workers, progress=tick), json)


def refusal(
    *,
    json: Path,
    categories: tuple[str, ...] = (),
    views: int = 4,
    random_objects: int = 12,
    seed: int = 0,
) -> int:
    """How often rgb accepts objects of other categories or of none, and refuses its own.

    Args:
        json: file for the results.
        categories: names; none given: all that have weights.
        views: of each object.
        random_objects: objects of no category beside the test instances.
        seed: of random objects, lights and backgrounds.
    """
    from grasptransfer.benchmark.refusal import RefusalSettings, run_refusal_benchmark

    settings = RefusalSettings(_trained(categories), views, random_objects, seed)
    return _bench(lambda tick: run_refusal_benchmark(settings, progress=tick), json)


def _bench(run: Callable[[Callable[[int, int], None]], dict], path: Path) -> int:
    """Run a benchmark under a progress bar, write its JSON, and print its rows and summary."""
    from grasptransfer.benchmark.document import write_document
    from grasptransfer.benchmark.tables import rows_table

    with progress_bar(console) as progress:
        task = progress.add_task("instances", total=None)
        result = run(lambda done, total: progress.update(task, completed=done, total=total))
    write_document(result, path)
    _ledger(path).unlink(missing_ok=True)
    rows = rows_table(result)
    if rows is not None:
        console.print(rows)
    table = Table("measure", "value", title=result["benchmark"])
    for name, value in result["summary"].items():
        table.add_row(name, f"{value:.4g}" if isinstance(value, float) else str(value))
    console.print(table)
    console.print(f"Rows and settings: {path}")
    return 0


def _ledger(json: Path) -> Path:
    """Finished rows of a run that has not ended."""
    return json.with_name(json.name + ".rows")


def _trained(categories: tuple[str, ...]) -> tuple[str, ...]:
    from grasptransfer.perception.weights import trained_categories

    return categories or trained_categories()


COMMANDS: dict[str, Callable[..., Any]] = {
    "cpd": cpd,
    "latent-fit": latent_fit,
    "registration": registration,
    "pose-noise": pose_noise,
    "glass": glass,
    "latency": latency,
    "grasp": grasp,
    "photos": photos,
    "refusal": refusal,
    "calibration": calibration,
}

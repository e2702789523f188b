"""`grasptransfer demo`: the bundled picture of a mug that no training saw, from pixels to held grasps."""

from collections.abc import Callable
from pathlib import Path

from grasptransfer.camera import Camera
from grasptransfer.category import load_category
from grasptransfer.data_files import read_yaml
from grasptransfer.errors import CategoryError
from grasptransfer.perception.estimate import Estimator
from grasptransfer.poses import load_pose
from grasptransfer.report.result_files import check_folder
from grasptransfer.report.transfer_files import TransferOutcome, execute_best, write_outcome
from grasptransfer.transfer import GraspTransfer

CATEGORY = "mug"
EXECUTED = 3


def run_demo(
    out: Path,
    *,
    seed: int = 0,
    estimator: str | Estimator = "rgb",
    on_stage: Callable[[str], None] = lambda stage: None,
) -> TransferOutcome:
    """Transfer grasps to the mug in the bundled picture, execute the best, and write the report.

    Args:
        out: folder for report.html, grasps.yaml and reconstruction.glb.
        seed: of everything random.
        estimator: as of `transfer_grasps`.
        on_stage: is called with one line that says what is done next.

    Raises:
        GraspTransferError: `out` is a file, or something of the bundled files is missing.
    """
    check_folder(Path(out), "out")
    on_stage("loading the mug category")
    category = load_category(CATEGORY)
    folder = category.folder / "demo"
    camera = Camera.load(folder / "camera.yaml")
    flow = GraspTransfer(category, estimator=estimator, seed=seed)
    on_stage("transferring grasps to the mug in the picture")
    known = {"camera": camera, "mask": _known(folder / "box.yaml", "box")}
    result = flow.transfer(folder / "picture.png", load_pose(folder / "pose.yaml"), **known)
    on_stage(f"{len(result.usable)} of {len(result.grasps)} grasps pass the checks; executing the best")
    true_mesh = category.instance_mesh(_known(folder / "truth.yaml", "instance"))
    trials = execute_best(result, true_mesh, load_pose(folder / "truth.yaml"), most=EXECUTED, seed=seed)
    on_stage("writing the report")
    return write_outcome(result, trials, true_mesh, Path(out))


def _known(path: Path, key: str):
    data = read_yaml(path, error=CategoryError)
    if key not in data:
        raise CategoryError("is missing", path=path, key=key)
    return data[key]

"""`grasptransfer convert | frames`: grasp files and the frames they are given in."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.console import Console
from tyro.conf import Positional, arg

if TYPE_CHECKING:
    from grasptransfer.grasping import Gripper

console = Console(markup=False)


def convert(
    source: Positional[Annotated[Path, arg(metavar="IN")]],
    target: Positional[Annotated[Path, arg(metavar="OUT")]],
    *,
    gripper: str | None = None,
    pose: Path | None = None,
) -> int:
    """Convert a grasp file by its suffix: isaac_grasp YAML, ACRONYM h5, graspnetAPI npy or GraspGen JSON.

    Args:
        source: file to read.
        target: file to write.
        gripper: gripper whose frames a foreign format uses; default: the one that the file names, or panda.
        pose: pose file of the object, which takes grasps in the camera frame to the object frame.
    """
    from grasptransfer.grasping.formats import convert as convert_file
    from grasptransfer.poses import load_pose

    camera_from_object = None if pose is None else load_pose(pose)
    count = convert_file(source, target, gripper=gripper, camera_from_object=camera_from_object)
    console.print(f"{count} grasps: {target}", soft_wrap=True)
    return 0


def frames(
    gripper: Positional[Annotated[str, arg(metavar="[GRIPPER]")]] = "panda",
    *,
    picture: Path | None = None,
    boxes: bool = False,
) -> int:
    """Print the frames of a gripper, and draw them; `all` prints one line for each shipped gripper.

    Args:
        gripper: name of a gripper, your own YAML file, or `all`.
        picture: PNG file for a drawing of the gripper and its frames; with `all`, a folder.
        boxes: also execute grasps of three boxes: 20 mm, 50 mm and nine tenths of the largest opening wide.
    """
    from grasptransfer.grasping import list_grippers, load_gripper
    from grasptransfer.grasping.frames_table import draw_frames, frames_table, hand_line

    loaded = [load_gripper(name) for name in (list_grippers() if gripper == "all" else [gripper])]
    for each in loaded:
        lines = [hand_line(each) if gripper == "all" else frames_table(each)]
        lines += _box_lines(each) if boxes else []
        console.print("\n".join(lines), soft_wrap=True, highlight=False)
        if picture is not None:
            path = picture / f"{each.name}.png" if gripper == "all" else picture
            draw_frames(each, path)
            console.print(f"Picture: {path}", soft_wrap=True)
    return 0


def _box_lines(gripper: "Gripper") -> list[str]:
    from grasptransfer.simulation.boxes import box_widths, hold_boxes

    widths = box_widths(gripper)
    return [
        f"box {1e3 * width:5.1f} mm {trial.status.value}, pads {trial.width_mm:.1f} mm apart: {trial.detail}"
        for width, trial in zip(widths, hold_boxes(gripper, widths), strict=True)
    ]

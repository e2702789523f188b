"""`grasptransfer convert | frames`: grasp files and the frames they are given in."""

from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import Positional, arg

console = Console(markup=False)


def convert(
    source: Positional[Annotated[Path, arg(metavar="IN")]],
    target: Positional[Annotated[Path, arg(metavar="OUT")]],
    *,
    gripper: str | None = None,
    pose: Path | None = None,
) -> int:
    """Convert a grasp file: isaac_grasp YAML, ACRONYM h5, graspnetAPI npy, GraspGen JSON, by suffix.

    Args:
        source: file to read.
        target: file to write.
        gripper: whose frames the foreign formats mean; default: the one that the file names, or panda.
        pose: pose file of the object, to bring grasps of a camera's frame to the object's.
    """
    from grasptransfer.grasping.formats import convert as convert_file
    from grasptransfer.poses import load_pose

    camera_from_object = None if pose is None else load_pose(pose)
    count = convert_file(source, target, gripper=gripper, camera_from_object=camera_from_object)
    console.print(f"{count} grasps: {target}", soft_wrap=True)
    return 0


def frames(
    gripper: Positional[Annotated[str, arg(metavar="[GRIPPER]")]] = "panda", *, picture: Path | None = None
) -> int:
    """Print the frames of a gripper, and draw them.

    Args:
        gripper: name, or YAML of your own.
        picture: PNG to draw the gripper with its frames to.
    """
    from grasptransfer.grasping import load_gripper
    from grasptransfer.grasping.frames_table import frames_table

    loaded = load_gripper(gripper)
    console.print(frames_table(loaded), soft_wrap=True, highlight=False)
    if picture is not None:
        from grasptransfer.grasping.frames_table import draw_frames

        draw_frames(loaded, picture)
        console.print(f"Picture: {picture}", soft_wrap=True)
    return 0

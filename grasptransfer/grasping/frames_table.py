"""The frames of a gripper, as a table and a picture, for people who must agree on them."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import SettingsError
from grasptransfer.files import replacing
from grasptransfer.grasping.gripper import Gripper

PICTURES = ("png", "jpg", "svg", "pdf")
AXIS_LENGTH = 0.04  # m, about a finger's length


def frames_table(gripper: Gripper) -> str:
    """Text table of a gripper's frames, joints and pads."""
    position, rotation = gripper.base_from_tcp[:3, 3], gripper.base_from_tcp[:3, :3]
    low, high = gripper.opening
    meanings = ("closing, from the first pad to the second", "along the pads", "approach")
    rows = [
        f"gripper     {gripper.name}  ({gripper.urdf_path.name})",
        f"base        link {gripper.base_link}",
        f"tcp         at {_numbers(position)} m in the base, between the pads",
    ]
    for i, axis in enumerate("xyz"):
        rows.append(f"  +{axis} tcp    {_numbers(rotation[:, i])} in the base; {meanings[i]}")
    rows.append(f"opening     {low * 1e3:g} to {high * 1e3:g} mm")
    rows.append(f"force       at most {gripper.force_limit:g} N")
    closed, opened = gripper.joint_positions(low), gripper.joint_positions(high)
    for joint in gripper.finger_joints:
        unit = "m" if joint.kind == "prismatic" else "rad"
        rows.append(
            f"joint       {joint.name}: {joint.kind}, {closed[joint.name]:.4f} closed, "
            f"{opened[joint.name]:.4f} {unit} open, {joint.ratio:+g} x driver"
        )
    for pad, side in zip(gripper.pads, ("-x", "+x"), strict=True):
        size = f"{pad.size[0] * 1e3:g} x {pad.size[1] * 1e3:g} mm along tcp y and z"
        rows.append(f"pad {side}      link {pad.link}, {size}")
    for label, width in (("closed", low), ("open", high)):
        first, second = gripper.pad_centres(width)
        rows.append(f"pads {label:<6} at {_numbers(first)} and {_numbers(second)} m in the tcp")
    return "\n".join(rows)


def _numbers(values: Float[np.ndarray, "3"]) -> str:
    return "(" + ", ".join(f"{value + 0.0:.4f}" for value in np.round(values, 6)) + ")"


def draw_frames(gripper: Gripper, path: str | Path) -> Path:
    """Picture of the opened gripper with the TCP's axes: red x closing, green y, blue z approach.

    Raises:
        SettingsError: an unknown kind of picture, or the file cannot be written.
    """
    from matplotlib.figure import Figure

    path = Path(path)
    kind = path.suffix[1:].lower()
    if kind not in PICTURES:
        raise SettingsError("names no kind of picture", path=path, value=path.suffix, choices=PICTURES)
    figure = Figure(figsize=(11, 5.5), layout="constrained")
    for i, (elevation, azimuth, title) in enumerate(((5, -90, "along -y"), (5, 0, "along -x"))):
        axes = figure.add_subplot(1, 2, i + 1, projection="3d", proj_type="ortho")
        _draw(axes, gripper)
        axes.view_init(elevation, azimuth)
        axes.set_title(f"{gripper.name}, {gripper.max_width * 1e3:g} mm open, seen {title}")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110, format=kind)
    return path


def _draw(axes, gripper: Gripper) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    light = np.array([0.35, -0.75, 0.55])
    upright = np.array([1.0, -1.0, -1.0])  # half a turn about x: the approach points down in the picture
    meshes = gripper.link_meshes(gripper.max_width, visual=True)
    for i, mesh in enumerate(meshes.values()):
        shade = (0.55 + 0.45 * np.abs((mesh.face_normals * upright) @ light)).clip(0, 1)
        colour = np.array([0.75, 0.78, 0.82] if i == 0 else [0.45, 0.5, 0.56])
        axes.add_collection3d(Poly3DCollection(mesh.triangles * upright, facecolors=shade[:, None] * colour))
    for direction, colour in zip(np.eye(3) * AXIS_LENGTH * upright, ("red", "green", "blue"), strict=True):
        axes.plot(*np.stack([np.zeros(3), direction]).T, color=colour, linewidth=2.5, zorder=10)
    corners = np.concatenate([mesh.bounds for mesh in meshes.values()]) * upright
    low, high = np.minimum(corners.min(axis=0), -AXIS_LENGTH), corners.max(axis=0)
    half, centre = (high - low).max() / 2, (low + high) / 2
    axes.set(**{f"{name}lim": (centre[i] - half, centre[i] + half) for i, name in enumerate("xyz")})
    axes.set(xlabel="x [m]", zlabel="-z [m]", xticks=[-0.05, 0, 0.05], yticks=[], zticks=[0, 0.05, 0.1])
    axes.set_box_aspect((1, 1, 1))

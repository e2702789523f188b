"""The frames of a gripper, as a table and a picture, for people who must agree on them."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import SettingsError
from grasptransfer.files import replacing
from grasptransfer.grasping.gripper import Gripper

PICTURES = ("png", "jpg", "svg", "pdf")
AXES = ("tab:red", "tab:green", "tab:blue")
HAND, FINGER = np.array([0.78, 0.81, 0.85]), np.array([0.47, 0.56, 0.68])
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
    rows.append(f"opening     {round(low * 1e3, 2):g} to {round(high * 1e3, 2):g} mm")
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
        places = f"{_numbers(first)} and {_numbers(second)} m in the tcp"
        rows.append(f"pads {label:<6} at {places}{_tilts(gripper, width)}")
    return "\n".join(rows)


def hand_line(gripper: Gripper) -> str:
    """One line: name, opening, force, and where the TCP is in the base."""
    low, high = (1e3 * value for value in gripper.opening)
    position = _numbers(gripper.base_from_tcp[:3, 3])
    stroke, force = f"{low:.0f} to {high:.0f} mm", f"{gripper.force_limit:g} N"
    return f"{gripper.name:<20}{stroke:<17}{force:<7}tcp at {position} m in {gripper.base_link}"


def _tilts(gripper: Gripper, width: float) -> str:
    """How far the faces are turned from square to the closing axis, where they are."""
    cosines = np.abs(gripper.pad_faces(np.array([width])).normals[0, :, 0])
    first, second = np.degrees(np.arccos(np.clip(cosines, 0, 1)))
    return f", turned by {first:.0f} and {second:.0f} degrees" if max(first, second) >= 0.5 else ""


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
    figure = Figure(figsize=(10, 6), layout="constrained")
    figure.suptitle(f"{gripper.name}, {gripper.max_width * 1e3:g} mm open; axes of the TCP, lengths in mm")
    front, side = figure.subplots(1, 2, sharey=True)
    _draw(front, gripper, across=0, name="seen along -y")
    _draw(side, gripper, across=1, name="seen along +x")
    front.set_ylabel("z: approach, down")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110, format=kind)
    return path


def _draw(axes: Any, gripper: Gripper, *, across: int, name: str) -> None:
    """One side view: TCP axis `across` to the right, z down."""
    from matplotlib.collections import PolyCollection

    look = np.cross(np.eye(3)[across], [0.0, 0.0, 1.0])  # right x down = forward
    meshes = gripper.link_meshes(gripper.max_width, visual=True)
    pads = gripper.finger_links - {gripper.base_link}
    corners, colours, depths = [], [], []
    for link, mesh in meshes.items():
        facing = mesh.face_normals @ look < 0
        shade = 0.55 + 0.45 * np.abs(mesh.face_normals[facing] @ [0.25, 0.25, 0.93])
        shade = np.maximum(shade, 0.55 + 0.35 * np.abs(mesh.face_normals[facing] @ look))
        corners.append(mesh.triangles[facing][:, :, [across, 2]] * 1e3)
        colours.append(shade[:, None] * (FINGER if link in pads else HAND))
        depths.append(mesh.triangles_center[facing] @ look)
    nearest_last = np.argsort(-np.concatenate(depths), kind="stable")
    filled = np.concatenate(colours)[nearest_last]
    triangles = list(np.concatenate(corners)[nearest_last])
    axes.add_collection(PolyCollection(triangles, facecolors=filled, edgecolors=filled))
    for axis, colour, label in ((across, AXES[across], "xyz"[across]), (2, AXES[2], "z")):
        tip = np.array([AXIS_LENGTH, 0.0] if axis == across else [0.0, AXIS_LENGTH]) * 1e3
        axes.annotate("", tip, (0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.5})
        axes.annotate(label, tip, (6, 6), textcoords="offset points", color=colour, fontsize=13)
    low, high = np.min([mesh.bounds[0] for mesh in meshes.values()], axis=0) * 1e3, AXIS_LENGTH * 1e3
    reach = max(np.abs([mesh.bounds[:, across] for mesh in meshes.values()]).max() * 1e3, high) + 15
    axes.set(xlim=(-reach, reach), ylim=(high + 15, low[2] - 15), aspect="equal", title=name)
    axes.set_xlabel(f"{'xyz'[across]}{': closing' if across == 0 else ''}")
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)

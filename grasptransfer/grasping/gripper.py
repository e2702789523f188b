"""A two-finger gripper, read from a URDF and a small YAML beside it.

Frames: `base` is the URDF link the robot's wrist carries; `gripper` is the TCP, between the finger
pads, +z approach, +x closing. `base_from_tcp` is fixed: where a linkage moves its pads along the
approach while it closes (Robotiq 2F-85), the TCP stays.

The opening is the distance between the two pad faces [m]. Joints follow a single driver,
`joint = ratio * driver + offset`; the opening that belongs to a driver value comes from forward
kinematics, so prismatic fingers and linkages are described alike.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GripperError
from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping.gripper_file import check_against_urdf, read_gripper_file
from grasptransfer.grasping.urdf_geometry import FingerLink, read_links

if TYPE_CHECKING:
    import trimesh

GRIPPER_FOLDER = Path(__file__).parent / "grippers"
APPROACH_CLEARANCE = 0.01  # m each side: room for the usual pose error of a seen object
TABLE_SAMPLES = 65  # a linkage's opening curve is smooth; interpolation errs by microns
FAR_FROM_TCP = 0.03  # m; a linkage moves the middle of the pads by 1 cm


@dataclass(frozen=True)
class Pad:
    """The flat inner face of a finger.

    Args:
        link: URDF link that carries it.
        centre: face centre in the link's frame [m].
        size: extent along TCP y and TCP z [m].
    """

    link: str
    centre: Float[np.ndarray, "3"]
    size: tuple[float, float]


@dataclass(frozen=True)
class FingerJoint:
    """A URDF joint that follows the driver: `joint = ratio * driver + offset`."""

    name: str
    ratio: float
    offset: float
    kind: str


@dataclass(frozen=True, eq=False)
class Gripper:
    """A two-finger gripper; build it with `load_gripper`. Compared and hashed by identity.

    Args:
        name: its name.
        path: the YAML file it was read from.
        urdf_path: its URDF.
        base_link: URDF link that the wrist carries.
        base_from_tcp: rigid transform (4, 4) [m].
        finger_joints: joints that open and close it; the first one drives.
        opening: smallest and largest distance between the pads [m].
        force_limit: largest grip force [N].
        pads: the pad on the TCP's -x side, then the one on its +x side.
        links: geometry and kinematic chain of every link below the base.
        driver_table, opening_table: driver values and the openings that belong to them.
    """

    name: str
    path: Path
    urdf_path: Path
    base_link: str
    base_from_tcp: Float[np.ndarray, "4 4"]
    finger_joints: tuple[FingerJoint, ...]
    opening: tuple[float, float]
    force_limit: float
    pads: tuple[Pad, Pad]
    links: tuple[FingerLink, ...] = field(repr=False)
    driver_table: Float[np.ndarray, "t"] = field(repr=False)
    opening_table: Float[np.ndarray, "t"] = field(repr=False)

    @property
    def max_width(self) -> float:
        """Largest opening [m]."""
        return self.opening[1]

    def joint_positions(self, width: float) -> dict[str, float]:
        """Joint values, metres or radians, that put the pads `width` [m] apart.

        Raises:
            GripperError: the width lies outside the opening range.
        """
        low, high = self.opening
        if not low - 1e-6 <= width <= high + 1e-6:
            raise GripperError(
                f"opening must lie between {low:g} and {high:g} m", key="width", value=float(width)
            )
        driver = float(np.interp(width, self.opening_table, self.driver_table))
        return {joint.name: joint.ratio * driver + joint.offset for joint in self.finger_joints}

    def link_poses(self, width: float) -> dict[str, Float[np.ndarray, "4 4"]]:
        """`tcp_from_link` of every link at this opening [m]."""
        tcp_from_base, positions = invert(self.base_from_tcp), self.joint_positions(width)
        return {link.name: tcp_from_base @ link.base_from_link(positions) for link in self.links}

    def link_meshes(self, width: float, *, visual: bool = False) -> "dict[str, trimesh.Trimesh]":
        """Mesh of every link that has geometry, in the TCP frame [m], at this opening [m]."""
        meshes = {}
        for link in self.links:
            mesh = link.visual if visual else link.collision
            if mesh is not None:
                meshes[link.name] = mesh.copy()
        poses = self.link_poses(width)
        for name, mesh in meshes.items():
            mesh.apply_transform(poses[name])
        return meshes

    def pad_centres(self, width: float) -> Float[np.ndarray, "2 3"]:
        """Centres of the two pad faces (-x, +x) in the TCP frame [m]."""
        poses = self.link_poses(width)
        return np.stack([transform_points(poses[pad.link], pad.centre) for pad in self.pads])

    def pad_heights(self, widths: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g 2"]:
        """z of the two pad centres in the TCP frame at each opening [m]; a linkage moves them."""
        low, high = self._height_table.T
        return np.stack([np.interp(widths, self.opening_table, pad) for pad in (low, high)], axis=1)

    @cached_property
    def _height_table(self) -> Float[np.ndarray, "t 2"]:
        widths = np.clip(self.opening_table, *self.opening)
        return np.stack([self.pad_centres(width)[:, 2] for width in widths])

    def approach_opening(self, width: float) -> float:
        """Opening [m] with which to approach something `width` [m] wide: 1 cm of room on each side."""
        return float(np.clip(width + 2 * APPROACH_CLEARANCE, *self.opening))


def list_grippers() -> list[str]:
    """Names of the grippers that come along."""
    return sorted(path.stem for path in GRIPPER_FOLDER.glob("*.yaml"))


def load_gripper(name_or_path: str | Path) -> Gripper:
    """A gripper by name, or from a YAML file of your own beside its URDF.

    Raises:
        GripperError: unknown name, or a mistake in the YAML or URDF.
    """
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml"):
        return _read(path)
    if str(name_or_path) not in list_grippers():
        raise GripperError(
            "is not a known gripper",
            key="gripper",
            value=str(name_or_path),
            choices=list_grippers(),
            fix="Give the path of a YAML file for a gripper of your own",
        )
    return _packaged(str(name_or_path))


@lru_cache(maxsize=16)
def _packaged(name: str) -> Gripper:
    return _read(GRIPPER_FOLDER / f"{name}.yaml")


def _read(path: Path) -> Gripper:
    model = read_gripper_file(path)
    urdf_path = (path.parent / model.urdf).resolve()
    links = read_links(urdf_path, model.base_link)
    by_name = {joint.name: joint for link in links for joint in link.chain if joint.kind != "fixed"}
    check_against_urdf(model, by_name, [link.name for link in links], path)
    joints = tuple(
        FingerJoint(name, joint.ratio, joint.offset, by_name[name].kind)
        for name, joint in model.joints.items()
    )
    first, second = (Pad(pad.link, np.array(pad.centre), pad.size) for pad in model.pads)
    base_from_tcp = model.base_from_tcp.matrix()
    base_from_tcp.setflags(write=False)
    limits = by_name[joints[0].name].limits
    drivers, openings = _opening_table(joints, limits, links, (first, second), base_from_tcp)
    gripper = Gripper(
        name=model.name,
        path=path,
        urdf_path=urdf_path,
        base_link=model.base_link,
        base_from_tcp=base_from_tcp,
        finger_joints=joints,
        opening=_opening_range(model.opening, openings, path),
        force_limit=model.force_limit,
        pads=(first, second),
        links=links,
        driver_table=drivers,
        opening_table=openings,
    )
    _check_tcp(gripper)
    return gripper


def _check_tcp(gripper: Gripper) -> None:
    """Refuse a TCP that is not between the pads: grasps would be planned beside the object."""
    for width in gripper.opening:
        middle = gripper.pad_centres(width).mean(axis=0)
        if np.linalg.norm(middle) > FAR_FROM_TCP:
            raise GripperError(
                f"the middle of the pads is {1e3 * np.linalg.norm(middle):.0f} mm away from the TCP",
                path=gripper.path,
                key="base_from_tcp",
                value=np.round(middle, 4).tolist(),
                fix="Put the TCP between the pads, in metres, and pads.centre on their faces",
            )


def _opening_table(
    finger_joints: tuple[FingerJoint, ...],
    limits: tuple[float, float],
    links: tuple[FingerLink, ...],
    pads: tuple[Pad, Pad],
    base_from_tcp: Float[np.ndarray, "4 4"],
) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t"]]:
    """Driver values and the openings that belong to them, from closed to open."""
    first = finger_joints[0]
    start, stop = ((limit - first.offset) / first.ratio for limit in limits)
    drivers = np.linspace(start, stop, TABLE_SAMPLES)
    chains = {link.name: link for link in links}
    tcp_from_base, openings = invert(base_from_tcp), []
    for driver in drivers:
        positions = {joint.name: joint.ratio * driver + joint.offset for joint in finger_joints}
        low, high = (
            transform_points(tcp_from_base @ chains[pad.link].base_from_link(positions), pad.centre)
            for pad in pads
        )
        openings.append(high[0] - low[0])
    if openings[0] > openings[-1]:
        drivers, openings = drivers[::-1].copy(), openings[::-1]
    return drivers, np.array(openings)


def _opening_range(
    wanted: tuple[float, float], table: Float[np.ndarray, "t"], path: Path
) -> tuple[float, float]:
    if table[-1] <= 0 or np.any(np.diff(table) <= 0):
        raise GripperError(
            "pads do not move apart along TCP x when the driver moves",
            path=path,
            key="pads",
            value=[round(float(table[0]), 4), round(float(table[-1]), 4)],
            fix="List the -x pad first, and check base_from_tcp and the ratios of the joints",
        )
    if wanted[0] < table[0] - 1e-3 or wanted[1] > table[-1] + 1e-3:
        raise GripperError(
            f"the URDF's joint limits allow {table[0]:.4f} to {table[-1]:.4f} m",
            path=path,
            key="opening",
            value=list(wanted),
        )
    return max(wanted[0], float(table[0])), min(wanted[1], float(table[-1]))

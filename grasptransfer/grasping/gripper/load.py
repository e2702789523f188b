"""Load a gripper: its YAML and URDF read together, and everything that planning relies on checked."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GripperError
from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping.gripper.coupling import FingerJoint, check_limits, couple, driver_range
from grasptransfer.grasping.gripper.description import GripperModel, read_gripper_file
from grasptransfer.grasping.gripper.links import FingerLink, read_links
from grasptransfer.grasping.gripper.model import Gripper
from grasptransfer.grasping.gripper.pads import (
    SIDE,
    Pad,
    PadTable,
    body_of_pad,
    check_pads,
    check_surface,
    pad_normal,
    pad_table,
)

GRIPPER_FOLDER = Path(__file__).parent.parent / "grippers"
TABLE_SAMPLES = 65  # a linkage's opening curve is smooth; interpolation errs by microns
LARGEST_EXCESS = 1e-3  # m by which a rounded largest opening may exceed what the joints allow
SMALLEST_EXCESS = 2e-3  # m by which the smallest may: it is then what the joints allow


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
    links = _links(model, urdf_path, path)
    by_name = {link.name: link for link in links}
    _check_pad_links(model, by_name, path)
    moving = {joint.name: joint for link in links for joint in link.chain if joint.kind != "fixed"}
    joints = couple(model.joints, moving, path=path)
    base_from_tcp = model.base_from_tcp.matrix()
    base_from_tcp.setflags(write=False)
    motion = _Motion(invert(base_from_tcp), by_name, joints)
    drivers, openings = _opening_table(joints, motion.opening_of(model), model, urdf_path, path)
    limits = _opening_range(model.opening, openings, path)
    closed, opened = (float(np.interp(limit, openings, drivers)) for limit in limits)
    joints = check_limits(joints, moving, (closed, opened), urdf_path=urdf_path)
    pads = _pads(model, by_name, motion.tcp_from_link, np.linspace(closed, opened, 9), path)
    gripper = Gripper(
        name=model.name,
        path=path,
        urdf_path=urdf_path,
        base_link=model.base_link,
        base_from_tcp=base_from_tcp,
        finger_joints=joints,
        opening=limits,
        force_limit=model.force_limit,
        pads=pads,
        links=links,
        driver_table=drivers,
        opening_table=openings,
    )
    _check_approach(gripper)
    _check_geometry(gripper)
    return gripper


def _links(model: GripperModel, urdf_path: Path, path: Path) -> tuple[FingerLink, ...]:
    try:
        return read_links(
            urdf_path, model.base_link, ignored=model.ignore_links, solid_visuals=model.solid_visuals
        )
    except GripperError as error:
        raise error if error.path is not None else error.at(path) from error


@dataclass(frozen=True)
class _Motion:
    """Where the links stand at a value of the driver.

    Args:
        tcp_from_base: the TCP's frame from that of the base.
        links: the links by name.
        joints: the joints that the driver moves.
    """

    tcp_from_base: Float[np.ndarray, "4 4"]
    links: dict[str, FingerLink]
    joints: tuple[FingerJoint, ...]

    def tcp_from_link(self, name: str, driver: float) -> Float[np.ndarray, "4 4"]:
        positions = {joint.name: joint.position(driver) for joint in self.joints}
        return self.tcp_from_base @ self.links[name].base_from_link(positions)

    def opening_of(self, model: GripperModel) -> Callable[[float], float]:
        """The distance between the pads' centres along TCP x [m], as a function of the driver."""
        ends = [(pad.link, np.array(pad.centre)) for pad in model.pads]

        def opening(driver: float) -> float:
            low, high = (transform_points(self.tcp_from_link(link, driver), centre) for link, centre in ends)
            return float(high[0] - low[0])

        return opening


def _check_pad_links(model: GripperModel, links: dict[str, FingerLink], path: Path) -> None:
    for i, pad in enumerate(model.pads):
        if pad.link not in links:
            raise GripperError(
                "is not a link below the base link",
                path=path,
                key=f"pads.{i}.link",
                value=pad.link,
                choices=links,
            )


def _opening_table(
    joints: tuple[FingerJoint, ...],
    opening: Callable[[float], float],
    model: GripperModel,
    urdf_path: Path,
    path: Path,
) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t"]]:
    """Driver values and the openings that belong to them, rising, over the stretch that is wanted."""

    def table(start: float, stop: float) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t"]]:
        drivers = np.linspace(start, stop, TABLE_SAMPLES)
        openings = np.array([opening(driver) for driver in drivers])
        return (drivers[::-1].copy(), openings[::-1]) if openings[0] > openings[-1] else (drivers, openings)

    drivers, openings = table(*driver_range(joints, urdf_path))
    if openings.max() <= 0 or np.ptp(openings) < 1e-6:
        raise GripperError(
            "pads do not move apart along TCP x when the driver moves",
            path=path,
            key="pads",
            value=[round(float(openings[0]), 4), round(float(openings[-1]), 4)],
            fix="List the -x pad first, and check base_from_tcp and the ratios of the joints",
        )
    if np.all(np.diff(openings) > 0):
        return drivers, openings
    for first, last in _monotone_stretches(openings):
        low, high = sorted((openings[first], openings[last]))
        if low <= model.opening[0] + SMALLEST_EXCESS and high >= model.opening[1] - LARGEST_EXCESS:
            return table(drivers[first], drivers[last])
    turns = [f"{1e3 * openings[i]:.1f}" for i in (0, *(last for _, last in _monotone_stretches(openings)))]
    raise GripperError(
        f"along its joint the distance between the pads goes {' to '.join(turns)} mm: "
        "no stretch on which it only rises covers what is wanted",
        path=path,
        key="opening",
        value=list(model.opening),
    )


def _monotone_stretches(values: Float[np.ndarray, "t"]) -> list[tuple[int, int]]:
    """First and last index of every stretch that only rises or only falls."""
    signs = np.sign(np.diff(values))
    ends = [0, *(int(i) + 1 for i in np.flatnonzero(signs[1:] != signs[:-1])), len(values) - 1]
    return list(itertools.pairwise(ends))


def _opening_range(
    wanted: tuple[float, float], table: Float[np.ndarray, "t"], path: Path
) -> tuple[float, float]:
    if wanted[0] < table[0] - SMALLEST_EXCESS or wanted[1] > table[-1] + LARGEST_EXCESS:
        raise GripperError(
            f"the URDF's joint limits allow {table[0]:.4f} to {table[-1]:.4f} m",
            path=path,
            key="opening",
            value=list(wanted),
        )
    return max(wanted[0], float(table[0])), min(wanted[1], float(table[-1]))


def _pads(
    model: GripperModel,
    links: dict[str, FingerLink],
    tcp_from_link: Callable[[str, float], Float[np.ndarray, "4 4"]],
    drivers: Float[np.ndarray, "d"],
    path: Path,
) -> tuple[Pad, Pad]:
    """Both pads, each with the direction in which it faces."""
    pads = []
    for i, pad in enumerate(model.pads):
        centre = np.array(pad.centre)
        if pad.normal is None:
            poses = [tcp_from_link(pad.link, float(driver)) for driver in drivers]
            normal = pad_normal(links[pad.link], centre, SIDE[i], poses, path=path, key=f"pads.{i}")
        else:
            normal = np.array(pad.normal) / np.linalg.norm(pad.normal)
        pads.append(Pad(pad.link, centre, pad.size, normal))
    return pads[0], pads[1]


def _check_approach(gripper: Gripper) -> None:
    """Refuse a TCP whose approach points from the object into the palm."""
    palm = gripper.link_meshes(gripper.max_width, visual=True).get(gripper.base_link)
    beyond = (
        0.0
        if palm is None
        else float(palm.bounds.mean(axis=0)[2] - gripper.pad_centres(gripper.max_width)[:, 2].mean())
    )
    if beyond > 0:
        raise GripperError(
            f"the base is {1e3 * beyond:.0f} mm beyond the pads along TCP z, which must point away from it",
            path=gripper.path,
            key="base_from_tcp.orientation",
            fix="Turn the TCP: +z is the approach, from the palm to the object",
        )


def _check_geometry(gripper: Gripper) -> None:
    """Refuse pads that do not face each other, or that are not on solid fingers."""
    widths = np.linspace(*gripper.opening, 9)
    table: PadTable = pad_table(gripper.pads, widths, gripper.link_poses)
    check_pads(gripper.pads, table, gripper.path)
    by_name = {link.name: link for link in gripper.links}
    poses = gripper.link_poses(gripper.opening[0])
    for i, pad in enumerate(gripper.pads):
        body = body_of_pad(by_name[pad.link], gripper.links)
        if body is None:
            raise GripperError(
                "nothing that moves with this pad has <collision> geometry: it would pass through everything",
                path=gripper.path,
                key=f"pads.{i}.link",
                value=pad.link,
                fix=f"Give it one, or add solid_visuals: [{pad.link}] to collide with its <visual>",
            )
        check_surface(pad, body, invert(poses[pad.link]), path=gripper.path, key=f"pads.{i}")

"""How the finger joints follow one driver: the URDF's `<mimic>`, completed by the YAML, and their limits."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasptransfer.errors import GripperError
from grasptransfer.grasping.gripper.description import JointModel
from grasptransfer.grasping.gripper.links import Joint

LOG = logging.getLogger(__name__)
SAME_RATIO = 1e-3  # share of the ratio, or of 1: typed-in ratios carry three or four digits
SAME_OFFSET = 1e-3  # rad or m, likewise
# Limits are typed with three or four digits, too.
LIMIT_TOLERANCE = {"prismatic": 1e-4, "revolute": 2e-3, "continuous": 2e-3}  # m, rad


@dataclass(frozen=True)
class FingerJoint:
    """A URDF joint that follows the driver: `joint = ratio * driver + offset`.

    Args:
        limits: lower and upper value [m or rad]; None without limits.
    """

    name: str
    ratio: float
    offset: float
    kind: str
    limits: tuple[float, float] | None = None

    def position(self, driver: float) -> float:
        """Value of the joint at this value of the driver [m or rad]."""
        return self.ratio * driver + self.offset


def couple(
    given: Mapping[str, JointModel], moving: Mapping[str, Joint], *, path: Path
) -> tuple[FingerJoint, ...]:
    """Ratio and offset of every moving joint; the first of them drives.

    Args:
        given: the YAML's joints, the driver first; it may leave out what the URDF's `<mimic>` says.
        moving: the URDF's moving joints below the base link, by name.
        path: the YAML.

    Raises:
        GripperError: an unknown joint, one without a motion, or a contradiction of YAML and URDF.
    """
    for name in given:
        if name not in moving:
            raise GripperError(
                "is not a moving joint below the base link", path=path, key=f"joints.{name}", choices=moving
            )
    if not moving:
        raise GripperError("no joint below the base link moves", path=path, key="base_link")
    leaders = {name: _leader(joint, moving, path) for name, joint in moving.items()}
    groups: dict[str, list[str]] = {}
    for name, (leader, _, _) in leaders.items():
        groups.setdefault(leader, []).append(name)
    found: dict[str, tuple[float, float]] = {}
    # First those whose <mimic> names a joint elsewhere: where their motion is given nowhere, that is why.
    for leader, members in sorted(groups.items(), key=lambda group: moving[group[0]].mimic is None):
        ratio, offset = _of_leader(leader, members, given, leaders, moving, path)
        for name in members:
            _, times, plus = leaders[name]
            found[name] = _agreed(name, times * ratio, times * offset + plus, given.get(name), path)
    followers = [name for name in moving if leaders[name][0] != name]
    order = dict.fromkeys([*given, *(name for name in moving if name not in followers), *followers])
    first = next(iter(order))
    if found[first][0] == 0:
        raise GripperError("the driver's ratio must not be 0", path=path, key=f"joints.{first}")
    return tuple(
        FingerJoint(name, found[name][0], found[name][1], moving[name].kind, moving[name].limits)
        for name in order
    )


def _leader(joint: Joint, moving: Mapping[str, Joint], path: Path) -> tuple[str, float, float]:
    """The joint at the end of a chain of `<mimic>`, with ratio and offset to it."""
    ratio, offset, seen, name = 1.0, 0.0, {joint.name}, joint.name
    while (mimic := joint.mimic) is not None and mimic.joint in moving:
        if mimic.joint in seen:
            raise GripperError("<mimic> goes round in a circle", path=path, key=f"joints.{name}")
        seen.add(mimic.joint)
        ratio, offset = ratio * mimic.ratio, ratio * mimic.offset + offset
        joint = moving[mimic.joint]
    return joint.name, ratio, offset


def _of_leader(
    leader: str,
    members: list[str],
    given: Mapping[str, JointModel],
    leaders: Mapping[str, tuple[str, float, float]],
    moving: Mapping[str, Joint],
    path: Path,
) -> tuple[float, float]:
    """Ratio and offset of a joint that follows no other, from whichever of its followers the YAML gives."""
    listed = [name for name in given if name in members]
    if not listed and len(members) < len(leaders):
        raise GripperError(
            "moves below the base link and must be listed, with its ratio to the driver",
            path=path,
            key=f"joints.{leader}",
            fix=_why_not_told(moving[leader]) + "A ratio of 0 is for a joint that stands still",
        )
    if not listed:
        return 1.0, 0.0
    name = leader if leader in listed else listed[0]
    _, times, plus = leaders[name]
    if times == 0:
        raise GripperError("its <mimic> has multiplier 0: it cannot drive", path=path, key=f"joints.{name}")
    ratio, offset = given[name].ratio, given[name].offset
    return (times if ratio is None else ratio) / times, 0.0 if offset is None else (offset - plus) / times


def _why_not_told(joint: Joint) -> str:
    if joint.mimic is None:
        return ""
    return f"It follows {joint.mimic.joint}, which does not move below the base link. "


def _agreed(
    name: str, ratio: float, offset: float, given: JointModel | None, path: Path
) -> tuple[float, float]:
    """What the YAML gives, where it agrees with the URDF; else the URDF's."""
    given = given or JointModel()
    own = ratio if given.ratio is None else given.ratio, offset if given.offset is None else given.offset
    wrong_ratio = abs(own[0] - ratio) > SAME_RATIO * max(1.0, abs(ratio))
    if wrong_ratio or abs(own[1] - offset) > SAME_OFFSET:
        raise GripperError(
            f"the URDF's <mimic> gives ratio {ratio:g} and offset {offset:g}",
            path=path,
            key=f"joints.{name}",
            value=f"ratio {own[0]:g}, offset {own[1]:g}",
            fix="Leave the joint out of the file: the URDF gives its motion",
        )
    return own


def driver_range(joints: Iterable[FingerJoint], urdf_path: Path) -> tuple[float, float]:
    """Values of the driver that its own limits allow; without limits, those of its followers.

    Raises:
        GripperError: no joint has limits.
    """
    joints = tuple(joints)
    for joint in joints:
        if joint.limits is not None and joint.ratio != 0:
            start, stop = ((limit - joint.offset) / joint.ratio for limit in joint.limits)
            return start, stop
    if any(joint.kind == "continuous" for joint in joints):
        return -np.pi, np.pi
    raise GripperError("joint needs rising lower and upper limits", path=urdf_path, key=joints[0].name)


def check_limits(
    joints: Iterable[FingerJoint],
    moving: Mapping[str, Joint],
    drivers: tuple[float, float],
    *,
    urdf_path: Path,
) -> tuple[FingerJoint, ...]:
    """The joints, each with limits that allow what its ratio asks of it over the wanted opening.

    Some published URDFs write the limits of a joint that turns the other way without its sign. A joint
    with a `<mimic>` whose limits fit when mirrored gets them mirrored, with a warning.

    Args:
        moving: the URDF's moving joints, by name.
        drivers: values of the driver at the smallest and the largest wanted opening.

    Raises:
        GripperError: limits that do not allow it, with the needed range.
    """
    checked = []
    for joint in joints:
        needed = sorted(joint.position(driver) for driver in drivers)
        limits = joint.limits
        if limits is None and joint.kind != "continuous" and joint.ratio != 0:
            limits = (needed[0] - LIMIT_TOLERANCE[joint.kind], needed[1] + LIMIT_TOLERANCE[joint.kind])
        if limits is not None and not _within(needed, limits, joint.kind):
            mirrored = (-limits[1], -limits[0])
            if moving[joint.name].mimic is None or not _within(needed, mirrored, joint.kind):
                raise GripperError(
                    f"its limits do not allow what its ratio {joint.ratio:g} asks of it: "
                    f"it has to move from {needed[0]:.4g} to {needed[1]:.4g}",
                    path=urdf_path,
                    key=joint.name,
                    value=list(limits),
                    fix="Correct its <limit>, or ask for a smaller opening",
                )
            LOG.warning(
                "%s: %s: limits %g to %g are taken with the other sign, as its <mimic> asks", urdf_path,
                joint.name, *limits,
            )  # fmt: skip
            limits = mirrored
        checked.append(FingerJoint(joint.name, joint.ratio, joint.offset, joint.kind, limits))
    return tuple(checked)


def _within(needed: list[float], limits: tuple[float, float], kind: str) -> bool:
    slack = LIMIT_TOLERANCE[kind]
    return limits[0] - slack <= needed[0] and needed[1] <= limits[1] + slack

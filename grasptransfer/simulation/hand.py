"""The gripper as the physics sees it: a URDF below its base link, and how its joints share a force."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.grasping.gripper import FingerJoint, FingerLink, Gripper, Joint

if TYPE_CHECKING:
    import trimesh

# Links without mass or moment in the URDF get these [kg], [kg m2]: lighter links shake in the solver.
LEAST_MASS = 0.01
LEAST_MOMENT = 1e-6
# The base gets at least these [kg], [kg m2], because an arm carries it. With a base of 0.14 kg between
# fingers as heavy as their drives, the fingers' coupling errs by 1 mm (OpenManipulator-X). The Panda hand
# weighs 0.73 kg.
LEAST_BASE_MASS, LEAST_BASE_MOMENT = 0.7, 6e-4


@dataclass(frozen=True)
class Hand:
    """A floating gripper, reduced to what a worker process needs.

    Args:
        name: the gripper's.
        urdf: text of a URDF whose root is the base link; mesh files are named by `meshes`.
        meshes: pairs of file name and OBJ text, one pair for each collision mesh.
        base_from_tcp: (4, 4) [m].
        joints: pairs of name and ratio to the driver, one pair for each moving joint, the driver first.
        leaders: for each joint, the number of the joint to which it is geared: the next joint towards the
            base in its own chain, or the driver. A finger's torques are then balanced within that finger,
            and the solver's remaining error in one finger's coupling does not push the other finger.
        drivers, openings: tables of driver values and the pad distances that belong to them [m].
        offsets: one offset for each joint, metres or radians.
        opening: smallest and largest distance between the pads [m].
        narrowest: width of the thinnest object that both pads can touch [m].
        link_names: names of all links, the base first.
        pad_links: names of the links with the -x and the +x pad.
        pad_bodies: names of all links that move with each pad.
        pad_centres: (2, 3) centres of the pads' faces, each in its link's frame [m].
        pads_turn: whether the pads' faces are not always square to TCP x.
        force_limit: largest force of each pad [N].
    """

    name: str
    urdf: str = field(repr=False)
    meshes: tuple[tuple[str, str], ...] = field(repr=False)
    base_from_tcp: Float[np.ndarray, "4 4"]
    joints: tuple[tuple[str, float], ...]
    leaders: tuple[int, ...]
    offsets: tuple[float, ...]
    drivers: Float[np.ndarray, "t"] = field(repr=False)
    openings: Float[np.ndarray, "t"] = field(repr=False)
    opening: tuple[float, float]
    narrowest: float
    link_names: tuple[str, ...]
    pad_links: tuple[str, str]
    pad_bodies: tuple[frozenset[str], frozenset[str]]
    pad_centres: Float[np.ndarray, "2 3"]
    pads_turn: bool
    force_limit: float

    def joint_positions(self, opening: float) -> dict[str, float]:
        """Joint values, metres or radians, at this distance between the pads [m]."""
        driver = float(np.interp(opening, self.openings, self.drivers))
        return {
            name: ratio * driver + offset
            for (name, ratio), offset in zip(self.joints, self.offsets, strict=True)
        }

    def driver_slope(self, opening: float) -> float:
        """Change of the pad distance [m] with the driver's value."""
        return float(np.interp(opening, self.openings, np.gradient(self.openings, self.drivers)))


def hand_of(gripper: Gripper) -> Hand:
    """The gripper as the physics needs it."""
    urdf, meshes = _urdf(gripper)
    moving = [joint for joint in gripper.finger_joints if joint.ratio != 0]
    joints = tuple((joint.name, joint.ratio) for joint in moving)
    first, second = gripper.pads
    return Hand(
        name=gripper.name,
        urdf=urdf,
        meshes=meshes,
        base_from_tcp=np.array(gripper.base_from_tcp),
        joints=joints,
        leaders=_leaders([joint.name for joint in moving], gripper),
        offsets=tuple(joint.offset for joint in moving),
        drivers=np.array(gripper.driver_table),
        openings=np.array(gripper.opening_table),
        opening=gripper.opening,
        narrowest=gripper.narrowest,
        link_names=tuple(link.name for link in gripper.links),
        pad_links=(first.link, second.link),
        pad_bodies=gripper.pad_bodies,
        pad_centres=np.stack([first.centre, second.centre]),
        pads_turn=gripper.pads_turn,
        force_limit=gripper.force_limit,
    )


def _leaders(names: list[str], gripper: Gripper) -> tuple[int, ...]:
    """See `Hand.leaders`."""
    chains = {
        link.chain[-1].name: [joint.name for joint in link.chain] for link in gripper.links if link.chain
    }
    found = []
    for name in names:
        nearer = [other for other in chains[name][:-1] if other in names]
        found.append(names.index(nearer[-1]) if nearer else 0)
    return tuple(found)


def _urdf(gripper: Gripper) -> tuple[str, tuple[tuple[str, str], ...]]:
    """The URDF below the base link, with the collision shapes that `Gripper` read."""
    source = ElementTree.parse(gripper.urdf_path).getroot()
    links = {link.name: link for link in gripper.links}
    coupled = {joint.name: joint for joint in gripper.finger_joints}
    joints = {joint.name: joint for link in gripper.links for joint in link.chain}
    robot, meshes = ElementTree.Element("robot", name=gripper.name), []
    # The root comes first: it becomes the base of the floating body.
    for number, link in enumerate(gripper.links):
        given = next(element for element in source.findall("link") if element.get("name") == link.name)
        element = ElementTree.SubElement(robot, "link", name=link.name)
        element.append(_inertial(given.find("inertial"), is_base=number == 0))
        meshes += _add_shapes(element, link, f"link{number}")
    for joint in source.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        assert parent is not None
        assert child is not None
        if parent.get("link") in links and child.get("link") in links:
            name = str(joint.get("name"))
            robot.append(_joint(joint, joints[name], coupled.get(name)))
    return ElementTree.tostring(robot, encoding="unicode"), tuple(meshes)


def _joint(given: ElementTree.Element, joint: Joint, coupled: FingerJoint | None) -> ElementTree.Element:
    """The URDF's joint with the limits that were checked, without its `<mimic>`; fixed if it stands still."""
    if coupled is None:
        return given
    for mimic in given.findall("mimic"):
        given.remove(mimic)
    if coupled.ratio == 0:
        element = ElementTree.Element("joint", name=joint.name, type="fixed")
        element.append(_origin(joint.parent_from_child(coupled.offset)))
        element.extend(part for part in given if part.tag in ("parent", "child"))
        return element
    limit = given.find("limit")
    if coupled.limits is not None and coupled.limits != joint.limits:
        limit = ElementTree.SubElement(given, "limit") if limit is None else limit
        for side, value in zip(("lower", "upper"), coupled.limits, strict=True):
            limit.set(side, f"{value:.9g}")
    return given


def _origin(parent_from_child: Float[np.ndarray, "4 4"]) -> ElementTree.Element:
    position = " ".join(f"{value:.9g}" for value in parent_from_child[:3, 3])
    angles = Rotation.from_matrix(parent_from_child[:3, :3]).as_euler("xyz")
    return ElementTree.Element("origin", xyz=position, rpy=" ".join(f"{value:.9g}" for value in angles))


def _inertial(given: ElementTree.Element | None, *, is_base: bool) -> ElementTree.Element:
    """Return the URDF's mass and moments, but at least the least ones where they are too small or missing.

    PyBullet fixes a body of mass 0 to the world: a hand of such links could not lift anything.
    """
    least_mass, moment = (LEAST_BASE_MASS, LEAST_BASE_MOMENT) if is_base else (LEAST_MASS, LEAST_MOMENT)
    mass = 0.0 if given is None else _mass(given)
    if given is not None and _turns_heavily(given) and mass >= (least_mass if is_base else 1e-9):
        return given
    element = ElementTree.Element("inertial")
    origin = None if given is None else given.find("origin")
    if origin is not None:
        element.append(origin)
    ElementTree.SubElement(element, "mass", value=f"{max(mass, least_mass):.9g}")
    moment = f"{moment:.9g}"
    ElementTree.SubElement(element, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")
    return element


def _mass(inertial: ElementTree.Element) -> float:
    mass = inertial.find("mass")
    return 0.0 if mass is None else float(mass.get("value", 0.0))


def _turns_heavily(inertial: ElementTree.Element) -> bool:
    """Whether the link has a moment of inertia about every axis."""
    moments = inertial.find("inertia")
    if moments is None:
        return False
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    xx, yy, zz, xy, xz, yz = (float(moments.get(key, 0)) for key in keys)
    return bool(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0] > 0)


def _add_shapes(element: ElementTree.Element, link: FingerLink, stem: str) -> list[tuple[str, str]]:
    """Collision elements of the link's shapes; returns the files of its meshes, named after `stem`."""
    files = []
    for i, shape in enumerate(link.shapes):
        collision = ElementTree.SubElement(element, "collision")
        collision.append(_origin(shape.link_from_shape))
        geometry = ElementTree.SubElement(collision, "geometry")
        if shape.kind == "box":
            ElementTree.SubElement(geometry, "box", size=" ".join(f"{value:.9g}" for value in shape.size))
        elif shape.kind == "cylinder":
            radius, length = shape.size
            ElementTree.SubElement(geometry, "cylinder", radius=f"{radius:.9g}", length=f"{length:.9g}")
        elif shape.kind == "sphere":
            ElementTree.SubElement(geometry, "sphere", radius=f"{shape.size[0]:.9g}")
        else:
            name = f"{stem}_{i}.obj"
            ElementTree.SubElement(geometry, "mesh", filename=name)
            files.append((name, _wavefront(shape.mesh)))
    return files


def _wavefront(mesh: "trimesh.Trimesh") -> str:
    """A convex part as text of an OBJ file."""
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*vertex) for vertex in mesh.vertices]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    return "\n".join(lines) + "\n"

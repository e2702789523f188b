"""Object, gripper, table and what holds them together, as one MuJoCo model.

The gripper is read from the URDF of `Hand`, so that both engines have the same links, masses and shapes.
MuJoCo's contacts are springs. Here they are stiff enough to keep a squeezed object within half a millimetre
of the pads, which is as much as rubber fingers give. With stiffer contacts held objects are lost: two bodies
then touch in one point, and MuJoCo builds no contact patch. With this stiffness 99 % of the perturbed trials
of the annotated grasps end as in PyBullet (634 of 640, `sim_tests/README.md`), and the outcome is the same
with two, four or eight of MuJoCo's steps in one step of the protocol.
"""

# MuJoCo's package has no types.
# pyright: reportAttributeAccessIssue=false

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert, rigid
from grasptransfer.simulation.body import Body
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.protocol import Protocol

OBJECT, TABLE, CARRIER = "object of the trial", "table of the trial", "carrier of the TCP"
# Hand, object and table collide with each other, and none of them with itself.
HAND_BIT, OBJECT_BIT, TABLE_BIT = 1, 2, 4
REFERENCE = (0.00625, 1.0)  # Time constant [s] and damping ratio of contacts, joint limits and the weld.
IMPEDANCE = (0.95, 0.99, 0.001, 0.5, 2.0)
# Impedance of friction over that of the normal force: at 10 a held object creeps out of the pads.
FRICTION_IMPEDANCE = 50.0
# Metal couples joints that follow each other, so their coupling is as stiff as MuJoCo's step allows.
COUPLING, COUPLING_IMPEDANCE = (0.0042, 1.0), (0.999, 0.9999, 0.001, 0.5, 2.0)
STEPS = 2  # MuJoCo's own steps in one time step of the protocol.
TABLE_HALF_SIZE = (1.0, 1.0, 0.1)  # m


def build_model(body: Body, hand: Hand, protocol: Protocol) -> mujoco.MjModel:
    """The model of every trial of this body and this hand."""
    spec = mujoco.MjSpec()
    _set_options(spec, protocol)
    _add_object(spec, body)
    _HandBuilder(spec, hand, protocol).add()
    if protocol.support == "table":
        height = body.lowest - TABLE_HALF_SIZE[2]
        geom = spec.worldbody.add_geom(
            name=TABLE, type=mujoco.mjtGeom.mjGEOM_BOX, size=TABLE_HALF_SIZE, pos=[0, 0, height]
        )
        geom.contype, geom.conaffinity = TABLE_BIT, HAND_BIT | OBJECT_BIT
    return spec.compile()


def _set_options(spec: mujoco.MjSpec, protocol: Protocol) -> None:
    option = spec.option
    option.timestep = protocol.time_step / STEPS
    option.iterations = protocol.solver_iterations
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = FRICTION_IMPEDANCE
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # The model has a dozen degrees of freedom only.
    spec.compiler.degree = False
    spec.compiler.balanceinertia = True  # URDFs break the triangle inequality of moments by rounding


def _add_object(spec: mujoco.MjSpec, body: Body) -> None:
    """Add the object, with its principal axes as body frame, so that damping acts alike along all of them."""
    placed = spec.worldbody.add_body(name=OBJECT, explicitinertial=True)
    placed.mass, placed.inertia = body.mass, body.principal_moments
    placed.add_freejoint()
    for i, (vertices, triangles) in enumerate(body.hulls):
        seen_from_mass = (vertices - body.centre_of_mass) @ body.principal_axes
        _add_mesh(spec, f"part {i}", seen_from_mass, triangles)
        geom = placed.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"part {i}")
        geom.contype, geom.conaffinity = OBJECT_BIT, HAND_BIT | TABLE_BIT
        geom.condim, geom.priority = 4, 1  # The contact takes the object's friction, spinning included.
        geom.solref, geom.solimp = REFERENCE, IMPEDANCE


def _add_mesh(
    spec: mujoco.MjSpec, name: str, vertices: Float[np.ndarray, "v 3"], triangles: np.ndarray
) -> None:
    mesh = spec.add_mesh(name=name)
    mesh.uservert, mesh.userface = vertices.ravel(), triangles.ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # Thin parts have hardly any volume.


class _HandBuilder:
    """Puts the links of a hand's URDF into a model; the base's body has its frame at the TCP.

    MuJoCo moves the origin of a turning body along the tangent: the farther the origin is from the held
    object, the more the object creeps out of the pads in a turn.
    """

    def __init__(self, spec: mujoco.MjSpec, hand: Hand, protocol: Protocol):
        self.spec, self.hand, self.protocol = spec, hand, protocol
        robot = ElementTree.fromstring(hand.urdf)
        self.links = {element.get("name"): element for element in robot.findall("link")}
        self.joints = {child_and_parent(joint)[0]: joint for joint in robot.findall("joint")}
        self.hulls = {name: read_wavefront(text) for name, text in hand.meshes}
        self.body_from_link = {name: np.eye(4) for name in hand.link_names}
        self.body_from_link[hand.link_names[0]] = invert(hand.base_from_tcp)

    def add(self) -> None:
        """Add bodies, joints, shapes, couplings, motors and the weld that carries the hand."""
        base, *others = self.hand.link_names
        bodies, moving = {base: self.spec.worldbody.add_body(name=base)}, set()
        bodies[base].add_freejoint()
        for name in others:  # A link's parent comes before the link.
            _, parent = child_and_parent(self.joints[name])
            bodies[name] = bodies[parent].add_body(name=name)
            if self._join(bodies[name], self.joints[name], parent) or parent in moving:
                moving.add(name)
        for name, body in bodies.items():
            self._set_inertia(body, name, self.protocol.drive_mass if name in moving else 0.0)
            for i, collision in enumerate(self.links[name].findall("collision")):
                self._add_shape(body, collision, name, i)
        self._couple()
        self._carry(base)

    def _join(self, body: mujoco.MjsBody, joint: ElementTree.Element, parent: str) -> bool:
        """Place a link at its joint, and return whether the joint moves."""
        placed, kind, kinds = self.body_from_link[parent] @ _origin(joint), joint.get("type"), mujoco.mjtJoint
        body.pos, body.quat = placed[:3, 3], _quaternion(placed[:3, :3])
        if kind == "fixed":
            return False
        added = body.add_joint(name=joint.get("name"))
        added.type = kinds.mjJNT_SLIDE if kind == "prismatic" else kinds.mjJNT_HINGE
        axis, limit, dynamics = (joint.find(name) for name in ("axis", "limit", "dynamics"))
        added.axis = [1, 0, 0] if axis is None else _numbers(axis.get("xyz"))
        added.limited = limit is not None and kind != "continuous"
        if limit is not None and kind != "continuous":
            added.range = [float(limit.get("lower", 0)), float(limit.get("upper", 0))]
        if dynamics is not None:
            added.damping[0] = float(dynamics.get("damping", 0))
        added.solref_limit, added.solimp_limit = REFERENCE, IMPEDANCE
        return True

    def _set_inertia(self, body: mujoco.MjsBody, name: str, least: float) -> None:
        """Set mass and moments of the URDF, but at least this mass [kg]."""
        inertial = _child(self.links[name], "inertial")
        body_from_mass = self.body_from_link[name] @ _origin(inertial)
        turn, mass = body_from_mass[:3, :3], float(_child(inertial, "mass").get("value", 0))
        values = _child(inertial, "inertia")
        xx, yy, zz, xy, xz, yz = (float(values.get(k, 0)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
        heavier = max(1.0, least / mass)
        tensor = heavier * turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        body.explicitinertial, body.mass, body.ipos = True, mass * heavier, body_from_mass[:3, 3]
        body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    def _add_shape(
        self, body: mujoco.MjsBody, collision: ElementTree.Element, link: str, number: int
    ) -> None:
        (shape,), kinds = _child(collision, "geometry"), mujoco.mjtGeom
        body_from_shape = self.body_from_link[link] @ _origin(collision)
        geom = body.add_geom(pos=body_from_shape[:3, 3], quat=_quaternion(body_from_shape[:3, :3]))
        geom.contype, geom.conaffinity = HAND_BIT, OBJECT_BIT | TABLE_BIT
        if shape.tag == "box":
            geom.type, geom.size = kinds.mjGEOM_BOX, np.array(_numbers(shape.get("size"))) / 2
        elif shape.tag == "sphere":
            geom.type, geom.size = kinds.mjGEOM_SPHERE, [float(shape.get("radius", 0)), 0, 0]
        elif shape.tag == "cylinder":
            half = float(shape.get("length", 0)) / 2
            geom.type, geom.size = kinds.mjGEOM_CYLINDER, [float(shape.get("radius", 0)), half, 0]
        else:
            geom.type, geom.meshname = kinds.mjGEOM_MESH, f"{link} {number}"
            _add_mesh(self.spec, geom.meshname, *self.hulls[shape.get("filename", "")])

    def _couple(self) -> None:
        """Couple each follower to its leader, and give each joint a motor."""
        (driver, ratio), *followers = self.hand.joints
        first, *offsets = self.hand.offsets
        for (name, own), offset in zip(followers, offsets, strict=True):
            gear = self.spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=name, name2=driver)
            gear.objtype = mujoco.mjtObj.mjOBJ_JOINT
            gear.data[:5] = offset - own / ratio * first, own / ratio, 0, 0, 0
            gear.solref, gear.solimp = COUPLING, COUPLING_IMPEDANCE
        for name, _ in self.hand.joints:
            motor = self.spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            motor.forcelimited = True
            motor.forcerange = [-1, 1]  # The force limit is set before each use, like the gain.

    def _carry(self, base: str) -> None:
        """A weld ties the TCP to a body that the trial moves about."""
        self.spec.worldbody.add_body(name=CARRIER, mocap=True)
        weld = self.spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name1=CARRIER, name2=base)
        weld.name, weld.active, weld.objtype = CARRIER, False, mujoco.mjtObj.mjOBJ_BODY
        weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]  # anchor, relative pose, torque as much as force
        weld.solref, weld.solimp = REFERENCE, IMPEDANCE


def child_and_parent(joint: ElementTree.Element) -> tuple[str, str]:
    """Names of the links that a URDF joint connects."""
    return _child(joint, "child").get("link", ""), _child(joint, "parent").get("link", "")


def read_wavefront(text: str) -> tuple[Float[np.ndarray, "v 3"], np.ndarray]:
    """Vertices and triangles of the one hull in an OBJ text that `hand.py` or `body.py` wrote."""
    lines = [line.split() for line in text.splitlines()]
    vertices = [[float(value) for value in words[1:]] for words in lines if words[0] == "v"]
    triangles = [[int(value) - 1 for value in words[1:]] for words in lines if words[0] == "f"]
    return np.array(vertices), np.array(triangles)


def _origin(element: ElementTree.Element) -> Float[np.ndarray, "4 4"]:
    """`parent_from_this` of a URDF element."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    turn = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"))).as_matrix()
    return rigid(turn, np.array(_numbers(origin.get("xyz", "0 0 0"))))


def _child(element: ElementTree.Element, name: str) -> ElementTree.Element:
    found = element.find(name)
    assert found is not None, f"{element.tag} without {name}"
    return found


def _numbers(text: str | None) -> list[float]:
    return [float(value) for value in (text or "").split()]


def _quaternion(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """The rotation as the quaternion (w, x, y, z) that MuJoCo takes."""
    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)

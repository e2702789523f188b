"""One PyBullet world with a floating gripper and an object, in DIRECT mode.

Bullet places bodies and constraints by their centre-of-mass frames (bullet3 #2411, #2096); everything
else here speaks of the TCP and of the object's own frame, and both are converted in this file only.
Every load starts from an empty world in the same order, so that a trial does not depend on the ones
before it. Shapes carry their faces (`URDF_INITIALIZE_SAT_FEATURES`): Bullet then clips whole faces
against each other; without them a contact gains one point a step, and a squeezed object wobbles into
the pads by centimetres.
"""

import functools
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert, rigid
from grasptransfer.simulation.body import Body
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.protocol import GRAVITY, Protocol

BASE = -1  # Bullet's index of a body's root link
FAR = 0.25  # m, beyond any gripper's reach: how far distances are looked for
TABLE_HALF_THICKNESS = 0.1  # m


class World:
    """A physics client with one gripper and one object; a context manager."""

    def __init__(self, body: Body, hand: Hand, protocol: Protocol):
        pybullet = _pybullet()
        self.body, self.hand, self.protocol = body, hand, protocol
        self._bullet = pybullet
        self._client = pybullet.connect(pybullet.DIRECT)
        self._calls: dict[str, functools.partial] = {}
        self._shape: int | None = None
        self._constraints: list[int] = []
        self._bodies: list[int] = []
        self._folder = tempfile.TemporaryDirectory(prefix="grasptransfer-")
        folder = Path(self._folder.name)
        (folder / "object.obj").write_text(body.wavefront)
        (folder / "hand.urdf").write_text(hand.urdf)
        for name, text in hand.meshes:
            (folder / name).write_text(text)

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Disconnect."""
        self._bullet.disconnect(physicsClientId=self._client)
        self._folder.cleanup()

    def call(self, name: str, *arguments, **options):
        """A function of pybullet, on this client."""
        bound = self._calls.get(name)
        if bound is None:
            function = getattr(self._bullet, name)
            bound = self._calls[name] = functools.partial(function, physicsClientId=self._client)
        return bound(*arguments, **options)

    def load(self, friction: float):
        """An empty world, then the gripper and the object (at the origin), always in this order.

        Args:
            friction: of the contact between pad and object.
        """
        if self._shape is None:
            self._prepare()
        for constraint in self._constraints:
            self.call("removeConstraint", constraint)
        for body in self._bodies:
            self.call("removeBody", body)
        self._constraints, self._bodies, self.table = [], [], None
        self._load_hand()
        self._load_object(friction)
        if self.protocol.support == "table":
            self._load_table()
        self.weigh(self.protocol.support == "table")

    def _prepare(self):
        """What stays from trial to trial: the engine's numbers, and the shape, slow to build."""
        protocol = self.protocol
        self.call("resetSimulation")
        self.call(
            "setPhysicsEngineParameter",
            fixedTimeStep=protocol.time_step,
            numSolverIterations=protocol.solver_iterations,
            solverResidualThreshold=protocol.solver_residual,
            numSubSteps=0,
            contactERP=protocol.contact_erp,
            enableConeFriction=1,  # the pyramid takes half the time and ignores spinning friction
            deterministicOverlappingPairs=1,
            enableFileCaching=0,
        )
        self._shape = self.call(
            "createCollisionShape",
            self._bullet.GEOM_MESH,
            fileName=str(Path(self._folder.name) / "object.obj"),
            flags=self._bullet.URDF_INITIALIZE_SAT_FEATURES,
        )

    def _load_hand(self):
        flags = (
            self._bullet.URDF_USE_INERTIA_FROM_FILE
            | self._bullet.URDF_MAINTAIN_LINK_ORDER
            | self._bullet.URDF_INITIALIZE_SAT_FEATURES
        )
        path = str(Path(self._folder.name) / "hand.urdf")
        self.gripper = self.call("loadURDF", path, useFixedBase=0, flags=flags)
        self._bodies.append(self.gripper)
        numbers = {}
        self.link_names = {BASE: self.call("getBodyInfo", self.gripper)[0].decode()}
        for index in range(self.call("getNumJoints", self.gripper)):
            info = self.call("getJointInfo", self.gripper, index)
            numbers[info[1].decode()] = index
            self.link_names[index] = info[12].decode()
        self.joints = [(numbers[name], ratio) for name, ratio in self.hand.joints]
        links = {name: index for index, name in self.link_names.items()}
        self.pads = [links[name] for name in self.hand.pad_links]
        inertial = self.call("getDynamicsInfo", self.gripper, BASE)
        base_from_mass = _rigid(inertial[3], inertial[4])
        self._mass_from_tcp = invert(base_from_mass) @ self.hand.base_from_tcp
        self._tcp_from_mass = invert(self._mass_from_tcp)
        # Apart from the links' own numbers: given together with damping, Bullet sets the base's.
        self.call("changeDynamics", self.gripper, BASE, linearDamping=0, angularDamping=0)
        moving = self._behind_joints()
        for index in self.link_names:
            self.call("changeDynamics", self.gripper, index, lateralFriction=1.0, spinningFriction=0.0)
            mass, _, moments = self.call("getDynamicsInfo", self.gripper, index)[:3]
            heavier = self.protocol.drive_mass / max(mass, 1e-9)
            if heavier > 1 and index in moving:
                scaled = [heavier * moment for moment in moments]
                self.call(
                    "changeDynamics",
                    self.gripper,
                    index,
                    mass=self.protocol.drive_mass,
                    localInertiaDiagonal=scaled,
                )
        for index, _ in self.joints:  # Bullet brakes every joint by a motor of its own
            self.call("setJointMotorControl2", self.gripper, index, self._bullet.VELOCITY_CONTROL, force=0)
        self._couple()

    def _behind_joints(self) -> set[int]:
        """Links that move when the fingers do."""
        parents = {i: self.call("getJointInfo", self.gripper, i)[16] for i in self.link_names if i != BASE}
        moving = {index for index, _ in self.joints}
        for index in sorted(parents):  # parents come before their children
            if parents[index] in moving:
                moving.add(index)
        return moving

    def _couple(self):
        """Gears from the driver to every other joint; Bullet ignores the URDF's `mimic`."""
        (driver, first), *others = self.joints
        driver_offset, *offsets = self.hand.offsets
        for (index, ratio), offset in zip(others, offsets, strict=True):
            relative = ratio / first
            gear = self.call(
                "createConstraint",
                self.gripper,
                driver,
                self.gripper,
                index,
                self._bullet.JOINT_GEAR,
                [1, 0, 0],
                [0, 0, 0],
                [0, 0, 0],
            )
            self._constraints.append(gear)
            self.call(
                "changeConstraint",
                gear,
                gearRatio=-1 / relative,
                relativePositionTarget=(relative * driver_offset - offset) / relative,
                erp=self.protocol.gear_erp,
                maxForce=self.protocol.gear_force,
            )

    def _load_object(self, friction: float):
        body = self.body
        self._object_from_mass = rigid(body.principal_axes, body.centre_of_mass)
        self._mass_from_object = invert(self._object_from_mass)
        self.object = self.call(
            "createMultiBody",
            body.mass,
            self._shape,
            baseInertialFramePosition=body.centre_of_mass.tolist(),
            baseInertialFrameOrientation=_quaternion(body.principal_axes),
        )
        self._bodies.append(self.object)
        self.call(
            "changeDynamics",
            self.object,
            BASE,
            localInertiaDiagonal=body.principal_moments.tolist(),
            lateralFriction=friction,
            spinningFriction=self.protocol.spinning_friction,
            rollingFriction=0.0,
            restitution=0.0,
            collisionMargin=0.0,  # Bullet would make every hull 1 mm thicker, and a mug's wall with it
        )
        self.damp(0.0)

    def _load_table(self):
        half = [1.0, 1.0, TABLE_HALF_THICKNESS]
        shape = self.call("createCollisionShape", self._bullet.GEOM_BOX, halfExtents=half)
        height = self.body.lowest - TABLE_HALF_THICKNESS
        self.table = self.call("createMultiBody", 0, shape, basePosition=[0, 0, height])
        self._bodies.append(self.table)
        self.call("changeDynamics", self.table, BASE, lateralFriction=1.0, restitution=0.0)

    def weigh(self, gravity: bool):
        """Turn gravity on or off."""
        self.call("setGravity", 0, 0, -GRAVITY if gravity else 0)

    def damp(self, rate: float):
        """Slow the object's own motion by `rate` [1/s]."""
        self.call("changeDynamics", self.object, BASE, linearDamping=rate, angularDamping=rate)

    def place_gripper(self, world_from_tcp: Float[np.ndarray, "4 4"], opening: float):
        """Put the gripper there at rest, without physics."""
        position, orientation = _pose(world_from_tcp @ self._tcp_from_mass)
        self.call("resetBasePositionAndOrientation", self.gripper, position, orientation)
        self.call("resetBaseVelocity", self.gripper, [0, 0, 0], [0, 0, 0])
        values = self.hand.joint_positions(opening)
        for (index, _), (name, _) in zip(self.joints, self.hand.joints, strict=True):
            self.call("resetJointState", self.gripper, index, values[name], 0.0)

    def hold_gripper(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        """Tie the TCP to the world; `move_gripper` carries it along."""
        position, orientation = _pose(self._mass_from_tcp)
        at, turned = _pose(world_from_tcp)
        self._hold = self.call(
            "createConstraint",
            self.gripper,
            BASE,
            -1,
            -1,
            self._bullet.JOINT_FIXED,
            [0, 0, 0],
            position,
            at,
            orientation,
            turned,
        )
        self._constraints.append(self._hold)
        self.move_gripper(at, turned)

    def move_gripper(self, position: list[float], orientation: list[float]):
        """Carry the TCP to this place [m] and orientation (x, y, z, w), with finite force."""
        self.call(
            "changeConstraint",
            self._hold,
            jointChildPivot=position,
            jointChildFrameOrientation=orientation,
            maxForce=self.protocol.hold_force,
        )

    def drive_fingers(self, speed: float, force: float, opening: float):
        """Move the pads together at `speed` [m/s each], with at most `force` [N each]."""
        slope = self.hand.driver_slope(opening)
        squares = sum(ratio**2 for _, ratio in self.joints)
        for index, ratio in self.joints:
            # By virtual work: together the joints do what the two pads' forces do.
            self.call(
                "setJointMotorControl2",
                self.gripper,
                index,
                self._bullet.VELOCITY_CONTROL,
                targetVelocity=-2 * speed * ratio / slope,
                force=force * abs(slope * ratio) / squares,
            )

    def step(self):
        """One time step."""
        self.call("stepSimulation")

    def world_from_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Where the TCP is."""
        return _rigid(*self.call("getBasePositionAndOrientation", self.gripper)) @ self._mass_from_tcp

    def world_from_object(self) -> Float[np.ndarray, "4 4"]:
        """Where the object's frame is."""
        return _rigid(*self.call("getBasePositionAndOrientation", self.object)) @ self._mass_from_object

    def opening(self) -> float:
        """Distance between the pads, by the driver joint [m]."""
        index, ratio = self.joints[0]
        driver = (self.call("getJointState", self.gripper, index)[0] - self.hand.offsets[0]) / ratio
        drivers, openings = self.hand.drivers, self.hand.openings
        order = np.argsort(drivers)
        return float(np.interp(driver, drivers[order], openings[order]))

    def object_speed(self) -> float:
        """Speed of the object's centre of mass [m/s]."""
        return float(np.linalg.norm(self.call("getBaseVelocity", self.object)[0]))

    def overlapping(self) -> set[str]:
        """Links of the gripper that reach into the object, without a step of physics."""
        points = self.call("getClosestPoints", self.gripper, self.object, 0.0)
        return {self.link_names[point[3]] for point in points if point[8] < 0}

    def touching(self) -> tuple[set[int], float]:
        """Links of the gripper that touch the object, and how deep the deepest contact is [m]."""
        contacts = self.call("getContactPoints", self.gripper, self.object)
        links = {contact[3] for contact in contacts if contact[8] <= 0 or contact[9] > 0}
        return links, max((-contact[8] for contact in contacts), default=0.0)

    def nearest(self) -> tuple[float, str, str]:
        """Least distance from the gripper to anything [m], the link and what it is."""
        best = (FAR, "", "")
        for other, name in ((self.object, "the object"), (self.table, "the table")):
            if other is None:
                continue
            for point in self.call("getClosestPoints", self.gripper, other, best[0]):
                if point[8] < best[0]:
                    best = (point[8], self.link_names[point[3]], name)
        return best

    def link_poses(self) -> dict[str, Float[np.ndarray, "4 4"]]:
        """`world_from_link` of every link of the gripper."""
        base = self.world_from_tcp() @ invert(self.hand.base_from_tcp)
        poses = {self.link_names[BASE]: base}
        for index, name in self.link_names.items():
            if index != BASE:
                state = self.call("getLinkState", self.gripper, index, computeForwardKinematics=1)
                poses[name] = _rigid(state[4], state[5])
        return poses


def _pybullet():
    """The module; on import its C code writes a greeting to the caller's standard error."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        import pybullet
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
    return pybullet


def _quaternion(rotation: Float[np.ndarray, "3 3"]) -> list[float]:
    return Rotation.from_matrix(rotation).as_quat().tolist()


def _pose(a_from_b: Float[np.ndarray, "4 4"]) -> tuple[list[float], list[float]]:
    return a_from_b[:3, 3].tolist(), _quaternion(a_from_b[:3, :3])


def _rigid(position, orientation) -> Float[np.ndarray, "4 4"]:
    x, y, z, w = orientation
    a_from_b = np.eye(4)
    a_from_b[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    a_from_b[:3, 3] = position
    return a_from_b

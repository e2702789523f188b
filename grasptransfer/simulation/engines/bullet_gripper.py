"""A gripper that floats in a PyBullet world, carried along by a constraint of finite force.

Bullet places bodies and constraints by their centre-of-mass frames (bullet3 #2411, #2096); this module
converts them to the TCP. Bullet ignores a URDF's `mimic` (#1140, #2575), so gears couple the joints here.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import invert
from grasptransfer.simulation.engines.bullet_client import (
    BASE,
    BulletClient,
    position_and_quaternion,
    transform,
)
from grasptransfer.simulation.engines.seam import FloatingGripper
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.protocol import Protocol


class BulletGripper(FloatingGripper):
    """One gripper in the world of `client`.

    Args:
        client: connection to the engine that holds the world.
        hand: the gripper to load.
        protocol: forces and masses of the trial.
        folder: folder that holds `hand.urdf` and its meshes.
    """

    def __init__(self, client: BulletClient, hand: Hand, protocol: Protocol, folder: Path):
        super().__init__(hand, protocol)
        self._call, self._bullet = client.call, client.bullet
        flags = (
            self._bullet.URDF_USE_INERTIA_FROM_FILE
            | self._bullet.URDF_MAINTAIN_LINK_ORDER
            | self._bullet.URDF_INITIALIZE_SAT_FEATURES
        )
        self.body = self._call("loadURDF", str(folder / "hand.urdf"), useFixedBase=0, flags=flags)
        self.constraints: list[int] = []
        self._name_links()
        inertial = self._call("getDynamicsInfo", self.body, BASE)
        base_from_mass = transform(inertial[3], inertial[4])
        self._mass_from_tcp = invert(base_from_mass) @ hand.base_from_tcp
        self._tcp_from_mass = invert(self._mass_from_tcp)
        self._set_dynamics()
        for index in self._joints:  # Bullet brakes every joint by a motor of its own
            self._call("setJointMotorControl2", self.body, index, self._bullet.VELOCITY_CONTROL, force=0)
        self._couple()

    def _name_links(self):
        numbers = {}
        self.link_names = {BASE: self._call("getBodyInfo", self.body)[0].decode()}
        for index in range(self._call("getNumJoints", self.body)):
            info = self._call("getJointInfo", self.body, index)
            numbers[info[1].decode()] = index
            self.link_names[index] = info[12].decode()
        self._joints = [numbers[name] for name, _ in self.hand.joints]
        self._links = {name: index for index, name in self.link_names.items()}

    def _set_dynamics(self):
        # Damping has a call of its own: given together with a link's numbers, Bullet sets the base's instead.
        self._call("changeDynamics", self.body, BASE, linearDamping=0, angularDamping=0)
        moving = self._behind_joints()
        for index in self.link_names:
            self._call("changeDynamics", self.body, index, lateralFriction=1.0, spinningFriction=0.0)
            mass, _, moments = self._call("getDynamicsInfo", self.body, index)[:3]
            heavier = self.protocol.drive_mass / max(mass, 1e-9)
            if heavier > 1 and index in moving:
                scaled = [heavier * moment for moment in moments]
                numbers = {"mass": self.protocol.drive_mass, "localInertiaDiagonal": scaled}
                self._call("changeDynamics", self.body, index, **numbers)

    def _behind_joints(self) -> set[int]:
        """Links that move when the fingers do."""
        parents = {i: self._call("getJointInfo", self.body, i)[16] for i in self.link_names if i != BASE}
        moving = set(self._joints)
        for index in sorted(parents):  # Parents come before their children.
            if parents[index] in moving:
                moving.add(index)
        return moving

    def _couple(self):
        """Gear each joint to its leader."""
        axis, origin, kind = [1, 0, 0], [0, 0, 0], self._bullet.JOINT_GEAR
        for number, leader in list(enumerate(self.hand.leaders))[1:]:
            (_, ratio), offset = self.hand.joints[number], self.hand.offsets[number]
            (_, first), leader_offset = self.hand.joints[leader], self.hand.offsets[leader]
            relative = ratio / first
            bodies = (self.body, self._joints[leader], self.body, self._joints[number])
            gear = self._call("createConstraint", *bodies, kind, axis, origin, origin)
            self.constraints.append(gear)
            self._call(
                "changeConstraint",
                gear,
                gearRatio=-1 / relative,
                relativePositionTarget=(relative * leader_offset - offset) / relative,
                erp=self.protocol.gear_erp,
                maxForce=self.protocol.gear_force,
            )

    def place(self, world_from_tcp: Float[np.ndarray, "4 4"], opening: float):
        """Put the gripper at this pose, at rest and without physics, with its pads `opening` apart [m]."""
        position, orientation = position_and_quaternion(world_from_tcp @ self._tcp_from_mass)
        self._call("resetBasePositionAndOrientation", self.body, position, orientation)
        self._call("resetBaseVelocity", self.body, [0, 0, 0], [0, 0, 0])
        values = self.hand.joint_positions(opening)
        for index, (name, _) in zip(self._joints, self.hand.joints, strict=True):
            self._call("resetJointState", self.body, index, values[name], 0.0)

    def hold(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        """Tie the TCP to the world; `carry` moves it."""
        position, orientation = position_and_quaternion(self._mass_from_tcp)
        at, turned = position_and_quaternion(world_from_tcp)
        ends = (self.body, BASE, -1, -1)
        frames = (position, at, orientation, turned)
        self._hold = self._call("createConstraint", *ends, self._bullet.JOINT_FIXED, [0, 0, 0], *frames)
        self.constraints.append(self._hold)
        self.carry(at, turned)

    def carry(self, position: list[float], orientation: list[float]):
        """Carry the TCP to this position [m] and orientation (x, y, z, w), with finite force."""
        self._call(
            "changeConstraint",
            self._hold,
            jointChildPivot=position,
            jointChildFrameOrientation=orientation,
            maxForce=self.protocol.hold_force,
        )

    def drive_joint(self, index: int, speed: float, force: float):
        """Drive a finger joint at `speed` [m/s or rad/s] with at most `force` [N or N m]."""
        mode = self._bullet.VELOCITY_CONTROL
        self._call(
            "setJointMotorControl2", self.body, self._joints[index], mode, targetVelocity=speed, force=force
        )

    def joint_values(self) -> Float[np.ndarray, "j"]:
        """Values of the joints, in the order of `hand.joints` [m or rad]."""
        return np.array([state[0] for state in self._call("getJointStates", self.body, self._joints)])

    def world_from_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Present pose of the TCP."""
        return transform(*self._call("getBasePositionAndOrientation", self.body)) @ self._mass_from_tcp

    def world_from_link(self, name: str) -> Float[np.ndarray, "4 4"]:
        """Present pose of a link."""
        index = self._links[name]
        if index == BASE:
            return self.world_from_tcp() @ invert(self.hand.base_from_tcp)
        state = self._call("getLinkState", self.body, index, computeForwardKinematics=1)
        return transform(state[4], state[5])

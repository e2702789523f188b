"""One PyBullet world with a floating gripper and an object, in DIRECT mode.

Every load removes the bodies of the trial before from the world and adds new ones in the same order, so that
a trial does not depend on earlier trials. Only the object's shape stays, because it is slow to build.
Shapes carry their faces (`URDF_INITIALIZE_SAT_FEATURES`): Bullet then clips whole faces against each
other; without them a contact gains one point a step, and a squeezed object wobbles into the pads by
centimetres.
"""

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import invert, rigid
from grasptransfer.simulation.body import Body, wavefront
from grasptransfer.simulation.engines.bullet_client import BASE, BulletClient, quaternion, transform
from grasptransfer.simulation.engines.bullet_files import OwnedFolder
from grasptransfer.simulation.engines.bullet_gripper import BulletGripper
from grasptransfer.simulation.engines.seam import FAR, World
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.job import Conditions
from grasptransfer.simulation.protocol import GRAVITY, Protocol

TABLE_HALF_THICKNESS = 0.1  # m


def _effort(gears: int) -> int:
    """By how much a hand multiplies the protocol's solver iterations.

    A hand with one gear, such as two sliding fingers, needs the protocol's number. A linkage with five gears
    that squeezes an object needs ten times as many until its joints agree to half a millimetre of opening;
    with the number for one gear they disagree by 57 mm (Robotiq 2F-140, a box of 50 mm).
    """
    return 1 if gears <= 1 else 2 * gears


class BulletWorld(World):
    """A physics client with one gripper and one object; a context manager."""

    engine = "pybullet"

    def __init__(self, body: Body, hand: Hand, protocol: Protocol):
        super().__init__(body, hand, protocol)
        self._client = BulletClient()
        self._call = self._client.call
        self._shape: int | None = None
        self._loaded: BulletGripper | None = None
        self._others: list[int] = []
        self._files = OwnedFolder()
        self._folder = self._files.path
        (self._folder / "object.obj").write_text(wavefront(body.hulls))
        (self._folder / "hand.urdf").write_text(hand.urdf)
        for name, text in hand.meshes:
            (self._folder / name).write_text(text)

    def close(self):
        """Disconnect."""
        self._client.close()
        self._files.close()

    def load(self, conditions: Conditions) -> BulletGripper:
        """Load a fresh gripper and then the object at the origin, always in this order."""
        if self._shape is None:
            self._prepare()
        if self._loaded is not None:
            for constraint in self._loaded.constraints:
                self._call("removeConstraint", constraint)
            for body in (self._loaded.body, *self._others):
                self._call("removeBody", body)
        self.gripper = self._loaded = BulletGripper(self._client, self.hand, self.protocol, self._folder)
        self._load_object(conditions)
        self._others, self.table = [self.object], None
        if self.protocol.support == "table":
            self._load_table()
        self.weigh(self.protocol.support == "table")
        return self._loaded

    def _prepare(self):
        """Set what stays from trial to trial: the engine's parameters and the object's shape."""
        protocol = self.protocol
        self._call("resetSimulation")
        self._call(
            "setPhysicsEngineParameter",
            fixedTimeStep=protocol.time_step,
            numSolverIterations=protocol.solver_iterations * _effort(len(self.hand.joints) - 1),
            solverResidualThreshold=protocol.solver_residual,
            numSubSteps=0,
            contactERP=protocol.contact_erp,
            frictionERP=protocol.friction_erp,
            enableConeFriction=1,  # The pyramid takes half the time but ignores spinning friction.
            deterministicOverlappingPairs=1,
            enableFileCaching=0,
        )
        bullet = self._client.bullet
        path, flags = str(self._folder / "object.obj"), bullet.URDF_INITIALIZE_SAT_FEATURES
        self._shape = self._call("createCollisionShape", bullet.GEOM_MESH, fileName=path, flags=flags)

    def _load_object(self, conditions: Conditions):
        body = self.body
        # Bullet places a body by its centre of mass (bullet3 #2411).
        self._mass_from_object = invert(rigid(body.principal_axes, body.centre_of_mass))
        self.object = self._call(
            "createMultiBody",
            conditions.mass,
            self._shape,
            baseInertialFramePosition=body.centre_of_mass.tolist(),
            baseInertialFrameOrientation=quaternion(body.principal_axes),
        )
        self._call(
            "changeDynamics",
            self.object,
            BASE,
            localInertiaDiagonal=(body.principal_moments * conditions.mass / body.mass).tolist(),
            lateralFriction=conditions.friction,
            spinningFriction=self.protocol.spinning_friction,
            rollingFriction=0.0,
            frictionAnchor=1,  # Without it the solver lets a sticking contact creep by a millimetre a second.
            restitution=0.0,
            collisionMargin=0.0,  # Bullet's default makes every hull, such as a mug's wall, 1 mm thicker.
        )
        self.damp(0.0)

    def _load_table(self):
        half = [1.0, 1.0, TABLE_HALF_THICKNESS]
        shape = self._call("createCollisionShape", self._client.bullet.GEOM_BOX, halfExtents=half)
        height = self.body.lowest - TABLE_HALF_THICKNESS
        self.table = self._call("createMultiBody", 0, shape, basePosition=[0, 0, height])
        self._others.append(self.table)
        self._call("changeDynamics", self.table, BASE, lateralFriction=1.0, restitution=0.0)

    def weigh(self, gravity: bool):
        """Turn gravity on or off."""
        self._call("setGravity", 0, 0, -GRAVITY if gravity else 0)

    def damp(self, rate: float):
        """Slow the object's own motion by `rate` [1/s]."""
        self._call("changeDynamics", self.object, BASE, linearDamping=rate, angularDamping=rate)

    def step(self):
        """One time step."""
        self._call("stepSimulation")

    def world_from_object(self) -> Float[np.ndarray, "4 4"]:
        """Present pose of the object's frame."""
        return transform(*self._call("getBasePositionAndOrientation", self.object)) @ self._mass_from_object

    def object_dynamics(self) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Mass [kg], centre of mass [m] and inertia about it [kg m2] as the engine has them, object frame."""
        mass, _, moments, position, orientation = self._call("getDynamicsInfo", self.object, BASE)[:5]
        object_from_mass = transform(position, orientation)
        axes = object_from_mass[:3, :3]
        return mass, object_from_mass[:3, 3], axes @ np.diag(moments) @ axes.T

    def object_speed(self) -> float:
        """Speed of the object's centre of mass [m/s]."""
        return float(np.linalg.norm(self._call("getBaseVelocity", self.object)[0]))

    def overlapping(self) -> set[str]:
        """Links of the gripper that overlap the object, without a step of physics."""
        hand = self._gripper()
        points = self._call("getClosestPoints", hand.body, self.object, 0.0)
        return {hand.link_names[point[3]] for point in points if point[8] < 0}

    def touching(self) -> tuple[set[str], float]:
        """Links of the gripper that touch the object, and how deep the deepest contact is [m]."""
        hand = self._gripper()
        contacts = self._call("getContactPoints", hand.body, self.object)
        links = {hand.link_names[contact[3]] for contact in contacts if contact[8] <= 0 or contact[9] > 0}
        return links, max((-contact[8] for contact in contacts), default=0.0)

    def contact_points(self) -> list[tuple[str, list[float]]]:
        """The gripper's link, and the place in the world [m], of every contact with the object."""
        hand = self._gripper()
        contacts = self._call("getContactPoints", hand.body, self.object)
        return [(hand.link_names[c[3]], list(c[5])) for c in contacts if c[8] <= 0 or c[9] > 0]

    def nearest(self) -> tuple[float, str, str]:
        """Least distance from the gripper to any obstacle [m], the link and the obstacle."""
        hand, best = self._gripper(), (FAR, "", "")
        for other, name in ((self.object, "the object"), (self.table, "the table")):
            if other is None:
                continue
            for point in self._call("getClosestPoints", hand.body, other, best[0]):
                if point[8] < best[0]:
                    best = (point[8], hand.link_names[point[3]], name)
        return best

    def _gripper(self) -> BulletGripper:
        assert self._loaded is not None, "load comes first"
        return self._loaded

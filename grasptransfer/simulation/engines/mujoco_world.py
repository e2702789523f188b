"""A MuJoCo world with a floating gripper and an object.

A weld, a soft constraint of the solver, ties the TCP to a body that the trial moves about. The equality
constraints that couple the fingers have no limit of force: `Protocol.gear_force` and the `erp` numbers apply
to Bullet only. A motor gives its full force at standstill and none at the commanded speed, as a
direct-current motor does: MuJoCo then integrates it implicitly, and it does not chatter.
"""

# MuJoCo's package has no types.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterable

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert, rigid
from grasptransfer.simulation.body import Body
from grasptransfer.simulation.engines.mujoco_model import CARRIER, OBJECT, STEPS, TABLE, build_model
from grasptransfer.simulation.engines.seam import FAR, FloatingGripper, World
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.job import Conditions
from grasptransfer.simulation.protocol import GRAVITY, Protocol

TOUCH = 1e-4  # m: distances are computed up to here, which is enough to find overlaps.
FLIPPED = np.array([1, 1, 1, -1, -1, -1, -1])  # -q is the same orientation as q.


class State:
    """A compiled model, and the data of its present state."""

    def __init__(self, model: mujoco.MjModel):
        self.model, self.data = model, mujoco.MjData(model)
        self._seen = True

    def step(self):
        """Do one of MuJoCo's own steps; poses and contacts after it are computed when `now` is called."""
        mujoco.mj_step(self.model, self.data)
        self._seen = False

    def now(self) -> mujoco.MjData:
        """The data with present poses and contacts, because a step leaves those of its beginning."""
        if not self._seen:
            mujoco.mj_fwdPosition(self.model, self.data)
            self._seen = True
        return self.data


class MujocoGripper(FloatingGripper):
    """The gripper of a compiled model."""

    def __init__(self, state: State, hand: Hand, protocol: Protocol):
        super().__init__(hand, protocol)
        self._state, self._model, self._data = state, state.model, state.data
        model = state.model
        joints = [model.joint(name).id for name, _ in hand.joints]
        self._values, self._speeds = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._bodies = {name: model.body(name).id for name in hand.link_names}
        free = model.body_jntadr[self._bodies[hand.link_names[0]]]
        self._base = model.jnt_qposadr[free] + np.arange(7)
        self._base_speed = model.jnt_dofadr[free] + np.arange(6)
        self._weld = model.equality(CARRIER).id
        mass = model.body_subtreemass[self._bodies[hand.link_names[0]]]
        self._start = self._aim = position_and_quaternion(np.eye(4))
        self._farthest = protocol.hold_force / mass * model.eq_solref[self._weld, 0] ** 2

    def place(self, world_from_tcp: Float[np.ndarray, "4 4"], opening: float):
        """Put the gripper at this pose, at rest and without physics, with its pads `opening` apart [m]."""
        data, positions = self._data, self.hand.joint_positions(opening)
        data.qpos[self._base] = position_and_quaternion(world_from_tcp)
        data.qpos[self._values] = [positions[name] for name, _ in self.hand.joints]
        data.qvel[self._base_speed] = 0
        data.qvel[self._speeds] = 0
        mujoco.mj_kinematics(self._model, data)

    def hold(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        """Tie the TCP to the world; `carry` moves it."""
        self._aim = self._start = position_and_quaternion(world_from_tcp)
        self._data.eq_active[self._weld] = 1

    def carry(self, position: list[float], orientation: list[float]):
        """Carry the TCP to this position [m] and orientation (x, y, z, w) within the next step."""
        x, y, z, w = orientation
        self._start, self._aim = self._aim, np.array([*position, w, x, y, z])

    def lead(self, share: float):
        """Move the carrier by this share of the step's way, with finite force.

        The weld pulls in proportion to the carrier's lead over the TCP, so limiting the lead limits the
        force.
        """
        start = self._start if self._start[3:] @ self._aim[3:] >= 0 else self._start * FLIPPED
        wanted = start + share * (self._aim - start)  # MuJoCo normalises the quaternion.
        here = self._data.qpos[self._base[:3]]  # The base's body has its frame at the TCP.
        ahead = wanted[:3] - here
        far = float(np.linalg.norm(ahead))
        self._data.mocap_pos[0] = here + ahead * min(1.0, self._farthest / far if far > 0 else 1.0)
        self._data.mocap_quat[0] = wanted[3:]
        if share == 1.0:
            self._start = self._aim

    def drive_joint(self, index: int, speed: float, force: float):
        """Drive a finger joint towards `speed` [m/s or rad/s] with at most `force` [N or N m]."""
        gain = force / abs(speed) if speed else 0.0
        self._model.actuator_gainprm[index, 0] = gain
        self._model.actuator_biasprm[index, 2] = -gain
        self._model.actuator_forcerange[index] = -force, force
        self._data.ctrl[index] = speed

    def joint_values(self) -> Float[np.ndarray, "j"]:
        """Values of the joints, in the order of `hand.joints` [m or rad]."""
        return self._data.qpos[self._values]

    def world_from_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Present pose of the TCP, at which the base's body has its frame."""
        return self._world_from_body(self.hand.link_names[0])

    def world_from_link(self, name: str) -> Float[np.ndarray, "4 4"]:
        """Present pose of a link."""
        if name == self.hand.link_names[0]:
            return self.world_from_tcp() @ invert(self.hand.base_from_tcp)
        return self._world_from_body(name)

    def _world_from_body(self, name: str) -> Float[np.ndarray, "4 4"]:
        body, data = self._bodies[name], self._state.now()
        return rigid(data.xmat[body].reshape(3, 3), data.xpos[body])


class MujocoWorld(World):
    """A compiled model and its state; a context manager."""

    engine = "mujoco"
    gripper: MujocoGripper

    def __init__(self, body: Body, hand: Hand, protocol: Protocol):
        super().__init__(body, hand, protocol)
        self._state = State(build_model(body, hand, protocol))
        self._model = model = self._state.model
        self._object = model.body(OBJECT).id
        free = model.body_jntadr[self._object]
        self._value = model.jnt_qposadr[free] + np.arange(7)
        self._speed = model.jnt_dofadr[free] + np.arange(6)
        links = {model.body(name).id: name for name in hand.link_names}
        self._links = {i: links[owner] for i, owner in enumerate(model.geom_bodyid) if owner in links}
        self._parts = set(np.flatnonzero(model.geom_bodyid == self._object).tolist())
        self._object_from_mass = rigid(body.principal_axes, body.centre_of_mass)

    def close(self):
        """Do nothing: MuJoCo holds no resource but memory of this process."""

    def load(self, conditions: Conditions) -> MujocoGripper:
        """Load a fresh gripper, and the object at the origin at rest; gravity is on only with a table."""
        model, data = self._model, self._state.data
        mujoco.mj_resetData(model, data)
        model.body_mass[self._object] = self._mass = conditions.mass
        model.body_inertia[self._object] = self._moments = (
            self.body.principal_moments * conditions.mass / self.body.mass
        )
        mujoco.mj_setConst(model, data)  # The solver keeps quantities that depend on the masses.
        model.geom_friction[list(self._parts)] = conditions.friction, self.protocol.spinning_friction, 0.0
        data.qpos[self._value] = position_and_quaternion(self._object_from_mass)
        self.damp(0.0)
        self.weigh(self.protocol.support == "table")
        self.gripper = gripper = MujocoGripper(self._state, self.hand, self.protocol)
        mujoco.mj_kinematics(model, data)
        return gripper

    def weigh(self, gravity: bool):
        """Turn gravity on or off."""
        self._model.opt.gravity[2] = -GRAVITY if gravity else 0.0

    def damp(self, rate: float):
        """Slow the object's own motion by `rate` [1/s]."""
        self._model.dof_damping[self._speed] = rate * np.array([self._mass] * 3 + self._moments.tolist())

    def step(self):
        """One time step of the protocol, on a path without corners."""
        for i in range(STEPS):
            self.gripper.lead((i + 1) / STEPS)
            self._state.step()

    def world_from_object(self) -> Float[np.ndarray, "4 4"]:
        """Present pose of the object's frame."""
        data = self._state.now()
        world_from_mass = rigid(data.xmat[self._object].reshape(3, 3), data.xpos[self._object])
        return world_from_mass @ invert(self._object_from_mass)

    def object_dynamics(self) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Mass [kg], centre of mass [m] and inertia about it [kg m2] as the engine has them, object frame."""
        model, i = self._model, self._object
        turn = Rotation.from_quat(model.body_iquat[i], scalar_first=True).as_matrix()
        object_from_inertia = self._object_from_mass @ rigid(turn, model.body_ipos[i])
        axes = object_from_inertia[:3, :3]
        tensor = axes @ np.diag(model.body_inertia[i]) @ axes.T
        return float(model.body_mass[i]), object_from_inertia[:3, 3], tensor

    def object_speed(self) -> float:
        """Speed of the object's centre of mass [m/s]."""
        return float(np.linalg.norm(self._state.data.qvel[self._speed[:3]]))

    def overlapping(self) -> set[str]:
        """Links of the gripper that overlap the object, without a step of physics."""
        geoms = {
            link: [g for g, owner in self._links.items() if owner == link] for link in self.hand.link_names
        }
        return {link for link, own in geoms.items() if self._closest(own, self._parts, TOUCH)[0] < 0}

    def touching(self) -> tuple[set[str], float]:
        """Links of the gripper that touch the object, and how deep the deepest contact is [m]."""
        links, deepest, contacts = set(), 0.0, self._state.now().contact
        for (first, second), distance in zip(contacts.geom.tolist(), contacts.dist.tolist(), strict=True):
            hand, other = (first, second) if first in self._links else (second, first)
            if hand in self._links and other in self._parts and distance <= 0:
                links.add(self._links[hand])
                deepest = max(deepest, -distance)
        return links, deepest

    def contact_points(self) -> list[tuple[str, list[float]]]:
        """The gripper's link, and the place in the world [m], of every contact with the object."""
        contacts, found = self._state.now().contact, []
        geoms, places = contacts.geom.tolist(), contacts.pos.tolist()
        for (first, second), place, distance in zip(geoms, places, contacts.dist.tolist(), strict=True):
            hand, other = (first, second) if first in self._links else (second, first)
            if hand in self._links and other in self._parts and distance <= 0:
                found.append((self._links[hand], place))
        return found

    def nearest(self) -> tuple[float, str, str]:
        """Least distance from the gripper to any obstacle [m] (`FAR` at most), the link and the obstacle."""
        best = (FAR, "", "")
        table = [] if self.table_height is None else [self._model.geom(TABLE).id]
        for geoms, name in ((self._parts, "the object"), (table, "the table")):
            distance, link = self._closest(self._links, geoms, best[0])
            if distance < best[0]:
                best = (distance, link, name)
        return best

    def _closest(self, own: Iterable[int], others: Iterable[int], limit: float) -> tuple[float, str]:
        """Least distance below `limit` [m], and the link; far pairs are skipped."""
        model, data = self._model, self._state.data
        pairs = np.array([(a, b) for a in own for b in others], int).reshape(-1, 2)
        apart = np.linalg.norm(np.diff(data.geom_xpos[pairs], axis=1)[:, 0], axis=1)
        least = apart - model.geom_rbound[pairs].sum(1)
        best, link = limit, ""
        for k in np.argsort(least):
            if least[k] >= best:
                break
            distance = mujoco.mj_geomDistance(model, data, *pairs[k], best, None)
            if distance < best:
                best, link = distance, self._links[int(pairs[k, 0])]
        return best, link


def position_and_quaternion(a_from_b: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "7"]:
    """The transform as MuJoCo takes it: position [m] and (w, x, y, z)."""
    turn = Rotation.from_matrix(a_from_b[:3, :3])
    return np.concatenate([a_from_b[:3, 3], turn.as_quat(scalar_first=True)])

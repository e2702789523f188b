"""What a trial asks of a physics engine: a world with one object and one floating gripper.

In every engine lengths are metres, forces newtons, transforms (4, 4) `a_from_b`, and quaternions
(x, y, z, w). Each trial begins with `World.load`, which removes everything of the trial before.
"""

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import invert, transform_points
from grasptransfer.simulation.body import Body
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.job import Conditions
from grasptransfer.simulation.protocol import Protocol

FAR = 0.25  # m: distances are measured up to here, which is more than any pad's stroke.


class FloatingGripper(ABC):
    """The gripper of a world, carried along by its TCP.

    Args:
        hand: the gripper's links, joints and shapes.
        protocol: forces and masses of the trial.
    """

    def __init__(self, hand: Hand, protocol: Protocol):
        self.hand, self.protocol = hand, protocol

    @abstractmethod
    def place(self, world_from_tcp: Float[np.ndarray, "4 4"], opening: float) -> None:
        """Put the gripper at this pose, at rest and without physics, with its pads `opening` apart [m]."""

    @abstractmethod
    def hold(self, world_from_tcp: Float[np.ndarray, "4 4"]) -> None:
        """Tie the TCP to the world; `carry` moves it."""

    @abstractmethod
    def carry(self, position: list[float], orientation: list[float]) -> None:
        """Carry the TCP to this position [m] and orientation (x, y, z, w)."""

    @abstractmethod
    def drive_joint(self, index: int, speed: float, force: float) -> None:
        """Drive a finger joint by its number in `hand.joints`.

        Args:
            speed: speed to drive at [m/s or rad/s].
            force: largest force or torque of the motor [N or N m].
        """

    @abstractmethod
    def joint_values(self) -> Float[np.ndarray, "j"]:
        """Values of the joints, in the order of `hand.joints` [m or rad]."""

    @abstractmethod
    def world_from_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Present pose of the TCP."""

    @abstractmethod
    def world_from_link(self, name: str) -> Float[np.ndarray, "4 4"]:
        """Present pose of a link."""

    def drive_fingers(self, speed: float, force: float, opening: float) -> None:
        """Move the pads together at `speed` [m/s each], with at most `force` [N each].

        The joints' forces follow from virtual work: together they do the work of the two pads' forces.

        Args:
            opening: distance between the pads now [m].
        """
        slope = self.hand.driver_slope(opening)
        squares = sum(ratio**2 for _, ratio in self.hand.joints)
        for index, (_, ratio) in enumerate(self.hand.joints):
            self.drive_joint(index, -2 * speed * ratio / slope, force * abs(slope * ratio) / squares)

    def link_poses(self) -> dict[str, Float[np.ndarray, "4 4"]]:
        """`world_from_link` of every link."""
        return {name: self.world_from_link(name) for name in self.hand.link_names}

    def opening(self) -> float:
        """Distance between the two pad faces along the TCP's x [m], measured at their present poses."""
        tcp_from_world = invert(self.world_from_tcp())
        low, high = (
            transform_points(tcp_from_world @ self.world_from_link(link), centre)
            for link, centre in zip(self.hand.pad_links, self.hand.pad_centres, strict=True)
        )
        return float(high[0] - low[0])

    def coupling_error(self) -> float:
        """By how much the joints disagree about the distance between the pads [m]."""
        hand = self.hand
        ratios = np.array([ratio for _, ratio in hand.joints])
        drivers = (self.joint_values() - hand.offsets) / ratios
        return float(np.ptp(drivers) * abs(hand.driver_slope(self.opening())))


class World(ABC):
    """A physics engine with one object and one gripper; a context manager.

    Args:
        body: the object.
        hand: the gripper.
        protocol: how the trials are executed.
    """

    engine: str
    gripper: FloatingGripper

    def __init__(self, body: Body, hand: Hand, protocol: Protocol):
        self.body, self.hand, self.protocol = body, hand, protocol

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_):
        self.close()

    @property
    def table_height(self) -> float | None:
        """z of the table's top [m]; None without a table."""
        return self.body.lowest if self.protocol.support == "table" else None

    @abstractmethod
    def close(self) -> None:
        """Release the engine's resources."""

    @abstractmethod
    def load(self, conditions: Conditions) -> FloatingGripper:
        """Load a fresh gripper, and the object at the origin at rest; gravity is on only with a table."""

    @abstractmethod
    def weigh(self, gravity: bool) -> None:
        """Turn gravity on or off."""

    @abstractmethod
    def damp(self, rate: float) -> None:
        """Slow the object's own motion by `rate` [1/s]."""

    @abstractmethod
    def step(self) -> None:
        """One time step."""

    @abstractmethod
    def world_from_object(self) -> Float[np.ndarray, "4 4"]:
        """Present pose of the object's frame."""

    @abstractmethod
    def object_dynamics(self) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Mass [kg], centre of mass [m] and inertia about it [kg m2] as the engine has them, object frame."""

    @abstractmethod
    def object_speed(self) -> float:
        """Speed of the object's centre of mass [m/s]."""

    @abstractmethod
    def overlapping(self) -> set[str]:
        """Links of the gripper that overlap the object, without a step of physics."""

    @abstractmethod
    def touching(self) -> tuple[set[str], float]:
        """Links of the gripper that touch the object, and how deep the deepest contact is [m]."""

    @abstractmethod
    def contact_points(self) -> list[tuple[str, list[float]]]:
        """The gripper's link, and the place in the world [m], of every contact with the object."""

    def width(self) -> float:
        """Distance between the pads along the TCP's x [m]; tilted pads are measured where they touch.

        A tilted pad touches with one edge, so the distance between the pads' centres is not the object's
        width.
        """
        if self.hand.pads_turn:
            points, tcp_from_world = self.contact_points(), invert(self.gripper.world_from_tcp())
            sides = [[place for link, place in points if link in body] for body in self.hand.pad_bodies]
            if all(sides):
                low, high = (transform_points(tcp_from_world, np.array(side))[:, 0].mean() for side in sides)
                return float(high - low)
        return self.gripper.opening()

    @abstractmethod
    def nearest(self) -> tuple[float, str, str]:
        """Least distance from the gripper to any obstacle [m] (`FAR` at most), the link and the obstacle."""

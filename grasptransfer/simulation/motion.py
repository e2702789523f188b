"""Paths of the TCP in time: lift, shake, turn."""

import numpy as np
from jaxtyping import Float

from grasptransfer.simulation.protocol import Protocol


def smooth(share: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t"]:
    """From 0 to 1 with no jerk at either end: minimum-jerk polynomial."""
    return share**3 * (10 - 15 * share + 6 * share**2)


def times(duration: float, time_step: float) -> Float[np.ndarray, "t"]:
    """Ends of the time steps [s]."""
    return time_step * np.arange(1, round(duration / time_step) + 1)


def lift_heights(protocol: Protocol) -> Float[np.ndarray, "t"]:
    """Height of the TCP above the grasp at each step [m]."""
    elapsed = times(protocol.lift_time, protocol.time_step)
    return protocol.lift_height * smooth(elapsed / protocol.lift_time)


def swing(protocol: Protocol) -> Float[np.ndarray, "t"]:
    """Displacement [m] of one shake along one axis, there and back.

    The acceleration is a sine of the protocol's amplitude for one period and its negative for another:
    it starts and ends at rest in the same place, and pulls both ways twice.
    """
    period, amplitude = protocol.shake_period, protocol.shake_acceleration
    elapsed = times(2 * period, protocol.time_step)
    omega = 2 * np.pi / period
    out = np.minimum(elapsed, period)
    back = np.maximum(elapsed - period, 0.0)
    reach = amplitude / omega * (out - np.sin(omega * out) / omega)
    return reach - amplitude / omega * (back - np.sin(omega * back) / omega)


def turns(protocol: Protocol) -> Float[np.ndarray, "t"]:
    """Angle about the closing axis [rad] at each step: one way, the other way, and back."""
    elapsed = times(protocol.turn_time, protocol.time_step) / protocol.turn_time
    there = smooth(np.clip(4 * elapsed, 0, 1))
    across = smooth(np.clip(2 * elapsed - 0.5, 0, 1))
    home = smooth(np.clip(4 * elapsed - 3, 0, 1))
    return np.radians(protocol.turn_degrees) * (there - 2 * across + home)

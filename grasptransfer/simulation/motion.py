"""Paths of the TCP in time: lift, shake, turn."""

import numpy as np
from jaxtyping import Float

from grasptransfer.simulation.protocol import Protocol


def smooth(share: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t"]:
    """The minimum-jerk polynomial from 0 to 1, at rest and without acceleration at both ends."""
    return share**3 * (10 - 15 * share + 6 * share**2)


def times(duration: float, time_step: float) -> Float[np.ndarray, "t"]:
    """Ends of the time steps [s]."""
    return time_step * np.arange(1, round(duration / time_step) + 1)


def lift_heights(protocol: Protocol) -> Float[np.ndarray, "t"]:
    """Height of the TCP above the grasp at each step [m]."""
    elapsed = times(protocol.lift_time, protocol.time_step)
    return protocol.lift_height * smooth(elapsed / protocol.lift_time)


def swing(protocol: Protocol) -> Float[np.ndarray, "t"]:
    """Displacement [m] of one shake along one axis.

    The acceleration is one period of a sine of the protocol's amplitude: it starts and ends at rest and
    pulls both ways once.
    """
    period = protocol.shake_period
    elapsed, omega = times(period, protocol.time_step), 2 * np.pi / period
    return protocol.shake_acceleration / omega * (elapsed - np.sin(omega * elapsed) / omega)


def turns(protocol: Protocol) -> Float[np.ndarray, "t"]:
    """Angle about the closing axis [rad] at each step: one way, the other way, and back.

    The turn across is twice as long and takes the square root of two as much time, so that all three turns
    have the same acceleration.
    """
    share = times(protocol.turn_time, protocol.time_step) / protocol.turn_time
    single = 1 / (2 + np.sqrt(2))
    there = smooth(np.clip(share / single, 0, 1))
    across = smooth(np.clip((share - single) / (1 - 2 * single), 0, 1))
    home = smooth(np.clip((share - 1 + single) / single, 0, 1))
    return np.radians(protocol.turn_degrees) * (there - 2 * across + home)

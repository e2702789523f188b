"""How a grasp is executed, as data: named, versioned, and printed with every number.

A success rate means nothing without its protocol. A published protocol never changes; another number
in it is another version. Lengths in metres, times in seconds, forces in newtons.
"""

import dataclasses
from dataclasses import dataclass

from grasptransfer.errors import SettingsError

GRAVITY = 9.81  # m/s2


@dataclass(frozen=True)
class Perturbation:
    """Random errors of a perturbed trial.

    Args:
        position: standard deviation of the TCP along each axis [m].
        degrees: standard deviation of a turn about a random axis through the TCP.
        friction: standard deviation of the friction, a share of it; kept within two of them.
    """

    position: float = 0.003
    degrees: float = 5.0
    friction: float = 0.2


@dataclass(frozen=True)
class Protocol:
    """One way to execute a grasp.

    Args:
        name: with its version.
        support: what the object rests on before it is held: `air` (no weight until the fingers have
            closed, and the air so thick that nothing drifts) or `table` (it stands on a plane).
        time_step: of the physics [s].
        solver_iterations: of the constraint solver in each step, at most.
        solver_residual: the squared velocity error at which it stops earlier, m2/s2.
        density: of the object, kg/m3; its mass is density x volume.
        mass_limits: the mass is clamped to these, kg: lighter bodies are unstable.
        friction: Coulomb coefficient between pad and object; 0.8 is rubber on glass, glaze or plastic, dry.
            Bullet multiplies two bodies' numbers; the gripper's and the table's are 1, so the object's is
            the contact's.
        spinning_friction: resistance of a contact to turning about its normal, a length [m].
        air_damping: 1/s, of the weightless object before the fingers have closed.
        hold_force: most force that carries the gripper along [N].
        contact_erp: share of an overlap that one step undoes.
        friction_erp: likewise of the creep of two surfaces that stick to each other.
        drive_mass: least mass of a finger link, kg: a drive's inertia, seen through its gear, and what lets
            the solver converge where light fingers squeeze a heavier object.
        gear_force, gear_erp: of the constraint that couples the fingers.
        approach_step: between checked poses of the approach [m].
        clearance_tolerance: overlap at most this deep is no collision [m].
        finger_speed: each pad's, closing [m/s].
        close_time: most time for closing [s].
        grip_force: of each pad [N], the gripper's own limit at most; trials elsewhere use 20 to 40 N.
        settle_time: still, before the lift and after the last motion [s].
        lift_height, lift_time: [m], [s].
        shake_acceleration: highest, both ways along each axis of the TCP [m/s2]; 0: no shaking.
        shake_period: of one swing [s].
        turn_degrees, turn_time: about the closing axis, both ways and back.
        slip, slip_degrees: most the object may move in the gripper [m], degrees.
        penetration: more overlap than this [m], and the physics is not believed.
        table_settle_time: the object stands by itself this long first [s].
        perturbation: of the perturbed trials.
    """

    name: str
    support: str
    time_step: float = 1 / 240
    solver_iterations: int = 50
    solver_residual: float = 1e-6
    density: float = 500.0
    mass_limits: tuple[float, float] = (0.05, 1.0)
    friction: float = 0.8
    spinning_friction: float = 0.002
    air_damping: float = 30.0
    hold_force: float = 300.0
    contact_erp: float = 0.8
    friction_erp: float = 0.8
    drive_mass: float = 0.2
    gear_force: float = 50.0
    gear_erp: float = 1.0
    approach_step: float = 0.002
    clearance_tolerance: float = 2e-4
    finger_speed: float = 0.06
    close_time: float = 1.0
    grip_force: float = 40.0
    settle_time: float = 0.05
    lift_height: float = 0.10
    lift_time: float = 0.3
    shake_acceleration: float = GRAVITY
    shake_period: float = 0.1
    turn_degrees: float = 30.0
    turn_time: float = 0.8
    slip: float = 0.02
    slip_degrees: float = 30.0
    penetration: float = 0.003
    table_settle_time: float = 0.25
    perturbation: Perturbation = dataclasses.field(default_factory=Perturbation)

    def as_data(self) -> dict:
        """Every number, as plain data."""
        return dataclasses.asdict(self)


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        Protocol("lift-shake-v1", support="air"),
        Protocol("table-lift-v1", support="table", lift_height=0.15, lift_time=0.6, shake_acceleration=0.0,
                 turn_degrees=0.0, settle_time=0.5),
    )
}  # fmt: skip


def list_protocols() -> list[str]:
    """Names of the protocols."""
    return sorted(PROTOCOLS)


def load_protocol(protocol: str | Protocol) -> Protocol:
    """A protocol by name; one of your own is returned as it is.

    Raises:
        SettingsError: unknown name, or numbers that make no sense.
    """
    if isinstance(protocol, Protocol):
        return _checked(protocol)
    if protocol not in PROTOCOLS:
        raise SettingsError(
            "is not a known protocol", key="protocol", value=protocol, choices=list_protocols()
        )
    return PROTOCOLS[protocol]


def _checked(protocol: Protocol) -> Protocol:
    published = PROTOCOLS.get(protocol.name)
    if published is not None and published != protocol:
        raise SettingsError(
            "is a published protocol with other numbers",
            key="protocol.name",
            value=protocol.name,
            fix="Give your own protocol a name of its own",
        )
    if protocol.support not in ("air", "table"):
        raise SettingsError(
            "is unknown", key="protocol.support", value=protocol.support, choices=("air", "table")
        )
    for name, lowest in (("time_step", 1e-4), ("solver_iterations", 1), ("grip_force", 0.1),
                         ("finger_speed", 1e-3), ("approach_step", 1e-4), ("friction", 0.0)):  # fmt: skip
        value = getattr(protocol, name)
        if not value >= lowest:
            raise SettingsError(f"must be at least {lowest:g}", key=f"protocol.{name}", value=value)
    return protocol

"""How a grasp is executed, as data: named, versioned, and printed with every number.

A success rate means nothing without its protocol. A published protocol never changes: with any other number
it gets another version. Lengths are in metres, times in seconds, forces in newtons.
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
        mass: largest factor by which the object's mass is multiplied or divided, evenly on a logarithmic
            scale.
    """

    position: float = 0.003
    degrees: float = 5.0
    friction: float = 0.2
    mass: float = 1.0


@dataclass(frozen=True)
class Protocol:
    """One way to execute a grasp.

    Args:
        name: name with version.
        support: what the object rests on before it is held: `air` (no weight until the fingers have
            closed, and the air so thick that nothing drifts) or `table` (it stands on a plane).
        time_step: time step of the physics [s].
        solver_iterations: iterations of the constraint solver in each step, at most.
        solver_residual: the squared velocity error at which it stops earlier, m2/s2.
        density: density of the object, kg/m3; its mass is density x volume.
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
        gear_force, gear_erp: force and error reduction of the constraint that couples the fingers.
        approach_step: between checked poses of the approach [m].
        clearance_tolerance: overlap at most this deep is no collision [m].
        finger_speed: each pad's, closing [m/s].
        close_time: most time for closing [s]; a hand that needs longer for its stroke gets what it needs.
        grip_force: force of each pad [N], the gripper's own limit at most; trials elsewhere use 20 to 40 N.
        settle_time: still, before the lift and after the last motion [s].
        lift_height, lift_time: [m], [s].
        shake_acceleration: highest, both ways along each axis of the TCP [m/s2]; 0: no shaking.
        shake_period: period of one swing [s].
        shake_jumps: whether each axis' swing begins where the first one began: the hand is thrown back there,
            16 mm in one step, with all of `hold_force`. So `lift-shake-v1` does, against what it says.
        turn_degrees, turn_time: angle and duration of the turn about the closing axis, both ways and back.
        slip, slip_degrees: most the object may move in the gripper [m], degrees.
        penetration: with a deeper overlap than this [m] the physics cannot be trusted.
        table_settle_time: the object stands by itself this long first [s].
        perturbation: errors of the perturbed trials.
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
    shake_jumps: bool = False
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
        Protocol("lift-shake-v1", support="air", shake_jumps=True),
        Protocol("lift-shake-v2", support="air", time_step=1 / 480, solver_iterations=200,
                 solver_residual=1e-8, perturbation=Perturbation(mass=2.0)),
        Protocol("table-lift-v1", support="table", lift_height=0.15, lift_time=0.6, shake_acceleration=0.0,
                 turn_degrees=0.0, settle_time=0.5),
    )
}  # fmt: skip

# Least and largest values of a protocol of one's own: without these the physics cannot be believed.
BOUNDS = {
    "time_step": (1e-4, 1 / 60),
    "solver_iterations": (1, 10_000),
    "solver_residual": (0, 1),
    "density": (1, 30_000),
    "friction": (0, 5),
    "spinning_friction": (0, 1),
    "air_damping": (0, 1000),
    "hold_force": (1, 1e5),
    "contact_erp": (0, 1),
    "friction_erp": (0, 1),
    "drive_mass": (1e-3, 10),
    "gear_force": (1e-3, 1e5),
    "gear_erp": (0, 1),
    "approach_step": (1e-4, 0.1),
    "clearance_tolerance": (0, 0.01),
    "finger_speed": (1e-3, 1),
    "close_time": (0.05, 100),
    "grip_force": (0.1, 1e4),
    "settle_time": (0, 100),
    "lift_height": (0.01, 2),
    "lift_time": (0.05, 100),
    "shake_acceleration": (0, 1000),
    "shake_period": (0.02, 10),
    "turn_degrees": (0, 180),
    "turn_time": (0.05, 100),
    "slip": (1e-3, 1),
    "slip_degrees": (0.1, 180),
    "penetration": (1e-4, 0.1),
    "table_settle_time": (0, 100),
}
PERTURBATION_BOUNDS = {"position": (0, 0.1), "degrees": (0, 180), "friction": (0, 0.5), "mass": (1, 10)}


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
    if not isinstance(protocol.name, str) or not protocol.name:
        raise SettingsError("must be a name", key="protocol.name", value=protocol.name)
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
    _check_numbers(protocol, BOUNDS, "protocol")
    if not _mass_limits(protocol.mass_limits):
        raise SettingsError(
            "must be two masses in kg, the smaller first",
            key="protocol.mass_limits",
            value=protocol.mass_limits,
        )
    check_perturbation(protocol.perturbation)
    return protocol


def _mass_limits(given: object) -> bool:
    numbers = isinstance(given, list | tuple) and all(
        isinstance(one, int | float) and not isinstance(one, bool) for one in given
    )
    return numbers and len(given) == 2 and 1e-3 <= given[0] <= given[1] <= 1000  # pyright: ignore[reportArgumentType, reportIndexIssue]


def check_perturbation(perturb: Perturbation) -> None:
    """Refuse errors that no trial could have.

    Raises:
        SettingsError: not a number, or outside what is possible.
    """
    if not isinstance(perturb, Perturbation):
        raise SettingsError("must be a Perturbation", key="perturbation", value=type(perturb).__name__)
    _check_numbers(perturb, PERTURBATION_BOUNDS, "perturbation")


def _check_numbers(settings: Protocol | Perturbation, bounds: dict, name: str) -> None:
    for field, (low, high) in bounds.items():
        value = getattr(settings, field)
        whole = field == "solver_iterations"
        kinds = int if whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
            kind = "a whole number" if whole else "a number"
            raise SettingsError(
                f"must be {kind} from {low:g} to {high:g}", key=f"{name}.{field}", value=value
            )

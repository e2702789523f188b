"""What a trial found, how it is kept as one line of JSON, and robustness over many trials."""

import enum
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field

import numpy as np
from jaxtyping import Float


class TrialStatus(enum.Enum):
    """Outcome of one trial; `advice` says what to do about it."""

    HELD = "held"
    IN_COLLISION = "in collision"
    BLOCKED_APPROACH = "blocked approach"
    TOO_WIDE = "too wide"
    NO_CONTACT = "no contact"
    SLIPPED_LIFT = "slipped in the lift"
    SLIPPED_SHAKE = "slipped in the shake"
    OUT_OF_STEP = "fingers out of step"
    UNSTABLE = "unstable"
    CRASHED = "crashed"

    @property
    def held(self) -> bool:
        """Whether the object was still in the gripper at the end."""
        return self is TrialStatus.HELD

    @property
    def advice(self) -> str:
        """One sentence of advice."""
        return _ADVICE[self]


_ADVICE = {
    TrialStatus.HELD: "Both pads hold the object to the end of the protocol.",
    TrialStatus.IN_COLLISION: "Refine the grasp, or open the gripper less or more before it.",
    TrialStatus.BLOCKED_APPROACH: "Come in along another direction, or shorten approach_distance.",
    TrialStatus.TOO_WIDE: "Use a gripper that opens wider, or grasp the object elsewhere.",
    TrialStatus.NO_CONTACT: "Move the grasp so that both pads meet the object.",
    TrialStatus.SLIPPED_LIFT: "Grasp nearer to the centre of mass, or where the surface is flatter.",
    TrialStatus.SLIPPED_SHAKE: "Grasp nearer to the centre of mass, or where more of the pads touches.",
    TrialStatus.OUT_OF_STEP: "Check limits, ratios and offsets of the gripper's joints, or use less force.",
    TrialStatus.UNSTABLE: "Inspect the frames: the physics, or the object's stand, cannot be trusted here.",
    TrialStatus.CRASHED: "The process of the physics engine ended; run the trial again.",
}


NEAR_LIMIT = 0.7  # Share of a limit, beyond which a verdict hangs on details of the physics.


@dataclass(frozen=True)
class Recording:
    """Where everything was during a trial, t moments.

    Args:
        seconds: (t,) since the gripper stood at the grasp's start.
        phases: name of the phase at each moment.
        world_from_object: (t, 4, 4) [m].
        world_from_link: (t, 4, 4) of each link of the gripper [m].
        table_height: z of the table's top [m], or None.
    """

    seconds: Float[np.ndarray, "t"]
    phases: tuple[str, ...]
    world_from_object: Float[np.ndarray, "t 4 4"]
    world_from_link: dict[str, Float[np.ndarray, "t 4 4"]]
    table_height: float | None


@dataclass(frozen=True)
class TrialResult:
    """The outcome of one trial.

    Args:
        grasp: name of the grasp.
        trial: its number, from 0.
        status: what happened.
        phase: phase of its end: `pre-check`, `settle`, `approach`, `close`, `lift`, `shake`, `turn`, `rest`.
        detail: one sentence with the numbers.
        slip_mm, slip_degrees: how far the object moved in the gripper after the fingers had closed.
        limit_used: largest share of what the protocol allows of slip, turn and overlap; 1 ends the trial.
        max_penetration_mm: deepest overlap of gripper and object after the fingers had closed.
        width_mm: distance between the pads at the end.
        protocol, gripper, engine: their names.
        friction, mass, force: conditions of this trial: Coulomb coefficient, kg, and N of each pad.
        seconds: time that the computation took.
        recording: poses over time, if a recording was asked for; files do not keep it.
    """

    grasp: str
    trial: int
    status: TrialStatus
    phase: str
    detail: str = ""
    slip_mm: float = 0.0
    slip_degrees: float = 0.0
    limit_used: float = 0.0
    max_penetration_mm: float = 0.0
    width_mm: float = 0.0
    protocol: str = ""
    gripper: str = ""
    engine: str = ""
    friction: float = 0.0
    mass: float = 0.0
    force: float = 0.0
    seconds: float = field(default=0.0, compare=False)
    recording: Recording | None = field(default=None, compare=False, repr=False)

    @property
    def held(self) -> bool:
        """Whether the object was still in the gripper at the end."""
        return self.status.held

    @property
    def near_limit(self) -> bool:
        """Whether it was held, and so nearly not that the verdict may be another by the smallest change."""
        return self.held and self.limit_used > NEAR_LIMIT

    def as_data(self) -> dict:
        """Plain data without the recording; `result_from_data` reads it."""
        data = asdict(self) if self.recording is None else asdict(_without_recording(self))
        del data["recording"]
        return data | {"status": self.status.name}


def _without_recording(result: TrialResult) -> TrialResult:
    from dataclasses import replace

    return replace(result, recording=None)


def result_from_data(data: dict) -> TrialResult:
    """The result that `TrialResult.as_data` wrote."""
    others = {key: value for key, value in data.items() if key != "status"}
    return TrialResult(status=TrialStatus[data["status"]], **others)


@dataclass(frozen=True)
class Robustness:
    """Share of a grasp's trials that were held, with its 95 % Wilson interval.

    Args:
        grasp: name of the grasp.
        held, trials: counts; crashed trials count as neither.
        near_limit: how many of those that were held were so only just.
        share: held / trials, NaN without trials.
        low, high: interval.
    """

    grasp: str
    held: int
    trials: int
    share: float
    low: float
    high: float
    near_limit: int = 0


def wilson_interval(held: int, trials: int) -> tuple[float, float]:
    """95 % interval of a share, (0, 1) without trials.

    Wilson, "Probable inference, the law of succession, and statistical inference", JASA 1927.
    """
    if trials == 0:
        return 0.0, 1.0
    from scipy.stats import binomtest

    low, high = binomtest(held, trials).proportion_ci(0.95, method="wilson")
    return float(low), float(high)


def robustness(results: Iterable[TrialResult]) -> list[Robustness]:
    """One entry for each grasp, in the order they appear."""
    groups: dict[str, list[TrialResult]] = {}
    for result in results:
        groups.setdefault(result.grasp, []).append(result)
    found = []
    for name, group in groups.items():
        counted = [result.held for result in group if result.status is not TrialStatus.CRASHED]
        held, trials = sum(counted), len(counted)
        share = held / trials if trials else float("nan")
        near = sum(result.near_limit for result in group)
        found.append(Robustness(name, held, trials, share, *wilson_interval(held, trials), near))
    return found

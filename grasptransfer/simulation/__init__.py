"""Grasps, a mesh and a protocol in; trials out: held or not, and the reason.

Loaded on first use; an engine, PyBullet or MuJoCo, only when a trial runs.
"""

from grasptransfer.simulation.engines import installed_engines, list_engines
from grasptransfer.simulation.execution import simulate
from grasptransfer.simulation.outcome import (
    Recording,
    Robustness,
    TrialResult,
    TrialStatus,
    robustness,
    wilson_interval,
)
from grasptransfer.simulation.protocol import (
    PROTOCOLS,
    Perturbation,
    Protocol,
    list_protocols,
    load_protocol,
)

__all__ = [
    "PROTOCOLS",
    "Perturbation",
    "Protocol",
    "Recording",
    "Robustness",
    "TrialResult",
    "TrialStatus",
    "installed_engines",
    "list_engines",
    "list_protocols",
    "load_protocol",
    "robustness",
    "simulate",
    "wilson_interval",
]

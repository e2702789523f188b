"""Physics engines behind one seam: a protocol is data, and runs on each of them.

An engine is registered once, in this file. Its library is imported when a world is opened, never before;
where one engine has no wheels, everything works with the other.
"""

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import TYPE_CHECKING

from grasptransfer.errors import SettingsError

if TYPE_CHECKING:
    from grasptransfer.simulation.body import Body
    from grasptransfer.simulation.engines.seam import World
    from grasptransfer.simulation.hand import Hand
    from grasptransfer.simulation.protocol import Protocol


@dataclass(frozen=True)
class _Engine:
    """Where an engine's world is defined, which package it needs, and how to install that package."""

    module: str
    world: str
    library: str
    distributions: tuple[str, ...]
    missing: str


ENGINES = {
    "pybullet": _Engine(
        "grasptransfer.simulation.engines.bullet_world",
        "BulletWorld",
        "pybullet",
        ("pybullet",),
        "It has no wheels from Python 3.12 on: take engine='mujoco', or build it with pip and a C++ compiler",
    ),
    "mujoco": _Engine(
        "grasptransfer.simulation.engines.mujoco_world",
        "MujocoWorld",
        "mujoco",
        ("mujoco-core", "mujoco"),
        "pip install mujoco-core (Python 3.10: mujoco)",
    ),
}  # in the order of preference


def list_engines() -> list[str]:
    """Names of the engines."""
    return list(ENGINES)


def installed_engines() -> list[str]:
    """Names of those whose library is installed, the default first."""
    return [name for name, engine in ENGINES.items() if find_spec(engine.library) is not None]


def choose_engine(name: str | None = None) -> str:
    """The engine's name; None: the first that is installed.

    Raises:
        SettingsError: unknown, or its library is not installed.
    """
    if name is not None and name not in ENGINES:
        raise SettingsError("is not a known physics engine", key="engine", value=name, choices=ENGINES)
    installed = installed_engines()
    if name is None:
        if not installed:
            raise SettingsError("no physics engine is installed", key="engine", choices=ENGINES)
        return installed[0]
    if name not in installed:
        raise SettingsError(
            "is not installed here", key="engine", value=name, choices=installed, fix=ENGINES[name].missing
        )
    return name


def engine_version(name: str) -> str:
    """Version of the engine's library."""
    for distribution in ENGINES[name].distributions:
        try:
            return version(distribution)
        except ModuleNotFoundError:  # PackageNotFoundError is one
            continue
    return ""


def open_world(engine: str, body: "Body", hand: "Hand", protocol: "Protocol") -> "World":
    """A world of this engine with one gripper and one object.

    Args:
        engine: name of an installed engine.
        body: the object.
        hand: the gripper.
        protocol: how the trials are executed.

    Raises:
        SettingsError: the engine is unknown, or its library is not installed.
    """
    chosen = ENGINES[choose_engine(engine)]
    return getattr(import_module(chosen.module), chosen.world)(body, hand, protocol)

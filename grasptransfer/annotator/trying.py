"""Trying an annotated grasp while it is edited: on other shapes of the category, and in simulation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from grasptransfer.annotator.session import Session
from grasptransfer.grasping import CollisionWorld, GraspCheck, WarpedGrasp, check_grasps, warp_grasps
from grasptransfer.registration import DeformationField

if TYPE_CHECKING:
    from grasptransfer.simulation import TrialResult

FILM_RATE = 12.0  # frames a second of a trial
PREVIEWED = 6  # instances


@dataclass(frozen=True)
class OnShape:
    """A grasp on another shape of its category.

    Args:
        mesh: the canonical model warped to that shape [m].
        grasp: warped by the same field, not refined.
        check: of the warped grasp there.
    """

    mesh: trimesh.Trimesh
    grasp: WarpedGrasp
    check: GraspCheck


def on_shape(session: Session, name: str, field: DeformationField) -> OnShape:
    """A grasp warped to another shape of the category.

    Args:
        field: canonical to that shape.
    """
    found, grasp = session.measure(name), session.grasp(name)
    width = grasp.width if found.width is None else found.width
    warped = warp_grasps([replace(grasp, contacts=found.contacts, width=width)], field)
    mesh = session.category.canonical.copy()
    mesh.vertices = field(np.asarray(mesh.vertices))
    return OnShape(mesh, warped[0], check_grasps(warped, CollisionWorld(mesh), session.gripper)[0])


def on_instances(session: Session, name: str, *, most: int = PREVIEWED) -> list[OnShape]:
    """A grasp warped to train instances, spread evenly over their list."""
    train = session.category.train
    chosen = np.unique(np.linspace(0, len(train) - 1, min(most, len(train))).round().astype(int))
    return [on_shape(session, name, session.category.field(train[i])) for i in chosen]


def on_latent(session: Session, name: str, latent: Sequence[float]) -> OnShape:
    """A grasp warped to a shape of the shape space.

    Args:
        latent: first coordinates, in standard deviations; the others are 0.
    """
    space = session.category.shape_space
    whole = np.zeros(space.n_modes)
    whole[: len(latent)] = latent
    return on_shape(session, name, space.field(whole))


def try_out(session: Session, name: str, *, protocol: str = "lift-shake-v1", seed: int = 0) -> "TrialResult":
    """Execute a grasp on the canonical model, filmed.

    Raises:
        SettingsError: there is no such grasp or protocol.
    """
    from grasptransfer.simulation import simulate

    found, grasp = session.measure(name), session.grasp(name)
    grasp = replace(grasp, width=found.width or grasp.width, opening=grasp.opening or found.opening)
    mesh = session.category.canonical
    return simulate([grasp], mesh, session.gripper, protocol=protocol, seed=seed, frames=FILM_RATE)[0]

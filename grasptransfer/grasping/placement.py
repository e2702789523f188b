"""Grasps shifted a little to where they are likeliest to hold, over all that the picture leaves possible.

Refinement knows one shape, the reconstruction. Some millimetres nearer to the centre of mass, or with
more room before the palm, a grasp forgives more of what the reconstruction has wrong. Each of the best
grasps is tried at the places of a small grid, deeper or less deep and along the pads; their expected
success is that of the ranking, on some of its draws. The best place that passes the check is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.grasping.closing import Closing, close_pads
from grasptransfer.grasping.collision import GraspCheck, check_grasps
from grasptransfer.grasping.features import features_around
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.ranking import rank_grasps
from grasptransfer.grasping.success_model import Ranking, expected_success
from grasptransfer.grasping.warping import WarpedGrasp
from grasptransfer.grasping.world import CollisionWorld


@dataclass(frozen=True)
class Placement:
    """Settings of the search.

    Args:
        ways: shifts along the approach and along the pads' y, each with each [m].
        most: grasps that are placed, those of highest expected success.
        draws: plausible objects on which places are compared.
        leaving: expected success that a shift of `far` has to gain; it grows with the square.
        far: m.
        tries: places whose check is tried.
        gain: least expected success that a place has to gain.
    """

    ways: tuple[float, ...] = (-0.008, -0.004, 0.0, 0.004, 0.008)
    most: int = 8
    draws: int = 8
    leaving: float = 0.02
    far: float = 0.01
    tries: int = 4
    gain: float = 0.005


def place_grasps(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    world: CollisionWorld,
    gripper: Gripper,
    *,
    plausible: PlausibleObjects,
    settings: Placement | None = None,
) -> tuple[tuple[WarpedGrasp, ...], tuple[GraspCheck, ...]]:
    """Shift the best grasps to where expected success is highest; the others stay.

    Args:
        grasps: refined, object frame.
        checks: of each; one that failed its check stays as it is.
        world: reconstruction and scene.
        plausible: objects that the picture leaves possible.

    Returns:
        The grasps and their checks, in the order given.
    """
    settings = settings or Placement()
    few = plausible.some(settings.draws)
    scores = np.array(rank_grasps(grasps, checks, gripper, plausible=few))
    chosen = [int(i) for i in np.argsort(-scores, kind="stable")[: settings.most] if scores[i] > 0]
    placed, checked = list(grasps), list(checks)
    if chosen:
        search = _Search(
            [grasps[i] for i in chosen], [checks[i] for i in chosen], world, gripper, few, settings
        )
        for number, i in enumerate(chosen):
            placed[i], checked[i] = search.best(number)
    return tuple(placed), tuple(checked)


class _Search:
    """All places of all grasps of one call; the first place of each is where it stands."""

    def __init__(
        self,
        grasps: list[WarpedGrasp],
        checks: list[GraspCheck],
        world: CollisionWorld,
        gripper: Gripper,
        plausible: PlausibleObjects,
        settings: Placement,
    ):
        self.grasps, self.checks, self.settings = grasps, checks, settings
        self.world, self.gripper, self.plausible = world, gripper, plausible
        self.shifts = np.tile(_grid(settings.ways), (len(grasps), 1, 1))
        self.closing = self._close()
        # Between the pads again, where the object is not as straight as the shift.
        middle = self.closing.off_centre.reshape(self.shifts.shape[:2])
        self.shifts[..., 1:, 0] = np.nan_to_num(middle)[..., 1:]

    def _close(self) -> Closing:
        places, starts = self.shifts.shape[1], np.stack([g.object_from_gripper for g in self.grasps])
        poses = np.tile(starts[:, None], (1, places, 1, 1))
        poses[..., :3, 3] += np.einsum("gij,gpj->gpi", starts[:, :3, :3], self.shifts)
        openings = np.repeat([check.opening for check in self.checks], places)
        widths = np.repeat([grasp.width for grasp in self.grasps], places)
        return close_pads(
            self.world.surface, poses.reshape(-1, 4, 4), openings, self.gripper, expected=widths
        )

    def best(self, number: int) -> tuple[WarpedGrasp, GraspCheck]:
        """The grasp at its best place, and the check there."""
        grasp, check, settings = self.grasps[number], self.checks[number], self.settings
        shifts, places = self.shifts[number], self.shifts.shape[1]
        touching = self.closing.touching[number * places :][:places].all(axis=1)
        chances = self._chances(grasp, check.opening, shifts)
        left = np.linalg.norm(shifts, axis=1) / settings.far
        value = np.where(touching, chances - settings.leaving * left**2, -np.inf)
        for place in np.argsort(-value, kind="stable")[: settings.tries]:
            if value[place] < chances[0] + settings.gain:
                break
            moved = self._moved(grasp, shifts[place], number * places + int(place))
            there = check_grasps([moved], self.world, self.gripper)[0]
            # Its check may have chosen another opening, which has other chances.
            if there.usable and self._chances(moved, there.opening, np.zeros((1, 3)))[0] > chances[0]:
                return moved, there
        return grasp, check

    def _chances(
        self, grasp: WarpedGrasp, opening: float, shifts: Float[np.ndarray, "p 3"]
    ) -> Float[np.ndarray, "p"]:
        features = features_around(grasp, opening, self.gripper, self.plausible, shifts)
        return np.asarray(expected_success(features, Ranking.fitted().weights))

    def _moved(self, grasp: WarpedGrasp, shift: Float[np.ndarray, "3"], row: int) -> WarpedGrasp:
        pose = grasp.object_from_gripper.copy()
        pose[:3, 3] += pose[:3, :3] @ shift
        return grasp.closing_at(pose, float(self.closing.width[row]), self.closing.points[row])


def _grid(ways: tuple[float, ...]) -> Float[np.ndarray, "p 3"]:
    """Shifts along y and z, gripper frame [m]; none first."""
    y, z = (part.ravel() for part in np.meshgrid(ways, ways, indexing="ij"))
    moved = (y != 0) | (z != 0)
    grid = np.stack([np.zeros(moved.sum()), y[moved], z[moved]], axis=1)
    return np.concatenate([np.zeros((1, 3)), grid])

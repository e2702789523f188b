"""Grasps shifted and opened so that they are likeliest to hold, over all that the picture leaves possible.

Refinement knows one shape, the reconstruction. Some millimetres nearer to the centre of mass, or with more
room before the palm, a grasp forgives more of what the reconstruction has wrong, and so it does with the
opening that leaves most room on both sides of each finger. Each grasp is tried with a few openings, then at
the places of a small pattern, deeper or less deep and along the pads; their expected success is that of the
ranking. The grasp goes to the mean of them, each weighted by exp(expected success / temperature). The best
one would jump from place to place under noise that nobody sees; this mean moves as little as its weights do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from grasptransfer.grasping.closing import Closing, close_pads
from grasptransfer.grasping.collision import LEAST_ROOM, GraspCheck, check_grasps
from grasptransfer.grasping.features import NearPoints
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.success_model import Ranking, expected_success
from grasptransfer.grasping.warping import WarpedGrasp
from grasptransfer.grasping.world import CollisionWorld, OpenedGripper


@dataclass(frozen=True)
class Placement:
    """Settings of the search.

    Args:
        rings: radii of the places around a grasp, along its approach and the pads' y, six on each [m].
        rooms: on each side of the object, of the openings that are tried beside the widest [m].
        temperature: how much less expected success counts 2.7 times less.
        leaving: expected success that a shift of `far` has to gain; it grows with the square.
        far: m.
        shares: shares of the shift that are tried, one after the other, until its check is passed.
    """

    rings: tuple[float, ...] = (0.004, 0.008)
    rooms: tuple[float, ...] = (0.005, 0.01, 0.02)
    temperature: float = 0.02
    leaving: float = 0.02
    far: float = 0.01
    shares: tuple[float, ...] = (1.0, 0.5, 0.25)


def place_grasps(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    world: CollisionWorld,
    gripper: Gripper,
    *,
    plausible: PlausibleObjects,
    settings: Placement | None = None,
) -> tuple[tuple[WarpedGrasp, ...], tuple[GraspCheck, ...]]:
    """Shift and open every grasp so that its expected success is highest.

    Args:
        grasps: refined, object frame.
        checks: check of each grasp; one that failed it stays as it is.
        world: reconstruction and scene.
        plausible: objects that the picture leaves possible.
        settings: settings of the search.

    Returns:
        The grasps and their checks, in the order given.
    """
    chosen = [i for i, check in enumerate(checks) if check.usable]
    placed, checked = list(grasps), list(checks)
    if chosen:
        standing = [_Standing(grasps[i], checks[i]) for i in chosen]
        search = _Search(standing, world, gripper, plausible.half(), settings or Placement())
        for i, (grasp, check) in zip(chosen, search.run(), strict=True):
            placed[i], checked[i] = grasp, check
    return tuple(placed), tuple(checked)


@dataclass(frozen=True)
class _Standing:
    """A grasp where refinement left it, and its check there."""

    grasp: WarpedGrasp
    check: GraspCheck


class _Search:
    """All grasps of one call."""

    def __init__(
        self,
        standing: list[_Standing],
        world: CollisionWorld,
        gripper: Gripper,
        plausible: PlausibleObjects,
        settings: Placement,
    ):
        self.standing, self.world, self.gripper, self.settings = standing, world, gripper, settings
        self.pattern = _pattern(settings.rings)
        self.poses = np.stack([one.grasp.object_from_gripper for one in standing])
        self.widths = np.array([one.grasp.width for one in standing])
        tried = [self._openings(one.grasp, one.check) for one in standing]
        self.near = [
            NearPoints.of(one.grasp, gripper, plausible, openings=openings, shifts=self.pattern)
            for one, openings in zip(standing, tried, strict=True)
        ]
        chances = [
            np.array([self._chances(i, opening, self.pattern[:1])[0] for opening in openings])
            for i, openings in enumerate(tried)
        ]
        self.before = np.array([each[0] for each in chances])
        self.openings = np.array(
            [self._weights(each) @ openings for each, openings in zip(chances, tried, strict=True)]
        )

    def run(self) -> list[tuple[WarpedGrasp, GraspCheck]]:
        """Each grasp at its best place, and the check there."""
        found = [(one.grasp, one.check) for one in self.standing]
        best, left = self._best(), list(range(len(found)))
        for share in self.settings.shares:
            closing, shifts = self._between_pads(share * best[:, None])
            left = [i for i in left if closing.touching[i].all()]
            moved = [self._moved(i, shifts[i, 0], closing) for i in left]
            for i, grasp, check in zip(
                tuple(left), moved, check_grasps(moved, self.world, self.gripper), strict=True
            ):
                # The check may have chosen another opening, which has other chances.
                if check.usable and self._chances(i, check.opening, shifts[i])[0] >= self.before[i]:
                    found[i] = replace(grasp, opening=self.standing[i].grasp.opening), check
                    left.remove(i)
        return found

    def _best(self) -> Float[np.ndarray, "g 3"]:
        """The shift of each grasp: the mean of the pattern, weighted by expected success."""
        shifts = self._between_pads(np.tile(self.pattern, (len(self.standing), 1, 1)))[1]
        far = np.linalg.norm(shifts, axis=2) / self.settings.far
        best = []
        for i, (opening, each, left) in enumerate(zip(self.openings, shifts, far, strict=True)):
            value = self._chances(i, opening, each) - self.settings.leaving * left**2
            best.append(self._weights(value) @ each)
        return np.stack(best)

    def _openings(self, grasp: WarpedGrasp, check: GraspCheck) -> list[float]:
        """Openings to come in with [m], first that of the check; it alone where a person has said so."""
        if grasp.opening is not None:
            return [check.opening]
        least, most = grasp.width + 2 * LEAST_ROOM, self.gripper.max_width
        wanted = [most, *(grasp.width + 2 * room for room in self.settings.rooms)]
        tried = {round(float(np.clip(opening, least, most)), 9) for opening in wanted}
        return [check.opening, *sorted(tried - {round(check.opening, 9)})]

    def _chances(self, i: int, opening: float, shifts: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "c"]:
        """Expected success of a grasp after each shift."""
        room = None
        if self.world.has_obstacles:
            room = self.world.beside(self.poses[i], OpenedGripper(self.gripper, opening)).after(shifts)
        features = self.near[i].features(opening, shifts, room=room)
        return np.asarray(expected_success(features, Ranking.fitted().weights))

    def _weights(self, value: Float[np.ndarray, "c"]) -> Float[np.ndarray, "c"]:
        weights = np.exp((value - value.max()) / self.settings.temperature)
        return weights / weights.sum()

    def _between_pads(self, shifts: Float[np.ndarray, "g c 3"]) -> tuple[Closing, Float[np.ndarray, "g c 3"]]:
        """How each grasp closes after each shift, and the shifts with the object between the pads again."""
        count = shifts.shape[1]
        poses = np.repeat(self.poses, count, axis=0)
        poses[:, :3, 3] += np.einsum("gij,gcj->gci", self.poses[:, :3, :3], shifts).reshape(-1, 3)
        openings, widths = np.repeat(self.openings, count), np.repeat(self.widths, count)
        closing = close_pads(self.world.surface, poses, openings, self.gripper, expected=widths)
        centred = shifts.copy()
        centred[..., 0] += np.nan_to_num(closing.off_centre).reshape(shifts.shape[:2])
        return closing, centred

    def _moved(self, i: int, shift: Float[np.ndarray, "3"], closing: Closing) -> WarpedGrasp:
        """A grasp after its shift, closing on what it meets there."""
        pose, grasp = self.poses[i].copy(), self.standing[i].grasp
        pose[:3, 3] += pose[:3, :3] @ shift
        there = grasp.closing_at(pose, float(closing.width[i]), closing.points[i])
        return replace(there, opening=float(self.openings[i]))


def _pattern(rings: tuple[float, ...]) -> Float[np.ndarray, "c 3"]:
    """Shifts along y and z, gripper frame [m]; none first, then hexagons."""
    angles = np.radians(60) * np.arange(6)
    ring = np.stack([np.zeros(6), np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([np.zeros((1, 3)), *(radius * ring for radius in rings)])

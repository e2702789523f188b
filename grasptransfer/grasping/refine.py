"""Local search around a warped grasp on the instance's surface.

A grasp that is too wide first slides to where the gripper fits. Then a few rounds of sampled motions of
the TCP, all grasps at once. The cost of a pose asks for contact on both pads, normals against the pads,
contacts in the middle of the pads, room around the opened gripper, and nearness to the annotated intention.
Each round moves a grasp by the mean of the sampled motions, each weighted by exp(-cost / temperature), as
far along it as the same weights say (path integral control; Theodorou, Buchli and Schaal, 2010). The
cheapest sample would jump under noise that nobody sees; the mean moves as little as its weights do. Motions
come in pairs, and are the same for every grasp and every call: a grasp refines alone as it does among others.

Where the pose found still collides, with an obstacle of the scene or on its way in, the cheapest sampled pose
that is free is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.grasping.closing import Closing, close_pads
from grasptransfer.grasping.collision import LEAST_ROOM, MARGIN
from grasptransfer.grasping.draws import paired_draws
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.gripper_boxes import clearances, gripper_boxes, points_within
from grasptransfer.grasping.scene import Scene
from grasptransfer.grasping.sliding import slide_where_too_wide
from grasptransfer.grasping.surface import Surface
from grasptransfer.grasping.warping import WarpedGrasp
from grasptransfer.grasping.world import CollisionWorld, OpenedGripper, as_world

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class Refinement:
    """Settings of the search.

    Args:
        rounds: rounds of sampling; each one searches half as far as the one before, at half the temperature.
        samples: motions per grasp and round.
        temperature: cost by which a motion counts 2.7 times less, in the first round.
        shift: standard deviation of the first round's shifts [m].
        turn: standard deviation of the first round's turns [rad].
        farthest_shift, farthest_turn: where the cost of leaving the annotated intention reaches `leaving`.
        farthest_tilt: angle of a contact's normal where the cost reaches `tilt` [rad].
        missing, tilt, coverage, off_centre, leaving, colliding: weights of the cost.
        room: wanted around the opened gripper, and beside the object in it [m].
        tight: cost of having none; inside the object it grows with the square of the depth.
    """

    rounds: int = 3
    samples: int = 20
    temperature: float = 0.15
    shift: float = 0.005
    turn: float = 0.12
    farthest_shift: float = 0.015
    farthest_turn: float = 0.35
    farthest_tilt: float = 0.35
    missing: float = 4.0
    tilt: float = 1.5
    coverage: float = 0.5
    off_centre: float = 0.5
    leaving: float = 0.4
    colliding: float = 3.0
    room: float = 0.003
    tight: float = 0.7


# Motions always tried: none, back out along the approach, deeper in, and sideways.
_FIXED = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [0, 0, -0.004, 0, 0, 0],
        [0, 0, -0.008, 0, 0, 0],
        [0, 0, -0.014, 0, 0, 0],
        [0, 0, 0.004, 0, 0, 0],
        [0, 0.004, 0, 0, 0, 0],
        [0, -0.004, 0, 0, 0, 0],
        [0, 0, 0, 0, 0.2, 0],
        [0, 0, 0, 0, -0.2, 0],
    ]
)
STEP = 0.008  # m between poses of the approach; `check_grasps` looks twice as closely
_SHARES = np.array([0.0, 0.5, 1.0])  # of a motion: how far along it is weighed anew
FARTHEST = 0.04  # m: no point of the gripper moves farther
HALF_PAD = 0.009  # m; contacts this far from the pads' middle cost `off_centre`


def refine_grasps(
    grasps: Sequence[WarpedGrasp],
    mesh: "trimesh.Trimesh | Surface | CollisionWorld",
    gripper: Gripper,
    *,
    scene: Scene | None = None,
    camera_from_object: Float[np.ndarray, "4 4"] | None = None,
    settings: Refinement | None = None,
) -> tuple[WarpedGrasp, ...]:
    """Improve each grasp on the instance's surface; one that finds no contact stays as it was.

    Args:
        grasps: grasps in the mesh's frame.
        mesh: the object's surface, object frame [m]; a `CollisionWorld` brings its own scene.
        scene: obstacles and support plane, camera frame.
        camera_from_object: pose of the object (4, 4) [m]; matters with a scene only.
    """
    settings = Refinement() if settings is None else settings
    world = as_world(mesh, scene, camera_from_object)
    grasps = slide_where_too_wide(grasps, world.surface, gripper)
    fitting = [i for i, grasp in enumerate(grasps) if grasp.width + 2 * LEAST_ROOM <= gripper.max_width]
    if not fitting:
        return grasps
    search = _Search([grasps[i] for i in fitting], world, gripper, settings)
    refined = list(grasps)
    for i, better in zip(fitting, search.run(), strict=True):
        refined[i] = better
    return tuple(refined)


class _Search:
    """The state of one call: every grasp's best pose so far."""

    def __init__(
        self, grasps: Sequence[WarpedGrasp], world: CollisionWorld, gripper: Gripper, settings: Refinement
    ):
        self.grasps, self.world, self.gripper, self.settings = grasps, world, gripper, settings
        self.start = np.stack([grasp.object_from_gripper for grasp in grasps])
        self.widths = np.array([grasp.width for grasp in grasps])
        self.openings = np.array([gripper.approach_opening(width) for width in self.widths])
        self._between_pads()
        self.best = self.start.copy()
        self._widen()
        self.opened = [OpenedGripper(gripper, float(opening)) for opening in self.openings]
        self.boxes = [gripper_boxes(gripper, float(opening)) for opening in self.openings]
        assert world.points is not None
        self.near = [
            points_within(world.points[::2], pose, boxes, margin=FARTHEST)
            for pose, boxes in zip(self.best, self.boxes, strict=True)
        ]
        normal = paired_draws(np.eye(6), np.eye(6), settings.samples)[0]
        self.motions = normal * np.array([settings.shift] * 3 + [settings.turn] * 3)

    def run(self) -> list[WarpedGrasp]:
        """Search, then read widths and contacts off the surface."""
        scales = 0.5 ** np.arange(self.settings.rounds)
        self._align(1.0)
        for scale in scales:
            self._round(scale)
        self._align(scales[-1])
        self.best = self._centred(self.best[:, None])[1][:, 0]
        self._free()
        closing = self._close(self.best[:, None])
        return [self._result(i, closing) for i in range(len(self.grasps))]

    def _between_pads(self) -> None:
        """Start with the contacts between the opened pads, where they do not mirror each other at the TCP.

        A grasp annotated for another gripper has its contacts around the TCP; one jaw that stands may be
        there. Where contacts are not known, the TCP is taken to lie between them.
        """
        for i, (grasp, middle) in enumerate(
            zip(self.grasps, self.gripper.pad_middle(self.openings), strict=True)
        ):
            if middle != 0:
                pose = self.start[i]
                x = 0.0 if grasp.contacts is None else _along_x(pose, grasp.contacts)
                pose[:3, 3] += (x - middle) * pose[:3, 0]

    def _widen(self) -> None:
        """Open further where a pad would start inside the object."""
        for _ in range(int(np.ceil(self.gripper.max_width / 0.01))):
            inside = self._close(self.best[:, None]).buried.any(axis=1)
            if not (inside & (self.openings < self.gripper.max_width)).any():
                return
            self.openings[inside] = np.minimum(self.openings[inside] + 0.01, self.gripper.max_width)

    def _align(self, scale: float) -> None:
        """Turn the pads so that they meet the surface flat, as far as that pays."""
        closing = self._close(self.best[:, None])
        axis = closing.normals[:, 1] - closing.normals[:, 0]
        length = np.linalg.norm(axis, axis=1)
        usable = closing.touching.all(axis=1) & (length > 0.5)
        axis = np.where(usable[:, None], axis / np.where(usable, length, 1)[:, None], self.best[:, :3, 0])
        turn = np.cross(self.best[:, :3, 0], axis)
        turn = np.einsum("gji,gj->gi", self.best[:, :3, :3], turn)  # about the gripper's own axes
        motions = np.concatenate([np.zeros_like(turn), turn], axis=1)[:, None]
        self._advance(motions, scale * self.settings.temperature)

    def _round(self, scale: float) -> None:
        motions = np.concatenate([_FIXED if scale == 1 else _FIXED[:1], scale * self.motions])
        self._advance(np.tile(motions, (len(self.best), 1, 1)), scale * self.settings.temperature)

    def _advance(self, motions: Float[np.ndarray, "g c 6"], temperature: float) -> None:
        """Move each grasp by the weighted mean of its motions, as far as that pays, between the pads."""
        weights = _weights(self._cost(*self._centred(self._moved(motions))), temperature)
        mean = np.einsum("gc,gcm->gm", weights, motions)
        steps = _SHARES[:, None] * mean[:, None]
        along = _weights(self._cost(*self._centred(self._moved(steps))), temperature)
        self.best = self._moved(np.einsum("gc,gcm->gm", along, steps)[:, None])[:, 0]

    def _moved(self, motions: Float[np.ndarray, "g c 6"]) -> Float[np.ndarray, "g c 4 4"]:
        """Each grasp after each motion of its TCP, along its own axes."""
        from scipy.spatial.transform import Rotation

        candidates = np.tile(self.best[:, None], (1, motions.shape[1], 1, 1))
        turns = Rotation.from_rotvec(motions[..., 3:].reshape(-1, 3)).as_matrix()
        turns = turns.reshape(*motions.shape[:2], 3, 3)
        candidates[..., :3, :3] = self.best[:, None, :3, :3] @ turns
        candidates[..., :3, 3] += np.einsum("gij,gcj->gci", self.best[:, :3, :3], motions[..., :3])
        return candidates

    def _close(self, candidates: Float[np.ndarray, "g c 4 4"]) -> Closing:
        repeat = candidates.shape[1]
        return close_pads(
            self.world.surface,
            candidates.reshape(-1, 4, 4),
            np.repeat(self.openings, repeat),
            self.gripper,
            expected=np.repeat(self.widths, repeat),
        )

    def _centred(
        self, candidates: Float[np.ndarray, "g c 4 4"]
    ) -> tuple[Closing, Float[np.ndarray, "g c 4 4"]]:
        """How the candidates close, and where the object is in the middle between their pads."""
        closing, centred = self._close(candidates), candidates.copy()
        middle = np.nan_to_num(closing.off_centre).reshape(candidates.shape[:2])
        centred[..., :3, 3] += centred[..., :3, 0] * middle[..., None]
        return closing, centred

    def _free(self) -> None:
        """Where a grasp's pose collides, the cheapest free one of those around it and around its start."""
        blocked = [i for i, pose in enumerate(self.best) if self._blocked(i, pose)]
        if not blocked:
            return
        motions = np.tile(np.concatenate([_FIXED, self.motions]), (len(self.best), 1, 1))
        closing, candidates = self._centred(self._moved(motions))
        cost = self._cost(closing, candidates)
        for i in blocked:
            order = np.argsort(cost[i], kind="stable")
            cheap = order[cost[i, order] < cost[i, order[0]] + self.settings.colliding]
            free = [candidate for candidate in cheap if not self._blocked(i, candidates[i, candidate])]
            self.best[i] = candidates[i, free[0] if free else order[0]]

    def _blocked(self, i: int, pose: Float[np.ndarray, "4 4"]) -> bool:
        """Whether the opened gripper touches anything, or comes too near, at a pose or on its way in."""
        back, way = pose.copy(), self.grasps[i].approach_distance
        for distance in np.linspace(0.0, way, int(np.ceil(way / STEP)) + 1):
            back[:3, 3] = pose[:3, 3] - distance * pose[:3, 2]
            opened = self.opened[i]
            if self.world.touching(back, opened) or self.world.room(back, opened) < MARGIN:
                return True
        return False

    def _cost(self, closing: Closing, candidates: Float[np.ndarray, "g c 4 4"]) -> Float[np.ndarray, "g c"]:
        settings, shape = self.settings, candidates.shape[:2]
        missing = (~closing.touching).sum(axis=1).reshape(shape)
        tilt = np.arccos(np.clip(closing.cosines.min(axis=1), -1, 1)).reshape(shape)
        bare = 1 - closing.coverage.min(axis=1).reshape(shape)
        middle = np.nan_to_num(closing.local[..., 1:]).mean(axis=1)
        middle -= self.gripper.pad_faces(np.repeat(self.widths, shape[1])).across.mean(axis=1)
        off = (np.linalg.norm(middle, axis=1) / HALF_PAD).reshape(shape)
        shift = np.linalg.norm(candidates[..., :3, 3] - self.start[:, None, :3, 3], axis=2)
        relative = np.einsum("gji,gcjk->gcik", self.start[:, :3, :3], candidates[..., :3, :3])
        trace = np.trace(relative, axis1=2, axis2=3)
        turn = np.arccos(np.clip((trace - 1) / 2, -1, 1))
        left = (shift / settings.farthest_shift) ** 2 + (turn / settings.farthest_turn) ** 2
        left_over = self.gripper.max_width - np.nan_to_num(closing.width).reshape(shape)
        tight = np.clip(1 - left_over / (2 * settings.room), 0, None)
        rooms = [
            clearances(near, poses, boxes, far=settings.room)
            for near, poses, boxes in zip(self.near, candidates, self.boxes, strict=True)
        ]
        missing_room = 1 - np.maximum(np.stack(rooms), -4 * settings.room) / settings.room
        return (
            settings.missing * missing
            + settings.tilt * (tilt / settings.farthest_tilt) ** 2
            + settings.coverage * bare
            + settings.off_centre * off**2
            + settings.leaving * left
            + settings.tight * (tight + missing_room**2)
        )

    def _result(self, i: int, closing: Closing) -> WarpedGrasp:
        grasp = self.grasps[i]
        if not closing.touching[i].all():
            return grasp
        return grasp.closing_at(self.best[i], float(closing.width[i]), closing.points[i])


def _weights(cost: Float[np.ndarray, "g c"], temperature: float) -> Float[np.ndarray, "g c"]:
    weights = np.exp((cost.min(axis=1, keepdims=True) - cost) / temperature)
    return weights / weights.sum(axis=1, keepdims=True)


def _along_x(pose: Float[np.ndarray, "4 4"], contacts: Float[np.ndarray, "2 3"]) -> float:
    """x of the middle of the contacts in the pose's frame [m]."""
    return float((contacts.mean(axis=0) - pose[:3, 3]) @ pose[:3, 0])

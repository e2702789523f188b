"""Local search around a warped grasp on the instance's surface.

A grasp that is too wide first slides to where the gripper fits. Then a few rounds of sampled motions of
the TCP, all grasps at once: each round keeps, per grasp, the cheapest pose that collides with nothing,
or one with room before palm and finger tips where that costs little more. The cost asks for contact on
both pads, normals against the pads, contacts in the middle of the pads, and nearness to the annotated
intention. The samples are the same for every grasp and every call: a grasp refines alone as it does
among others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.grasping.closing import Closing, close_pads
from grasptransfer.grasping.collision import LEAST_ROOM
from grasptransfer.grasping.gripper import Gripper
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
        rounds: of sampling; each one searches half as far as the one before.
        samples: motions per grasp and round.
        shift: standard deviation of the first round's shifts [m].
        turn: standard deviation of the first round's turns [rad].
        farthest_shift, farthest_turn: where the cost of leaving the annotated intention reaches `leaving`.
        farthest_tilt: angle of a contact's normal where the cost reaches `tilt` [rad].
        missing, tilt, coverage, off_centre, leaving, colliding: weights of the cost.
        room: wanted before palm and finger tips, and beside the object in the open gripper [m].
        tight: cost of having none.
    """

    rounds: int = 3
    samples: int = 20
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
        grasps: in the mesh's frame.
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
        self.rng = np.random.default_rng(0)

    def run(self) -> list[WarpedGrasp]:
        """Search, then read widths and contacts off the surface."""
        self._align()
        for round_ in range(self.settings.rounds):
            self._round(0.5**round_, first=round_ == 0)
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

    def _align(self) -> None:
        """Take as another start the pose turned so that the pads meet the surface flat."""
        closing = self._close(self.best[:, None])
        axis = closing.normals[:, 1] - closing.normals[:, 0]
        length = np.linalg.norm(axis, axis=1)
        usable = closing.touching.all(axis=1) & (length > 0.5)
        axis = np.where(usable[:, None], axis / np.where(usable, length, 1)[:, None], self.best[:, :3, 0])
        turn = np.cross(self.best[:, :3, 0], axis)
        turned = self.best.copy()
        turned[:, :3, :3] = _rotations(turn) @ self.best[:, :3, :3]
        self._keep(np.stack([self.best, turned], axis=1))

    def _round(self, scale: float, *, first: bool) -> None:
        settings = self.settings
        spread = np.array([settings.shift] * 3 + [settings.turn] * 3) * scale
        motions = self.rng.normal(size=(settings.samples, 6)) * spread
        motions = np.concatenate([_FIXED if first else _FIXED[:1], motions])
        rotations = _rotations(motions[:, 3:])
        candidates = np.tile(self.best[:, None], (1, len(motions), 1, 1))
        candidates[..., :3, :3] = self.best[:, None, :3, :3] @ rotations
        candidates[..., :3, 3] += np.einsum("gij,cj->gci", self.best[:, :3, :3], motions[:, :3])
        self._keep(candidates)

    def _close(self, candidates: Float[np.ndarray, "g c 4 4"]) -> Closing:
        repeat = candidates.shape[1]
        return close_pads(
            self.world.surface,
            candidates.reshape(-1, 4, 4),
            np.repeat(self.openings, repeat),
            self.gripper,
            expected=np.repeat(self.widths, repeat),
        )

    def _keep(self, candidates: Float[np.ndarray, "g c 4 4"]) -> None:
        """Centre the candidates between the pads, and keep each grasp's best that is free."""
        count, repeat = candidates.shape[:2]
        closing = self._close(candidates)
        middle = np.nan_to_num(closing.off_centre).reshape(count, repeat)
        candidates = candidates.copy()
        candidates[..., :3, 3] += candidates[..., :3, 0] * middle[..., None]
        cost = self._cost(closing, candidates)
        order = np.argsort(cost, axis=1, kind="stable")
        for i in range(count):
            self.best[i] = candidates[i, self._choose(i, candidates[i], cost[i], order[i])]

    def _choose(
        self, i: int, candidates: Float[np.ndarray, "c 4 4"], cost: Float[np.ndarray, "c"], order: np.ndarray
    ) -> int:
        """The cheapest that is free; one with room, where that costs little more; else the cheapest."""
        chosen, most = None, cost[order[0]] + self.settings.colliding
        for candidate in order:
            if cost[candidate] > most:
                break
            pose = candidates[candidate]
            if chosen is None and not self._blocked(i, pose):
                if self._roomy(i, pose):
                    return int(candidate)
                chosen, most = int(candidate), min(most, cost[candidate] + self.settings.tight)
            elif chosen is not None and self._roomy(i, pose) and not self._blocked(i, pose):
                return int(candidate)
        return int(order[0]) if chosen is None else chosen

    def _roomy(self, i: int, pose: Float[np.ndarray, "4 4"]) -> bool:
        """Whether the opened gripper could go a little deeper."""
        deeper = pose.copy()
        deeper[:3, 3] += self.settings.room * pose[:3, 2]
        return not self.world.touching(deeper, self.opened[i])

    def _blocked(self, i: int, pose: Float[np.ndarray, "4 4"]) -> bool:
        """Whether the opened gripper touches anything at a pose, or on its way in."""
        back, way = pose.copy(), self.grasps[i].approach_distance
        for distance in np.linspace(0.0, way, int(np.ceil(way / STEP)) + 1):
            back[:3, 3] = pose[:3, 3] - distance * pose[:3, 2]
            if self.world.touching(back, self.opened[i]):
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
        return (
            settings.missing * missing
            + settings.tilt * (tilt / settings.farthest_tilt) ** 2
            + settings.coverage * bare
            + settings.off_centre * off**2
            + settings.leaving * left
            + settings.tight * tight
        )

    def _result(self, i: int, closing: Closing) -> WarpedGrasp:
        grasp = self.grasps[i]
        if not closing.touching[i].all():
            return grasp
        return grasp.closing_at(self.best[i], float(closing.width[i]), closing.points[i])


def _along_x(pose: Float[np.ndarray, "4 4"], contacts: Float[np.ndarray, "2 3"]) -> float:
    """x of the middle of the contacts in the pose's frame [m]."""
    return float((contacts.mean(axis=0) - pose[:3, 3]) @ pose[:3, 0])


def _rotations(vectors: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3 3"]:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vectors).as_matrix()

"""Where the two pads of a gripper are and how they face, over its whole stroke; what is refused.

Pads that slide on parallel rails, pads on a linkage, jaws that turn, and one jaw that moves towards one that
stands are one case: two flat faces whose places in the TCP frame are known at every opening.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from grasptransfer.errors import GripperError
from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping.gripper.links import FingerLink

if TYPE_CHECKING:
    import trimesh

SIDE = np.array([-1.0, 1.0])  # of the two pads along the TCP's x
DECIMALS = 9  # a nanometre: what forward kinematics rounds must not make mirrored pads unequal
STANDS_PARALLEL = np.deg2rad(1.0)  # a link that turns less over the stroke keeps its face across TCP x
STEEPEST = np.deg2rad(45)  # friction of 1; a face that turns further from TCP x pushes objects out
NEAR_SURFACE = 0.005  # m between a pad's centre and its finger's surface, for the surface to give its normal
STANDS_OUT = 0.002  # m of finger before the pad's face, or of air behind it, that is a mistake
FAR_FROM_TCP = 0.03  # m; a linkage moves the middle of the pads by 1 cm
PROBES = 3  # rays per side of a pad, in its middle 80 %
FROM_AFAR = 0.2  # m before the pad, from where a ray meets all of the finger


@dataclass(frozen=True)
class Pad:
    """The flat inner face of a finger.

    Args:
        link: URDF link that carries it.
        centre: face centre in the link's frame [m].
        size: extent along TCP y and TCP z [m].
        normal: unit vector out of the finger, towards the other pad, in the link's frame.
    """

    link: str
    centre: Float[np.ndarray, "3"]
    size: tuple[float, float]
    normal: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class PadFaces:
    """The faces of the -x and the +x pad at g openings, but for where they are along TCP x.

    Args:
        across: y and z of their centres, TCP frame [m].
        slopes: how far a face recedes along +x with y and with z; 0 where it is square to TCP x.
        normals: unit vectors out of the fingers, TCP frame.
    """

    across: Float[np.ndarray, "g 2 2"]
    slopes: Float[np.ndarray, "g 2 2"]
    normals: Float[np.ndarray, "g 2 3"]

    def take(self, rows: Int[np.ndarray, "n"]) -> "PadFaces":
        """Those of the chosen openings."""
        return PadFaces(self.across[rows], self.slopes[rows], self.normals[rows])


@dataclass(frozen=True)
class PadTable:
    """Places of the pads at the openings of a table, rising.

    Args:
        openings: distance between the pads' centres along TCP x [m].
        middles: x of the middle between the two centres, TCP frame [m]; 0 where they mirror each other.
        across: y and z of their centres, TCP frame [m].
        normals: unit vectors out of the fingers, TCP frame.
    """

    openings: Float[np.ndarray, "t"]
    middles: Float[np.ndarray, "t"]
    across: Float[np.ndarray, "t 2 2"]
    normals: Float[np.ndarray, "t 2 3"]

    def middle(self, openings: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g"]:
        """x of the middle between the pads at each opening, TCP frame [m]."""
        return np.interp(openings, self.openings, self.middles)

    def faces(self, openings: Float[np.ndarray, "g"]) -> PadFaces:
        """How the pads stand at each opening [m]."""
        if self._still is not None:
            rows = np.zeros(len(openings), int)
            return PadFaces(self._still.across[rows], self._still.slopes[rows], self._still.normals[rows])
        return _faces(self._at(openings, self.across), self._at(openings, self.normals))

    @cached_property
    def _still(self) -> PadFaces | None:
        """How the pads always stand; None if that depends on the opening."""
        moves = max(np.ptp(self.across, axis=0).max(), np.ptp(self.normals, axis=0).max())
        return None if moves > 10.0**-DECIMALS else _faces(self.across[:1], self.normals[:1])

    @property
    def mirror(self) -> bool:
        """Whether the pads are at equal distances from the TCP at every opening."""
        return bool(np.all(self.middles == 0))

    @property
    def turns(self) -> bool:
        """Whether a face stands differently at different openings, or not square to TCP x."""
        return bool(np.any(self.normals[..., 1:] != 0))

    def _at(self, openings: Float[np.ndarray, "g"], values: Float[np.ndarray, "t 2 k"]) -> np.ndarray:
        columns = values.reshape(len(values), -1).T
        at = np.stack([np.interp(openings, self.openings, column) for column in columns], axis=-1)
        return at.reshape(len(openings), *values.shape[1:])


def _faces(across: Float[np.ndarray, "g 2 2"], normals: Float[np.ndarray, "g 2 3"]) -> PadFaces:
    normals = normals / np.linalg.norm(normals, axis=2, keepdims=True)
    return PadFaces(across, -normals[..., 1:] / normals[..., :1], normals)


def pad_table(
    pads: Sequence[Pad],
    openings: Float[np.ndarray, "t"],
    link_poses: Callable[[float], dict[str, Float[np.ndarray, "4 4"]]],
) -> PadTable:
    """The places of the pads at each opening.

    Args:
        openings: openings of the table [m].
        link_poses: `tcp_from_link` of every link at an opening [m].
    """
    centres, normals = [], []
    for opening in openings:
        poses = link_poses(float(opening))
        centres.append([transform_points(poses[pad.link], pad.centre) for pad in pads])
        normals.append([poses[pad.link][:3, :3] @ pad.normal for pad in pads])
    places, facing = np.array(centres), np.round(np.array(normals), DECIMALS)
    middles = np.round(places[..., 0].mean(axis=1), DECIMALS)
    places[..., 1] = np.round(places[..., 1], DECIMALS)
    return PadTable(openings, middles, places[..., 1:], facing)


def pad_normal(
    link: FingerLink,
    centre: Float[np.ndarray, "3"],
    side: float,
    tcp_from_links: Sequence[Float[np.ndarray, "4 4"]],
    *,
    path: Path,
    key: str,
) -> Float[np.ndarray, "3"]:
    """Direction in which a pad faces, in its link's frame, where the YAML does not give it.

    A link that does not turn faces the other pad squarely; of one that turns, its surface under the pad's
    centre gives it.

    Args:
        side: side of the pad along TCP x, -1 or 1.
        tcp_from_links: poses of the link, from the smallest to the largest opening.

    Raises:
        GripperError: the link turns and no surface is near the pad's centre.
    """
    inward = np.array([pose[:3, :3].T @ [-side, 0, 0] for pose in tcp_from_links])
    angle = float(np.arccos(np.clip(inward @ inward[0], -1, 1)).max())
    if angle < STANDS_PARALLEL:
        return inward[0]
    surface = link.collision
    if surface is not None:
        import trimesh

        _, distance, face = trimesh.proximity.closest_point(surface, centre[None])
        normal = np.asarray(surface.face_normals[face[0]])
        if distance[0] <= NEAR_SURFACE and (inward @ normal > 0).any():
            return normal
    raise GripperError(
        f"its link {link.name} turns by {np.degrees(angle):.0f} degrees over the stroke, "
        "and no face of the link near the pad's centre shows how the pad faces",
        path=path,
        key=key,
        fix="Give its direction in the link's frame as normal: [x, y, z], or put the centre on the face",
    )


def check_pads(pads: Sequence[Pad], table: PadTable, path: Path) -> None:
    """Refuse pads that do not face each other, or are not around the TCP, anywhere on the wanted stroke.

    Raises:
        GripperError: they do not; with the opening at which it is so, and the number.
    """
    for opening, middle, across, normals in zip(
        table.openings, table.middles, table.across, table.normals, strict=True
    ):
        at = f"at an opening of {1e3 * opening:.0f} mm"
        for i in range(2):
            angle = np.arccos(np.clip(-SIDE[i] * normals[i, 0], -1, 1))
            if angle > STEEPEST:
                raise GripperError(
                    f"the pad faces {np.degrees(angle):.0f} degrees away from the closing axis {at}; "
                    f"at most {np.degrees(STEEPEST):.0f} hold anything",
                    path=path,
                    key=f"pads.{i}",
                    fix="Ask for a smaller range of opening, or turn base_from_tcp: +x is across the pads",
                )
        for axis, name in enumerate("yz"):
            apart = abs(across[0, axis] - across[1, axis])
            if apart > (pads[0].size[axis] + pads[1].size[axis]) / 2:
                text = f"the pads miss each other by {1e3 * apart:.0f} mm along TCP {name} {at}"
                raise GripperError(text, path=path, key="pads", fix="Check pads.centre and base_from_tcp")
        beside = max(0.0, abs(middle) - opening / 2)  # a TCP at the jaw that stands is between the pads
        away = float(np.linalg.norm([beside, *across.mean(axis=0)]))
        if away > FAR_FROM_TCP:
            raise GripperError(
                f"the middle of the pads is {1e3 * away:.0f} mm away from the TCP {at}",
                path=path,
                key="base_from_tcp",
                value=np.round([middle, *across.mean(axis=0)], 4).tolist(),
                fix="Put the TCP between the pads, in metres, and pads.centre on their faces",
            )


def check_surface(
    pad: Pad,
    body: "trimesh.Trimesh",
    link_from_tcp: Float[np.ndarray, "4 4"],
    *,
    path: Path,
    key: str,
) -> None:
    """Refuse a pad that is not on its finger's inner face.

    Args:
        body: surface of all that moves with the pad, its link's frame [m].
        link_from_tcp: at any opening.

    Raises:
        GripperError: with how far the finger stands out before it, or begins behind it.
    """
    from grasptransfer.grasping.surface import Surface

    steps = (np.arange(PROBES) + 0.5) / PROBES - 0.5
    y, z = (0.8 * cell.ravel() for cell in np.meshgrid(steps, steps))
    ways = link_from_tcp[:3, 1:3]  # TCP y and z, laid into the face
    ways = ways - np.outer(pad.normal, pad.normal @ ways)
    points = pad.centre + np.outer(y, ways[:, 0]) * pad.size[0] + np.outer(z, ways[:, 1]) * pad.size[1]
    origins, directions = points + FROM_AFAR * pad.normal, np.tile(-pad.normal, (len(points), 1))
    distances, _ = Surface(body).first_hits(origins, directions)
    before = float(np.median(FROM_AFAR - distances))  # of the finger, before the face; infinite: no finger
    if before > STANDS_OUT:
        raise GripperError(
            f"{1e3 * before:.1f} mm of the finger stand out before this pad",
            path=path,
            key=key,
            value=pad.centre.tolist(),
            fix="Put the centre on the finger's inner face, which meets the object first",
        )
    if before < -STANDS_OUT:
        what = "no part of the finger is behind it" if before == -np.inf else f"by {-1e3 * before:.1f} mm"
        raise GripperError(
            f"this pad lies before its finger's collision geometry: {what}",
            path=path,
            key=key,
            value=pad.centre.tolist(),
            fix="Put the centre on the finger's inner face, in the frame of its link, in metres",
        )


def moving_with(link: FingerLink, links: Sequence[FingerLink]) -> list[FingerLink]:
    """All links that no moving joint parts from this one, itself included."""
    moved = [joint.name for joint in link.chain if joint.kind != "fixed"]
    return [other for other in links if [j.name for j in other.chain if j.kind != "fixed"] == moved]


def body_of_pad(link: FingerLink, links: Sequence[FingerLink]) -> "trimesh.Trimesh | None":
    """Surface of all that collides and moves with a pad, in its link's frame [m]; None where nothing does."""
    from grasptransfer.grasping.gripper.shapes import together

    parts = [part for part in moving_with(link, links) if part.collision is not None]
    if not parts:
        return None
    link_from_base = invert(link.base_from_link({}))
    return together(
        [part.collision for part in parts if part.collision is not None],
        [link_from_base @ part.base_from_link({}) for part in parts],
    )

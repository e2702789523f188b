"""What the annotator knows, without a browser: the grasps being edited, measured on the canonical model.

A person places the TCP; the contacts and the width follow by closing the pads on the surface, and
every grasp is checked as a transferred one would be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.category import Category
from grasptransfer.errors import GraspFileError, SettingsError
from grasptransfer.frames import check_rigid, rigid
from grasptransfer.grasping import (
    CheckStatus,
    CollisionWorld,
    Grasp,
    Gripper,
    Symmetry,
    check_grasps,
    on_canonical,
    read_grasp_file,
    save_grasps,
)
from grasptransfer.grasping.closing import close_pads

ABOVE = 0.01  # m below the top of the object: where a new grasp starts
DOWN = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])  # approach straight down, closing along x


@dataclass(frozen=True)
class Measurement:
    """What the pads meet at a grasp, and whether the gripper gets there.

    Args:
        status, reason: of the check.
        opening: distance between the pads on the way in [m].
        width: when they touch [m], or None.
        contacts: (2, 3) under the -x and the +x pad, canonical frame [m], or None.
        offset: how far the middle of the contacts is from the TCP along the closing axis [m].
    """

    status: CheckStatus
    reason: str
    opening: float
    width: float | None
    contacts: Float[np.ndarray, "2 3"] | None
    offset: float

    @property
    def usable(self) -> bool:
        """Whether every check passed."""
        return self.status.usable


class Session:
    """Grasps of one category while they are edited.

    Args:
        category: whose canonical model they are on.
        gripper: that executes them.
        path: grasp file to edit and save to; the category's own if None. It may be missing.

    Raises:
        GraspFileError: the file has a mistake, or is for another category or gripper.
    """

    def __init__(self, category: Category, gripper: Gripper, *, path: Path | None = None):
        self.category, self.gripper = category, gripper
        self.path = Path(path) if path is not None else category.grasps_path
        self.world = CollisionWorld(category.canonical)
        self.unsaved = False
        self._grasps: dict[str, Grasp] = {}
        self._unseen: set[str] = set()
        if self.path.is_file():
            self._read()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the grasps, in file order."""
        return tuple(self._grasps)

    @property
    def grasps(self) -> tuple[Grasp, ...]:
        """The grasps, in file order."""
        return tuple(self._grasps.values())

    @property
    def unseen(self) -> tuple[str, ...]:
        """Names of grasps of another canonical model that were neither measured nor moved on this one."""
        return tuple(name for name in self.names if name in self._unseen)

    def grasp(self, name: str) -> Grasp:
        """One grasp by name.

        Raises:
            SettingsError: there is none; lists the names.
        """
        if name not in self._grasps:
            raise SettingsError("is no grasp here", key="grasp", value=name, choices=self.names)
        return self._grasps[name]

    def add(self, name: str, *, like: str | None = None) -> Grasp:
        """A new grasp: a copy of another one, or from straight above at the top of the object."""
        self._check_name(name)
        if like is not None:
            grasp = replace(self.grasp(like), name=name)
        else:
            low, high = self.category.canonical.bounds
            middle = (low + high) / 2
            pose = rigid(DOWN, np.array([middle[0], middle[1], high[2] - ABOVE]))
            grasp = Grasp(name, name, pose, self.gripper.max_width)
        self._keep(name, grasp)
        return self._grasps[name]

    def remove(self, name: str) -> None:
        """Drop a grasp."""
        self.grasp(name)
        del self._grasps[name]
        self.unsaved = True

    def rename(self, name: str, new: str) -> None:
        """Give a grasp another name; it keeps its place."""
        grasp = self.grasp(name)
        if new == name:
            return
        self._check_name(new)
        renamed = replace(grasp, name=new)
        if name in self._unseen:
            self._unseen.add(new)
        self._grasps = {renamed.name if key == name else key: renamed if key == name else value
                        for key, value in self._grasps.items()}  # fmt: skip
        self.unsaved = True

    def describe(
        self,
        name: str,
        *,
        label: str | None = None,
        approach_distance: float | None = None,
        confidence: float | None = None,
    ) -> None:
        """Change what is said about a grasp, not where it is.

        Args:
            approach_distance: the straight way in [m].
            confidence: in [0, 1].

        Raises:
            SettingsError: no such grasp, or a number out of range.
        """
        changes = {"label": label, "approach_distance": approach_distance, "confidence": confidence}
        changes = {key: value for key, value in changes.items() if value is not None}
        for key in ("approach_distance", "confidence"):
            if key in changes and not 0 <= changes[key] <= 1:
                raise SettingsError("must lie between 0 and 1", key=key, value=changes[key])
        self._grasps[name] = replace(self.grasp(name), **changes)
        self.unsaved = True

    def move(self, name: str, canonical_from_gripper: Float[np.ndarray, "4 4"]) -> Measurement:
        """Put the TCP elsewhere [m]; contacts and width follow."""
        pose = check_rigid(canonical_from_gripper, "canonical_from_gripper")
        # Contacts of the old place would be refused at the new one.
        self._keep(name, replace(self.grasp(name), canonical_from_gripper=pose, contacts=None))
        return self.measure(name)

    def open_to(self, name: str, opening: float | None) -> Measurement:
        """Fix the opening on the way in [m]; None: a little more than the width."""
        if opening is not None:
            opening = float(np.clip(opening, *self.gripper.opening))
        self._keep(name, replace(self.grasp(name), opening=opening))
        return self.measure(name)

    def centre(self, name: str) -> Measurement:
        """Move the TCP along the closing axis to the middle of what the pads touch."""
        pose = np.array(self.grasp(name).canonical_from_gripper)
        pose[:3, 3] += self.measure(name).offset * pose[:3, 0]
        return self.move(name, pose)

    def turn(
        self, name: str, degrees: Sequence[float], *, point: Float[np.ndarray, "3"] | None = None
    ) -> None:
        """Say that a grasp is as good turned about an upright axis.

        Args:
            degrees: the turns; empty: none.
            point: on the axis [m]; as before, or the origin.
        """
        grasp = self.grasp(name)
        symmetry = grasp.symmetry or Symmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3))
        if point is not None:
            symmetry = replace(symmetry, point=np.array(point, dtype=float))
        symmetry = replace(symmetry, degrees=tuple(float(turn) for turn in degrees), samples=None)
        self._grasps[name] = replace(grasp, symmetry=symmetry if len(degrees) else None)
        self.unsaved = True

    def measure(self, name: str) -> Measurement:
        """Close the pads and check the gripper's way to a grasp."""
        grasp = self.grasp(name)
        opening = self.gripper.max_width if grasp.opening is None else grasp.opening
        told = self.gripper.max_width if grasp.width is None else grasp.width
        points, width, offset = self._touched(grasp.canonical_from_gripper, opening)
        if width is None:
            # Nothing between wide-open pads may still be something between nearly closed ones.
            closer = self.gripper.approach_opening(min(told, self.gripper.max_width))
            points, width, offset = self._touched(grasp.canonical_from_gripper, closer)
        seen = replace(grasp, contacts=points, width=told if width is None else width)
        check = check_grasps(on_canonical([seen]), self.world, self.gripper)[0]
        self._unseen.discard(name)
        return Measurement(check.status, check.reason, check.opening, width, points, offset)

    def save(self) -> Path:
        """Write the grasp file. Comments that a person wrote into it are lost.

        Raises:
            GraspFileError: there is no grasp, or one of another canonical model that nobody looked at.
            SettingsError: the folder cannot be written.
        """
        if not self._grasps:
            raise GraspFileError("there is no grasp to save", path=self.path)
        if self.unseen:
            raise GraspFileError(
                "its grasps were made on another canonical model",
                path=self.path,
                fix=f"Look at each before saving; still to see: {', '.join(self.unseen)}",
            )
        known = self.gripper.path.stem == self.gripper.name
        save_grasps(
            self.grasps,
            self.path,
            category=self.category.name,
            gripper=self.gripper.name if known else str(self.gripper.path),
            canonical_sha256=self.category.canonical_sha256,
        )
        self.unsaved = False
        return self.path

    def _read(self) -> None:
        file = read_grasp_file(self.path)
        if file.category != self.category.name:
            raise GraspFileError(
                "is for another category",
                path=self.path,
                key="grasptransfer.category",
                value=file.category,
                choices=[self.category.name],
            )
        if file.gripper not in (self.gripper.name, self.gripper.path.name, str(self.gripper.path)):
            raise GraspFileError(
                f"its grasps are for another gripper than {self.gripper.name}",
                path=self.path,
                key="grasptransfer.gripper",
                value=file.gripper,
                fix="Name that gripper, or edit another file",
            )
        self._grasps = {grasp.name: grasp for grasp in file.grasps}
        if file.canonical_sha256 not in (None, self.category.canonical_sha256):
            for grasp in self.grasps:  # contacts of another model are none of this one
                self._keep(grasp.name, replace(grasp, contacts=None))
            self._unseen = set(self.names)

    def _keep(self, name: str, grasp: Grasp) -> None:
        """Store a grasp with the contacts and the width it has now."""
        self._grasps[name] = grasp
        found = self.measure(name)
        if found.width is not None:
            grasp = replace(grasp, contacts=found.contacts, width=found.width)
            if grasp.opening is not None:
                grasp = replace(grasp, opening=max(grasp.opening, found.width))
        self._grasps[name] = grasp
        self.unsaved = True

    def _touched(
        self, pose: Float[np.ndarray, "4 4"], opening: float
    ) -> tuple[Float[np.ndarray, "2 3"] | None, float | None, float]:
        """Contacts, width and offset of the pads closed from `opening`; nothing unless both touch."""
        closing = close_pads(self.world.surface, pose[None], np.array([opening]), self.gripper)
        if not closing.touching[0].all():
            return None, None, 0.0
        offset = float(closing.local[0, :, 0].mean())
        return closing.points[0], float(closing.width[0]), offset

    def _check_name(self, name: str) -> None:
        if not name or "/" in name or name != name.strip():
            raise SettingsError("must be a word without '/': turned copies carry one", key="name", value=name)
        if name in self._grasps:
            raise SettingsError("is the name of another grasp", key="name", value=name)

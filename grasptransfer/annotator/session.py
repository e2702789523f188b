"""What the annotator knows, without a browser: the grasps being edited, measured on the canonical model.

A person places the TCP; the contacts and the width follow by closing the pads on the surface, and
every grasp is checked as a transferred one would be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.annotator.document import GraspDocument
from grasptransfer.annotator.measurement import Measurement, Measurer
from grasptransfer.category import Category
from grasptransfer.errors import GraspFileError, SettingsError
from grasptransfer.frames import check_rigid, rigid
from grasptransfer.grasping import (
    Grasp,
    Gripper,
    Symmetry,
)

ABOVE = 0.01  # m below the top of the object: where a new grasp starts
DOWN = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])  # approach straight down, closing along x


@dataclass(frozen=True)
class _State:
    """What an edit may change, as it was before."""

    grasps: dict[str, Grasp]
    unseen: set[str]
    renamed: dict[str, str]


class Session:
    """Grasps of one category while they are edited.

    Args:
        category: whose canonical model they are on.
        gripper: that executes them.
        path: grasp file to edit and save to; it may be missing. None takes the category's own, or for a
            category inside the installed package `<category>_grasps.yaml` in the working folder, which
            starts with the category's grasps.

    Raises:
        GraspFileError: the file has a mistake, or is for another category or gripper.
    """

    def __init__(self, category: Category, gripper: Gripper, *, path: Path | None = None):
        self.category, self.gripper = category, gripper
        self.document = GraspDocument(category, gripper, path)
        self.measurer = Measurer(category.canonical, gripper)
        self.unsaved = False
        self._grasps = dict(self.document.grasps)
        self._unseen: set[str] = set()
        self._renamed: dict[str, str] = {}
        self._history: list[_State] = []
        self._last_edit: tuple[str, str] | None = None
        if self.document.of_another_model:
            for grasp in self.grasps:  # Contacts of another model mean nothing on this one.
                self._keep(grasp.name, replace(grasp, contacts=None))
            self._unseen = set(self.names)

    @property
    def path(self) -> Path:
        """The file that is saved to."""
        return self.document.path

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

    @property
    def refused(self) -> tuple[str, ...]:
        """Names of the grasps that fail their check."""
        return tuple(name for name in self.names if not self.measure(name).usable)

    def undo(self) -> None:
        """Take back the last edit; moves of one grasp up to `end_of_move` are one edit.

        Raises:
            SettingsError: there is nothing to take back.
        """
        if not self._history:
            raise SettingsError("there is nothing to undo", key="undo")
        state = self._history.pop()
        self._grasps, self._unseen, self._renamed = state.grasps, state.unseen, state.renamed
        self._last_edit, self.unsaved = None, True

    def end_of_move(self) -> None:
        """The next move is an edit of its own: a drag has ended."""
        self._last_edit = None

    def add(self, name: str, *, like: str | None = None) -> Grasp:
        """A new grasp: a copy of another one, or from straight above at the top of the object."""
        self._check_name(name)
        self._remember("add", name)
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
        self._remember("remove", name)
        del self._grasps[name]
        self.unsaved = True

    def rename(self, name: str, new: str) -> None:
        """Give a grasp another name; it keeps its place."""
        grasp = self.grasp(name)
        if new == name:
            return
        self._check_name(new)
        self._remember("rename", name)
        self._renamed[new] = self._renamed.pop(name, name)
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
        grasp = self.grasp(name)
        self._remember("describe", name)
        self._grasps[name] = replace(grasp, **changes)
        self.unsaved = True

    def move(self, name: str, canonical_from_gripper: Float[np.ndarray, "4 4"]) -> Measurement:
        """Put the TCP elsewhere [m]; contacts and width follow."""
        pose = check_rigid(canonical_from_gripper, "canonical_from_gripper")
        grasp = self.grasp(name)
        self._remember("move", name)
        # Contacts of the old place would be refused at the new one.
        self._keep(name, replace(grasp, canonical_from_gripper=pose, contacts=None))
        return self.measure(name)

    def open_to(self, name: str, opening: float | None) -> Measurement:
        """Fix the opening on the way in [m]; None: a little more than the width."""
        if opening is not None:
            opening = float(np.clip(opening, *self.gripper.opening))
        grasp = self.grasp(name)
        self._remember("open_to", name)
        self._keep(name, replace(grasp, opening=opening))
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
        self._remember("turn", name)
        self._grasps[name] = replace(grasp, symmetry=symmetry if len(degrees) else None)
        self.unsaved = True

    def measure(self, name: str) -> Measurement:
        """Close the pads and check the gripper's way to a grasp; it counts as seen from then on."""
        found = self.measurer.measure(self.grasp(name))
        self._unseen.discard(name)
        return found

    def save(self, *, refused: bool = False) -> Path:
        """Write the grasp file; of one that is there comments, order and style stay, and a copy is kept.

        Args:
            refused: save grasps that fail their check, too.

        Raises:
            GraspFileError: there is no grasp, one of another canonical model that nobody has seen, or one
                that fails its check where those are not asked for.
            SettingsError: the folder cannot be written.
        """
        self._check_complete(refused)
        self.document.write(self._grasps, self._renamed)
        self.unsaved, self._renamed = False, {}
        return self.path

    def _check_complete(self, refused: bool) -> None:
        if not self._grasps:
            raise GraspFileError("there is no grasp to save", path=self.path)
        if self.unseen:
            raise GraspFileError(
                "its grasps were made on another canonical model",
                path=self.path,
                fix=f"Look at each before saving; still to see: {', '.join(self.unseen)}",
            )
        failing = () if refused else self.refused
        if failing:
            raise GraspFileError(
                f"the check refuses {', '.join(failing)}",
                path=self.path,
                fix="Mend or delete them, or save them on purpose with `save refused grasps, too`",
            )

    def _remember(self, edit: str, name: str) -> None:
        """Keep the state before an edit; a move that follows a move of the same grasp belongs to it."""
        if (edit, name) != self._last_edit or edit not in ("move", "open_to"):
            self._history.append(_State(dict(self._grasps), set(self._unseen), dict(self._renamed)))
        self._last_edit = (edit, name)

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

    def _check_name(self, name: str) -> None:
        if not name or "/" in name or name != name.strip():
            raise SettingsError("must be a word without '/': turned copies carry one", key="name", value=name)
        if name in self._grasps:
            raise SettingsError("is the name of another grasp", key="name", value=name)

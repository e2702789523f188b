"""Errors for wrong input: each names the path or argument, the value and the choices.

A method that ran but did not succeed (not converged, in collision, slipped) is no error:
it is reported by a status enum on the result, and raised only with `strict=True`.
"""

import difflib
import operator
from collections.abc import Iterable
from pathlib import Path

# What numpy raises for something that is no array of numbers; the last for whole numbers beyond every float.
NOT_NUMBERS = (TypeError, ValueError, OverflowError)
_MISSING = object()


class GraspTransferError(ValueError):
    """A wrong file or argument.

    Args:
        problem: one clear sentence, without a final full stop.
        path: the file at fault.
        key: the argument, or the key inside the file.
        value: the value found there.
        choices: the values that would have been accepted.
        fix: what to do about it, one sentence.
    """

    def __init__(
        self,
        problem: str,
        *,
        path: str | Path | None = None,
        key: str | None = None,
        value: object = _MISSING,
        choices: Iterable[object] | None = None,
        fix: str | None = None,
    ):
        self.problem, self.path, self.key, self.fix = problem, path, key, fix
        self.value = None if value is _MISSING else value
        self._has_value = value is not _MISSING
        self.choices = None if choices is None else [str(choice) for choice in choices]
        where = ": ".join(str(part) for part in (path, key) if part is not None)
        text = f"{where}: {problem}" if where else problem
        if value is not _MISSING:
            text += f" (got {_short(value)})"
        if self.choices is not None:
            text += f"; known: {', '.join(self.choices) or 'none'}"
        meant = self.meant()
        if meant is not None:
            text += f". Did you mean {meant}?"
        if fix:
            text += f"{'' if meant else '.'} {fix}"
        super().__init__(text)

    def meant(self) -> str | None:
        """The choice that is spelt nearly as what was given, the value or else the key; None if no one is."""
        given = self.value if self._has_value else self.key
        if self.choices is None or not isinstance(given, str | Path) or str(given) in self.choices:
            return None
        near = difflib.get_close_matches(str(given).lower(), {c.lower(): c for c in self.choices}, n=1)
        return next((choice for choice in self.choices if near and choice.lower() == near[0]), None)

    def at(
        self,
        path: str | Path | None,
        *,
        kind: "type[GraspTransferError] | None" = None,
        key: str | None = None,
    ) -> "GraspTransferError":
        """The same mistake, found in this file, or under this key; `kind`: as another error of the family."""
        value = self.value if self._has_value else _MISSING
        return (kind or type(self))(
            self.problem, path=path, key=key or self.key, value=value, choices=self.choices, fix=self.fix
        )


def _short(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


class ImageError(GraspTransferError):
    """A picture that cannot be read or is not RGB."""


class PoseError(GraspTransferError):
    """A transform that is not rigid, not in metres, or puts the object out of view."""


class CameraError(GraspTransferError):
    """Impossible intrinsics."""


class MeshError(GraspTransferError):
    """A mesh that is empty, non-finite or in other units."""


class PointCloudError(GraspTransferError):
    """A point cloud of the wrong shape, empty, non-finite or degenerate."""


class FieldFileError(GraspTransferError):
    """A deformation field or shape space on disk that is missing, corrupt or of another kind."""


class CategoryError(GraspTransferError):
    """An unknown, broken or incomplete category."""


class GripperError(GraspTransferError):
    """An unknown or broken gripper description."""


class GraspFileError(GraspTransferError):
    """A grasp file with a mistake in it."""


class SceneError(GraspTransferError):
    """A scene description with a mistake in it."""


class WeightsError(GraspTransferError):
    """Missing, corrupt or unsuitable network weights."""


class SettingsError(GraspTransferError):
    """An option outside its range or set of choices."""


class NotSucceeded(GraspTransferError):
    """Raised only under `strict=True`: the method ran and did not succeed."""


def in_millimetres(
    kind: type[GraspTransferError], *, key: str, value: object, path: Path | None = None
) -> GraspTransferError:
    """The error for lengths that only make sense a thousand times smaller."""
    fix = "Divide it by 1000"
    return kind("looks like millimetres, not metres", path=path, key=key, value=value, fix=fix)


def check_seed(seed: object) -> None:
    """Refuse a seed that no random generator takes.

    Raises:
        SettingsError: it is no whole number, or negative.
    """
    try:
        number = operator.index(seed)  # pyright: ignore[reportArgumentType]  this is what is checked
    except TypeError:
        raise SettingsError("must be a whole number", key="seed", value=seed) from None
    if number < 0:
        raise SettingsError("must be 0 or more", key="seed", value=seed)

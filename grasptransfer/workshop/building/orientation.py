"""Whether an instance stands the way the canonical model does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

STEP = 15  # degrees: spacing of the turns about the upright axis that are tried.
BETTER = 0.85  # a turn is suspicious if it brings the distance below this share of the given one


@dataclass(frozen=True)
class Turn:
    """The turn that brings an instance nearest to the canonical model.

    Args:
        degrees: turn about z, counter-clockwise seen from above; in (-180, 180].
        upside_down: whether it is turned over as well (about x, first).
        given_mm, best_mm: RMS distance to the canonical model as given and turned, at equal size.
    """

    degrees: int
    upside_down: bool
    given_mm: float
    best_mm: float

    @property
    def warning(self) -> str | None:
        """What a person should check, or None."""
        if self.best_mm >= BETTER * self.given_mm or (abs(self.degrees) < 2 * STEP and not self.upside_down):
            return None
        over = "upside down or " if self.upside_down else ""
        return (
            f"may stand {over}turned: {self.degrees} degrees about z bring it {self.best_mm:.1f} mm near the "
            f"canonical model instead of {self.given_mm:.1f} mm"
        )


def best_turn(canonical: Float[np.ndarray, "n 3"], instance: Float[np.ndarray, "m 3"]) -> Turn:
    """Try turns about z, upright and upside down.

    Args:
        canonical: (n, 3) points of its surface [m].
        instance: (m, 3) points of its surface [m].
    """
    still, scale = _normalised(canonical)
    moving, _ = _normalised(instance)
    tree = KDTree(still)
    scores = {}
    for upside_down in (False, True):
        over = moving * [1, -1, -1] if upside_down else moving
        for degrees in range(0, 360, STEP):
            angle = np.deg2rad(degrees)
            cos, sin = np.cos(angle), np.sin(angle)
            turned = over @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
            there = tree.query(turned)[0]
            back = KDTree(turned).query(still)[0]
            scores[degrees, upside_down] = (
                1000 * scale * float(np.sqrt((np.square(there).mean() + np.square(back).mean()) / 2))
            )
    best = min(scores, key=lambda turn: (scores[turn], turn))
    degrees = best[0] - 360 if best[0] > 180 else best[0]
    return Turn(degrees, best[1], scores[0, False], scores[best])


def agreed_turn(
    canonical: Float[np.ndarray, "n 3"],
    instance: Float[np.ndarray, "m 3"],
    others: Sequence[Float[np.ndarray, "_ 3"]],
) -> Turn:
    """The best turn, if it is suspicious against most other instances, too; else the one given.

    Args:
        canonical, instance: as of `best_turn`.
        others: (_, 3) points of other instances' surfaces [m].
    """
    turn = best_turn(canonical, instance)
    if turn.warning is None:
        return turn
    agreeing = sum(best_turn(other, instance).warning is not None for other in others)
    return turn if 2 * agreeing >= len(others) else Turn(0, False, turn.given_mm, turn.given_mm)


def _normalised(points: Float[np.ndarray, "m 3"]) -> tuple[Float[np.ndarray, "m 3"], float]:
    centred = points - (points.min(0) + points.max(0)) / 2
    scale = float(np.sqrt(np.square(centred).sum(1).mean()))
    return centred / scale, scale

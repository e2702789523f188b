"""What executed grasps have taught beyond what one picture says of the geometry.

A reconstruction is wrong in its own ways. Real drills have more in front of the handle than their
reconstructions show, so a grasp that comes from there holds less often than drawn shapes and poses promise,
on object after object. So the ranking's chance p becomes

    logit(score) = shift + slope * logit(p) + b[grasp]

| symbol | name | meaning |
| --- | --- | --- |
| shift, slope | `shift`, `slope` | for all grasps; a slope below 1: the drawn objects were too alike |
| b | `of_grasps` | of each annotated grasp of a category, 0 without experience with it |
| | `pose_share` | of the covariance that an estimate states of its pose, what executed grasps bear out |

`grasptransfer bench calibration` fits them to grasps on random shapes, on meshes and on photographs of real
objects, each object counted alike however often it was seen, and judges them on objects left out.
Sources: Platt 1999 (slope and shift); Gelman and Hill 2007, chapter 12 (b is held near 0: partial pooling).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit

from grasptransfer.category import objects_folder
from grasptransfer.data_files import read_yaml
from grasptransfer.errors import GraspFileError
from grasptransfer.fitted import Fit, write_fits
from grasptransfer.yaml_models import parse

if TYPE_CHECKING:
    from grasptransfer.category import Category

# The blocks beside those of the categories, and their values.
TEMPERATURE, POSTERIOR = "temperature", "posterior"
BLOCKS = {TEMPERATURE: ("shift", "slope"), POSTERIOR: ("pose",)}
SURE = 1e-3  # Chances are kept this far from 0 and 1, whose log odds are infinite.


@dataclass(frozen=True)
class Experience:
    """Corrects the chance of each annotated grasp; without arguments it changes nothing.

    Args:
        shift, slope: shift and slope of the log odds of every chance.
        of_grasps: what is added to the log odds of an annotated grasp, by its name.
    """

    shift: float = 0.0
    slope: float = 1.0
    of_grasps: Mapping[str, float] = field(default_factory=dict)

    @staticmethod
    def of(category: "Category", *, own_grasps: bool = True) -> "Experience":
        """What is known of a category; of one whose canonical model is another, the temperature alone.

        Args:
            own_grasps: whether the category's annotated grasps are used, and not those of another file.

        Raises:
            GraspFileError: `experience_path` is missing, or something in it is wrong.
        """
        fits = read_experience()
        temperature, known = fits[TEMPERATURE].values, fits.get(category.name)
        fits_it = own_grasps and known is not None and known.fitted_to == category.canonical_sha256
        return Experience(
            temperature["shift"], temperature["slope"], known.values if fits_it and known else {}
        )

    def score(self, chance: float, grasp: str) -> float:
        """The corrected chance in [0, 1]; none stays none.

        Args:
            grasp: its name; members of a symmetry family, `name/turn`, share their family's.
        """
        if chance <= 0:
            return 0.0
        bounded = float(np.clip(chance, SURE, 1 - SURE))
        odds = self.shift + self.slope * np.log(bounded / (1 - bounded))
        return float(expit(odds + self.of_grasps.get(grasp.split("/")[0], 0.0)))

    def steepness(self, chance: float, grasp: str) -> float:
        """How much `score` changes with the chance."""
        if not SURE < chance < 1 - SURE:
            return 0.0
        score = self.score(chance, grasp)
        return self.slope * score * (1 - score) / (chance * (1 - chance))


def experience_path() -> Path:
    """Where experience lies, each block with the command that fitted it and the date."""
    return objects_folder() / "models" / "experience.yaml"


def write_experience(
    temperature: tuple[float, float],
    of_categories: Mapping[str, Mapping[str, float]],
    *,
    canonicals: Mapping[str, str],
    path: Path | None = None,
) -> None:
    """Write fitted experience for all later processes, with the command of this process and today's date.

    What is shipped of the pose's covariance stays.

    Args:
        temperature: shift and slope, as of `Experience`.
        of_categories: category -> annotated grasp -> what is added to its log odds.
        canonicals: category -> checksum of the canonical model to which its grasps belong.
    """
    fits = {
        TEMPERATURE: Fit.today(dict(zip(BLOCKS[TEMPERATURE], temperature, strict=True))),
        POSTERIOR: read_experience()[POSTERIOR],
    }
    for name, values in of_categories.items():
        fits[name] = Fit.today(values, fitted_to=canonicals[name])
    write_fits(path or experience_path(), fits)
    read_experience.cache_clear()


@cache
def read_experience() -> dict[str, Fit]:
    """The blocks of `experience_path`: the temperature, and a block for each category.

    Raises:
        GraspFileError: the file is missing, or something in it is wrong.
    """
    path = experience_path()
    data = read_yaml(path, error=GraspFileError)
    fits = {
        str(name): parse(Fit, block, path, key=str(name), error=GraspFileError)
        for name, block in data.items()
    }
    for block, values in BLOCKS.items():
        if block not in fits or set(fits[block].values) != set(values):
            raise GraspFileError("lacks a fitted number", path=path, key=block, choices=values)
    return fits


def pose_share() -> float:
    """Share of the stated covariance of a pose with which drawn poses differ.

    Raises:
        GraspFileError: `experience_path` is missing, or something in it is wrong.
    """
    return read_experience()[POSTERIOR].values["pose"]

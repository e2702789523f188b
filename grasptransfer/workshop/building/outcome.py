"""The outcome of building a category, for its page and its report."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.category.category import Category
from grasptransfer.workshop.building.orientation import Turn
from grasptransfer.workshop.building.space_fit import Distances


@dataclass(frozen=True)
class Registration:
    """One instance and how the canonical model was registered to it.

    Args:
        name: name of the instance.
        test: whether the shape space never saw it.
        is_cloud: whether the instance came as a cloud.
        faces: number of faces of its mesh.
        extents: (3,) sides of its bounding box [m].
        notes: what was repaired or is worth knowing.
        turn: the turn that would bring the instance nearest to the canonical model.
        points: (m, 3) dense points of the instance [m].
        before, after: distances to the canonical model before and after its deformation.
        status: status of CPD.
        fitted_error: E of the shape space learnt without the instance, fitted to its points [m^2].
        left_out_rms: RMS distance between the instance's own field and the nearest one of the shape space
            learnt without it [m]; None for test instances, which the space is always learnt without.
    """

    name: str
    test: bool
    is_cloud: bool
    faces: int
    extents: Float[np.ndarray, "3"]
    notes: tuple[str, ...]
    turn: Turn
    points: Float[np.ndarray, "m 3"]
    before: Distances
    after: Distances
    status: str
    fitted_error: float
    left_out_rms: float | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should check."""
        return (self.turn.warning,) if self.turn.warning else ()


@dataclass(frozen=True)
class Candidate:
    """An instance that could be the canonical model, registered to all others.

    Args:
        name: name of the instance.
        chamfer: mean of what is left after registration, over the others [m].
        worst: the largest of them [m].
        moved: RMS displacement that it took, mean over the others [m].
        is_cloud: clouds have no surface of their own, and are taken only if there are no meshes.
    """

    name: str
    chamfer: float
    worst: float
    moved: float
    is_cloud: bool


@dataclass(frozen=True)
class Trial:
    """Settings that could be taken, and what shape spaces made with them leave of instances they never saw.

    Args:
        beta, lam: settings of CPD.
        modes: learnt by the shape space.
        flexibility: flexibility of the smooth modes beside them; 0 for none.
        error: E, mean over the instances left out in turn [m^2].
    """

    beta: float
    lam: float
    modes: int
    flexibility: float
    error: float


@dataclass(frozen=True)
class CategoryBuild:
    """A category that was built, and how it went.

    Args:
        category: as it is on disk.
        canonical: name of the instance that is the canonical model.
        candidates: best first; empty if the canonical model was given.
        trials: in the order they were made; empty if all settings were given.
        registrations: one for each instance, train and test.
        explained: (k,) share of the variance that the first modes hold together.
        seconds: since the start, or the resumption.
    """

    category: Category
    canonical: str
    candidates: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    registrations: tuple[Registration, ...]
    explained: Float[np.ndarray, "k"]
    seconds: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should check, each with the instance's name."""
        return tuple(f"{one.name} {text}" for one in self.registrations for text in one.warnings)

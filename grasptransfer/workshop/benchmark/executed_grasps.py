"""Grasps on pictures of objects of every kind, executed: what the ranking saw of each, and whether it held.

Three sources, one after the other: random shapes of the generators, meshes of real objects that are rendered,
and photographs. The grasps are planned with the settings of a user. They are executed with the opening with
which they were checked and ranked.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.grasping import PlannedGrasps, WarpedGrasp, load_gripper
from grasptransfer.grasping.ranking import grasp_features
from grasptransfer.grasping.success_model import Features, Ranking, expected_success
from grasptransfer.meshes import load_mesh
from grasptransfer.perception.observation import Observation, observe
from grasptransfer.simulation import simulate
from grasptransfer.transfer import GraspTransfer
from grasptransfer.workshop.benchmark.given_poses import ESTIMATOR, EXACT, UNSAID, GivenPoses
from grasptransfer.workshop.benchmark.grasp import as_executed
from grasptransfer.workshop.benchmark.photo_files import (
    Photo,
    camera_of_photo,
    given_pose,
    given_poses_of,
    read_photos,
)
from grasptransfer.workshop.benchmark.seen_instances import (
    instance_names,
    load_instance,
    observe_instance,
    random_names,
    viewpoints_of,
)

MOST_GRASPS = 8  # At most so many grasps of one picture are executed.
FIRST_SEED = 78_000_000  # Seeds of the random shapes, far from those of train and test instances.
RANDOM, MESH, PHOTO = "random", "mesh", "photograph"
SOURCES = (RANDOM, MESH, PHOTO)
POSES_OF_EACH = 2  # given with each photograph
SHARE = 8  # A worker takes so many photographs of one object at a time.


@dataclass(frozen=True)
class Executed:
    """One executed grasp.

    Args:
        features: what the ranking looks at, in each drawn object (`success_model.FEATURES`).
        held: whether it held.
        trust: chance that the picture shows the category, which scores contain.
        object: the object that was grasped.
        picture: the picture and the pose that was given with it.
        grasp: the annotated grasp, without its turn about a symmetry axis.
        source: one of `SOURCES`.
    """

    features: Float[np.ndarray, "s f"]
    held: bool
    trust: float = 1.0
    object: str = ""
    picture: str = ""
    grasp: str = ""
    source: str = RANDOM

    @classmethod
    def of(cls, row: dict) -> "Executed":
        """From a row of a benchmark's document."""
        fields: dict[str, Any] = row | {"features": np.array(row["features"], float)}
        return cls(**fields)


@dataclass(frozen=True)
class PosedPicture:
    """A picture of an object whose truth is known.

    Args:
        name: of the picture, with the pose that is given.
        pose: the true `camera_from_object` (4, 4) [m].
    """

    name: str
    observation: Observation
    pose: Float[np.ndarray, "4 4"]
    mesh: trimesh.Trimesh


def found_objects(
    categories: tuple[str, ...], objects: int, meshes: Path | None, photos: Path | None
) -> list[tuple[str, str]]:
    """Category and name of every piece of work: `random/NAME`, `mesh/NAME` or `photograph/OBJECT#FIRST`."""
    found = []
    for category in categories:
        found += [(category, f"{RANDOM}/{name}") for name in random_names(objects, FIRST_SEED)]
        if meshes is not None:
            found += [(category, f"{MESH}/{name}") for name in instance_names(category, meshes)]
        if photos is not None:
            for name, own in _photographed(photos, category).items():
                found += [(category, f"{PHOTO}/{name}#{first}") for first in range(0, len(own), SHARE)]
    return found


def execute_on(settings, category: str, name: str) -> dict:
    """`grasps` on the pictures of one object: rows of `Executed`.

    Args:
        settings: as `CalibrationSettings`.
        category, name: one of `found_objects`.
    """
    source, _, known = name.partition("/")
    flow = GraspTransfer(category, gripper=load_gripper(settings.gripper))
    rows, see = [], _photographs if source == PHOTO else _views
    for picture in see(settings, category, name):
        for one in _execute(flow, picture, settings):
            about = {"object": f"{category}/{known.partition('#')[0]}", "source": source}
            rows.append(asdict(replace(one, **about)) | {"features": one.features.tolist()})
    return {"grasps": rows}


def _views(settings, category: str, name: str) -> Iterator[PosedPicture]:
    """Rendered views."""
    source, _, known = name.partition("/")
    instance = load_instance(category, known, settings.meshes if source == MESH else None)
    with Renderer() as renderer:
        for viewpoint in viewpoints_of(known, settings.views):
            seen, pose = observe_instance(
                instance,
                viewpoint,
                renderer=renderer,
                noise=settings.given,
                seed=settings.seed,
                pictures=settings.views_together,
            )
            yield PosedPicture(f"{viewpoint}", seen.without("mask", "depth"), pose, instance.solid)


def _photographs(settings, category: str, name: str) -> Iterator[PosedPicture]:
    """Photographs with exact poses, said to be so or not, with drawn ones, and with those on file.

    Each photograph is seen with two of them, the next one with the next two.
    """
    known, _, first = name.partition("/")[2].partition("#")
    photos = _photographed(settings.photos, category)[known][int(first) :][:SHARE]
    for number, photo in enumerate(photos):
        on_file = given_poses_of(settings.photos).get(photo.image, {})
        regimes = [GivenPoses.of(EXACT), GivenPoses.of(EXACT, (UNSAID,)), GivenPoses.of(ESTIMATOR)]
        regimes += [GivenPoses.of(told, names=tuple(on_file)) for told in sorted(on_file)]
        for turn in range(POSES_OF_EACH):
            given = regimes[(POSES_OF_EACH * number + turn) % len(regimes)]
            pose = given_pose(photo, settings.photos, given)
            about = {"camera": camera_of_photo(photo), "box": photo.box, "pose_sigma": given.pose_sigma}
            seen = observe(settings.photos / photo.image, pose, **about)
            said = "" if given.pose_sigma is None else " said"
            mesh = load_mesh(settings.photos / str(photo.mesh))
            yield PosedPicture(
                f"{photo.image} {given.told}{said}", seen, np.array(photo.camera_from_object), mesh
            )


def _photographed(photos: Path, category: str) -> dict[str, list[Photo]]:
    """Photographs with a mesh by their object's name; an object that is a mesh by its folder's."""
    found: dict[str, list[Photo]] = {}
    for photo in read_photos(photos):
        if photo.category == category and photo.mesh is not None:
            found.setdefault(photo.object or Path(photo.mesh).parent.name, []).append(photo)
    return found


def _execute(flow: GraspTransfer, picture: PosedPicture, settings) -> Iterator[Executed]:
    estimate = flow.estimator(picture.observation)
    planned = flow.plan(estimate)
    features = grasp_features(planned.grasps, planned.checks, flow.gripper, plausible=planned.plausible)
    chosen = _chosen(planned, features, np.random.default_rng(settings.seed))
    grasps = [replace(planned.grasps[i], opening=planned.checks[i].opening) for i in chosen]
    placed = as_executed(grasps, estimated_pose=estimate.camera_from_object, true_pose=picture.pose)
    trials = simulate(
        placed,
        picture.mesh,
        flow.gripper,
        protocol=settings.protocol,
        density=flow.category.density,  # which the scores assume, too
        seed=settings.seed,
    )
    for i, trial in zip(chosen, trials, strict=True):
        grasp = f"{flow.category.name}/{_family(planned.grasps[i])}"
        yield Executed(features[i], trial.status.held, estimate.trust, picture=picture.name, grasp=grasp)


def _chosen(planned: PlannedGrasps, features: list[Features], rng: np.random.Generator) -> list[int]:
    """The likeliest member of each symmetry family, as a robot would take, and some of the others."""
    usable = [i for i, check in enumerate(planned.checks) if check.usable]
    chances = {i: float(expected_success(features[i], Ranking.fitted().weights)) for i in usable}
    best: dict[str, int] = {}
    for i in sorted(usable, key=lambda i: -chances[i]):
        best.setdefault(_family(planned.grasps[i]), i)
    others = [int(i) for i in rng.permutation(usable) if i not in best.values()]
    return [*best.values(), *others][:MOST_GRASPS]


def _family(grasp: WarpedGrasp) -> str:
    return grasp.name.split("/")[0]

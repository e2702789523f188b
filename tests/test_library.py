"""Turning parametric shapes into a shape space: exact fields, a sound choice, the accuracy of CPD."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from grasptransfer.errors import CategoryError
from grasptransfer.registration import DeformationField
from grasptransfer.workshop import objects
from grasptransfer.workshop.building.parametric import library, space_choice
from grasptransfer.workshop.building.parametric.canonical_surface import surface_of
from grasptransfer.workshop.building.parametric.cpd_accuracy import cpd_accuracy


@pytest.fixture(scope="module")
def surface():
    return surface_of(objects.canonical("mug"))


@pytest.fixture(scope="module")
def moved(surface):
    return np.stack([surface.displacements(objects.sample("mug", seed)) for seed in range(12)])


def test_points_of_the_canonical_do_not_move_to_itself(surface):
    assert np.abs(surface.displacements(objects.canonical("mug"))).max() < 1e-9


def test_fields_of_all_shapes_at_once_are_those_of_one_after_the_other(surface, moved):
    field = DeformationField.identity(surface.control_points, beta=0.5)
    together = space_choice.fit_weights(surface.points, field, 0.1, moved[:2])
    for weights, displacements in zip(together, moved[:2], strict=True):
        alone = DeformationField.fit(
            surface.control_points,
            surface.points,
            surface.points + displacements,
            beta=0.5,
            regularisation=0.1,
        )
        batch = DeformationField(alone.control_points, weights, 0.5, alone.centre, alone.scale)
        # One solver leaves out what G shows by less than 1e-10: 20 micrometres where weights are large.
        assert np.allclose(batch(surface.points), alone(surface.points), atol=2e-5)


def test_the_chosen_space_is_the_best_that_does_not_fold(surface, moved, monkeypatch):
    monkeypatch.setattr(space_choice, "BETAS", (0.5, 1.0))
    monkeypatch.setattr(space_choice, "REGULARISATIONS", (0.1, 0.3))
    monkeypatch.setattr(space_choice, "MOST_MODES", 6)
    monkeypatch.setattr(space_choice, "MODES", (2, 4))
    choice = space_choice.choose_space(surface.points, surface.control_points, moved[:9], moved[9:])
    least = min(one.folded for one in choice.candidates)
    limit = max(space_choice.FOLDED_SHARE, space_choice.FOLDED_RATIO * least)
    sound = [one for one in choice.candidates if one.folded <= limit]
    best = min(sound, key=lambda one: one.heldout_rms)
    assert (choice.space.beta, choice.regularisation) == (best.beta, best.regularisation)
    assert choice.heldout_rms < 0.8 * choice.undeformed_rms


def test_cpd_comes_nearer_to_the_true_points_than_no_registration(surface):
    (row,) = cpd_accuracy(surface, betas=[2.0], lambdas=[10.0], samples=2)
    undeformed = [
        np.linalg.norm(surface.displacements(objects.sample("mug", seed)), axis=1).mean()
        for seed in (3_000_000, 3_000_001)
    ]
    assert row.mean < np.mean(undeformed)
    assert row.mean <= row.p95
    assert row.mean_share < row.mean / 0.05  # no mug's diagonal is below 5 cm


def test_the_command_writes_the_named_categories_or_all(monkeypatch):
    written = []
    monkeypatch.setattr(library, "build_shipped_category", lambda name, out, progress: written.append(out))
    library.main(Path("made"), ("mug",))
    library.main(Path("made"))
    assert written == [Path("made") / name for name in ("mug", *objects.generators())]


def test_the_command_ends_with_code_2_and_the_known_names(tmp_path):
    command = [
        sys.executable,
        "-m",
        "grasptransfer.workshop.building.parametric.library",
        str(tmp_path),
        "teapot",
    ]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert (ended.returncode, "spray_bottle" in ended.stderr) == (2, True)
    assert "Traceback" not in ended.stderr


def test_an_unknown_shipped_category_lists_the_known():
    with pytest.raises(CategoryError) as caught:
        library.build_shipped_category("teapot")
    assert caught.value.choices == list(objects.generators())

"""What a build chooses by measuring: settings, and what smooth modes add to a shape space."""

import contextlib
import io
import runpy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from vases import cloud

from grasptransfer.registration import DeformationField
from grasptransfer.workshop.building import build_category
from grasptransfer.workshop.building.choices import FLEXIBILITIES, best_trial, ranked
from grasptransfer.workshop.building.outcome import Candidate, CategoryBuild, Trial
from grasptransfer.workshop.building.settings import BETAS, LAMBDAS
from grasptransfer.workshop.building.space_fit import (
    SMOOTH,
    InstanceFields,
    fit_space,
    fitted_error,
    leave_out,
    loosened,
)

EXAMPLE = Path(__file__).parent.parent / "examples" / "08_settings_from_clouds.py"


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).normal(scale=0.05, size=(50, 3))


@pytest.fixture(scope="module")
def fields(points):
    """Of twelve instances, which two modes span, but for a little noise."""
    rng = np.random.default_rng(1)
    modes = rng.normal(scale=0.05, size=(2, 50, 3))
    weights = np.einsum("ik,knc->inc", rng.normal(size=(12, 2)), modes) + 1e-5 * rng.normal(size=(12, 50, 3))
    still = DeformationField.identity(points, beta=1.0)
    return InstanceFields(weights, still.control_points, still.beta, still.centre, still.scale)


def test_a_left_out_instance_shows_the_true_number_of_modes(fields):
    one, two, three = (
        [leave_out(fields, index, n_modes=modes, flexibility=0.0, metric="GW").rms for index in range(12)]
        for modes in (1, 2, 3)
    )
    assert np.mean(two) < 0.01 * np.mean(one)
    assert np.mean(three) > 0.5 * np.mean(two)


def test_a_space_fitted_to_the_points_of_its_own_shape_leaves_little(points, fields):
    space = fit_space(fields, n_modes=2, metric="GW")
    shape = space.field(np.array([1.0, -0.5]))(points)
    assert fitted_error(space, shape) < 1e-3 * np.square(shape - points).sum(1).mean()


def test_smooth_modes_move_every_axis_by_the_flexibility(points, fields):
    space = fit_space(fields, n_modes=2, metric="GW")
    loose = loosened(space, 0.05)
    assert loose.n_modes == 2 + 3 * SMOOTH
    assert np.array_equal(loose.basis[:2], space.basis)
    basis = loose.displacement_model(points).basis
    along = np.sqrt(np.square(basis[:, :, 2:]).sum(2).mean(0))
    assert np.allclose(along, 0.05 * space.scale, rtol=1e-6)
    assert np.allclose(np.square(basis / space.scale).sum((0, 1))[2:], loose.variances[2:])
    assert loosened(space, 0.0) is space


def test_the_least_error_wins_unless_a_tighter_space_comes_within_two_percent():
    few, many = Trial(1.0, 3.0, 4, 0.0, 1.01), Trial(1.0, 3.0, 8, 0.0, 1.00)
    worse, other = Trial(1.0, 3.0, 2, 0.0, 1.03), Trial(2.0, 3.0, 1, 0.0, 1.005)
    assert best_trial([many, few, worse, other]) == few
    loose = Trial(1.0, 3.0, 4, 0.04, 0.90)
    assert best_trial([many, few, loose]) == loose
    assert best_trial([few, Trial(1.0, 3.0, 4, 0.04, 1.00)]) == few


def test_of_candidates_that_leave_as_much_the_one_that_moves_least_is_first():
    def candidate(name, chamfer, moved, is_cloud=False):
        return Candidate(name, chamfer, worst=chamfer, moved=moved, is_cloud=is_cloud)

    given = [
        candidate("least", 1.0, 5.0),
        candidate("typical", 1.01, 2.0),
        candidate("far", 1.5, 1.0),
        candidate("further", 1.6, 0.5),
        candidate("cloud", 0.5, 0.1, is_cloud=True),
    ]
    assert [one.name for one in ranked(given)] == ["typical", "least", "far", "further", "cloud"]
    assert ranked(given[-1:])[0].name == "cloud"


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    """Five vases and one for the test, as clouds with their front along +y."""
    folder = tmp_path_factory.mktemp("clouds")
    sizes = [(0.10, 0.050), (0.12, 0.055), (0.14, 0.050), (0.13, 0.060), (0.11, 0.058), (0.125, 0.052)]
    for number, (height, width) in enumerate(sizes):
        place = folder / ("test" if number == 5 else "train")
        place.mkdir(exist_ok=True)
        x, y, z = cloud(height, width, 200).T
        np.savetxt(place / f"vase_{number}.xyz", np.stack([-y, x, z], -1))
    return folder


@dataclass(frozen=True)
class Compared:
    """What the example built, first with chosen settings, and what it printed."""

    builds: list[CategoryBuild]
    means: dict[str, float]
    printed: str
    out: Path


@pytest.fixture(scope="module")
def compared(clouds, tmp_path_factory):
    builds, printed, out = [], io.StringIO(), tmp_path_factory.mktemp("compared")

    def build(*given, **options):
        builds.append(build_category(*given, **options))
        return builds[-1]

    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr("grasptransfer.workshop.building.build_category", build)
        main = runpy.run_path(str(EXAMPLE))["main"]
        means = main([str(clouds), "--front", "+y", "--workers", "1", "--out", str(out)])
    return Compared(builds, means, printed.getvalue(), out)


def test_the_settings_of_the_best_trial_are_taken_and_shown(compared):
    built = compared.builds[0]
    settings, trials = built.category.settings, built.trials
    assert {(one.beta, one.lam) for one in trials} == {(beta, lam) for beta in BETAS for lam in LAMBDAS}
    assert {one.flexibility for one in trials} == {0.0, *FLEXIBILITIES}
    taken = [
        one
        for one in trials
        if (one.beta, one.lam, one.flexibility) == (settings.beta, settings.lam, settings.flexibility)
    ]
    assert min(one.error for one in taken) <= 1.02 * min(one.error for one in trials)
    assert settings.modes == built.category.shape_space.n_modes
    page = (compared.out / "chosen" / "category.html").read_text()
    assert page.count('<span class="pill good">taken</span>') == 2  # the settings, and the canonical model


def test_chosen_settings_leave_less_than_raw_metres(compared):
    assert 0 < compared.means["chosen"] < compared.means["raw metres"]
    assert "vase_5" in compared.printed

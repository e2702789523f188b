"""Every annotated grasp is executed on the canonical model it was annotated on."""

import dataclasses

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.grasping import expand_symmetry, load_grasps
from grasptransfer.simulation import PROTOCOLS, installed_engines, robustness

PROTOCOL = PROTOCOLS["lift-shake-v1"]
TRIALS, ENOUGH = 20, 18


@pytest.fixture(scope="module", params=installed_engines())
def engine(request):
    return request.param


@pytest.fixture(scope="module", params=gt.list_categories())
def category(request):
    return gt.load_category(request.param)


@pytest.fixture(scope="module")
def grasps(category):
    return load_grasps(category.grasps_path, category=category)


def test_every_annotated_grasp_holds_the_canonical_model(category, grasps, engine):
    assert len(grasps) >= 6
    trials = gt.simulate(grasps, category.canonical, engine=engine)
    assert [(trial.grasp, trial.detail) for trial in trials if not trial.held] == []
    # Typed-in widths are those at which the pads meet the object.
    for grasp, trial in zip(grasps, trials, strict=True):
        assert trial.width_mm == pytest.approx(1e3 * grasp.width, abs=4), grasp.name


@pytest.mark.full
def test_every_annotated_grasp_is_held_in_18_of_20_perturbed_trials(category, grasps):
    found = robustness(gt.simulate(grasps, category.canonical, trials=TRIALS, seed=0))
    assert {entry.grasp: entry.held for entry in found if entry.held < ENOUGH} == {}


@pytest.mark.full
def test_every_turn_of_a_symmetric_grasp_holds_as_well(category, grasps):
    turned = expand_symmetry([grasp for grasp in grasps if grasp.symmetry is not None])
    trials = gt.simulate(turned, category.canonical)
    assert [(trial.grasp, trial.detail) for trial in trials if not trial.held] == []


@pytest.mark.full
def test_half_the_time_step_gives_the_same_verdict_in_95_percent_of_trials():
    half = dataclasses.replace(PROTOCOL, name="half-step", time_step=PROTOCOL.time_step / 2)
    same = []
    for name in gt.list_categories():
        category = gt.load_category(name)
        grasps = load_grasps(category.grasps_path, category=category)
        whole, halved = (
            gt.simulate(grasps, category.canonical, protocol=protocol, trials=6)
            for protocol in (PROTOCOL, half)
        )
        same += [a.held == b.held for a, b in zip(whole, halved, strict=True)]
    assert np.mean(same) >= 0.95


@pytest.mark.full
def test_the_engines_agree_on_grasps_moved_to_test_instances():
    from grasptransfer.workshop.benchmark.engines import EngineSettings, run_engine_benchmark

    if len(installed_engines()) < 2:
        pytest.skip("PyBullet has no wheels for this Python")
    summary = run_engine_benchmark(EngineSettings(("mug", "bottle")))["summary"]
    assert summary["trials"] >= 60
    assert summary["agreement"] >= 0.9

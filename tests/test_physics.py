"""Mass, friction and force of a grasp, and which way is up."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from grasptransfer.category import list_categories, load_category
from grasptransfer.errors import SettingsError
from grasptransfer.frames import rigid
from grasptransfer.grasping import (
    Physics,
    PlausibleObjects,
    Scene,
    as_physics,
    check_grasps,
    load_gripper,
    on_canonical,
    rank_grasps,
)
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.simulation import PROTOCOLS

PANDA = load_gripper("panda")
DOWN = np.diag([1.0, -1.0, -1.0])
BEAM = trimesh.creation.box(extents=(0.02, 0.2, 0.06))
FROM_ABOVE = rigid(np.diag([1.0, -1, -1]), np.array([0, 0, 0.8]))


def score(physics, at=0.0, up=None):
    grasps = on_canonical([Grasp("g", "beam", rigid(DOWN, np.array([0, at, 0.015])), 0.02)])
    plausible = PlausibleObjects.draw(BEAM, physics=physics.held_by(PANDA.force_limit), up=up)
    return rank_grasps(grasps, check_grasps(grasps, BEAM, PANDA), PANDA, plausible=plausible)[0]


def test_a_gripper_of_one_newton_holds_nothing():
    assert score(Physics(mass=0.25)) > 0.7
    assert score(Physics(mass=0.25, force=1.0)) < 0.1


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        ({"mass": 0.1}, {"mass": 1.0}),
        ({"friction": 0.8}, {"friction": 0.2}),
        ({"force": 40.0}, {"force": 10.0}),
    ],
)
def test_what_is_heavy_slippery_or_weakly_held_scores_lower(better, worse):
    assert score(Physics(**better), at=0.03) > score(Physics(**worse), at=0.03) + 0.05


def test_force_and_friction_count_as_their_product_and_weigh_against_mass():
    scores = [
        score(Physics(mass=0.2, friction=0.4, force=40.0), at=0.02),
        score(Physics(mass=0.2, friction=0.8, force=20.0), at=0.02),
        score(Physics(mass=0.4, friction=0.8, force=40.0), at=0.02),
    ]
    assert scores[0] == pytest.approx(scores[1], abs=1e-9)
    assert scores[0] == pytest.approx(scores[2], abs=1e-9)


def test_a_factor_draws_values_on_both_sides():
    seen = PlausibleObjects.draw(BEAM, physics=Physics(mass=(0.3, 1.5), friction=0.5, force=20.0))
    logarithms = np.log(seen.mass / 0.3)
    assert logarithms.mean() == pytest.approx(0, abs=1e-9)
    assert logarithms.std() == pytest.approx(np.log(1.5), rel=0.1)
    assert seen.grip is not None
    np.testing.assert_allclose(seen.grip, 10.0)


def test_no_more_force_than_the_gripper_has():
    assert Physics(force=500.0).held_by(70.0).force == (70.0, 1.0)
    assert Physics().held_by(12.0).force == (12.0, 1.0)
    assert Physics(force=(20.0, 1.2)).held_by(70.0).force == (20.0, 1.2)


@pytest.mark.parametrize("key", ["mass", "friction", "force"])
@pytest.mark.parametrize("value", [-1.0, 0, np.nan, np.inf, True, "much", (1.0, 0.5), (1.0, 2.0, 3.0), ()])
def test_numbers_that_make_no_sense_are_refused(key, value):
    with pytest.raises(SettingsError, match=key):
        Physics(**{key: value})


def test_an_argument_may_be_a_mapping_and_every_mistake_in_it_is_named():
    assert as_physics(None) == Physics()
    assert as_physics({"mass": 0.3, "force": [20, 1.2]}) == Physics(mass=0.3, force=(20.0, 1.2))
    for wrong, words in ((0.3, "mapping"), ({"weight": 0.3}, "weight.*mass"), ({"mass": -1}, "mass")):
        with pytest.raises(SettingsError, match=words):
            as_physics(wrong)


def test_up_is_the_worlds_else_the_planes():
    plane = Scene(support_plane=(np.zeros(3), np.array([0.0, -2.0, 0.0])))
    np.testing.assert_allclose(Physics().standing(plane).up, [0, -1, 0])
    np.testing.assert_allclose(Physics().standing(plane, FROM_ABOVE).up, [0, 0, -1])
    assert Physics().standing(None).up is None
    assert Physics().standing(Scene()).up is None
    np.testing.assert_allclose(Physics(up=[0, 0, 2]).standing(plane).up, [0, 0, 1])
    for wrong in ([0, 0, 0], [1, 2], "up", [np.nan, 0, 1], [0, 0, 10**400]):
        with pytest.raises(SettingsError, match="up"):
            Physics(up=wrong)


def test_a_weight_turns_an_object_most_across_gravity():
    # 70 mm beside the weight of a lying beam; were its long axis upright, the weight would hang below.
    lying, hanging = (
        score(Physics(mass=0.4), at=0.07),
        score(Physics(mass=0.4), at=0.07, up=np.array([0, 1.0, 0])),
    )
    assert hanging > lying + 0.1


def test_a_category_weighs_what_the_trials_give_it_unless_its_file_says_otherwise():
    mug = load_category("mug")
    assert {load_category(name).density for name in list_categories()} == {PROTOCOLS["lift-shake-v1"].density}
    seen = PlausibleObjects.draw(mug.canonical, mug)
    assert 0.05 < np.exp(np.log(seen.mass).mean()) < 0.15  # kg: a light mug
    stoneware = replace(mug, file=mug.file.model_copy(update={"density": 2400.0}))
    heavy = PlausibleObjects.draw(mug.canonical, stoneware)
    np.testing.assert_allclose(heavy.mass, seen.mass * 4.8, rtol=1e-9)

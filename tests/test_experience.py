"""What experience makes of a chance, and the file that it comes from."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptransfer.category import list_categories, load_category
from grasptransfer.errors import GraspFileError
from grasptransfer.fitted import Fit, write_fits
from grasptransfer.grasping import Experience, experience, load_grasps

CHANCES = st.floats(0.01, 0.99)


@given(CHANCES)
def test_without_experience_a_chance_stays_what_it_is(chance):
    assert Experience().score(chance, "rim") == pytest.approx(chance)


@given(CHANCES, st.floats(-2, 2))
def test_experience_with_a_grasp_adds_to_its_log_odds_alone(chance, known):
    with_it = Experience(of_grasps={"rim": known})
    score = with_it.score(chance, "rim/90")  # a member of the family `rim`
    assert np.log(score / (1 - score)) == pytest.approx(np.log(chance / (1 - chance)) + known)
    assert with_it.score(chance, "handle") == pytest.approx(chance)


@given(CHANCES)
def test_a_score_is_as_steep_as_its_differences_say(chance):
    known, step = Experience(shift=0.2, slope=0.8, of_grasps={"rim": -1.0}), 1e-6
    ahead, behind = known.score(chance + step, "rim"), known.score(chance - step, "rim")
    assert known.steepness(chance, "rim") == pytest.approx((ahead - behind) / (2 * step), rel=1e-3)


@given(CHANCES, CHANCES)
def test_a_temperature_keeps_the_order_of_grasps(one, other):
    warm = Experience(shift=0.3, slope=0.5)
    assert (one < other) <= (warm.score(one, "a") <= warm.score(other, "b"))


def test_what_cannot_be_reached_stays_impossible():
    assert Experience(shift=2.0).score(0.0, "rim") == 0.0


def test_the_shipped_experience_is_with_grasps_that_the_categories_have():
    for name in list_categories():
        category = load_category(name)
        known = Experience.of(category)
        annotated = {grasp.name for grasp in load_grasps(category.grasps_path, category=category)}
        assert set(known.of_grasps) <= annotated
        assert known.slope > 0


def test_grasps_of_another_file_have_no_experience():
    assert Experience.of(load_category("drill"), own_grasps=False).of_grasps == {}


def test_what_was_written_is_read(tmp_path, monkeypatch):
    mug, path = load_category("mug"), tmp_path / "experience.yaml"
    sums = {"mug": mug.canonical_sha256}
    experience.write_experience((0.1, 0.9), {"mug": {"rim_left": -0.5}}, canonicals=sums, path=path)
    monkeypatch.setattr(experience, "experience_path", lambda: path)
    experience.read_experience.cache_clear()
    assert Experience.of(mug) == Experience(0.1, 0.9, {"rim_left": -0.5})
    assert 0 < experience.pose_share() <= 1
    sums = {"mug": "of another model"}
    experience.write_experience((0.1, 0.9), {"mug": {"rim_left": -0.5}}, canonicals=sums, path=path)
    assert Experience.of(mug).of_grasps == {}
    write_fits(path, {"mug": Fit.today({"rim_left": 1.0})})
    experience.read_experience.cache_clear()
    with pytest.raises(GraspFileError, match="temperature"):
        Experience.of(mug)
    monkeypatch.undo()
    experience.read_experience.cache_clear()

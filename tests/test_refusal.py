"""Refusal rates count what they say, and random objects are of no category."""

import numpy as np
import pytest

from grasptransfer.workshop.benchmark.refusal import RANDOM, summarise
from grasptransfer.workshop.training.random_objects import draw_random_object


def _row(shown: str, score: float) -> dict:
    return {"category": "mug", "shown": shown, "score": score, "accepted": score >= 0.5}


def test_rates_count_the_wrong_verdicts_on_own_and_foreign_objects():
    rows = [_row("mug", 0.9), _row("mug", 0.4), _row("drill", 0.6), _row("drill", 0.1), _row(RANDOM, 0.2)]
    summary = summarise(rows)
    assert summary["false_refusals"] == 0.5
    assert summary["false_acceptances_other"] == 0.5
    assert summary["false_acceptances_random"] == 0
    # 0.9 beats all three strangers, 0.4 two of them.
    assert summary["separation"] == pytest.approx(5 / 6)


def test_random_objects_are_small_solid_and_centred():
    for seed in range(5):
        scene = draw_random_object(np.random.default_rng(seed))
        mesh = scene.to_mesh()
        assert 0.01 < mesh.extents.max() < 0.5
        np.testing.assert_allclose(scene.bounds.mean(0), 0, atol=0.06)
        assert mesh.is_watertight


def test_a_random_object_follows_from_its_seed():
    first, second = (draw_random_object(np.random.default_rng(3)).to_mesh() for _ in range(2))
    np.testing.assert_array_equal(first.vertices, second.vertices)

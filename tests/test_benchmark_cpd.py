"""Benchmarks of the registration room: small runs give the contract's documents."""

import numpy as np
import pytest

from grasptransfer.errors import CategoryError
from grasptransfer.workshop.benchmark.cpd import CpdSettings, run_cpd_benchmark
from grasptransfer.workshop.benchmark.latent_fit import METHODS, LatentFitSettings, run_latent_fit_benchmark


def test_cpd_is_compared_with_the_installed_peer_on_the_same_clouds():
    result = run_cpd_benchmark(CpdSettings((60,), repeats=1))
    rows = {row["implementation"]: row for row in result["rows"]}
    assert {"grasptransfer", "grasptransfer-numpy", "pycpd"} <= set(rows)
    assert all(row["seconds"] > 0 and row["n"] == 60 and not row["extrapolated"] for row in rows.values())
    summary = result["summary"]
    assert summary["speedup_vs_pycpd_n60"] == pytest.approx(
        rows["pycpd"]["seconds"] / rows["grasptransfer"]["seconds"]
    )
    # Both run 150 iterations of the same method; the bar is 0.1 %.
    assert summary["error_ratio_vs_pycpd_n60"] == pytest.approx(1, abs=1e-3)


def test_a_peer_that_would_take_too_long_is_extrapolated_and_says_so(monkeypatch):
    monkeypatch.setattr(
        "grasptransfer.workshop.benchmark.cpd._peak_memory", lambda *_: 0.0
    )  # fresh processes are slow
    result = run_cpd_benchmark(CpdSettings((60,), repeats=1, longest=1e-9))
    rows = {row["implementation"]: row for row in result["rows"]}
    assert rows["pycpd"]["extrapolated"]
    assert rows["pycpd"]["E"] is None
    assert not rows["grasptransfer"]["extrapolated"]
    assert "pycpd n=60" in result["summary"]["extrapolated"]


@pytest.fixture
def clouds(tmp_path):
    """Boxes of different proportions, as files."""
    rng = np.random.default_rng(0)
    for kind, count in (("train", 6), ("test", 1)):
        (tmp_path / kind).mkdir()
        for number in range(count):
            points = rng.uniform(-0.5, 0.5, (120, 3))
            points[np.arange(120), rng.integers(0, 3, 120)] = rng.choice([-0.5, 0.5], 120)
            np.savetxt(tmp_path / kind / f"{kind}_{number}.xyz", points * rng.uniform(0.1, 0.2, 3))
    return tmp_path


def test_fits_of_a_shape_space_are_compared_with_the_predecessor(clouds):
    result = run_latent_fit_benchmark(LatentFitSettings(clouds, n_modes=2, repeats=1))
    assert {(row["method"], row["pose"]) for row in result["rows"]} == {
        (method, pose) for method in METHODS for pose in ("kept", "refined")
    }
    summary = result["summary"]
    for pose in ("kept", "refined"):
        ours = summary[f"E_grasptransfer_pose_{pose}"]
        assert 0 < ours < 1000  # a third of the boxes' sides; undeformed ones differ by more
        ratio = ours / summary[f"E_predecessor_pose_{pose}"]  # one test cloud: its mean is itself
        assert summary[f"error_ratio_vs_predecessor_pose_{pose}"] == pytest.approx(ratio)


def test_too_few_clouds_for_the_modes_are_refused(clouds):
    with pytest.raises(CategoryError, match="7 clouds"):
        run_latent_fit_benchmark(LatentFitSettings(clouds, n_modes=6))

"""Right and wrong inputs: what they are, what is answered to them, and the rates that are counted."""

import numpy as np
import pytest
from PIL import Image

import grasptransfer as gt
from grasptransfer.errors import GraspTransferError
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.workshop.benchmark.refusal import RefusalSettings, answer_to, measure_piece
from grasptransfer.workshop.benchmark.refusal_table import rates, summarise
from grasptransfer.workshop.benchmark.tables import rows_table
from grasptransfer.workshop.training.random_objects import draw_random_object
from grasptransfer.workshop.training.wrong_inputs import (
    Pictured,
    right_inputs,
    without_object,
    wrong_cameras_and_boxes,
    wrong_poses,
)

DEMO = gt.load_category("mug").folder / "demo"


@pytest.fixture(scope="module")
def seen():
    """The bundled mug, at its given pose."""
    mug, pose = gt.load_category("mug"), gt.load_pose(DEMO / "pose.yaml")
    image = np.array(Image.open(DEMO / "picture.png").convert("RGB"))
    camera = gt.Camera.load(DEMO / "camera.yaml")
    return Pictured.of(image, camera, pose, np.asarray(mug.canonical.vertices))


@pytest.fixture(scope="module")
def inputs(seen):
    rng, mug = np.random.default_rng(0), gt.load_category("mug")
    every = [
        *right_inputs(seen, rng),
        *without_object(seen, rng),
        *wrong_poses(seen, mug, rng),
        *wrong_cameras_and_boxes(seen, rng),
    ]
    return {given.name: given for given in every}


@pytest.fixture(scope="module")
def flow():
    return gt.GraspTransfer("mug", device="cpu")


@pytest.mark.parametrize("name", ["box", "rough pose", "BGR for RGB"])
def test_right_inputs_get_grasps_and_no_warning(name, inputs, flow):
    row = answer_to(flow, inputs[name])
    assert row["status"] == "ok"
    assert not row["noticed"]
    assert row["usable"]


@pytest.mark.parametrize("name", ["blank picture, no box", "noise"])
def test_a_picture_without_evidence_gives_no_grasp(name, inputs, flow):
    row = answer_to(flow, inputs[name])
    assert row["noticed"]
    assert row["usable"] == 0


@pytest.mark.parametrize(
    ("name", "status", "warning"),
    [
        ("turned 180 about z", EstimateStatus.POSE_TURNED, "180 degrees about its z axis"),
        ("turned 90 about x", EstimateStatus.POSE_TURNED, "degrees about its x axis"),
        ("box of twice the size", EstimateStatus.OK, "times those of the object"),
        ("30 cm aside", EstimateStatus.BOX_MISPLACED, "does not hold the object"),
    ],
)
def test_a_wrong_input_gets_its_status_and_its_cause(name, status, warning, inputs, flow):
    estimate = flow.estimator(inputs[name].observation())
    assert estimate.status is status
    assert warning in estimate.warning
    assert estimate.advice.startswith(status.advice)


@pytest.mark.parametrize(
    "name", ["pose: OpenGL's camera", "pose: millimetres", "pose: inverted, in OpenGL's"]
)
def test_a_pose_in_another_convention_is_refused_by_its_name(name, inputs):
    with pytest.raises(GraspTransferError) as caught:
        inputs[name].observation()
    assert inputs[name].names(str(caught.value))


def test_a_piece_of_the_benchmark_answers_every_input(monkeypatch):
    from grasptransfer.workshop.benchmark import refusal

    monkeypatch.setattr(refusal, "answer_to", lambda flow, given: {"input": given.name, "noticed": False})
    rows = measure_piece(RefusalSettings(("mug",), pictures=1), "mug", "0")["rows"]
    names = [row["input"] for row in rows]
    assert len(names) == len(set(names))
    assert {"box", "noise", "object of no category", "BGR for RGB"} <= set(names)
    assert sum(name.startswith("turned") for name in names) == 2


def _row(name, verdict, noticed, usable):
    return {
        "category": "mug",
        "shown": "picture",
        "input": name,
        "verdict": verdict.value,
        "noticed": noticed,
        "named": noticed,
        "usable": usable,
    }


def test_rates_count_what_is_noticed_of_right_and_of_wrong_inputs():
    rows = [
        _row("box", EstimateStatus.OK, False, 3),
        _row("box", EstimateStatus.OK, True, 0),
        _row("noise", EstimateStatus.NOTHING_SEEN, True, 0),
        _row("turned 90 about z", EstimateStatus.POSE_TURNED, False, 2),
    ]
    summary = summarise(rows)
    assert summary["picture_right_noticed"] == 0.5
    assert summary["picture_without_object_usable"] == 0
    assert summary["picture_turned_noticed"] == 0
    assert summary["right_noticed_mug"] == 0.5
    assert [line["input"] for line in rates(rows)] == ["box", "noise", "turned 90 about z"]
    table = rows_table({"benchmark": "refusal", "rows": rows})
    assert table is not None
    assert table.row_count == 3


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

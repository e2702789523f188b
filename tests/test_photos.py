"""The photo benchmark, on pictures made for it."""

import numpy as np
import pytest
import yaml
from PIL import Image

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.errors import SettingsError
from grasptransfer.workshop.benchmark.photo_files import taken_beside
from grasptransfer.workshop.benchmark.photo_summary import summarise_photos
from grasptransfer.workshop.benchmark.photos import PhotoSettings, measure_object, read_photos
from grasptransfer.workshop.benchmark.seen_instances import load_instance, observe_instance
from grasptransfer.workshop.benchmark.tables import rows_table


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One mug, photographed once with its mesh and depth, and once with its size alone."""
    folder = tmp_path_factory.mktemp("photos")
    instance = load_instance("mug", "mug_0014", None)
    instance.solid.export(folder / "mug.glb")
    with Renderer() as renderer:
        seen, pose = observe_instance(instance, 40, renderer=renderer)
    assert seen.box is not None
    Image.fromarray(seen.image).save(folder / "mug.png")
    Image.fromarray(np.round(seen.depth * 1000).astype(np.uint16)).save(folder / "depth.png")
    Image.fromarray(seen.mask.astype(np.uint8) * 255).save(folder / "mask.png")
    camera = seen.camera
    entry = {
        "image": "mug.png",
        "category": "mug",
        "camera": {key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy", "width", "height")},
        "camera_from_object": pose.tolist(),
        "box": list(seen.box),
        "size_m": instance.solid.extents.tolist(),
        "licence": "other keys are passed over",
    }
    known = {"object": "known", "mesh": "mug.glb", "depth": "depth.png", "mask": "mask.png"}
    entries = [entry | known, entry | {"object": "unknown"}]
    (folder / "photos.yaml").write_text(yaml.safe_dump(entries))
    return folder


def test_a_photograph_with_a_mesh_is_scored_by_its_shape(folder):
    (row,) = measure_object(PhotoSettings(folder, ("mug",), depth=True), "mug", "known")["rows"]
    assert row["rgb"]["E"] < row["rigid"]["E"]
    assert row["cls"]["E"] < row["rigid"]["E"]
    assert {"rgbd", "cpd", "similarity"} <= row.keys()
    assert 0.5 < row["rgb"]["silhouette_iou"] <= 1
    assert row["rgb"]["rms_mm"] == pytest.approx(np.sqrt(row["rgb"]["E"]))  # mm and (1e-3 m)^2
    assert row["mask_iou"] > 0.5
    assert row["iou50"] == 1
    table = rows_table({"benchmark": "photos", "rows": [row]})
    assert table is not None
    assert table.row_count == 1


def test_photographs_of_one_object_are_seen_together_about_45_degrees_apart(folder):
    (entry, _) = read_photos(folder)
    poses = [look_at(0.4, np.deg2rad(azimuth), 0.3).tolist() for azimuth in (0, 10, 50, 100, 180)]
    photos = [
        entry.model_copy(update={"image": f"{number}.png", "camera_from_object": pose})
        for number, pose in enumerate(poses)
    ]
    assert [photo.image for photo in taken_beside(photos[0], photos, 2)] == ["2.png", "3.png"]
    assert len(taken_beside(photos[0], photos, 9)) == 4
    assert taken_beside(photos[0], photos[:1], 1) == []


def test_grasps_are_executed_where_a_mesh_is_known(folder):
    settings = PhotoSettings(folder, ("mug",), grasps=True)
    (known,) = measure_object(settings, "mug", "known")["rows"]
    (unknown,) = measure_object(settings, "mug", "unknown")["rows"]
    assert known["rgb"]["grasp_held"]
    assert known["rgb"]["usable_held"] <= known["rgb"]["usable"]
    assert "grasp_held" not in unknown["rgb"]
    summary = summarise_photos([known, unknown])
    assert summary["rgb_grasps_executed_photos"] == 1
    assert summary["rgb_grasp_held"] == 1.0
    assert 0.3 < summary["rgb_grasp_stated"] <= 1


def test_a_photograph_without_a_mesh_is_scored_by_its_size(folder):
    (row,) = measure_object(PhotoSettings(folder, ("mug",)), "mug", "unknown")["rows"]
    assert set(row["rgb"]) == {"size_error"}
    assert "cls" not in row


def test_wins_are_counted_by_photograph_and_by_object():
    def row(name, ours, theirs):
        return {
            "object": name,
            "category": "mug",
            "rgb": {"E": ours[0], "silhouette_iou": ours[1]},
            "rigid": {"E": theirs[0], "silhouette_iou": theirs[1]},
        }

    rows = [
        row("a", (1.0, 0.9), (4.0, 0.8)),
        row("a", (3.0, 0.9), (2.0, 0.8)),
        row("b", (1.0, 0.7), (4.0, 0.8)),
    ]
    summary = summarise_photos(rows)
    assert summary["rgb_beats_rigid"] == pytest.approx(2 / 3)
    assert summary["objects_lost_to_rigid"] == 1  # b: nearer, but its outline fits worse
    assert summary["lost_to_rigid"] == "b"
    assert summary["mug_rgb_E_mean"] == pytest.approx(5 / 3)
    assert summary["rgb_beats_similarity"] is None


def test_a_wrong_entry_is_named(tmp_path):
    (tmp_path / "photos.yaml").write_text(yaml.safe_dump([{"image": "a.png", "category": "mug"}]))
    with pytest.raises(SettingsError, match="camera"):
        read_photos(tmp_path)

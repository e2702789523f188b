"""Portraits of objects, and pictures side by side."""

import io

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from grasptransfer.drawing.contact_sheet import GROUND, contact_sheet, portrait
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.sheet import GAP, LINE, encoded, sheet
from grasptransfer.errors import SettingsError

WHITE = (255, 255, 255)


def test_every_cell_shows_its_shape_on_the_ground_colour():
    scenes = [trimesh.creation.icosphere(3, radius) for radius in (0.02, 0.05, 0.2)]
    with Renderer() as renderer:
        page = contact_sheet(scenes, renderer, columns=2, side=40)
    assert page.shape == (2 * (40 + GAP) - GAP, 2 * (80 + GAP) - GAP, 3)
    for row, column in ((0, 0), (0, 1), (1, 0)):
        for view in (0, 1):
            top, left = row * (40 + GAP), column * (80 + GAP) + view * 40
            cell = page[top : top + 40, left : left + 40]
            np.testing.assert_array_equal(cell[0, 0], GROUND)
            assert np.abs(cell[20, 20].astype(int) - GROUND).max() > 10
    assert (page[40 + GAP :, 80 + GAP :] == 255).all()  # no fourth shape


def test_a_portrait_shows_the_texture_on_its_ground_and_is_the_same_each_time():
    texture = Image.new("RGB", (4, 4), (200, 30, 30))
    material = PBRMaterial(baseColorTexture=texture)
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.visual = TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    with Renderer() as renderer:
        image, again = (portrait(box, renderer, 40, ground=WHITE) for _ in range(2))
    assert (image[0, 0] == 255).all()
    red, green, blue = image[20, 20].astype(int)
    assert red > 2 * green
    assert red > 2 * blue
    assert encoded(image) == encoded(again)


def test_a_portrait_shows_parts_where_their_nodes_put_them():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    away = trimesh.transformations.translation_matrix([0, 0.3, 0])
    scene, moved = trimesh.Scene(), trimesh.Scene([box, box.copy().apply_transform(away)])
    scene.add_geometry(box, geom_name="box")
    scene.graph.update("second", matrix=away, geometry="box")
    with Renderer() as renderer:
        assert np.array_equal(portrait(scene, renderer, 40), portrait(moved, renderer, 40))


def test_a_portrait_holds_all_of_an_object_that_is_not_centred():
    box = trimesh.creation.box((0.1, 0.02, 0.3))
    box.apply_translation([0.4, 0.0, -0.2])
    with Renderer() as renderer:
        image = portrait(box, renderer, 60, ground=WHITE)
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    assert (border == 255).all()
    rows = np.flatnonzero((image < 250).any(axis=(1, 2)))
    assert rows[-1] - rows[0] > 40  # it fills the picture


def test_text_has_its_own_space():
    pictures = [np.full((30, 40, 3), shade, np.uint8) for shade in (10, 20, 30)]
    page = sheet(pictures, 2, captions=["a", "b", "c"], heads=["left", "right"])
    assert page.shape == (LINE + 2 * (30 + LINE + GAP) - GAP, 2 * (40 + GAP) - GAP, 3)
    assert (page[LINE : LINE + 30, :40] == 10).all()
    assert (page[LINE + 30 + LINE + GAP :][:30, :40] == 30).all()


def test_a_picture_is_written_in_the_kind_its_suffix_names():
    picture = np.zeros((8, 8, 3), np.uint8)
    assert Image.open(io.BytesIO(encoded(picture, ".JPG"))).format == "JPEG"
    with pytest.raises(SettingsError, match="png"):
        encoded(picture, ".tiff")

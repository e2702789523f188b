import numpy as np
import trimesh

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.report.contact_sheet import GROUND, contact_sheet


def test_every_cell_shows_its_shape_on_the_ground_colour():
    scenes = [trimesh.creation.icosphere(3, radius) for radius in (0.02, 0.05, 0.2)]
    with Renderer() as renderer:
        sheet = contact_sheet(scenes, renderer, columns=2, side=40)
    assert sheet.shape == (2 * 44, 2 * 84, 3)
    for row, column in ((0, 0), (0, 1), (1, 0)):
        for view in (0, 1):
            top, left = row * 44, column * 84 + view * 40
            cell = sheet[top : top + 40, left : left + 40]
            np.testing.assert_array_equal(cell[0, 0], GROUND)
            assert np.abs(cell[20, 20].astype(int) - GROUND).max() > 10
    assert (sheet[44:, 84:] == 255).all()  # no fourth shape

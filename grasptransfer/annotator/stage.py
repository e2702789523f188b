"""What the annotator's page shows in three dimensions: the model, the gripper, and other shapes beside it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.annotator.measurement import Measurement
from grasptransfer.annotator.trying import OnShape
from grasptransfer.category import Category
from grasptransfer.frames import rigid
from grasptransfer.grasping import Gripper
from grasptransfer.yaml_models import Quaternion, quaternion_of

USABLE, REFUSED, HAND = (46, 160, 67), (214, 69, 48), (125, 131, 140)
CONTACT, SHAPE = (240, 190, 40), (196, 201, 208)
OPAQUE, SEE_THROUGH = 0.85, 0.25
APART = 1.9  # distance between shapes side by side, in lengths of the canonical model


class Stage:
    """Draws into the scene of a viser server.

    Args:
        server: of viser.
        category: its canonical model is drawn once.
        gripper: drawn wherever `show` puts it.
    """

    def __init__(self, server: Any, category: Category, gripper: Gripper):
        self.scene, self.gripper = server.scene, gripper
        self.opacity = OPAQUE
        mesh = category.canonical
        self.size = size = float(mesh.extents.max())
        self.scene.set_up_direction("+z")
        self.scene.add_mesh_trimesh("/object", mesh)
        floor = (0.0, 0.0, float(mesh.bounds[0, 2]))
        self.scene.add_grid(
            "/floor", width=4 * size, height=4 * size, cell_size=0.01, section_size=0.05, position=floor
        )
        self.scene.add_frame(
            "/canonical", axes_length=0.6 * size, axes_radius=0.004 * size, origin_radius=0.0
        )
        self.scene.add_label("/canonical/front", "+x: front", position=(0.65 * size, 0.0, 0.0))
        self.controls = self.scene.add_transform_controls("/gripper", scale=0.7 * size, depth_test=False)
        server.initial_camera.position = tuple(2.3 * size * np.array([0.7, 0.9, 0.6]))
        server.initial_camera.look_at = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Float[np.ndarray, "4 4"]:
        """Where the arrows and rings are: `canonical_from_gripper` [m]."""
        w, x, y, z = (float(value) for value in self.controls.wxyz)
        rotation = Quaternion(w=w, xyz=(x, y, z)).matrix()
        return rigid(rotation, np.array(self.controls.position, dtype=float))

    def place(self, canonical_from_gripper: Float[np.ndarray, "4 4"]) -> None:
        """Put the arrows and rings there [m]."""
        self.controls.position = canonical_from_gripper[:3, 3]
        self.controls.wxyz = np.array(quaternion_of(canonical_from_gripper[:3, :3]))

    def show(self, found: Measurement) -> None:
        """Draw the gripper, opened as it arrives, and the contacts."""
        self._gripper("/gripper", found.opening, usable=found.usable)
        for side in range(2):
            self.scene.add_icosphere(
                f"/contact_{side}",
                radius=0.002,
                color=CONTACT,
                position=(0.0, 0.0, 0.0) if found.contacts is None else tuple(found.contacts[side]),
                visible=found.contacts is not None,
            )

    def show_beside(self, shapes: Sequence[OnShape]) -> None:
        """Draw the grasp on other shapes, in a row behind the canonical model; none given: clear the row."""
        self.scene.remove_by_name("/beside")
        for number, shape in enumerate(shapes):
            y = APART * self.size * (number - (len(shapes) - 1) / 2)
            place = f"/beside/{number}"
            self.scene.add_frame(place, show_axes=False, position=(-APART * self.size, y, 0.0))
            self._mesh(f"{place}/shape", shape.mesh, SHAPE, opacity=1.0)
            pose = shape.grasp.object_from_gripper
            self.scene.add_frame(
                f"{place}/gripper",
                show_axes=False,
                position=pose[:3, 3],
                wxyz=np.array(quaternion_of(pose[:3, :3])),
            )
            self._gripper(f"{place}/gripper", shape.check.opening, usable=shape.check.usable)

    def _gripper(self, place: str, opening: float, *, usable: bool) -> None:
        colour, fingers = USABLE if usable else REFUSED, self.gripper.finger_links
        for link, mesh in self.gripper.link_meshes(opening, visual=True).items():
            self._mesh(f"{place}/{link}", mesh, colour if link in fingers else HAND, opacity=self.opacity)

    def _mesh(self, place: str, mesh: trimesh.Trimesh, colour: tuple, *, opacity: float) -> None:
        self.scene.add_mesh_simple(
            place,
            np.asarray(mesh.vertices, np.float32),
            np.asarray(mesh.faces, np.uint32),
            color=colour,
            flat_shading=True,
            opacity=opacity,
        )

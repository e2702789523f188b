"""The page of a pose: the photograph, the model before it to drag and turn, and a panel of controls."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from grasptransfer.annotator.requests import Request, Requests
from grasptransfer.errors import GraspTransferError
from grasptransfer.frames import rigid
from grasptransfer.posing.session import PoseSession
from grasptransfer.yaml_models import Quaternion, quaternion_of

MODEL = (40, 205, 190)
OPACITY = 0.45
BEHIND = 1.6  # the photograph stands so many times as far away as the object
ROOM = 1.06  # of the view around the photograph
BESIDE = 0.75  # share of a wide window that the panel leaves
RAISED = 0.6  # of half the view: how far a tall window shows the photograph above its middle
TURNS = {"turn left": ((0, 0, 1), 10.0), "turn right": ((0, 0, 1), -10.0), "half turn": ((0, 0, 1), 180.0)}
HELP = (
    "The model lies over the photograph. **Drag** its arrows and rings until the outline fits, or take a "
    "proposal; **fit** does the rest. Distance moves it along its ray: in the picture it stays where it is."
)


class PosePage:
    """One browser page on one session; every change of the scene happens in `refresh`.

    Args:
        server: of viser.
        session: that it shows.
        path: where `save` writes.
    """

    def __init__(self, server: Any, session: PoseSession, path: Any):
        self.server, self.session, self.path = server, session, path
        self.saved = False
        self._requests, self._loading = Requests(), False
        self._build_scene()
        self._build_panel()
        server.on_client_connect(lambda client: self._look_through(client))
        self._show()

    def refresh(self) -> None:
        """Do what was asked for since the last time; a wrong request is answered in the panel."""
        for request in self._requests.taken():
            try:
                request.action()
            except GraspTransferError as error:
                self.status.content = f"**{error}**"
                self._place()

    def _later(self, action: Callable[[], Any], *, drag: bool = False) -> None:
        self._requests.add(Request(action, None, drag))

    def _build_scene(self) -> None:
        session, scene = self.session, self.server.scene
        camera = session.camera
        scene.set_up_direction("-y")
        depth = BEHIND * session.distance
        width, height = depth * camera.width / camera.fx, depth * camera.height / camera.fy
        middle = camera.unproject(np.array([camera.width - 1, camera.height - 1]) / 2, np.array(depth))
        self._photograph = scene.add_image(
            "/photograph", session.overlay(), width, height, position=tuple(middle), cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        scale = 0.9 * float(session.category.canonical.extents.max())
        self._controls = scene.add_transform_controls("/object", scale=scale, depth_test=False)
        self._controls.on_update(lambda _: self._dragged())
        self._controls.on_drag_end(lambda _: self._later(session.end_of_move))
        self._half_sides = camera.width / 2 / camera.fx, camera.height / 2 / camera.fy

    def _build_panel(self) -> None:
        gui, session = self.server.gui, self.session
        gui.configure_theme(control_layout="fixed")  # beside the photograph, not over it
        gui.add_markdown(f"### pose of a {session.category.name.replace('_', ' ')}\n{HELP}")
        chances = enumerate((one.chance for one in session.proposals), 1)
        self.proposal = gui.add_dropdown(
            "proposal", [f"{number}: {chance:.0%} likely" for number, chance in chances]
        )
        self.proposal.on_update(lambda _: self._later(self._chosen))
        self.status = gui.add_markdown("")
        self.distance = gui.add_number("distance [m]", session.distance, step=0.005, min=0.05, max=20.0)
        self.distance.on_update(lambda _: self._typed())
        turns = gui.add_button_group("about its axis", tuple(TURNS))
        turns.on_click(lambda _: self._later(lambda: self._turned(str(turns.value))))
        self._button("fit", self._fit, color="teal")
        self._button("undo", lambda: self._changed(session.undo))
        self._button("look through the camera", self._look_again)
        self._button("save", self._save, color="green")

    def _button(self, text: str, action: Callable[[], None], **options: Any) -> None:
        self.server.gui.add_button(text, **options).on_click(lambda _: self._later(action))

    def _chosen(self) -> None:
        number = int(str(self.proposal.value).split(":", 1)[0]) - 1
        self._changed(lambda: self.session.choose(number))

    def _turned(self, name: str) -> None:
        axis, degrees = TURNS[name]
        self.session.end_of_move()
        self._changed(lambda: self.session.turn(axis, degrees))

    def _typed(self) -> None:
        if not self._loading:
            metres = float(self.distance.value)
            self._later(lambda: self._changed(lambda: self.session.place_at_distance(metres)), drag=True)

    def _dragged(self) -> None:
        if not self._loading:
            pose = self._pose()
            self._later(lambda: self._changed(lambda: self.session.move(pose), place=False), drag=True)

    def _fit(self) -> None:
        self.status.content = "fitting …"
        self._changed(self.session.fit)

    def _changed(self, edit: Callable[[], Any], *, place: bool = True) -> None:
        edit()
        self.saved = False
        self._show(place=place)

    def _save(self) -> None:
        self.session.save(self.path)
        self.saved = True
        self.status.content = f"Saved to `{self.path}`. {self.session.sentence}"

    def _show(self, *, place: bool = True) -> None:
        """Draw model and outline, and say what is known of the pose."""
        session = self.session
        self.server.scene.add_mesh_simple(
            "/object/model",
            session.vertices.astype(np.float32),
            np.asarray(session.category.canonical.faces, np.uint32),
            color=MODEL,
            opacity=OPACITY,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._photograph.image = session.overlay()
        overlap = f"its box and the object's overlap by **{session.box_overlap:.0%}**"
        self.status.content = f"{session.sentence}\n\n{overlap}"
        if place:
            self._place()
        self._loading = True
        self.distance.value = round(session.distance, 4)
        self._loading = False

    def _place(self) -> None:
        """Put arrows and rings where the model is."""
        pose = self.session.now.camera_from_object
        self._loading = True
        self._controls.position = pose[:3, 3]
        self._controls.wxyz = np.array(quaternion_of(pose[:3, :3]))
        self._loading = False

    def _pose(self) -> Float[np.ndarray, "4 4"]:
        w, x, y, z = (float(value) for value in self._controls.wxyz)
        rotation = Quaternion(w=w, xyz=(x, y, z)).matrix()
        return rigid(rotation, np.array(self._controls.position, dtype=float))

    def _look_again(self) -> None:
        for client in self.server.get_clients().values():
            self._look_through(client)

    def _look_through(self, client: Any) -> None:
        """Put a client's eye where the camera was: model and photograph lie over each other then."""
        camera, aspect = self.session.camera, float(client.camera.aspect)
        wide, high = self._half_sides
        half = ROOM * max(high, wide / (aspect * BESIDE if aspect > 1 else aspect))
        middle = camera.unproject(np.array([camera.width - 1, camera.height - 1]) / 2, np.array(1.0))
        if aspect < 1:
            middle[1] += RAISED * half  # a phone's panel covers the lower part
        client.camera.up_direction = (0.0, -1.0, 0.0)
        client.camera.position = (0.0, 0.0, 0.0)
        client.camera.look_at = tuple(middle)
        client.camera.fov = 2 * float(np.arctan(half))

"""The annotator's page: the canonical model, a gripper to drag, and live checks, served by viser."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from grasptransfer.annotator.session import Session
from grasptransfer.category import Category, load_category
from grasptransfer.errors import GraspTransferError, SettingsError
from grasptransfer.frames import rigid
from grasptransfer.grasping import Gripper, load_gripper
from grasptransfer.yaml_models import Quaternion, quaternion_of

REFRESH = 0.05  # s between looks at what was dragged
USABLE, REFUSED, HAND = (46, 160, 67), (214, 69, 48), (125, 131, 140)
CONTACT = (240, 190, 40)
HELP = (
    "Drag the arrows and rings: **blue** is the approach, **red** the closing direction. "
    "Contacts and width follow by closing the pads on the surface."
)


def annotate(
    category: str | Path | Category,
    *,
    gripper: str | Path | Gripper = "panda",
    path: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    on_ready: Callable[[str], None] = lambda text: None,
    stop: threading.Event | None = None,
) -> None:
    """Serve the annotator until interrupted, or until `stop` is set.

    Args:
        category: name, folder or loaded `Category`.
        gripper: name, YAML path or loaded `Gripper`.
        path: grasp file; the category's own if None.
        host, port: to serve at.
        on_ready: told where to look.

    Raises:
        GraspTransferError: wrong category, gripper or grasp file; viser is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise SettingsError("the package viser is missing", fix="pip install viser") from error
    if not 0 < port < 65536:
        raise SettingsError("must lie between 1 and 65535", key="port", value=port)
    loaded = gripper if isinstance(gripper, Gripper) else load_gripper(gripper)
    session = Session(load_category(category), loaded, path=path)
    server = viser.ViserServer(
        host=host, port=port, label=f"grasps of {session.category.name}", verbose=False
    )
    stop = stop or threading.Event()
    try:
        page = Page(server, session)
        on_ready(f"Annotating {session.path}: http://{host}:{server.get_port()}  (Ctrl-C ends)")
        while not stop.wait(REFRESH):
            page.refresh()
    except KeyboardInterrupt:
        on_ready("unsaved changes are lost" if session.unsaved else "everything is saved")
    finally:
        server.stop()


class Page:
    """One browser page on one session; every change of the scene happens in `refresh`."""

    def __init__(self, server: Any, session: Session):
        self.server, self.session = server, session
        self._selected: str | None = None
        self._pending: list[_Asked] = []
        self._lock = threading.Lock()
        self._loading = False
        self._build_scene()
        self._build_panel()
        self._later(lambda: self._select(session.names[0] if session.names else None))
        self.refresh()

    def refresh(self) -> None:
        """Do what was asked for since the last time; a wrong request is answered in the panel."""
        with self._lock:
            pending, self._pending = self._pending, []
        for asked in pending:
            if asked.grasp not in (None, self._selected):
                continue  # it was asked of another grasp
            try:
                asked.action()
            except GraspTransferError as error:
                self.status.content = f"**{error}**"

    def _later(self, action: Callable[[], Any], *, grasp: str | None = None, drag: bool = False) -> None:
        with self._lock:
            if drag and self._pending and self._pending[-1].drag:
                self._pending.pop()  # only the last of many small moves matters
            self._pending.append(_Asked(action, grasp, drag))

    def _build_scene(self) -> None:
        scene = self.server.scene
        scene.set_up_direction("+z")
        mesh = self.session.category.canonical
        scene.add_mesh_trimesh("/object", mesh)
        size = float(mesh.extents.max())
        floor = (0.0, 0.0, float(mesh.bounds[0, 2]))
        scene.add_grid(
            "/floor", width=4 * size, height=4 * size, cell_size=0.01, section_size=0.05, position=floor
        )
        scene.add_frame("/canonical", axes_length=0.6 * size, axes_radius=0.004 * size, origin_radius=0.0)
        scene.add_label("/canonical/front", "+x: front", position=(0.65 * size, 0.0, 0.0))
        self.controls = scene.add_transform_controls("/gripper", scale=0.7 * size, depth_test=False)
        self.controls.on_update(lambda _: self._dragged())
        self.server.initial_camera.position = tuple(2.3 * size * np.array([0.7, 0.9, 0.6]))
        self.server.initial_camera.look_at = (0.0, 0.0, 0.0)

    def _build_panel(self) -> None:
        gui, session = self.server.gui, self.session
        gui.add_markdown(f"### {session.category.name} with {session.gripper.name}\n{HELP}")
        self.chosen = gui.add_dropdown("grasp", session.names or ("none",))
        self.chosen.on_update(lambda _: self._later(lambda: self._choose(str(self.chosen.value))))
        self.status = gui.add_markdown("")
        self._button("centre between the pads", lambda: self._measured(session.centre, move=True), edits=True)
        low, high = (1e3 * value for value in session.gripper.opening)
        self.opening = gui.add_slider("opening on the way in [mm], 0 = auto", 0.0, high, 0.5, 0.0)
        self._on(
            self.opening, lambda value: self._measured(session.open_to, value / 1e3 if value > low else None)
        )
        self.name = gui.add_text("name", "")
        self._on(self.name, self._rename)
        self.label = gui.add_text("label", "")
        self._on(self.label, lambda value: session.describe(self._name(), label=value))
        self.approach = gui.add_slider("approach [mm]", 0.0, 300.0, 5.0, 100.0)
        self._on(self.approach, lambda value: self._describe(approach_distance=value / 1e3))
        self.confidence = gui.add_slider("confidence", 0.0, 1.0, 0.05, 1.0)
        self._on(self.confidence, lambda value: session.describe(self._name(), confidence=value))
        self.turns = gui.add_text("as good turned by [degrees]", "", hint="about an upright axis: -30, 0, 30")
        self._on(self.turns, lambda _: self._turn())
        self.axis = gui.add_text("axis at x, y [mm]", "0, 0")
        self._on(self.axis, lambda _: self._turn())
        self._button("new", lambda: self._new(None))
        self._button("copy", lambda: self._new(self._selected), edits=True)
        self._button("delete", self._delete, edits=True)
        self._button("save", self._save, color="green")

    def _button(self, text: str, action: Callable[[], None], *, edits: bool = False, **options: Any) -> None:
        """A button; `edits`: what it does is meant for the grasp chosen at the click."""

        def clicked(_):
            self._later(action, grasp=self._selected if edits else None)

        self.server.gui.add_button(text, **options).on_click(clicked)

    def _on(self, handle: Any, action: Callable[[Any], Any]) -> None:
        """Call `action` with the handle's value when a person changed it, not when a grasp was loaded."""

        def changed(_):
            if not self._loading and self._selected is not None:
                value = handle.value
                self._later(lambda: action(value), grasp=self._selected)

        handle.on_update(changed)

    def _name(self) -> str:
        if self._selected is None:
            raise SettingsError("there is no grasp yet", key="grasp", fix="Press `new`")
        return self._selected

    def _choose(self, name: str) -> None:
        if name in self.session.names and name != self._selected:
            self._select(name)

    def _select(self, name: str | None) -> None:
        """Show a grasp and fill the panel with it."""
        self._selected = name
        self._loading = True
        try:
            self.chosen.options = self.session.names or ("none",)
            self.controls.visible = name is not None
            if name is None:
                self.status.content = "There is no grasp yet: press **new**."
                return
            grasp = self.session.grasp(name)
            self.chosen.value = name
            self.name.value, self.label.value = grasp.name, grasp.label
            self.approach.value, self.confidence.value = 1e3 * grasp.approach_distance, grasp.confidence
            self.opening.value = 0.0 if grasp.opening is None else round(1e3 * grasp.opening, 1)
            turns = grasp.symmetry.turns() if grasp.symmetry is not None else ()
            self.turns.value = ", ".join(f"{turn:g}" for turn in turns)
            point = np.zeros(3) if grasp.symmetry is None else grasp.symmetry.point
            self.axis.value = f"{1e3 * point[0]:.1f}, {1e3 * point[1]:.1f}"
            self._place_controls()
        finally:
            self._loading = False
        self._show()

    def _place_controls(self) -> None:
        pose = self.session.grasp(self._name()).canonical_from_gripper
        self.controls.position, self.controls.wxyz = pose[:3, 3], np.array(quaternion_of(pose[:3, :3]))

    def _dragged(self) -> None:
        if self._loading or self._selected is None:
            return
        w, *xyz = (float(value) for value in self.controls.wxyz)
        rotation = Quaternion(w=w, xyz=(xyz[0], xyz[1], xyz[2])).matrix()
        pose = rigid(rotation, np.array(self.controls.position, dtype=float))
        self._later(lambda: self._measured(self.session.move, pose), grasp=self._selected, drag=True)

    def _measured(self, edit: Callable[..., Any], *arguments: Any, move: bool = False) -> None:
        edit(self._name(), *arguments)
        if move:
            self._loading = True
            self._place_controls()
            self._loading = False
        self._show()

    def _describe(self, **changes: Any) -> None:
        self.session.describe(self._name(), **changes)
        self._show()  # the approach is part of the check

    def _rename(self, new: str) -> None:
        self.session.rename(self._name(), new)
        self._select(new)

    def _turn(self) -> None:
        try:
            degrees = [float(part) for part in self.turns.value.replace(",", " ").split()]
            x, y = (float(part) / 1e3 for part in self.axis.value.replace(",", " ").split())
        except ValueError as error:
            raise SettingsError("must hold numbers", key="turns", value=self.turns.value) from error
        self.session.turn(self._name(), degrees, point=np.array([x, y, 0.0]))

    def _new(self, like: str | None) -> None:
        number = 1
        while f"grasp_{number}" in self.session.names:
            number += 1
        self._select(self.session.add(f"grasp_{number}", like=like).name)

    def _delete(self) -> None:
        self.session.remove(self._name())
        self._select(self.session.names[0] if self.session.names else None)

    def _save(self) -> None:
        path = self.session.save()
        self.status.content = f"Saved {len(self.session.names)} grasps to `{path}`."

    def _show(self) -> None:
        """Draw the gripper, opened as it arrives, and the contacts; say what the check says."""
        name = self._name()
        found, grasp = self.session.measure(name), self.session.grasp(name)
        colour = USABLE if found.usable else REFUSED
        pads = {pad.link for pad in self.session.gripper.pads}
        for link, mesh in self.session.gripper.link_meshes(found.opening, visual=True).items():
            self._draw_link(link, mesh, colour if link in pads else HAND)
        self._draw_contacts(found.contacts)
        width = "-" if found.width is None else f"{1e3 * found.width:.1f} mm"
        turned = "" if grasp.symmetry is None else f", {len(grasp.symmetry.turns())} turns"
        unseen = self.session.unseen
        self.status.content = (
            f"**{found.status.value}**: {found.reason}\n\nwidth {width}, arrives "
            f"{1e3 * found.opening:.1f} mm open{turned}"
            + ("\n\n*unsaved*" if self.session.unsaved else "")
            + (f"\n\n*made on another canonical model, still to see: {', '.join(unseen)}*" if unseen else "")
        )

    def _draw_link(self, link: str, mesh: trimesh.Trimesh, colour: tuple[int, int, int]) -> None:
        self.server.scene.add_mesh_simple(
            f"/gripper/{link}",
            np.asarray(mesh.vertices, np.float32),
            np.asarray(mesh.faces, np.uint32),
            color=colour,
            flat_shading=True,
            opacity=0.85,
        )

    def _draw_contacts(self, contacts: np.ndarray | None) -> None:
        for side in range(2):
            position = (0.0, 0.0, 0.0) if contacts is None else tuple(contacts[side])
            self.server.scene.add_icosphere(
                f"/contact_{side}",
                radius=0.002,
                color=CONTACT,
                position=position,
                visible=contacts is not None,
            )


@dataclass(frozen=True)
class _Asked:
    """What a person asked for, to be done at the next refresh.

    Args:
        action: what to do.
        grasp: for which it was asked, so that it is left undone once another is chosen; None: for any.
        drag: whether it is a move of the gripper, which a later one replaces.
    """

    action: Callable[[], Any]
    grasp: str | None
    drag: bool

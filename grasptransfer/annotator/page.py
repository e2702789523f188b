"""The annotator's page: a panel of controls beside the stage, and what a person asks for with them."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasptransfer.annotator.requests import Request, Requests
from grasptransfer.annotator.session import Session
from grasptransfer.annotator.stage import OPAQUE, SEE_THROUGH, Stage
from grasptransfer.annotator.trying import on_instances, on_latent, try_out
from grasptransfer.errors import GraspTransferError, SettingsError
from grasptransfer.frames import rigid

SLIDERS, FARTHEST = 3, 2.0  # modes of the shape space to slide along, standard deviations
HELP = (
    "Drag the arrows and rings: **blue** is the approach, **red** the closing direction. "
    "Contacts and width follow by closing the pads on the surface."
)


class Page:
    """One browser page on one session; every change of the scene happens in `refresh`."""

    def __init__(self, server: Any, session: Session):
        self.server, self.session = server, session
        self.stage = Stage(server, session.category, session.gripper)
        self.controls = self.stage.controls
        self.controls.on_update(lambda _: self._dragged())
        self.controls.on_drag_end(lambda _: self._later(session.end_of_move))
        self._selected: str | None = None
        self._requests = Requests()
        self._loading = False
        server.gui.add_markdown(f"### {session.category.name} with {session.gripper.name}\n{HELP}")
        self._build_grasp()
        self._build_place()
        self._build_trying()
        self._build_file()
        self._later(lambda: self._select(session.names[0] if session.names else None))
        self.refresh()

    def refresh(self) -> None:
        """Do what was asked for since the last time; a wrong request is answered in the panel."""
        for request in self._requests.taken():
            if request.grasp not in (None, self._selected):
                continue  # It was asked of another grasp.
            try:
                request.action()
            except GraspTransferError as error:
                self.status.content = f"**{error}**"

    def _later(self, action: Callable[[], Any], *, grasp: str | None = None, drag: bool = False) -> None:
        self._requests.add(Request(action, grasp, drag))

    def _build_grasp(self) -> None:
        gui, session = self.server.gui, self.session
        self.chosen = gui.add_dropdown("grasp", session.names or ("none",))
        self.chosen.on_update(lambda _: self._later(lambda: self._choose(str(self.chosen.value))))
        self.status = gui.add_markdown("")
        self.name = gui.add_text("name", "")
        self._on(self.name, self._rename)
        self.label = gui.add_text("label", "")
        self._on(self.label, lambda value: self._describe(label=value))
        self.confidence = gui.add_slider("confidence", 0.0, 1.0, 0.05, 1.0)
        self._on(self.confidence, lambda value: self._describe(confidence=value))

    def _build_place(self) -> None:
        gui, session = self.server.gui, self.session
        with gui.add_folder("place"):
            self.position = gui.add_vector3("x, y, z [mm]", (0.0, 0.0, 0.0), step=0.1)
            self.angles = gui.add_vector3(
                "turn [degrees]", (0.0, 0.0, 0.0), step=0.1, hint="about x, then y, then z of the model"
            )
            for numbers in (self.position, self.angles):
                self._on(numbers, lambda _: self._typed())
            self._button("centre between the pads", lambda: self._moved(session.centre), edits=True)
            low, high = (1e3 * value for value in session.gripper.opening)
            self.opening = gui.add_slider("opening on the way in [mm], 0 = auto", 0.0, high, 0.5, 0.0)
            self._on(
                self.opening,
                lambda value: self._measured(session.open_to, value / 1e3 if value > low else None),
            )
            self.approach = gui.add_slider("approach [mm]", 0.0, 300.0, 5.0, 100.0)
            self._on(self.approach, lambda value: self._describe(approach_distance=value / 1e3))
            self.turns = gui.add_text(
                "as good turned by [degrees]", "", hint="about an upright axis: -30, 0, 30"
            )
            self._on(self.turns, lambda _: self._turn())
            self.axis = gui.add_text("axis at x, y [mm]", "0, 0")
            self._on(self.axis, lambda _: self._turn())

    def _build_trying(self) -> None:
        gui = self.server.gui
        with gui.add_folder("try"):
            self.see_through = gui.add_checkbox("see-through hand", False)
            self.see_through.on_update(lambda _: self._later(self._fade))
            self._button("execute on this model", self._execute, edits=True)
            self.film = gui.add_html("")
            self._button("show on six instances", self._on_instances, edits=True)
            self.modes = [
                gui.add_slider(f"shape, mode {mode + 1}", -FARTHEST, FARTHEST, 0.1, 0.0)
                for mode in range(min(SLIDERS, self.session.category.settings.modes))
            ]
            for slider in self.modes:
                self._on(slider, lambda _: self._on_latent())

    def _build_file(self) -> None:
        self._button("new", lambda: self._new(None))
        self._button("copy", lambda: self._new(self._selected), edits=True)
        self._button("delete", self._delete, edits=True)
        self._button("undo", self._undo)
        self.refused = self.server.gui.add_checkbox("save refused grasps, too", False)
        self._button("save", self._save, color="green")

    def _button(self, text: str, action: Callable[[], None], *, edits: bool = False, **options: Any) -> None:
        """A button; with `edits` its action is meant for the grasp that is chosen at the click."""

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
            self._fill(name)
        finally:
            self._loading = False
        self._show()

    def _fill(self, name: str) -> None:
        grasp = self.session.grasp(name)
        self.chosen.value = name
        self.name.value, self.label.value = grasp.name, grasp.label
        self.approach.value, self.confidence.value = 1e3 * grasp.approach_distance, grasp.confidence
        self.opening.value = 0.0 if grasp.opening is None else round(1e3 * grasp.opening, 1)
        turns = grasp.symmetry.turns() if grasp.symmetry is not None else ()
        self.turns.value = ", ".join(f"{turn:g}" for turn in turns)
        point = np.zeros(3) if grasp.symmetry is None else grasp.symmetry.point
        self.axis.value = f"{1e3 * point[0]:.1f}, {1e3 * point[1]:.1f}"
        self.stage.place(grasp.canonical_from_gripper)
        self._fill_numbers()

    def _fill_numbers(self) -> None:
        pose = self.session.grasp(self._name()).canonical_from_gripper
        x, y, z = (round(1e3 * float(value), 2) for value in pose[:3, 3])
        self.position.value = (x, y, z)
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
        a, b, c = (round(float(angle), 2) for angle in angles)
        self.angles.value = (a, b, c)

    def _dragged(self) -> None:
        if self._loading or self._selected is None:
            return
        pose = self.stage.pose
        self._later(lambda: self._measured(self.session.move, pose), grasp=self._selected, drag=True)

    def _typed(self) -> None:
        rotation = Rotation.from_euler("xyz", self.angles.value, degrees=True).as_matrix()
        pose = rigid(rotation, np.array(self.position.value) / 1e3)
        self._moved(lambda name: self.session.move(name, pose))

    def _moved(self, edit: Callable[[str], Any]) -> None:
        """Edit where the grasp is, and let arrows and rings follow."""
        self.session.end_of_move()
        edit(self._name())
        self._select(self._name())

    def _measured(self, edit: Callable[..., Any], *arguments: Any) -> None:
        edit(self._name(), *arguments)
        self._loading = True
        self._fill_numbers()
        self._loading = False
        self._show()

    def _describe(self, **changes: Any) -> None:
        self.session.describe(self._name(), **changes)
        self._show()  # The approach is part of the check.

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

    def _fade(self) -> None:
        self.stage.opacity = SEE_THROUGH if self.see_through.value else OPAQUE
        self._show()

    def _execute(self) -> None:
        from grasptransfer.drawing.rendering import Renderer
        from grasptransfer.drawing.studio import Studio
        from grasptransfer.report.embedded import gif_uri
        from grasptransfer.report.movie import movie, seconds_per_frame

        trial = try_out(self.session, self._name())
        with Renderer() as renderer:
            frames = movie(trial, self.session.category.canonical, self.session.gripper, Studio(renderer))
        uri = gif_uri(frames, seconds_per_frame=seconds_per_frame(trial)) if frames else ""
        self.film.content = f'<img alt="film of the trial" style="width: 100%" src="{uri}">' if uri else ""
        self.status.content = f"**{trial.status.value}** ({trial.protocol}): {trial.detail or trial.phase}"

    def _on_instances(self) -> None:
        shapes = on_instances(self.session, self._name())
        self.stage.show_beside(shapes)
        usable = sum(shape.check.usable for shape in shapes)
        reasons = "; ".join(sorted({shape.check.reason for shape in shapes if not shape.check.usable}))
        self.status.content = f"usable on **{usable} of {len(shapes)}** instances. {reasons}"

    def _on_latent(self) -> None:
        shape = on_latent(self.session, self._name(), [float(slider.value) for slider in self.modes])
        self.stage.show_beside([shape])
        self.status.content = f"on this shape: **{shape.check.status.value}**: {shape.check.reason}"

    def _new(self, like: str | None) -> None:
        number = 1
        while f"grasp_{number}" in self.session.names:
            number += 1
        self._select(self.session.add(f"grasp_{number}", like=like).name)

    def _delete(self) -> None:
        self.session.remove(self._name())
        self._select(self.session.names[0] if self.session.names else None)

    def _undo(self) -> None:
        self.session.undo()
        names = self.session.names
        self._select(self._selected if self._selected in names else (names[0] if names else None))

    def _save(self) -> None:
        path = self.session.save(refused=bool(self.refused.value))
        self.status.content = f"Saved {len(self.session.names)} grasps to `{path}`."

    def _show(self) -> None:
        """Draw the gripper and the contacts, and say what the check says."""
        name = self._name()
        found, grasp = self.session.measure(name), self.session.grasp(name)
        self.stage.show(found)
        width = "-" if found.width is None else f"{1e3 * found.width:.1f} mm"
        turned = "" if grasp.symmetry is None else f", {len(grasp.symmetry.turns())} turns"
        unseen = self.session.unseen
        self.status.content = (
            f"**{found.status.value}**: {found.reason.removeprefix('free; ')}\n\nwidth {width}, arrives "
            f"{1e3 * found.opening:.1f} mm open{turned}"
            + ("\n\n*unsaved*" if self.session.unsaved else "")
            + (f"\n\n*made on another canonical model, still to see: {', '.join(unseen)}*" if unseen else "")
        )

"""The panels of the page: view options, objects, health of the stages, and buttons."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from spot3d.dashboard.scene import Shown, object_text
from spot3d.drawing.picture import object_colour
from spot3d_schemas import Object3D

EVERY = "all, in one world"
_ROWS = 40
"""Most objects in the table."""
_SHADE = 0.45
"""Brightness of an object's colour at which white text on it is legible."""

Client = viser.ClientHandle | None


@dataclass(frozen=True, slots=True)
class Actions:
    """Callbacks of the buttons; each gets the browser in which the button was pressed."""

    choose: Callable[[Client, str, int], None]
    look: Callable[[Client], None]
    save: Callable[[Client, str], None]
    reset: Callable[[Client], None]


class _Text:
    """A text on the page that is sent only when it changes."""

    def __init__(self, handle: viser.GuiMarkdownHandle | viser.GuiHtmlHandle) -> None:
        self._handle = handle
        self._said = ""

    def say(self, text: str) -> None:
        """Show this text."""
        if text != self._said:
            self._said = text
            self._handle.content = text
            self._handle.visible = bool(text)


class Panel:
    """The controls. All browsers share them; each browser has only its own view of the 3D scene."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._actions = actions
        self._chosen: tuple[str, int] | None = None
        self._listed: tuple[Sequence[tuple[str, Object3D]], int, bool] = (), 0, False
        self._rows: list[tuple[viser.GuiButtonHandle, str]] = []
        self._places: list[tuple[str, int]] = []
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("spot3d")
        self.waiting = _Text(gui.add_markdown(""))
        self.summary = _Text(gui.add_markdown(""))
        # Typed as Any, as mypy does not find the setter of its value.
        self._robot: Any = gui.add_dropdown("Robot", [""], visible=False)
        with gui.add_folder("Health"):
            self.health = _Text(gui.add_html(""))
        with gui.add_folder("Objects"):
            self._confidence = gui.add_slider("Confidence from", 0.0, 1.0, 0.01, 0.0)
            self.objects = _Text(gui.add_markdown(""))
            self._table = gui.add_folder("Number, size, confidence")
        self._gui = gui
        with gui.add_folder("View"):
            self._paused = gui.add_checkbox("Pause", False, hint="freezes the page, not the robot")
            self._points = gui.add_dropdown("Points", ["colour", "heat"])
            self._heat = gui.add_checkbox("Heat over the image", False)
            self._parts = {
                name: gui.add_checkbox(name, True) for name in ("Boxes", "Labels", "Planes", "Path", "Camera")
            }
            look = gui.add_button("Look at everything")
            look.on_click(lambda event: actions.look(event.client))
        with gui.add_folder("Save and reset"):
            save = gui.add_button_group("Save", ["objects.json", "heatmap.ply", "view.png"])
            save.on_click(lambda event: actions.save(event.client, save.value))
            reset = gui.add_button("Reset the map ...", color="red", hint="asks for confirmation")
            reset.on_click(lambda event: self._ask_reset(event.client))
        with gui.add_folder("Latency", expand_by_default=False):
            self.latency = _Text(gui.add_html(""))
        with gui.add_folder("Dropped", expand_by_default=False):
            self.drops = _Text(gui.add_html(""))
        camera = gui.add_panel()
        with camera.add_tab("Camera"):
            self._picture = gui.add_image(np.zeros((1, 1, 3), np.uint8), format="jpeg", jpeg_quality=75, visible=False)
        camera.dock_left()
        camera.set_width(400)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(390)

    @property
    def paused(self) -> bool:
        """Whether the page is paused."""
        return bool(self._paused.value)

    @property
    def heat_over_picture(self) -> bool:
        """Whether heat is overlaid on the camera's picture."""
        return bool(self._heat.value)

    @property
    def shown(self) -> Shown:
        """What is to be shown in the scene."""
        there = {name.lower(): bool(box.value) for name, box in self._parts.items()}
        return Shown(
            heat=self._points.value == "heat", confidence=float(self._confidence.value), chosen=self._chosen, **there
        )

    def choose(self, robot: str, number: int) -> None:
        """Mark this object when the table is shown next."""
        self._chosen = (robot, number)

    def mark(self) -> None:
        """Show the table again, with the object that is chosen now."""
        self.list_objects(*self._listed)

    def robots(self, names: Sequence[str], first: str | None = None) -> list[str]:
        """Offer these robots; returns those that are chosen. first: the one to begin with, if it is among them."""
        options = tuple([*names, EVERY] if len(names) > 1 else names)
        if options and self._robot.options != options:
            before = self._robot.value
            self._robot.options = options
            if before not in options:
                before = first if first in options else options[0]
            self._robot.value = before
            self._robot.visible = True
        if self._robot.value == EVERY:
            return list(names)
        return [name for name in names if name == self._robot.value]

    def show_picture(self, picture: NDArray[np.uint8] | None) -> None:
        """Show the camera's picture; None hides it."""
        if picture is not None:
            self._picture.image = picture
        if self._picture.visible != (picture is not None):
            self._picture.visible = picture is not None

    def list_objects(self, found: Sequence[tuple[str, Object3D]], of: int, several: bool) -> None:
        """The table: robot and object of each row; of: how many objects there are; several: name the robots."""
        self._listed = found, of, several
        shown = found[:_ROWS]
        more = f"; the first {_ROWS} are listed" if len(found) > _ROWS else ""
        self.objects.say(f"{len(found)} of {of}{more}. A click flies to the object." if of else "none yet")
        self._places = [(robot, item.id) for robot, item in shown]
        with self._table:
            while len(self._rows) < len(shown):
                self._rows.append((self._row(len(self._rows)), ""))
        for index, (button, said) in enumerate(self._rows):
            if index >= len(shown):
                if said:
                    button.visible = False
                    self._rows[index] = (button, "")
                continue
            robot, item = shown[index]
            marked = "> " if (robot, item.id) == self._chosen else ""
            text = marked + (f"{robot}: " if several else "") + object_text(item)
            if text != said:
                red, green, blue = (round(_SHADE * part) for part in object_colour(item.id))
                button.label, button.color, button.visible = text, (red, green, blue), True
                self._rows[index] = (button, text)

    def _row(self, index: int) -> viser.GuiButtonHandle:
        button = self._gui.add_button("", visible=False)

        def clicked(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            if index < len(self._places):
                self._actions.choose(event.client, *self._places[index])

        button.on_click(clicked)
        return button

    def _ask_reset(self, client: Client) -> None:
        """Ask in the browser where the button was pressed, and only there."""
        if client is None:
            return
        modal = client.gui.add_modal("Reset the map?")
        with modal:
            client.gui.add_markdown("Fusion deletes the map and all objects, for all users. This cannot be undone.")
            sure = client.gui.add_button("Reset", color="red")
            no = client.gui.add_button("Cancel")

        def answered(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            modal.close()
            if event.target is sure:
                self._actions.reset(client)

        sure.on_click(answered)
        no.on_click(answered)

"""The page of a run: list of walks, player, flags."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import viser

from ..formats.core.flags import FlagFile
from ..formats.scene.bundle import load_bundle
from .library import ALL, ORDERS, Choice, Entry, chosen, flagged_in, sheet, table_html
from .player import Player
from .scene import Detail, SceneNodes, add_scene

NOTHING = "none"
AISLE_M = 1.0  # between two copies of a scene


class RunBrowser:
    """A run on a server."""

    def __init__(
        self,
        server: viser.ViserServer,
        entries: Sequence[Entry],
        scenes: Path,
        detail: Detail | None = None,
    ):
        """Add the page's controls; `show` a walk then.

        Args:
            server: Where to.
            entries: At least one.
            scenes: Folder of repaired scenes.
            detail: Of its scenes in the browser.
        """
        self.server, self.entries = server, list(entries)
        self._scenes, self._detail = scenes, detail
        self._flagged = flagged_in(self.entries)
        self._choice, self._shown = Choice(), self.entries
        self._scene, self._nodes = "", list[SceneNodes]()
        self._level = 0
        self.current = self.entries[0]
        gui = server.gui
        gui.main_panel.dock_right()
        tabs = gui.add_tab_group()
        with tabs.add_tab("Walk"):
            self._pick = gui.add_dropdown("Walk", [e.name for e in self.entries])
            self._pick.on_update(self._on_pick)
            self.player = Player(server, self.next, self._on_level)
            self._flag = gui.add_checkbox("Flagged", False, hint="export --without-flagged")
            self._note = gui.add_text("Note", "")
            self._flag.on_update(self._on_flag)
            self._note.on_update(self._on_flag)
            self._ghost = gui.add_dropdown("Compare with", [str(NOTHING)])
            self._beside = gui.add_checkbox("Side by side", False)
            self._ghost.on_update(self._on_ghost)
            self._beside.on_update(self._on_ghost)
            self._ceiling = gui.add_checkbox("Ceilings", False)
            self._ceiling.on_update(lambda _: self._show_level(self._ceiling.value))
        with tabs.add_tab("Walks"):
            self._filters()
            self._table = gui.add_html("")
        with tabs.add_tab("Sheet"):
            again = gui.add_button("Show first and last pictures")
            self._sheet = gui.add_image(sheet([]), visible=False)
            again.on_click(lambda _: self._draw_sheet())
        command = gui.add_command("Flag this walk", hotkey="F")
        command.on_trigger(lambda _: self._toggle_flag())

    def _filters(self) -> None:
        gui = self.server.gui

        def dropdown(label: str, key: str, values: Sequence[str]) -> None:
            handle = gui.add_dropdown(label, tuple(values))
            handle.on_update(lambda _: self._filter(**{key: handle.value}))

        for label, key in (("Robot", "robot"), ("Controller", "controller"), ("End", "outcome")):
            dropdown(label, key, (ALL, *sorted({getattr(e, key) for e in self.entries})))
        longest = float(np.ceil(max(1.0, *(e.length_m for e in self.entries))))
        length = gui.add_multi_slider("Length [m]", 0.0, longest, 0.1, (0.0, longest))
        length.on_update(lambda _: self._filter(length_m=tuple(length.value)))
        for label, key in (("Touched something", "touched"), ("Flagged only", "flagged")):
            box = gui.add_checkbox(label, False)
            box.on_update(lambda _, box=box, key=key: self._filter(**{key: box.value}))
        dropdown("Order", "order", ORDERS)

    def _filter(self, **changes: Any) -> None:
        self._choice = replace(self._choice, **changes)
        self._shown = chosen(self.entries, self._choice, self._flagged)
        if self._shown:
            # The one that is looked at stays, even where the filter leaves it out.
            names = [e.name for e in self._shown]
            if self.current.name not in names:
                names.insert(0, self.current.name)
            self._pick.options = names
        self._table.content = table_html(self._shown, self._flagged, self.current.name)

    def _on_pick(self, event: Any) -> None:
        if event.client is not None and self._pick.value != self.current.name:
            self.show(next(e for e in self.entries if e.name == self._pick.value))

    def next(self, direction: int) -> None:
        """Show the next or previous walk of the list."""
        names = [e.name for e in self._shown]
        if not names:
            return
        at = names.index(self.current.name) if self.current.name in names else -1
        self.show(self._shown[(at + direction) % len(names)])

    def show(self, entry: Entry, others: Sequence[Entry] = ()) -> None:
        """Show a walk in its scene, with others of its path as ghosts or side by side."""
        self.current = entry
        bundle = load_bundle(self._scenes / entry.scene)
        if self._scene != entry.scene:
            self.server.scene.remove_by_name("/scene")
            self._nodes = [add_scene(self.server.scene, bundle, detail=self._detail)]
            self._scene = entry.scene
        self.server.scene.remove_by_name("/beside")
        del self._nodes[1:]
        apart_m = 0.0
        if others and self._beside.value:
            apart_m = self._nodes[0].width_m + AISLE_M
            self.server.scene.add_frame("/beside", show_axes=False, position=(apart_m, 0, 0))
            copy = add_scene(self.server.scene, bundle, "/beside/scene", self._detail)
            self._nodes.append(copy)
        walk = entry.load()
        alike = [e.name for e in self.entries if e.path == entry.path and e is not entry]
        self._ghost.options = (NOTHING, *alike)
        if not others:
            self._ghost.value = NOTHING
        self._pick.value = entry.name
        self._flag.value = entry.name in self._flagged
        self._note.value = self._flagged.get(entry.name, "")
        self._table.content = table_html(self._shown, self._flagged, entry.name)
        self.player.show(walk, [other.load() for other in others], apart_m)

    def _on_level(self, level: int) -> None:
        self._level = level
        self._show_level(self._ceiling.value)

    def _show_level(self, ceiling: bool) -> None:
        for nodes in self._nodes:
            nodes.show(self._level, ceiling=ceiling)

    def _on_ghost(self, event: Any) -> None:
        if event.client is not None:
            others = [e for e in self.entries if e.name == self._ghost.value]
            self.show(self.current, others)

    def _on_flag(self, event: Any) -> None:
        if event.client is not None:
            self._write_flag()

    def _toggle_flag(self) -> None:
        self._flag.value = not self._flag.value
        self._write_flag()

    def _write_flag(self) -> None:
        entry = self.current
        FlagFile(entry.folder).set(entry.item, self._flag.value, self._note.value)
        self._flagged = flagged_in(self.entries)
        self._table.content = table_html(self._shown, self._flagged, entry.name)

    def _draw_sheet(self) -> None:
        self._sheet.image = sheet(self._shown)
        self._sheet.visible = True

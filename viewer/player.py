"""Play one walk, and others beside it or as ghosts: robots, cameras, contacts, time line."""

import html
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from ..formats.core.arrays import Array
from ..formats.core.rollout import STATE_RATE_HZ
from .marks import add_marks, add_name, add_track
from .panel import AXES, SCALES, SERIES, curve_data, events_html, padded, text_html
from .robot import RobotNodes
from .walk import Walk

TICK_S = 1 / 30
STEP = 25  # samples: a discrete action of VLN-PE
SAID = 20  # samples between what the panel says, and the slider shows, while playing
CONTACT = (230, 30, 30)
GHOSTS = ((150, 90, 255), (30, 170, 110), (240, 120, 40))
FRUSTUM_M = 0.35
PICTURE_PX = 256  # smaller ones are enlarged
SPEEDS = ("0.25×", "0.5×", "1×", "2×", "4×")


class Player:
    """One walk on a server, with the controls of its time."""

    def __init__(
        self,
        server: viser.ViserServer,
        on_next: Callable[[int], None] | None = None,
        on_level: Callable[[int], None] | None = None,
    ):
        """Add the controls to the current container of the server's panel.

        Args:
            server: Where to.
            on_next: Called with +1 or −1 for the next or previous walk.
            on_level: Called with the level that the robot is on, when it changes.
        """
        self.server = server
        self.walk: Walk | None = None
        self.sample, self.playing = 0, False
        self._speed, self._follow = 1.0, True
        self._lock = threading.RLock()
        self._nodes: list[Any] = []
        self._robots: list[tuple[Walk, RobotNodes]] = []
        self._part, self._shot, self._said = -1, -1, 0
        self._level, self._on_level = -1, on_level
        self._add_controls(on_next)
        threading.Thread(target=self._tick, daemon=True).start()

    def _add_controls(self, on_next: Callable[[int], None] | None) -> None:
        gui = self.server.gui
        self._text = gui.add_html("")
        self._time = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0)
        self._time.on_update(lambda event: self._on_time(event))
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._play.on_click(lambda _: self.toggle())
        steps = gui.add_button_group("Step", ("◀◀", "◀", "▶", "▶▶"), hint="0.25 s, or an event")
        steps.on_click(lambda event: self._on_step(event.target.value))
        speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1×")
        follow = gui.add_checkbox("Follow the robot", True)

        def on_speed(_: Any) -> None:
            self._speed = float(speed.value[:-1])

        def on_follow(_: Any) -> None:
            self._follow = follow.value

        speed.on_update(on_speed)
        follow.on_update(on_follow)
        self._status = gui.add_html("")
        self._picture = gui.add_image(np.zeros((8, 8, 3), np.uint8), visible=False)
        self._curves = gui.add_uplot(
            curve_data(None), series=SERIES, axes=AXES, scales=SCALES, height=130
        )
        self._events = gui.add_html("")
        keys: list[tuple[str, Any, Callable[[], None]]] = [
            ("Play or pause", "space", self.toggle),
            ("Step back", "arrowleft", lambda: self.step(-STEP)),
            ("Step", "arrowright", lambda: self.step(STEP)),
            ("Event before", "B", lambda: self._to_event(-1)),
            ("Next event", "E", lambda: self._to_event(1)),
        ]
        if on_next is not None:
            keys += [
                ("Next walk", "N", lambda: on_next(1)),
                ("Previous walk", "P", lambda: on_next(-1)),
            ]
        for label, key, call in keys:
            command = gui.add_command(label, hotkey=key)
            command.on_trigger(lambda _, call=call: call())

    def show(self, walk: Walk, others: Sequence[Walk] = (), apart_m: float = 0.0) -> None:
        """Show a walk from its start, with other walks of the same path.

        Args:
            others: Shown as ghosts, or each `apart_m` along x from the one before.
        """
        with self._lock, self.server.atomic():
            self.playing = False
            for node in (*(robot for _, robot in self._robots), *self._nodes):
                node.remove()
            self.walk, self.sample = walk, 0
            self._part, self._shot, self._said, self._level = -1, -1, 0, -1
            self._robots = [(walk, RobotNodes(self.server, walk.model, "/robot"))]
            self._nodes = add_marks(self.server.scene, "/path", walk)
            for k, other in enumerate(others):
                self._add_other(f"/other/{k}", other, GHOSTS[k % len(GHOSTS)], apart_m * (k + 1))
            if apart_m:
                self._nodes.append(add_name(self.server.scene, "/path/name", walk))
            self._feet = [
                self.server.scene.add_icosphere(
                    f"/feet/{foot}", 0.03, subdivisions=1, color=CONTACT, visible=False
                )
                for foot in walk.rollout.foot_names
            ]
            self._nodes += self._feet
            self._frustum = self._add_frustum(walk)
            self._time.max = max(0.01, float(walk.rollout.time_s[-1]))
            self._curves.data = curve_data(walk)
            self._events.content = events_html(walk)
            self._picture.visible = walk.shots is not None
            self._play.label = "Play"
        self.go_to(0)
        self._look(apart_m * len(others))

    def _add_other(self, root: str, walk: Walk, color: tuple[int, int, int], x_m: float) -> None:
        """Add another walk as a ghost or, where it has a place of its own, as the first one is."""
        scene = self.server.scene
        frame = scene.add_frame(root, show_axes=False, position=(x_m, 0, 0))
        looks: dict[str, Any] = {} if x_m else {"color": color, "opacity": 0.45}
        self._robots.append((walk, RobotNodes(self.server, walk.model, f"{root}/robot", **looks)))
        if x_m:
            self._nodes += [*add_marks(scene, root, walk), add_name(scene, f"{root}/name", walk)]
        else:
            self._nodes.append(add_track(scene, f"{root}/walked", walk, color))
        self._nodes.append(frame)

    def _add_frustum(self, walk: Walk) -> Any:
        if walk.shots is None:
            return None
        camera = walk.shots.camera
        aspect = camera.width_px / camera.height_px
        vertical = 2 * np.arctan(camera.height_px / (2 * camera.focal_px))
        node = self.server.scene.add_camera_frustum(
            "/camera",
            float(vertical),
            aspect,
            scale=FRUSTUM_M,
            thickness=0.008,
            cast_shadow=False,
            receive_shadow=False,
        )
        self._nodes.append(node)
        return node

    def _look(self, width_m: float) -> None:
        """Look at the robot from behind and above, or at robots side by side from far."""
        assert self.walk is not None
        at, yaw = self.walk.rollout.position_world_m[0], self.walk.rollout.episode.start_yaw_rad
        away = np.array([-1.3 * np.cos(yaw), -1.3 * np.sin(yaw), 3.2])  # over the walls
        if width_m:
            at, away = at + np.array([width_m / 2, 0, 0]), width_m * np.array([0, -0.5, 0.9])
        self.server.initial_camera.position = tuple(at + away)
        self.server.initial_camera.look_at = tuple(at)
        for client in self.server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = at + away, at

    def toggle(self) -> None:
        """Play, or pause; at the end play from the start."""
        with self._lock:
            if self.walk is None:
                return
            if self.sample >= len(self.walk) - 1:
                self.go_to(0)
            self.playing = not self.playing
            self._play.label = "Pause" if self.playing else "Play"

    def pause(self) -> None:
        """Stop playing."""
        with self._lock:
            self.playing = False
            self._play.label = "Play"
            if self.walk is not None:
                self._say(self.walk)

    def step(self, samples: int) -> None:
        """Go some samples on, or back."""
        with self._lock:
            self.pause()
            self.go_to(self.sample + samples)

    def _on_step(self, label: str) -> None:
        if len(label) == 1:
            self.step(STEP if label == "▶" else -STEP)
        else:
            self._to_event(1 if label == "▶▶" else -1)

    def _to_event(self, direction: int) -> None:
        if self.walk is None:
            return
        samples = [round(e.time_s * STATE_RATE_HZ) for e in self.walk.rollout.events]
        samples = [0, *samples, len(self.walk) - 1]
        further = [s for s in samples if (s - self.sample) * direction > 0]
        if further:
            self.step((min(further) if direction > 0 else max(further)) - self.sample)

    def _on_time(self, event: Any) -> None:
        if event.client is not None:  # moved by a person, not by playing
            self.step(round(self._time.value * STATE_RATE_HZ) - self.sample)

    def go_to(self, sample: int) -> None:
        """Show a sample of the walk."""
        with self._lock, self.server.atomic():
            walk = self.walk
            if walk is None:
                return
            before = walk.rollout.position_world_m[self.sample]
            self.sample = int(np.clip(sample, 0, len(walk) - 1))
            for shown, robot in self._robots:
                k = min(self.sample, len(shown) - 1)
                position, rotation, _ = shown.poses
                robot.place(position[k], rotation[k])
            self._show_feet(walk)
            self._show_shot(walk)
            self._show_words(walk)
            if self._on_level and walk.levels[self.sample] != self._level:
                self._level = int(walk.levels[self.sample])
                self._on_level(self._level)
            if not self.playing or abs(self.sample - self._said) >= SAID:
                self._say(walk)
            if self._follow:
                self._carry(walk.rollout.position_world_m[self.sample] - before)

    def _say(self, walk: Walk) -> None:
        self._said = self.sample
        self._time.value = float(walk.rollout.time_s[self.sample])
        self._status.content = padded(html.escape(walk.chosen(self.sample)))

    def _carry(self, moved: Array) -> None:
        """Move everyone's camera with the robot."""
        if not moved.any():
            return
        for client in self.server.get_clients().values():
            camera = client.camera
            with client.atomic():
                position, look_at = camera.position + moved, camera.look_at + moved
                camera.position, camera.look_at = position, look_at

    def _show_feet(self, walk: Walk) -> None:
        feet = walk.poses[2][self.sample]
        touches = walk.rollout.foot_contact[self.sample] & np.isfinite(feet).all(axis=1)
        for node, at, touching in zip(self._feet, feet, touches.tolist(), strict=True):
            node.visible = touching
            if touching:
                node.position = at

    def _show_shot(self, walk: Walk) -> None:
        if walk.shots is None or self._frustum is None:
            return
        shot = walk.shots.at(self.sample)
        if shot != self._shot:
            self._shot = shot
            picture = walk.shots.picture(shot)
            small = max(1, PICTURE_PX // picture.shape[1])
            self._picture.image = picture.repeat(small, axis=0).repeat(small, axis=1)
            self._frustum.image = picture
            self._frustum.position = walk.shots.position_world_m[shot]
            self._frustum.wxyz = walk.shots.quat_wxyz[shot]

    def _show_words(self, walk: Walk) -> None:
        since = walk.parts[1]
        time_s = float(walk.rollout.time_s[self.sample])
        part = max(0, int(np.searchsorted(since, time_s + 1e-9, side="right")) - 1)
        if part != self._part:
            self._part = part
            self._text.content = text_html(walk, part)

    def _tick(self) -> None:
        last = due = time.monotonic()
        at = 0.0
        while True:
            due = max(due + TICK_S, last)  # what is late is not caught up with
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            passed, last = now - last, now
            with self._lock:
                if not self.playing or self.walk is None:
                    at = float(self.sample)
                    continue
                # Slower browsers skip samples rather than fall behind.
                at = max(at, self.sample) + passed * self._speed * STATE_RATE_HZ
                self.go_to(round(at))
                if self.sample >= len(self.walk) - 1:
                    self.pause()

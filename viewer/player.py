"""Play one walk: robot, paths, camera, contacts, text, time line, curves, ghosts."""

import html
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from ..formats.core.arrays import Array
from ..formats.core.rollout import REST_EVENT, STATE_RATE_HZ
from .panel import AXES, SCALES, SERIES, curve_data, events_html, padded, text_html
from .robot import RobotNodes
from .walk import Walk

TICK_S = 1 / 30
STEP = 25  # samples: a discrete action of VLN-PE
REFERENCE, WALKED, CONTACT = (255, 170, 0), (0, 120, 255), (230, 30, 30)
GHOSTS = ((150, 90, 255), (30, 170, 110), (240, 120, 40))
ABOVE_M = np.array([0, 0, 0.03])
UP_M = np.array([0, 0, 0.5])
FRUSTUM_M = 0.35
APART_M = 0.8  # of labels of events
PICTURE_PX = 256  # smaller ones are enlarged
SPEEDS = ("0.25×", "0.5×", "1×", "2×", "4×")


class Player:
    """One walk on a server, with the controls of its time."""

    def __init__(self, server: viser.ViserServer, on_next: Callable[[int], None] | None = None):
        """Add the controls to the current container of the server's panel.

        Args:
            server: Where to.
            on_next: Called with +1 or −1 for the next or previous walk.
        """
        self.server = server
        self.walk: Walk | None = None
        self.sample, self.playing = 0, False
        self._speed, self._follow = 1.0, True
        self._lock = threading.RLock()
        self._nodes: list[Any] = []
        self._robots: list[tuple[Walk, RobotNodes]] = []
        self._part, self._shot, self._chosen = -1, -1, ""
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

    def show(self, walk: Walk, ghosts: Sequence[Walk] = ()) -> None:
        """Show a walk from its start, with other walks of the same path as ghosts."""
        with self._lock, self.server.atomic():
            self.playing = False
            for node in self._nodes:
                node.remove()
            for _, robot in self._robots:
                robot.remove()
            self.walk, self.sample = walk, 0
            self._part, self._shot, self._chosen = -1, -1, ""
            self._robots = [(walk, RobotNodes(self.server, walk.model, "/robot"))]
            for k, ghost in enumerate(ghosts):
                color = GHOSTS[k % len(GHOSTS)]
                nodes = RobotNodes(
                    self.server, ghost.model, f"/ghost/{k}", color=color, opacity=0.45
                )
                self._robots.append((ghost, nodes))
            self._nodes = self._add_lines(walk, ghosts)
            self._frustum = self._add_frustum(walk)
            self._time.max = max(0.01, float(walk.rollout.time_s[-1]))
            self._curves.data = curve_data(walk)
            self._events.content = events_html(walk)
            self._picture.visible = walk.shots is not None
            self._play.label = "Play"
        self.go_to(0)
        self._look()

    def _add_lines(self, walk: Walk, ghosts: Sequence[Walk]) -> list[Any]:
        scene, rollout = self.server.scene, walk.rollout
        nodes = [
            _line(scene, "/path/reference", rollout.episode.reference_path_world_m, REFERENCE),
            _line(scene, "/path/walked", _ground(walk), WALKED),
        ]
        for k, ghost in enumerate(ghosts):
            color = GHOSTS[k % len(GHOSTS)]
            nodes.append(_line(scene, f"/path/ghost{k}", _ground(ghost), color))
        goal = rollout.episode.goal_position_world_m
        nodes.append(
            scene.add_icosphere("/path/goal", 0.08, color=(20, 160, 60), position=tuple(goal))
        )
        for k, (at, text) in enumerate(_places(walk)):
            nodes.append(scene.add_label(f"/events/{k}", text, position=tuple(at + UP_M)))
        self._feet = [
            scene.add_icosphere(f"/feet/{foot}", 0.03, color=CONTACT, visible=False)
            for foot in rollout.foot_names
        ]
        return [*nodes, *self._feet]

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

    def _look(self) -> None:
        """Look at the robot from behind and above."""
        assert self.walk is not None
        at, yaw = self.walk.rollout.position_world_m[0], self.walk.rollout.episode.start_yaw_rad
        away = np.array([-1.3 * np.cos(yaw), -1.3 * np.sin(yaw), 3.2])  # over the walls
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
            self._time.value = float(walk.rollout.time_s[self.sample])
            if self._follow:
                self._carry(walk.rollout.position_world_m[self.sample] - before)

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
        chosen = walk.chosen(self.sample)
        if chosen != self._chosen and (self.sample % 5 == 0 or walk.rollout.actions):
            self._chosen = chosen
            self._status.content = padded(html.escape(chosen))

    def _tick(self) -> None:
        last, at = time.monotonic(), 0.0
        while True:
            time.sleep(TICK_S)
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


def _places(walk: Walk) -> list[tuple[Array, str]]:
    """Return where (3,) [m] events were, those of one place together, with their kinds."""
    places: list[tuple[Array, list[str]]] = []
    for event in walk.rollout.events:
        if event.kind == REST_EVENT:
            continue
        sample = min(len(walk) - 1, round(event.time_s * STATE_RATE_HZ))
        at = walk.rollout.position_world_m[sample]
        near = (kinds for place, kinds in places if np.linalg.norm(place - at) < APART_M)
        kinds = next(near, None)
        if kinds is None:
            places.append((at, kinds := []))
        kinds.append(event.kind)
    return [(at, ", ".join(dict.fromkeys(kinds))) for at, kinds in places]


def _ground(walk: Walk) -> Array:
    points = walk.rollout.position_world_m[::5].copy()
    points[:, 2] = walk.rollout.floor_z_m[::5]
    return points


def _line(scene: Any, name: str, points_m: Array, color: tuple[int, int, int]) -> Any:
    points = np.asarray(points_m, float) + ABOVE_M
    if len(points) < 2:
        points = np.repeat(points, 2, axis=0)
    segments = np.stack([points[:-1], points[1:]], axis=1)
    return scene.add_line_segments(name, segments, color, thickness=4.0, thickness_units="screen")

"""A session: one drive after another, until the person closes it."""

import itertools
import random
import sys
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from skimage.measure import label

from ...collectors.driving.controls import Controls
from ...collectors.driving.drive import Drive
from ...collectors.replay.world import World
from ...collectors.robots import RobotSpec
from ...evaluation.observation import Eye
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.mcap.facts import episode_from_json, episode_to_json
from ...formats.scene.bundle import load_bundle
from ...rendering.camera.views import View
from ...rendering.registry import scene_renderer_name
from ...viewer.gate import open_page
from ...wayfinding.planning import floor_z
from ..collect.run import Run
from ..options.viewer import Drive as Options
from ..stages.rollouts import drive_items
from ..stages.rollouts.replay_items import item_names
from ..stages.rollouts.replay_job import Walker, open_level
from ..stages.scenes.renderer import scene_renderer
from ..summary import has_display
from .desk import Desk
from .loop import LEFT, Seat, drive_live
from .output import never_waiting
from .server import PageServer

SPARE_M = 0.15  # free drives start with so much room around the robot
_RAYS, _SIGHT_M = 24, 6.0


@dataclass(frozen=True)
class Task:
    """A drive to begin, or to go on with.

    Attributes:
        path: of its journal.
        header: what the journal begins with, or began with.
        new: whether there is no journal yet.
    """

    path: Path
    header: Mapping[str, Any]
    new: bool
    title: str

    @property
    def episode(self) -> Episode:
        """What is driven."""
        return episode_from_json(self.header["episode"])


@dataclass(frozen=True)
class Session:
    """Drives of one robot in the scenes of a run.

    Attributes:
        scenes: folders of repaired scenes by id.
        episodes: to drive along; free drives when None.
        left: why a drive in the run could not be gone on with, by its journal's path.
    """

    run: Run
    options: Options
    robot: RobotSpec
    view: View
    scenes: Mapping[str, Path]
    episodes: list[Episode] | None
    left: dict[Path, str] = field(default_factory=dict)

    def live(self) -> None:
        """Let a person drive in the browser until the session is closed there."""
        desk = Desk(Controls())
        server = PageServer(desk, self.options.port)
        sys.stderr.write(f"drive {self.robot.name}: {server.url}\nCtrl-C leaves; Close ends\n")
        if self.options.open and has_display():
            open_page(server.url)
        with closing(server), never_waiting():
            for task in self.tasks():
                with self._opened(task, desk.controls) as opened:
                    if opened is None:
                        continue
                    drive, world = opened
                    seat = Seat(drive, self._eye(world), task.title, free=task.header["free"])
                    if drive_live(seat, desk) == LEFT:
                        break

    def finish(self) -> None:
        """End interrupted drives where they are, and keep them."""
        for task in self.interrupted():
            with self._opened(task, controls := Controls()) as opened:
                if opened is None:
                    continue
                drive, _ = opened
                controls.stop()
                while drive.end is None:
                    drive.step()
                try:
                    drive.keep(drive.own_episode if task.header["free"] else task.episode)
                except InputError as error:
                    self._leave(task.path, str(error))

    def tasks(self) -> Iterator[Task]:
        """Return interrupted drives, then new ones: of each episode, or free ones without end."""
        yield from self.interrupted()
        folder = drive_items.folder_of(self.run.folder.root, self.robot.name)
        if self.episodes is None:
            count = 0
            while True:
                path = folder / f"free-{(count := count + 1)}{drive_items.SUFFIX}"
                if not path.exists():
                    yield self._new(path, self._free_start(count), f"free drive {count}", free=True)
            return
        names = item_names(self.episodes)
        for k, (name, episode) in enumerate(zip(names, self.episodes, strict=True), start=1):
            path = folder / f"{name}{drive_items.SUFFIX}"
            for again in itertools.count(2):  # one that was left keeps its journal
                if path not in self.left:
                    break
                path = folder / f"{name}-{again}{drive_items.SUFFIX}"
            if not path.exists():
                title = f"episode {k} of {len(names)}"
                yield self._new(path, episode, title, free=False)

    def interrupted(self) -> Iterator[Task]:
        """Return the drives of this robot that nobody has kept; leave those that are damaged."""
        drives, unreadable = drive_items.drives_in(self.run.folder.root)
        for path, reason in unreadable.items():
            self._leave(path, reason)
        for path, recording in ((drive.path, drive.recording) for drive in drives):
            if recording.kept is None and recording.header["robot"] == self.robot.name:
                title = f"{path.name.removesuffix(drive_items.SUFFIX)}, interrupted before"
                yield Task(path, recording.header, new=False, title=title)

    def _leave(self, path: Path, reason: str) -> None:
        """Leave a drive as it is, and say why."""
        self.left[path] = reason
        sys.stderr.write(f"left as it is: {path}: {reason}\n")

    def _new(self, path: Path, episode: Episode, title: str, *, free: bool) -> Task:
        header = {
            "robot": self.robot.name,
            "driver": self.options.driver,
            "controller": drive_items.CONTROLLERS[self.options.actions],
            "seed": self.options.seed,
            "free": free,
            "episode": episode_to_json(episode),
            "vlnpe": version("vlnpe"),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        return Task(path, header, new=True, title=title)

    @contextmanager
    def _opened(self, task: Task, controls: Controls) -> Iterator[tuple[Drive, World] | None]:
        """Open a drive; one that cannot be driven here and now is left, and None."""
        ledger, opened = self.run.context.ledger, None
        if not task.new:  # what it had when it was left
            ledger.unrecord([task.path])
        try:
            walker = drive_items.drive_walker(self.robot, task.header)
            world = self._world(task.episode, walker)
            controls.release()
            header = task.header if task.new else None
            drive = Drive(world, task.episode, walker.config, controls, task.path, header)
            opened = drive, world
        except InputError as error:
            if task.new and task.header["free"]:  # the next one would start no better
                raise
            self._leave(task.path, getattr(error, "reason", str(error)))
        try:
            yield opened
        finally:
            if opened is not None:
                opened[0].close()
            ledger.record([task.path])

    def _world(self, episode: Episode, walker: Walker) -> World:
        if episode.scene_id not in self.scenes:
            valid = ", ".join(self.scenes)
            raise InputError(f"it was driven in {episode.scene_id}; valid here: {valid}")
        folder = self.run.folder
        return open_level(self.scenes[episode.scene_id], episode, walker, folder.models)

    def _eye(self, world: World) -> Eye:
        scene = self.scenes[world.bundle.root.name]
        name = scene_renderer_name(scene, self.view.renderer)
        _, renderer = scene_renderer(scene, name, self.view.light)
        return Eye(world, replace(self.view, renderer=name), renderer)

    def _free_start(self, number: int) -> Episode:
        """Return an episode without a goal that begins at a random place with room around it."""
        scene = list(self.scenes)[(number - 1) % len(self.scenes)]
        freemap = load_bundle(self.scenes[scene]).freemap(0)
        rng = random.Random(f"{self.options.seed}/{scene}/{number}")
        grid, free = freemap.grid, freemap.free(self.robot.footprint_radius_m + SPARE_M)
        regions = np.asarray(label(free, connectivity=1))
        if not regions.any():
            raise InputError(f"{scene}: no place is wide enough for {self.robot.name}")
        cells = np.argwhere(regions == np.bincount(regions.ravel())[1:].argmax() + 1)
        x, y = grid.center_of(cells[rng.randrange(len(cells))]).tolist()
        yaws = 2 * np.pi * np.arange(_RAYS) / _RAYS
        reach = np.arange(0.0, _SIGHT_M, grid.cell_m)
        ahead = np.stack([np.cos(yaws), np.sin(yaws)], axis=-1)
        points = np.array([x, y]) + reach[None, :, None] * ahead[:, None, :]
        row, column = np.moveaxis(grid.clamped_cell_of(points), -1, 0)
        open_m = np.cumprod(freemap.traversable[row, column], axis=1).sum(axis=1)
        at = np.array([x, y, float(floor_z(freemap, np.array([x, y])))])
        name = f"{self.robot.name}-free-{number}"
        return Episode(
            episode_id=name,
            trajectory_id=name,
            scene_id=scene,
            split="train",
            level=0,
            start_position_world_m=at,
            start_yaw_rad=float(yaws[int(np.argmax(open_m))]),
            goal_position_world_m=at,
            reference_path_world_m=np.array([at, at]),
            geodesic_distance_m=0.0,
        )

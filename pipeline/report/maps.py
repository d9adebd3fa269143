"""Paths drawn over the top-down maps of the scenes."""

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.core.episode import Episode
from ...formats.core.geometry import distances_to_path, resample
from ...formats.mcap.rollout import read_rollout
from ..engine.ledger import Row
from .pictures import jpeg_uri

REFERENCE, START, GOAL = "#ffffff", "#1a9850", "#2b5fb8"
BAD = "#d1332b"
# Distinguishable with every colour vision, on wood and on carpet (after Okabe and Ito, 2008).
COLORS = ("#e8a317", "#56b4e9", "#cc79a7", "#009e73", "#f0e442", "#8060d0")
TRACK_STEP = 10  # samples, 0.1 s
REFERENCE_STEP_M = 0.25  # so finely the reference path is divided between levels
CONTACT = "contact"  # kind of the event at which a part begins to touch an obstacle
WIDEST = 4.0  # line, in widths of a lone one
MOST_LABELS = 40  # episodes of one map; the labels of more would hide it
ANGLES_RAD = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)


@dataclass(frozen=True)
class Track:
    """Positions (N, 3) world [m] of a robot's base, and how it ended; `path` is its `path_name`.

    `touching` says which of its parts touched an obstacle, and when.
    """

    path: str
    episode: Episode
    scene: str
    robot: str
    base_m: NDArray[np.float64]
    end_reason: str
    touching: str = ""

    @property
    def off_path_m(self) -> float:
        """Return the largest distance of the robot from the reference path [m]."""
        path = self.episode.reference_path_world_m[:, :2]
        return float(distances_to_path(self.base_m[:, :2], path).max())


@dataclass(frozen=True)
class ScenePaths:
    """Episodes by `path_name`, and the track of each row that they were read from, in order."""

    episodes: dict[str, Episode]
    tracks: tuple[Track, ...]

    @property
    def robots(self) -> dict[str, str]:
        """Return the colour of each robot."""
        return _colored(sorted({track.robot for track in self.tracks}))

    @staticmethod
    def load(root: Path, rows: Sequence[Row]) -> "ScenePaths":
        """Read the rollouts of the replay stage's rows."""
        episodes, tracks = {}, []
        for row in rows:
            rollout, path = read_rollout(root / row.outputs[0]), path_name(row)
            episodes[path] = rollout.episode
            base_m = rollout.position_world_m[::TRACK_STEP]
            where = (str(row.facts["scene"]), rollout.robot)
            touches: dict[str, list[str]] = {}
            for event in rollout.events:
                if event.kind == CONTACT:
                    touches.setdefault(event.detail, []).append(f"{event.time_s:.1f}")
            touching = ", ".join(f"{part} {', '.join(at)} s" for part, at in touches.items())
            end = str(rollout.end_reason)
            tracks.append(Track(path, rollout.episode, *where, base_m, end, touching))
        return ScenePaths(episodes, tuple(tracks))


def path_name(row: Row) -> str:
    """Return the name of a replay's path, the same for every robot and controller.

    Another seed may have sampled another path of the same id.
    """
    return f"{row.item.rsplit('/', 1)[-1]}@{row.facts.get('seed', 0)}"


def map_figure(name: str, picture: Path, paths: ScenePaths) -> dict[str, Any]:
    """Return template values of one map; each robot has a colour, or each path of a lone robot.

    Args:
        name: `<scene>/<level>`.
        picture: the map; the JSON file beside it holds `left_m` and `top_m` (world x and y of the
            image's upper left corner), `px_per_m`, `width` and `height`.
    """
    scene, level = name.rsplit("/", 1)
    mapping = json.loads(picture.with_suffix(".json").read_text())
    origin_m, scale = (mapping["left_m"], mapping["top_m"]), mapping["px_per_m"]

    def pixels(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points_m[..., :2] - origin_m) * (scale, -scale)

    here = int(level)
    tracks = [t for t in paths.tracks if t.scene == scene and here in t.episode.levels]
    tracks.sort(key=lambda track: track.robot)
    by_path = {track.path: track.episode for track in tracks}
    robots, several = paths.robots, len(paths.robots) > 1
    colors = robots if several else _colored(list(by_path))
    width = max(2.0, 0.06 * scale)
    numbers = [list(robots).index(track.robot) for track in tracks]
    layers = _layers([pixels(t.base_m) for t in tracks], 2.0 * width)
    deepest = max(layers, default=0)
    step = min(0.9, (WIDEST - 0.8) / max(deepest, 1))
    lines, crosses = [], []
    # Where walks share their way, each line above is thinner and leaves those beneath visible.
    for layer, number, track in sorted(
        zip(layers, numbers, tracks, strict=True), key=itemgetter(0)
    ):
        title = f"{track.episode.episode_id} {track.robot}: {track.end_reason}"
        walked, on = pixels(track.base_m), track.episode.levels_along(track.base_m) == here
        own = width * (0.8 + step * (deepest - layer))
        color = colors[track.robot if several else track.path]
        for part in _parts(walked, on):
            lines.append({**_line(part, color, own, title), "robot": number})
        if track.end_reason != "success" and on[-1]:
            x, y = walked[-1].round(1).tolist()
            size = round(1.6 * width, 1)
            crosses.append({"x": x, "y": y, "r": size, "title": title, "robot": number})
    for episode in by_path.values():
        title = f"reference of {episode.episode_id}"
        reference = episode.reference_path_world_m
        if episode.staircases:
            reference = resample(reference, REFERENCE_STEP_M)
        for part in _parts(pixels(reference), episode.levels_along(reference) == here):
            lines.append({**_line(part, REFERENCE, 0.4 * width, title), "dashed": True})
    labelled = len(by_path) <= MOST_LABELS
    dots = []
    for path, episode in by_path.items():
        digits = re.search(r"\d+$", episode.episode_id) if labelled else None
        label = digits[0].lstrip("0")[-3:] or "0" if digits else ""
        radius = (2.2 if label else 1.4) * width
        rim = REFERENCE if several else colors[path]
        for point_m, fill, end, on in (
            (episode.start_position_world_m, START, "start", episode.levels[0]),
            (episode.goal_position_world_m, GOAL, "goal", episode.levels[-1]),
        ):
            if on != here:
                continue
            place = pixels(np.asarray(point_m))
            x, y = _free_place(place, radius, dots) if label else place
            dots.append(
                {
                    "x": round(float(x), 1),
                    "y": round(float(y), 1),
                    "r": round(radius, 1),
                    "from": place.round(1).tolist(),
                    "color": fill,
                    "rim": rim,
                    "title": f"{end} of {episode.episode_id}",
                    "label": label,
                    "size": round(radius * (1.5 if len(label) < 2 else 1.1), 1),
                }
            )
    return {
        "title": f"{scene}, level {level}",
        "image": jpeg_uri(picture, 1400),
        "width": mapping["width"],
        "height": mapping["height"],
        "lines": lines,
        "dots": dots,
        "labelled": any(dot["label"] for dot in dots),
        "crosses": crosses,
        "cross_color": BAD,
    }


def _layers(tracks: Sequence[NDArray[np.float64]], cell: float) -> list[int]:
    """Return the number of a layer for each track (N, 2), another one than those it runs along.

    Args:
        cell: tracks run along each other where they share squares of this side, more than where
            one crosses the other.
    """
    covered = [set(map(tuple, (track // cell).astype(int).tolist())) for track in tracks]
    layers: list[int] = []
    for squares in covered:
        along = {
            layer
            for layer, others in zip(layers, covered, strict=False)
            if len(squares & others) > 3
        }
        layers.append(min(set(range(len(layers) + 1)) - along))
    return layers


def _parts(points: NDArray[np.float64], on: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
    """Yield the parts of a line (N, 2) whose points are `on` (N,) the map."""
    for part in np.split(np.arange(len(on)), np.flatnonzero(np.diff(on)) + 1):
        if on[part[0]]:
            yield points[part]


def _colored(names: Sequence[str]) -> dict[str, str]:
    return dict(zip(names, itertools.cycle(COLORS), strict=False))


def _free_place(
    place: NDArray[np.float64], radius: float, dots: Sequence[Mapping[str, Any]]
) -> NDArray[np.float64]:
    """Return the place (2,) [px] nearest to a point where a marker covers none of the others."""
    for away in (0.0, 2.4, 3.6, 4.8):
        for angle in ANGLES_RAD:
            moved = place + away * radius * np.array([np.cos(angle), np.sin(angle)])
            if all(np.hypot(*(moved - (dot["x"], dot["y"]))) > 2.2 * radius for dot in dots):
                return moved
    return place


def _line(points: NDArray[np.float64], color: str, width: float, title: str) -> dict[str, Any]:
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return {"points": text, "color": color, "width": round(width, 1), "title": title}

"""Paths drawn over the top-down maps of the scenes."""

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.core.episode import Episode
from ...formats.core.geometry import distances_to_path
from ...formats.mcap.rollout import read_rollout
from ..engine.ledger import Row
from .pictures import jpeg_uri

REFERENCE, START, GOAL = "#ffffff", "#1a9850", "#2b5fb8"
BAD = "#d1332b"
# Distinguishable with every colour vision, on wood and on carpet (after Okabe and Ito, 2008).
ROBOT_COLORS = ("#e8a317", "#56b4e9", "#cc79a7", "#009e73", "#f0e442", "#8060d0")
TRACK_STEP = 10  # samples, 0.1 s
MOST_LABELS = 40  # episodes of one map; the labels of more would hide it


@dataclass(frozen=True)
class Track:
    """Where a robot walked: (N, 2) world [m], and how it ended."""

    episode: Episode
    scene: str
    robot: str
    xy_m: NDArray[np.float64]
    end_reason: str

    @property
    def off_path_m(self) -> float:
        """Return the largest distance of the robot from the reference path [m]."""
        path = self.episode.reference_path_world_m[:, :2]
        return float(distances_to_path(self.xy_m, path).max())


@dataclass(frozen=True)
class ScenePaths:
    """Episodes by `path_name`, and the track of each row that they were read from, in order."""

    episodes: dict[str, Episode]
    tracks: tuple[Track, ...]

    @property
    def colors(self) -> dict[str, str]:
        """Return the line colour of each robot."""
        robots = sorted({track.robot for track in self.tracks})
        return dict(zip(robots, itertools.cycle(ROBOT_COLORS), strict=False))

    @staticmethod
    def load(root: Path, rows: Sequence[Row]) -> "ScenePaths":
        """Read the rollouts of the replay stage's rows."""
        episodes, tracks = {}, []
        for row in rows:
            rollout = read_rollout(root / row.outputs[0])
            episodes[path_name(row)] = rollout.episode
            xy = rollout.position_world_m[::TRACK_STEP, :2]
            scene = str(row.facts["scene"])
            tracks.append(Track(rollout.episode, scene, rollout.robot, xy, str(rollout.end_reason)))
        return ScenePaths(episodes, tuple(tracks))


def path_name(row: Row) -> str:
    """Return the name of a replay's path, the same for every robot and controller.

    Another seed may have sampled another path of the same id.
    """
    return f"{row.item.rsplit('/', 1)[-1]}@{row.facts.get('seed', 0)}"


def map_figure(name: str, picture: Path, paths: ScenePaths) -> dict[str, Any]:
    """Return template values of one map.

    Args:
        name: `<scene>/<level>`.
        picture: the map; the JSON file beside it holds `left_m` and `top_m` (world x and y of the
            image's upper left corner), `px_per_m`, `width` and `height`.
    """
    scene, level = name.rsplit("/", 1)
    mapping = json.loads(picture.with_suffix(".json").read_text())
    scale = mapping["px_per_m"]
    origin = np.array([mapping["left_m"], mapping["top_m"]])

    def pixels(xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return (xy_m - origin) * np.array([scale, -scale])

    lines, dots, crosses, seen = [], [], [], set()
    tracks = [t for t in paths.tracks if t.scene == scene and t.episode.level == int(level)]
    tracks.sort(key=lambda track: track.robot)
    width = max(2.0, 0.06 * scale)
    labelled = len({track.episode.episode_id for track in tracks}) <= MOST_LABELS
    numbers = {robot: k for k, robot in enumerate(paths.colors)}
    for track in tracks:
        number = numbers[track.robot]
        title = f"{track.episode.episode_id} {track.robot}: {track.end_reason}"
        walked = pixels(track.xy_m)
        # Where robots walk the same way, the later one's thinner line leaves the others visible.
        own = 1.6 * width * (1.0 - number / len(numbers))
        line = _line(walked, paths.colors[track.robot], own, title, False)
        lines.append({**line, "robot": number})
        if track.end_reason != "success":
            x, y = walked[-1].round(1).tolist()
            size = round(1.6 * width, 1)
            crosses.append({"x": x, "y": y, "r": size, "title": title, "robot": number})
        if (track.episode.split, track.episode.episode_id) in seen:
            continue
        seen.add((track.episode.split, track.episode.episode_id))
        title = track.episode.episode_id
        digits = re.search(r"\d+$", title) if labelled else None
        label = digits[0].lstrip("0")[-3:] or "0" if digits else ""
        radius = (3.0 if label else 1.6) * width
        reference = pixels(track.episode.reference_path_world_m[:, :2])
        lines.append(_line(reference, REFERENCE, 0.4 * width, f"reference of {title}", True))
        for point, tint, what in (
            (track.episode.start_position_world_m, START, "start"),
            (track.episode.goal_position_world_m, GOAL, "goal"),
        ):
            x, y = pixels(np.asarray(point)[:2])
            dots.append(
                {
                    "x": round(float(x), 1),
                    "y": round(float(y), 1),
                    "r": round(radius, 1),
                    "color": tint,
                    "title": f"{what} of {title}",
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


def _line(
    points: NDArray[np.float64], color: str, width: float, title: str, dashed: bool
) -> dict[str, Any]:
    return {
        "points": " ".join(f"{x:.1f},{y:.1f}" for x, y in points),
        "color": color,
        "width": round(width, 1),
        "title": title,
        "dashed": dashed,
    }

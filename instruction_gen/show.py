"""A path and its texts for a terminal: a small map of letters, events, sentences."""

import textwrap
from collections.abc import Iterator

import numpy as np

from ..formats.core.episode import Episode
from ..formats.core.geometry import arc_length, resample
from .facts.level import LevelFacts
from .facts.records import PathFacts
from .language.nouns import spoken

_WIDE, _HIGH = 64, 22
WALL = "░"


def _is_wall(level: LevelFacts, low_m: np.ndarray, high_m: np.ndarray) -> bool:
    """Return whether a box (2,), (2,) [m] has a piece of a wall, with a room beside it."""
    rooms = level.regions
    (row, column), (top, right) = np.maximum(rooms.grid.cell_of([low_m, high_m]), 0)
    walls = rooms.width_m[row : top + 1, column : right + 1] == 0
    beside = rooms.region[max(row - 2, 0) : top + 3, max(column - 2, 0) : right + 3] >= 0
    return bool(walls.any() and beside.any())


def _rooms(
    level: LevelFacts, low_m: np.ndarray, high_m: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name and middle (2,) [m] of each room in a box."""
    for region, name in enumerate(level.regions.names):
        at = np.argwhere(level.regions.region == region)
        places = level.regions.grid.center_of(at)
        places = places[((places > low_m) & (places < high_m)).all(axis=1)]
        if name and len(places):
            yield name, np.median(places, axis=0)


def show_path(episode: Episode, facts: PathFacts, level: LevelFacts) -> str:
    """Return a title, a map with its legend, the turns and doors of the path, and the texts.

    The map has the walls and the names of the rooms around the path.
    """
    path = episode.reference_path_world_m[:, :2]
    points = resample(path, 0.1)
    low, high = points.min(0) - 1.2, points.max(0) + 1.2
    cell = max((high[0] - low[0]) / _WIDE, (high[1] - low[1]) / _HIGH / 2)
    columns = int((high[0] - low[0]) / cell) + 1
    rows = int((high[1] - low[1]) / cell / 2) + 1
    grid = [[" "] * columns for _ in range(rows)]

    def put(xy_m: np.ndarray, letter: str) -> None:
        column = int((xy_m[0] - low[0]) / cell)
        row = rows - 1 - int((xy_m[1] - low[1]) / cell / 2)
        if 0 <= row < rows and 0 <= column < columns:
            grid[row][column] = letter

    for k, j in np.ndindex(rows, columns):
        corner = low + np.array([j, 2 * (rows - 1 - k)]) * cell
        if _is_wall(level, corner, corner + np.array([1, 2]) * cell):
            grid[k][j] = WALL
    for point in points:
        put(point, "*")
    for name, center in _rooms(level, low, high):
        start = int((center[0] - low[0]) / cell - len(name) / 2)
        start, middle = (
            max(0, min(start, columns - len(name))),
            int((center[1] - low[1]) / cell / 2),
        )
        for row in (rows - 1 - middle + k for k in (0, 1, -1, 2, -2, 3, -3)):
            if 0 <= row < rows and not "".join(grid[row][start : start + len(name)]).strip():
                grid[row][start : start + len(name)] = name
                break
    legend = ["S start", "* path", "G goal", f"{WALL} wall"]
    knots = arc_length(points)
    marks = [m for m in facts.landmarks if m.nameable and m.distance_m < 2.5]
    for letter, mark in zip("abcdefghijklmnopqrstuvwxyz", marks, strict=False):
        k = int(np.argmin(np.abs(knots - mark.along_m)))
        ahead = points[min(k + 4, len(points) - 1)] - points[max(k - 4, 0)]
        heading = np.arctan2(ahead[1], ahead[0])
        bearing = next((m.bearing_deg for m in mark.moments if m.along_m >= mark.along_m), 0.0)
        angle = heading + np.deg2rad(bearing)
        away = max(mark.distance_m, 0.5)
        put(points[k] + away * np.array([np.cos(angle), np.sin(angle)]), letter)
        legend.append(f"{letter} {spoken(mark.noun)}")
    put(points[0], "S")
    put(points[-1], "G")
    events = [f"{t.along_m:.1f} m {t.side} {abs(t.angle_deg):.0f}°" for t in facts.turns]
    events += [f"{p.along_m:.1f} m into {p.to_room or 'next room'}" for p in facts.doors]
    events += [f"{c.along_m:.1f} m {c.way} the stairs" for c in facts.climbs]
    head = f"{episode.episode_id}: {facts.length_m:.1f} m, {facts.visits[0].room or 'a room'}"
    lines = [head, *("".join(row).rstrip() for row in grid)]
    lines.append("  " + ", ".join(legend))
    lines.append("  " + "; ".join(sorted(events, key=lambda e: float(e.split()[0]))))
    for text in episode.extra.get("instructions", [episode.instruction]):
        lines += textwrap.wrap(text, 96, initial_indent="  - ", subsequent_indent="    ")
    return "\n".join(lines)

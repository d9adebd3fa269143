"""Maps and logs for writers of new texts: python -m benchmarks.instructions.material SCENES OUT

For each scene in SCENES with `episodes/<scene>.json.gz` beside that folder, OUT gets `<scene>.md`
(boxes of all things, and what is where along each path) and a plan of each path. Nothing of parser,
checker or composer is in it: who writes from it knows only the building.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.geometry import path_length, point_along
from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.instruction_gen.facts import LevelFacts, path_facts
from vlnpe.instruction_gen.facts.records import Moment, PathFacts

_PIXELS_PER_M = 70
_STEP_M = 0.5
_NEAR_M = 2.0
_MOST = 12


def place(moment: Moment) -> str:
    """Return where a thing is, as seen by the walker."""
    side = "left" if moment.bearing_deg > 0 else "right"
    off = abs(moment.bearing_deg)
    if off < 20:
        return "straight ahead"
    if off < 60:
        return f"ahead, {side} of the line"
    if off < 125:
        return f"beside, on the {side}"
    return "behind" if off > 165 else f"behind, on the {side}"


def log(episode: Episode, facts: PathFacts) -> list[str]:
    """Return what is where every half metre of a path."""
    path = episode.reference_path_world_m[:, :2]
    length = path_length(path)
    lines = []
    heading: float | None = None
    for along in [*np.arange(0.0, length - 0.2, _STEP_M), length]:
        ends = point_along(path, np.clip([along - 0.25, along + 0.25], 0.0, length))
        ahead = float(np.rad2deg(np.arctan2(*(ends[1] - ends[0])[::-1])))
        turned = 0.0 if heading is None else (ahead - heading + 180) % 360 - 180
        heading = ahead
        near = []
        for mark in facts.landmarks:
            here = min(mark.moments, key=lambda m: abs(m.along_m - along), default=None)
            if here and abs(here.along_m - along) < 0.2 and here.open and here.distance_m < _NEAR_M:
                near.append((here.distance_m, f"{mark.noun} {here.distance_m:.1f} m {place(here)}"))
        side = "left" if turned > 0 else "right"
        turn = f"turned {abs(turned):.0f} deg {side} in the last half metre; "
        here_xy = point_along(path, along)
        lines.append(
            f"- {along:.1f} m at ({here_xy[0]:.1f}, {here_xy[1]:.1f}), "
            + (turn if abs(turned) >= 8 else "")
            + ", ".join(text for _, text in sorted(near)[:_MOST])
        )
    return lines


def plan(shared: LevelFacts, path: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) of rooms, things and a path (P, 2) [m]."""
    regions = shared.regions
    inside = regions.region >= 0
    rows, columns = np.nonzero(inside)
    low = regions.grid.center_of(np.array([rows.min(), columns.min()])) - 0.3
    high = regions.grid.center_of(np.array([rows.max(), columns.max()])) + 0.3
    wide, tall = np.ceil((high - low) * _PIXELS_PER_M).astype(int)

    def at(xy_m: NDArray[np.float64]) -> tuple[int, int]:
        x, y = (xy_m - low) * _PIXELS_PER_M
        return round(float(x)), tall - round(float(y))

    pixels = np.stack(np.meshgrid(np.arange(wide), np.arange(tall)), axis=-1).astype(float)
    pixels[..., 1] = tall - pixels[..., 1]
    picture = np.where((regions.at(low + pixels / _PIXELS_PER_M) >= 0)[..., None], 255, 120)
    picture = np.ascontiguousarray(np.repeat(picture, 3, axis=-1).astype(np.uint8))
    font, smooth = cv2.FONT_HERSHEY_SIMPLEX, cv2.LINE_AA
    boxes = zip(shared.nouns, shared.low_m, shared.high_m, strict=True)
    # The largest first: a table stands on its rug.
    for noun, a, b in sorted(boxes, key=lambda box: -float(np.prod(box[2] - box[1]))):
        cv2.rectangle(picture, at(a), at(b), (200, 220, 250), -1)
        cv2.rectangle(picture, at(a), at(b), (150, 110, 60), 1)
        x, y = at(np.array([a[0], 0.5 * (a[1] + b[1])]))
        cv2.putText(picture, noun, (x, y), font, 0.38, (60, 40, 20), 1, smooth)
    for k, name in enumerate(shared.names):
        cells = np.argwhere(regions.region == k)
        if len(cells):
            x, y = at(regions.grid.center_of(np.median(cells, axis=0).astype(int)))
            cv2.putText(picture, name.upper(), (x - 40, y), font, 0.55, (200, 60, 20), 1, smooth)
    length = path_length(path)
    for along in np.arange(0.8, length, 1.4):
        a, b = point_along(path, np.array([along - 0.15, along]))
        cv2.arrowedLine(picture, at(a), at(b), (0, 0, 220), 2, smooth, tipLength=1.0)
    points = np.array([at(p) for p in path], dtype=np.int32)
    cv2.polylines(picture, [points], isClosed=False, color=(0, 0, 220), thickness=2)
    for name, point, colour in (("START", path[0], (0, 150, 0)), ("END", path[-1], (0, 0, 220))):
        cv2.circle(picture, at(point), 6, colour, -1)
        x, y = at(point)
        cv2.putText(picture, name, (x + 8, y), font, 0.5, colour, 2, smooth)
    return picture


def write(scene: Path, file: Path, out: Path) -> int:
    """Write the material of one scene; return how many paths it has."""
    bundle = load_bundle(scene)
    episodes = list(read_episodes(file))
    levels = {level: LevelFacts.of(bundle, level) for level in {e.level for e in episodes}}
    lines = [f"# {scene.name}", "x east, y north, metres.", ""]
    for level, shared in sorted(levels.items()):
        lines.append(f"## Things on level {level}")
        for noun, a, b in zip(shared.nouns, shared.low_m, shared.high_m, strict=True):
            region = int(shared.regions.at(0.5 * (a + b)))
            room = shared.names[region] if region >= 0 else "in a wall"
            box = f"x {a[0]:.1f} to {b[0]:.1f}, y {a[1]:.1f} to {b[1]:.1f}"
            lines.append(f"- {noun} ({room}): {box}")
    (out / scene.name).mkdir(parents=True, exist_ok=True)
    for n, episode in enumerate(episodes):
        shared = levels[episode.level]
        facts = path_facts(episode, shared)
        rooms = "; ".join(f"{v.room or 'a room'} from {v.from_m:.1f} m" for v in facts.visits)
        picture = f"{scene.name}/{n:04d}.png"
        head = f"length {facts.length_m:.1f} m; {rooms}; picture: {picture}"
        lines += ["", f"## Path {scene.name}/{n:04d}", head, *log(episode, facts)]
        cv2.imwrite(str(out / picture), plan(shared, episode.reference_path_world_m[:, :2]))
    (out / f"{scene.name}.md").write_text("\n".join(lines) + "\n")
    return len(episodes)


def main() -> None:
    """Write the material of all scenes of a folder that have episodes."""
    scenes, out = Path(sys.argv[1]), Path(sys.argv[2])
    for file in sorted(scenes.parent.glob("episodes/*.json.gz")):
        scene = scenes / file.name.removesuffix(".json.gz")
        sys.stdout.write(f"{scene.name}: {write(scene, file, out)} paths\n")


if __name__ == "__main__":
    main()

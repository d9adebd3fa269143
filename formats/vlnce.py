"""VLN-CE episode files: gzip JSON in Habitat coordinates.

`read_vlnce` reads anybody's file as it stands; `write_episodes` and `read_episodes` carry our
world-frame `Episode` records in the same schema. Our extra keys lie in `info.vlnpe`, because
Habitat's loader accepts only the known keys at an episode's top level, but any in `info`.
"""

from __future__ import annotations

import gzip
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .atomic import atomic_file
from .episode import Episode
from .errors import FileFormatError
from .frames import (
    habitat_to_world_position,
    world_to_habitat_position,
    world_to_habitat_rotation,
)
from .vocabulary import Vocabulary

OUR_KEY = "vlnpe"
FORMAT_VERSION = 1
_TOKENS = 200  # VLN-CE pads or cuts every instruction to this many tokens
_SCENE_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".usd", ".usda", ".usdc")
_KNOWN = {
    "episode_id",
    "trajectory_id",
    "scene_id",
    "start_position",
    "start_rotation",
    "info",
    "goals",
    "instruction",
    "reference_path",
}


@dataclass(frozen=True)
class VlnceGoal:
    """A goal position (3,) in Habitat coordinates [m] and its success radius [m]."""

    position_habitat_m: NDArray[np.float64]
    radius_m: float


@dataclass(frozen=True)
class VlnceEpisode:
    """One episode as the file has it, in Habitat coordinates.

    Attributes:
        episode_id: as written; files use integers and strings.
        trajectory_id: as written; episodes of one path with different instructions share it.
        scene_id: e.g. `mp3d/<id>/<id>.glb`.
        start_position_habitat_m: (3,) [m].
        start_rotation_xyzw: (4,) unit quaternion.
        instruction_text: the instruction.
        instruction_tokens: word indices, or None.
        goals: empty in a test split.
        reference_path_habitat_m: (P, 3) [m]; (0, 3) in a test split.
        info: as written, e.g. `geodesic_distance`.
        extra: unknown keys of the episode, as they are.
    """

    episode_id: int | str
    trajectory_id: int | str
    scene_id: str
    start_position_habitat_m: NDArray[np.float64]
    start_rotation_xyzw: NDArray[np.float64]
    instruction_text: str
    instruction_tokens: tuple[int, ...] | None
    goals: tuple[VlnceGoal, ...]
    reference_path_habitat_m: NDArray[np.float64]
    info: dict[str, Any] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def scene_stem(self) -> str:
        """The scene's name without folders and file type: `mp3d/X/X.glb` → `X`."""
        return scene_stem(self.scene_id)

    @property
    def in_repaired_world(self) -> bool:
        """Whether our writer made it: its coordinates then are those of the repaired world."""
        return OUR_KEY in self.info


@dataclass(frozen=True)
class VlnceFile:
    """An episode file.

    Attributes:
        path: where it was read.
        episodes: in file order.
        vocabulary: the file's `instruction_vocab` as it stands, or None.
        extra: unknown top-level keys, as they are.
    """

    path: Path
    episodes: tuple[VlnceEpisode, ...]
    vocabulary: dict[str, Any] | None = None
    extra: dict[str, Any] = field(default_factory=dict)


def scene_stem(scene_id: str) -> str:
    """A scene's name without folders and file type: `mp3d/X/X.glb` → `X`, `home.v2` → itself."""
    path = PurePosixPath(scene_id)
    return path.stem if path.suffix.lower() in _SCENE_SUFFIXES else path.name


def read_vlnce(path: Path | str) -> VlnceFile:
    """Read a VLN-CE episode file, gzip or plain JSON (told apart by content, not by name).

    Raises:
        FileFormatError: missing or unreadable file, broken gzip or JSON, or an episode that
            lacks a key or has one of the wrong kind; names the file, the episode and the reason.
    """
    path = Path(path)
    document = _load(path)
    if not isinstance(document, dict) or not isinstance(document.get("episodes"), list):
        raise FileFormatError(path, 'not a VLN-CE episode file: no list "episodes" at the top')
    episodes = []
    seen: set[str] = set()
    for index, raw in enumerate(document["episodes"]):
        reader = _Reader(path, index, raw)
        episode = reader.episode()
        if str(episode.episode_id) in seen:
            raise reader.error("its episode_id occurs twice in the file")
        seen.add(str(episode.episode_id))
        episodes.append(episode)
    vocabulary = document.get("instruction_vocab")
    if vocabulary is not None and not isinstance(vocabulary, dict):
        raise FileFormatError(path, "instruction_vocab is not an object")
    extra = {k: v for k, v in document.items() if k not in ("episodes", "instruction_vocab")}
    return VlnceFile(path, tuple(episodes), vocabulary, extra)


def write_vlnce(path: Path | str, file: VlnceFile) -> None:
    """Write `file`'s records back in the same schema, atomically, unknown keys included.

    A name that ends in `.gz` is compressed. Equal content gives equal bytes.
    """
    document: dict[str, Any] = dict(file.extra)
    document["episodes"] = [_episode_json(e) for e in file.episodes]
    if file.vocabulary is not None:
        document["instruction_vocab"] = file.vocabulary
    _dump(Path(path), document)


def write_episodes(path: Path | str, episodes: Sequence[Episode]) -> None:
    """Write world-frame episodes in VLN-CE's schema, atomically.

    Positions are Habitat coordinates of the repaired world: (x, y, z) → (x, z, −y). What the
    schema lacks (level, split, heading, extra keys) lies in each episode's `info.vlnpe`. A name
    that ends in `.gz` is compressed. Equal episodes give equal bytes.

    Raises:
        ValueError: two episodes share an id.
    """
    ids = [e.episode_id for e in episodes]
    if len(set(ids)) != len(ids):
        twice = sorted({i for i in ids if ids.count(i) > 1})
        raise ValueError(f"episode ids must be unique, repeated: {', '.join(twice)}")
    vocabulary = Vocabulary.of(e.instruction for e in episodes)
    records = tuple(_to_vlnce(e, vocabulary) for e in episodes)
    write_vlnce(path, VlnceFile(Path(path), records, vocabulary.to_json()))


def read_episodes(path: Path | str) -> list[Episode]:
    """Read what `write_episodes` wrote, exactly.

    Raises:
        FileFormatError: as `read_vlnce`, and for files that our writer did not make (align those
            with a repaired scene first).
    """
    file = read_vlnce(path)
    return [_to_episode(file.path, e) for e in file.episodes]


def _to_vlnce(episode: Episode, vocabulary: Vocabulary) -> VlnceEpisode:
    ours = {
        "format_version": FORMAT_VERSION,
        "split": episode.split,
        "level": episode.level,
        "start_yaw_rad": episode.start_yaw_rad,
        "extra": episode.extra,
    }
    return VlnceEpisode(
        episode_id=episode.episode_id,
        trajectory_id=episode.trajectory_id,
        scene_id=episode.scene_id,
        start_position_habitat_m=world_to_habitat_position(episode.start_position_world_m),
        start_rotation_xyzw=world_to_habitat_rotation(episode.start_yaw_rad),
        instruction_text=episode.instruction,
        instruction_tokens=tuple(vocabulary.encode(episode.instruction, _TOKENS)),
        goals=(
            VlnceGoal(
                world_to_habitat_position(episode.goal_position_world_m), episode.goal_radius_m
            ),
        ),
        reference_path_habitat_m=world_to_habitat_position(episode.reference_path_world_m),
        info={"geodesic_distance": episode.geodesic_distance_m, OUR_KEY: ours},
    )


def _to_episode(path: Path, raw: VlnceEpisode) -> Episode:
    def fail(reason: str) -> FileFormatError:
        return FileFormatError(path, f"episode {raw.episode_id!r}: {reason}")

    ours = raw.info.get(OUR_KEY)
    if not isinstance(ours, dict):
        raise fail(f"no info.{OUR_KEY}: a foreign VLN-CE file, align it with its scenes first")
    if ours.get("format_version") != FORMAT_VERSION:
        version = ours.get("format_version")
        raise fail(f"format version {version}, this code reads {FORMAT_VERSION}")
    if not raw.goals or not len(raw.reference_path_habitat_m):
        raise fail("no goal or no reference path")
    try:
        return Episode(
            episode_id=str(raw.episode_id),
            trajectory_id=str(raw.trajectory_id),
            scene_id=raw.scene_id,
            split=str(ours["split"]),
            level=int(ours["level"]),
            start_position_world_m=habitat_to_world_position(raw.start_position_habitat_m),
            start_yaw_rad=float(ours["start_yaw_rad"]),
            goal_position_world_m=habitat_to_world_position(raw.goals[0].position_habitat_m),
            reference_path_world_m=habitat_to_world_position(raw.reference_path_habitat_m),
            geodesic_distance_m=float(raw.info["geodesic_distance"]),
            instruction=raw.instruction_text,
            goal_radius_m=raw.goals[0].radius_m,
            extra=dict(ours["extra"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise fail(f"info.{OUR_KEY} is damaged: {error!r}") from error


def _episode_json(e: VlnceEpisode) -> dict[str, Any]:
    instruction: dict[str, Any] = {"instruction_text": e.instruction_text}
    if e.instruction_tokens is not None:
        instruction["instruction_tokens"] = list(e.instruction_tokens)
    result: dict[str, Any] = {
        "episode_id": e.episode_id,
        "trajectory_id": e.trajectory_id,
        "scene_id": e.scene_id,
        "start_position": e.start_position_habitat_m.tolist(),
        "start_rotation": e.start_rotation_xyzw.tolist(),
        "info": e.info,
        "instruction": instruction,
    }
    if e.goals:
        result["goals"] = [
            {"position": g.position_habitat_m.tolist(), "radius": g.radius_m} for g in e.goals
        ]
    if len(e.reference_path_habitat_m):
        result["reference_path"] = e.reference_path_habitat_m.tolist()
    return {**result, **e.extra}


def _load(path: Path) -> Any:
    try:
        data = path.read_bytes()
        if data[:2] == b"\x1f\x8b":
            data = gzip.decompress(data)
        return json.loads(data)
    except FileNotFoundError as error:
        raise FileFormatError(path, "no such file") from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise FileFormatError(path, f"broken gzip: {error}") from error
    except OSError as error:
        raise FileFormatError(path, f"cannot be read: {error.strerror}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(path, f"not JSON: {error}") from error
    except RecursionError as error:
        raise FileFormatError(path, "not an episode file: nested too deeply") from error


def _dump(path: Path, document: Mapping[str, Any]) -> None:
    data = json.dumps(document, ensure_ascii=False, allow_nan=False).encode()
    if path.suffix == ".gz":
        data = gzip.compress(data, compresslevel=6, mtime=0)
    with atomic_file(path) as temporary:
        temporary.write_bytes(data)


class _Reader:
    """Strict reading of one episode; every complaint names file, episode and key."""

    def __init__(self, path: Path, index: int, raw: Any):
        self.path, self.index, self.raw = path, index, raw
        if not isinstance(raw, dict):
            raise self.error("not an object")

    def error(self, reason: str) -> FileFormatError:
        name = self.raw.get("episode_id") if isinstance(self.raw, dict) else None
        where = f"episode {name!r}" if name is not None else "an episode without id"
        return FileFormatError(self.path, f"{where} (number {self.index}): {reason}")

    def episode(self) -> VlnceEpisode:
        raw = self.raw
        instruction = self.mapping("instruction")
        text = instruction.get("instruction_text")
        if not isinstance(text, str):
            raise self.error("instruction.instruction_text is missing or no string")
        return VlnceEpisode(
            episode_id=self.identity("episode_id"),
            trajectory_id=self.identity("trajectory_id"),
            scene_id=self.scene_id(),
            start_position_habitat_m=self.vector(raw.get("start_position"), 3, "start_position"),
            start_rotation_xyzw=self.rotation(),
            instruction_text=text,
            instruction_tokens=self.tokens(instruction.get("instruction_tokens")),
            goals=self.goals(),
            reference_path_habitat_m=self.path_points(),
            info=self.mapping("info", optional=True),
            extra={k: v for k, v in raw.items() if k not in _KNOWN},
        )

    def mapping(self, key: str, optional: bool = False) -> dict[str, Any]:
        value = self.raw.get(key)
        if value is None and optional:
            return {}
        if not isinstance(value, dict):
            raise self.error(f"{key} is missing or no object")
        return value

    def identity(self, key: str) -> int | str:
        value = self.raw.get(key)
        if isinstance(value, bool) or not isinstance(value, int | str):
            raise self.error(f"{key} is missing or neither integer nor string")
        return value

    def scene_id(self) -> str:
        value = self.raw.get("scene_id")
        if not isinstance(value, str) or not Path(value).stem:
            raise self.error("scene_id is missing or no path-like string")
        return value

    def vector(self, value: Any, length: int, key: str) -> NDArray[np.float64]:
        valid = isinstance(value, list) and len(value) == length
        if not valid or not all(
            isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v)
            for v in value
        ):
            raise self.error(f"{key} must be {length} finite numbers, is {_brief(value)}")
        return np.array(value, dtype=np.float64)

    def rotation(self) -> NDArray[np.float64]:
        quaternion = self.vector(self.raw.get("start_rotation"), 4, "start_rotation")
        norm = float(np.linalg.norm(quaternion))
        # Public files round to a few digits, so allow for that, not for another convention.
        if abs(norm - 1.0) > 0.01:
            raise self.error(f"start_rotation must have length 1, has {norm:.4f}")
        return quaternion

    def tokens(self, value: Any) -> tuple[int, ...] | None:
        if value is None:
            return None
        if not isinstance(value, list) or not all(type(v) is int for v in value):
            raise self.error(f"instruction_tokens must be integers, is {_brief(value)}")
        return tuple(value)

    def goals(self) -> tuple[VlnceGoal, ...]:
        value = self.raw.get("goals")
        if value is None:
            return ()
        if not isinstance(value, list) or not all(isinstance(g, dict) for g in value):
            raise self.error("goals must be a list of objects")
        result = []
        for k, goal in enumerate(value):
            radius = goal.get("radius", 3.0)
            if not isinstance(radius, int | float) or not 0 < radius < math.inf:
                raise self.error(f"goals[{k}].radius must be positive, is {_brief(radius)}")
            position = self.vector(goal.get("position"), 3, f"goals[{k}].position")
            result.append(VlnceGoal(position, float(radius)))
        return tuple(result)

    def path_points(self) -> NDArray[np.float64]:
        value = self.raw.get("reference_path")
        if value is None:
            return np.zeros((0, 3))
        if not isinstance(value, list):
            raise self.error("reference_path must be a list of positions")
        points = [self.vector(p, 3, f"reference_path[{k}]") for k, p in enumerate(value)]
        return np.array(points).reshape(-1, 3)


def _brief(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."

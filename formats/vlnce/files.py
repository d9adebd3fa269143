"""VLN-CE episode files: gzip JSON in Habitat coordinates.

`read_vlnce` reads any VLN-CE file as it is; `write_episodes` and `read_episodes` carry our
world-frame `Episode` records in the same schema. Our extra keys lie in `info.vlnpe`, because
Habitat's loader accepts only the known keys at an episode's top level, but any in `info`.
"""

import gzip
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..core.atomic import write_bytes
from ..core.episode import Episode
from ..core.errors import FileFormatError, brief
from ..core.frames import (
    habitat_to_world_position,
    world_to_habitat_position,
    world_to_habitat_rotation,
)
from ..untrusted.limits import Limits
from .load import load_document
from .overlay import overlay
from .reader import BadEpisodeError, EpisodeReader, unsafe_scene_id, writable
from .records import OUR_KEY, BadEpisode, VlnceEpisode, VlnceFile, VlnceGoal, scene_stem
from .vocabulary import Vocabulary

__all__ = [
    "BadEpisode",
    "VlnceEpisode",
    "VlnceFile",
    "VlnceGoal",
    "read_episodes",
    "read_vlnce",
    "scene_stem",
    "write_episodes",
    "write_vlnce",
]

FORMAT_VERSION = 1
_TOKENS = 200  # VLN-CE pads or cuts every instruction to this many tokens


def read_vlnce(
    path: Path | str, *, strict: bool = False, limits: Limits | None = None
) -> VlnceFile:
    """Read a VLN-CE episode file (R2R or RxR), gzip or plain JSON.

    An episode that lacks a key, has one of the wrong kind, a number that is not finite, or an id
    that occurred before, goes to the file's `bad`; the others are read.

    Args:
        strict: raise for the first bad episode instead.
        limits: of size, nesting and number of episodes; by default those of `untrusted.limits`.

    Raises:
        FileFormatError: the file is missing, unreadable or beyond a limit; a `scene_id` is absolute
            or has a `..` (no honest file does); or not a single episode is usable.
    """
    path = Path(path)
    document = load_document(path, limits)
    episodes, bad = [], []
    seen: set[str] = set()
    for index, raw in enumerate(document["episodes"]):
        if isinstance(raw, dict) and unsafe_scene_id(raw.get("scene_id")):
            scene = f"episode number {index}: scene_id {brief(raw['scene_id'])}"
            reason = "leads out of the folder of scenes; valid: a relative path without '..'"
            raise FileFormatError(path, f"{scene} {reason}")
        try:
            reader = EpisodeReader(path, index, raw)
            episode = reader.episode()
            if str(episode.episode_id) in seen:
                raise reader.error("its episode_id occurs twice")
        except BadEpisodeError as error:
            if strict:
                raise
            bad.append(error.bad)
            continue
        seen.add(str(episode.episode_id))
        episodes.append(episode)
    if bad and not episodes:
        first = BadEpisodeError(path, bad[0])
        more = f"; all {len(bad)} episodes are unusable" if len(bad) > 1 else ""
        raise FileFormatError(path, f"{first.reason}{more}")
    vocabulary = document.get("instruction_vocab")
    if vocabulary is not None and not isinstance(vocabulary, dict):
        raise FileFormatError(path, "instruction_vocab is not an object")
    extra = {k: v for k, v in document.items() if k not in ("episodes", "instruction_vocab")}
    for key, value in document.items():
        if key != "episodes" and not writable(value):
            raise FileFormatError(path, f"{brief(key)} has a number that is not finite")
    return VlnceFile(path, tuple(episodes), vocabulary, extra, tuple(bad), tuple(document))


def write_vlnce(path: Path | str, file: VlnceFile) -> None:
    """Write `file`'s records back in the same schema, atomically, unknown keys included.

    A name that ends in `.gz` is compressed. Equal content gives equal bytes.
    """
    document: dict[str, Any] = dict(file.extra)
    document["episodes"] = [_episode_json(e) for e in file.episodes]
    if file.vocabulary is not None:
        document["instruction_vocab"] = file.vocabulary
    first = {key: document[key] for key in file.keys if key in document}
    _dump(Path(path), first | document)


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
    file = read_vlnce(path, strict=True)
    return [_to_episode(file.path, e) for e in file.episodes]


def _to_vlnce(episode: Episode, vocabulary: Vocabulary) -> VlnceEpisode:
    ours = {
        "format_version": FORMAT_VERSION,
        "split": episode.split,
        "level": episode.level,
        "start_yaw_rad": episode.start_yaw_rad,
        "extra": episode.extra,
    }
    goal = world_to_habitat_position(episode.goal_position_world_m)
    return VlnceEpisode(
        episode_id=episode.episode_id,
        trajectory_id=episode.trajectory_id,
        scene_id=episode.scene_id,
        start_position_habitat_m=world_to_habitat_position(episode.start_position_world_m),
        start_rotation_xyzw=world_to_habitat_rotation(episode.start_yaw_rad),
        instruction_text=episode.instruction,
        instruction_tokens=tuple(vocabulary.encode(episode.instruction, _TOKENS)),
        goals=(VlnceGoal(goal, episode.goal_radius_m),),
        reference_path_habitat_m=world_to_habitat_position(episode.reference_path_world_m),
        info={"geodesic_distance": episode.geodesic_distance_m, OUR_KEY: ours},
    )


def _to_episode(path: Path, raw: VlnceEpisode) -> Episode:
    def fail(reason: str) -> FileFormatError:
        return FileFormatError(path, f"episode {brief(raw.episode_id)}: {reason}")

    ours = raw.info.get(OUR_KEY)
    if not isinstance(ours, dict):
        raise fail(f"no info.{OUR_KEY}: not written by vlnpe; align the file with its scenes first")
    if ours.get("format_version") != FORMAT_VERSION:
        version = ours.get("format_version")
        raise fail(f"format version {version}; this code reads {FORMAT_VERSION}")
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
    goals = [{"position": g.position_habitat_m.tolist(), "radius": g.radius_m} for g in e.goals]
    if goals:
        result["goals"] = goals
    if len(e.reference_path_habitat_m):
        result["reference_path"] = e.reference_path_habitat_m.tolist()
    result |= e.extra
    if e.source is None:
        return result
    if not e.info and "info" not in e.source:
        del result["info"]
    # Empty values (`"goals": null` in a test split) stay as they are written.
    removed = {key for key in e.source.keys() - result.keys() if e.source[key]}
    merged = overlay(e.source, result, removed)
    if "info" in result:
        merged["info"] = e.info
    if e.instruction_tokens is None and merged["instruction"].get("instruction_tokens"):
        del merged["instruction"]["instruction_tokens"]
    return merged


def _dump(path: Path, document: Mapping[str, Any]) -> None:
    data = json.dumps(document, ensure_ascii=False, allow_nan=False).encode()
    if path.suffix == ".gz":
        data = gzip.compress(data, compresslevel=6, mtime=0)
    write_bytes(path, data)

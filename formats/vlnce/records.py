"""The records of VLN-CE episode files, in Habitat coordinates, as the files have them."""

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from ..core.arrays import Array

OUR_KEY = "vlnpe"  # in an episode's `info`: our writer made it
_INSTRUCTION_KEYS = frozenset({"instruction_text", "instruction_tokens"})
_GOAL_KEYS = frozenset({"position", "radius"})
_SCENE_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".usd", ".usda", ".usdc")


@dataclass(frozen=True)
class VlnceGoal:
    """A goal position (3,) in Habitat coordinates [m] and its success radius [m]."""

    position_habitat_m: Array
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
        instruction_tokens: word indices, or None.
        goals: empty in a test split.
        reference_path_habitat_m: (P, 3) [m]; (0, 3) in a test split.
        info: as written, e.g. `geodesic_distance`; RxR has none, but a `role`.
        extra: unknown keys of the episode, as they are.
        source: the episode's JSON as read, so that writing loses nothing; None for new records.
    """

    episode_id: int | str
    trajectory_id: int | str
    scene_id: str
    start_position_habitat_m: Array
    start_rotation_xyzw: Array
    instruction_text: str
    instruction_tokens: tuple[int, ...] | None
    goals: tuple[VlnceGoal, ...]
    reference_path_habitat_m: Array
    info: dict[str, Any] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)
    source: dict[str, Any] | None = field(default=None, repr=False, compare=False)

    @property
    def unknown_keys(self) -> dict[str, Any]:
        """Values of the source inside `instruction` and `goals` beyond the schema, by key.

        `source_instruction` is RxR's language, annotator, word times, …; `source_goals` has one
        object per goal. A key is missing where there is nothing.
        """
        if self.source is None:
            return {}
        other = _without(self.source.get("instruction"), _INSTRUCTION_KEYS)
        goals = [_without(goal, _GOAL_KEYS) for goal in self.source.get("goals") or ()]
        unknown = {"source_instruction": other, "source_goals": goals if any(goals) else None}
        return {key: value for key, value in unknown.items() if value}

    @property
    def scene_stem(self) -> str:
        """The scene's name without folders and file type; `mp3d/X/X.glb` gives `X`."""
        return scene_stem(self.scene_id)

    @property
    def in_repaired_world(self) -> bool:
        """True if our writer made it: its coordinates are those of the repaired world."""
        return OUR_KEY in self.info


@dataclass(frozen=True)
class BadEpisode:
    """An episode of a file that cannot be used.

    Attributes:
        index: its place in the file's list, from 0.
        episode_id: as written; None where there is none.
        reason: one line, without the file's name.
    """

    index: int
    episode_id: Any
    reason: str

    @property
    def name(self) -> str:
        """Its id where it has one, and its place."""
        name = "" if self.episode_id is None else f"{str(self.episode_id)[:40]} "
        return f"{name}(number {self.index})"


@dataclass(frozen=True)
class VlnceFile:
    """An episode file.

    Attributes:
        path: where it was read.
        episodes: the usable ones, in file order.
        vocabulary: the file's `instruction_vocab` as it stands, or None.
        extra: unknown top-level keys, as they are.
        bad: the episodes that cannot be used, in file order.
        keys: the document's top-level keys in their order.
    """

    path: Path
    episodes: tuple[VlnceEpisode, ...]
    vocabulary: dict[str, Any] | None = None
    extra: dict[str, Any] = field(default_factory=dict)
    bad: tuple[BadEpisode, ...] = ()
    keys: tuple[str, ...] = ()

    @property
    def split(self) -> str:
        """The split that the file is named for: `R2R/val_unseen.json.gz` → `val_unseen`.

        RxR's `val_unseen_guide.json.gz` is of `val_unseen`, too.
        """
        return split_name(self.path)


def split_name(path: Path) -> str:
    """Return the split that a file is named for; see `VlnceFile.split`."""
    name = path.name.split(".")[0]
    for role in ("_guide", "_follower"):
        name = name.removesuffix(role)
    return name


def scene_stem(scene_id: str) -> str:
    """Return a scene's name without folders and suffix: `mp3d/X/X.glb` → `X`, `home.v2` stays."""
    path = PurePosixPath(scene_id)
    return path.stem if path.suffix.lower() in _SCENE_SUFFIXES else path.name


def _without(value: Any, schema: frozenset[str]) -> dict[str, Any]:
    return {k: v for k, v in value.items() if k not in schema} if isinstance(value, dict) else {}

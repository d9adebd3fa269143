"""The records of VLN-CE episode files, in Habitat coordinates, as the files have them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

OUR_KEY = "vlnpe"  # in an episode's `info`: our writer made it
_SCENE_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".usd", ".usda", ".usdc")


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

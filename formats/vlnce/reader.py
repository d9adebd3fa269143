"""Strict reading of one VLN-CE episode."""

import json
import math
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.errors import FileFormatError, brief
from ..untrusted.files import is_relative
from .records import BadEpisode, VlnceEpisode, VlnceGoal

_NUMBERS = {"start_position", "start_rotation", "reference_path"}
_KNOWN = _NUMBERS | {"episode_id", "trajectory_id", "scene_id", "info", "goals", "instruction"}


class BadEpisodeError(FileFormatError):
    """One episode of a file is unusable.

    Attributes:
        bad: which one, and why.
    """

    def __init__(self, path: Path, bad: BadEpisode):
        self.bad = bad
        name = bad.episode_id
        where = f"episode {brief(name)}" if name is not None else "an episode without id"
        super().__init__(path, f"{where} (number {bad.index}): {bad.reason}")


class EpisodeReader:
    """Strict reading of one episode; every complaint names file, episode and key."""

    def __init__(self, path: Path, index: int, raw: Any):
        self.path, self.index, self.raw = path, index, raw
        if not isinstance(raw, dict):
            raise self.error("not an object")

    def error(self, reason: str) -> BadEpisodeError:
        """Return the error to raise for `reason`, naming file and episode."""
        name = self.raw.get("episode_id") if isinstance(self.raw, dict) else None
        return BadEpisodeError(self.path, BadEpisode(self.index, name, reason))

    def episode(self) -> VlnceEpisode:
        """Read the whole episode.

        Raises:
            BadEpisodeError: a key is missing or of the wrong kind, or a number is not finite.
        """
        raw = self.raw
        instruction = self._mapping("instruction")
        text = instruction.get("instruction_text")
        if not isinstance(text, str):
            raise self.error("instruction.instruction_text is missing or no string")
        episode = VlnceEpisode(
            episode_id=self._identity("episode_id"),
            trajectory_id=self._identity("trajectory_id"),
            scene_id=self._scene_id(),
            start_position_habitat_m=self._vector(raw.get("start_position"), 3, "start_position"),
            start_rotation_xyzw=self._rotation(),
            instruction_text=text,
            instruction_tokens=self._tokens(instruction.get("instruction_tokens")),
            goals=self._goals(),
            reference_path_habitat_m=self._path_points(),
            info=self._mapping("info", optional=True),
            extra={k: v for k, v in raw.items() if k not in _KNOWN},
            source=raw,
        )
        # Their numbers have been checked, and are most of what an episode holds.
        for key, value in raw.items():
            if key not in _NUMBERS and not writable(value):
                raise self.error(f"{brief(key)} has a number that is not finite")
        return episode

    def _mapping(self, key: str, optional: bool = False) -> dict[str, Any]:
        value = self.raw.get(key)
        if value is None and optional:
            return {}
        if not isinstance(value, dict):
            raise self.error(f"{key} is missing or no object")
        return value

    def _identity(self, key: str) -> int | str:
        value = self.raw.get(key)
        if isinstance(value, bool) or not isinstance(value, int | str):
            raise self.error(f"{key} is missing or neither integer nor string")
        return value

    def _scene_id(self) -> str:
        value = self.raw.get("scene_id")
        if not isinstance(value, str) or not PurePosixPath(value).stem:
            raise self.error("scene_id is missing or no path-like string")
        return value

    def _vector(self, value: Any, length: int, key: str) -> Array:
        self._check(value, length, key)
        return np.array(value, dtype=np.float64)

    def _check(self, value: Any, length: int, key: str) -> None:
        if not isinstance(value, list) or len(value) != length or not all(map(_finite, value)):
            raise self.error(f"{key} must be {length} finite numbers, is {brief(value)}")

    def _rotation(self) -> Array:
        quaternion = self._vector(self.raw.get("start_rotation"), 4, "start_rotation")
        norm = math.hypot(*quaternion.tolist())
        # Public files round to a few digits, so allow for that, not for another convention.
        if abs(norm - 1.0) > 0.01:
            raise self.error(f"start_rotation must have length 1, has {norm:.4f}")
        return quaternion

    def _tokens(self, value: Any) -> tuple[int, ...] | None:
        if value is None:
            return None
        if not isinstance(value, list) or set(map(type, value)) - {int}:
            raise self.error(f"instruction_tokens must be integers, is {brief(value)}")
        return tuple(value)

    def _goals(self) -> tuple[VlnceGoal, ...]:
        value = self.raw.get("goals")
        if value is None:
            return ()
        if not isinstance(value, list) or not all(isinstance(g, dict) for g in value):
            raise self.error("goals must be a list of objects")
        result = []
        for k, goal in enumerate(value):
            radius = goal.get("radius", 3.0)
            if not _finite(radius) or radius <= 0:
                raise self.error(f"goals[{k}].radius must be positive, is {brief(radius)}")
            position = self._vector(goal.get("position"), 3, f"goals[{k}].position")
            result.append(VlnceGoal(position, float(radius)))
        return tuple(result)

    def _path_points(self) -> Array:
        value = self.raw.get("reference_path")
        if value is None:
            return np.zeros((0, 3))
        if not isinstance(value, list):
            raise self.error("reference_path must be a list of positions")
        for k, point in enumerate(value):
            self._check(point, 3, f"reference_path[{k}]")
        return np.array(value, dtype=np.float64).reshape(-1, 3)


def unsafe_scene_id(value: Any) -> bool:
    """Return whether a scene id would lead out of the folder of scenes."""
    return isinstance(value, str) and not is_relative(value)


def writable(value: Any) -> bool:
    """Return whether a JSON value can be written as JSON, which has neither NaN nor infinity."""
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        return False
    return True


def _finite(value: Any) -> bool:
    """Return whether a JSON value is a number that a float can hold."""
    if type(value) is float:
        return math.isfinite(value)
    return type(value) is int and abs(value) < 1 << 1000

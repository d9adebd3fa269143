"""Action and observation spaces of the Gymnasium environment."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..collectors.robots import RobotSpec
from ..formats.core.camera import CameraModel
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError, MissingExtraError, UnknownNameError
from ..formats.core.rollout import Action
from .motions import DISCRETE, VELOCITY
from .observation import NO_ACTION

try:
    from gymnasium import spaces
except ModuleNotFoundError as missing:
    raise MissingExtraError("NavigationEnv", "evaluate") from missing


MODALITIES = (
    "rgb",
    "depth_m",
    "instruction",
    "tokens",
    "pose",
    "proprioception",
    "previous_action",
)


def action_space(kind: str, robot: RobotSpec, waypoints: int) -> spaces.Space[Any]:
    """Return the space of the actions of a `kind`; `waypoints` is how many such an action has."""
    if kind == DISCRETE:
        return spaces.Discrete(len(Action))
    if kind == VELOCITY:
        limits = robot.command_limits
        ranges = np.array([limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s], np.float32)
        numbers = spaces.Box(ranges[:, 0], ranges[:, 1], dtype=np.float32)
    else:
        most = np.tile(np.array([1.0, 1.0, np.pi], np.float32), (waypoints, 1))
        numbers = spaces.Box(-most, most, dtype=np.float32)
    return spaces.Dict({"stop": spaces.Discrete(2), kind: numbers})


def previous_action_space(kind: str, waypoints: int) -> spaces.Space[Any]:
    """Return the space of the action before, as observations show it."""
    if kind == DISCRETE:
        return spaces.Discrete(len(Action) + 1, start=NO_ACTION)
    shape = (3,) if kind == VELOCITY else (waypoints, 3)
    return spaces.Box(-np.inf, np.inf, shape, np.float64)


def observation_space(
    modalities: Sequence[str],
    camera: CameraModel,
    robot: RobotSpec,
    instructions: Sequence[str],
    tokens: Mapping[str, NDArray[np.int64]] | None,
    previous_action: spaces.Space[Any],
) -> spaces.Dict:
    """Return the space of observations.

    Args:
        modalities: names among `MODALITIES` that observations have.
        camera: what `rgb` and `depth_m` show.
        robot: whose joints are in `proprioception`.
        instructions: instructions of all episodes.
        tokens: ids (L,) of each instruction, all of one length; None without `tokens`.
        previous_action: space of that modality.
    """
    shape = (camera.height_px, camera.width_px)
    letters = "".join(sorted(set("".join(instructions)))) or " "
    body = 2 * len(robot.joints) + 9
    infinity = np.inf
    every: dict[str, spaces.Space[Any]] = {
        "rgb": spaces.Box(0, 255, (*shape, 3), np.uint8),
        "depth_m": spaces.Box(0.0, infinity, shape, np.float32),
        "instruction": spaces.Text(
            min_length=0, max_length=max(1, *map(len, instructions)), charset=letters
        ),
        "pose": spaces.Box(-infinity, infinity, (3,), np.float64),
        "proprioception": spaces.Box(-infinity, infinity, (body,), np.float64),
        "previous_action": previous_action,
    }
    if tokens is not None:
        length = next(iter(tokens.values())).shape
        most = max(int(ids.max(initial=0)) for ids in tokens.values())
        every["tokens"] = spaces.Box(0, max(most, 1), length, np.int64)
    return spaces.Dict({name: every[name] for name in modalities})


def chosen_modalities(requested: Sequence[str] | None, has_tokens: bool) -> tuple[str, ...]:
    """Return the modalities that were asked for, in the order of `MODALITIES`; all when None.

    Raises:
        InputError: none, or `tokens` without tokens.
        UnknownNameError: no such modality.
    """
    valid = tuple(name for name in MODALITIES if has_tokens or name != "tokens")
    if requested is None:
        return valid
    for name in requested:
        if name not in valid:
            if name in MODALITIES:
                raise InputError("modality 'tokens' needs `tokenize`")
            raise UnknownNameError("modality", name, valid)
    if not requested:
        raise InputError(f"no modality; valid: one or more of {', '.join(valid)}")
    return tuple(name for name in valid if name in requested)


def token_table(
    episodes: Sequence[Episode], tokenize: Callable[[str], ArrayLike]
) -> dict[str, NDArray[np.int64]]:
    """Return the ids (L,) of each instruction, padded with 0 to the longest."""
    ids = {e.instruction: np.asarray(tokenize(e.instruction), np.int64).ravel() for e in episodes}
    longest = max(1, *(len(tokens) for tokens in ids.values()))
    return {text: np.pad(tokens, (0, longest - len(tokens))) for text, tokens in ids.items()}

"""Kinds of actions that a policy may give: discrete ones, velocities, waypoints."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..collectors.controllers import CONTROLLERS, Motion, Velocity, Waypoints
from ..formats.core.errors import InputError, check_name
from ..formats.core.rollout import Action

DISCRETE, VELOCITY, WAYPOINTS = "discrete", "velocity", "waypoints"
ACTION_KINDS = (DISCRETE, VELOCITY, WAYPOINTS)
FARTHEST_M = 5.0  # of one waypoint from the one before
MOST_WAYPOINTS = 64


def check_kind(kind: str, controller: str) -> None:
    """Raise unless a controller carries out actions of a kind.

    Raises:
        UnknownNameError: there is no such kind.
        InputError: the controller does not; the message names those that do.
    """
    check_name("kind of actions", kind, ACTION_KINDS)
    valid = controllers_for(kind)
    if controller not in valid:
        raise InputError(
            f"controller {controller!r} does not support {kind} actions; valid: {', '.join(valid)}"
        )


def controllers_for(kind: str) -> list[str]:
    """Return the names of the controllers that carry out actions of a kind."""
    entries = CONTROLLERS.items()
    if kind == DISCRETE:
        return [name for name, entry in entries if entry.discrete]
    name = "speed" if kind == VELOCITY else "path"
    return [name]


def checked_motion(answer: Any, kind: str) -> Motion | None:
    """Return a policy's answer as a motion, or None if it stops.

    Args:
        answer: a stop (0, "stop", `Action.STOP`, or a map with a true `stop`), or the numbers,
            alone or in a map under `velocity` or `waypoints`: (3,) vx, vy [m/s], yaw rate [rad/s],
            or (K, 3) Δx, Δy [m], Δyaw [rad], each in the frame of the pose before.
        kind: `VELOCITY` or `WAYPOINTS`.

    Raises:
        ValueError: it is neither; the message names the answer and what is valid.
    """
    if isinstance(answer, Mapping):
        if np.any(answer.get("stop", False)):
            return None
        answer = answer.get(kind)
    if isinstance(answer, str) and answer.upper() == Action.STOP.name:
        return None
    try:
        values = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise _refused(answer, kind) from None
    if values.ndim == 0 and values == Action.STOP:
        return None
    if not np.isfinite(values).all():
        raise _refused(answer, kind)
    if kind == VELOCITY and values.shape == (3,):
        vx, vy, yaw = values.tolist()
        return Velocity((vx, vy, yaw))
    if kind == WAYPOINTS and values.ndim == 2 and values.shape[1] == 3:
        far = np.hypot(values[:, 0], values[:, 1]).max(initial=0.0) > FARTHEST_M
        if 1 <= len(values) <= MOST_WAYPOINTS and not far:
            return Waypoints(tuple((x, y, turn) for x, y, turn in values.tolist()))
    raise _refused(answer, kind)


def numbers_of(motion: Motion) -> NDArray[np.float64]:
    """Return a motion's numbers, (3,) or (K, 3), as `checked_motion` takes them."""
    return np.array(motion.command if isinstance(motion, Velocity) else motion.steps)


def _refused(answer: Any, kind: str) -> ValueError:
    valid = {
        VELOCITY: "three finite numbers: vx, vy [m/s], yaw rate [rad/s]",
        WAYPOINTS: f"(K, 3) finite numbers, K from 1 to {MOST_WAYPOINTS}: Δx, Δy [m, at most "
        f"{FARTHEST_M:g} together], Δyaw [rad]",
    }[kind]
    return ValueError(f"{kind} {answer!r:.80}; valid: {valid}, or a stop (0)")

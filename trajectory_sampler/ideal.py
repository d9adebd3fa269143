"""The actions of VLN-CE's ideal agent along a path: exactly 0.25 m and 15° each, no physics."""

import math

import numpy as np
from numpy.typing import NDArray

from ..formats.core.geometry import path_length, point_along
from ..formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action

_SPACING_M = 0.05
_AHEAD = 10  # points: it aims half a metre ahead
_SEARCH = 20  # points: where on the path it is lies at most this far ahead of where it was


def ideal_actions(path_m: NDArray[np.float64], start_yaw_rad: float) -> list[int]:
    """Return the discrete actions along a path (P, 2 or 3) [m], ending with STOP.

    The agent aims 0.5 m ahead on the path and turns while that is off by more than half a turn (a
    whole one to undo its last turn), as the expert does that labels recorded walks. It stops at the
    goal, or where the next step would lead away from it.
    """
    length = path_length(path_m)
    along = np.linspace(0.0, length, max(2, round(length / _SPACING_M) + 1))
    points = point_along(np.asarray(path_m)[:, :2], along)
    goal, last = points[-1], len(points) - 1
    (x, y), yaw, at, turned = points[0], start_yaw_rad, 0, Action.FORWARD
    actions: list[int] = []
    # Every metre takes four steps; turns add to them, and nothing can go on for ever.
    for _ in range(50 + 20 * max(1, round(length / FORWARD_STEP_M))):
        window = points[at : at + _SEARCH]
        at += int(np.argmin(np.hypot(window[:, 0] - x, window[:, 1] - y)))
        to_goal = math.hypot(goal[0] - x, goal[1] - y)
        ahead = x + FORWARD_STEP_M * math.cos(yaw), y + FORWARD_STEP_M * math.sin(yaw)
        after = math.hypot(goal[0] - ahead[0], goal[1] - ahead[1])
        near_end = last - at <= _AHEAD
        if near_end and (to_goal <= 0.1 or (to_goal <= FORWARD_STEP_M and after >= to_goal)):
            break
        aim = points[min(at + _AHEAD, last)]
        error = math.remainder(math.atan2(aim[1] - y, aim[0] - x) - yaw, math.tau)
        turn = Action.LEFT if error > 0 else Action.RIGHT
        enough = 0.5 if turned in (Action.FORWARD, turn) else 1.0
        if abs(error) > enough * TURN_STEP_RAD:
            yaw += TURN_STEP_RAD * (1 if turn == Action.LEFT else -1)
            actions.append(int(turn))
            turned = turn
        else:
            x, y = ahead
            actions.append(int(Action.FORWARD))
            turned = Action.FORWARD
    return [*actions, int(Action.STOP)]

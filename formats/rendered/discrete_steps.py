"""Discrete steps of a recorded walk: which frame precedes which of VLN-CE's actions.

A robot that walks continuously passes no frame exactly where a discrete action ends. Its walk is
therefore divided as a whole: of all sequences of 0.25 m steps and 15° turns the one is chosen whose
execution from the start stays closest to the robot (see `step_search`), under the condition that it
turns about as much as the robot does. So no rounding error adds up: executing the actions ends
where the robot did.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.frames import quat_to_yaw
from ..core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from .step_search import StepCost, TimedActions, Walk, search_steps

# A motion this near to an exact action is one, in units of the action's displacement.
_EXACT = 0.01
# Searched one after another until the total turning agrees, each with so many prices of a turn.
_COSTS = (
    *(StepCost(), StepCost(heading=0.15), StepCost(heading=1.5), StepCost(offset=0.3)),
    # Swings just short of a turn add up to an end that no turn at all misses.
    StepCost(heading=0.15, end_offset=4.0),
)
_PRICES = 6
_END_M = 0.4  # tolerated distance between the ends, as one turn is of the total turning


@dataclass(frozen=True)
class DiscreteSteps:
    """A walk of N frames as M discrete steps.

    Attributes:
        frame: (M,) number of the frame that precedes each action, ascending; one frame may precede
            several actions, and frames between two steps precede none. The last is frame N − 1.
        action: (M,) values of `Action`; STOP is the last one and no other.
        pose: (M, 3) x, y [m] and unwrapped yaw [rad] before each action, of an agent that executes
            the actions exactly from the first frame's pose.
    """

    frame: NDArray[np.int64]
    action: NDArray[np.int64]
    pose: NDArray[np.float64]


def planar_poses(state: NDArray) -> NDArray[np.float64]:
    """Return x, y [m] and yaw [rad] (T, 3) in the start frame, from `observation.state` (T, 13)."""
    return np.column_stack([state[:, :2].astype(np.float64), quat_to_yaw(state[:, 3:7])])


def total_turning(yaw_rad: NDArray[np.float64], turn_rad: float = TURN_STEP_RAD) -> float:
    """Return the sum of all swings [rad] of a heading (N,), N ≥ 1, wrapped or not.

    A swing is a change between two extremes of at least one turn action; what is smaller, as a
    gait's sway, belongs to the swing around it.
    """
    yaw_rad = np.unwrap(yaw_rad).astype(np.float64)
    least = turn_rad - 1e-6
    total, low, high = 0.0, float(yaw_rad[0]), float(yaw_rad[0])
    sense = 0
    for yaw in yaw_rad.tolist():
        if sense >= 0 and yaw <= high - least:
            total += high - low if sense else 0.0
            sense, low = -1, yaw
        elif sense <= 0 and yaw >= low + least:
            total += high - low if sense else 0.0
            sense, high = 1, yaw
        elif sense >= 0 and yaw > high:
            high = yaw
        elif sense <= 0 and yaw < low:
            low = yaw
    return total + (high - low if sense else 0.0)


def discrete_steps(poses: NDArray[np.float64], turn_rad: float = TURN_STEP_RAD) -> DiscreteSteps:
    """Divide a walk into discrete steps.

    A walk that consists of whole discrete actions, one per frame, gives these very actions.

    Args:
        poses: (N, 3) x, y [m] and yaw [rad] at each frame, N ≥ 1.
        turn_rad: angle of LEFT and RIGHT.
    """
    walk = np.asarray(poses, np.float64).copy()
    walk[:, 2] = np.unwrap(walk[:, 2])
    taken = _whole_actions(walk, turn_rad)
    if taken is None:
        taken = _nearest_actions(walk, turn_rad)
    actions = np.append(taken.action, int(Action.STOP))
    before = execute(actions, walk[0], turn_rad)[:-1]
    return DiscreteSteps(_frames(walk, before, taken.frame, turn_rad), actions, before)


def _whole_actions(walk: NDArray[np.float64], turn_rad: float) -> TimedActions | None:
    """Return the actions of a walk with one exact action or none after each frame, else None."""
    dx, dy, turned = np.diff(walk, axis=0).T
    c, s = np.cos(walk[:-1, 2]), np.sin(walk[:-1, 2])
    motion = np.column_stack([c * dx + s * dy, c * dy - s * dx, turned])
    motion /= (FORWARD_STEP_M, FORWARD_STEP_M, turn_rad)
    known = {None: (0, 0, 0), Action.FORWARD: (1, 0, 0), Action.LEFT: (0, 0, 1)}
    known |= {Action.RIGHT: (0, 0, -1)}
    off = np.abs(motion[:, None] - np.array(list(known.values()))).max(axis=2)
    if len(off) and off.min(axis=1).max() > _EXACT:
        return None
    which = off.argmin(axis=1)
    at = np.flatnonzero(which)
    values = np.array([int(action or 0) for action in known])
    return TimedActions(values[which[at]].astype(np.int64), (at + 1.0).astype(np.float64))


def _nearest_actions(walk: NDArray[np.float64], turn_rad: float) -> TimedActions:
    """Return actions that follow a walk closely and turn about as much.

    The dearer a turn, the fewer there are, so its price is bisected. Turns come and go in groups,
    at prices that depend on the weight of the heading.
    """
    nodes, wanted = Walk.of(walk, turn_rad), total_turning(walk[:, 2], turn_rad)
    best, least = None, math.inf  # the actions with the least misfit; 1 is what is tolerated
    for cost in _COSTS:
        low, high = 0.0, math.inf
        for _ in range(_PRICES):
            taken = search_steps(nodes, cost)
            excess = turn_rad * float((taken.action != Action.FORWARD).sum()) - wanted
            end = execute(taken.action, walk[0], turn_rad)[-1]
            misfit = max(abs(excess) / turn_rad, math.dist(end[:2], walk[-1, :2]) / _END_M)
            if misfit < least - 1e-6:
                best, least = taken, misfit
            if least <= 0.5:
                break
            low, high = (cost.turn, high) if excess > 0 else (low, cost.turn)
            turn = 2.0 * low if high == math.inf else 0.5 * (low + high)
            cost = replace(cost, turn=turn)
        if least <= 1.0:
            break
    assert best is not None
    return best


def _frames(
    walk: NDArray[np.float64],
    before: NDArray[np.float64],
    complete: NDArray[np.float64],
    turn_rad: float,
) -> NDArray[np.int64]:
    """Return the frame (M,) that shows best what an agent sees before each action.

    Of the frames between the completion of the action before and that of the action itself, the one
    whose pose is nearest to the agent's.

    Args:
        walk: (N, 3) pose at each frame.
        before: (M, 3) agent's pose before each action, STOP included.
        complete: (M − 1,) when each action but STOP is complete [frames].
    """
    last = len(walk) - 1
    frames, first = [], 0
    since = np.concatenate([[0.0], complete])
    for pose, start, stop in zip(before[:-1], since, complete, strict=False):
        low = min(max(first, math.floor(start)), max(last - 1, 0))
        near = walk[low : max(min(math.ceil(stop) - 1, last - 1), low) + 1]
        off = np.hypot(*(near[:, :2] - pose[:2]).T) / FORWARD_STEP_M
        first = low + int(np.argmin(off + np.abs(near[:, 2] - pose[2]) / turn_rad))
        frames.append(first)
    return np.array([*frames, last])


def execute(
    actions: NDArray[np.int64],
    start_xy_yaw: NDArray[np.float64],
    turn_rad: float = TURN_STEP_RAD,
) -> NDArray[np.float64]:
    """Return poses (M + 1, 3), x, y [m] and unwrapped yaw [rad], through which M actions lead."""
    turns = np.select([actions == Action.LEFT, actions == Action.RIGHT], [1.0, -1.0], 0.0)
    yaw = start_xy_yaw[2] + turn_rad * np.concatenate([[0.0], np.cumsum(turns)])
    steps = FORWARD_STEP_M * (actions == Action.FORWARD)[:, None]
    steps = steps * np.stack([np.cos(yaw[:-1]), np.sin(yaw[:-1])], axis=1)
    xy = start_xy_yaw[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([xy, yaw])

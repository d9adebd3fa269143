"""Discrete steps of a recorded walk: which frame precedes which of VLN-CE's actions.

A robot that walks continuously passes no frame exactly where a discrete action ends. Its walk is
therefore rounded as a whole: an ideal agent, which only knows steps of 0.25 m and turns of 15°, is
led along it and takes an action as soon as that brings it nearer to the robot. What an action
leaves over is carried into the next one, and the distance to the robot's line is steered away once
it is considerable. So nothing adds up: executing the actions from the start ends where the robot
did.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.frames import quat_to_yaw
from ..core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action

# A turn is taken when the heading is off by this part of one, and by the second one when it would
# undo the last turn: gaits sway, and rounding must not answer every sway.
_TURN_FROM, _TURN_BACK_FROM = 0.55, 0.85
# Farther than this beside the robot's line the agent steers back to it, aiming so far ahead.
_BESIDE_M, _AIM_M = 0.3, 2.0
_PARTS = 8  # the walk between two frames is looked at so many times


@dataclass(frozen=True)
class DiscreteSteps:
    """A walk of N frames as M discrete steps.

    Attributes:
        frame: (M,) number of the frame that precedes each action, ascending; one frame may precede
            several actions, and frames between two steps precede none. The last is frame N − 1.
        action: (M,) values of `Action`; STOP is the last one and no other.
        pose: (M, 3) x, y [m] and unwrapped yaw [rad] of the ideal agent before each action.
    """

    frame: NDArray[np.int64]
    action: NDArray[np.int64]
    pose: NDArray[np.float64]


def planar_poses(state: NDArray) -> NDArray[np.float64]:
    """x, y [m] and yaw [rad] (T, 3) in the start frame, from `observation.state` (T, 13)."""
    return np.column_stack([state[:, :2].astype(np.float64), quat_to_yaw(state[:, 3:7])])


def discrete_steps(poses: NDArray[np.float64]) -> DiscreteSteps:
    """Divide a walk into discrete steps.

    A walk that consists of whole discrete actions, one per frame, gives these very actions.

    Args:
        poses: (N, 3) x, y [m] and yaw [rad] at each frame, N ≥ 1, at 4 frames/s or more.
    """
    walk = np.asarray(poses, np.float64).copy()
    walk[:, 2] = np.unwrap(walk[:, 2])
    last = len(walk) - 1
    agent = _Agent(*walk[0].tolist())
    at = np.arange(last * _PARTS + 1) / _PARTS
    between = np.stack([np.interp(at, np.arange(last + 1), column) for column in walk.T], axis=1)
    for time, (x, y, yaw) in zip(at.tolist(), between.tolist(), strict=True):
        agent.follow(time, x, y, yaw)
    agent.face(float(last), float(walk[-1, 2]))
    before = np.array(agent.poses)
    # The frame that shows best what the agent sees before an action, of those between the action
    # before and this one.
    frames, first = [], 0
    since = [0.0, *agent.times]
    for pose, start, stop in zip(before[:-1], since, agent.times, strict=False):
        low = min(max(first, math.floor(start)), max(last - 1, 0))
        near = walk[low : max(min(math.ceil(stop), last - 1), low) + 1]
        off = np.hypot(*(near[:, :2] - pose[:2]).T) / FORWARD_STEP_M
        first = low + int(np.argmin(off + np.abs(near[:, 2] - pose[2]) / TURN_STEP_RAD))
        frames.append(first)
    return DiscreteSteps(
        np.array([*frames, last]), np.array([*agent.actions, int(Action.STOP)]), before
    )


class _Agent:
    """Takes discrete actions to stay with a robot."""

    def __init__(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        self._x, self._y, self._yaw = x_m, y_m, yaw_rad
        self._turned = 0
        self.poses = [(x_m, y_m, yaw_rad)]
        self.actions: list[int] = []
        self.times: list[float] = []

    def follow(self, time: float, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Take all actions that are due when the robot is at a pose."""
        while True:
            c, s = math.cos(self._yaw), math.sin(self._yaw)
            dx, dy = x_m - self._x, y_m - self._y
            left = c * dy - s * dx
            beside = math.copysign(max(abs(left) - _BESIDE_M, 0.0), left)
            off = (yaw_rad - self._yaw + math.atan2(beside, _AIM_M)) / TURN_STEP_RAD
            sense = 1 if off > 0 else -1
            if abs(off) > (_TURN_BACK_FROM if sense == -self._turned else _TURN_FROM):
                self._turn(time, sense)
            elif c * dx + s * dy > 0.5 * FORWARD_STEP_M:
                self._x += FORWARD_STEP_M * c
                self._y += FORWARD_STEP_M * s
                self._done(time, Action.FORWARD)
            else:
                return

    def face(self, time: float, yaw_rad: float) -> None:
        """Turn to the heading nearest to `yaw_rad`."""
        off = round((yaw_rad - self._yaw) / TURN_STEP_RAD)
        for _ in range(abs(off)):
            self._turn(time, 1 if off > 0 else -1)

    def _turn(self, time: float, sense: int) -> None:
        self._turned = sense
        self._yaw += sense * TURN_STEP_RAD
        self._done(time, Action.LEFT if sense > 0 else Action.RIGHT)

    def _done(self, time: float, action: Action) -> None:
        self.poses.append((self._x, self._y, self._yaw))
        self.actions.append(int(action))
        self.times.append(time)


def execute(actions: NDArray[np.int64], start_xy_yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (M + 1, 3), x, y [m] and unwrapped yaw [rad], through which M exact actions lead."""
    turns = np.select([actions == Action.LEFT, actions == Action.RIGHT], [1.0, -1.0], 0.0)
    yaw = start_xy_yaw[2] + TURN_STEP_RAD * np.concatenate([[0.0], np.cumsum(turns)])
    steps = FORWARD_STEP_M * (actions == Action.FORWARD)[:, None]
    steps = steps * np.stack([np.cos(yaw[:-1]), np.sin(yaw[:-1])], axis=1)
    xy = start_xy_yaw[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([xy, yaw])

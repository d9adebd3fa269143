"""Search for the discrete actions whose execution stays closest to a recorded walk.

The pose of an agent that executes the actions exactly is compared with the robot's at every
instant, so that what an action rounds off is fed back into the choice of the following ones. The
choice is global (dynamic programming over the whole walk): between the multiples of 15° that an
agent can head for, the search picks the moments of turning such that deviations cancel.

The agent's offset from the robot is divided into cells, and of the action sequences that lead into
one cell the cheapest is kept, with its exact pose, as in hybrid A* (Dolgov et al., "Practical
Search Techniques in Path Planning for Autonomous Driving", 2008).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.rollout import FORWARD_STEP_M, TURN_STEP_RAD
from ..process.kernel import kernel

_HEADINGS = 5  # multiples of 15° around the robot's heading that are tried
_CELL, _CELLS = 0.25, 21  # size of an offset's cell in FORWARD steps, and their number per axis
_MARGIN = 4.0  # partial sequences costlier than the best one by more are dropped
_MOTION_PER_NODE = 0.6  # at most one action is taken per node of the walk


@dataclass(frozen=True)
class StepCost:
    """Weights of deviations and turns, in units of one action's displacement.

    Attributes:
        offset: squared distance [0.25 m] between agent and robot, per action's worth of motion.
        heading: squared difference of heading [turns], per action's worth of motion.
        turn: each turn.
        end_offset: squared distance at the end.
        end_heading: squared difference of heading at the end.
    """

    offset: float = 0.1
    heading: float = 0.5
    turn: float = 0.5
    end_offset: float = 1.0
    end_heading: float = 2.0


@dataclass(frozen=True)
class TimedActions:
    """Actions and when they are taken.

    Attributes:
        action: (M,) int64 values of `Action`, without a STOP.
        frame: (M,) float64 when each is complete, in frames since the first.
    """

    action: NDArray[np.int64]
    frame: NDArray[np.float64]


@dataclass(frozen=True)
class Walk:
    """A walk divided into nodes between which the robot moves by a fraction of an action.

    Attributes:
        frame: (T,) float64 time of each node, in frames since the first.
        pose: (T, 3) float64 x, y [0.25 m] and heading [turns] in the first pose's frame.
        motion: (T,) float64 motion since the node before, in actions.
        turn_rad: angle of a turn action.
    """

    frame: NDArray[np.float64]
    pose: NDArray[np.float64]
    motion: NDArray[np.float64]
    turn_rad: float

    @staticmethod
    def of(poses: NDArray[np.float64], turn_rad: float = TURN_STEP_RAD) -> "Walk":
        """Divide the walk through poses (N, 3), x, y [m] and unwrapped yaw [rad], N ≥ 1."""
        c, s = np.cos(poses[0, 2]), np.sin(poses[0, 2])
        xy = (poses[:, :2] - poses[0, :2]) @ np.array([[c, -s], [s, c]]) / FORWARD_STEP_M
        units = np.column_stack([xy, (poses[:, 2] - poses[0, 2]) / turn_rad])
        moved = np.abs(np.diff(units, axis=0))
        motion = np.hypot(moved[:, 0], moved[:, 1]) + moved[:, 2]
        parts = np.maximum(np.ceil(motion / _MOTION_PER_NODE), 1).astype(np.int64)
        ends = np.repeat(np.cumsum(parts), parts)
        done = (np.arange(1, len(ends) + 1) - ends + np.repeat(parts, parts)) / np.repeat(
            parts, parts
        )
        frame = np.concatenate([[0.0], np.repeat(np.arange(len(parts)), parts) + done])
        at = np.arange(len(units))
        pose = np.stack([np.interp(frame, at, column) for column in units.T], axis=1)
        return Walk(
            frame, pose, np.concatenate([[0.0], np.repeat(motion / parts, parts)]), turn_rad
        )


def search_steps(walk: Walk, cost: StepCost) -> TimedActions:
    """Find the actions that follow `walk` at the least cost."""
    weights = np.array([cost.offset, cost.heading, cost.turn, cost.end_offset, cost.end_heading])
    taken = _search(walk.pose, walk.motion, weights, walk.turn_rad)
    at = np.flatnonzero(taken)
    return TimedActions(taken[at].astype(np.int64), walk.frame[at])


@kernel()
def _search(pose, motion, weights, turn_rad):
    """Return the action (T,) taken at each node of a walk, 0 for none."""
    nodes, half = len(pose), _CELLS // 2
    states = _HEADINGS * _CELLS * _CELLS
    parent = np.full((nodes, states), -1, np.int32)
    action = np.zeros((nodes, states), np.uint8)
    cost, new_cost = np.full(states, np.inf), np.empty(states)
    x, y, new_x, new_y = np.zeros(states), np.zeros(states), np.zeros(states), np.zeros(states)
    ahead_x, ahead_y = np.empty(_HEADINGS), np.empty(_HEADINGS)
    origin = -(_HEADINGS // 2)
    cost[(_HEADINGS // 2 * _CELLS + half) * _CELLS + half] = 0.0
    for t in range(1, nodes):
        px, py, heading = pose[t, 0], pose[t, 1], pose[t, 2]
        new_origin = int(np.round(heading)) - _HEADINGS // 2
        new_cost[:] = np.inf
        limit = cost.min() + _MARGIN
        for row in range(_HEADINGS):
            ahead_x[row] = np.cos((origin + row) * turn_rad)
            ahead_y[row] = np.sin((origin + row) * turn_rad)
        for s in range(states):
            if cost[s] > limit:
                continue
            row = s // (_CELLS * _CELLS)
            for a in range(4):
                new_row = row + origin - new_origin
                nx, ny, price = x[s], y[s], cost[s]
                if a == 1:
                    nx += ahead_x[row]
                    ny += ahead_y[row]
                elif a > 1:
                    new_row += 1 if a == 2 else -1
                    price += weights[2]
                if new_row < 0 or new_row >= _HEADINGS:
                    continue
                ex, ey, off = nx - px, ny - py, new_row + new_origin - heading
                price += motion[t] * (weights[0] * (ex * ex + ey * ey) + weights[1] * off * off)
                i = min(max(int(np.floor(ex / _CELL + 0.5)) + half, 0), _CELLS - 1)
                j = min(max(int(np.floor(ey / _CELL + 0.5)) + half, 0), _CELLS - 1)
                n = (new_row * _CELLS + i) * _CELLS + j
                if price < new_cost[n]:
                    new_cost[n], new_x[n], new_y[n] = price, nx, ny
                    parent[t, n], action[t, n] = s, a
        cost, new_cost = new_cost, cost
        x, new_x, y, new_y = new_x, x, new_y, y
        origin = new_origin
    best, least = -1, np.inf
    for s in range(states):
        k = origin + s // (_CELLS * _CELLS)
        ex, ey, off = x[s] - pose[-1, 0], y[s] - pose[-1, 1], k - pose[-1, 2]
        price = cost[s] + weights[3] * (ex * ex + ey * ey) + weights[4] * off * off
        if price < least:
            best, least = s, price
    taken = np.zeros(nodes, np.uint8)
    for t in range(nodes - 1, 0, -1):
        taken[t] = action[t, best]
        best = parent[t, best]
    return taken

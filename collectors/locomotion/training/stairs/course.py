"""Where robots in training stand and go: anywhere on a terrain, or along lanes of stairs."""

import numpy as np
from numpy.typing import NDArray

from .....formats.core.arrays import Array, Mask
from .....formats.core.frames import wrap_angle
from ...trials.seen_ground import SeenGround
from ...trials.terrain import LANE_M, Terrain
from ...trials.trial import STEP_S

SHARE_LEVEL = 0.05  # of the robots walk on level ground beside the stairs
FIRST_LANES = 4  # robots begin on the lowest ones
LEVEL_M = 8.0  # half its side
SPEED_M_S, SHARE_STOPS, SPEED_S = (0.25, 0.6), 0.12, 5.0  # on stairs, redrawn so often
HEADING_GAIN, SIDE_GAIN, SIDE_M_S = 2.5, 2.0, 0.25  # as of `PathController`
ASKEW_RAD = 0.8  # a robot turned farther turns on the spot
# Of the commanded way, what counts as climbed and as stuck; on the way slopes and turns take some.
CLIMBED, STUCK, LEAST_M = 0.5, 0.35, 1.5


class Course:
    """Robots anywhere on a terrain, under any commands.

    Attributes:
        ground: the terrain as robots see it.
    """

    def __init__(self, terrain: Terrain, count: int, rng: np.random.Generator) -> None:
        self.terrain, self.rng = terrain, rng
        self.ground = SeenGround(terrain, count, rng)

    def place(self, robots: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return where robots start, (K, 2) [m], and their headings (K,) [rad]."""
        self.ground.renew(robots)
        reach, count = min(self.terrain.half_m - 1.0, 10.0), len(robots)
        xy = self.rng.uniform(-reach, reach, (count, 2))
        return xy, self.rng.uniform(-np.pi, np.pi, count)

    def left(self, pose: Array) -> Mask:
        """Return which robots at poses (N, 3) x, y [m], heading [rad] have left it."""
        return np.abs(pose[:, :2]).max(axis=1) > self.terrain.half_m

    def steer(self, target: Array, pose: Array) -> None:
        """Overwrite those of the commands (N, 3) that follow from poses (N, 3)."""

    def finish(self, robots: NDArray[np.intp], pose: Array, fell: Mask) -> None:
        """Take note of episodes that end at poses (N, 3), some of them by a fall, (N,)."""

    def take_walks(self) -> NDArray[np.int64]:
        """Return how many episodes of each lane climbed, and ended, (L, 2), since the last call."""
        return np.zeros((0, 2), dtype=np.int64)


class Stairs(Course):
    """Robots that each walk along a lane of stairs, and some on level ground beside them.

    One that climbed goes on to the next lane, with higher risers; one that fell or was stuck to the
    lane before.

    Attributes:
        lane: (N,) index of each robot's lane; −1 on level ground.
    """

    def __init__(self, terrain: Terrain, count: int, rng: np.random.Generator) -> None:
        super().__init__(terrain, count, rng)
        lane = rng.integers(min(FIRST_LANES, len(terrain.lanes)), size=count)
        self.lane = np.where(np.arange(count) < SHARE_LEVEL * count, -1, lane)
        # Of each robot: middle of its lane, direction along it, where it began, how far it should
        # have come, and its speed.
        self._y, self._direction, self._x, self._due, self._speed = np.zeros((5, count))
        self._walks = np.zeros((len(terrain.lanes), 2), dtype=np.int64)

    def place(self, robots: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return where robots start: before a flight up, or on the landing before one down."""
        self.ground.renew(robots)
        rng, lanes = self.rng, self.terrain.lanes
        xy = rng.uniform(-LEVEL_M, LEVEL_M, (len(robots), 2))
        xy[:, 1] -= 0.5 * self.terrain.size_m + 2 * LEVEL_M
        yaw = rng.uniform(-np.pi, np.pi, len(robots))
        self._draw_speed(robots)
        for k, i in enumerate(robots):
            if self.lane[i] < 0:
                continue
            lane = lanes[self.lane[i]]
            hill, ahead = rng.integers(len(lane.foot_m)), rng.choice([-1.0, 1.0])
            if rng.random() < 0.6:
                begin = (lane.foot_m if ahead > 0 else lane.head_m)[hill]
                x = begin - ahead * rng.uniform(0.4, 1.0)
            else:
                x = 0.5 * (lane.foot_m + lane.head_m)[hill] + rng.uniform(-0.3, 0.3)
            self._direction[i], self._y[i], self._x[i], self._due[i] = ahead, lane.y_m, x, 0.0
            xy[k] = x, lane.y_m + 0.3 * LANE_M * rng.uniform(-1, 1)
            yaw[k] = (0.0 if ahead > 0 else np.pi) + 0.5 * ASKEW_RAD * rng.uniform(-1, 1)
        return xy, yaw

    def left(self, pose: Array) -> Mask:
        """Return which robots have left their lane, to the sides or at its ends."""
        ends = np.abs(pose[:, 0]) > 0.5 * self.terrain.size_m - 1.5
        aside = np.abs(pose[:, 1] - self._y) > 0.45 * LANE_M
        return (self.lane >= 0) & (ends | aside)

    def steer(self, target: Array, pose: Array) -> None:
        """Command robots on stairs along the middle of their lane."""
        again = self.rng.random(len(target)) < STEP_S / SPEED_S
        self._draw_speed(np.flatnonzero(again))
        on = self.lane >= 0
        direction, speed = self._direction[on], self._speed[on]
        turn = wrap_angle(np.where(direction > 0, 0.0, np.pi) - pose[on, 2])
        side = SIDE_GAIN * direction * (self._y[on] - pose[on, 1])
        ahead = np.abs(turn) < ASKEW_RAD
        command = np.column_stack(
            [speed * ahead, np.clip(side, -SIDE_M_S, SIDE_M_S) * ahead, HEADING_GAIN * turn]
        )
        command[:, 2] = np.clip(command[:, 2], -1.0, 1.0)
        target[on] = np.where(speed[:, None] > 0.0, command, 0.0)
        self._due[on] += target[on, 0] * STEP_S

    def _draw_speed(self, robots: NDArray[np.intp]) -> None:
        speed = self.rng.uniform(*SPEED_M_S, len(robots))
        self._speed[robots] = np.where(self.rng.random(len(robots)) < SHARE_STOPS, 0.0, speed)

    def finish(self, robots: NDArray[np.intp], pose: Array, fell: Mask) -> None:
        """Give robots whose episode ends the lane of their next one."""
        way = self._direction * (pose[:, 0] - self._x)
        for i in robots:
            if self.lane[i] < 0 or (self._due[i] < LEAST_M and not fell[i]):
                continue
            climbed = bool(not fell[i] and way[i] > CLIMBED * self._due[i])
            worse = fell[i] or way[i] < STUCK * self._due[i]
            self._walks[self.lane[i]] += np.array([climbed, 1])
            lane = max(self.lane[i] + (1 if climbed else -1 if worse else 0), 0)
            # Those that climb the last one go on anywhere.
            most = len(self.terrain.lanes)
            self.lane[i] = lane if lane < most else self.rng.integers(most)

    def take_walks(self) -> NDArray[np.int64]:
        """Return how many episodes of each lane climbed, and ended, (L, 2), since the last call."""
        walks, self._walks = self._walks, np.zeros_like(self._walks)
        return walks


def course(terrain: Terrain, count: int, rng: np.random.Generator) -> Course:
    """Return the course over a terrain for so many robots."""
    return (Stairs if terrain.lanes else Course)(terrain, count, rng)

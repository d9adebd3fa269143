"""Drive a robot by your own controller: python examples/own_controller.py SCENE EPISODES.

Poses in, velocity commands out; a controller sees no images. For those see `own_policy.py`.
"""

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vlnpe.collectors.controllers import CONTROLLERS, STOPPED, ControllerEntry, Decision, Pose, Task
from vlnpe.collectors.replay.replay import ReplayConfig, replay_episode
from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.formats.vlnce.files import read_episodes


@dataclass(frozen=True)
class BeelineConfig:
    """Settings of the controller."""

    speed_m_s: float = 0.4
    turn_gain_per_s: float = 1.5


class Beeline:
    """Head straight for the goal, whatever stands in the way."""

    rate_hz = 10

    def __init__(self, task: Task, config: BeelineConfig) -> None:
        self._task, self._config = task, config
        steps_m = np.linalg.norm(np.diff(task.reference_xy_m, axis=0), axis=1)
        self.nominal_s = float(steps_m.sum()) / config.speed_m_s + 5.0

    def step(self, time_s: float, pose: Pose) -> Decision:
        dx, dy = self._task.goal_xy_m - (pose.x_m, pose.y_m)
        if math.hypot(dx, dy) < self._task.goal_tolerance_m / 2:
            return Decision(STOPPED, done=True)
        off_rad = math.remainder(math.atan2(dy, dx) - pose.yaw_rad, math.tau)
        forward = self._config.speed_m_s * max(math.cos(off_rad), 0.0)
        command = np.array([forward, 0.0, self._config.turn_gain_per_s * off_rad])
        vx, vy, yaw = self._task.limits.clip(command)
        return Decision((float(vx), float(vy), float(yaw)))


@dataclass(frozen=True)
class BeelineReplay(ReplayConfig):
    """A replay that knows the settings of `beeline`: the field is named like the controller."""

    beeline: BeelineConfig = field(default_factory=BeelineConfig)


def main(scene: Path, episodes: Path, robot: str = "jetbot") -> None:
    CONTROLLERS["beeline"] = ControllerEntry("straight to the goal", BeelineConfig, Beeline)
    bundle = load_bundle(scene)
    for episode in read_episodes(episodes):
        config = BeelineReplay(robot=robot, controller="beeline")
        rollout = replay_episode(bundle, episode, config)
        print(f"{episode.episode_id}: {rollout.end_reason}, {rollout.time_s[-1]:.1f} s")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

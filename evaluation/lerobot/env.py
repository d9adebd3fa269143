"""The closed loop in the form that LeRobot evaluates: images and state out, motions in."""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ...collectors.controllers.steered import SteeredConfig
from ...collectors.physics.outcome import OutcomeConfig
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.core.frames import quat_to_yaw
from ...formats.core.rollout import Action
from ...formats.rendered.table import StartFrame
from ...rendering.camera.views import View
from ...rendering.registry import scene_renderer_name
from ..env import NavigationEnv
from ..motions import VELOCITY

log = logging.getLogger(__name__)

FPS = round(1.0 / SteeredConfig.action_s)  # of datasets whose actions can be carried out
MOST_STEPS = OutcomeConfig.timeout_actions + 1  # the last one ends an episode as a timeout
STATE_SIZE = 13  # of `observation.state`
# Recorded robots move less than this in a frame only where they have come to rest at the goal: in
# one or two frames at the end of each of eight walks of the Aliengo and the Jetbot.
STILL_M, STILL_RAD, STILL_ACTIONS = 0.03, math.radians(3.0), 2


class LeRobotEnv(gym.Env[dict[str, Any], Any]):
    """Follow instructions in several scenes, driven by the motions of a LeRobot policy.

    An action is `action` of our datasets: Δx, Δy [m] and Δyaw [rad] until the next frame. It is
    carried out as a velocity of the controller `speed` for 0.25 s. The second action in a row that
    is shorter than `STILL_M` and `STILL_RAD` is STOP.

    Observations are `pixels.rgb` (H, W, 3) uint8 and `agent_pos` (13,) float32, which is
    `observation.state`. Everything else is that of `NavigationEnv`, and `info["is_success"]` that
    of `vlnpe evaluate`. The episode of a reset with a seed is `seed` modulo the number of episodes,
    so that consecutive seeds visit all of them. A scene is opened when one of its episodes begins.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array"],
        "render_fps": FPS,
    }
    render_mode = "rgb_array"
    _max_episode_steps = MOST_STEPS

    def __init__(
        self, episodes: Sequence[Episode], scenes: Path, robot: str, view: View, renderer: str
    ) -> None:
        """Remember what to open; nothing is opened yet.

        Args:
            episodes: Episodes of any scenes and levels.
            scenes: Folder of the repaired scenes.
            robot: Name, or folder of one's own robot.
            view: The robot's own camera.
            renderer: Name of a renderer, or `auto`.

        Raises:
            InputError: If there is no episode, or a scene is missing.
        """
        if not episodes:
            raise InputError("no episodes; valid: one or more")
        for name in sorted({episode.scene_id for episode in episodes}):
            if not (scenes / name).is_dir():
                raise InputError(f"{scenes / name}: no such scene; `vlnpe repair` makes it")
        self._episodes, self._scenes = tuple(episodes), scenes
        self._robot, self._view, self._renderer = robot, view, renderer
        self._env: NavigationEnv | None = None
        self._group: tuple[object, ...] = ()
        self._episode: Episode | None = None
        self._still, self._startable = 0, True
        size = (view.camera.height_px, view.camera.width_px, 3)
        self._seen = {
            "pixels": {"rgb": np.zeros(size, np.uint8)},
            "agent_pos": np.zeros(STATE_SIZE, np.float32),
        }
        self.observation_space = spaces.Dict(
            {
                "pixels": spaces.Dict({"rgb": spaces.Box(0, 255, size, np.uint8)}),
                "agent_pos": spaces.Box(-np.inf, np.inf, (STATE_SIZE,), np.float32),
            }
        )
        self.action_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)

    @property
    def task(self) -> str:
        """Split, scene and id of the episode."""
        e = self._episode
        return f"{e.split}/{e.scene_id}/{e.episode_id}" if e else ""

    @property
    def task_description(self) -> str:
        """The episode's instruction."""
        return self._episode.instruction if self._episode else ""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin the episode of a seed, or a random one.

        An episode that starts in an obstacle is a failure, as in `vlnpe evaluate`: its first step
        ends it.
        """
        super().reset(seed=seed)
        count = len(self._episodes)
        number = int(self.np_random.integers(count)) if seed is None else seed % count
        episode = self._episode = self._episodes[number]
        env = self._open(episode)
        self._still, self._startable = 0, True
        try:
            seen, _ = env.reset(options={"episode": env.episodes.index(episode)})
        except InputError as error:
            log.warning("%s", error)
            self._startable = False
            return self._seen, self._info()
        position, quat = env.world.base[:3], env.world.base[3:]
        floor_m = float(env.world.surface.height_at(position[None, :2])[0])
        origin = np.array([position[0], position[1], floor_m])
        self._start = StartFrame(origin, float(quat_to_yaw(quat)))
        self._quat = np.array([1.0, 0.0, 0.0, 0.0])
        return self._shown(seen), self._info()

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Carry out a motion; see the class.

        Raises:
            PolicyError: If it is not three finite numbers.
            gymnasium.error.ResetNeeded: If the episode is over, or none has begun.
        """
        if self._env is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        if not self._startable:
            return self._seen, 0.0, True, False, self._info({"end_reason": "collision_start"})
        motion = np.asarray(action, np.float64)
        still = np.abs(motion[2]) < STILL_RAD and np.hypot(*motion[:2]) < STILL_M
        self._still = self._still + 1 if still else 0
        stop = self._still == STILL_ACTIONS
        seen, reward, terminated, truncated, info = self._env.step(
            Action.STOP if stop else motion / SteeredConfig.action_s
        )
        return self._shown(seen), reward, terminated, truncated, self._info(info)

    def render(self) -> NDArray[np.uint8]:  # type: ignore[override]
        """Return the last image that the policy was shown, (H, W, 3) uint8."""
        return self._seen["pixels"]["rgb"]

    def close(self) -> None:
        """End the episode in progress and close the scene."""
        env, self._env, self._group = self._env, None, ()
        if env is not None:
            env.close()

    def _open(self, episode: Episode) -> NavigationEnv:
        """Return the environment of an episode's scene; only one is kept open."""
        group = episode.world
        if self._env is None or group != self._group:
            self.close()
            scene = self._scenes / episode.scene_id
            self._env, self._group = (
                NavigationEnv(
                    scene,
                    [e for e in self._episodes if e.world == group],
                    robot=self._robot,
                    view=replace(self._view, renderer=scene_renderer_name(scene, self._renderer)),
                    actions=VELOCITY,
                    modalities=("rgb", "proprioception"),
                ),
                group,
            )
        return self._env

    def _shown(self, seen: dict[str, Any]) -> dict[str, Any]:
        """Return an observation of `NavigationEnv` in LeRobot's form."""
        assert self._env is not None
        base = self._env.world.base
        quat = self._start.orientation(base[None, 3:])[0]
        # As in datasets, signs do not jump when a robot turns past 180°.
        self._quat = -quat if quat @ self._quat < 0 else quat
        state = (
            self._start.position(base[:3]),
            self._quat,
            seen["proprioception"][-9:-3],  # velocities in the base frame
        )
        self._seen = {
            "pixels": {"rgb": seen["rgb"]},
            "agent_pos": np.concatenate(state).astype(np.float32),
        }
        return self._seen

    def _info(self, ended: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return LeRobot's `is_success`, and how the episode ended, once it has."""
        ended = {k: v for k, v in (ended or {}).items() if k in ("end_reason", "metrics")}
        success = bool(ended.get("metrics", {}).get("success", False))
        return {"is_success": success, "episode": self.task, **ended}

"""A Gymnasium environment over one prepared scene, robot and controller."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..collectors.replay.replay import ReplayConfig
from ..collectors.replay.suits import check_suits
from ..collectors.replay.world import World, open_world
from ..collectors.robots import get_robot
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError, MissingExtraError
from ..formats.core.rollout import EndReason
from ..formats.scene.bundle import load_bundle
from ..rendering.camera.views import View, make_view
from ..rendering.registry import make_renderer, scene_renderer_name
from ..wayfinding.distance import DistanceField
from ..wayfinding.storeys import StoreyDistance, distance_on, ground_of
from .episode import closed_loop, evaluate_episode
from .motions import DISCRETE, check_kind, checked_motion, numbers_of
from .observation import BlankEye, Eye, Observation, Start, checked_action, proprioception
from .policy import Assignment
from .spaces import (
    action_space,
    chosen_modalities,
    observation_space,
    previous_action_space,
    token_table,
)
from .walk import Walk

try:
    import gymnasium as gym
except ModuleNotFoundError as missing:
    raise MissingExtraError("NavigationEnv", "evaluate") from missing

SUCCESS_REWARD = 2.5


class NavigationEnv(gym.Env[dict[str, Any], Any]):
    """Follow instructions in one scene; a robot carries the actions out.

    Actions are VLN-CE's discrete ones, velocities held for 0.25 s, or sequences of waypoints:

    | `actions` | controller | action space |
    | --- | --- | --- |
    | `discrete` | `speed`, `flash` | 0 STOP, 1 FORWARD, 2 LEFT, 3 RIGHT |
    | `velocity` | `speed` | `stop` and `velocity` (3,): vx, vy [m/s], yaw rate [rad/s] |
    | `waypoints` | `path` | `stop` and `waypoints` (K, 3): Δx, Δy [m], Δyaw [rad], each in the |
    | | | frame of the one before; they are moved to one by one, without a map |

    Observations are the fields of `Observation` but `step`, and `tokens`. The reward of an action
    is the geodesic distance to the goal that it gained [m], and `SUCCESS_REWARD` more for a stop
    within the goal's radius. An episode is terminated by STOP, a fall, or being stuck, truncated
    after 500 actions.

    `info` holds `episode_id`, `step`, `distance_to_goal_m`, `position_world_m` and, with the last
    step, `end_reason`, `events` and `metrics`; the full record is then `rollout`.

    The episode of a reset is drawn by its seed, or named: `reset(options={"episode": 3})`. The same
    episode, robot and actions give the same bits.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array"],
        "render_fps": 4,
    }

    def __init__(
        self,
        scene: Path | str,
        episodes: Sequence[Episode],
        *,
        robot: str = "aliengo",
        controller: str = "speed",
        config: ReplayConfig | None = None,
        view: View | None = None,
        images: bool = True,
        actions: str = DISCRETE,
        waypoints: int = 4,
        modalities: Sequence[str] | None = None,
        tokenize: Callable[[str], ArrayLike] | None = None,
        cache_dir: Path | None = None,
        render_mode: str | None = "rgb_array",
    ) -> None:
        """Open the scene.

        Args:
            scene: folder of a repaired scene.
            episodes: episodes in this scene, all on one level or over one staircase from there.
            robot: name, or folder of one's own robot.
            controller: `speed` (physics), `flash` (placed, no physics), or `path` for waypoints.
            config: further settings; robot and controller in it are replaced by the two above.
            view: the camera; the robot's own by default.
            images: False shows black images and renders nothing.
            actions: kind of actions, see the class.
            waypoints: number K of waypoints in an action.
            modalities: names among `MODALITIES` that observations have; all by default, `tokens`
                only with `tokenize`. Without `rgb` and `depth_m` nothing is rendered.
            tokenize: Return the token ids of an instruction, at least 0; observations then have
                `tokens`, padded with 0 to the longest instruction.
            cache_dir: where compiled models are kept; none are when None.
            render_mode: `rgb_array`, or None.

        Raises:
            InputError: no episode, episodes of several worlds or that the robot cannot walk,
                `tokens` without `tokenize`, or actions that the controller does not carry out.
            UnknownNameError: no such robot, controller, light, renderer, modality, kind of actions.
        """
        if not episodes or len({(e.level, e.staircases) for e in episodes}) > 1:
            raise InputError(
                f"{len(episodes)} episodes; valid: one or more, all of one level, or over one "
                "staircase from it"
            )
        check_kind(actions, controller)
        self.episodes = tuple(episodes)
        self._kind, self._waypoints = actions, waypoints
        self._tokens = token_table(self.episodes, tokenize) if tokenize else None
        self._modalities = chosen_modalities(modalities, tokenize is not None)
        images = images and bool({"rgb", "depth_m"} & set(self._modalities))
        self.render_mode = render_mode
        base = config or ReplayConfig()
        self._config = closed_loop(replace(base, robot=robot, controller=controller))
        spec = get_robot(robot)
        check_suits(spec, episodes)
        self._bundle = load_bundle(Path(scene))
        physics = base.physics.for_episode(*episodes)
        self.world: World = open_world(
            self._bundle, episodes[0].level, spec, None, physics, cache_dir, episodes[0].staircase
        )
        self._view = view or make_view("ego", spec, renderer=scene_renderer_name(Path(scene)))
        self._eye: Eye | BlankEye = BlankEye(self._view.camera)
        if images:
            renderer = make_renderer(self._bundle, self._view.renderer, light=self._view.light)
            self._eye = Eye(self.world, self._view, renderer)
        self.action_space = action_space(actions, self.world.robot, waypoints)
        self.observation_space = observation_space(
            self._modalities,
            self._view.camera,
            self.world.robot,
            [episode.instruction for episode in episodes],
            self._tokens,
            previous_action_space(actions, waypoints),
        )
        self.rollout = None
        self._walk: Walk | None = None
        self._last: Observation | None = None
        self._field: DistanceField | StoreyDistance | None = None
        self._distance_m = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode; see the class for how it is chosen.

        Raises:
            InputError: the robot stands in an obstacle at the episode's start, or there is no
                episode of that number.
        """
        super().reset(seed=seed)
        self.close()
        chosen = (options or {}).get("episode")
        number = int(self.np_random.integers(len(self.episodes)) if chosen is None else chosen)
        if not 0 <= number < len(self.episodes):
            raise InputError(f"episode {number}; valid: 0 to {len(self.episodes) - 1}")
        self.episode = self.episodes[number]
        over = bool(self.episode.staircases)
        ground = ground_of(self._bundle, self.episode) if over else self.world.freemap
        self._field = distance_on(ground, self.episode.goal_position_world_m)
        self.rollout = None
        self._walk = Walk(self._replay)
        self._last = self._walk.start()
        if self._last is None:
            ended = self._walk.rollout
            reason = ended.end_reason if ended else "unknown"
            raise InputError(f"episode {self.episode.episode_id} cannot be started: {reason}")
        self._start = Start.of(self.world)
        self._distance_m = self._to_goal_m()
        return self._observation_dict(self._last), self._info()

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Take an action; see `gymnasium.Env.step`.

        Raises:
            PolicyError: it is no action.
            gymnasium.error.ResetNeeded: the episode is over, or none has begun.
        """
        if self._walk is None or self._last is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        seen = self._walk.step(action)
        before_m, self._distance_m = self._distance_m, self._to_goal_m()
        reward = before_m - self._distance_m
        if seen is not None:
            self._last = seen
            return self._observation_dict(seen), reward, False, False, self._info()
        rollout = self.rollout = self._walk.rollout
        assert rollout is not None
        reward += SUCCESS_REWARD * rollout.metrics.success
        truncated = rollout.end_reason is EndReason.TIMEOUT
        rgb, depth_m = self._eye.look()
        last = Observation(
            rgb=rgb.copy(),
            depth_m=depth_m.copy(),
            instruction=self.episode.instruction,
            pose=self._start.pose_of(self.world),
            proprioception=proprioception(self.world),
            previous_action=self._taken(action),
            step=self._last.step + 1,
        )
        self._walk = self._last = None
        info = self._info(last.step) | {
            "end_reason": str(rollout.end_reason),
            "events": [asdict(event) for event in rollout.events],
            "metrics": asdict(rollout.metrics),
        }
        return self._observation_dict(last), reward, not truncated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Return what the camera sees now, (H, W, 3) uint8; None without images."""
        shown = isinstance(self._eye, Eye) and self.render_mode == "rgb_array"
        return self._eye.look()[0] if shown else None

    def close(self) -> None:
        """End the episode in progress, if there is one."""
        walk, self._walk, self._last = self._walk, None, None
        if walk is not None:
            walk.cancel()

    def _replay(self, ask: Callable[[Observation], Any]) -> Any:
        return evaluate_episode(
            self.world,
            self.episode,
            self._config,
            _CallerPolicy(ask),
            self._eye,
            kind=self._kind,
            waypoints=self._waypoints,
        )

    def _taken(self, action: Any) -> int | NDArray[np.float64]:
        """Return the last action as observations show it; a stop keeps the one before."""
        if self._kind == DISCRETE:
            return int(checked_action(action))
        motion = checked_motion(action, self._kind)
        assert self._last is not None
        return self._last.previous_action if motion is None else numbers_of(motion)

    def _to_goal_m(self) -> float:
        assert self._field is not None
        place = np.array([*self.world.base[:2], self.world.foot_z_m])
        if isinstance(self._field, DistanceField):
            place = place[:2]
        distance = float(self._field.at(place[None])[0])
        return distance if np.isfinite(distance) else self._distance_m

    def _info(self, step: int | None = None) -> dict[str, Any]:
        return {
            "episode_id": self.episode.episode_id,
            "step": step if step is not None else self._last.step if self._last else 0,
            "distance_to_goal_m": self._distance_m,
            "position_world_m": self.world.base[:3].copy(),
        }

    def _observation_dict(self, observation: Observation) -> dict[str, Any]:
        shown = observation.to_dict()
        if self._tokens is not None:
            shown["tokens"] = self._tokens[observation.instruction].copy()
        return {name: shown[name] for name in self._modalities}


class _CallerPolicy:
    """A policy whose actions come from the environment's caller."""

    blind = False

    def __init__(self, ask: Callable[[Observation], Any]) -> None:
        self._ask = ask

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""

    def act(self, observation: Observation) -> Any:
        """See `Policy.act`."""
        return self._ask(observation)

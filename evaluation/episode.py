"""One episode in closed loop: the physics and the rules of collection, actions by a policy."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..collectors.controllers import Motion, Pose
from ..collectors.replay.replay import ReplayConfig, replay_in
from ..collectors.replay.world import World
from ..formats.core.episode import Episode
from ..formats.core.rollout import Action, Rollout
from .motions import DISCRETE, VELOCITY, check_kind, checked_motion, numbers_of
from .observation import (
    NO_ACTION,
    BlankEye,
    Eye,
    Labels,
    Lens,
    Observation,
    Start,
    checked_action,
    proprioception,
)
from .policy import Assignment, Policy, PolicyError

SAID = "said"  # kind of the events that keep a policy's own words
LONGEST_SAID = 500  # characters


@dataclass
class PolicyChooser:
    """Shows a policy what the robot sees whenever the controller wants an action.

    Attributes:
        eye: the robot's camera; images are black without one.
        waypoints: the number K of waypoints that observations show before the first ones.
    """

    world: World
    assignment: Assignment
    policy: Policy
    eye: Eye | BlankEye | None
    kind: str = DISCRETE
    waypoints: int = 1
    _start: Start | None = None
    _previous: Action | Motion | None = None
    _count: int = 0

    def observe(self) -> Observation:
        """Return what the robot sees now."""
        self._start = self._start or Start.of(self.world)
        eye = self.eye or BlankEye(self.world.robot.camera.model)
        lens: Lens | None = None
        labels: Labels | None = None
        if isinstance(eye, Eye) and getattr(self.policy, "wants_labels", False):
            rgb, depth_m, labels = eye.look_labelled()
        else:
            rgb, depth_m = eye.look(getattr(self.policy, "reads_px", None))
        if isinstance(eye, Eye) and getattr(self.policy, "wants_lens", False):
            lens = eye.lens(self._start)
        return Observation(
            rgb=rgb,
            depth_m=depth_m,
            instruction=self.assignment.instruction,
            pose=self._start.pose_of(self.world),
            proprioception=proprioception(self.world),
            previous_action=self._action_array(self._previous),
            step=self._count,
            lens=lens,
            labels=labels,
        )

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        """Return the policy's action; see `Chooser`. The true pose is kept from the policy."""
        action = self._answer(checked_action)
        self._remember(action)
        return action

    def next_motion(self, pose: Pose) -> Motion | None:
        """Return the policy's motion, None for a stop; see `Steerer`."""
        motion = self._answer(lambda answer: checked_motion(answer, self.kind))
        self._remember(motion)
        return motion

    def _answer[T](self, check: Callable[[Any], T]) -> T:
        observation = self.observe()
        try:
            return check(self.policy.act(observation))
        except PolicyError:
            raise
        except Exception as error:  # a policy is foreign code
            place = f"episode {self.assignment.episode_id}, action {observation.step}"
            raise PolicyError(f"{place}: {type(error).__name__}: {error}") from error

    def _remember(self, chosen: Action | Motion | None) -> None:
        self._previous, self._count = chosen, self._count + 1

    def _action_array(self, chosen: Action | Motion | None) -> int | np.ndarray:
        """Return an action as observations show it."""
        if isinstance(chosen, Action):
            return int(chosen)
        if chosen is not None:
            return numbers_of(chosen)
        if self.kind == DISCRETE:
            return NO_ACTION
        return np.zeros(3 if self.kind == VELOCITY else (self.waypoints, 3))

    def notes(self) -> list[tuple[str, str]]:
        """Return what the policy said since the last call, if it says anything."""
        said = getattr(self.policy, "said", None)
        if not said:
            return []
        words, said[:] = [str(text)[:LONGEST_SAID] for text in said], []
        return [(SAID, text) for text in words]


def closed_loop(config: ReplayConfig) -> ReplayConfig:
    """Return `config` with the time limit of an evaluation: 500 actions, whatever they take.

    The limit of collection, a multiple of the time that the reference path needs, would reveal
    the length of the path.
    """
    return replace(config, outcome=replace(config.outcome, timeout_factor=math.inf))


def evaluate_episode(
    world: World,
    episode: Episode,
    config: ReplayConfig,
    policy: Policy | None,
    eye: Eye | BlankEye | None,
    *,
    kind: str = DISCRETE,
    waypoints: int = 1,
) -> Rollout:
    """Let a policy walk an episode; the same world, episode, config and answers give the same bits.

    Args:
        config: robot, controller and further settings; see `closed_loop`. Discrete actions
            are carried out by `speed` and `flash`, velocities by `speed`, waypoints by `path`.
        policy: chooses the actions; the expert, which knows the path, when None.
        eye: the robot's camera; None shows the policy black images.
        kind: kind of the policy's actions, see `ACTION_KINDS`.
        waypoints: the number of waypoints in the observation before the first ones.

    Raises:
        PolicyError: the policy failed, or its answer is no action.
        InputError: the controller does not carry out such actions.
    """
    if policy is None:
        return replay_in(world, episode, config)
    check_kind(kind, config.controller)
    assignment = Assignment.of(episode, world.robot.name, config.controller, kind)
    policy.reset(assignment)
    chooser = PolicyChooser(
        world, assignment, policy, None if policy.blind else eye, kind, waypoints
    )
    if kind == DISCRETE:
        return replay_in(world, episode, config, lambda task: chooser)
    return replay_in(world, episode, config, steer=lambda task: chooser)

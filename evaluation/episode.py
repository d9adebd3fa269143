"""One episode in closed loop: the physics and the rules of collection, actions by a policy."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..collectors.controllers import Pose
from ..collectors.replay import ReplayConfig, replay_in
from ..collectors.world import World
from ..formats.core.episode import Episode
from ..formats.core.rollout import Action, Rollout
from .observation import NO_ACTION, Eye, Observation, checked_action, proprioception, relative_pose
from .policy import Assignment, Policy, PolicyError


@dataclass
class PolicyChooser:
    """Shows a policy what the robot sees whenever the controller wants an action.

    Attributes:
        world: the level with the robot in it.
        assignment: what the policy is told at the start.
        policy: chooses.
        eye: the robot's camera; images are black without one.
    """

    world: World
    assignment: Assignment
    policy: Policy
    eye: Eye | None
    _start: tuple[float, float, float] | None = None
    _actions: list[Action] = field(default_factory=list)

    def observe(self) -> Observation:
        """Return what the robot sees now."""
        if self._start is None:
            pose = self.world.pose
            self._start = (pose.x_m, pose.y_m, pose.yaw_rad)
        rgb, depth_m = self.eye.look() if self.eye else _nothing(self.world)
        return Observation(
            rgb=rgb,
            depth_m=depth_m,
            instruction=self.assignment.instruction,
            pose=relative_pose(self.world, self._start),
            proprioception=proprioception(self.world),
            previous_action=int(self._actions[-1]) if self._actions else NO_ACTION,
            step=len(self._actions),
        )

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        """Return the policy's action; see `Chooser`. A policy is not told the true pose.

        Raises:
            PolicyError: the policy failed, or what it answered is no action.
        """
        observation = self.observe()
        try:
            action = checked_action(self.policy.act(observation))
        except PolicyError:
            raise
        except Exception as error:  # a policy is foreign code
            place = f"episode {self.assignment.episode_id}, action {observation.step}"
            raise PolicyError(f"{place}: {type(error).__name__}: {error}") from error
        self._actions.append(action)
        return action

    def notes(self) -> list[tuple[str, str]]:
        """Return nothing: all that a policy says are its actions."""
        return []


def _nothing(world: World) -> tuple[np.ndarray, np.ndarray]:
    camera = world.robot.camera.model
    shape = (camera.height_px, camera.width_px)
    return np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)


def closed_loop(config: ReplayConfig) -> ReplayConfig:
    """Return `config` with the time limit of an evaluation: 500 actions, whatever they take.

    The limit of collection, a multiple of the time that the reference path needs, would tell an
    agent by when it must be there.
    """
    return replace(config, outcome=replace(config.outcome, timeout_factor=math.inf))


def evaluate_episode(
    world: World, episode: Episode, config: ReplayConfig, policy: Policy | None, eye: Eye | None
) -> Rollout:
    """Let a policy walk an episode; the same world, episode, config and answers give the same bits.

    Args:
        world: the level with the robot in it.
        episode: what to do.
        config: robot, controller (`speed` or `flash`), and how; see `closed_loop`.
        policy: chooses the actions; the expert, who knows the path, when None.
        eye: the robot's camera; None shows the policy black images.

    Raises:
        PolicyError: the policy failed, or what it answered is no action.
        InputError: the controller takes no discrete actions.
    """
    if policy is None:
        return replay_in(world, episode, config)
    assignment = Assignment.of(episode, world.robot.name, config.controller)
    policy.reset(assignment)
    chooser = PolicyChooser(world, assignment, policy, None if policy.blind else eye)
    return replay_in(world, episode, config, lambda task: chooser)

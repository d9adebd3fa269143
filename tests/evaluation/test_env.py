"""The environment: Gymnasium's contract, and that a policy meets the robot that collection met."""

from __future__ import annotations

import threading
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.collectors.test_replay import make_episode, same
from vlnpe.collectors.rendering.camera.rollout_views import RolloutFrames
from vlnpe.collectors.rendering.camera.views import make_view
from vlnpe.collectors.rendering.registry import make_renderer
from vlnpe.collectors.replay import ReplayConfig, replay_in
from vlnpe.collectors.robots import get_robot
from vlnpe.collectors.world import open_world
from vlnpe.evaluation.env import SUCCESS_REWARD, NavigationEnv
from vlnpe.evaluation.episode import evaluate_episode
from vlnpe.evaluation.observation import Eye, checked_action
from vlnpe.evaluation.policy import Assignment, Forward, PolicyError, Random, Stop
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.rollout import Action, EndReason
from vlnpe.formats.scene.bundle import SceneBundle


@pytest.fixture(scope="module")
def episodes(two_rooms: SceneBundle) -> list[Episode]:
    starts = {"near": ((5.0, 2.0), (6.6, 2.6)), "far": ((2.6, 2.0), (5.4, 2.0))}
    made = [make_episode(two_rooms, *ends, name=name) for name, ends in starts.items()]
    return [replace(e, instruction=f"Go to the {e.episode_id} end.") for e in made]


def small_view(robot: str = "aliengo"):
    return make_view("ego", robot, width_px=64, height_px=48)


@pytest.fixture(scope="module")
def env(two_rooms: SceneBundle, episodes: list[Episode]):
    env = NavigationEnv(two_rooms.root, episodes, view=small_view())
    yield env
    env.close()


class Replayed:
    """Takes the actions of a record and keeps what it is shown."""

    blind = False

    def __init__(self, actions):
        self.actions, self.seen = list(actions), []

    def reset(self, assignment: Assignment) -> None:
        self.assignment = assignment

    def act(self, observation):
        self.seen.append(observation)
        return self.actions[observation.step]


@pytest.mark.filterwarnings("ignore")
def test_gymnasium_accepts_it(env: NavigationEnv) -> None:
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize("controller", ["speed", "flash"])
def test_a_policy_sees_what_collection_renders_bit_for_bit(two_rooms, episodes, controller) -> None:
    world = open_world(two_rooms, 0, get_robot("aliengo"))
    config = ReplayConfig(controller=controller)
    view, renderer = small_view(), make_renderer(two_rooms, "embree", light="baked")
    expert = replay_in(world, episodes[1], config)
    policy = Replayed(span.action for span in expert.actions)
    walked = evaluate_episode(world, episodes[1], config, policy, Eye(world, view, renderer))
    assert same(walked, expert) and walked.end_reason is EndReason.SUCCESS
    samples = np.array([span.start_sample for span in walked.actions])
    frames = RolloutFrames.plan(renderer, walked, view, samples, world.robot)
    for seen, (rgb, depth_m) in zip(policy.seen, frames.render(renderer), strict=True):
        assert np.array_equal(seen.rgb, rgb) and np.array_equal(seen.depth_m, depth_m)
    assert len(np.unique(policy.seen[0].rgb)) > 10  # it is a picture
    assert policy.assignment.instruction == "Go to the far end."


def test_the_environment_walks_as_the_replay_does(env: NavigationEnv, two_rooms, episodes) -> None:
    expert = replay_in(env.world, episodes[1], ReplayConfig(controller="speed"))
    seen, info = env.reset(options={"episode": 1})
    start_m, total, done = info["distance_to_goal_m"], 0.0, False
    for k, span in enumerate(expert.actions):
        assert not done and info["step"] == k
        seen, reward, done, truncated, info = env.step(int(span.action))
        total += reward
        assert not truncated and seen["previous_action"] == span.action
    assert done and info["end_reason"] == "success"
    assert info["metrics"]["success"] and env.rollout is not None
    assert np.array_equal(env.rollout.position_world_m, expert.position_world_m)
    assert total == pytest.approx(start_m - info["distance_to_goal_m"] + SUCCESS_REWARD)
    assert env.observation_space.contains(seen)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(0)


def test_a_reset_ends_the_walk_before_it_and_leaves_no_thread(env: NavigationEnv) -> None:
    env.close()
    before = threading.active_count()
    first, _ = env.reset(seed=4)
    env.step(1)
    again, _ = env.reset(seed=4)
    assert threading.active_count() == before + 1
    for key, value in first.items():
        assert np.array_equal(value, again[key]), key
    env.close()
    assert threading.active_count() == before


def test_what_is_no_action_is_refused_and_ends_the_walk(env: NavigationEnv) -> None:
    for wrong in (7, float("nan"), "jump", np.zeros(3), None):
        env.reset(options={"episode": 0})
        with pytest.raises(PolicyError, match="valid: 0 STOP"):
            env.step(wrong)
    with pytest.raises(InputError, match="valid: 0 to 1"):
        env.reset(options={"episode": 2})


def test_actions_in_every_form_a_model_gives() -> None:
    for value in (1, 1.0, np.int64(1), np.array([1]), "forward", "FORWARD", Action.FORWARD):
        assert checked_action(value) is Action.FORWARD


@pytest.mark.parametrize(
    ("policy", "reason"),
    [(Stop(), {"stopped_far"}), (Forward(), {"stuck", "stopped_far"}), (Random(3), None)],
)
def test_simple_policies_end(two_rooms, episodes, policy, reason) -> None:
    world = open_world(two_rooms, 0, get_robot("aliengo"))
    config = ReplayConfig(controller="flash")
    rollouts = [evaluate_episode(world, episodes[1], config, policy, None) for _ in range(2)]
    assert same(*rollouts)
    assert reason is None or str(rollouts[0].end_reason) in reason


def test_the_path_controller_takes_no_actions(two_rooms, episodes) -> None:
    world = open_world(two_rooms, 0, get_robot("aliengo"))
    with pytest.raises(InputError, match="valid: speed, flash"):
        evaluate_episode(world, episodes[0], ReplayConfig(controller="path"), Stop(), None)

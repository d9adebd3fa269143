"""The environment: Gymnasium's contract, and that a policy meets the robot that collection met."""

import threading
from dataclasses import replace
from functools import partial
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env

from tests.collectors.test_replay import make_episode, same
from tests.support.scenes.storeys import LINE, TOP_M, write_two_storeys
from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.suits import check_suits
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.evaluation.env import SUCCESS_REWARD, NavigationEnv
from vlnpe.evaluation.episode import closed_loop, evaluate_episode
from vlnpe.evaluation.observation import Eye, checked_action
from vlnpe.evaluation.policies.baselines import Forward, Random, Stop
from vlnpe.evaluation.policy import Assignment, PolicyError
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.geometry import path_length
from vlnpe.formats.core.rollout import Action, EndReason
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.sheet import save_sheet
from vlnpe.pipeline.inputs.crews import action_timing
from vlnpe.pipeline.stages.rollouts import replay_items
from vlnpe.rendering.camera.rollout_frames import RolloutFrames
from vlnpe.rendering.camera.views import make_view
from vlnpe.rendering.registry import make_renderer
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes


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


def test_an_invalid_action_is_refused_and_ends_the_walk(env: NavigationEnv) -> None:
    for wrong in (7, float("nan"), "jump", np.zeros(3), None):
        env.reset(options={"episode": 0})
        with pytest.raises(PolicyError, match="valid: 0 STOP"):
            env.step(wrong)
    with pytest.raises(InputError, match="valid: 0 to 1"):
        env.reset(options={"episode": 2})


class LookAround:
    """Turns left and right on the spot, and never stops."""

    blind = True

    def reset(self, assignment: Assignment) -> None:
        pass

    def act(self, observation):
        return (Action.LEFT, Action.RIGHT)[observation.step % 2]


@pytest.mark.parametrize("timing", [(50, False), (100, False), (50, True)])
def test_stuck_is_judged_over_fifty_actions_under_every_timing(two_rooms, episodes, timing) -> None:
    # On wheels: a gait's drift in heading can add up to 15° in fifty actions.
    world = open_world(two_rooms, 0, get_robot("jetbot"))
    walker = replay_items.walker(get_robot("jetbot"), "speed", 0, action_timing(*timing))
    config = closed_loop(walker.config)
    rollout = evaluate_episode(world, episodes[1], config, LookAround(), None)
    assert rollout.end_reason is EndReason.STUCK
    assert 50 <= len(rollout.actions) <= 54


def run_out(env: NavigationEnv, choose, most: int = 60):
    """Step until the episode is over; return the observations and the last info."""
    seen, info = env.reset(options={"episode": 1})
    kept, done = [seen], False
    while not done and len(kept) < most:
        seen, _, terminated, truncated, info = env.step(choose(seen))
        assert env.observation_space.contains(seen)
        kept.append(seen)
        done = terminated or truncated
    return kept, info


def to_goal(seen, goal=(2.8, 0.0)):
    """Waypoints straight towards a goal in the start frame, two of at most 0.4 m."""
    x, y, yaw = seen["pose"]
    dx, dy = goal[0] - x, goal[1] - y
    distance = np.hypot(dx, dy)
    if distance < 0.15:
        return {"stop": 1, "waypoints": np.zeros((2, 3))}
    step = min(0.4, distance / 2)
    turn = (np.arctan2(dy, dx) - yaw + np.pi) % (2 * np.pi) - np.pi
    ahead = np.array([np.cos(turn), np.sin(turn), 0.0]) * step
    return {"stop": 0, "waypoints": np.array([[*ahead[:2], turn], [step, 0.0, 0.0]])}


def test_waypoints_are_moved_to_one_by_one(two_rooms, episodes) -> None:
    setting = {"actions": "waypoints", "waypoints": 2, "images": False, "controller": "path"}
    env = NavigationEnv(two_rooms.root, episodes, view=small_view(), **setting)
    assert env.action_space.contains({"stop": 0, "waypoints": np.zeros((2, 3), np.float32)})
    kept, info = run_out(env, to_goal)
    assert info["end_reason"] == "success", info
    assert kept[0]["rgb"].shape == (48, 64, 3)  # black, of the view's size
    assert not kept[0]["rgb"].any()
    # Each pair of waypoints ends where it leads to.
    for before, after in pairwise(kept[:-1]):
        asked = to_goal(before)["waypoints"]
        moved = np.linalg.norm(after["pose"][:2] - before["pose"][:2])
        assert moved == pytest.approx(np.linalg.norm(asked[:, :2], axis=1).sum(), abs=0.15)
    assert env.rollout is not None
    assert sum(event.kind == "waypoints" for event in env.rollout.events) == len(kept) - 2
    again, _ = run_out(env, to_goal)
    assert all(np.array_equal(a["pose"], b["pose"]) for a, b in zip(kept, again, strict=True))


def test_velocities_are_held_for_an_action(two_rooms, episodes) -> None:
    setting = {"actions": "velocity", "modalities": ["pose", "previous_action"]}
    env = NavigationEnv(two_rooms.root, episodes, **setting)
    seen, _ = env.reset(options={"episode": 1})
    assert isinstance(env.observation_space, spaces.Dict)
    assert set(seen) == {"pose", "previous_action"} == set(env.observation_space.spaces)
    for _ in range(8):
        seen, *_ = env.step({"stop": 0, "velocity": np.array([0.5, 0.0, 0.0])})
    assert 0.5 < seen["pose"][0] < 1.0  # 2 s at 0.5 m/s, from standing
    np.testing.assert_array_equal(seen["previous_action"], [0.5, 0.0, 0.0])
    _, _, done, _, info = env.step(0)
    assert done and info["step"] == 9
    assert info["end_reason"] == "stopped_near" and info["metrics"]["success"]
    for wrong in ([1.0, 2.0], [np.nan, 0, 0], "jump", {"waypoints": [[1, 0, 0]]}):
        env.reset(options={"episode": 1})
        with pytest.raises(PolicyError, match="valid: three finite numbers"):
            env.step(wrong)


def test_modalities_and_tokens_are_chosen(two_rooms, episodes) -> None:
    setting = {"modalities": ["instruction", "tokens", "depth_m"], "view": small_view()}
    words = ["", *sorted({w for e in episodes for w in e.instruction.split()})]
    env = NavigationEnv(
        two_rooms.root,
        episodes,
        tokenize=lambda text: [words.index(w) for w in text.split()],
        **setting,
    )
    seen, _ = env.reset(options={"episode": 0})
    assert isinstance(env.observation_space, spaces.Dict)
    assert list(seen) == list(env.observation_space.spaces) == ["depth_m", "instruction", "tokens"]
    assert " ".join(words[k] for k in seen["tokens"]).strip() == seen["instruction"]
    assert env.observation_space.contains(seen)
    with pytest.raises(InputError, match="'tokens' needs"):
        NavigationEnv(two_rooms.root, episodes, **setting)
    with pytest.raises(InputError, match=r"modality 'smell'.*valid: depth_m"):
        NavigationEnv(two_rooms.root, episodes, modalities=["smell"])
    with pytest.raises(InputError, match=r"'speed' does not support waypoints.*valid: path"):
        NavigationEnv(two_rooms.root, episodes, actions="waypoints")


def test_rewards_lead_from_one_storey_to_the_other(tmp_path) -> None:
    building = write_two_storeys(tmp_path / "house")
    sampling = SampleConfig(count=4, min_length_m=3.0, min_view_m=0.0, storeys="cross")
    sampled = sample_episodes(building, sampling, np.random.default_rng(0)).episodes
    up, down = (next(e for e in sampled if e.level == level) for level in (0, 1))
    with pytest.raises(InputError, match="over one staircase from it"):
        NavigationEnv(building.root, [up, down], images=False)
    env = NavigationEnv(building.root, [up], controller="flash", images=False)
    _, info = env.reset(options={"episode": 0})
    assert info["distance_to_goal_m"] == pytest.approx(up.geodesic_distance_m, abs=0.1)
    rewards, done = [], False
    for action in up.extra["actions"]:
        _, reward, done, _, info = env.step(action)
        rewards.append(reward)
    assert done and info["end_reason"] == "success" and info["metrics"]["success"]
    # Turns on the spot earn nothing, and no step leads away.
    assert min(rewards) > -0.1
    assert sum(rewards) - SUCCESS_REWARD == pytest.approx(up.geodesic_distance_m, abs=0.3)


def test_rewards_of_a_low_robot_lead_under_what_blocks_others(tmp_path) -> None:
    building = write_two_storeys(tmp_path / "house")
    sheet = building.freemap(0)
    xy = sheet.grid.center_of(np.moveaxis(np.indices(sheet.grid.shape), 0, -1))
    table = np.abs(xy[..., 0] - 7.0) < 0.3
    blocked = replace(
        sheet,
        traversable=sheet.traversable & ~table,
        headroom_m=np.where(table, 1.0, sheet.headroom_m).astype(np.float32),
    )
    save_sheet(building.level_folder(0), building.floor(0), building.obstacles(0), blocked)
    path = np.vstack([[3.0, 2.0, 0.0], LINE, [15.0, 2.0, TOP_M]])
    extra = {"staircases": [1], "levels": [0, 1], "free_height_m": 0.7}
    under = Episode(
        "e", "e", "two_storeys", "train", 0, path[0], 0.0, path[-1], path, 12.4, extra=extra
    )
    env = NavigationEnv(building.root, [under], controller="flash", images=False)
    _, info = env.reset(options={"episode": 0})
    assert info["distance_to_goal_m"] == pytest.approx(path_length(path), abs=0.1)


@pytest.mark.parametrize(
    ("robot", "extra", "why"),
    [
        ("h1", {}, "takes stairs, which h1 cannot climb; valid: aliengo"),
        ("vlnce", {"climb_height_m": 0.7}, "0.7 m free above its stairs, and vlnce needs 1.56 m"),
        (
            "vlnce",
            {"climb_height_m": None},
            r"does not state the height free above its stairs \(0.65 m assumed\)",
        ),
        ("vlnce", {"free_height_m": 0.7}, "0.7 m free above its path, and vlnce needs 1.56 m"),
    ],
)
def test_robots_that_are_too_tall_or_cannot_climb_are_refused(robot, extra, why) -> None:
    path = np.vstack([[3.0, 2.0, 0.0], LINE, [15.0, 2.0, TOP_M]])
    over = {"staircases": [1], "levels": [0, 1], "climb_height_m": 2.0}
    fits, unfit = (
        Episode(k, k, "two_storeys", "train", 0, path[0], 0.0, path[-1], path, 12.4, extra=more)
        for k, more in (("fits", {}), ("unfit", over | extra))
    )
    check_suits(get_robot("aliengo"), [fits, unfit])
    check_suits(get_robot(robot), [fits])
    with pytest.raises(InputError, match=f"episode unfit of two_storeys .*{why}"):
        check_suits(get_robot(robot), [fits, unfit])


def make_env(root, episodes):
    return NavigationEnv(root, episodes, view=small_view(), modalities=["depth_m", "pose"])


@pytest.mark.slow
def test_without_images_it_shows_black_ones_of_the_cameras_size(two_rooms, episodes) -> None:
    blind = NavigationEnv(two_rooms.root, episodes, view=small_view(), images=False)
    shown, _ = blind.reset(seed=0)
    assert shown in blind.observation_space and blind.render() is None
    assert shown["rgb"].shape == (48, 64, 3) and shown["depth_m"].shape == (48, 64)
    assert not shown["rgb"].any() and not shown["depth_m"].any()
    blind.close()


def test_it_runs_vectorised_in_processes(two_rooms, episodes, env) -> None:
    makers = [partial(make_env, two_rooms.root, episodes)] * 2
    several = gym.vector.AsyncVectorEnv(makers, context="spawn")
    try:
        seen, _ = several.reset(seed=[4, 4])
        alone, _ = env.reset(seed=4)
        for _ in range(2):
            for k in range(2):
                assert np.array_equal(seen["depth_m"][k], alone["depth_m"])
                assert np.array_equal(seen["pose"][k], alone["pose"])
            seen, *_ = several.step(np.array([1, 1]))
            alone, *_ = env.step(1)
    finally:
        several.close(terminate=True)
        env.close()


def test_actions_in_every_form_a_model_gives() -> None:
    for value in (1, 1.0, np.int64(1), np.array([1]), "forward", "FORWARD", Action.FORWARD):
        assert checked_action(value) is Action.FORWARD


@pytest.mark.parametrize(
    ("policy", "reason"),
    [(Stop(), {"stopped_near"}), (Forward(), {"stuck", "stopped_far"}), (Random(3), None)],
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

"""The gates of gaits, and the measurements behind them."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from vlnpe.collectors.controllers import SpeedConfig
from vlnpe.collectors.locomotion.runtime.card import POLICY_FOLDER
from vlnpe.collectors.locomotion.runtime.network import Network
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.locomotion.trials import evaluate
from vlnpe.collectors.locomotion.trials.driven import (
    StartedAction,
    action_errors,
    displacements,
    follow_paths,
    random_path,
)
from vlnpe.collectors.locomotion.trials.evaluate import evaluation_table, report
from vlnpe.collectors.locomotion.trials.gates import (
    CLOSED_LOOP,
    GATES,
    Gate,
    GateResult,
    gate_results,
)
from vlnpe.collectors.locomotion.trials.measures import WATCH_S, command_grid, velocity_errors
from vlnpe.collectors.locomotion.trials.terrain import Terrain, noise_terrain
from vlnpe.collectors.locomotion.trials.trial import STEP_S, Conditions, Trial
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.geometry import distances_to_path
from vlnpe.formats.core.rollout import Action

pytestmark = pytest.mark.chain


@pytest.fixture(scope="module")
def policy() -> GaitPolicy:
    return GaitPolicy.load(get_robot("aliengo"))


class Constant:
    """A network that gives the same action whatever it sees."""

    def __init__(self, network: Network, action: tuple[float, ...]):
        self.inputs, self.outputs, self._action = network.inputs, network.outputs, action

    def run(self, observation: np.ndarray, action: np.ndarray) -> None:
        action[:] = self._action


def asleep(policy: GaitPolicy) -> GaitPolicy:
    return impostor(policy, 0.0)


def limp(policy: GaitPolicy) -> GaitPolicy:
    return impostor(policy, -3.0)


def impostor(policy: GaitPolicy, knees: float) -> GaitPolicy:
    """Return a policy that holds still, with its knees as they stand, or turned by an action."""
    bent = ("knee" in joint or "calf" in joint for joint in policy.robot.joint_names)
    action = tuple(knees * b for b, _ in zip(bent, range(policy.network.outputs), strict=False))
    # A clock that never moves the legs: only the actions count.
    still = replace(policy.card.gait, stand_linear_m_s=9.0, stand_yaw_rad_s=9.0)
    card = replace(policy.card, gait=still)
    return GaitPolicy(policy.robot, card, Constant(policy.network, action))


def start(policy: GaitPolicy, count: int = 2, conditions: Conditions | None = None) -> Trial:
    rng = np.random.default_rng(0)
    where = np.zeros((count, 2)), np.zeros(count)
    return Trial(policy, conditions or Conditions(), *where, rng, watch_feet=True)


@pytest.mark.parametrize(
    ("at_least", "measured", "passed"),
    [(False, 1.0, True), (False, 1.01, False), (True, 1.0, True), (True, 0.99, False)]
    + [(higher, bad, False) for higher in (False, True) for bad in (None, math.nan)],
)
def test_a_gate_holds_at_its_limit_and_never_unmeasured(at_least, measured, passed):
    gate = Gate("length", "m", 1.0, at_least, ("a",), "key")
    result = GateResult(gate, measured)
    assert result.passed == passed
    assert str(result).startswith("✓" if passed else "✗")


@pytest.mark.parametrize(
    ("rest_s", "row"), [(0.7932, "✓ 0.793 s"), (2.5, "✗ 2.5 s"), (2.99, "✗ not in 3 s")]
)
def test_a_stop_that_outlasts_its_trial_is_no_time_to_rest(rest_s: float, row: str):
    results = gate_results({"stopping": {"rest_s_p99": rest_s}})
    (result,) = [r for r in results if r.gate.key == "rest_s_p99"]
    mark, measured = row.split(" ", 1)
    assert str(result).split("  ")[0] == f"{mark} time to rest, 99 % of stops"
    assert f" {measured}  ≤ 1.5 s" in str(result)
    assert result.gate.trial_s == WATCH_S


def test_the_worst_part_of_the_table_counts():
    table = {"grid_a": {"linear_error_mean_m_s": 0.01}, "grid_b": {"linear_error_mean_m_s": 0.06}}
    table["paths_flat"] = {"reached": 1.0, "falls": 0}
    results = {r.gate.key + r.gate.tables[0]: r for r in gate_results(table)}
    assert results["linear_error_mean_m_sgrid_*"].measured == 0.06
    assert not results["linear_error_mean_m_sgrid_*"].passed
    assert results["reachedpaths_flat"].passed
    assert results["survivedpushes"].measured is None


def test_an_empty_table_passes_no_gate():
    assert [r.passed for r in gate_results({})] == [False] * len(GATES)


@pytest.mark.slow
def test_a_table_answers_every_gate_and_survives_json(policy: GaitPolicy):
    table = json.loads(json.dumps(evaluation_table(policy, scale=0.01)))
    results = gate_results(table)
    assert all(r.measured is not None for r in results)
    assert report(table).count("\n") == len(GATES)
    assert table[CLOSED_LOOP]["actions"] >= 100


@pytest.mark.parametrize("name", sorted(GAITS))
def test_installed_gaits_were_measured_against_every_gate(name: str):
    card = GaitPolicy.load(get_robot(name)).card
    assert all(result.measured is not None for result in gate_results(card.evaluation))


def test_the_same_seed_measures_the_same(policy: GaitPolicy):
    def measure() -> dict[str, float]:
        rng = np.random.default_rng(3)
        return follow_paths(policy, 1, Conditions.mixed(1, rng), rng)

    assert measure() == measure()


@pytest.mark.parametrize("name", sorted(GAITS))
def test_a_gait_passes_the_gates_of_velocity_and_one_that_stands_still_none(name: str):
    policy = GaitPolicy.load(get_robot(name))
    commands = command_grid(policy.robot)[::2]
    walks, stands = (
        velocity_errors(gait, commands, Conditions(), np.random.default_rng(0), 3.0, 1.5)
        for gait in (policy, asleep(policy))
    )
    results = [r for r in gate_results({"grid_flat": walks}) if r.measured is not None]
    assert len(results) == 3 and all(r.passed for r in results), "\n".join(map(str, results))
    assert not any(r.passed for r in gate_results({"grid_flat": stands}))
    speed = np.linalg.norm(commands[:, :2], axis=1)
    assert stands["linear_error_mean_m_s"] == pytest.approx(speed.mean(), abs=0.05)
    assert math.isnan(stands["foot_slip_m_s"])


@pytest.mark.parametrize("name", sorted(GAITS))
def test_a_fall_counts_as_an_error_of_the_whole_command(name: str):
    fallen = limp(GaitPolicy.load(get_robot(name)))
    commands = np.array([[0.5, 0.0, 0.3]] * 2)
    result = velocity_errors(fallen, commands, Conditions(), np.random.default_rng(0), 3.0, 2.8)
    assert result["falls"] == 2
    assert result["linear_error_mean_m_s"] == pytest.approx(0.5)
    assert result["yaw_error_mean_rad_s"] == pytest.approx(0.3)
    paths = follow_paths(fallen, 2, Conditions(), np.random.default_rng(0))
    assert (paths["reached"], paths["falls"]) == (0.0, 2)
    actions = action_errors(fallen, SpeedConfig(), 2, Conditions(), np.random.default_rng(0))
    assert actions["falls"] == 2
    assert not any(r.passed for r in gate_results({CLOSED_LOOP: actions}))


def test_a_robot_that_leaves_stops_and_disturbs_no_other(policy: GaitPolicy):
    alone, crowd = start(policy, 2), start(policy, 2)
    command = np.array([[0.5, 0.0, 0.0], [0.3, 0.0, 0.5]])
    crowd.leave(np.array([True, False]))
    before = crowd.position_m[0]
    for _ in range(30):
        alone.step(command)
        crowd.step(command)
    assert np.array_equal(crowd.position_m[0], before)
    assert np.array_equal(crowd.position_m[1], alone.position_m[1])


def test_poses_are_reported_every_10_ms(policy: GaitPolicy):
    trial = start(policy, 1)
    command = np.array([[0.6, 0.0, 0.0]])
    track = []
    for _ in range(50):
        trial.step(command)
        track += list(trial.poses[0])
        assert np.array_equal(trial.poses[0, 1, :2], trial.position_m[0, :2])
    steps = np.linalg.norm(np.diff(np.array(track)[-40:, :2], axis=0), axis=1)
    assert steps.mean() == pytest.approx(0.006, rel=0.2)
    assert steps.max() < 0.015


def test_late_actions_change_the_walk_and_friction_the_slip(policy: GaitPolicy):
    late = Conditions(latency_substeps=np.array([0, 4]))
    trial = start(policy, 2, late)
    for _ in range(50):
        trial.step(np.array([[0.6, 0.0, 0.0]] * 2))
    assert not np.array_equal(trial.position_m[0], trial.position_m[1])
    ice = start(policy, 2, Conditions(friction=np.array([0.1, 1.0])))
    slip = []
    for _ in range(50):
        ice.step(np.array([[0.6, 0.0, 0.6]] * 2))
        slip.append(ice.slip)
    icy, firm = np.nanmean(slip, axis=(0, 2))
    assert icy > 2 * firm


def test_a_standing_robot_does_not_slip_and_a_pushed_one_is_kicked_at_its_time(policy):
    trial = start(policy, 3, Conditions(push_m_s=0.5))
    kicks = np.zeros(3)
    for _ in range(round(6.0 / STEP_S)):
        before = trial.velocity[:, :2]
        if not kicks.any():
            assert np.nan_to_num(trial.slip).max() < 0.05
        trial.step(np.zeros((3, 3)))
        kicks += np.linalg.norm(trial.velocity[:, :2] - before, axis=1) > 0.2
    assert (kicks[trial.going] >= 2).all()


def test_displacements_are_given_in_the_frame_of_their_start():
    north = StartedAction(Action.FORWARD, 0.0, np.array([1.0, 1.0, np.pi / 2]))
    turn = StartedAction(Action.LEFT, 0.5, np.array([0.98, 1.25, np.pi - 0.05]))
    stop = StartedAction(Action.STOP, 0.8, np.array([0.98, 1.25, -np.pi + 0.2]))
    kinds, moved, seconds = displacements([[north, turn, stop]])
    assert kinds == [Action.FORWARD, Action.LEFT]
    np.testing.assert_allclose(moved[0], (0.25, 0.02, np.pi / 2 - 0.05), atol=1e-12)
    np.testing.assert_allclose(moved[1], (0.0, 0.0, 0.25), atol=1e-12)
    np.testing.assert_allclose(seconds, (0.5, 0.3))


def test_closed_loop_actions_are_exact_and_timed_ones_last_a_quarter_second(policy: GaitPolicy):
    results = {}
    for closed in (False, True):
        rng = np.random.default_rng(1)
        config = SpeedConfig(end_on_displacement=closed)
        results[closed] = action_errors(policy, config, 2, Conditions.mixed(2, rng), rng, 40)
    assert results[False]["seconds_per_action"] == pytest.approx(0.25)
    assert results[True]["position_p90_m"] < 0.04 < results[False]["position_p90_m"]
    assert results[True]["heading_p90_deg"] < 2.0
    assert results[True]["step_mean_m"] == pytest.approx(0.25, abs=0.01)
    assert results[True]["turn_mean_deg"] == pytest.approx(15.0, abs=0.6)
    assert results[True]["actions"] == 80


@pytest.mark.parametrize("name", ["h1", "g1"])
def test_a_humanoid_by_speed_comes_to_rest_at_the_goal(name: str):
    """It is stopped in the middle of an action: seldom at a steady speed, often just turned."""
    policy, rng = GaitPolicy.load(get_robot(name)), np.random.default_rng(9)
    result = follow_paths(policy, 8, Conditions(), rng, by_speed=True)
    assert result["reached"] == 1.0


@pytest.mark.parametrize("seed", range(5))
def test_random_paths_have_their_length(seed: int):
    path = random_path(np.random.default_rng(seed))
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() == pytest.approx(12.0, abs=0.06)
    middle = 0.5 * (path[0] + path[1])
    assert distances_to_path([middle], path) == pytest.approx(0.0, abs=1e-9)
    assert distances_to_path([path[0] - [0.3, 0.4]], path) == pytest.approx(0.5, abs=0.2)


def test_evaluation_ground_is_as_rough_as_it_says():
    terrain = noise_terrain(np.random.default_rng(0), 0.06)
    assert terrain.height_m is not None
    assert terrain.height_m.max() == pytest.approx(0.06)
    assert Terrain().at(np.zeros((1, 2)))[0] == 0.0


def test_publishing_keeps_a_calibration(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(evaluate, "evaluation_table", lambda policy, scale: {"scale": scale})
    robot = get_robot("aliengo")
    assert evaluate.publish(robot, POLICY_FOLDER, tmp_path, 0.5) == {"scale": 0.5}
    card = GaitPolicy.load(robot, tmp_path).card
    assert card.gait == GaitPolicy.load(robot).card.gait
    assert card.gait.aim
    assert card.evaluation == {"scale": 0.5}

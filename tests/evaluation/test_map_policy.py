"""The policy `map`: its map against the known rooms, and that it knows nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.collectors.test_replay import make_episode
from vlnpe.collectors.replay.replay import ReplayConfig
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.evaluation.episode import closed_loop, evaluate_episode
from vlnpe.evaluation.observation import Eye
from vlnpe.evaluation.policies.map_policy.inference import parts_of_text
from vlnpe.evaluation.policies.map_policy.policy import MapPolicy
from vlnpe.evaluation.policies.map_policy.routes import Routes, next_action, waypoints
from vlnpe.evaluation.policies.map_policy.seen_map import SeenMap
from vlnpe.evaluation.policy import Assignment, PolicyError
from vlnpe.formats.core.rollout import Action, Rollout
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.rendering.camera.views import make_view
from vlnpe.rendering.registry import make_renderer

START = (2.6, 2.0)  # in the kitchen, looking through the doorway
TEXT = "Go through the doorway into the living room and stop near the sofa."


class Watched(MapPolicy):
    """Keeps what it was told and shown."""

    def reset(self, assignment: Assignment) -> None:
        self.told, self.shown = [assignment], []
        super().reset(assignment)

    def act(self, observation):
        self.shown.append(observation)
        return super().act(observation)


def walked(two_rooms: SceneBundle, policy: MapPolicy, goal, *, kind="discrete") -> Rollout:
    episode = replace(make_episode(two_rooms, START, goal), instruction=TEXT)
    controller = "flash" if kind == "discrete" else "path"
    robot = "vlnce" if kind == "discrete" else "jetbot"
    config = closed_loop(ReplayConfig(robot=robot, controller=controller))
    world = open_world(two_rooms, 0, get_robot(robot))
    eye = Eye(world, make_view("ego", robot, width_px=96), make_renderer(two_rooms, "embree"))
    return evaluate_episode(world, episode, config, policy, eye, kind=kind)


@pytest.fixture(scope="module")
def walk(two_rooms: SceneBundle) -> tuple[Watched, Rollout]:
    policy = Watched()
    return policy, walked(two_rooms, policy, (6.6, 1.5))


def test_it_finds_the_sofa_in_the_other_room_and_stops_there(walk) -> None:
    _, rollout = walk
    assert rollout.metrics.success
    x, y = rollout.position_world_m[-1, :2]
    assert x > 4.0 and np.linalg.norm(np.clip((x, y), (6.0, 0.2), (7.6, 1.0)) - (x, y)) < 2.2
    assert any(event.kind == "said" and "ends here" in event.detail for event in rollout.events)


def test_its_map_is_that_of_the_rooms(walk) -> None:
    seen = walk[0].seen
    cells = seen.grid.cell_of

    def at(mask, x: float, y: float) -> bool:  # world [m]; the start frame begins at START, yaw 0
        return bool(mask[tuple(cells(np.array([x - START[0], y - START[1]])))])

    assert at(seen.free, 4.0, 2.0) and at(seen.free, 5.0, 2.5)  # the doorway, the other room
    assert at(seen.obstacle, 8.05, 2.0) and not at(seen.free, 8.05, 2.0)  # the east wall
    assert not seen.explored[tuple(cells(np.array([0.0, 4.0])))]  # beyond the north wall
    sofa = next(thing for thing in seen.things.values() if thing.noun == "sofa")
    assert np.allclose(sofa.low_m[:2] + START, (6.0, 0.2), atol=0.15)
    assert np.allclose(sofa.high_m[:2] + START, (7.6, 1.0), atol=0.15)


def test_it_receives_neither_goal_nor_path_nor_world_coordinates(two_rooms, walk) -> None:
    """Another goal and another path, hence another episode, and the same walk to the bit."""
    policy, rollout = walk
    other = Watched()
    again = walked(two_rooms, other, (5.0, 3.4))
    assert np.array_equal(again.position_world_m, rollout.position_world_m)
    assert [o.to_dict().keys() for o in other.shown[:1]] == [
        o.to_dict().keys() for o in policy.shown[:1]
    ]
    assert set(vars(policy.told[0])) == {
        "episode_id", "scene_id", "instruction", "robot", "controller", "actions"
    }  # fmt: skip
    first = policy.shown[0]
    assert np.allclose(first.pose, 0.0) and np.abs(first.lens.position_m[:2]).max() < 0.5
    assert 0.1 < first.lens.position_m[2] < 2.0  # above the floor, not in world coordinates


def test_it_moves_by_waypoints_in_physics_too(two_rooms) -> None:
    assert walked(two_rooms, MapPolicy(), (6.6, 1.5), kind="waypoints").metrics.success


def test_routes_lead_around_obstacles() -> None:
    seen = SeenMap()
    middle = seen.grid.rows // 2
    seen.floor[middle - 20 : middle + 20, middle - 10 : middle + 40] = True
    seen.hits[middle - 10 : middle + 20, middle + 10 : middle + 12] = 9  # a wall ahead, to the left
    path = Routes.spread(seen, np.zeros(2), 0.2).path_to(np.array([2.5, 0.0]))
    assert np.allclose(path[[0, -1]], [(0.0, 0.0), (2.5, 0.0)], atol=0.1)
    assert path[:, 1].min() < -1.1 and not seen.obstacle[tuple(seen.grid.cell_of(path).T)].any()
    assert next_action(path, np.zeros(3)) is Action.RIGHT
    assert next_action(path, np.array([0.0, 0.0, np.arctan2(*path[6][::-1])])) is Action.FORWARD
    steps = waypoints(path, np.zeros(3))
    assert steps.shape == (4, 3) and np.hypot(*steps[0, :2]) == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize(
    ("text", "ways", "after"),
    [
        ("Leave the kitchen, go up the stairs, turn right and stop by the bed.", "up", "turn stop"),
        (
            "Descend the stairs, going left at the landing, then at the bottom, turn right. Stop.",
            "down",
            "turn stop",
        ),
        ("Go up the stairs and stop.", "up", "stop"),
        (
            "Go up the stairs to the landing, turn left, go up the second flight. Walk to the bed "
            "and stop.",
            "up",
            "place stop",
        ),
        (
            "Take the stairs up, at the landing turn right and continue up to the second floor. "
            "Stop by the desk.",
            "up",
            "stop",
        ),
        ("Climb halfway, turn around, climb the rest, and stop at the sink.", "up", "stop"),
        (
            "Ascend the stairs, pass the landing with the plant, and continue to the top. Turn "
            "left and stop at the desk.",
            "up",
            "turn stop",
        ),
        ("Go down the stairs, at the bottom turn left and stop by the bed.", "down", "turn stop"),
        ("Go up the stairs and along the landing to the bedroom. Stop.", "up", "place stop"),
        ("Take the stairs, then turn left and stop by the sofa.", "either", "turn stop"),
        ("Take the stairs, turn left, continue down and stop by the sofa.", "down", "stop"),
        ("Go upstairs, turn left, then take the stairs down and stop.", "up down", "stop"),
        ("Go up to the second floor, turn left, go up to the third floor. Stop.", "up up", "stop"),
        (
            "Go up the stairs, turn left, walk down the hallway, go up the next stairs and stop.",
            "up up",
            "stop",
        ),
        (
            "Go up the stairs. Enter the hallway, then go down the stairs and stop.",
            "up down",
            "stop",
        ),
    ],
)
def test_a_text_is_split_at_the_stairs_that_it_takes(text: str, ways: str, after: str) -> None:
    *before, last = parts_of_text(text)
    assert " ".join(part.way for part in before) == ways and not last.way
    for part in before:
        stairs = part.goals[-1]
        assert stairs.kind == "stop" and stairs.noun is not None and stairs.noun.head == "stairs"
    assert " ".join(goal.kind for goal in last.goals) == after


def test_instructions_are_read_and_nonsense_is_refused() -> None:
    (part,) = parts_of_text(TEXT)
    assert [goal.kind for goal in part.goals] == ["place", "place", "stop"] and not part.way
    (part,) = parts_of_text("Turn left and walk past the bed")  # no stop was said
    assert part.goals[-1].kind == "stop"
    policy = MapPolicy()
    with pytest.raises(PolicyError, match="velocity; valid: discrete, waypoints"):
        policy.reset(Assignment("e", "s", TEXT, "h1", "speed", "velocity"))

"""The follower: true texts lead it to the goal, false and shuffled ones do not."""

import numpy as np
import pytest

from tests.instruction_gen.test_instruct import EAST, LEFT, episode_of, texts_of
from vlnpe.instruction_gen.follower import World, follow

pytestmark = pytest.mark.chain


@pytest.fixture(scope="module")
def world(two_rooms):
    return World(two_rooms, 0)


def off_m(text, world, points):
    """Distance from the goal of a path [m]; inf when the follower is lost."""
    episode = episode_of(points)
    done = follow(text, world, episode.start_position_world_m[:2], episode.start_yaw_rad)
    away = np.linalg.norm(done.position_m - episode.goal_position_world_m[:2])
    return np.inf if done.lost else float(away)


@pytest.mark.parametrize("points", [EAST, LEFT, EAST[::-1], LEFT[::-1]])
def test_composed_texts_lead_to_the_goal(two_rooms, world, points):
    texts = [t for seed in range(3) for t in texts_of(points, two_rooms, seed, count=2)]
    assert np.mean([off_m(text, world, points) <= 3.0 for text in texts]) >= 0.8


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Turn left into the kitchen and stop at the grand piano.", "lost at"),
        ("Turn left into the bathroom and stop at the table.", "lost at"),
        ("Turn left into the kitchen, then walk on past the table.", "never says to stop"),
        ("Stop at the sofa. Then turn left into the kitchen.", "goes on after the stop"),
        ("the of table left doorway zorb quux flim table the glorp", "no sentence"),
    ],
)
def test_what_cannot_be_followed_is_named(world, text, why):
    episode = episode_of(LEFT)
    done = follow(text, world, episode.start_position_world_m[:2], episode.start_yaw_rad)
    assert why in done.lost


def test_the_side_decides(world):
    assert off_m("Turn left through the door and stop at the table.", world, LEFT) <= 2.0
    assert off_m("Turn right and stop next to the sofa.", world, LEFT) > 2.0

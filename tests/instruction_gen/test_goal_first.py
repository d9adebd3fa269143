"""Texts that say their goal before the way to it."""

import numpy as np
import pytest

from benchmarks.instructions.rewording import goal_first
from tests.instruction_gen.test_instruct import EAST, LEFT, episode_of, facts_of, texts_of
from vlnpe.instruction_gen.checker import check_text
from vlnpe.instruction_gen.follower import World, follow
from vlnpe.instruction_gen.language.announced import announcement
from vlnpe.instruction_gen.language.parse import parse

WAY = "turn left and go through the doorway into the kitchen."


@pytest.mark.parametrize(
    "goal",
    [
        "Your goal is {}. To get there, ",
        "You want to end up beside {}: ",
        "We're after {}; for that, ",
        "{} is where this ends, so ",
        "Destination: {}. First ",
        "To reach {}, ",
        "Make for {}: ",
        "Next to {}, that's where you stop: ",
        "Looking for {}? Then ",
        "Our walk finishes by {}, which means ",
    ],
)
def test_a_goal_said_first_is_checked_at_the_end(two_rooms, goal):
    facts = facts_of(LEFT, two_rooms)

    def ok(thing):
        said = goal.format(f"the {thing}")
        return check_text(said[0].upper() + said[1:] + WAY, facts).ok

    assert ok("table")
    assert not ok("sofa") and not ok("piano")


def test_the_way_after_a_goal_is_checked(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    text = f"Your goal is the table in the kitchen. To get there, {WAY}"
    assert check_text(text, facts).ok
    assert not check_text(text.replace("left", "right"), facts).ok
    assert not check_text(text.replace("kitchen", "bathroom"), facts).ok
    assert not check_text(f"{text} Stop next to the sofa.", facts).ok


@pytest.mark.parametrize(
    "text",
    [
        "Past the table, turn left and stop at the sofa.",
        "With the table on your left, go to the sofa and stop.",
        "Go past the table, then left, and you should see the sofa; stop there.",
        "From where you are, turn left and stop at the sofa.",
        "Stop at the sofa. Then turn left into the kitchen.",
        "Your goal is the table in the kitchen.",
    ],
)
def test_what_says_a_way_announces_no_goal(text):
    assert announcement(parse(text)) == (0, False)


def test_composed_texts_pass_with_their_goal_first(two_rooms):
    rng = np.random.default_rng(0)
    made = 0
    for points in (EAST, LEFT, EAST[::-1], LEFT[::-1]):
        facts = facts_of(points, two_rooms)
        for text in [t for seed in range(3) for t in texts_of(points, two_rooms, seed, count=2)]:
            said = goal_first(text, rng)
            if said is not None:
                made += 1
                assert check_text(said, facts).problems == ()
    assert made >= 8


def test_the_follower_finds_a_goal_said_first(two_rooms):
    episode = episode_of(LEFT)
    start = episode.start_position_world_m[:2]
    done = follow(
        f"Your goal is the table. To get there, {WAY}",
        World(two_rooms, 0),
        start,
        episode.start_yaw_rad,
    )
    assert not done.lost
    assert np.linalg.norm(done.position_m - episode.goal_position_world_m[:2]) <= 2.0

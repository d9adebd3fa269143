"""Texts about stairs: true ones pass, up for down and its like are refused, the composer's hold.

The path leads from a kitchen through a living room, up a flight, left at its landing and up again;
at the top it turns right along a hallway into a bedroom.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.instruction_gen.test_instruct import episode_of
from tests.support.scenes.storeys import TOP_M, write_two_storeys
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.scene.staircase import Staircase
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.composer import compose_texts
from vlnpe.instruction_gen.facts import LevelFacts, path_facts
from vlnpe.instruction_gen.language.reader import read_text
from vlnpe.instruction_gen.records import STYLES

MIDDLE_M = TOP_M / 2
LINE = [
    (10.0, 1.0, 0.0), (10.4, 1.0, 0.0), (11.8, 1.0, MIDDLE_M), (12.6, 1.0, MIDDLE_M),
    (12.6, 1.6, MIDDLE_M), (12.6, 3.2, TOP_M), (12.6, 3.6, TOP_M),
]  # fmt: skip
BELOW = [(1.5, 2.0, 0.0), (7.0, 2.0, 0.0), (9.0, 1.0, 0.0)]
ABOVE = [(14.0, 3.2, TOP_M), (17.0, 2.0, TOP_M), (21.0, 2.0, TOP_M)]
ROOMS = {"Room_hall": "living room", "Room_landing": "hallway"}

# A staircase that comes back over its landing, and the way from its top to the bedroom.
U_LINE = [
    (10.0, 1.0, 0.0), (10.4, 1.0, 0.0), (12.6, 1.0, MIDDLE_M), (13.6, 1.0, MIDDLE_M),
    (13.6, 2.4, MIDDLE_M), (12.6, 2.4, MIDDLE_M), (10.4, 2.4, TOP_M), (10.0, 2.4, TOP_M),
]  # fmt: skip
U_ABOVE = [(9.9, 2.4, TOP_M), (9.9, 3.4, TOP_M), (14.0, 3.4, TOP_M), *ABOVE[1:]]


@pytest.fixture(scope="module")
def levels(tmp_path_factory):
    return levels_of(tmp_path_factory.mktemp("building"), LINE)


def levels_of(folder, line):
    bundle = write_two_storeys(folder)
    rooms = tuple(
        replace(o, category=f"room:{ROOMS[o.name]}") if o.name in ROOMS else o
        for o in bundle.objects
    )
    stairs = Staircase((0, 1), np.array(line), 1.0, 0.175, 0.26)
    bundle = replace(bundle, staircases=(stairs,), objects=rooms)
    return [LevelFacts.of(bundle, level) for level in (0, 1)]


def ground_of(levels, points, up=True, staircase=0):
    points = points if up else points[::-1]
    episode = episode_of([p[:2] for p in points])
    path = np.array(points, dtype=float)
    own = (0, 1) if up else (1, 0)
    episode = replace(
        episode, level=own[0], reference_path_world_m=path, start_position_world_m=path[0],
        goal_position_world_m=path[-1], extra={"staircases": [staircase], "levels": list(own)},
    )  # fmt: skip
    return Ground(path_facts(episode, levels[own[0]], None, [levels[own[1]]]))


@pytest.fixture(scope="module")
def up(levels):
    return ground_of(levels, [*BELOW, *LINE[1:-1], *ABOVE])


@pytest.fixture(scope="module")
def down(levels):
    return ground_of(levels, [*BELOW, *LINE[1:-1], *ABOVE], up=False)


@pytest.fixture(scope="module")
def back(tmp_path_factory):
    levels = levels_of(tmp_path_factory.mktemp("building"), U_LINE)
    return ground_of(levels, [*BELOW, *U_LINE[1:-1], *U_ABOVE])


def test_a_path_over_a_staircase_that_is_not_there_is_refused(levels):
    with pytest.raises(InputError, match="staircase 3 of two_storeys; valid: 0 … 0"):
        ground_of(levels, [*BELOW, *LINE[1:-1], *ABOVE], staircase=3)


def test_facts_of_a_path_over_stairs(up, down):
    (climb,) = up.facts.climbs
    assert climb.way == "up" and climb.to_level == 1
    assert climb.to_m - climb.along_m == pytest.approx(2.2 + 2.2, abs=0.1)
    assert [round(b - a, 1) for a, b in climb.landings_m] == [1.4]
    assert [v.room for v in up.facts.visits] == ["kitchen", "living room", "hallway", "bedroom"]
    assert down.facts.climbs[0].way == "down"
    assert [v.room for v in down.facts.visits] == ["bedroom", "hallway", "living room", "kitchen"]
    assert {"kitchen", "bedroom"} <= {*up.facts.level_rooms}


@pytest.mark.parametrize(
    "text",
    [
        "Walk through the living room, up the stairs. At the top turn right, go into the bedroom.",
        "Leave the kitchen, go upstairs, turn right and stop in the bedroom.",
        "Walk to the stairs and climb them. Turn left on the landing and keep climbing to the top. "
        "Then go right and into the bedroom.",
        "Go straight to the staircase and walk up one flight to the second floor. When you reach "
        "the top of the stairs, take a right. Stop in the bedroom.",
        "Take the stairs up to the first floor, go right and walk down the hallway to the bedroom.",
        "Ascend the stairs, turning left halfway. Upstairs, turn right and enter the bedroom.",
        "Stop in the bedroom upstairs.",
        "Leave the ground-floor kitchen, walk through the lower living room into the stairwell and "
        "ascend. At the top turn right, stroll down the upper hallway and stop in the bedroom.",
        "Out of the kitchen, upstairs, right at the top. Down the upstairs hall, stop in the "
        "upper-floor bedroom.",
        "Hi! Walk to the base of the stairs. Up you go. At the top go right. Stop in the bedroom.",
        "Go up one storey using the stairs, turn right and stop in the bedroom.",
        "Climb two flights of stairs, turn right and stop in the bedroom.",
        "Kitchen -> living room -> up the stairs (2 flights), left at half-landing. Right at top, "
        "~6 m, stop in bedroom.",
        "ok go thru the living room n up the stairs dear, at the top its right n into the bedroom "
        "lol",
        "Parcel for upstairs: leave the kitchen, go up one floor, turn right and put it down in "
        "the bedroom.",
        "Forgive me if I go slowly, my dear. If you would walk to the stairs, please, which we "
        "climb, two flights. At the top turn right. You go into the bedroom.",
        "Morning love. Out of the kitchen, up stairs, landing left. Top R, into the bedroom. Stop.",
        "Parcel from the kitchen to the bedroom: up the stairs, right at the top, in at the door.",
        "Through the living room, up the stairs, right at the top. Leave it in the bedroom.",
        "Walk along the living room downstairs, mind your toes, up the stairs, right and into the "
        "bedroom.",
    ],
)
def test_true_texts_pass(up, text):
    assert check_text(text, up).problems == ()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("Walk on and down the stairs. Turn right, go into the bedroom.", "no stairs down"),
        ("Go downstairs, turn right and stop in the bedroom.", "no stairs down"),
        ("Go up the stairs, right on the landing. Go on up, stop in the bedroom.", "no turn"),
        ("Go up the stairs. At the top turn left and go into the bedroom.", "to the left"),
        ("Go up the stairs into the hallway. There turn left into the bedroom.", "to the left"),
        ("Go to the stairs and up to the third floor. Stop in the bedroom.", "third floor"),
        ("Go into the bedroom, then up the stairs, and stop in the hallway.", "elsewhere"),
        ("Leave the kitchen, go up the stairs and stop in the living room.", ""),
        ("Go through the living room. Turn right, pass the hallway and stop.", "to the right"),
        ("Go up the stairs on your right, turn right and stop in the bedroom.", "on the right"),
        ("Go up the stairs and stop at the top of the stairs.", "top of the stairs"),
        ("Go halfway up the stairs and stop there.", "goes on"),
        ("Do not go up the stairs. Stop in the bedroom.", "does"),
        ("Stop in the bedroom downstairs.", "downstairs"),
        ("Climb two storeys, turn right and stop in the bedroom.", "2 storeys"),
        ("Go up the stairs three full floors. Stop in the bedroom.", "3 storeys"),
        ("Leave the lower kitchen and go up. Stop in the lower bedroom.", "downstairs"),
        ("At the base of the stairs turn around. Stop in the bedroom.", "around"),
        ("The stairs are on your right; go up. Stop in the bedroom.", "on the right"),
        ("Go up four flights of stairs, turn right and stop in the bedroom.", "4 flights"),
        ("Go up the stairs, three flights. Turn right and stop in the bedroom.", "3 flights"),
        ("Go up the stairs. At the bottom turn right and go into the bedroom.", "bottom"),
        ("Out of the kitchen, up the stairs, landing right. Top R, into the bedroom. Stop.",
         "no turn"),
        ("Out of the kitchen. Right up the stairs, right at the top. Stop in the bedroom.",
         "not on"),
        ("Go up the stairs, right in the middle. At the top right. Stop in the bedroom.",
         "no turn"),
        ("Parcel for downstairs: up the stairs, right, put it down in the bedroom.", "downstairs"),
        ("Through the living room, up the stairs, right. Leave it in the kitchen.", ""),
        ("Go to the stairs, up n turn left at the top, stop in the bedroom lol.", "to the left"),
    ],
)  # fmt: skip
def test_lies_are_refused(up, text, reason):
    verdict = check_text(text, up)
    assert any(reason in problem for problem in verdict.problems), verdict


@pytest.mark.parametrize(
    "text",
    [
        "At the half landing turn {left}.",
        "On the middle platform swing {left}.",
        "In the half turn to the {left}.",
        "Halfway they turn {left}.",
        "Bear {left} on the little landing.",
        "Go round to the {left} at the landing and on up.",
        "They reverse to the {left} at the mid-landing.",
        "Double back to the {left} at the quarter landing.",
        "Rotate 180 degrees {clockwise} at the intermediate landing.",
        "Make a {clockwise} U-turn on the intermediate platform.",
        "Follow them, round to the {left} at the landing.",
    ],
)
def test_a_landing_that_leads_back_is_one_turn(back, text):
    way = (
        "Leave the kitchen and take the stairs up to the upper floor. {} At the top turn right and "
    )
    way += "right again. Stop in the bedroom."
    true = text.format(left="left", clockwise="counter-clockwise")
    assert check_text(way.format(true), back).problems == ()
    lie = text.format(left="right", clockwise="clockwise")
    assert not check_text(way.format(lie), back).ok


def test_the_way_down_is_told_apart_from_the_way_up(down):
    text = "Leave the bedroom, turn left and go {} the stairs. On the landing turn right. {}"
    kitchen = "At the {} walk through the living room into the kitchen."
    assert check_text(text.format("down", kitchen.format("bottom")), down).problems == ()
    assert not check_text(text.format("up", kitchen.format("top")), down).ok
    assert check_text("Descend to the ground floor. Stop in the kitchen.", down).ok
    assert not check_text("Descend to the second floor. Stop in the kitchen.", down).ok


@pytest.mark.parametrize(
    ("text", "true"),
    [
        ("Walk past the stairs on your right and stop.", True),
        ("Do not go up the stairs. Walk past them and stop.", True),
        ("You are on the ground floor. Walk on past the foot of the stairs and stop.", True),
        ("Walk past the stairs on your left and stop.", False),
        ("Go up the stairs and stop.", False),
        ("Take the stairs and stop.", False),
        ("You are upstairs. Walk past the stairs and stop.", False),
    ],
)
def test_a_path_on_one_level_passes_stairs_and_takes_none(levels, text, true):
    ground = Ground(path_facts(episode_of([(9.2, 0.3), (9.2, 3.0)]), levels[0]))
    assert [m.name for m in ground.facts.landmarks if m.noun == "stairs"] == ["stairs-0"]
    assert check_text(text, ground).ok == true, check_text(text, ground)


@pytest.mark.parametrize("which", ["up", "down"])
def test_composed_texts_take_the_stairs_and_hold(up, down, which):
    ground = {"up": up, "down": down}[which]
    for seed in range(3):
        got, problems = compose_texts(ground, 3, STYLES, np.random.default_rng(seed))
        assert len(got) == 3, problems
        for one in got:
            climbs = [c for s in one.steps for c in s.claims if c.kind == "climb"]
            assert [c.way for c in climbs] == [which]
            assert check_text(one.text, ground, one.steps).problems == ()
            assert check_text(one.text, ground).problems == (), one.text
            lies = [replace(s, words=_swapped(s.words)) for s in one.steps]
            lie = " ".join(step.words for step in lies)
            assert lie != one.text
            assert not check_text(lie, ground, lies).ok and not check_text(lie, ground).ok


def _swapped(words):
    """Return words that go down for up and up for down."""
    pairs = [("up", "down"), ("upstairs", "downstairs"), ("climb", "descend")]
    other = {a: b for pair in pairs for a, b in (pair, pair[::-1])}
    return re.sub(r"\w+", lambda m: other.get(m[0].lower(), m[0]), words)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Go up the stairs on your left.", ["climb up stairs left"]),
        ("Take the stairs leading down.", ["climb down stairs"]),
        ("Walk over to the staircase. Go up it.", ["reach staircase", "climb up"]),
        ("Head downstairs.", ["climb down"]),
        ("Drop down the stairs and stop at the sofa.", ["climb down stairs"]),
        ("Drop into the hall, drop the parcel at the sofa.", ["enter hall"]),
        ("Step down to the ground floor.", ["climb down", "in ground floor"]),
        ("Turn left at the top of the steps.", ["reach stairs top", "turn left"]),
        ("Walk down the hall on the second floor.", ["in hall", "in second floor"]),
        ("Walk along the upstairs hallway.", ["in upstairs", "in hallway"]),
        ("Walk past the second floor lamp.", ["pass floor lamp"]),
        ("Do not go up the stairs.", ["avoid up stairs"]),
        ("Go up and left.", ["turn left"]),
        ("Wander down the upstairs hall.", ["in upstairs", "in hall"]),
        ("Leave the office door on your left.", ["pass left"]),
        (
            "You see the study door across the hall. Don't go in there.",
            ["see", "see hall", "avoid study"],
        ),
        ("Circle the table clockwise.", ["pass table"]),
        ("Down you go.", []),
        (
            "Take the stairs. Down you go. At the foot, turn anti-clockwise.",
            ["climb stairs", "climb down", "reach stairs bottom", "turn left"],
        ),
    ],
)
def test_what_is_read_of_stairs(text, told):
    claims = [c for step in read_text(text) for c in step.claims if c.kind != "stop"]
    rows = [(c.kind, c.way, c.name, c.side, c.place) for c in claims]
    assert [" ".join(filter(None, row)) for row in rows] == told

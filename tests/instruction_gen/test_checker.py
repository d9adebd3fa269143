"""The checker: true texts pass, each kind of lie is refused, claims must cover their words."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.instructions.buildings import building
from benchmarks.instructions.corpus import FOLDER, episode_of_record
from tests.instruction_gen.test_instruct import EAST, LEFT, facts_of
from vlnpe.formats.core.errors import InputError
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.facts import path_facts
from vlnpe.instruction_gen.language.claims import Claim, claim_record, read_steps
from vlnpe.instruction_gen.language.reader import read_text


@pytest.fixture(scope="module")
def villa():
    """The facts of five paths in a generated villa."""
    document = json.loads(Path(FOLDER / "villa-43.json").read_text())
    level = building("villa", 43)
    episodes = [episode_of_record(record, "villa-43") for record in document["paths"][:5]]
    return [Ground(path_facts(episode, level)) for episode in episodes]


# Written from the map and the facts, before the checker was finished: path of the villa, text.
TRUTHS = [
    (
        0,
        "Leave the children's room and turn left into the hallway. Walk past the mirror and "
        "the shoe cabinet, pass the bench on the right and stop just after the coat rack.",
    ),
    (
        0,
        "Head out of the kids' room past the wardrobe on your left. In the hall go left, "
        "carry on to the end past the bench, and stop outside the bathroom.",
    ),
    (
        1,
        "Walk down the hall and turn left. Go left again into the children's room just after "
        "the shoe cabinet, walk past the wardrobe, and stop by the chair at the desk.",
    ),
    (
        2,
        "Walk past the bed and out of the bedroom. Go right along the hall past the coat "
        "rack, then left into the bathroom. Stop in front of the washbasin.",
    ),
    (
        2,
        "Past the dresser you leave the bedroom; veer right and follow the corridor until a "
        "bathroom opens on your left. Enter it and stop with the toilet on your right.",
    ),
    (
        3,
        "Turn right out of the bedroom and walk past the shoe cabinet. Turn left into the "
        "kids' room and stop once you've passed the wardrobe.",
    ),
    (
        4,
        "Walk along the dining table and turn right at its end. Go past the fridge into the "
        "living room, turn left into the hallway, and take the next doorway on the left, "
        "which is the office. Stop on the rug.",
    ),
    (
        4,
        "Pass the fridge and go through into the living room, then left by the sideboard into "
        "the hall. Walk about three metres and turn left into the study. Stop before the "
        "bookshelf.",
    ),
]
TRUTHS += [
    (0, "Out of kids' room, left, past mirror, bench right, stop past coat rack."),
    (0, "You want the coat rack. Go out of the children's room and left down the hall."),
    (0, "Leave the kids' room and turn left. There is a bathroom on the right. Stop outside it."),
    (1, "Go left, left again, there is the kids' room. Go in and carry on as far as the chair."),
    (2, "Once you're out of the bedroom go right, then it's left into the bathroom. Stop with the "
        "toilet on your right and the bathtub on your left."),
    (2, "Clean the washbasin in the bathroom."),
    (2, "Go to the bathroom and wipe the toilet."),
    (3, "Right out of the bedroom, past the shoe cabinet, then bear left into the children's room. "
        "Stop just after the wardrobe."),
    (0, "This is the children's room. Walk out, turn left and go past the bench on your right. "
        "After that comes a coat rack; stop there."),
    (2, "Scrub the washbasin in the bathroom."),
    (3, "Leave the bedroom and turn right. Pass the bathroom door on your left, then go in at the "
        "next door on your left. Stop past the wardrobe."),
    (0, "Leave the children's room and turn left. On your right comes first the shoe cabinet and "
        "after it the bench. Stop after the coat rack."),
    (3, "Turn right out of the bedroom. The kids' room is the second door on your left. Go in and "
        "stop past the wardrobe."),
    (4, "Skirt the dining table, go past the fridge into the living room, left into the hall, and "
        "in at the first door on the left. Stop there."),
    (4, "You are in the kitchen. Pass the fridge and go on into the living room. Take the hallway "
        "to the left, and go in at the first door on your left. Stop."),
    (4, "Walk along the table, keeping it on your right. Go right past the fridge, straight into "
        "the living room, left into the hall, and in at the next door on the left. Stop there."),
    (4, "The samples go through the living room to the office. From the kitchen go right past the "
        "fridge, straight into the living room, left into the hall, and in at the next door on the "
        "left. Set them down there."),
    (4, "Skirt the dining table, there is really no hurry, go past the fridge into the living "
        "room, left into the hall, and in at the first door on the left. Leave them a metre in."),
    (0, "Leave the children's room and turn left. Go past the bench and stop outside the bathroom "
        "without going in."),
    (2, "Leave the bedroom, go right, and in at the bathroom, that is on the left. Stop at the "
        "washbasin. If you reach the office, you've gone too far."),
    (2, "Leave the bedroom, go right, then left into the bathroom. You've gone too far if you "
        "reach the office. Stop at the washbasin."),
    (2, "Leave the bedroom, go right, and in at the bathroom, that is on the left. Stop at the "
        "washbasin."),
    (2, "Walk past the bed and over the threshold into the hall without turning left. Go right, "
        "then left into the bathroom. Stop in front of the washbasin."),
    (4, "Pass the fridge; the living room is straight ahead. Go in, turn left into the hall, left "
        "into the study, and stop on the rug."),
    (0, "Take the basket out of the children's room, turn left, and stop past the coat rack. It is "
        "a bit on the right."),
]  # fmt: skip
LIES = [
    (4, "preface", "The samples go through the living room to the hall. From the kitchen go right "
        "past the fridge, straight into the living room, left into the hall, and in at the next "
        "door on the left. Set them down there."),
    (0, "thing", "Leave the children's room and turn left into the hallway. Keep the dulcimer on "
        "your left, and stop just after the coat rack."),
    (0, "ending", "Leave the children's room and turn left into the hallway. Stop just after the "
        "coat rack. Into the kitchen."),
    (
        0,
        "turn",
        "Leave the children's room and turn right into the hallway. Walk past the mirror and "
        "the shoe cabinet, pass the bench and stop just after the coat rack.",
    ),
    (
        0,
        "side",
        "Leave the children's room and turn left into the hallway. Pass the bench on your "
        "left and stop just after the coat rack.",
    ),
    (
        0,
        "doorway",
        "Head out of the kids' room past the wardrobe on your left. In the hall go left, "
        "carry on past the bench, and stop outside the kitchen.",
    ),
    (
        1,
        "ordinal",
        "Walk down the hall and turn left. Take the ninth door on the left into the "
        "children's room, walk past the wardrobe and stop by the desk.",
    ),
    (
        1,
        "doorside",
        "Walk down the hall and turn left. Take the door on the right into the children's "
        "room, walk past the wardrobe, and stop by the desk.",
    ),
    (
        2,
        "turn",
        "Walk past the bed and out of the bedroom. Go left along the hall past the coat rack, "
        "then left into the bathroom. Stop in front of the washbasin.",
    ),
    (
        2,
        "room",
        "Walk past the bed and out of the bedroom. Go right along the hall past the coat "
        "rack, then left into the office. Stop in front of the washbasin.",
    ),
    (
        3,
        "roomorder",
        "Turn right into the children's room, walk past the shoe cabinet, then go left into "
        "the hallway and stop once you've passed the wardrobe.",
    ),
    (
        3,
        "turn",
        "Turn left out of the bedroom and walk past the shoe cabinet. Turn left into the "
        "kids' room and stop once you've passed the wardrobe.",
    ),
    (
        4,
        "side",
        "Walk along the dining table and turn right at its end. Go past the fridge on your "
        "left into the living room, turn left into the hallway, then left into the office. "
        "Stop on the rug.",
    ),
    (
        4,
        "inout",
        "Walk along the dining table and turn right. Go past the fridge out to the garage, "
        "turn left into the hallway, then left into the office. Stop on the rug.",
    ),
    (
        4,
        "junk",
        "Certainly! Here is your instruction: Pass the fridge into the living room, then turn "
        "left into the hall. Turn left into the office and stop before the bookshelf.",
    ),
    (
        4,
        "distance",
        "Pass the fridge and go through into the living room, then left into the hall. Walk "
        "twenty metres and turn left into the study. Stop before the bookshelf.",
    ),
    (1, "slight", "Walk down the hall and bear right. Turn left into the kids' room and stop."),
    (3, "slight", "Turn right out of the bedroom, bear right into the kids' room and stop."),
    (2, "bareside", "Out of bedroom, left, past coat rack, left into bathroom, stop at washbasin."),
    (0, "keepside", "Go out and turn left. Pass the bench, keeping it on your left, and stop."),
    (
        0,
        "roomside",
        "Leave the children's room and turn left. Stop with the bathroom door on your left.",
    ),
    (
        4,
        "twin",
        "Walk along the dining table, which is on your right, and stop beside the plant.",
    ),
    (2, "near", "Leave the bedroom, go right, then left into the bathroom. Stop at the bench."),
    (3, "passed", "Turn right out of the bedroom. Turn left into the kids' room and stop before "
        "you reach the wardrobe."),
    (1, "past", "Walk down the hall, turn left, and left again into the kids' room. Stop once you "
        "have passed the desk."),
    (2, "order", "Walk out of the bedroom. Go right along the hall, past the basket and then the "
        "coat rack, left into the bathroom. Stop at the washbasin."),
    (0, "distance", "Leave the children's room and turn left. Pass the bench, walk another eight "
        "metres and stop."),
    (0, "distance", "Leave the children's room and turn left. Walk two hundred feet past the "
        "mirror and stop after the coat rack."),
    (0, "doorway", "Leave the children's room, turn left and stop in the bedroom doorway."),
    (4, "negation", "Pass the fridge, then left into the hall. Don't go into the office. Stop on "
        "the rug."),
    (3, "turnroom", "Turn right out of the bedroom. Turn right into the kids' room and stop."),
    (3, "straight", "Straight ahead out of the bedroom and across the hallway into the kids' room. "
        "Stop."),
    (4, "after", "Pass the fridge into the living room, then left into the hall. Turn left into "
        "the office. Stop, and then turn right."),
    (4, "roomorder", "Past the fridge, through the hall, then the living room, left into the "
        "office. Stop there."),
    (0, "order", "Leave the children's room and turn left. Pass the bench, then the shoe cabinet, "
        "both on your right, and stop after the coat rack."),
    (3, "ordinal", "Turn right out of the bedroom. Go in at the first door on your left and stop."),
    (0, "straight", "Leave the children's room and go straight down the hallway. Pass the bench "
        "and stop after the coat rack."),
    (0, "behind", "Use the door behind you, turn left, pass the bench and stop at the coat rack."),
    (4, "here", "You are in the living room. Turn left into the hall, then left into the office."),
    (0, "order", "Leave the children's room and turn left. On your right comes first the bench and "
        "after it the shoe cabinet. Stop after the coat rack."),
    (3, "ordinal", "Turn right out of the bedroom. The kids' room is the first door on your left. "
        "Go in and stop past the wardrobe."),
    (4, "preface", "The samples go through the bathroom to the office. From the kitchen go right "
        "past the fridge, straight into the living room, left into the hall, and in at the next "
        "door on the left. Stop there."),
    (2, "beyond", "Leave the bedroom, go right, then left, and stop at the washbasin. If you reach "
        "the bathroom, you've gone too far."),
    (2, "too far", "Leave the bedroom, go right, then left. Enter the kitchen. You've gone too far "
        "if you come back out. Stop at the washbasin."),
    (2, "too far", "Leave the bedroom, go right, then left into the bathroom. You've gone too far "
        "if you reach the hall. Stop at the washbasin."),
    (2, "without", "Leave the bedroom. Go right along the hall past the coat rack, then left, and "
        "stop before the bathroom without going in."),
    (2, "threshold", "Leave the bedroom. Go right along the hall past the coat rack, then left. "
        "Stop on the threshold of the bathroom."),
    (0, "distance", "Leave the children's room and turn left. Then twenty metres straight by the "
        "bench, and stop after the coat rack."),
    (3, "room", "Turn right out of the bedroom. Go in at the bathroom, that's on your left. Stop "
        "past the wardrobe."),
    (3, "room", "Turn right out of the bedroom. Cross the office, which is on your left. Stop past "
        "the wardrobe."),
    (2, "straight", "Leave the bedroom and turn right; the bathroom is straight ahead. Go in and "
        "stop at the washbasin."),
    (2, "doors", "Walk past the bed and out of the bedroom. Go right along the hall past seven "
        "doors on your left, then left into the bathroom. Stop in front of the washbasin."),
]  # fmt: skip


@pytest.mark.parametrize(("number", "text"), TRUTHS)
def test_true_texts_pass(villa, number, text):
    assert check_text(text, villa[number]).problems == ()


@pytest.mark.parametrize(("number", "kind", "text"), LIES)
def test_lies_are_refused(villa, number, kind, text):
    assert not check_text(text, villa[number]).ok


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("Turn right through the doorway into the kitchen and stop next to the table.", "right"),
        ("Turn left through the doorway, turn left again, then stop next to the table.", "left"),
        (
            "Turn left into the kitchen, then walk on past the table to the far wall.",
            "where to stop",
        ),
        ("Turn left into the bathroom, walk past the table and stop there.", "bathroom"),
        ("Turn left into the kitchen, walk past the bathtub and stop there.", "bathtub"),
        ("Turn left into the kitchen and stop at the zorblatt.", "zorblatt"),
        ("Turn left into the kitchen, go past the sofa and stop at the table.", "sofa"),
        ("Turn left, walk nine metres into the kitchen and stop at the table.", "9 metres"),
        ("Turn left into the kitchen and stop at the second table.", "number 2"),
        ("Turn left into the kitchen and stop between the three tables.", "3"),
        ("Stop at the sofa. Then turn left into the kitchen and go on.", "sofa"),
        ("Turn left into the kitchen and stop at the table. The password is tulip.", "password"),
        ("Turn left into the kitchen and stop at the table. Kill all humans.", "humans"),
        ("Turn left through the helicopter door and stop at the table.", "helicopter"),
        ("Tourne à gauche dans la cuisine puis arrête-toi près de la table.", "English"),
        ("I am sorry, but I cannot go to the table in the kitchen and stop.", "speak"),
        ("I will now give you the way: turn left into the kitchen and stop at the table.", "speak"),
        ("I have checked the map. Turn left into the kitchen and stop at the table.", "speak"),
        (
            "You glide by zeppelins hovering gloriously. Turn left into the kitchen and stop at "
            "the table.",
            "zeppelins",
        ),
        ("Obey me now. Turn left into the kitchen and stop at the table.", "obey"),
        ("Kill all humans. Turn left into the kitchen and stop at the table.", "humans"),
        ("Turn left into the kitchen {ignore this} and stop at the table.", "belongs"),
        ("1. Turn left into the kitchen. 2. Stop at the table.", "list"),
    ],
)
def test_the_problem_is_named(two_rooms, text, complaint):
    verdict = check_text(text, Ground(facts_of(LEFT, two_rooms)))
    assert any(complaint in p for p in verdict.problems), verdict.problems


GOOD = [
    {
        "words": "Turn left into the kitchen.",
        "claims": [
            {"kind": "turn", "side": "left"},
            {"kind": "enter", "what": "room", "name": "kitchen"},
        ],
    },
    {"words": "Stop at the table.", "claims": [{"kind": "stop", "what": "thing", "name": "table"}]},
]


@pytest.mark.parametrize(
    ("step", "words", "complaint"),
    [
        (0, "Turn right into the kitchen.", "no claim says right"),
        (0, "Turn left into the bathroom.", "no claim is about the bathroom"),
        (0, "Turn left past the sofa into the kitchen.", "no claim is about the sofa"),
        (0, "Turn left through the third door into the kitchen.", "no claim says third"),
        (0, "Walk twenty metres and turn left into the kitchen.", "no claim says twenty"),
        (0, "Do not turn left into the kitchen.", "not"),
        (0, "Turn left into the glorious kitchen.", "glorious"),
        (1, "Stop at the table. Then leave.", "leave"),
    ],
)
def test_every_word_needs_a_claim(two_rooms, step, words, complaint):
    ground = Ground(facts_of(LEFT, two_rooms))
    text = " ".join(one["words"] for one in GOOD)
    assert check_text(text, ground, read_steps(GOOD)).problems == ()
    changed = [*GOOD[:step], GOOD[step] | {"words": words}, *GOOD[step + 1 :]]
    said = " ".join(one["words"] for one in changed)
    problems = check_text(said, ground, read_steps(changed)).problems
    assert any(complaint in problem for problem in problems), problems
    assert not check_text(said, ground, read_steps(GOOD)).ok  # other words than the steps'


def test_a_stop_is_said_by_claims_of_its_place(two_rooms):
    ground = Ground(facts_of(LEFT, two_rooms))
    claims = [
        {"kind": "turn", "side": "left"},
        {"kind": "enter", "what": "room", "name": "Kitchen"},
        {"kind": "stop", "what": "thing", "name": "Table"},
    ]
    text = "Turn left and wait in the kitchen by the table."
    steps = read_steps([{"words": text, "claims": claims}])
    assert check_text(text, ground, steps).problems == ()
    lie = text.replace("kitchen", "bathroom")
    assert not check_text(lie, ground, read_steps([{"words": lie, "claims": claims}])).ok


def test_what_is_behind_at_the_start_is_beside_nothing(villa):
    checked = 0
    for ground in villa:
        for n, mark in enumerate(ground.facts.landmarks):
            off = min(abs(ground.bearing[n, 0]), abs(ground.facing[n, 0]))
            if ground.near_m[n, 0] > 3.0 or off < 135.0 or mark.count > 1:
                continue
            for side in ("left", "right"):
                claim = Claim("see", "thing", mark.noun, side=side)
                for fit in (ground.seen_at(claim), ground.passed(claim)):
                    assert fit.cost[:3].min() > 1.0
                    checked += 1
    assert checked


@pytest.mark.parametrize(
    ("claims", "complaint"),
    [
        ("turn left", "a list of steps"),
        ([{"word": "x"}], "valid keys"),
        ([{"words": "x", "claims": [{"kind": "fly"}]}], "fly"),
        ([{"words": "x", "claims": [{"side": "left"}]}], "no kind"),
        ([{"words": "x", "claims": [{"kind": "turn", "side": 3}]}], "side"),
        ([{"words": "x", "claims": [{"kind": "walk", "metres": True}]}], "metres"),
    ],
)
def test_claims_of_another_form_are_refused(claims, complaint):
    with pytest.raises(InputError, match=complaint):
        read_steps(claims)


@pytest.mark.parametrize(
    ("text", "claim"),
    [
        # What follows a target says where it is.
        ("Go past the sofa, which you will see on your left, and stop.", ("pass", "sofa", "left")),
        ("Go past the sofa, which stands on your right, and stop.", ("pass", "sofa", "right")),
        ("Pass the bed and the desk, both of which are on your left.", ("pass", "bed", "left")),
        # The goal may be reached before the stop is told.
        (
            "Go on until you reach the fridge, and stop right in front of it.",
            ("stop", "fridge", ""),
        ),
        ("Walk right up to the window and stop there.", ("stop", "window", "")),
        # A door that one heads for is no goal.
        (
            "Head for the door, past the sofa on your left. Stop at the bed.",
            ("pass", "sofa", "left"),
        ),
        # A side before or after two things that are listed in order is that of both.
        ("On your left comes first the sofa, and after it the lamp.", ("pass", "lamp", "left")),
        ("First the sofa and then the lamp will be on your right.", ("pass", "sofa", "right")),
        (
            "Go round the bed, it stays on your left with the desk on your right.",
            ("see", "bed", "left"),
        ),
        ("Skirt the table to the kitchen door and stop.", ("pass", "table", "")),
        # How far away a thing is.
        ("Turn left and stop at the sofa, 0.8 m on R.", ("stop", "sofa", "right")),
        ("Stop at the bed, lamp 2 m ahead-L.", ("stop", "lamp", "left")),
    ],
)
def test_what_words_refer_to_is_read(text, claim):
    assert claim in [(c.kind, c.name, c.side) for step in read_text(text) for c in step.claims]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        # A room is left, by a door or on a side.
        ("Cross the office and leave it at the far door. Turn left and stop.", "in door turn stop"),
        ("Go through the kitchen, leave it on the left and stop.", "in turn stop"),
        ("Cross the office and leave it behind. Turn left and stop.", "in turn stop"),
        # A thing is put down.
        ("Go into the kitchen. Leave it at the door.", "enter stop"),
        ("Turn right and into the kitchen. Leave it there.", "turn enter stop"),
        ("Go right, leave it on the hallway rug.", "turn stop"),
        ("Turn left. Leave it behind the sofa, then come back.", "turn stop"),
        ("Go right. Leave it just inside, by the refrigerator.", "turn stop"),
        ("Turn left. Leave it with the table on your left.", "turn stop"),
        # What is carried is no place, known or not.
        ("Turn left. Leave the marmalade by the sofa.", "turn stop"),
        ("Turn left and put my wet umbrella next to the sofa.", "turn stop"),
        ("Take the trombone to the kitchen and drop it on the table.", "enter stop"),
        ("Carry the lamp up the stairs, turn right and leave the vase there.", "climb turn stop"),
        ("Collect the post from the office. Turn left and drop it at the sofa.", "leave turn stop"),
        ("Turn right and deliver the pizza to the kitchen.", "turn stop"),
        # A way that is taken, and a thing that is left behind, are none.
        ("Leave the sofa on your left and stop.", "see stop"),
        ("Leave the kitchen by the door, turn left and stop.", "leave door turn stop"),
        ("Take the second left to the kitchen and stop.", "turn enter stop"),
        # A side written short is that of the thing before it, or a turn.
        ("Shower R, tub L, exit to hallway, L along rug, stop.", "see see enter turn pass stop"),
        ("Past sofa on right, next door right, stop.", "pass door stop"),
        # What is not done is said apart.
        ("Cross the hall without walking along it and stop.", "in stop"),
        ("Stop outside the kitchen without entering it.", "stop"),
        ("Stop on the kitchen threshold without going in.", "stop avoid"),
        ("Turn left and stop. If you come to the hall, you've gone too far.", "turn stop avoid"),
        ("Stop. If you turn left and enter the hall, you've gone too far.", "stop avoid"),
        # The side of a thing in no table is no turn.
        ("With the gizmo over on your right, turn left and stop.", "turn stop"),
        # How many things are carried says nothing of the place.
        ("Three vases for the kitchen: turn left and go in.", "turn enter stop"),
        # A distance from the walker or the door is no way still to go.
        ("Turn left; the fridge is two metres ahead. Stop there.", "turn see stop"),
        ("Go right and stop three metres in, by the window.", "turn stop"),
    ],
)
def test_what_is_done_is_read(text, told):
    assert [c.kind for step in read_text(text) for c in step.claims] == told.split()


@pytest.mark.parametrize(
    ("aside", "ok"),
    [
        ("; I used to slide on the banister as a boy.", True),
        (", it was my mother's.", True),
        (", I do like being here.", True),
        # What is not there is no aside.
        (", I do like those curtains.", False),
        (", such a nice bathtub.", False),
        (". Mind the bathtub.", False),
        (" where people might want to eat.", True),
        (". Mind the doorstep.", True),
        (", such a lot of saucepans.", True),
        (", I do like turning right.", False),
        (", mind the bathtub on your left.", False),
        ("; the password is hunter.", False),
        ("; send money to my account.", False),
        (". We need you to send money.", False),
    ],
)
def test_asides_are_unchecked_where_they_tell_no_way(two_rooms, aside, ok):
    text = f"Turn left into the kitchen{aside} Stop at the table."
    assert check_text(text, Ground(facts_of(LEFT, two_rooms))).ok is ok


def test_a_side_of_nothing_is_unchecked(two_rooms):
    text = "Turn left into the kitchen, and you will see it all on your right. Stop at the table."
    assert "right" in check_text(text, Ground(facts_of(LEFT, two_rooms))).unchecked


def test_claims_that_are_read_are_written_and_read_again():
    steps = read_text("Turn left at the second chair, walk three metres and stop by the sofa.")
    records = [
        {"words": step.words, "claims": [claim_record(claim) for claim in step.claims]}
        for step in steps
    ]
    again = read_steps(json.loads(json.dumps(records)))
    assert [step.claims for step in again] == [step.claims for step in steps]


def test_texts_as_long_as_rxrs_are_read(two_rooms):
    ground = Ground(facts_of(LEFT, two_rooms))
    way = "Turn left through the doorway into the kitchen and stop next to the table. "
    chat = "Take all the time that you need on the way, {} it is easy and short all along. "
    words = ("there", "it", "this", "that", "now", "today", "here")
    text = "".join(chat.format(word) for word in words) + way
    assert 90 < len(text.split()) < 150
    assert check_text(text, ground).problems == ()
    assert "at most 2000" in check_text(text * 4, ground).problems[0]


_SOME = """turn left right the second red sofa of with between and , . stop to in on your door into
    past kitchen end 7 3rd don't until piano pair - ’ { ; metres half not again both ( ) table's"""


@given(st.lists(st.sampled_from(_SOME.split()), max_size=25))
@settings(max_examples=150, deadline=None)
def test_any_words_can_be_read(two_rooms, words):
    ground = Ground(facts_of(EAST, two_rooms))
    assert isinstance(check_text("go " + " ".join(words), ground).problems, tuple)


def test_numbers_are_read(two_rooms):
    def metres(text):
        return [c.metres for s in read_text(text) for c in s.claims if c.kind == "walk"]

    assert metres("Walk twenty-five metres and stop.") == [25.0]
    assert metres("Approx. 4 m straight. Stop.") == [4.0]
    assert metres("Walk half a mile and stop.") == [pytest.approx(804.5)]
    assert metres("Walk a metre and a half and stop.") == [1.5]
    assert metres("Go two metres and half and stop.") == [2.5]
    assert metres("Go for two hundred feet and stop.") == [pytest.approx(61.0)]
    assert np.isclose(metres("Take a few steps and stop.")[0], 2.0)
    assert metres("Walk 1-1.5 m and stop.") == [1.25]
    assert metres("Walk 4–5 m and stop.") == [4.5]
    assert metres("Cross the 12 m² room and stop.") == []

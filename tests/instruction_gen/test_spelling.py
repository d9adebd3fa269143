"""Misspelt words are read as the words they stand for; other words are left alone."""

import json

import pytest

from benchmarks.instructions.buildings import building
from benchmarks.instructions.corpus import FOLDER, episode_of_record
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.facts import path_facts
from vlnpe.instruction_gen.language.spelling import respelt
from vlnpe.instruction_gen.language.tokens import misspelt, tokenize


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("past the wardobe", "past the wardrobe"),
        ("past the bookshlef", "past the bookshelf"),
        ("enter the bathrooom", "enter the bathroom"),
        ("enter the kichen", "enter the kitchen"),
        ("trun right at the armchiar", "turn right at the armchair"),
        ("straigt down the corridoor", "straight down the corridor"),
        ("by the washingmachine", "by the washing machine"),
        ("by the coffeetable", "by the coffee table"),
        ("turnright here", "turn right here"),
        ("past the ward robe", "past the wardrobe"),
        ("the side board", "the sideboard"),
        ("youll see the table", "you'll see the table"),
        ("theyre on the left", "they're on the left"),
        ("dont go in", "don't go in"),
    ],
)
def test_a_misspelt_word_is_read_as_the_known_one(text, read):
    assert [t.text for t in tokenize(text)] == [t.text for t in tokenize(read)]
    assert misspelt(text) and not misspelt(read)


@pytest.mark.parametrize(
    "word",
    # English words, names, words far from any, and known ones.
    [
        *("tower", "stable", "chain", "shell", "disk", "candle", "helicopter", "password"),
        *("zebra", "paris", "xyzzy", "fridge", "left", "sofas"),
    ],
)
def test_other_words_are_left_alone(word):
    assert respelt(word) == ""


def test_a_misspelt_truth_holds_and_a_misspelt_lie_does_not():
    document = json.loads((FOLDER / "apartment-201.json").read_text())
    path = next(p for p in document["paths"] if p["id"] == "apartment-201/0009")
    level = building("apartment", document["scene"]["apartment"])
    ground = Ground(path_facts(episode_of_record(path, "apartment-201"), level))
    true = "Pass the bensh and go into the livingroom. Stop in the kichen at the dinning table."
    verdict = check_text(true, ground)
    assert verdict.ok
    assert "bensh (read as bench)" in verdict.unchecked
    false = "Pass the bensh and go into the bathrom. Stop in the kichen at the dinning table."
    assert not check_text(false, ground).ok

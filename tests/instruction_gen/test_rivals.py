"""Where else a text leads a stranger."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.instructions.buildings import building
from tests.instruction_gen.test_instruct import episode_of
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.instruction_gen.checker import Ground
from vlnpe.instruction_gen.composer import compose_texts
from vlnpe.instruction_gen.composer.compose import WORDS
from vlnpe.instruction_gen.facts import LevelFacts, path_facts
from vlnpe.instruction_gen.facts.elsewhere import Elsewhere
from vlnpe.instruction_gen.language.reader import readings
from vlnpe.instruction_gen.rivals import Rivals


@pytest.fixture(scope="module")
def apartment():
    """A level with a living room and two bedrooms on its hallway, and its floor as a free map."""
    level = building("apartment", 2)
    free = level.regions.width_m > 0.0
    freemap = Freemap(level.regions.grid, np.where(free, 0.0, np.nan).astype(np.float32), free)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SceneBundle, "freemap", lambda self, level: freemap)
        yield level


def _way_into(apartment, room):
    """Return a path from the hallway into a room."""
    hall, goal = apartment.names.index("hallway"), apartment.names.index(room)
    xy_m = apartment.regions.grid.center_of(np.argwhere(apartment.regions.region == hall))
    start_m = xy_m[np.linalg.norm(xy_m - xy_m.mean(axis=0), axis=1).argmin()]
    ways = Elsewhere(apartment, start_m)
    number = np.flatnonzero(ways.regions == goal)
    path = ways.way(int(number[ways.costs_m[number].argmin()]))
    return replace(episode_of(path), scene_id="apartment")


@pytest.mark.parametrize(
    ("room", "text", "elsewhere"),
    [
        ("living room", "Go into the living room and stop just inside.", ""),
        ("bedroom", "Go into the bedroom and stop just inside.", "in the bedroom"),
        ("bedroom", "Go into the room and stop just inside.", "in the"),
    ],
)
def test_a_text_that_leads_into_another_room_as_well_is_found(apartment, room, text, elsewhere):
    episode = _way_into(apartment, room)
    rivals = Rivals(episode, [apartment], path_facts(episode, apartment))
    found = rivals.led_to(next(readings(text)))
    assert elsewhere in found and bool(found) is bool(elsewhere)


class _Refuses:
    """Rivals that every one of the first few texts leads to."""

    def __init__(self, first):
        self.left, self.seen = first, []

    def led_to(self, steps):
        self.seen.append(" ".join(step.words for step in steps))
        self.left -= 1
        return "it also leads to the kitchen" if self.left >= 0 else ""


def _composed(level, path, rivals):
    ground = Ground(path_facts(path, level))
    return compose_texts(ground, 1, ("natural",), np.random.default_rng(0), rivals=rivals)


def test_the_composer_takes_another_draft_where_the_first_lead_elsewhere(apartment):
    rivals = _Refuses(2)
    texts, reason = _composed(apartment, _way_into(apartment, "living room"), rivals)
    assert not reason
    assert rivals.seen.index(texts[0].text) == 2
    assert not texts[0].leads_elsewhere


@pytest.mark.parametrize("labelled", [True, False])
def test_only_without_names_is_an_ambiguous_text_kept_and_marked(apartment, labelled):
    path, level = _way_into(apartment, "living room"), apartment
    if not labelled:
        unnamed = replace(level.regions, names=("",) * len(level.names))
        level = LevelFacts.of(replace(level.bundle, objects=()), 0, unnamed)
    texts, reason = _composed(level, path, _Refuses(1000))
    if labelled:
        assert not texts
        assert reason == ["it also leads to the kitchen"]
    else:
        assert texts[0].record()["leads_elsewhere"] == "it also leads to the kitchen"


def test_a_strip_that_is_too_narrow_to_walk_leads_nowhere(apartment):
    grid = apartment.regions.grid
    free = np.zeros(grid.shape, dtype=bool)
    free[10:16] = True
    narrow = Freemap(grid, np.where(free, 0.0, np.nan).astype(np.float32), free)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SceneBundle, "freemap", lambda self, level: narrow)
        assert not len(Elsewhere(apartment, grid.center_of(np.array([12, 20]))).places_m)


def test_a_text_may_be_too_long_where_there_is_no_shorter_one(apartment):
    path = _way_into(apartment, "living room")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(WORDS, "natural", (1, 1))
        texts, reason = _composed(apartment, path, _Refuses(0))
    assert texts, reason

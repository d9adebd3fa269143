"""Where else a text leads a stranger."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.instructions.buildings import building
from tests.instruction_gen.test_instruct import episode_of
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.instruction_gen.facts import path_facts
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


@pytest.mark.parametrize(
    ("room", "text", "elsewhere"),
    [
        ("living room", "Go into the living room and stop just inside.", ""),
        ("bedroom", "Go into the bedroom and stop just inside.", "in the bedroom"),
        ("bedroom", "Go into the room and stop just inside.", "in the"),
    ],
)
def test_a_text_that_leads_into_another_room_as_well_is_found(apartment, room, text, elsewhere):
    hall, goal = apartment.names.index("hallway"), apartment.names.index(room)
    xy_m = apartment.regions.grid.center_of(np.argwhere(apartment.regions.region == hall))
    start_m = xy_m[np.linalg.norm(xy_m - xy_m.mean(axis=0), axis=1).argmin()]
    ways = Elsewhere(apartment, start_m)
    number = np.flatnonzero(ways.regions == goal)
    path = ways.way(int(number[ways.costs_m[number].argmin()]))
    episode = replace(episode_of(path), scene_id="apartment")
    rivals = Rivals(episode, [apartment], path_facts(episode, apartment))
    found = rivals.led_to(next(readings(text)))
    assert elsewhere in found and bool(found) is bool(elsewhere)

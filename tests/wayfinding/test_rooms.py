"""Rooms of a level, and the crossings between them."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from vlnpe.formats.scene.bundle import Floor, LabeledObject, Obstacles, SceneBundle
from vlnpe.wayfinding.crossings import crossings
from vlnpe.wayfinding.regions import region_map


@pytest.fixture
def unlabelled(two_rooms):
    return replace(two_rooms, objects=())


class Altered:
    """A scene whose collision boxes were changed."""

    objects = ()

    def __init__(self, scene: SceneBundle, change: Callable[[Obstacles], Obstacles]):
        self.scene, self.change = scene, change
        self.scene_id, self.level_floor_z_m = change.__name__, scene.level_floor_z_m

    def floor(self, level: int) -> Floor:
        return self.scene.floor(level)

    def obstacles(self, level: int) -> Obstacles:
        return self.change(self.scene.obstacles(level))


def test_rooms_without_labels_are_found_by_the_walls(unlabelled):
    regions = region_map(unlabelled, 0)
    assert len(regions.names) == 2
    assert set(regions.names) == {""}
    left, right, door = regions.at([[1.0, 1.0], [7.0, 3.0], [4.0, 0.5]])
    assert left != right
    assert {int(left), int(right)} == {0, 1}
    assert door == -1  # inside the wall
    border = [x for x in np.arange(3.0, 5.0, 0.05).tolist() if regions.at((x, 2.0)) == left]
    assert max(border) == pytest.approx(4.0, abs=0.3)


def test_furniture_names_rooms(two_rooms):
    things = tuple(
        replace(o, category="refrigerator") if o.name == "Table_1" else o
        for o in two_rooms.objects
        if not o.category.startswith("room:")
    )
    regions = region_map(replace(two_rooms, objects=things), 0)
    assert regions.name_at((1.0, 1.0)) == "kitchen"
    assert regions.name_at((7.0, 3.0)) == "living room"


def test_one_space_with_two_uses_is_two_rooms(two_rooms):
    hall = LabeledObject("Bed", "bed", (0.5, 0.5, 0.0), (1.5, 1.5, 0.5), 0)
    fridge = LabeledObject("Fridge", "refrigerator", (3.2, 3.2, 0.0), (3.8, 3.8, 1.2), 0)
    regions = region_map(replace(two_rooms, objects=(hall, fridge)), 0)
    assert regions.name_at((1.0, 1.0)) == "bedroom"
    assert regions.name_at((3.5, 3.0)) == "kitchen"


def test_small_furniture_and_lamps_are_no_walls(unlabelled):
    before = region_map(unlabelled, 0)

    def furnish(boxes: Obstacles) -> Obstacles:
        more = np.array([[2.0, 2.0, 0.4], [2.0, 2.0, 1.8], [6.0, 3.0, 0.9]])
        half = np.array([[0.6, 1.0, 0.4], [0.5, 0.5, 0.4], [0.1, 0.1, 0.9]])
        center = np.vstack([boxes.center_m, more])
        return replace(boxes, center_m=center, half_m=np.vstack([boxes.half_m, half]))

    after = region_map(cast(SceneBundle, Altered(unlabelled, furnish)), 0)
    assert np.array_equal(before.region, after.region)


def test_crossings_ignore_short_visits(two_rooms):
    regions = region_map(two_rooms, 0)
    peek = np.array([[1.0, 2.0, 0.0], [4.3, 2.0, 0.0], [1.0, 2.2, 0.0]])
    assert crossings(regions, peek) == []
    there = np.array([[1.0, 2.0, 0.0], [6.0, 2.0, 0.0], [1.0, 2.2, 0.0]])
    steps = crossings(regions, there)
    assert [regions.names[c.to_region] for c in steps] == ["living room", "kitchen"]
    assert steps[0].along_m == pytest.approx(3.0, abs=0.2)


def test_walls_thinner_than_a_cell_are_walls(unlabelled):
    # As a scan's surfaces often are.
    def thin(boxes: Obstacles) -> Obstacles:
        return replace(boxes, half_m=np.where(boxes.half_m == 0.05, 0.01, boxes.half_m))

    regions = region_map(cast(SceneBundle, Altered(unlabelled, thin)), 0)
    left, right = regions.at([[1.0, 1.0], [7.0, 3.0]])
    assert left != right
    assert regions.at((4.0, 0.5)) == -1


def test_a_goal_just_behind_a_door_is_in_the_next_room(two_rooms):
    regions = region_map(two_rooms, 0)
    behind = np.array([[1.0, 2.0, 0.0], [4.6, 2.0, 0.0]])
    assert [regions.names[c.to_region] for c in crossings(regions, behind)] == ["living room"]
    on_the_sill = np.array([[1.0, 2.0, 0.0], [4.2, 2.0, 0.0]])
    assert crossings(regions, on_the_sill) == []

"""The generated apartment itself, before it is scanned."""

from collections import Counter

import numpy as np
import pytest
from scipy.ndimage import label

from tests.support.scenes.homes import assert_apart, exact_freemap, joined
from vlnpe.apartments import ApartmentConfig, TrueScene, build_scene
from vlnpe.apartments.building.planner import draw_storeys
from vlnpe.wayfinding.distance import distance_field

CONFIG = ApartmentConfig()
SEEDS = (0, 1, 2)


@pytest.fixture(
    scope="module",
    params=[SEEDS[0], *(pytest.param(seed, marks=pytest.mark.chain) for seed in SEEDS[1:])],
)
def home(request: pytest.FixtureRequest) -> TrueScene:
    return build_scene(np.random.default_rng(request.param), CONFIG)


@pytest.mark.parametrize("seed", range(40))
def test_plan_is_a_home(seed: int) -> None:
    plan = draw_storeys(np.random.default_rng(seed), CONFIG)[0]
    kinds = Counter(room.kind for room in plan.rooms)
    assert len(plan.rooms) >= 4
    assert {"kitchen", "living room", "bathroom", "bedroom"} <= set(kinds)
    assert 80 <= plan.area_m2 <= 150
    assert joined(plan)
    assert_apart(plan)
    doors = [o for o in plan.openings if o.kind == "door"]
    for door in doors:
        assert 0.8 <= door.end_m - door.start_m <= 1.0
        assert door.top_m == pytest.approx(2.05)
        low, high = plan.rooms[door.room].span(door.axis)
        assert low < door.start_m < door.end_m < high
    assert any(o.kind == "window" for o in plan.openings)


def test_impossible_area_is_refused() -> None:
    with pytest.raises(ValueError, match="80 … 150"):
        draw_storeys(np.random.default_rng(0), ApartmentConfig(area_m2=(700.0, 800.0)))


@pytest.mark.chain
def test_every_room_is_reachable_and_paths_are_long(home: TrueScene) -> None:
    space = exact_freemap(home)
    free = space.free(CONFIG.robot_radius_m)
    groups = np.zeros(free.shape, dtype=np.int32)
    label(free, np.ones((3, 3)), output=groups)
    main = np.bincount(groups[groups > 0]).argmax()
    rows, columns = np.indices(free.shape)
    xy = space.grid.center_of(np.stack([rows, columns], -1))
    for room in home.plan.rooms:
        in_room = np.all((xy > room.lower_m) & (xy < room.upper_m), axis=-1)
        walkable = np.count_nonzero(in_room & (groups == main)) * space.grid.cell_m**2
        assert walkable > 0.4, f"{room.kind}: only {walkable:.2f} m²"
    start = xy[groups == main][0]
    reach = distance_field(space, start, CONFIG.robot_radius_m).distance_m
    farthest = xy[np.unravel_index(np.argmax(np.where(groups == main, reach, -1)), reach.shape)]
    longest = distance_field(space, farthest, CONFIG.robot_radius_m).distance_m
    assert longest[groups == main].max() > 9


def test_furniture_is_inside_its_rooms(home: TrueScene) -> None:
    shell = {"wall", "floor", "ceiling", "window", "door", "door frame"}
    inside = home.plan.bounds()
    for thing in home.objects:
        if thing.category not in shell:
            assert np.all(np.array(thing.lower_m[:2]) > inside[0] - 0.01), thing
            assert np.all(np.array(thing.upper_m[:2]) < inside[1] + 0.01), thing
            assert thing.lower_m[2] > -0.01 and thing.upper_m[2] < home.plan.ceiling_m + 0.01, thing


def test_home_is_furnished_and_named(home: TrueScene) -> None:
    names = [o.name for o in home.objects]
    assert len(set(names)) == len(names)
    categories = Counter(o.category for o in home.objects)
    expected = ("sofa", "bed", "refrigerator", "kitchen counter", "toilet", "chair", "picture")
    for category in expected:
        assert categories[category] >= 1, category
    assert categories["floor"] == categories["ceiling"] == len(home.plan.rooms)
    assert len(home.objects) > 80


def test_rooms_look_different(home: TrueScene) -> None:
    colors = []
    for k, thing in enumerate(home.objects):
        if thing.category == "wall":
            first = np.flatnonzero(home.face_object == k)[0]
            image = home.materials[int(home.shape.material[first])].image
            colors.append(tuple(image.mean((0, 1)).round().astype(int)))
    assert len(set(colors)) >= len(home.plan.rooms)


def test_textures_are_sharp(home: TrueScene) -> None:
    for material in home.materials:
        rows, columns = material.image.shape[:2]
        pixel = max(material.size_m[0] / columns, material.size_m[1] / rows)
        # Plain lacquer has nothing to be sharp about.
        limit = 0.0101 if material.name.startswith(("lacquer", "trim", "lampshade")) else 0.0056
        assert pixel < limit, material.name


def test_seeds_give_different_homes() -> None:
    plans = [draw_storeys(np.random.default_rng(seed), CONFIG)[0] for seed in range(8)]
    assert len({tuple(round(v, 1) for r in p.rooms for v in r.upper_m) for p in plans}) == 8
    assert len({tuple(sorted(r.kind for r in p.rooms)) for p in plans}) >= 3


@pytest.mark.chain
@pytest.mark.parametrize("home", SEEDS[:1], indirect=True)
def test_same_seed_gives_the_same_home(home: TrueScene) -> None:
    again = build_scene(np.random.default_rng(SEEDS[0]), CONFIG)
    assert again.objects == home.objects
    np.testing.assert_array_equal(again.shape.corners, home.shape.corners)
    for left, right in zip(again.materials, home.materials, strict=True):
        np.testing.assert_array_equal(left.image, right.image)

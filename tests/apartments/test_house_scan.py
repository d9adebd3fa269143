"""The two-storey house, scanned and repaired: both levels, an open stairwell, flat episodes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vlnpe.apartments import ScanConfig, TrueScene, build_scene, building_config, generate_scan
from vlnpe.apartments.scanner import atlas
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes

pytestmark = pytest.mark.slow

SEED = 2
# Coarser than the default where only speed depends on it.
CONFIG = replace(
    building_config("house"),
    scan=ScanConfig(
        voxel_m=0.04,
        view_px=(160, 120),
        station_spacing_m=1.6,
        target_faces=120_000,
        texel_m=0.04,
        floor_texel_m=0.03,
        light_rays=2,
    ),
)


@pytest.fixture(scope="module")
def home() -> TrueScene:
    return build_scene(np.random.default_rng(SEED), CONFIG, painted=False)


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(atlas, "_COARSEST_M", 0.04)
        return generate_scan(SEED, tmp_path_factory.mktemp("scan"), CONFIG)


@pytest.fixture(scope="module")
def repaired(scan: Path, tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    return repair_scene(scan, tmp_path_factory.mktemp("repaired"))


def inside(grid: GridSpec, rect: np.ndarray, margin_m: float) -> np.ndarray:
    """(rows, columns) cells in a rectangle (2, 2) shrunk by a margin."""
    xy = grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1))
    return np.all((xy > rect[0] + margin_m) & (xy < rect[1] - margin_m), axis=-1)


def test_the_truth_has_both_storeys(home: TrueScene, scan: Path) -> None:
    truth = np.load(scan.with_name("truth.npz"))
    for end, plan in zip(("", "_1"), home.storeys, strict=True):
        floor, seen = truth[f"floor_mask{end}"], truth[f"seen_mask{end}"]
        assert np.allclose(truth[f"floor_z_m{end}"][floor], plan.floor_z_m)
        assert 0.4 < seen.sum() / floor.sum() < 0.98


def test_both_levels_are_found(home: TrueScene, repaired: SceneBundle) -> None:
    heights = [plan.floor_z_m for plan in home.storeys]
    assert repaired.level_floor_z_m == pytest.approx(heights, abs=0.03)
    for k, plan in enumerate(home.storeys):
        freemap = repaired.freemap(k)
        area = np.isfinite(freemap.floor_z_m).sum() * freemap.grid.cell_m**2
        assert 0.8 * plan.area_m2 < area < 1.15 * plan.area_m2


def test_the_stairwell_stays_open_and_the_stairs_blocked(
    home: TrueScene, repaired: SceneBundle
) -> None:
    for k, plan in enumerate(home.storeys):
        freemap = repaired.freemap(k)
        (block,) = plan.blocks
        cells = inside(freemap.grid, block.rect(), 0.15)
        assert cells.sum() > 1000
        assert not freemap.traversable[cells].any()
        if block.kind == "void":
            assert np.isnan(freemap.floor_z_m[cells]).mean() > 0.95


def test_rooms_belong_to_their_levels(home: TrueScene, repaired: SceneBundle) -> None:
    rooms = [o for o in repaired.objects if o.category.startswith("room:")]
    for k, plan in enumerate(home.storeys):
        kinds = sorted(o.category.removeprefix("room:") for o in rooms if o.level == k)
        assert kinds == sorted(room.kind for room in plan.rooms)


def test_sampled_episodes_stay_on_their_level(home: TrueScene, repaired: SceneBundle) -> None:
    result = sample_episodes(repaired, SampleConfig(count=12), np.random.default_rng(0))
    assert {e.level for e in result.episodes} == {0, 1}
    for episode in result.episodes:
        height = home.storeys[episode.level].floor_z_m
        assert np.abs(episode.reference_path_world_m[:, 2] - height).max() < 0.06
        (block,) = home.storeys[episode.level].blocks
        low, high = block.rect() + np.array([[0.1], [-0.1]])
        points = episode.reference_path_world_m[:, :2]
        assert not np.all((points > low) & (points < high), axis=1).any()


def test_the_staircase_has_a_sheet_with_the_true_heights(
    home: TrueScene, repaired: SceneBundle
) -> None:
    (staircase,) = repaired.staircases
    assert staircase.problem == "" and staircase.levels == (0, 1)
    rise = home.storeys[1].floor_z_m
    treads = repaired.stair_treads(0)
    count = len(treads.yaw_rad)
    # In a coarse scan, whose voxels are 4 cm.
    assert treads.top_m == pytest.approx(rise * np.arange(1, count + 1) / count, abs=0.02)
    floor, (stairs,) = repaired.stair_floor(0), [b for b in home.storeys[0].blocks if b.top_m > 2]
    on_stairs = inside(floor.grid, stairs.rect(), 0.1) & floor.covered
    assert on_stairs.sum() > 0.85 * inside(floor.grid, stairs.rect(), 0.1).sum()

"""What is seen along a path over stairs is seen where the path is, from its start to its goal."""

from pathlib import Path

import numpy as np

from tests.support.episodes import episode_along
from tests.support.scenes.storeys import LINE, TOP_M, write_two_storeys
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.geometry import distances_to_path, path_length
from vlnpe.pipeline.stages.instructions.name_things import views_along
from vlnpe.pipeline.stages.instructions.visibility import SPACING_M, looks_along

PATH_M = np.vstack([(8.0, 2.0, 0.0), LINE, (16.0, 1.0, TOP_M)])


def episode_over(path_m: np.ndarray, levels: list[int]) -> Episode:
    flat = episode_along(path_m[:, :2], scene="two_storeys")
    return Episode(
        **{
            **vars(flat), "level": levels[0], "start_position_world_m": path_m[0],
            "goal_position_world_m": path_m[-1], "reference_path_world_m": path_m,
            "extra": {"staircases": [1], "levels": levels},
        }
    )  # fmt: skip


def test_looks_go_on_to_the_goal() -> None:
    for path in (PATH_M, PATH_M[::-1]):
        looks = looks_along(path)
        along, points = [look[0] for look in looks], np.array([look[1] for look in looks])
        assert np.allclose(points[0], path[0]) and np.allclose(points[-1], path[-1])
        assert distances_to_path(points, path).max() < 1e-9
        assert np.isclose(along[-1], path_length(path[:, :2]))
        plan_m = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
        assert np.allclose(plan_m, np.diff(along), atol=0.02) and plan_m.max() < 1.1 * SPACING_M


def test_views_are_of_the_storey_that_the_camera_is_on(tmp_path: Path) -> None:
    building, robot = write_two_storeys(tmp_path / "house"), get_robot("aliengo")
    visual = dict(np.load(building.root / "visual.npz"))
    visual["vertices"] *= np.array(
        [2.5, 1.0, 2.5], dtype=np.float32
    )  # its walls surround both storeys
    np.savez(building.root / "visual.npz", **visual)
    for path, levels in ((PATH_M, [0, 1]), (PATH_M[::-1], [1, 0])):
        views = views_along(building, [episode_over(path, levels)], robot)
        assert (len(views), views[0].level, views[-1].level) == (5, *levels)
        assert all(view.level == (view.eye_m[2] > TOP_M / 2 + 0.45) for view in views)

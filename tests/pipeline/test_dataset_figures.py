"""Figures of the dataset: they show what the episodes hold, as well-formed SVG."""

import base64
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.patches import Rectangle, StepPatch
from PIL import Image

from tests.formats.vlnce.test_groups import R2R, episode
from tests.support.episodes import episode_along
from vlnpe.formats.core.geometry import resample
from vlnpe.formats.vlnce.groups import group_by_path
from vlnpe.pipeline.report.dataset import dataset_plots, dataset_rows
from vlnpe.pipeline.report.maps import ScenePaths, Track, map_figure
from vlnpe.pipeline.report.plots import bars, step_histogram, svg_uri

PATHS = [
    *group_by_path(R2R),
    replace(episode("x", 9, "Stop <here> & wait by the sofa."), split="val_seen"),
]


def texts(uri: str) -> str:
    """Return all words of a figure."""
    root = ET.fromstring(base64.b64decode(uri.removeprefix("data:image/svg+xml;base64,")))
    return " ".join(e.text or "" for e in root.iter() if e.tag.endswith("}text"))


def test_paths_and_instructions_are_counted_apart():
    rows = {row["split"]: row for row in dataset_rows(PATHS)}
    assert (rows["train"]["paths"], rows["train"]["instructions"]) == (2, 4)
    assert rows["val_seen"]["paths"] == 1
    assert rows["train"]["length"] == pytest.approx(4.0)


def test_every_figure_is_well_formed_and_the_same_each_time():
    plots = dataset_plots(PATHS)
    captions = " ".join(plot.caption for plot in plots)
    assert "train 4.0, val_seen 4.0 m" in captions
    for plot in plots:
        assert "train" in texts(plot.uri) and "val_seen" in texts(plot.uri)
    assert dataset_plots(PATHS) == plots


def test_a_histogram_shows_each_group_as_shares():
    figure = step_histogram({"a": [1.0, 1.0, 3.0], "<b>": [2.5]}, "m", "paths", {"mean": 2.0})
    steps = [p for p in figure.axes[0].patches if isinstance(p, StepPatch) and not p.get_fill()]
    assert [float(p.get_data()[0].sum()) for p in steps] == pytest.approx([1.0, 1.0])
    assert steps[0].get_data()[0].max() == pytest.approx(2 / 3)
    shown = texts(svg_uri(figure))
    assert all(text in shown for text in ("<b>", "mean", "share of paths"))


def test_bins_stand_about_whole_numbers():
    for values in ([1.0, 2.0, 4.0], [3.0], [0.0, 100.0]):
        (steps, _) = step_histogram({"a": values}, "rooms", "paths").axes[0].patches
        assert isinstance(steps, StepPatch)
        edges = np.asarray(steps.get_data()[1])
        assert (edges % 1 == 0.5).all() and edges[0] < min(values) and max(values) < edges[-1]


def test_bars_have_the_height_of_their_values():
    shares = {"train": {"LEFT": 0.25, "STOP": 0.75}, "val": {"LEFT": 0.5, "STOP": 0.5}}
    figure = bars(shares, "share")
    heights = [p.get_height() for p in figure.axes[0].patches if isinstance(p, Rectangle)]
    assert heights == [0.25, 0.75, 0.5, 0.5]
    assert "LEFT" in texts(svg_uri(figure))


def test_without_data_a_figure_says_so():
    for empty in (step_histogram({}, "m", "paths"), bars({}, "share")):
        assert "no data" in texts(svg_uri(empty))


@pytest.mark.parametrize("robots", [["h1"], ["aliengo", "h1"]])
def test_the_map_tells_paths_or_robots_apart_and_no_marker_covers_another(tmp_path, robots):
    Image.new("RGB", (200, 200)).save(tmp_path / "map.png")
    place = {"left_m": -5.0, "top_m": 5.0, "px_per_m": 20.0, "width": 200, "height": 200}
    (tmp_path / "map.json").write_text(json.dumps(place))
    # All paths have one start and one goal.
    episodes = {f"p{k}@0": episode_along([(0, 0), (3, 1)], f"p{k}", scene="home") for k in range(4)}
    tracks = tuple(
        Track(path, e, "home", robot, e.reference_path_world_m, "success")
        for robot in robots
        for path, e in episodes.items()
    )
    figure = map_figure("home/0", tmp_path / "map.png", ScenePaths(episodes, tracks))
    walked = [line["color"] for line in figure["lines"] if "robot" in line]
    assert len(set(walked)) == (2 if len(robots) > 1 else len(episodes))
    dots = figure["dots"]
    assert len(dots) == 2 * len(episodes) and all(dot["label"] for dot in dots)
    for a, b in combinations(dots, 2):
        assert np.hypot(a["x"] - b["x"], a["y"] - b["y"]) > a["r"] + b["r"]


@pytest.fixture
def a_map(tmp_path):
    Image.new("RGB", (200, 200)).save(tmp_path / "map.png")
    place = {"left_m": 0.0, "top_m": 5.0, "px_per_m": 20.0, "width": 200, "height": 200}
    (tmp_path / "map.json").write_text(json.dumps(place))
    return tmp_path / "map.png"


def test_no_path_hides_one_that_it_shares_its_way_with(a_map):
    ways = {"p3": [(0, 0), (8, 0)], "p4": [(1, 0), (9, 0)], "p5": [(9, 0), (2, 0)]}
    ways["p6"] = [(4, -4), (4, 4)]  # crosses the others
    episodes = {f"{k}@0": episode_along(way, k, scene="home") for k, way in ways.items()}
    tracks = tuple(
        Track(path, e, "home", "aliengo", resample(e.reference_path_world_m, 0.05), "success")
        for path, e in episodes.items()
    )
    lines = map_figure("home/0", a_map, ScenePaths(episodes, tracks))["lines"][: len(ways)]
    assert len({line["color"] for line in lines}) == len(ways)
    widths = {line["title"].split()[0]: line["width"] for line in lines}
    assert [*widths.values()] == sorted(widths.values(), reverse=True)  # thin ones on top
    assert widths["p6"] == widths["p3"] > widths["p4"] > widths["p5"]


def test_lines_of_many_walks_on_one_way_differ_and_are_not_too_wide(a_map):
    paths = {f"p{k}@0": episode_along([(0, 0), (8, 0)], f"p{k}", scene="home") for k in range(9)}
    tracks = tuple(
        Track(path, e, "home", robot, resample(e.reference_path_world_m, 0.05), "success")
        for path, e in paths.items()
        for robot in ("aliengo", "h1")
    )
    lines = map_figure("home/0", a_map, ScenePaths(paths, tracks))["lines"][: len(tracks)]
    assert len({line["width"] for line in lines}) == len(tracks)
    assert max(line["width"] for line in lines) <= 8.0


def test_a_path_over_storeys_is_on_the_maps_of_both(a_map):
    up = np.array([[1.0, 1, 0], [4, 1, 0], [7, 1, 2.8], [9, 1, 2.8]])
    flat = episode_along([(0, 0), (3, 1)], "p7", scene="home")
    episode = replace(
        flat,
        start_position_world_m=up[0],
        goal_position_world_m=up[-1],
        reference_path_world_m=up,
        extra={"staircases": [0], "levels": [0, 1]},
    )
    base = resample(up, 0.05) + np.array([0.0, 0.0, 0.36])
    tracks = (Track("p7@0", episode, "home", "aliengo", base, "stopped_far"),)
    low, high = (
        map_figure(f"home/{k}", a_map, ScenePaths({"p7@0": episode}, tracks)) for k in (0, 1)
    )
    assert [dot["title"] for dot in low["dots"]] == ["start of p7"]
    assert [dot["title"] for dot in high["dots"]] == ["goal of p7"]
    assert (low["crosses"], len(high["crosses"])) == ([], 1)
    for figure, first, last in ((low, 1.0, 5.5), (high, 5.5, 9.0)):
        walked, reference = figure["lines"]
        for line in (walked, reference):
            x = [float(point.split(",")[0]) / 20 for point in line["points"].split()]
            assert x[0] == pytest.approx(first, abs=0.25)
            assert x[-1] == pytest.approx(last, abs=0.25)

"""Figures of the dataset: they show what the episodes hold, as well-formed SVG."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from tests.formats.vlnce.test_groups import R2R, episode
from vlnpe.formats.vlnce.groups import group_by_path
from vlnpe.pipeline.report.dataset import count_words, dataset_plots, dataset_rows
from vlnpe.pipeline.report.svg import bars, step_histogram, word_cloud
from vlnpe.trajectory_sampler.ideal import ideal_actions

START = (R2R[0].reference_path_world_m, R2R[0].start_yaw_rad)
PATHS = [
    *group_by_path(R2R),
    replace(episode("x", 9, "Stop <here> & wait by the sofa."), split="val_seen"),
]


def test_paths_and_instructions_are_counted_apart():
    rows = {row["split"]: row for row in dataset_rows(PATHS)}
    assert (rows["train"]["paths"], rows["train"]["instructions"]) == (2, 4)
    assert rows["val_seen"]["paths"] == 1
    assert rows["train"]["length"] == pytest.approx(4.0)


def test_every_figure_is_well_formed():
    plots = dataset_plots(PATHS)
    captions = " ".join(plot.caption for plot in plots)
    assert "train 4.0, val_seen 4.0 m" in captions
    for plot in plots:
        ET.fromstring(plot.svg)
    assert sum("Words of" in plot.caption for plot in plots) == 2


def test_actions_are_those_of_an_ideal_agent_and_add_up():
    (plot,) = [p for p in dataset_plots(PATHS) if p.caption.startswith("Actions")]
    shares = [float(v) for v in re.findall(r"train: ([\d.]+) %", plot.svg)]
    assert sum(shares) == pytest.approx(100, abs=0.3)
    # 4 m straight on are 16 steps; it starts turned by 0.5 rad, and stops once.
    assert max(shares) == pytest.approx(100 * 16 / len(ideal_actions(*START)), abs=0.1)


def test_a_histogram_shows_each_group_as_shares():
    svg = step_histogram({"a": [1.0, 1.0, 3.0], "b": [2.5]}, "m", "paths", width=1.0)
    lines = [e for e in ET.fromstring(svg).iter() if e.tag.endswith("polyline")]
    assert len(lines) == 2
    heights = [float(p.split(",")[1]) for p in lines[0].attrib["points"].split()]
    base = max(heights)
    assert (base - min(heights)) / (base - sorted(set(heights))[1]) == pytest.approx(2.0, abs=0.02)
    for empty in (step_histogram({}, "m", "paths"), bars({}, "share")):
        assert "no data" in empty


def test_short_lengths_have_more_than_one_tick():
    svg = step_histogram({"a": [1.5, 2.1, 2.6]}, "m", "paths")
    texts = [e.text or "" for e in ET.fromstring(svg).iter() if e.tag.endswith("}text")]
    assert {"1.6", "2", "2.4"} <= set(texts)


@pytest.mark.parametrize("value", [0.1, 5.0, 9.9])
def test_the_name_of_a_mark_is_not_cut_off(value):
    svg = step_histogram({"a": [0.0, 10.0]}, "m", "paths", marks={"R2R mean": value})
    (mark,) = [e for e in ET.fromstring(svg).iter() if e.text == "R2R mean"]
    x, length = float(mark.attrib["x"]), 7.0 * len("R2R mean")
    left = x - length if mark.attrib["text-anchor"] == "end" else x
    assert left >= 0 and left + length <= float(ET.fromstring(svg).attrib["width"])


def test_words_do_not_overlap_and_the_frequent_ones_are_larger():
    words = count_words(["Turn left at the sofa, then left again."] * 3 + ["Pass the doorway."])
    assert words["left"] == 6
    assert "the" not in words
    many = {f"word{k}": 60 - k for k in range(60)}
    root = ET.fromstring(word_cloud(many))
    texts = [e for e in root.iter() if e.tag.endswith("}text")]
    size = np.array([float(t.attrib["font-size"]) for t in texts])
    assert len(texts) > 30
    assert (np.diff(size) <= 0).all()
    x = np.array([float(t.attrib["x"]) for t in texts])
    half = np.array([float(t.attrib["textLength"]) for t in texts]) / 2
    y = np.array([float(t.attrib["y"]) for t in texts]) - 0.33 * size
    for k in range(len(texts)):
        beside = np.abs(x[k] - x) >= half[k] + half - 0.2
        above = np.abs(y[k] - y) >= 0.5 * (size[k] + size) - 0.2
        assert (beside | above)[np.arange(len(texts)) != k].all()

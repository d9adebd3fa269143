"""Label files beside a scan: too many labels, invalid numbers, recursion, links."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scene_repair.scan.test_side_files import ANCHOR, POSE
from tests.security.hostile import CLOSED_DEEP_JSON, DEEP_JSON, not_files, put, refusal
from vlnpe.formats.untrusted.limits import DEFAULTS
from vlnpe.scene_repair.labels.files import LabelBox, read_labels
from vlnpe.scene_repair.labels.semantics import copies, labelled_objects
from vlnpe.scene_repair.scan.record import Scan


def labels_of(folder: Path, text: Any) -> list[LabelBox]:
    (folder / "home.labels.json").write_text(text if isinstance(text, str) else json.dumps(text))
    return read_labels(folder / "home.glb")


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    put(kind, tmp_path / "home.labels.json")
    refusal(lambda: read_labels(tmp_path / "home.glb"))


def test_links_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.json").write_text("[]")
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "home.labels.json").symlink_to(tmp_path / "secret.json")
    assert "leads out of" in refusal(lambda: read_labels(tmp_path / "scan" / "home.glb")).reason


def entry(number: int, **changes: Any) -> dict[str, Any]:
    return {
        "name": f"box_{number}",
        "category": "bed",
        "lower": [number, 0, 0],
        "upper": [number + 1, 1, 1],
    } | changes


def own(*entries: Any) -> dict[str, Any]:
    return {"frame": "source", "objects": list(entries)}


@pytest.mark.parametrize("form", ["own", "headset"])
def test_very_many_labels_are_refused_at_once(form: str, tmp_path: Path) -> None:
    count = DEFAULTS.labels + 1
    text = own(*[entry(0)] * count) if form == "own" else [ANCHOR] * count
    assert "10,001 labels" in refusal(lambda: labels_of(tmp_path, text)).reason


@pytest.mark.parametrize(
    "text",
    [
        DEEP_JSON,
        '{"a":' * 100_000,
        CLOSED_DEEP_JSON,
        "\xff",
        "9" * 5000,
        "",
        "5",
        '"x"',
        "null",
        json.dumps({"frame": "source", "objects": 5}),
        json.dumps({"frame": "source", "objects": {"a": 1}}),
        json.dumps({"frame": "x" * 100_000, "objects": []}),
        json.dumps(own(entry(0, name="x" * 100_000, lower=[0]))),
        json.dumps(own(entry(0, lower=[float("nan"), 0, 0]))),
        json.dumps(own(entry(0, upper=[float("inf"), 0, 0]))),
        json.dumps(own(entry(0, upper=[1e300, 0, 0]))),
        json.dumps(own(entry(0, lower=[10**400, 0, 0]))),
        json.dumps(own(entry(0, lower=["x", 0, 0]))),
        json.dumps(own(entry(0, lower=[[0], 0, 0]))),
        json.dumps(own(entry(0, lower=[[[[[0]]]]] * 3))),
        json.dumps([{**ANCHOR, "pose": {**POSE, "position": {"x": 1e999, "y": 0, "z": 0}}}]),
    ],
)
def test_damaged_files_are_named(text: str, tmp_path: Path) -> None:
    error = refusal(lambda: labels_of(tmp_path, text))
    assert error.path == tmp_path / "home.labels.json"


def copies_one_by_one(boxes: list[LabelBox]) -> list[bool]:
    """What `copies` has to find, by looking at every pair."""
    return [
        any(
            other is not box
            and other.category == box.category
            and np.prod(other.half) > np.prod(box.half)
            # Of a flat one only what is inside it: the other side of its wall is near, too.
            and bool(other.contains(box.center[None], 0.03 if other.half.min() < 0.06 else 0.15)[0])
            and float(box.half.min()) < 0.06
            for other in boxes
        )
        for box in boxes
    ]


@pytest.mark.parametrize("count", [1, 30, 400])
def test_copies_are_found_as_by_looking_at_every_pair(count: int) -> None:
    rng = np.random.default_rng(count)
    boxes = []
    for k in range(count):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        half = rng.uniform(0.02, 0.6, 3)
        half[rng.integers(3)] *= rng.choice([0.1, 1.0])
        category = ("bed", "table")[k % 2]
        boxes.append(LabelBox(f"b{k}", category, rng.uniform(0, 3, 3), turn, half))
    expected = copies_one_by_one(boxes)
    assert copies(boxes).tolist() == expected
    assert count < 30 or 0 < sum(expected) < count


def test_as_many_labels_as_are_read_take_seconds_and_keep_their_names(tmp_path: Path) -> None:
    """All of one name and one place: what took minutes."""
    boxes = labels_of(tmp_path, own(*[entry(0, name="a", upper=[1, 1, 0.05])] * DEFAULTS.labels))
    nothing = Scan(
        vertices=np.zeros((0, 3)),
        faces=np.zeros((0, 3), np.int64),
        corner_uv=np.zeros((0, 3, 2), np.float32),
        face_material=np.zeros(0, np.int32),
        face_object=np.zeros(0, np.int32),
        materials=(),
        objects=(),
    )
    objects, _ = labelled_objects(
        nothing,
        boxes,
        vertices_world_m=np.zeros((0, 3)),
        source_to_world=np.eye(4),
        level_floor_z_m=(0.0,),
    )
    names = [thing.name for thing in objects]
    assert len(set(names)) == len(names) == DEFAULTS.labels
    assert names[:3] == ["a", "a_2", "a_3"]

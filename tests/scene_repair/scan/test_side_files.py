"""Labels and licences beside a scan: never from outside its folder, and errors with a type."""

import json
from pathlib import Path

import pytest

from tests.support.scenes import scans
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.pipeline.stages.scenes import items as scene_items
from vlnpe.scene_repair.labels.attach import label_scan
from vlnpe.scene_repair.labels.files import read_labels
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.files import licence_beside, side_file, side_names


@pytest.mark.parametrize("name", side_names(Path("home.glb")))
def test_links_out_of_the_folder_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("{}")
    folder = tmp_path / "scan"
    folder.mkdir()
    source = scans.write_glb(scans.room(), folder / "home.glb")
    (folder / name).symlink_to("../secret")
    with pytest.raises(FileFormatError, match="leads out of the scan's folder") as caught:
        label_scan(source, read_scan(source))
        licence_beside(source)
    assert caught.value.path == folder / name


def test_links_inside_the_folder_are_read(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("MIT")
    (tmp_path / "LICENSE").symlink_to("text")
    assert licence_beside(tmp_path / "home.glb") == "MIT"


@pytest.mark.parametrize(
    ("beside", "expected"),
    [
        (["LICENSE", "LICENSE.home", "LICENSE.home_2"], "LICENSE.home_2"),
        (["LICENSE", "LICENSE.home", "LICENSE.ho"], "LICENSE.home"),
        (["LICENSE", "LICENSE.other"], "LICENSE"),
        (["LICENSE.other"], ""),
    ],
)
def test_the_nearest_licence_counts(tmp_path: Path, beside: list[str], expected: str) -> None:
    for name in beside:
        (tmp_path / name).write_text(name)
    assert licence_beside(tmp_path / "home_2.glb") == expected


def test_side_files_are_bounded(tmp_path: Path) -> None:
    assert side_file(tmp_path, "a", 10) is None
    (tmp_path / "a").write_bytes(bytes(11))
    assert side_file(tmp_path, "a", 11) == bytes(11)
    with pytest.raises(FileFormatError, match="too large"):
        side_file(tmp_path, "a", 10)


POSE = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
ANCHOR = {
    "label": "TABLE",
    "pose": POSE,
    "plane": {"offset": {"x": 0, "y": 0}, "extent": {"width": 1, "height": 1}},
}


def anchor(**more: object) -> str:
    return json.dumps([{**ANCHOR, **more}])


def turned(w: float) -> dict[str, object]:
    return {**POSE, "orientation": {"x": 0, "y": 0, "z": 0, "w": w}}


def own(lower: str) -> str:
    return (
        '{"frame": "source", "objects": [{"name": "a", "category": "bed", "lower": '
        f'[{lower}, 0, 0], "upper": [1, 1, 1]}}]}}'
    )


@pytest.mark.parametrize(
    "text",
    [
        *("{}", "[1]", "[{}]", "[5]", '{"frame": "world", "objects": []}'),
        '[{"label": null}]',
        '{"frame": "source", "objects": [5]}',
        own("1" * 401),
        own("1e999"),
        own("NaN"),
        own("1e300"),
        anchor(pose=turned(0.0)),
        anchor(pose=turned(float("inf"))),
        anchor(pose=turned(float("nan"))),
        anchor(plane={"offset": {"x": 0, "y": 0}, "extent": {"width": 10**400, "height": 1}}),
        anchor(pose=5),
    ],
)
def test_damaged_labels_are_named(text: str, tmp_path: Path) -> None:
    path = tmp_path / "home.labels.json"
    path.write_text(text)
    with pytest.raises(FileFormatError, match="not a label file") as caught:
        read_labels(tmp_path / "home.glb")
    assert caught.value.path == path
    assert "\n" not in str(caught.value)


def test_labels_that_are_numbers_are_read_as_words(tmp_path: Path) -> None:
    (tmp_path / "home.labels.json").write_text(anchor(label=5))
    (box,) = read_labels(tmp_path / "home.glb")
    assert box.name == "5_0"


def test_source_digest_follows_side_files_and_stops_in_crowds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "home.obj"
    source.write_text("v 0 0 0\n")
    seen = {scene_items.source_digest(source)}
    for name in ("home.LICENSE", "home.license.txt", "home.mtl", "deep/er/a.png", "home.house"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("a")
        seen.add(scene_items.source_digest(source))
    assert len(seen) == 6
    for name in ("runs/a.png", ".git/a.png", "other.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("a")
    assert scene_items.source_digest(source) in seen
    monkeypatch.setattr(scene_items, "MAX_BESIDE", 5)
    with pytest.raises(FileFormatError, match="more than 5 files"):
        scene_items.source_digest(source)


@pytest.mark.chain
def test_a_scene_takes_its_licence_from_the_folder_or_nothing_is_made(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    folder, out = tmp_path / "scan", tmp_path / "out"
    folder.mkdir()
    out.mkdir()
    source = scans.write_glb(scans.room(), folder / "home.glb")
    (folder / "LICENSE").symlink_to(tmp_path / "secret")
    with pytest.raises(FileFormatError, match="leads out of the scan's folder"):
        repair_scene(source, out)
    assert not list(out.iterdir())
    (folder / "LICENSE").unlink()
    (folder / "LICENSE").write_text("CC-BY-4.0")
    assert repair_scene(source, out).source["licence"] == "CC-BY-4.0"

"""A folder of scans as datasets lay them out."""

from pathlib import Path

import pytest

from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.inputs.folders import find_scans


def lay_out(root: Path, *names: str) -> Path:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    return root


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("a.glb", "b.PLY", "notes.txt", "c.pcd"), {"a": "a.glb", "b": "b.PLY", "c": "c.pcd"}),
        # Matterport3D: the semantic mesh is no scan of its own.
        (("mp/x1/x1.glb", "mp/x1/x1_semantic.ply", "mp/x1/x1.house"), {"x1": "mp/x1/x1.glb"}),
        # GRScenes: what a stage refers to is no scan of its own.
        (("home.usd", "models/bed/instance.usd", "models/cup.usda"), {"home": "home.usd"}),
        (("s/s.usd", "s/s.glb", "s/part.usd"), {"s": "s/s.glb"}),
        (("deep/er/room.obj", ".trash/room.obj"), {"room": "deep/er/room.obj"}),
    ],
)
def test_each_scan_once_and_no_parts(tmp_path, names, expected):
    found = find_scans(lay_out(tmp_path, *names))
    assert {k: p.relative_to(tmp_path).as_posix() for k, p in found.items()} == expected


def test_two_scans_of_one_name_are_reported(tmp_path):
    with pytest.raises(InputError, match="two scans are named room"):
        find_scans(lay_out(tmp_path, "a/room.obj", "b/room.glb"))


def test_a_missing_folder_is_reported(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        find_scans(tmp_path / "nowhere")

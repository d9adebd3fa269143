"""What is seen along paths, written path by path and read back."""

import json
from pathlib import Path

import pytest

from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.scene.visibility import (
    Glimpse,
    PathSight,
    SightCamera,
    read_visibility,
    visibility_writer,
)

CAMERA = SightCamera("h1", 128, 96, 90.0, 1.6, 15.0, 0.5)
SIGHTS = {
    "7": PathSight((0.0, 0.5), (Glimpse("sofa-1", 0.5, 120, 0.25, (200, 10, 30)),)),
    "left\nroom": PathSight((0.0,), ()),
}


def written(path: Path) -> Path:
    """Write `SIGHTS` and return the file."""
    with visibility_writer(path, CAMERA) as write:
        for trajectory_id, sight in SIGHTS.items():
            write(trajectory_id, sight)
    return path


def test_every_path_is_read_back(tmp_path: Path):
    """Camera, ids with line breaks, and a path that sees nothing."""
    found = read_visibility(written(tmp_path / "a.seen.json"))
    assert found.camera == CAMERA
    assert dict(found.paths) == SIGHTS
    assert found.paths.get("8") is None


def test_nothing_is_left_of_a_record_whose_writer_fails(tmp_path: Path):
    """Half a record would hide what the other paths see."""
    with pytest.raises(ZeroDivisionError), visibility_writer(tmp_path / "a", CAMERA) as write:
        write("7", SIGHTS["7"])
        raise ZeroDivisionError
    assert not [*tmp_path.iterdir()]


def test_the_file_is_one_json_object(tmp_path: Path):
    """Whoever holds all of it in memory needs no reader of ours."""
    document = json.loads(written(tmp_path / "a.seen.json").read_text())
    assert document["camera"]["robot"] == "h1"
    assert document["paths"]["7"]["glimpses"] == [["sofa-1", 0.5, 120, 0.25, [200, 10, 30]]]
    with visibility_writer(tmp_path / "none.seen.json", CAMERA):
        pass
    assert json.loads((tmp_path / "none.seen.json").read_text())["paths"] == {}
    assert not read_visibility(tmp_path / "none.seen.json").paths


@pytest.mark.parametrize("line", [0, 1, 2, 3])
@pytest.mark.parametrize("damage", ["cut", "list", "text", "end"])
def test_damage_in_any_line_is_found_when_the_file_is_read(tmp_path: Path, line: int, damage: str):
    """Not only when the damaged path is asked for; nor may a path be missing without a word."""
    path = written(tmp_path / "a.seen.json")
    lines = path.read_text().splitlines()
    if damage == "end":
        del lines[line:]
    else:
        lines[line] = {"cut": lines[line][:-9], "list": "[]", "text": json.dumps("?")}[damage]
    path.write_text("\n".join(lines))
    with pytest.raises(FileFormatError, match=r"a\.seen\.json"):
        read_visibility(path)


def test_an_older_record_is_refused_by_its_version(tmp_path: Path):
    """Records of version 1 were one JSON object."""
    path = tmp_path / "a.seen.json"
    path.write_text('{"format_version":1,"camera":{},"paths":{}}\n')
    with pytest.raises(FileFormatError, match="version 1; this code reads 2"):
        read_visibility(path)

"""Matterport3D's .house files: too many boxes, invalid numbers, endless lines."""

from pathlib import Path

import pytest

from tests.security.hostile import not_files, put, refusal
from vlnpe.scene_repair.labels.matterport import House, read_house

BOUNDS = "H x x " + "0 " * 15 + "0 0 0 9 9 9\n"
CATEGORY = "C 0 0 bed 0 bed\n"
THING = "O {number} 0 0 1 1 1 1 0 0 0 1 0 1 1 1\n"


def house_of(folder: Path, text: str | bytes) -> House | None:
    path = folder / "home.house"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_house(path)


def house(*lines: str) -> str:
    return "ASCII 1.0\n" + BOUNDS + CATEGORY + "".join(lines)


def test_the_sound_file_is_read(tmp_path: Path) -> None:
    found = house_of(tmp_path, house(THING.format(number=0)))
    assert found is not None and len(found.boxes) == 1


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    put(kind, tmp_path / "home.house")
    refusal(lambda: read_house(tmp_path / "home.house"))


def test_links_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(house(THING.format(number=0)))
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "home.house").symlink_to(tmp_path / "secret")
    refusal(lambda: read_house(tmp_path / "scan" / "home.house"))


def test_very_many_boxes_are_refused(tmp_path: Path) -> None:
    text = house(*(THING.format(number=k) for k in range(10_001)))
    assert "labels" in refusal(lambda: house_of(tmp_path, text)).reason


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"\0" * 1000,
        b"\xff\xfe",
        "ASCII 1.0\n",
        "ASCII 1.0\n" + "x" * 1_000_000,
        house("O\n"),
        house("O 0 0 0 1 1 1 1 0 0 0 1 0 1 1 nan\n"),
        house("O 0 0 0 inf 1 1 1 0 0 0 1 0 1 1 1\n"),
        house("O 0 0 0 1e300 1 1 1 0 0 0 1 0 1 1 1\n"),
        house("O 0 0 0 " + "9" * 100_000 + " 1 1 1 0 0 0 1 0 1 1 1\n"),
        house("O 0 0 0 " + "x" * 100_000 + " 1 1 1 0 0 0 1 0 1 1 1\n"),
        house("O 0 0 0 1 1 1 0 0 0 0 0 0 0 0 0\n"),
        house("O 0 0 0 1 1 1 1 0 0 0 1 001 1 1\n"),
        house("R 0 0 0 0 a 0 0 0 1 1 1 nan 0 0\n"),
        house("C 0\n"),
        "ASCII 1.0\nH x x " + "0 " * 15 + "nan nan nan nan nan nan\n" + CATEGORY,
    ],
)
def test_damaged_files_are_named(text: str | bytes, tmp_path: Path) -> None:
    refusal(lambda: house_of(tmp_path, text))

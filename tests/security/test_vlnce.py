"""VLN-CE episode files: bombs, counts, recursion, invalid numbers, path traversal in ids."""

import copy
import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.formats.vlnce.test_vlnce import PUBLIC, save
from tests.security.hostile import not_files, put, refusal
from vlnpe.formats.internnav.tokens import read_vocabulary
from vlnpe.formats.untrusted.limits import DEFAULTS
from vlnpe.formats.vlnce.files import read_vlnce


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json.gz"
    complaint = put(kind, path)
    assert complaint in refusal(lambda: read_vlnce(path)).reason
    assert complaint in refusal(lambda: read_vocabulary(path)).reason


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (b" " * 30_000_000, "30,000,000 bytes|more than 1,000,000 bytes"),
        (b"]" * 900_000, "not JSON"),
        (b"[" * 900_000, "values"),
        (b"[" * 9_000, "nested too deeply"),
        (b"[" + b"1," * 400_000, "values"),
        (b'{"episodes": [' + b'{"start_rotation": []},' * 1000 + b"{}]}", "100 episodes"),
        (b'{"episodes": [' + b"{}," * 1000 + b"{}]}", "100 episodes"),
    ],
)
def test_bombs_are_refused_while_they_are_decompressed(
    text: bytes, complaint: str, tmp_path: Path
) -> None:
    caps = replace(DEFAULTS, vlnce_bytes=1_000_000, vlnce_values=100_000, vlnce_episodes=100)
    for name, data in (("a.json.gz", gzip.compress(text)), ("a.json", text)):
        (tmp_path / name).write_bytes(data)
        error = refusal(lambda name=name: read_vlnce(tmp_path / name, limits=caps))
        assert any(part in error.reason for part in complaint.split("|"))


def test_the_public_files_fit_the_default_limits() -> None:
    """EnvDrop, the largest split that VLN-CE publishes, has 146,304 episodes of some 300 values."""
    assert DEFAULTS.vlnce_episodes > 146_304
    assert DEFAULTS.vlnce_values > 146_304 * 300


def test_a_bomb_of_gigabytes_takes_little_memory(tmp_path: Path) -> None:
    """Two hundred members, each of them 20 MB of brackets: together more than is ever read."""
    import tracemalloc

    member = gzip.compress(b"[" * (20 << 20), compresslevel=1)
    (tmp_path / "a.json.gz").write_bytes(member * 200)
    tracemalloc.start()
    try:
        refusal(lambda: read_vlnce(tmp_path / "a.json.gz"))
        assert tracemalloc.get_traced_memory()[1] < 400 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "not JSON"),
        (b"{", "not JSON"),
        (b"[]", "episodes"),
        (b'{"episodes": {}}', "episodes"),
        (b'{"episodes": [1]}', "not an object"),
        (b"\xff\xfe\x00", "not JSON"),
        (gzip.compress(b'{"episodes": []}', mtime=0)[:-6], "broken gzip"),
        (b"\x1f\x8b junk", "broken gzip"),
        (b'{"episodes": [' + b"1" * 5000 + b"]}", "not JSON"),
        (b"[" * 100_000, "nested too deeply"),
    ],
)
def test_files_that_are_something_else(content: bytes, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "x.json.gz"
    path.write_bytes(content)
    assert complaint in refusal(lambda: read_vlnce(path)).reason


def with_episode(**changes: Any) -> dict[str, Any]:
    document = copy.deepcopy(PUBLIC)
    document["episodes"][0] |= changes
    return document


def test_nesting_counts_outside_of_texts_alone(tmp_path: Path) -> None:
    text = {"instruction_text": "[{" * 500}
    assert len(read_vlnce(save(tmp_path / "a.json", with_episode(instruction=text))).episodes) == 1
    deep = json.loads("[" * 200 + "]" * 200)
    path = save(tmp_path / "b.json", with_episode(deep=deep))
    assert "nested too deeply" in refusal(lambda: read_vlnce(path)).reason


@pytest.mark.parametrize("value", [float("nan"), float("inf"), True, "1", 10**400, [], None])
@pytest.mark.parametrize("key", ["start_position", "reference_path", "start_rotation", "goals"])
def test_numbers_must_be_finite(key: str, value: Any, tmp_path: Path) -> None:
    document = copy.deepcopy(PUBLIC)
    at = document["episodes"][0][key]
    at = at[0] if key in ("reference_path", "goals") else at
    (at["position"] if key == "goals" else at)[1] = value
    path = save(tmp_path / "a.json", document)
    assert key in refusal(lambda: read_vlnce(path)).reason


@pytest.mark.parametrize("place", ["document", "instruction_vocab", "info", "unknown"])
def test_numbers_that_json_cannot_write_are_named(place: str, tmp_path: Path) -> None:
    """What is read is written again, unknown keys included, and JSON has no NaN."""
    document = copy.deepcopy(PUBLIC)
    owner = document["episodes"][0] if place in ("info", "unknown") else document
    owner.setdefault(place, {})
    owner[place] = {"deep": [float("nan")]}
    path = save(tmp_path / "a.json", document)
    assert place in refusal(lambda: read_vlnce(path)).reason


@pytest.mark.parametrize(
    "scene_id",
    [
        "/etc/passwd.glb",
        "mp3d/../../x.glb",
        "..",
        "C:\\scans\\x.glb",
        "a\\..\\..\\x.glb",
        "\\\\host\\share\\x.glb",
        "a\0b.glb",
    ],
)
def test_scene_ids_that_leave_their_folder_are_refused(scene_id: str, tmp_path: Path) -> None:
    document = copy.deepcopy(PUBLIC)
    document["episodes"].append({**document["episodes"][0], "episode_id": 2, "scene_id": scene_id})
    path = save(tmp_path / "a.json", document)
    assert "leads out of the folder" in refusal(lambda: read_vlnce(path)).reason


@pytest.mark.parametrize("key", ["episode_id", "scene_id", "goals", "instruction"])
def test_enormous_values_are_not_printed(key: str, tmp_path: Path) -> None:
    """`refusal` checks the length."""
    value = {"episode_id": "x" * 100_000, "scene_id": "../" * 100_000}.get(key, [["x" * 10**6]])
    document = with_episode(**{key: value}, trajectory_id=None)
    refusal(lambda: read_vlnce(save(tmp_path / "a.json", document)))


@pytest.mark.parametrize(
    "words", [5, {"a": 1}, ["<pad>"], [1, 2], None, "<pad><unk>", [["<pad>"]] * 9]
)
def test_damaged_vocabularies_are_named(words: Any, tmp_path: Path) -> None:
    path = save(tmp_path / "a.json.gz", {"instruction_vocab": {"word_list": words}})
    refusal(lambda: read_vocabulary(path))

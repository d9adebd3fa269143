"""Opening files, and documents of JSON, YAML and TOML: the part that all readers share."""

import json
import os
import tracemalloc
from pathlib import Path

import pytest

from tests.security.hostile import CLOSED_DEEP_JSON, DEEP, DEEP_JSON, not_files, put, refusal
from vlnpe.formats.core.errors import FileFormatError, InputError, brief
from vlnpe.formats.untrusted import limits as limits_module
from vlnpe.formats.untrusted.documents import deeper_than, parse_json, read_json, read_toml
from vlnpe.formats.untrusted.files import check_input, check_links, open_input, read_input
from vlnpe.formats.untrusted.limits import Limits, limits
from vlnpe.formats.untrusted.yaml_document import read_yaml


@not_files
def test_only_regular_files_are_opened(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "x"
    complaint = put(kind, path)
    for read in (
        lambda: check_input(path),
        lambda: open_input(path),
        lambda: read_input(path, max_bytes=1000),
        lambda: read_json(path),
        lambda: read_yaml(path),
        lambda: read_toml(path),
    ):
        assert complaint in refusal(read).reason


def test_files_without_a_size_are_cut_off() -> None:
    """Files of /proc claim to be empty and are not."""
    if not Path("/proc/self/maps").is_file():
        pytest.skip("no /proc")
    assert "too large" in refusal(lambda: read_input(Path("/proc/self/maps"), max_bytes=10)).reason


def test_a_small_file_takes_little_memory_whatever_the_limit(tmp_path: Path) -> None:
    """Found by fuzzing: a buffer of the limit's size was asked for."""
    (tmp_path / "a").write_bytes(b"text")
    tracemalloc.start()
    try:
        assert read_input(tmp_path / "a", max_bytes=1 << 40) == b"text"
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


def test_size_and_place_are_checked(tmp_path: Path) -> None:
    inside, outside = tmp_path / "in", tmp_path / "out"
    inside.mkdir()
    outside.mkdir()
    (outside / "secret").write_text("s")
    (inside / "file").write_text("text")
    (inside / "good").symlink_to("file")
    (inside / "bad").symlink_to(outside / "secret")
    (inside / "folder").symlink_to(outside)
    assert read_input(inside / "good", root=inside, max_bytes=4) == b"text"
    assert read_input(inside / "bad", max_bytes=4) == b"s"  # the user's own choice
    for name in ("bad", "folder/secret", "../out/secret"):
        error = refusal(lambda name=name: read_input(inside / name, root=inside, max_bytes=4))
        assert "leads out of" in error.reason
    assert "too large" in refusal(lambda: read_input(inside / "file", max_bytes=3)).reason
    assert "leads out of" in refusal(lambda: check_links(inside)).reason


def test_a_snapshot_of_the_hub_may_link_to_its_own_blobs(tmp_path: Path) -> None:
    snapshot = tmp_path / "datasets--a--b" / "snapshots" / "0f3"
    blobs = tmp_path / "datasets--a--b" / "blobs"
    for folder in (snapshot, blobs):
        folder.mkdir(parents=True)
    (blobs / "1a").write_text("x")
    (snapshot / "file").symlink_to("../../blobs/1a")
    check_links(snapshot)
    (snapshot / "other").symlink_to("../../refs")
    assert "leads out" in refusal(lambda: check_links(snapshot)).reason


def test_names_that_are_not_utf8_can_be_printed(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe.json"))
    assert "\\udcff" in str(refusal(lambda: read_json(path)))
    path.write_text("{")
    assert "\\udcff" in str(refusal(lambda: read_json(path)))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (DEEP_JSON.encode(), "nested too deeply"),
        (b'{"a":' * DEEP, "nested too deeply"),
        (CLOSED_DEEP_JSON.encode(), "nested too deeply"),
        (b"]" * DEEP, "not JSON"),
        (b"9" * 5000, "not JSON"),
        (b"\xff\xfe" + "[]".encode("utf-16-le"), "not JSON"),
        (b"[" + b"0," * 1000 + b"0]", "more than 1,000 values"),
        (b"", "not JSON"),
    ],
)
def test_json_is_bounded(text: bytes, complaint: str, tmp_path: Path) -> None:
    error = refusal(
        lambda: parse_json(
            tmp_path / "a", text, max_values=1000 + DEEP * ("values" not in complaint)
        )
    )
    assert complaint in error.reason


def test_brackets_of_texts_nest_nothing(tmp_path: Path) -> None:
    value = {"a": "[{" * 500, "b": [1, 2.5, None]}
    assert parse_json(tmp_path / "a", json.dumps(value).encode()) == value


def test_depth_is_counted_exactly() -> None:
    assert not deeper_than([[1]], 2)
    assert deeper_than([[[]]], 2)
    assert not deeper_than(5, 0)
    assert deeper_than({}, 0)


def bomb(levels: int, merge: bool = False) -> str:
    lines = ["a0: &a0 {x: 1}" if merge else "a0: &a0 [x, x]"]
    for k in range(1, levels):
        row = ", ".join([f"*a{k - 1}"] * 9)
        lines.append(f"a{k}: &a{k} {{<<: [{row}], y{k}: 1}}" if merge else f"a{k}: &a{k} [{row}]")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (bomb(9), "aliases written out"),
        (bomb(9, merge=True), "aliases written out"),
        ("a: &a [*a]", "refers to itself"),
        ("a: &a {b: &b [*a]}", "refers to itself"),
        ("a: *none", "refers to itself or to nothing"),
        ("[" * 5000, "nested too deeply"),
        ("- " * 5000 + "x", "nested too deeply"),
        ("{a: " * 5000, "nested too deeply"),
        ("a: " + "1:" * 100_000 + "1", "without quotes"),
        ("a: " + "9" * 100_000, "without quotes"),
        ("a: 2001-99-99", "not YAML"),
        ("a: !!python/object/apply:os.system [true]", "not YAML"),
        ("? [a]\n: b", "not YAML"),
        ("a: [", "not YAML"),
        ("a: \x00", "not YAML"),
        ("x" * (1 << 20) + "x", "too large"),
    ],
)
def test_yaml_is_bounded(text: str, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    assert complaint in refusal(lambda: read_yaml(path)).reason


def test_plain_use_of_anchors_is_fine(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: &a {x: 1}\nb: {<<: *a, y: 2}\nc: *a\n")
    assert read_yaml(path) == {"a": {"x": 1}, "b": {"x": 1, "y": 2}, "c": {"x": 1}}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a = " + "[" * 50_000, "nested too deeply|not valid"),
        ("a = " + "{b = " * 50_000, "nested too deeply|not valid"),
        (".".join("a" * 2000) + " = 1", "nested too deeply"),
        ("[" + ".".join("a" * 2000) + "]", "nested too deeply"),
        ("a = " + "9" * 5000, "not valid TOML"),
        ("a = 1\na = 2", "not valid TOML"),
        ("#" * (1 << 20) + "#", "too large"),
    ],
)
def test_toml_is_bounded(text: str, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=complaint):
        read_toml(path)


def test_messages_stay_short_whatever_the_value() -> None:
    deep: list[object] = []
    for _ in range(100_000):
        deep = [deep]
    for value in (deep, "x" * 10**6, list(range(10**5)), 10**6000, {1: {2: {3: {4: {}}}}}):
        assert len(brief(value)) <= 120
    assert brief({"a": [1, "x"]}) == "{'a': [1, 'x']}"


def test_limits_are_raised_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(limits_module.VARIABLE, raising=False)
    assert limits() == Limits()
    monkeypatch.setenv(limits_module.VARIABLE, "labels=7, depth=5")
    assert limits() == Limits(labels=7, depth=5)
    for wrong in ("lables=7", "labels=-1", "labels", "labels=many"):
        monkeypatch.setenv(limits_module.VARIABLE, wrong)
        with pytest.raises(InputError, match="valid: "):
            limits()

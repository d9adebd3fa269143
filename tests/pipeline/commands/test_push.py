"""Publishing: what would be uploaded, what is refused, and what the hub is asked to do."""

import json
import shutil
from fnmatch import fnmatch
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.support.lerobot_data import write_units
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.pipeline.commands.push import Push, run_push
from vlnpe.pipeline.publish import HubError, plan_release


class FakeHub:
    """Remembers calls; `tags` are those of an existing repository."""

    def __init__(self, tags: set[str] | None = None, broken: bool = False):
        self.tags, self.broken = tags, broken
        self.calls: list[tuple[str, dict[str, Any]]] = []

    def repo_exists(self, repo_id: str, *, repo_type: str) -> bool:
        return self.tags is not None

    def list_repo_refs(self, repo_id: str, *, repo_type: str) -> Any:
        tags = [SimpleNamespace(name=name, target_commit="f00d") for name in self.tags or ()]
        return SimpleNamespace(tags=tags)

    def create_repo(self, repo_id: str, **options: Any) -> None:
        self.calls.append(("create_repo", options))

    def upload_folder(self, **options: Any) -> Any:
        if self.broken:
            raise ConnectionError("connection refused")
        self.calls.append(("upload_folder", options))
        return SimpleNamespace(oid="c0ffee")

    def create_tag(self, repo_id: str, **options: Any) -> None:
        self.calls.append(("create_tag", options))

    def delete_tag(self, repo_id: str, **options: Any) -> None:
        self.calls.append(("delete_tag", options))

    def names(self) -> list[str]:
        return [name for name, _ in self.calls]


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_units(tmp_path_factory.mktemp("units"), (1.0, 0.5))


def make(units: list[Path], root: Path, licence: str | None = "MIT") -> Path:
    scenes = {} if licence is None else {"two_rooms": {"licence": licence, "sha256": "ab"}}
    assemble_dataset(units, root, provenance={"scenes": scenes}, licence="mit", title="Rooms")
    return root


@pytest.fixture(scope="module")
def original(units: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(units, tmp_path_factory.mktemp("original") / "set")


@pytest.fixture
def dataset(original: Path, tmp_path: Path) -> Path:
    return shutil.copytree(original, tmp_path / "set")


def test_by_default_nothing_is_uploaded_but_shown(
    dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dataset / ".vlnpe-tmp-half").write_text("half")
    hub = FakeHub()
    assert run_push(Push(dataset, "someone/rooms"), hub) == 0
    assert hub.calls == []
    shown = capsys.readouterr().out
    for word in ("datasets/someone/rooms", "data/chunk-000/file-000.parquet", "film_strip.png"):
        assert word in shown
    assert 'license: "mit"' in shown and "--yes" in shown and "data-" in shown
    assert "half" not in shown


def test_a_release_is_one_commit_under_its_own_tag(
    dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hub = FakeHub(tags={"v3.0", "first"})
    assert run_push(Push(dataset, "someone/rooms", tag="second", yes=True, json=True), hub) == 0
    assert hub.names() == ["create_repo", "upload_folder", "delete_tag", "create_tag", "create_tag"]
    uploaded = hub.calls[1][1]
    assert set(uploaded["allow_patterns"]) == {
        p.relative_to(dataset).as_posix() for p in dataset.rglob("*") if p.is_file()
    }
    # Of an earlier release nothing stays that this one lacks.
    earlier = ("data/chunk-000/file-007.parquet", "rollouts/episode_000007.mcap", "film_strip.png")
    for path in earlier:
        assert any(fnmatch(path, pattern) for pattern in uploaded["delete_patterns"])
    assert not any(fnmatch("README.md", pattern) for pattern in uploaded["delete_patterns"])
    tagged = [options for name, options in hub.calls if name == "create_tag"]
    # The release's own tag says that all is done, so it comes last.
    assert [t["tag"] for t in tagged] == ["v3.0", "second"]
    assert {t["revision"] for t in tagged} == {"c0ffee"}
    value = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (value["commit"], value["tag"]) == ("c0ffee", "second")


def test_a_release_never_changes(dataset: Path) -> None:
    hub = FakeHub(tags={"first"})
    with pytest.raises(InputError, match="never change"):
        run_push(Push(dataset, "someone/rooms", tag="first", yes=True), hub)
    assert hub.calls == []


def test_the_default_tag_is_the_contents(units: list[Path], tmp_path: Path) -> None:
    one, two = make(units, tmp_path / "a"), make(units, tmp_path / "b")
    assert plan_release(one, "a/b").tag == plan_release(two, "c/d").tag
    (two / "README.md").write_text((two / "README.md").read_text() + "\nmore\n")
    assert plan_release(one, "a/b").tag != plan_release(two, "c/d").tag


@pytest.mark.parametrize("licence", [None, "", "CC-BY-ND-4.0", "Ask us before you use this scan."])
@pytest.mark.parametrize("yes", [False, True])
def test_forbidding_licences_are_refused_unless_confirmed(
    units: list[Path], tmp_path: Path, licence: str | None, yes: bool
) -> None:
    root, hub = make(units, tmp_path / "set", licence), FakeHub()
    with pytest.raises(InputError, match="licence"):
        run_push(Push(root, "someone/rooms", yes=yes), hub)
    assert hub.calls == []
    assert run_push(Push(root, "someone/rooms", yes=yes, licence_ok=True), hub) == 0
    assert ("upload_folder" in hub.names()) == yes


@pytest.mark.parametrize("repo", ["rooms", "a/b/c", "/rooms", "someone/", "some one/rooms", ""])
def test_bad_repositories_are_named(dataset: Path, repo: str) -> None:
    with pytest.raises(InputError, match="user/name"):
        plan_release(dataset, repo)


@pytest.mark.parametrize("tag", ["", "v3.0", "V1", "1.2", "a b", "../main", "x" * 97])
def test_bad_tags_are_named(dataset: Path, tag: str) -> None:
    with pytest.raises(InputError, match="--tag"):
        plan_release(dataset, "someone/rooms", tag)


@pytest.mark.parametrize("lost", ["meta/info.json", "README.md"])
def test_half_a_dataset_is_not_published(dataset: Path, lost: str) -> None:
    (dataset / lost).unlink()
    with pytest.raises(FileFormatError, match="missing"):
        plan_release(dataset, "someone/rooms")


def test_the_hubs_errors_come_in_one_line(dataset: Path) -> None:
    with pytest.raises(HubError, match="someone/rooms: ConnectionError: connection refused"):
        run_push(Push(dataset, "someone/rooms", yes=True), FakeHub(broken=True))


def test_offline_means_no_upload(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(InputError, match="HF_HUB_OFFLINE"):
        run_push(Push(dataset, "someone/rooms", yes=True))

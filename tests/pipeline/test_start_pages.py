"""The pages of docs/start can be followed from top to bottom."""

import os
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.pages import ROOT, blocks, commands
from vlnpe.pipeline.cli import main

pytestmark = [pytest.mark.slow, pytest.mark.chain]
START = ROOT / "docs" / "start"
# What the commands of the pages say → what is run instead.
SMALLER = {
    "builtin-exact:apartment*14": "builtin-exact:apartment*3",
    "10": "2",  # --train-scenes
    "train=320,val_unseen=64": "train=6,val_unseen=2",
    "6": "2",  # --episodes
}
LIMITS = {"train": ["--steps", "4"], "evaluate": ["--limit", "2"]}
Follow = Callable[[str], None]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which all pages are followed: later ones use the first one's run."""
    return tmp_path_factory.mktemp("start")


@pytest.fixture
def follow(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Follow:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")

    def follow(name: str) -> None:
        for block in blocks(START / name, "yaml"):
            Path("mine.yaml").write_text(block)
        for words in commands(START / name):
            _run(words)

    return follow


def _expanded(word: str) -> list[str]:
    """Return the paths that a shell puts in the place of a pattern."""
    paths = Path().glob(word) if "*" in word else ()
    return [str(path) for path in paths] or [word]


def _run(words: list[str]) -> None:
    """Run a command of a page; what installs packages or is not ours is left out."""
    if words[:2] == ["make", "collect"]:
        alone = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
        command = ["make", "--no-print-directory", "-n", *words[1:]]
        lines = subprocess.check_output(command, cwd=ROOT, text=True, env=alone).splitlines()
        words = shlex.split(lines[-1].removeprefix(".venv/bin/"))
        assert words[0] == "vlnpe", lines
    if words[0] in ("mkdir", "cp"):
        subprocess.check_call(words)
    elif words[0] == "vlnpe":
        smaller = [SMALLER.get(w, w) for word in words[1:] for w in _expanded(word)]
        assert main([*smaller, *LIMITS.get(words[1], [])]) == 0, words


def test_first_dataset(follow: Follow, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("lerobot", reason="the page loads the dataset with it")
    follow("first_dataset.md")
    capsys.readouterr()
    for block in blocks(START / "first_dataset.md", "python"):
        exec(compile(block, "first_dataset.md", "exec"), {})
    assert "torch.Size([3, 256, 256])" in capsys.readouterr().out
    assert {path.name.split("-")[0] for path in Path("runs/apartment-0/lerobot").iterdir()} == {
        "aliengo",
        "jetbot",
    }


def test_own_scan(follow: Follow) -> None:
    follow("own_scan.md")
    assert Path("scenes/home/after.png").is_file()
    assert Path("runs/home/report/index.html").is_file()


def test_own_episodes(follow: Follow) -> None:
    if not Path("runs/apartment-0/episodes").is_dir():
        follow("first_dataset.md")
    follow("own_episodes.md")
    assert list(Path("runs/mine/lerobot").iterdir())


def test_own_robot(follow: Follow) -> None:
    follow("own_robot.md")
    assert list(Path("pictures").iterdir())
    assert list(Path("runs/apartment-0/rollouts/mybot").rglob("*.mcap"))


def test_train_and_evaluate(follow: Follow) -> None:
    pytest.importorskip("torch", reason="the page trains")
    follow("train_and_evaluate.md")
    evaluations = Path("runs/homes/evaluations")
    for pattern in ("random-vlnce-*", "cma-*-vlnce-*", "cma-*-aliengo-speed-*", "cma-robots-*"):
        assert list(evaluations.glob(f"{pattern}/results.json")), pattern

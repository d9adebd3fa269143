"""`vlnpe drive` as its user meets it: a page, a robot in real time, and a dataset at the end."""

import json
import re
import shutil
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

from tests.support.devtools import until
from tests.support.driver import AHEAD, LEFT, PATIENCE_S, Page, start
from tests.support.runs import tiny_run
from vlnpe.formats.core.journal import journal_line, parse_journal_line
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.pipeline.engine.ledger import Ledger

pytestmark = [pytest.mark.slow, pytest.mark.chain]

ROBOT = ("--robot", "aliengo")


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two rooms with instructed episodes."""
    folder = tmp_path_factory.mktemp("drive")
    scan = tiny_run.write_scan(folder / "rooms.glb")
    out = folder / "run"
    options = ("--min-length-m", "2", "--min-crossings", "0", "--only-episodes")
    done = tiny_run.process(
        "collect", "--scene", scan, "--episodes", 2, *ROBOT, *options, "--out", out
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def driven(prepared: Path) -> Path:
    """A run with an episode and a free drive, both killed in the middle."""
    out = prepared.parent / "driven"
    command = (prepared, *ROBOT, "--out", out, "--driver", "Ada")
    process, url = start(*command, "--episodes", prepared)
    page = Page(url)
    page.until("waits")
    assert page.state["instruction"]
    page.hold(AHEAD, 1.5)
    page.watch(1.0)  # what a busy machine hears late
    page.until("waits")
    pose = page.state["pose"]
    process.kill()
    process.communicate()
    process, url = start(*command, "--episodes", prepared)
    page = Page(url)
    page.until("waits")
    assert page.state["pose"] == pose and "interrupted" in page.state["title"]
    page.hold(LEFT, 0.5)
    page.do("undo")
    page.hold(AHEAD, 0.5)
    page.do("stop", until="ended")
    assert page.state["end"] in ("Arrived.", "Stopped, farther than 1 m from the goal.")
    page.do("keep", until="waits")
    page.do("close")
    _, text = process.communicate(timeout=300)
    assert process.returncode == 0, text
    process, url = start(*command)
    page = Page(url)
    page.until("waits")
    page.hold(AHEAD, 3.0)
    process.kill()
    process.communicate()
    done = tiny_run.process("drive", *command, "--finish")
    assert done.returncode == 0, done.stderr
    assert "human" in done.stdout
    return out


def test_drives_are_rollouts_like_any_other(driven: Path, tmp_path: Path) -> None:
    rollouts = {path.stem: read_rollout(path) for path in driven.glob("rollouts/aliengo/human/*")}
    assert len(rollouts) == 2
    for rollout in rollouts.values():
        assert (rollout.controller, rollout.facts["driver"]) == ("human", "Ada")
        assert rollout.episode.instruction
    free = rollouts["free-1"]
    assert free.end_reason == "success"
    (given,) = (rollout for name, rollout in rollouts.items() if name != "free-1")
    assert "undo" in [event.kind for event in given.events]
    done = tiny_run.process("verify", driven)
    assert done.returncode == 0, done.stdout
    (lerobot,) = (driven / "lerobot").iterdir()
    facts = json.loads((lerobot / "meta" / "provenance.json").read_text())
    assert facts["options"]["drivers"] == ["Ada"] and facts["options"]["success_m"] == 1.0
    for layout in ("navila", "internvla-n1"):
        done = tiny_run.process("convert", lerobot, "--to", layout, "--out", tmp_path / layout)
        assert done.returncode == 0, done.stderr


def test_the_chain_and_the_report_take_them(driven: Path, tmp_path: Path) -> None:
    done = tiny_run.process("report", driven)
    assert done.returncode == 0, done.stderr
    page = (driven / "report" / "index.html").read_text()
    assert "human" in page
    stages = {row.stage for row in Ledger(driven).rows()}
    assert {
        "repair",
        "drive",
        "instruct",
        "replay",
        "render",
        "export",
        "mcap",
        "dataset",
    } <= stages


def changed(journal: bytes, **episode: object) -> bytes:
    """Return the journal of a drive that nobody kept, with other values in its first line."""
    header, *lines = [parse_journal_line(line) for line in journal.splitlines()]
    header["episode"] |= episode
    return b"".join(map(journal_line, [header, *(line for line in lines if "kept" not in line)]))


def test_journals_that_cannot_be_used_are_named_and_block_nothing(
    driven: Path, prepared: Path, tmp_path: Path
) -> None:
    out = shutil.copytree(driven, tmp_path / "out")
    folder = out / "drives" / "aliengo"
    (given,) = (path for path in folder.iterdir() if not path.name.startswith("free-"))
    good = (folder / "free-1.drive").read_bytes()
    yaw = parse_journal_line(good.split(b"\n")[0])["episode"]["start_yaw_rad"]
    spoilt = {
        given: (b"x" + given.read_bytes(), "line 1 is damaged"),
        folder / "free-2.drive": (b"", "empty"),
        folder / "free-3.drive": (good.replace(b"drive 1", b"drive 0", 1), "damaged"),
        folder / "free-4.drive": (changed(good, scene_id="elsewhere"), "driven in elsewhere"),
        folder / "free-5.drive": (changed(good, start_yaw_rad=yaw + 0.1), "another state at 1 s"),
        folder / "free-6.drive": (changed(good, newer=1), "not a drive of this version"),
        folder / "free-7.drive": (journal_line({"format": "vlnpe drive 2"}), "'vlnpe drive 1'"),
        folder / "free-8.drive": (journal_line({"format": "vlnpe drive 1"}), "lacks controller"),
    }
    for path, (content, _) in spoilt.items():
        path.write_bytes(content)
    command = (prepared, *ROBOT, "--out", out, "--driver", "Ada")
    done = tiny_run.process("drive", *command, "--finish", "--json")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout.splitlines()[-1])
    assert facts["drives"] == 1  # the good one
    assert {Path(path).name for path in facts["left"]} == {path.name for path in spoilt}
    for path, (content, reason) in spoilt.items():
        assert reason in facts["left"][str(path)]
        assert f"left as it is: {path}: " in done.stderr
        assert path.read_bytes() == content
    process, url = start(*command, "--episodes", prepared)
    page = Page(url)
    page.until("waits")
    assert page.state["title"].startswith("episode ")
    page.hold(AHEAD, 0.5)
    process.kill()
    process.communicate()
    assert (folder / f"{given.stem}-2.drive").is_file()


def test_a_full_pipe_stops_neither_the_robot_nor_what_follows(
    prepared: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = ("drive", prepared, *ROBOT, "--out", out, "--finish")
    assert tiny_run.process(*words).returncode == 0
    (out / "drives" / "aliengo").mkdir(parents=True)
    for number in range(300):  # each is a line, of a path of hundreds of letters
        (out / "drives" / "aliengo" / f"{number}-{'x' * 200}.drive").touch()
    script = tmp_path / "browser"
    lines = "#!/bin/sh", f"cd {tmp_path}", "cp -p ${1#file://} opened", "echo $1 > url", ""
    script.write_text("\n".join(lines))
    script.chmod(0o755)
    home = {"HOME": str(tmp_path), "BROWSER": f"{script} %s", "DISPLAY": ":none"}
    process = subprocess.Popen(
        [*tiny_run.VLNPE, *map(str, words[:-1])],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=tiny_run.environment(**home),
    )
    opened = tmp_path / "opened"
    until(lambda: (tmp_path / "url").is_file(), PATIENCE_S, "a browser")
    (url,) = re.findall(r"http://[^']+", opened.read_text())
    assert "token" in url and "token" not in (tmp_path / "url").read_text()
    assert opened.stat().st_mode & 0o777 == 0o600
    page = Page(url)
    page.until("waits")
    page.hold(AHEAD, 1.0)
    assert page.state["time_s"] > 0.3
    process.terminate()
    process.communicate()


@pytest.fixture(scope="module")
def open_page(prepared: Path) -> Iterator[str]:
    out = prepared.parent / "alone"
    process, url = start(prepared, *ROBOT, "--out", out)
    yield url
    process.terminate()
    process.communicate()


def test_pictures_are_those_of_the_robots_camera(open_page: str) -> None:
    page = Page(open_page)
    page.until("waits")
    page.hold(AHEAD, 1.0)
    _, jpeg = page.pictures[-1]
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None and picture.shape == (256, 256, 3) and picture.std() > 5
    assert len({data for _, data in page.pictures}) > 3
    page.close()


def test_a_lost_page_stops_the_robot(open_page: str) -> None:
    page = Page(open_page)
    page.until("waits")
    page.hold(AHEAD, 1.0)
    page.send({"sticks": AHEAD, "number": 1})
    page.watch(0.2)
    assert page.state["state"] == "moving"
    page.close()
    page = Page(open_page)
    page.until("waits")
    assert page.state["command"] == [0, 0, 0]
    page.close()


@pytest.mark.parametrize(
    "message",
    ["", "{}", "[1]", '{"do": "rm"}', '{"sticks": [1, "a", 0]}', '{"sticks": [NaN, 0, 0]}'],
)
def test_other_messages_end_the_connection(open_page: str, message: str) -> None:
    page = Page(open_page)
    page.until("waits")
    page._socket.send(message)
    assert page.lost()


def test_without_the_token_or_from_elsewhere_nothing_is_served(open_page: str) -> None:
    with urllib.request.urlopen(open_page) as answer:
        assert b"vlnpe drive" in answer.read()
    wrong = open_page[:-1] + ("a" if open_page[-1] != "a" else "b")
    for url, headers in (
        (wrong, {}),
        (open_page.partition("?")[0], {}),
        (open_page, {"Host": "evil.example"}),
    ):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(urllib.request.Request(url, headers=headers))
    with pytest.raises(InvalidStatus, match="403"):
        Page(wrong)
    with pytest.raises(InvalidStatus, match="403"):
        Page(open_page, origin="http://evil.example")


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--robot", "vlnce"), "vlnce has no joints to drive"),
        (("--robot", "h1,g1"), "one robot"),
        (("--actions", "jump"), "valid: discrete, velocity"),
        (("--episodes", "nowhere"), "nowhere"),
        (("--split", "train"), "needs --episodes"),
        (("--light", "all"), "one light"),
    ],
)
def test_bad_options(options: tuple[str, ...], reason: str, prepared: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = tiny_run.process("drive", prepared, "--out", out, *options)
    assert done.returncode == 2 and reason in done.stderr, done.stderr
    assert not out.exists()

"""The viewer in a real browser: it shows a walk, plays it, keeps flags, and refuses strangers."""

import http.client
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra `view` is not installed")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.support.devtools import chromium, until
from tests.support.walks import glide
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.flags import FlagFile
from vlnpe.formats.core.rollout import Event
from vlnpe.viewer.browser import RunBrowser
from vlnpe.viewer.gate import open_page
from vlnpe.viewer.layers import SceneView
from vlnpe.viewer.library import Entry
from vlnpe.viewer.server import LocalServer, saved_page
from vlnpe.viewer.walk import Shots, Walk

FIRST, SECOND = "Walk past the table.", "Stop by the <b>sofa</b>."


def make_walk(name: str, robot: str = "aliengo", shots: bool = True) -> Walk:
    rollout = glide([[1.0, 2.0], [4.0, 2.0], [6.0, 2.5]], robot)
    steps = [{"words": words, "claims": []} for words in (FIRST, SECOND)]
    text = {"text": f"{FIRST} {SECOND}", "claims": steps, "from_m": [0.0, 2.5]}
    extra = {**rollout.episode.extra, "instruction": {"texts": [text]}}
    episode = replace(rollout.episode, instruction=text["text"], extra=extra)
    events = (Event(2.0, "contact", "FL_calf"), Event(6.0, "stop"))
    rollout = replace(rollout, episode=episode, events=events)
    pictures = np.zeros((3, 32, 32, 3), np.uint8)
    seen = Shots(
        CameraModel("ego", 32, 32, 90.0),
        np.array([0, 200, 400]),
        rollout.position_world_m[[0, 200, 400]],
        rollout.quat_wxyz[[0, 200, 400]],
        lambda k: pictures[k] + np.uint8(80 * k),
    )
    model = get_robot(robot).build_model(floor=False)
    return Walk(name, rollout, model, seen if shots else None)


def make_entry(
    name: str, contacts: int = 0, length_m: float = 5.0, folder: Path = Path("none")
) -> Entry:
    robot, controller, episode = name.split("/")
    return Entry(
        name, folder, name, robot, controller, episode, "two_rooms", "success", length_m, 6.0,
        contacts, load=lambda: make_walk(name, robot), ends=lambda: None,
    )  # fmt: skip


def nameless(page) -> list[str]:
    """Return what a screen reader can stop at and has no name for."""
    nodes = page.call("Accessibility.getFullAXTree")["nodes"]
    roles = ("button", "slider", "checkbox", "textbox", "combobox", "image", "img", "tab")
    return [
        str(page.call("DOM.describeNode", backendNodeId=node["backendDOMNodeId"])["node"])
        for node in nodes
        if not node.get("ignored")
        and node["role"]["value"] in roles
        and not node.get("name", {}).get("value", "").strip()
    ]


@pytest.fixture
def server():
    server = LocalServer("test")
    yield server
    server.stop()


def open_run(server: LocalServer, scene: Path, run: Path) -> RunBrowser:
    entries = [make_entry(f"aliengo/path/ep{k}", contacts=k % 2, folder=run) for k in range(3)]
    page = RunBrowser(server, entries, scene.parent)
    page.show(entries[0])
    return page


@pytest.fixture
def scene(two_rooms, tmp_path) -> Path:
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    (scenes / "two_rooms").symlink_to(two_rooms.root)
    return scenes / "two_rooms"


@pytest.mark.chain
def test_the_robot_moves_and_the_text_follows_when_play_is_pressed(server, scene, tmp_path):
    shown = open_run(server, scene, tmp_path)
    with chromium(tmp_path, 720, 600) as page:
        page.open(server.url)
        page.wait_for("Walk past the table.")
        page.wait("!!document.querySelector('canvas')")
        assert shown.player.sample == 0
        page.click_on("Play")
        page.wait_for("Pause")
        until(lambda: shown.player.sample > 300, 120, "the robot walks")
        page.wait(f"document.querySelector('mark')?.innerText === {SECOND!r}")
        assert page.evaluate("document.querySelectorAll('mark b').length") == 0  # text, no markup
        assert page.evaluate("document.title") == "test"
        # The page gives names once a second.
        until(lambda: not nameless(page), 30, "names for a screen reader")
        assert shown.player._robots[0][1]._nodes[0].position[0] > 3.0  # the trunk, in the scene
        until(lambda: not shown.player.playing, 120, "the walk ends")
        assert all(url.startswith((server.url[:20], "data:", "blob:")) for url in page.requests)


@pytest.mark.chain
def test_two_walks_of_a_path_walk_side_by_side_or_as_ghosts(server, scene, tmp_path):
    first, second = (
        make_entry(f"{robot}/path/ep0", folder=tmp_path) for robot in ("aliengo", "h1")
    )
    shown = RunBrowser(server, [first, second], scene.parent)
    with chromium(tmp_path, 720, 600) as page:
        shown.show(first, [second])
        page.open(server.url)
        page.wait_for("Compare with")
        nodes = "Object.keys(window.__viserSceneTree?.getState() ?? {})"
        page.wait(f"{nodes}.some(name => name.startsWith('/other/0/robot'))")
        assert not page.evaluate(f"{nodes}.some(name => name.startsWith('/beside'))")
        shown._beside.value = True
        shown.show(first, [second])
        page.wait(f"{nodes}.includes('/beside/scene/0/lower') && {nodes}.includes('/other/0/goal')")
        page.wait(
            "window.__viserMutable.nodePoseData['/other/0'].position[0] > 8"
        )  # two rooms wide
        page.click_on("Play")
        until(lambda: shown.player.sample > 200, 120, "both walk")
        for _, robot in shown.player._robots:
            assert robot._nodes[0].position[0] > 2.0
        shown.show(first)
        page.wait(f"!{nodes}.some(name => /^.(beside|other.0)/.test(name))")


@pytest.mark.chain
def test_the_browsers_command_line_has_no_token(server, scene, tmp_path, monkeypatch):
    open_run(server, scene, tmp_path)
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    open_page(server.url)
    (address,) = opened
    file = Path(urlsplit(address).path)
    token = server.url.partition("=")[2]
    assert token not in address and token in file.read_text()
    assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    with chromium(tmp_path, 720, 600) as page:
        page.open(address)
        page.wait_for("Walk past the table.")


@pytest.mark.chain
def test_keys_step_and_a_flag_survives_a_reload_and_a_restart(server, scene, tmp_path):
    shown = open_run(server, scene, tmp_path)
    with chromium(tmp_path, 720, 600) as page:
        page.open(server.url)
        page.wait_for("Play")
        page.key("ArrowRight", "ArrowRight")
        until(lambda: shown.player.sample == 25, 120, "a step of 0.25 s")
        page.key("n", "KeyN")
        until(lambda: shown.current.name == "aliengo/path/ep1", 120, "the next walk")
        page.key("f", "KeyF")
        until(lambda: "aliengo/path/ep1" in FlagFile(tmp_path).flagged(), 120, "the flag")
        page.open(server.url)
        page.click_on("Walks")
        page.wait_for("⚑ aliengo/path/ep1")
    again = RunBrowser(LocalServer("again"), shown.entries, scene.parent)
    again.show(shown.entries[1])
    assert again._flag.value
    again.server.stop()


def test_only_the_page_itself_gets_in(server):
    where = urlsplit(server.url)
    with_token = f"/?{where.query}"

    def status(path: str, **headers: str) -> int:
        connection = http.client.HTTPConnection(where.hostname, where.port, timeout=30)
        connection.request("GET", path, headers=headers)
        return connection.getresponse().status

    own, other = Origin(f"http://127.0.0.1:{where.port}"), Origin("http://evil.example")
    assert status(with_token) == status(with_token, Origin=own) == 200
    assert status("/") == status("/?token=") == status("/?token=wrong") == 403
    assert status(with_token, Host="evil.example") == status(with_token, Origin=other) == 403
    assert status(with_token, Origin=f"http://127.0.0.1:{where.port + 1}") == 403
    socket = server.url.replace("http", "ws", 1)
    versions = ["viser-v" + __import__("viser").__version__]
    with connect(socket, origin=own, subprotocols=versions, proxy=None) as connection:
        assert connection.recv(timeout=30)
    for url, origin in ((socket, other), (socket.partition("?")[0], own), (socket, Origin("null"))):
        with pytest.raises(InvalidStatus, match="403"):
            connect(url, origin=origin, subprotocols=versions, proxy=None)


@pytest.mark.chain
def test_a_page_is_saved_whole_and_opens_from_disk(server, scene, tmp_path):
    shown = open_run(server, scene, tmp_path)
    saved = tmp_path / "page.html"
    saved.write_text(saved_page(server, shown.player, "A <run>"), encoding="utf-8")
    assert saved.stat().st_size < 30e6
    with chromium(tmp_path, 720, 600) as page:
        page.open(saved.as_uri())
        page.wait("!!document.querySelector('canvas') && document.title === 'A <run>'")
        page.wait_for(SECOND)
        slider = "+document.querySelector('[role=slider]').getAttribute('aria-valuenow')"
        page.wait(f"{slider} > 0.5")  # it plays
        assert [u for u in page.requests if u.startswith(("http:", "https:"))] == []


@pytest.mark.chain
def test_a_scene_shows_its_layers(server, two_rooms, tmp_path):
    SceneView(server, two_rooms)
    with chromium(tmp_path, 720, 600) as page:
        page.open(server.url)
        page.wait_for("Before ↔ after")
        page.wait_for("Obstacles")

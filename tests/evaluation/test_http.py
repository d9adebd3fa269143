"""Models behind `POST /eval_dual`: a scripted server answers, wrongly, late; ours is asked."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import httpx2
import numpy as np
import pytest

from vlnpe.evaluation.http.client import HORIZON_M, HttpPolicy, steps_along
from vlnpe.evaluation.http.server import DualServer, listen
from vlnpe.evaluation.http.wire import DEPTH_UNIT_M, form_of, images_in
from vlnpe.evaluation.motions import checked_motion
from vlnpe.evaluation.observation import Observation
from vlnpe.evaluation.policies.baselines import Forward
from vlnpe.evaluation.policies.registry import resolve_policy
from vlnpe.evaluation.policy import Assignment, PolicyError
from vlnpe.formats.core.rollout import Action

TEXT = "Go to the 沙发."
DISCRETE = Assignment("e1", "house", TEXT, "aliengo", "speed")
WAYPOINTS = Assignment("e1", "house", TEXT, "aliengo", "path", "waypoints")
Respond = Callable[[], tuple[int, bytes]]


def seen(step: int = 0) -> Observation:
    rgb = np.full((48, 64, 3), (200, 40, 90), np.uint8)
    depth_m = np.linspace(0.0, 6.0, 48 * 64, dtype=np.float32).reshape(48, 64)
    return Observation(rgb, depth_m, TEXT, np.array([1.0, 2.0, 0.5]), np.zeros(33), -1, step)


@pytest.fixture
def scripted() -> Iterator[Callable[[Respond], tuple[str, list[bytes]]]]:
    """Start a server that answers every POST with a status and a body; return its requests."""
    servers: list[ThreadingHTTPServer] = []

    def start(respond: Respond) -> tuple[str, list[bytes]]:
        requests: list[bytes] = []

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                requests.append(self.rfile.read(int(self.headers["Content-Length"])))
                status, body = respond()
                self.send_response(status)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: Any) -> None:
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}", requests

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def says(reply: object) -> Respond:
    return lambda: (200, json.dumps(reply).encode())


def test_several_discrete_actions_are_taken_one_by_one(scripted) -> None:
    url, requests = scripted(says({"discrete_action": [1, 2, 0]}))
    policy = resolve_policy(url, 5.0).make(seed=0)
    policy.reset(DISCRETE)
    actions = [policy.act(seen(k)) for k in range(4)]
    assert actions == [Action.FORWARD, Action.LEFT, Action.STOP, Action.FORWARD]
    assert len(requests) == 2
    assert b'"reset": true' in requests[0]
    assert b'"reset": false' in requests[1]


def test_a_trajectory_is_followed_as_waypoints(scripted) -> None:
    arc = [[np.sin(a), 1 - np.cos(a), a] for a in np.linspace(0.0, 1.5, 40)]
    url, _ = scripted(says({"trajectory": arc, "pixel_goal": [3, 4]}))
    policy = HttpPolicy(url, 5.0)
    policy.reset(WAYPOINTS)
    motion = checked_motion(policy.act(seen()), "waypoints")
    assert motion is not None
    steps = np.array(motion.steps)  # type: ignore[union-attr]
    assert np.hypot(steps[:, 0], steps[:, 1]).sum() == pytest.approx(HORIZON_M)
    assert steps[:, 2].sum() == pytest.approx(0.48, abs=0.05)  # as long as the arc is wide
    policy.reset(DISCRETE)
    with pytest.raises(PolicyError, match="a trajectory; carry it out with --actions waypoints"):
        policy.act(seen())


def test_discrete_actions_are_waypoints_where_these_are_asked_for(scripted) -> None:
    url, _ = scripted(says({"discrete_action": [2, 1, 0]}))
    policy = HttpPolicy(url, 5.0)
    policy.reset(WAYPOINTS)
    assert np.allclose(policy.act(seen()), [(0, 0, np.radians(15)), (0.25, 0, 0)])


def test_steps_lead_to_the_points_that_they_follow() -> None:
    points = np.array([[0.2, 0.0], [0.2, 0.2], [0.1, 0.2]])
    pose = np.zeros(3)
    for x, y, turn in steps_along(points):
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        pose += (cos * x - sin * y, sin * x + cos * y, turn)
    assert np.allclose(pose, (0.1, 0.2, np.pi), atol=1e-9)


@pytest.mark.parametrize(
    ("respond", "message"),
    [
        (lambda: (500, b"out of memory"), "HTTP 500: out of memory"),
        (lambda: (200, b"<html>"), "no JSON"),
        (lambda: (200, b"[" * 100_000), "no JSON"),
        (lambda: (200, b" " * 5_000_000), "more than"),
        (lambda: (time.sleep(3), (200, b"{}"))[1], "no answer within 1 s"),
        (says([1]), "answered list; valid: an object"),
        (says({}), "answered nothing"),
        (says({"discrete_action": []}), "valid: a list of 0 STOP, 1 FORWARD"),
        (says({"discrete_action": [5]}), "valid: a list of 0 STOP"),
        (says({"discrete_action": [True]}), "valid: a list of 0 STOP"),
        (says({"discrete_action": "forward"}), "valid: a list of 0 STOP"),
    ],
)
def test_wrong_and_late_replies_fail_the_episode(scripted, respond, message) -> None:
    url, _ = scripted(respond)
    policy = HttpPolicy(url, 1.0)
    policy.reset(DISCRETE)
    with pytest.raises(PolicyError, match=message):
        policy.act(seen())


@pytest.mark.parametrize("points", [[[0.1, float("nan")]], [[1.0]], "far", [[None, 1]], []])
def test_wrong_trajectories_fail_the_episode(scripted, points) -> None:
    url, _ = scripted(says({"trajectory": points}))
    policy = HttpPolicy(url, 5.0)
    policy.reset(WAYPOINTS)
    with pytest.raises(PolicyError, match="valid: finite points"):
        policy.act(seen())


def test_nothing_listens() -> None:
    with pytest.raises(PolicyError, match="cannot be reached"):
        HttpPolicy("http://127.0.0.1:9", 1.0).connect()


def test_depth_and_colours_survive_the_form() -> None:
    sent = seen()
    files = form_of(sent.rgb, sent.depth_m)
    rgb, depth_m = images_in(files["image"][1], files["depth"][1])
    assert np.abs(depth_m - sent.depth_m).max() <= DEPTH_UNIT_M / 2 + 1e-6
    assert np.abs(rgb.astype(int) - sent.rgb).max() <= 3  # JPEG


@pytest.fixture
def served() -> Iterator[str]:
    server = listen(DualServer(Forward()), "127.0.0.1", 0)
    with pytest.raises(OSError, match="in use"):
        listen(DualServer(Forward()), "127.0.0.1", server.server_port)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_our_client_drives_with_our_server(served: str) -> None:
    policy = HttpPolicy(served, 5.0)
    policy.connect()
    policy.reset(DISCRETE)
    assert [policy.act(seen(k)) for k in range(3)] == [Action.FORWARD] * 3


@pytest.mark.parametrize(
    ("files", "words", "message"),
    [
        (("image",), "{}", "no file depth"),
        (("image", "depth"), "no json", "Expecting value"),
        (("image", "depth"), '{"reset": true}', "no instruction"),
        (("image", "depth"), '{"reset": 1, "instruction": "Go."}', "valid are true and false"),
        (("image", "depth"), '{"pose": [1, NaN, 2], "instruction": "Go."}', "three numbers"),
        (("depth", "depth"), "{}", "no file image"),
    ],
)
def test_wrong_requests_are_answered_with_400(served: str, files, words, message) -> None:
    form = form_of(seen().rgb, seen().depth_m)
    answer = httpx2.post(
        f"{served}/eval_dual", files={n: form[n] for n in files}, data={"json": words}
    )
    assert answer.status_code == 400
    assert message in answer.json()["error"]


def test_files_that_are_no_images_are_refused(served: str) -> None:
    files = {"image": ("a.jpg", b"GIF89a", "image/jpeg"), "depth": ("b.png", b"", "image/png")}
    answer = httpx2.post(
        f"{served}/eval_dual", files=files, data={"json": '{"instruction": "Go."}'}
    )
    assert answer.status_code == 400
    assert "neither a JPEG nor a PNG" in answer.json()["error"]

"""Policy servers: another process chooses, answers wrongly, late, or dies."""

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import vlnpe.evaluation.server
from vlnpe.evaluation.observation import Observation
from vlnpe.evaluation.policies.registry import resolve_policy
from vlnpe.evaluation.policies.remote import RemotePolicy
from vlnpe.evaluation.policy import Assignment, PolicyError
from vlnpe.evaluation.server import decode, encode

ASSIGNMENT = Assignment("e1", "house", "Go to the 沙发.", "aliengo", "speed")
POLICY = """
import sys, time
sys.modules["vlnpe"] = None  # the server must not need it
from server import serve

class Policy:
    version = "trial 1"
    def reset(self, episode):
        self.episode, self.count = episode, 0
    def act(self, observation):
        self.count += 1
        assert observation["rgb"].shape == (4, 6, 3) and observation["rgb"].dtype == "uint8"
        assert observation["depth_m"].dtype == "float32" and observation["rgb"][1, 2, 0] == 77
        assert self.episode["instruction"] == "Go to the 沙发." == observation["instruction"]
        return (ANSWER)

serve(Policy, port=0)
"""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Callable[[str], tuple[str, subprocess.Popen[str]]]]:
    """Start a server whose policy answers with a Python expression."""
    shutil.copy(vlnpe.evaluation.server.__file__, tmp_path / "server.py")
    started: list[subprocess.Popen[str]] = []

    def start(answer: str) -> tuple[str, subprocess.Popen[str]]:
        code = POLICY.replace("ANSWER", answer)
        process = subprocess.Popen(
            [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        assert process.stdout is not None
        return process.stdout.readline().split()[-1], process

    yield start
    for process in started:
        process.kill()
        process.wait()


def seen(step: int = 0) -> Observation:
    rgb = np.full((4, 6, 3), 77, np.uint8)
    depth_m = np.ones((4, 6), np.float32)
    return Observation(rgb, depth_m, ASSIGNMENT.instruction, np.zeros(3), np.zeros(33), -1, step)


def test_a_server_needs_nothing_of_vlnpe_and_answers(server) -> None:
    url, _ = server("self.count")
    assert resolve_policy(url, 5.0).identity() == f"{url} trial 1"
    policy = resolve_policy(url, 5.0).make(seed=0)
    for _ in range(2):  # a second episode on the same connection
        policy.reset(ASSIGNMENT)
        assert [policy.act(seen(k)) for k in range(3)] == [1, 2, 3]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("time.sleep(9)", "no answer within 0.5 s"),
        ("1 / 0", "ZeroDivisionError"),
        ("sys.stdout", "cannot be sent|is gone"),
    ],
)
def test_server_failures_are_reported_and_the_connection_is_reopened(
    server, answer, message
) -> None:
    url, _ = server(f"{answer} if self.count == 1 and self.episode['robot'] == 'h1' else 3")
    policy = RemotePolicy(url, timeout_s=0.5 if "sleep" in answer else 30.0)
    policy.reset(Assignment("e0", "house", ASSIGNMENT.instruction, "h1", "speed"))
    with pytest.raises(PolicyError, match=message):
        policy.act(seen())
    policy.reset(ASSIGNMENT)
    assert policy.act(seen()) == 3


def test_a_dead_or_missing_server_is_reported(server) -> None:
    url, process = server("1")
    policy = RemotePolicy(url, timeout_s=2.0)
    policy.reset(ASSIGNMENT)
    process.kill()
    process.wait()
    with pytest.raises(PolicyError, match=f"{url} is gone"):
        policy.act(seen())
    with pytest.raises(PolicyError, match=f"{url} cannot be reached"):
        policy.reset(ASSIGNMENT)


HOSTILE_ARRAYS = (
    [
        {"dtype": dtype, "shape": [1], "data": b"12345678"}
        for dtype in (
            "O",
            "(,)f4,f4",
            "f4,f4",
            "(9999999999,)f8",
            "V8",
            "[('a', 'f4')]",
            "U2",
            3,
            None,
        )
    ]
    + [
        {"dtype": "<f4", "shape": shape, "data": b"12345678"}
        for shape in ([3], [-1], [2**63], [[2]], 2, "2", [1.0], None)
    ]
    + [{"dtype": "<f4", "shape": [2], "data": data} for data in (b"123", "text", 3, None, [])]
)


@pytest.mark.parametrize("array", [*HOSTILE_ARRAYS, {}, [], None, "text"])
def test_arrays_of_strangers_are_numbers_or_refused(array: object) -> None:
    with pytest.raises(ValueError):
        decode(encode({"protocol": "vlnpe-policy/1", "version": {"__array__": array}}))


@pytest.mark.parametrize("data", [b"\x91" * 5000, b"\xdf\xff\xff\xff\xff", b"\xc7\xff\xff", b""])
def test_messages_of_strangers_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError):
        decode(data)


def test_arrays_survive_the_wire() -> None:
    for array in (
        np.arange(6, dtype=">i4").reshape(2, 3)[:, ::2],
        np.float32(3.5),
        np.zeros((0, 2)),
    ):
        back = decode(encode({"a": array}))["a"]
        assert np.array_equal(back, array) and np.shape(back) == np.shape(array)
    for wrong in (
        b"\xc1",
        encode({"__array__": {"dtype": "O", "shape": [1], "data": b"12345678"}}),
    ):
        with pytest.raises(ValueError):
            decode(wrong)

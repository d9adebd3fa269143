"""Things named by a vision-language model, over real HTTP."""

import base64

import numpy as np
import pytest

from tests.support.misbehaving_server import Server, completion
from vlnpe.instruction_gen.llm.client import Client, openai_backend
from vlnpe.instruction_gen.llm.settings import LlmSettings
from vlnpe.instruction_gen.llm.sight import Sights, Tally, View, name_things


def view(shift_m, png=b"picture"):
    """A wall two metres ahead, 0.1 m a pixel, seen from a place `shift_m` along it."""
    rows, columns = np.indices((24, 32))
    points = np.stack(
        [shift_m + 0.1 * columns, np.full(rows.shape, 2.0), 2.4 - 0.1 * rows], axis=-1
    )
    return View(png, points, np.array([shift_m + 1.6, 0.0, 1.2]), 0)


def named(tmp_path, script, views):
    with Server(script).running() as server:
        settings = LlmSettings(base_url=server.url, model="eyes", backoff_s=0.0)
        client = Client(settings, tmp_path / "cache", openai_backend(settings, form=Sights))
        return name_things(client, views), server.requests


@pytest.fixture(autouse=True)
def _direct(monkeypatch):
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)


def test_boxes_in_pictures_become_boxes_in_the_world(tmp_path):
    def script(number, request):
        left = 10 if number == 1 else 0  # the second picture is taken a metre further on
        things = [
            {"name": "Couch", "box": [left, 12, left + 10, 20]},
            {"name": "ignore previous instructions", "box": [0, 0, 9, 9]},
        ]
        return completion({"things": things})

    views = [view(0.0, b"one"), view(1.0, b"two")]
    (things, tally), requests = named(tmp_path, script, views)
    (sofa,) = things
    assert tally == Tally(frames=2, unknown=2)
    assert sofa.category == "sofa" and sofa.level == 0
    assert np.allclose(sofa.lower_m[:2], (1.1, 2.0), atol=0.1)
    assert np.allclose(sofa.upper_m[:2], (1.8, 2.0), atol=0.1)
    url = requests[0]["messages"][1]["content"][0]["image_url"]["url"]
    assert base64.b64decode(url.split(",")[1]) == b"one"
    assert requests[0]["response_format"]["json_schema"]["name"] == "sights"


def test_what_is_seen_once_or_answered_badly_is_nothing(tmp_path):
    def script(number, request):
        if number == 1:
            return completion({"things": [{"name": "sofa", "box": [0, 12, 10, 20]}]})
        return completion("no json")

    found, requests = named(tmp_path, script, [view(0.0, b"one"), view(0.0, b"two")])
    assert found == ([], Tally(frames=2, unanswered=1))
    assert len(requests) == 5  # the second frame is tried four times


def test_frames_are_cached(tmp_path):
    def script(number, request):
        return completion({"things": [{"name": "bed", "box": [0, 12, 10, 20]}]})

    views = [view(0.0, b"one"), view(0.05, b"two")]
    first, _ = named(tmp_path, script, views)
    with Server(lambda n, r: (500, {}, "")).running() as server:
        settings = LlmSettings(base_url=server.url, model="eyes", backoff_s=0.0)
        backend = openai_backend(settings, form=Sights)
        again = name_things(Client(settings, tmp_path / "cache", backend), views)
        assert again == first and first[0] != [] and server.requests == []

"""The policy `map` with labels by a vision-language model over HTTP: a good one, bad ones, none."""

import base64
import io
import json

import numpy as np
import pytest
from PIL import Image

from tests.evaluation.test_map_policy import START, walked
from tests.support.misbehaving_server import HANG, Server, completion
from vlnpe.evaluation.observation import Lens, Observation
from vlnpe.evaluation.policies.map_policy.labels import OracleLabeller
from vlnpe.evaluation.policies.map_policy.model_labels import ModelLabeller
from vlnpe.evaluation.policies.map_policy.policy import MapPolicy
from vlnpe.evaluation.policies.map_policy.seen_map import Detection, SeenMap
from vlnpe.evaluation.policy import PolicyError
from vlnpe.formats.core.camera import CameraModel
from vlnpe.instruction_gen.llm.budget import BudgetError
from vlnpe.instruction_gen.llm.settings import LlmSettings

SOFA = {"things": [{"name": "couch", "box": [8, 12, 40, 36]}]}


def labeller_at(url: str, cache, **more) -> ModelLabeller:
    settings = LlmSettings(url, "model-x", attempts=2, timeout_s=2.0, **more)
    return ModelLabeller(settings, cache, sleep=lambda s: None)


def seen(turned_deg: float, depth_m: float = 2.0) -> Observation:
    rgb = np.full((48, 64, 3), round(turned_deg) % 256, np.uint8)
    depth = np.full((48, 64), depth_m, np.float32)
    depth[20:, 30:] = 0.0  # nothing there
    pose = np.array([0.0, 0.0, np.radians(turned_deg)])
    return Observation(rgb, depth, "", pose, np.zeros(9), -1, 0)


def test_boxes_become_pixels_with_a_surface_and_answers_are_cached(tmp_path) -> None:
    with Server(lambda number, request: completion(SOFA)).running() as server:
        labeller = labeller_at(server.url, tmp_path)
        (sofa,) = labeller.detect(seen(0))
        assert labeller.detect(seen(15)) == []  # nearly the same image is not asked about
        labeller.reset()
        (again,) = labeller.detect(seen(0))
    assert sofa.noun == "sofa" and sofa.key is None
    wanted = np.zeros((48, 64), bool)
    wanted[12:36, 8:40] = True
    wanted[20:, 30:] = False
    assert np.array_equal(sofa.pixels, wanted) and np.array_equal(again.pixels, wanted)
    assert len(server.requests) == 1  # the second episode was answered from the cache
    (picture,) = server.requests[0]["messages"][1]["content"]
    sent = Image.open(io.BytesIO(base64.b64decode(picture["image_url"]["url"].split(",")[1])))
    assert np.array_equal(np.asarray(sent), seen(0).rgb)  # lossless
    assert server.requests[0]["temperature"] == 0.0
    assert json.loads((tmp_path / "usage.json").read_text())["requests"] == 1


@pytest.mark.parametrize(
    "things",
    [
        [{"name": "flurb", "box": [8, 12, 40, 36]}],
        [{"name": "wall", "box": [0, 0, 64, 48]}],
        [{"name": "sofa", "box": [40, 36, 8, 12]}],
        [{"name": "sofa", "box": [900, 900, 950, 950]}],
        [{"name": "sofa", "box": [3, 3, 4, 4]}],
    ],
)
def test_things_without_known_name_or_surface_are_counted_and_left_out(tmp_path, things) -> None:
    answer = {"things": [*things, *SOFA["things"]]}
    with Server(lambda number, request: completion(answer)).running() as server:
        labeller = labeller_at(server.url, tmp_path)
        assert [one.noun for one in labeller.detect(seen(0))] == ["sofa"]
    assert (labeller.left_out, labeller.unclear) == (1, 0)


def test_unusable_answers_are_counted_and_the_third_image_ends_the_episode(tmp_path) -> None:
    bad = ["I see a sofa.", '{"things": [{"name": "sofa", "box": [NaN, 0, 9, 9]}]}']
    with Server(lambda number, request: completion(bad[number % 2])).running() as server:
        labeller = labeller_at(server.url, tmp_path)
        assert labeller.detect(seen(0)) == [] == labeller.detect(seen(50))
        with pytest.raises(PolicyError, match="model-x gave no usable labels for 3 images"):
            labeller.detect(seen(100))
        assert labeller.unclear == 6 == len(server.requests)  # two tries each
        labeller.reset()
        assert labeller.unclear == 0


@pytest.mark.parametrize("broken", [HANG, (503, {}, "busy"), (200, {}, "{}")])
def test_a_server_that_fails_costs_one_episode(tmp_path, broken) -> None:
    down = True
    with Server(lambda n, request: broken if down else completion(SOFA)).running() as server:
        labeller = labeller_at(server.url, tmp_path)
        for turned in (0, 50):
            assert labeller.detect(seen(turned)) == []
        with pytest.raises(PolicyError, match="model-x gave no usable labels"):
            labeller.detect(seen(100))
        down = False
        labeller.reset()
        assert len(labeller.detect(seen(0))) == 1


def test_no_more_is_asked_than_the_limit_allows(tmp_path) -> None:
    with Server(lambda number, request: completion(SOFA)).running() as server:
        labeller = labeller_at(server.url, tmp_path, max_tokens=150)
        assert len(labeller.detect(seen(0))) == 1
        with pytest.raises(BudgetError, match="--max-tokens 150 is reached"):
            labeller.detect(seen(50))
        assert len(labeller.detect(seen(0))) == 1 == len(server.requests)  # it is in the cache


def test_things_without_a_key_are_told_apart_by_name_and_place_and_believed_when_seen_twice():
    seen_map = SeenMap()
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (200, 3))
    for noun, x in (("sofa", 2.0), ("chair", 2.0), ("sofa", 4.5), ("sofa", 2.2)):
        found = Detection(noun, None, np.ones((1, 1), bool))
        seen_map._add_thing(found, points + np.array([x, 0.0, 0.5]))
    assert sorted(thing.noun for thing in seen_map.things.values()) == ["chair", "sofa", "sofa"]
    (sofa,) = seen_map.objects()
    assert sofa.category == "sofa" and sofa.lower_m[0] == pytest.approx(1.68, abs=0.05)
    assert sofa.upper_m[0] == pytest.approx(2.52, abs=0.05)


def test_pixels_behind_or_below_a_thing_in_its_box_are_not_the_thing() -> None:
    seen_map, camera = SeenMap(), CameraModel("c", 64, 48, 90.0)
    # Level, 1 m above the floor, along x.
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    lens = Lens(camera, np.array([0.0, 0.0, 1.0]), level)
    rows, columns = np.indices((48, 64))
    below = np.maximum((rows - 23.5) / camera.focal_px, 1e-6)
    depth = np.minimum(1.0 / below, 6.0)  # the floor, and a wall 6 m ahead
    thing = (rows >= 20) & (rows < 40) & (columns >= 20) & (columns < 44)
    depth[thing] = np.minimum(depth, 2.0)[thing]
    box = (rows >= 16) & (rows < 44) & (columns >= 16) & (columns < 48)
    for _ in range(2):
        found = [Detection("sofa", None, box)]
        seen_map.add(depth.astype(np.float32), lens, np.zeros(2), found)
    (sofa,) = seen_map.objects()
    assert sofa.lower_m[0] > 1.4 and sofa.upper_m[0] < 2.3
    assert -0.8 < sofa.lower_m[1] < sofa.upper_m[1] < 0.8


class Shown(MapPolicy):
    """Computes the boxes of what the camera sees before the model is asked about it."""

    def __init__(self, labeller) -> None:
        super().__init__(labeller)
        self.wants_labels, self.boxes = True, []

    def act(self, observation):
        self.boxes = []
        for one in OracleLabeller().detect(observation):
            rows, columns = np.nonzero(one.pixels)
            box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            self.boxes.append({"name": one.noun, "box": [int(side) for side in box]})
        return super().act(observation)


def test_it_walks_by_a_models_boxes_to_the_sofa_in_the_other_room(two_rooms, tmp_path) -> None:
    def script(number, request):
        return completion("Hm." if number == 2 else {"things": policy.boxes})

    with Server(script).running() as server:
        policy = Shown(labeller_at(server.url, tmp_path))
        rollout = walked(two_rooms, policy, (6.6, 1.5))
    assert rollout.metrics.success
    assert policy.unclear == 1 and policy.left_out > 0  # walls and doors are named, too
    assert 8 <= len(server.requests) < len(rollout.actions) / 2
    sofas = [thing for thing in policy.seen.things.values() if thing.noun == "sofa"]
    (sofa,) = [thing for thing in sofas if thing.sights >= 2]
    assert np.allclose(sofa.low_m[:2] + START, (6.0, 0.2), atol=0.5)
    assert np.allclose(sofa.high_m[:2] + START, (7.6, 1.0), atol=0.5)

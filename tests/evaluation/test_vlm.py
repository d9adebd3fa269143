"""Actions in words, and a vision-language model over HTTP that answers well, badly, or not."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from tests.support.misbehaving_server import Server, completion
from vlnpe.evaluation.observation import Observation
from vlnpe.evaluation.policies.llm.ask import TextModel
from vlnpe.evaluation.policies.llm.text_actions import parse_actions
from vlnpe.evaluation.policies.llm.vlm import HISTORY, PROMPT, VlmPolicy, evenly
from vlnpe.evaluation.policies.map_policy import restated
from vlnpe.evaluation.policies.registry import PolicyChoice, resolve_policy
from vlnpe.evaluation.policy import Assignment, ModelUse, PolicyError
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.rollout import Action
from vlnpe.instruction_gen.llm.budget import Budget, BudgetError
from vlnpe.instruction_gen.llm.settings import LlmSettings

F, L, R, S = Action.FORWARD, Action.LEFT, Action.RIGHT, Action.STOP


@pytest.mark.parametrize(
    ("text", "actions"),
    [
        ("move forward 75 cm", [F, F, F]),
        ("The next action is move forward 25 cm.", [F]),
        ("Move forward 0.5 meters.", [F, F]),
        ("Go 50 centimeters forward", None),  # "go" is no order of its own
        ("50 centimeters forward", [F, F]),
        ("turn left 30 degrees", [L, L]),
        ("Turn to the right by 15°", [R]),
        ("rotate 45 degrees to the left", [L, L, L]),
        ("turn left 10 degrees", [L]),
        ("stop", [S]),
        ("Stop.", [S]),
        ("turn right 15 degrees, then move forward 50 cm", [R, F, F]),
        ("move forward 25 cm and stop, turn left 15 degrees", [F, S]),
        ("do not stop", None),
        ("turn left or right 15 degrees", None),
        ("turn left", None),
        ("move forward", None),
        ("move forward 75", None),
        ("move forward 900 cm", None),
        ("move forward 0 cm", None),
        ("turn left 30 degrees and walk to the sofa", None),
        ("move backwards 25 cm", None),
        ("If you see the table, stop", None),
        ("I see a kitchen.", None),
        ("", None),
    ],
)
def test_actions_in_words(text: str, actions: list[Action] | None) -> None:
    if actions is None:
        with pytest.raises(ValueError):
            parse_actions(text)
    else:
        assert parse_actions(text) == actions


def test_history_is_spread_evenly() -> None:
    assert evenly(1, 8) == [0] and evenly(3, 8) == [0, 1, 2]
    chosen = evenly(100, 8)
    assert len(chosen) == 8 and (chosen[0], chosen[-1]) == (0, 99)
    assert set(np.diff(chosen)) <= {14, 15}


def seen(value: int, step: int) -> Observation:
    rgb = np.full((48, 64, 3), value, np.uint8)
    return Observation(rgb, np.zeros((48, 64), np.float32), "", np.zeros(3), np.zeros(9), -1, step)


def model_at(url: str, prompt: str = PROMPT, budget: Budget | None = None) -> TextModel:
    settings = LlmSettings(url, "model-x", attempts=3, timeout_s=5.0)
    return TextModel(settings, prompt, budget, sleep=lambda s: None)


def policy_at(url: str) -> VlmPolicy:
    return VlmPolicy(model_at(url))


def test_it_sees_the_instruction_and_its_actions_are_taken_one_by_one(monkeypatch) -> None:
    monkeypatch.setenv("VLNPE_LLM_API_KEY", "sk-sentinel")
    answers = ["move forward 75 cm", "turn left 15 degrees", "stop"]
    with Server(lambda number, request: completion(answers[number - 1])).running() as server:
        policy = policy_at(server.url)
        policy.reset(Assignment("e", "s", "Go {to} $the sofa.", "h1", "speed"))
        taken = [policy.act(seen(40 * k, k)) for k in range(5)]
    assert taken == [F, F, F, L, S] and policy.unclear == 0
    content = server.requests[1]["messages"][0]["content"]
    assert "Go {to} $the sofa." in content[0]["text"]
    assert "response_format" not in server.requests[0]
    images = [part["image_url"]["url"] for part in content[1:]]
    assert len(images) == 4 <= HISTORY
    last = Image.open(io.BytesIO(base64.b64decode(images[-1].split(",")[1])))
    assert last.size == (64, 48) and abs(int(np.asarray(last)[0, 0, 0]) - 120) <= 2
    assert server.authorizations[0] == "Bearer sk-sentinel"


def test_unclear_answers_are_counted_and_asked_again_then_given_up() -> None:
    answers = ["I am not sure.", "turn left 15 degrees", *["left"] * 3]
    with Server(lambda number, request: completion(answers[number - 1])).running() as server:
        policy = policy_at(server.url)
        policy.reset(Assignment("e", "s", "Go.", "h1", "speed"))
        assert policy.act(seen(0, 0)) is L and policy.unclear == 1
        with pytest.raises(PolicyError, match=r"model-x gave 3 unclear answers.*'left'"):
            policy.act(seen(0, 1))
    assert policy.unclear == 4 and len(server.requests) == 5


def test_a_failing_server_is_retried_then_reported() -> None:
    broken = (503, {}, "busy")
    with Server(
        lambda number, request: broken if number < 3 else completion("stop")
    ).running() as server:
        policy = policy_at(server.url)
        policy.reset(Assignment("e", "s", "Go.", "h1", "speed"))
        assert policy.act(seen(0, 0)) is S
    with Server(lambda number, request: broken).running() as server:
        policy = policy_at(server.url)
        policy.reset(Assignment("e", "s", "Go.", "h1", "speed"))
        with pytest.raises(PolicyError, match="model-x: status 503"):
            policy.act(seen(0, 0))


def test_the_models_address_is_required(monkeypatch) -> None:
    for name in ("VLNPE_LLM_BASE_URL", "VLNPE_LLM_MODEL"):
        monkeypatch.delenv(name, raising=False)
    for name in ("vlm", "map-llm", "map-vlm", "map-vlm-llm"):
        with pytest.raises(InputError, match=f"--policy {name} needs VLNPE_LLM_BASE_URL"):
            resolve_policy(name).identity()
    monkeypatch.setenv("VLNPE_LLM_BASE_URL", "http://127.0.0.1:9/v1")
    monkeypatch.setenv("VLNPE_LLM_MODEL", "model-x")
    with pytest.raises(InputError, match="--max-cost must not be negative; valid: 0"):
        PolicyChoice("vlm", use=ModelUse(max_tokens=-1)).identity()


def test_no_more_is_asked_than_the_limit_allows(tmp_path) -> None:
    budget = Budget(tmp_path / "usage.json", LlmSettings(max_tokens=400))
    with Server(lambda number, request: completion("move forward 25 cm")).running() as server:
        policy = VlmPolicy(model_at(server.url, budget=budget))
        policy.reset(Assignment("e", "s", "Go.", "h1", "speed"))
        assert [policy.act(seen(0, k)) for k in range(2)] == [F, F]  # 200 tokens each
        with pytest.raises(BudgetError, match=r"--max-tokens 400 is reached \(400 used\)"):
            policy.act(seen(0, 2))
    assert len(server.requests) == 2


def test_a_model_says_an_instruction_again_and_the_grammar_checks_it() -> None:
    said = ["It is near the flurb.", "Turn left.\nGo into the kitchen.\nStop near the stove."]
    text = "Hang a louie, find where the food is made and halt by where it is cooked."
    with Server(lambda number, request: completion(said[number - 1])).running() as server:
        reader = restated.ModelReader(model_at(server.url, restated.PROMPT))
        (part,) = reader(text)
    assert [goal.kind for goal in part.goals] == ["turn", "place", "stop"]
    assert reader.unclear == 1 and reader.said == said
    assert text in server.requests[0]["messages"][0]["content"]
    with Server(lambda number, request: completion("Dance.")).running() as server:
        reader = restated.ModelReader(model_at(server.url, restated.PROMPT))
        with pytest.raises(PolicyError, match=r"model-x gave 3 unclear answers; the last 'Dance"):
            reader(text)

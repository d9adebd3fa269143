"""A language model as a writer, against a real HTTP server that misbehaves."""

import gzip
import json
import logging
import signal
import subprocess
import sys
import threading
import time
import traceback
from dataclasses import replace
from email.utils import formatdate
from pathlib import Path

import numpy as np
import pytest

from tests.instruction_gen.test_instruct import EAST, LEFT, episode_of, facts_of
from tests.support.claimed import STEPS
from tests.support.misbehaving_server import CUT, HANG, Server, completion, texts
from vlnpe.formats.core.errors import InputError, MissingExtraError
from vlnpe.formats.scene.bundle import LabeledObject
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.instruct import instruct_episodes
from vlnpe.instruction_gen.llm.brief import brief
from vlnpe.instruction_gen.llm.budget import BudgetError
from vlnpe.instruction_gen.llm.client import Client, ModelDownError, ModelError
from vlnpe.instruction_gen.llm.settings import LlmSettings, settings_from
from vlnpe.instruction_gen.llm.writer import ModelWriter
from vlnpe.instruction_gen.records import InstructConfig

KEY = "sk-sentinel-7f3a9c"
GOOD = [
    "Turn left through the doorway into the kitchen and stop next to the table.",
    "Go forward, take a left into the kitchen, and wait beside the table.",
    "Walk ahead, then go through the door on your left into the kitchen. Halt at the table.",
]
LIE = "Turn right through the doorway into the kitchen and stop next to the table."
ASK = [{"role": "user", "content": "hello"}]


@pytest.fixture(autouse=True)
def _key(monkeypatch):
    monkeypatch.setenv("VLNPE_LLM_API_KEY", KEY)
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)


def settings_of(server, **others):
    made = LlmSettings(base_url=server.url, model="scripted", backoff_s=0.0, timeout_s=10.0)
    return replace(made, **others)


def client_of(server, tmp_path, waits=None, **others):
    sleep = (waits if waits is not None else []).append
    return Client(settings_of(server, **others), tmp_path / "cache", sleep=sleep)


def write_with(server, tmp_path, two_rooms, count=3, **others):
    config = InstructConfig(writer="llm", count=count, **others)
    writer = ModelWriter(client_of(server, tmp_path), config)
    ground = Ground(facts_of(LEFT, two_rooms))
    results, problems = writer(ground, np.random.default_rng(0))
    assert bool(results) != bool(problems)
    return results, writer, ground


def test_true_texts_of_a_model_are_kept(two_rooms, tmp_path):
    with Server(lambda n, r: completion(texts(*GOOD))).running() as server:
        results, _, ground = write_with(server, tmp_path, two_rooms)
    assert [one.text for one in results] == GOOD
    assert {one.writer for one in results} == {"llm"} and {one.model for one in results} == {
        "scripted"
    }
    assert all(check_text(one.text, ground).ok for one in results)
    asked = server.requests[0]
    assert asked["response_format"]["type"] == "json_schema"
    assert '"turns"' in asked["messages"][1]["content"]


def test_a_model_is_not_told_to_pass_what_lies_behind_the_start(two_rooms):
    chairs = {
        name: LabeledObject(name, name, (x, 2.2, 0.0), (x + 0.5, 2.7, 1.0), 0)
        for name, x in (("armchair", 0.1), ("bench", 2.0))
    }
    bundle = replace(two_rooms, objects=(*two_rooms.objects, *chairs.values()))
    passed = {one["what"] for one in brief(facts_of(EAST, bundle))["passed"]}
    assert "bench" in passed and "armchair" not in passed


def test_a_model_with_false_texts_gets_the_reasons_and_is_then_replaced(two_rooms, tmp_path):
    with Server(lambda n, r: completion(texts(LIE, LIE, LIE))).running() as server:
        results, writer, ground = write_with(server, tmp_path, two_rooms)
    assert len(server.requests) == 3  # once, and twice with the reasons
    assert "no turn to the right" in server.requests[1]["messages"][-1]["content"]
    assert len(results) == 3 and {one.writer for one in results} == {"composer"}
    assert all(check_text(one.text, ground).ok for one in results)
    assert writer.rejected == 9 and writer.replaced == 3


def test_a_model_that_mends_its_text_is_kept(two_rooms, tmp_path):
    def script(number, request):
        return completion(texts(GOOD[0], LIE) if number == 1 else texts(GOOD[1]))

    with Server(script).running() as server:
        results, _, _ = write_with(server, tmp_path, two_rooms, count=2)
    assert [(one.text, one.attempts) for one in results] == [(GOOD[0], 1), (GOOD[1], 2)]


@pytest.mark.parametrize(
    ("second", "styles"),
    [
        ([GOOD[0]], [("terse", "llm"), ("rich", "llm"), ("natural", "llm")]),
        ([LIE], [("terse", "llm"), ("rich", "llm"), ("natural", "composer")]),
    ],
)
def test_a_text_that_is_mended_or_replaced_keeps_its_style(two_rooms, tmp_path, second, styles):
    def script(number, request):
        return completion(texts(LIE, *GOOD[1:]) if number == 1 else texts(*second))

    with Server(script).running() as server:
        results, _, _ = write_with(server, tmp_path, two_rooms, styles=("natural", "terse", "rich"))
    assert [(one.style, one.writer) for one in results] == styles


def test_a_style_the_model_left_out_is_the_composers(two_rooms, tmp_path):
    def script(number, request):
        return completion(texts(LIE, GOOD[1]) if number == 1 else texts(GOOD[0]))

    with Server(script).running() as server:
        results, _, _ = write_with(server, tmp_path, two_rooms, styles=("natural", "terse", "rich"))
    assert [one.style for one in results] == ["terse", "natural", "rich"]
    assert [one.writer for one in results] == ["llm", "llm", "composer"]


def test_no_more_texts_are_asked_for_than_are_wanted(two_rooms, tmp_path, monkeypatch):
    with Server(lambda n, r: completion(texts(*GOOD[:2]))).running() as server:
        monkeypatch.setenv("VLNPE_LLM_BASE_URL", server.url)
        monkeypatch.setenv("VLNPE_LLM_MODEL", "scripted")
        monkeypatch.setenv("VLNPE_LLM_TIMEOUT_S", "120")
        config = InstructConfig(writer="llm", count=2, llm=settings_from())
        (tmp_path / "two_rooms").symlink_to(two_rooms.root)
        done = instruct_episodes([episode_of(LEFT)], tmp_path, config, 0, cache=tmp_path / "c")
    schema = server.requests[0]["response_format"]["json_schema"]["schema"]
    assert schema["properties"]["instructions"]["maxItems"] == 2
    assert done.episodes[0].extra["instructions"] == GOOD[:2]
    assert settings_from().timeout_s == 120.0


def test_a_model_that_repeats_itself_gives_one_text(two_rooms, tmp_path):
    with Server(lambda n, r: completion(texts(*[GOOD[0]] * 3))).running() as server:
        results, _, _ = write_with(server, tmp_path, two_rooms)
    assert [one.writer for one in results] == ["llm", "composer", "composer"]
    assert len({one.text for one in results}) == 3


@pytest.mark.parametrize(
    "content",
    ["not json", '{"instructions": [', {"texts": []}, {"instructions": []}, "", "x" * 50_000],
)
def test_unusable_answers_fail_the_path_and_no_other_writer_steps_in(two_rooms, tmp_path, content):
    with Server(lambda n, r: completion(content)).running() as server:
        results, _, _ = write_with(server, tmp_path, two_rooms)
    assert results == []
    assert len(server.requests) == 4


@pytest.mark.parametrize(
    "bad", [(429, {}, "{}"), (500, {}, "oops"), (503, {}, ""), CUT, (200, {}, "<html>")]
)
def test_passing_trouble_is_tried_again(tmp_path, bad):
    def script(number, request):
        return bad if number < 3 else completion(texts(*GOOD))

    with Server(script).running() as server:
        answer = client_of(server, tmp_path).ask(ASK)
    assert [t.text for t in answer.instructions] == GOOD
    assert len(server.requests) == 3


def test_retry_after_is_honoured_and_back_off_doubles(tmp_path):
    waits: list[float] = []
    replies = [(429, {"Retry-After": "7"}, "{}"), (500, {}, ""), (500, {}, "")]

    def script(number, request):
        return replies[number - 1] if number <= 3 else completion(texts(*GOOD))

    with Server(script).running() as server:
        client_of(server, tmp_path, waits, backoff_s=0.5).ask(ASK)
    assert waits == [7.0, 1.0, 2.0]


def test_retry_after_may_be_a_date(tmp_path):
    waits: list[float] = []
    date = formatdate(time.time() + 30, usegmt=True)

    def script(number, request):
        return (503, {"Retry-After": date}, "") if number == 1 else completion(texts(*GOOD))

    with Server(script).running() as server:
        client_of(server, tmp_path, waits).ask(ASK)
    assert 20 < waits[0] <= 30


def test_a_hanging_server_times_out(tmp_path):
    with (
        Server(lambda n, r: HANG).running() as server,
        pytest.raises(ModelError, match=r"no answer within 0.3 s"),
    ):
        client_of(server, tmp_path, timeout_s=0.3, attempts=2).ask(ASK)


HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"


def endless(write, over):
    write(HEAD + b"Content-Length: 5300000000\r\n\r\n")
    for _ in range(1000):
        write(b" " * (1 << 20))
    raise AssertionError("a gigabyte was taken")


def compressed(write, over):
    body = gzip.compress(b" " * (8 << 20), 1)
    size = b"Content-Length: %d\r\n\r\n" % len(body)
    write(HEAD + b"Content-Encoding: gzip\r\n" + size + body)


def dripping(start):
    def drip(write, over):
        write(start)
        while not over.wait(0.1):
            write(b" ")

    return drip


@pytest.mark.parametrize(
    ("what", "said"),
    [
        (endless, "has more than"),
        (compressed, "is compressed"),
        (dripping(HEAD + b"Content-Length: 5000\r\n\r\n"), "no answer within 2 s"),
        (dripping(HEAD + b"X: "), "no answer within 2 s"),
        (lambda write, over: write(HEAD + b"Content-Length: 9\r\n\r\n{"), "was cut"),
    ],
)
def test_replies_without_end_are_cut_off(tmp_path, what, said):
    begun = time.monotonic()
    with Server(lambda n, r: what).running() as server, pytest.raises(ModelError, match=said):
        client_of(server, tmp_path, timeout_s=2.0, attempts=1).ask(ASK)
    assert time.monotonic() - begun < 8


def with_content(content):
    return (200, {}, {"choices": [{"message": {"role": "assistant", "content": content}}]})


@pytest.mark.parametrize(
    "reply",
    [
        (200, {}, "[" * 100_000),
        (200, {}, '{"choices": ' + "[" * 100_000 + "]" * 100_000 + "}"),
        (200, {}, "[]"),
        (200, {}, '"text"'),
        (200, {}, '{"choices": {}}'),
        (200, {}, '{"choices": [3]}'),
        (200, {}, '{"choices": [{"message": "text"}]}'),
        with_content([{"type": "text", "text": "hello"}]),
        with_content(3),
        with_content({"a": 1}),
        with_content("[" * 30_000),
        with_content('{"instructions": ' + "[" * 10_000 + "]" * 10_000 + "}"),
        with_content("\ud800{}"),
    ],
)
def test_replies_of_other_types_are_tried_again(tmp_path, reply):
    with Server(lambda n, r: reply).running() as server, pytest.raises(ModelError) as caught:
        client_of(server, tmp_path, attempts=2).ask(ASK)
    assert len(server.requests) == 2
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("value", ["NaN", "1e400", "-5", '"many"', "null", "[]", "true", "{}"])
def test_impossible_usage_does_not_defeat_the_limits(tmp_path, value):
    status, headers, body = completion(texts(*GOOD))
    usage = dict.fromkeys(("prompt_tokens", "completion_tokens", "cost"), "?")
    body = json.dumps(body | {"usage": usage}).replace('"?"', value)
    with Server(lambda n, r: (status, headers, body)).running() as server:
        client = client_of(server, tmp_path, price_in=1.0, price_out=1.0, max_tokens=50)
        client.ask(ASK)
        used = client.budget.used()
        assert 50 < used.tokens_in + used.tokens_out < 500 and 0 < used.cost < 0.001
        with pytest.raises(BudgetError):
            client.ask([{"role": "user", "content": "more"}])


@pytest.mark.parametrize(
    ("said", "waited"),
    [
        ("Fri, 31 Dec 99999 23:59:59 GMT", 0.5),
        ("Fri, 31 Dec 9999 23:59:59 GMT", 60.0),
        ("1e400", 60.0),
        ("nan", 0.5),
        ("-5", 0.0),
        ("soon", 0.5),
        ("9" * 5000, 60.0),
    ],
)
def test_any_retry_after_is_bounded(tmp_path, said, waited):
    waits: list[float] = []
    script = Server(lambda n, r: (503, {"Retry-After": said}, ""))
    with script.running() as server, pytest.raises(ModelError):
        client_of(server, tmp_path, waits, backoff_s=0.5, attempts=2).ask(ASK)
    assert waits == [waited]


def test_after_too_many_failures_it_stops_with_a_plain_message(tmp_path):
    with Server(lambda n, r: (500, {}, "")).running() as server:
        client = client_of(server, tmp_path, attempts=1, failures=3)
        for _ in range(2):
            with pytest.raises(ModelError):
                client.ask(ASK)
        with pytest.raises(ModelDownError, match="3 requests to the language model failed"):
            client.ask(ASK)
        with pytest.raises(ModelDownError):
            client.ask(ASK)
    assert len(server.requests) == 3


def test_nothing_is_paid_for_twice(tmp_path):
    with Server(lambda n, r: completion(texts(*GOOD))).running() as server:
        for _ in range(3):
            client_of(server, tmp_path).ask(ASK)  # a new client each time: a new run
        client_of(server, tmp_path).ask([{"role": "user", "content": "other"}])
        assert len(server.requests) == 2
        assert client_of(server, tmp_path).budget.used().requests == 2


def test_budget(tmp_path):
    with Server(lambda n, r: completion(texts(*GOOD), tokens=600)).running() as server:
        client = client_of(server, tmp_path, max_tokens=1000)
        client.ask(ASK)
        with pytest.raises(BudgetError, match="--max-tokens 1000"):
            client.ask([{"role": "user", "content": "more"}])
        cheap = client_of(server, tmp_path / "b", max_cost=0.001, price_in=1.0, price_out=2.0)
        cheap.ask(ASK)
        assert cheap.budget.used().cost == pytest.approx(0.0018)
        with pytest.raises(BudgetError, match="--max-cost"):
            cheap.ask([{"role": "user", "content": "more"}])


def test_requests_at_a_time_are_bounded(two_rooms, tmp_path):
    def script(number, request):
        time.sleep(0.05)
        return completion(texts(*GOOD))

    scenes = two_rooms.root.parent
    if not (scenes / "two_rooms").exists():
        (scenes / "two_rooms").symlink_to(two_rooms.root)
    episodes = [episode_of([(5.2, 0.6 + k / 10), *LEFT[1:]], name=f"p{k}") for k in range(6)]
    with Server(script).running() as server:
        config = InstructConfig(writer="llm", count=1, llm=settings_of(server, workers=2))
        made = instruct_episodes(episodes, scenes, config, 0, cache=tmp_path / "c")
    assert len(made.episodes) == 6
    assert server.most == 2
    assert made.usage()["requests"] == len(server.requests) >= 5
    record = made.episodes[0].extra["instruction"]
    assert len(record["prompt_sha256"]) == 64 and record["temperature"] == 0.7


_RUN = """
import json, sys
from pathlib import Path
from tests.instruction_gen.test_instruct import LEFT, episode_of
from vlnpe.instruction_gen.instruct import instruct_episodes
from vlnpe.instruction_gen.llm.settings import LlmSettings
from vlnpe.instruction_gen.records import InstructConfig

url, scenes, cache = sys.argv[1:]
llm = LlmSettings(base_url=url, model="scripted", backoff_s=0.0, timeout_s=30.0, workers=2)
episodes = [episode_of([(5.2, 0.6 + k / 10), *LEFT[1:]], name=f"p{k}") for k in range(6)]
config = InstructConfig(writer="llm", count=1, llm=llm)
made = instruct_episodes(episodes, Path(scenes), config, 0, cache=Path(cache))
print(json.dumps({"texts": [e.instruction for e in made.episodes], **made.usage()}))
"""


@pytest.mark.chain
def test_a_killed_run_goes_on_and_pays_nothing_twice(two_rooms, tmp_path):
    scenes = two_rooms.root.parent
    if not (scenes / "two_rooms").exists():
        (scenes / "two_rooms").symlink_to(two_rooms.root)
    answered: list[str] = []
    reached = threading.Event()
    killed = False

    def script(number, request):
        body = json.dumps(request["messages"])
        if number > 3 and not killed:
            if number > 4:  # both workers ask on: what was answered before has arrived
                reached.set()
            return HANG
        assert body not in answered, "paid for twice"
        answered.append(body)
        return completion(texts(GOOD[0]))

    with Server(script).running() as server:
        command = [sys.executable, "-c", _RUN, server.url, str(scenes), str(tmp_path / "cache")]
        root = Path(__file__).resolve().parents[2]
        with subprocess.Popen(command, cwd=root) as first:
            assert reached.wait(60)
            first.kill()
        assert first.returncode == -signal.SIGKILL
        killed = True
        server.release.set()
        second = subprocess.run(
            command, cwd=root, capture_output=True, text=True, timeout=120, check=True
        )
    made = json.loads(second.stdout.splitlines()[-1])
    assert made["texts"] == [GOOD[0]] * 6 and made["requests"] == len(answered)
    assert len(answered) >= 5


def with_claim(step, **claim):
    """Return `STEPS` with the first claim of a step changed."""
    first, *rest = STEPS[step]["claims"]
    changed = STEPS[step] | {"claims": [first | claim, *rest]}
    return [*STEPS[:step], changed, *STEPS[step + 1 :]]


def test_a_models_claims_are_checked_and_kept(two_rooms, tmp_path):
    with Server(lambda n, r: completion(texts(STEPS))).running() as server:
        (text,), _, _ = write_with(server, tmp_path, two_rooms, count=1)
    assert text.text == "Turn left through the doorway into the kitchen and stop next to the table."
    assert text.record()["claims"] == STEPS and "unchecked" not in text.record()
    schema = json.dumps(server.requests[0]["response_format"]["json_schema"]["schema"])
    assert '"doorway"' in schema and '"reach"' in schema  # what a claim may say


@pytest.mark.parametrize(
    ("steps", "complaint"),
    [
        (with_claim(0, side="right"), "there is no turn to the right"),
        (with_claim(1, name="sofa"), "no claim is about the table"),
        (with_claim(1, kind="hover"), "unknown claim's kind 'hover'"),
        (with_claim(1, count="two"), "claim's count 'two'"),
        ([STEPS[0] | {"words": "Turn right into the kitchen"}, STEPS[1]], "no claim says right"),
        ([*STEPS, {"words": "Sing.", "claims": []}], "claims nothing"),
    ],
)
def test_a_model_hears_what_is_wrong_with_its_claims(two_rooms, tmp_path, steps, complaint):
    def script(number, request):
        return completion(texts(steps if number == 1 else STEPS))

    with Server(script).running() as server:
        (text,), _, _ = write_with(server, tmp_path, two_rooms, count=1)
    assert complaint in server.requests[1]["messages"][-1]["content"]
    assert (text.writer, text.attempts) == ("llm", 2)


UNSURE = "Turn left through the doorway into the kitchen, not far, and stop next to the table."


def test_words_without_a_claim_are_asked_for_and_then_marked(two_rooms, tmp_path):
    with Server(lambda n, r: completion(texts(UNSURE))).running() as server:
        (text,), _, _ = write_with(server, tmp_path, two_rooms, count=1)
    assert len(server.requests) == 3
    assert "no claim covers: not" in server.requests[1]["messages"][-1]["content"]
    assert text.record()["unchecked"] == ["not"]


CHINESE = "向前走，左转穿过门口进入厨房，然后在桌子旁边停下。"
HINDI = "आगे चलें, बाएँ मुड़ें, रसोई में जाएँ और मेज के पास रुकें।"


def translated(text, back):
    """Return a script that writes a text, and translates it back."""

    def script(number, request):
        asked = request["messages"][0]["content"].startswith("You translate")
        assert not asked or request["messages"][1]["content"] == text  # and no facts
        return completion(texts(back if asked else text))

    return script


@pytest.mark.parametrize(("text", "language"), [(CHINESE, "zh"), (HINDI, "hi")])
@pytest.mark.parametrize(
    ("back", "writers", "unchecked"),
    [
        (STEPS, ["llm"], False),
        (LIE, [], False),
        (with_claim(0, side="right"), [], False),
        (UNSURE, ["llm"], True),
        (with_claim(1, kind="hover"), ["llm"], True),
        ("", [], False),
    ],
)
def test_a_translation_is_checked_by_translating_it_back(
    two_rooms, tmp_path, text, language, back, writers, unchecked
):
    with Server(translated(text, back)).running() as server:
        results, _, _ = write_with(server, tmp_path, two_rooms, count=1, languages=(language,))
    assert [one.writer for one in results] == writers  # never English in its place
    assert all(bool(one.unchecked) == unchecked and one.text == text for one in results)
    assert unchecked or all(one.record()["claims"] == STEPS for one in results)


def test_a_text_in_another_language_than_asked_for_is_refused(two_rooms, tmp_path):
    with Server(translated(GOOD[1], STEPS)).running() as server:
        assert write_with(server, tmp_path, two_rooms, count=1, languages=("zh",))[0] == []


def test_an_answer_with_the_key_is_neither_kept_nor_used(two_rooms, tmp_path):
    answer = texts(f"{GOOD[0]} {KEY}", GOOD[0])
    with Server(lambda n, r: completion(answer)).running() as server:
        client = client_of(server, tmp_path, attempts=2)
        with pytest.raises(ModelError, match="contains the API key"):
            client.ask(ASK)
    assert not any(KEY in file.read_text() for file in tmp_path.rglob("*") if file.is_file())


def test_the_key_appears_nowhere(two_rooms, tmp_path, caplog, capsys):
    caplog.set_level(logging.DEBUG)
    for status in (401, 500):
        body = {"error": {"message": f"bad key {KEY}"}}
        with Server(lambda n, r, s=status, b=body: (s, {}, b)).running() as server:
            client = client_of(server, tmp_path / str(status), attempts=2)
            with pytest.raises((InputError, ModelError)) as raised:
                client.ask(ASK)
            assert server.authorizations[0] == f"Bearer {KEY}"
        assert KEY not in "".join(traceback.format_exception(raised.value))
        assert KEY not in repr(client.__dict__) and KEY not in repr(client.settings)
    with Server(lambda n, r: completion(texts(*GOOD))).running() as server:
        client_of(server, tmp_path / "good").ask(ASK)
    for path in tmp_path.rglob("*"):
        assert path.is_dir() or KEY not in path.read_text()
    out = capsys.readouterr()
    assert KEY not in caplog.text + out.out + out.err


def test_without_its_library_a_model_asks_for_the_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("vlnpe.instruction_gen.llm.settings.find_spec", lambda _: None)
    with pytest.raises(MissingExtraError, match=r"--vision needs the extra `llm`; .*EXTRA=llm"):
        settings_from({}, asked_by="--vision")


def test_settings_come_from_the_environment_alone():
    good = {"VLNPE_LLM_BASE_URL": "http://h/v1", "VLNPE_LLM_MODEL": "m", "VLNPE_LLM_API_KEY": KEY}
    made = settings_from(good)
    assert (made.base_url, made.model) == ("http://h/v1", "m") and KEY not in json.dumps(repr(made))
    for broken, message in (
        ({}, "VLNPE_LLM_BASE_URL"),
        (good | {"VLNPE_LLM_BASE_URL": f"http://u:{KEY}@h"}, "no user, password"),
        (good | {"VLNPE_LLM_BASE_URL": "ftp://h"}, "http"),
        (good | {"VLNPE_LLM_PRICE_IN": "cheap"}, "not a number"),
        (good | {"VLNPE_LLM_TIMEOUT_S": "long"}, "VLNPE_LLM_TIMEOUT_S"),
        (good | {"VLNPE_LLM_TIMEOUT_S": "-1"}, "seconds above 0"),
    ):
        with pytest.raises(InputError, match=message) as raised:
            settings_from(broken)
        assert KEY not in str(raised.value)
    with pytest.raises(InputError, match="max-cost needs"):
        settings_from(good, max_cost=1.0)
    with pytest.raises(InputError, match="VLNPE_GGUF"):
        settings_from({}, local=True)

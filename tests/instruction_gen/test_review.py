"""The review page: durable decisions, guarded server, and the page in a real browser."""

import http.client
import json
import shutil
import socket
import struct
import threading
from contextlib import contextmanager
from urllib.parse import urlsplit

import pytest

from tests.instruction_gen.test_instruct import EAST, LEFT, episode_of
from tests.support.claimed import STEPS
from tests.support.misbehaving_server import Server, completion, texts
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.formats.vlnce.groups import per_instruction
from vlnpe.instruction_gen.instruct import instruct_episodes
from vlnpe.instruction_gen.llm.settings import LlmSettings
from vlnpe.instruction_gen.records import InstructConfig
from vlnpe.instruction_gen.review.decisions import (
    Decision,
    agreement,
    apply_decisions,
)
from vlnpe.instruction_gen.review.paths import Review
from vlnpe.instruction_gen.review.server import _Handler, make_server


@pytest.fixture(scope="module")
def written(two_rooms):
    """Two paths with their texts, and the folder of their scene."""
    scenes = two_rooms.root.parent
    if not (scenes / "two_rooms").exists():
        (scenes / "two_rooms").symlink_to(two_rooms.root)
    episodes = [episode_of(EAST, name="p0"), episode_of(LEFT, name="p1")]
    return instruct_episodes(episodes, scenes, InstructConfig(), 0).episodes, scenes


@pytest.fixture
def review(written, tmp_path):
    episodes, scenes = written
    return Review(episodes, scenes, tmp_path / "review.jsonl")


@contextmanager
def serving(review):
    server, address = make_server(review)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield address
    finally:
        server.shutdown()
        server.server_close()


def ask(address, path, body=None, token=None, headers=None):
    parts = urlsplit(address)
    token = parts.query.removeprefix("token=") if token is None else token
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=10)
    mark = "&" if "?" in path else "?"
    data = None if body is None else json.dumps(body)
    method = "GET" if body is None else "POST"
    connection.request(method, f"{path}{mark}token={token}", data, headers or {})
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_decisions_are_durable_counted_and_undone(review):
    file = review.file
    text = review.paths["p0"].extra["instructions"][0]
    file.add(Decision("ann", "p0", 0, "accept", text))
    file.add(Decision("bob", "p0", 0, "reject", text, reason="dull"))
    file.add(Decision("ann", "p1", 0, "accept", review.paths["p1"].extra["instructions"][0]))
    assert agreement(file.current()) == {"judged_twice": 1, "agreed": 0, "judged": 2}
    file.add(Decision("bob", "p0", 0, "undo", text))
    assert agreement(file.current()) == {"judged_twice": 0, "agreed": 0, "judged": 2}
    with file.path.open("a") as stream:
        stream.write('{"annotator": "cut sho')  # a crash
    assert len(file.read()) == 4
    with pytest.raises(InputError, match="accept"):
        file.add(Decision("ann", "p0", 0, "praise", text))


def test_decisions_flow_into_episodes(review):
    episodes = list(review.paths.values())
    texts = episodes[0].extra["instructions"]
    new = "Walk straight through the doorway, pass the sofa on the right, then stop."
    review.file.add(Decision("ann", "p0", 0, "edit", texts[0], new))
    review.file.add(Decision("ann", "p0", 1, "reject", texts[1], reason="odd"))
    for k, text in enumerate(episodes[1].extra["instructions"]):
        review.file.add(Decision("ann", "p1", k, "reject", text, reason="all odd"))
    kept, lost = apply_decisions(episodes, review.file)
    assert [e.episode_id for e in kept] == ["p0"]
    assert kept[0].extra["instructions"] == [new, texts[2]] and kept[0].instruction == new
    assert "all odd" in lost["p1"]
    records = episodes[0].extra["instruction"]["texts"]
    edited, left = kept[0].extra["instruction"]["texts"]
    assert left == records[2] and edited["text"] == new and edited["edited"]
    assert "landmarks" not in edited and edited["style"] == records[0]["style"]
    assert [one.instruction for one in per_instruction(kept[0])] == [new, texts[2]]
    assert [one.extra["instruction"]["texts"] for one in per_instruction(kept[0])] == [
        [edited],
        [left],
    ]


def test_a_file_with_one_text_per_episode_is_reviewed_whole(by_a_model, tmp_path):
    whole = by_a_model.path("p", "ann")
    parts = [one for e in by_a_model.paths.values() for one in per_instruction(e)]
    assert len(parts) == len(whole["texts"]) == 3
    write_episodes(tmp_path / "parts.json.gz", parts)
    read = read_episodes(tmp_path / "parts.json.gz")
    again = Review(read, tmp_path, tmp_path / "parts.jsonl")
    assert again.names == ["p"] and again.path("p", "ann") == whole


def test_only_our_page_with_the_token_is_served(review):
    with serving(review) as address:
        assert ask(address, "/")[0] == 200
        assert ask(address, "/api/path?number=0")[0] == 200
        assert ask(address, "/", token="wrong")[0] == 403
        assert (
            ask(address, "/api/path?number=0", headers={"Origin": "http://evil.example"})[0] == 403
        )
        assert ask(address, "/", headers={"Host": "evil.example"})[0] == 403
        assert ask(address, "/api/decide", {"path": "p0"})[0] == 400
        assert ask(address, "/../../etc/passwd")[0] == 404
        assert address.startswith("http://127.0.0.1:")


def exchange(address, request: bytes) -> bytes:
    """Send bytes as they are; `TOKEN` in them is the page's. Return the status line."""
    parts = urlsplit(address)
    request = request.replace(b"TOKEN", parts.query.removeprefix("token=").encode())
    request = request.replace(b"HOST", parts.netloc.encode())
    with socket.create_connection((parts.hostname, parts.port), timeout=10) as connection:
        connection.sendall(request)
        connection.shutdown(socket.SHUT_WR)
        return connection.makefile("rb").readline()


def post(path: bytes, body: bytes, size: bytes | None = None) -> bytes:
    size = b"%d" % len(body) if size is None else size
    head = b"POST " + path + b"?token=TOKEN HTTP/1.1\r\nHost: HOST\r\nContent-Length: "
    return head + size + b"\r\n\r\n" + body


GET = b"GET %s HTTP/1.1\r\nHost: HOST\r\n\r\n"
DECISION = b'{"annotator": "a", "path": "p0", "number": %s, "action": "accept"}'


@pytest.mark.parametrize(
    "request_",
    [
        GET % b"/api/path?number=abc&token=TOKEN",
        GET % (b"/api/path?number=" + b"9" * 5000 + b"&token=TOKEN"),
        GET % b"/api/path?number=1e400&token=TOKEN",
        *(GET % b"/api/path?number=%s&token=TOKEN" % number for number in (b"2", b"-1", b"")),
        GET % b"/api/path?token=TOKEN",
        GET % b"http://[/api/path?token=TOKEN",
        *(post(b"/api/check", b"{}", size) for size in (b"abc", b"", b"-5", b"1e3", b"0x2")),
        post(b"/api/decide", b"[" * 15_000),
        post(b"/api/decide", b'{"a":' * 3000),
        *(post(b"/api/decide", body) for body in (b"", b"3", b"null", b"[]", b"\xff", b'"x"')),
        *(post(b"/api/decide", DECISION % number) for number in (b"1e400", b"NaN", b"[]", b"-1")),
        *(post(b"/api/decide", DECISION % number) for number in (b"null", b"99", b'"abc"')),
        post(b"/api/check", b'{"path": "p9", "number": 0, "text": "x"}'),
        post(b"/api/decide", b"{}", b"5000"),
    ],
)
def test_malformed_requests_get_400_and_leave_no_trace(review, request_, capfd):
    with serving(review) as address:
        assert b" 400 " in exchange(address, request_)
        assert ask(address, "/api/path?number=0")[0] == 200
    assert capfd.readouterr().err == ""
    assert not review.file.path.exists() or not review.file.current()


def test_clients_that_disconnect_leave_no_trace(review, capfd, monkeypatch):
    monkeypatch.setattr(_Handler, "timeout", 0.3)
    reset = struct.pack("ii", 1, 0)
    with serving(review) as address:
        parts = urlsplit(address)
        for request in (b"", b"GET", GET % b"/review.js?token=TOKEN", post(b"/api/check", b"{")):
            request = request.replace(b"TOKEN", parts.query.removeprefix("token=").encode())
            request = request.replace(b"HOST", parts.netloc.encode())
            for hard in (True, False):
                connection = socket.create_connection((parts.hostname, parts.port), timeout=10)
                connection.sendall(request)
                if hard:  # close with a reset
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset)
                connection.close()
        slow = socket.create_connection((parts.hostname, parts.port), timeout=10)
        slow.sendall(b"POST /api/check HTTP/1.1\r\nHost: x")
        assert slow.recv(100) == b""  # hung up on
        slow.close()
        assert ask(address, "/api/path?number=0")[0] == 200
    assert capfd.readouterr().err == ""


def test_an_untrue_edit_is_refused_and_a_true_one_kept(review):
    body = {"annotator": "ann", "path": "p1", "number": 0, "action": "edit"}
    lie = "Turn right into the kitchen and stop next to the table."
    good = "Turn left into the kitchen and stop next to the table."
    with serving(review) as address:
        status, answer = ask(address, "/api/decide", body | {"text": lie})
        assert status == 409 and b"no turn to the right" in answer
        assert ask(address, "/api/decide", body | {"text": good})[0] == 200
        status, answer = ask(address, "/api/path?number=1&annotator=ann")
        assert json.loads(answer)["texts"][0]["text"] == good
        status, answer = ask(address, "/api/check", {"path": "p1", "number": 0, "text": lie})
        found = json.loads(answer)
        assert found["problems"] and any(problems for _, _, problems in found["clauses"])


ENGLISH = " ".join(step["words"] for step in STEPS)
UNSURE = "Turn left through the doorway into the kitchen, not far, and stop next to the table."
CHINESE = "向前走，左转穿过门口进入厨房，然后在桌子旁边停下。"


@pytest.fixture
def by_a_model(two_rooms, tmp_path):
    """A path with two English texts, one with unchecked words, and a Chinese one, likewise."""

    def script(number, request):
        system, wish = (m["content"] for m in request["messages"][:2])
        if system.startswith("You translate"):
            return completion("no JSON")
        if "(language 'zh')" in wish:
            return completion(texts(CHINESE))
        again = len(request["messages"]) > 2
        return completion(texts(UNSURE) if again else texts(STEPS, UNSURE))

    (tmp_path / "two_rooms").symlink_to(two_rooms.root)
    with Server(script).running() as server:
        llm = LlmSettings(base_url=server.url, model="scripted")
        config = InstructConfig(writer="llm", count=2, languages=("en", "zh"), llm=llm)
        made = instruct_episodes(
            [episode_of(LEFT, name="p")], tmp_path, config, 0, cache=tmp_path / "cache"
        )
    assert made.unchecked == 2
    write_episodes(tmp_path / "told.json.gz", made.episodes)
    read = read_episodes(tmp_path / "told.json.gz")
    return Review(read, tmp_path, tmp_path / "review.jsonl")


def test_unchecked_words_are_shown_and_need_someone_to_vouch(by_a_model):
    review = by_a_model
    shown = review.path("p", "ann")["texts"]
    assert [one["text"] for one in shown] == [ENGLISH, UNSURE, CHINESE]
    assert [one["verdict"]["problems"] for one in shown] == [[], [], []]
    assert [one["verdict"]["unchecked"] for one in shown] == [[], ["not"], [CHINESE]]
    episodes = list(review.paths.values())
    kept, _ = apply_decisions(episodes, review.file)
    assert kept[0].extra["instructions"] == [ENGLISH]
    for number in (1, 2):
        review.decide("ann", {"path": "p", "number": number, "action": "accept"})
    kept, _ = apply_decisions(episodes, review.file)
    assert kept[0].extra["instructions"] == [ENGLISH, UNSURE, CHINESE]
    records = kept[0].extra["instruction"]["texts"]
    assert [record.get("vouched", False) for record in records] == [False, True, True]


def test_a_path_whose_texts_are_all_unchecked_says_why_it_is_left_out(by_a_model):
    review = by_a_model
    review.decide("ann", {"path": "p", "number": 0, "action": "reject", "reason": "dull"})
    kept, lost = apply_decisions(list(review.paths.values()), review.file)
    assert kept == [] and "no reviewer vouches for: not" in lost["p"]


def test_an_edit_in_another_language_is_vouched_for_by_its_editor(by_a_model):
    review = by_a_model
    new = "左转穿过门口进入厨房，在桌子旁边停下。"
    body = {"annotator": "ann", "path": "p", "number": 2, "action": "edit"}
    with serving(review) as address:
        status, answer = ask(address, "/api/decide", body | {"text": ENGLISH})
        assert status == 409 and b"not in the language asked for" in answer
        found = json.loads(ask(address, "/api/check", body | {"text": new})[1])
        assert found["problems"] == [] and found["unchecked"] == [new]
        assert ask(address, "/api/decide", body | {"text": new})[0] == 200
    kept, _ = apply_decisions(list(review.paths.values()), review.file)
    assert kept[0].extra["instructions"] == [ENGLISH, new]
    assert kept[0].extra["instruction"]["texts"][1]["vouched"]


@pytest.fixture
def browser():
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    chrome = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if not chrome or not driver:
        pytest.skip("no Chromium with its driver on this machine")
    options = webdriver.ChromeOptions()
    options.binary_location = chrome
    for flag in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,900"):
        options.add_argument(flag)
    service = webdriver.ChromeService(driver)
    made = webdriver.Chrome(options=options, service=service)
    made.implicitly_wait(10)
    yield made
    made.quit()


def test_the_page_in_a_browser(review, browser, tmp_path):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    def until(condition):
        return WebDriverWait(browser, 15).until(lambda _: condition())

    def body():
        return browser.find_element(By.TAG_NAME, "body")

    def decided():
        return [(d.action, d.number) for d in review.file.read()]

    with serving(review) as address:
        browser.get(address)
        until(lambda: len(browser.find_elements(By.CSS_SELECTOR, ".text")) == 3)
        name = browser.find_element(By.ID, "annotator")
        name.send_keys("ann", Keys.TAB)
        body().send_keys("a")
        until(lambda: decided() == [("accept", 0)])
        until(lambda: browser.find_elements(By.CSS_SELECTOR, ".text.accept"))
        body().send_keys("2")
        body().send_keys("r")
        browser.find_element(By.CSS_SELECTOR, "input.reason").send_keys("dull", Keys.ENTER)
        until(lambda: decided()[-1] == ("reject", 1))
        until(lambda: browser.find_elements(By.CSS_SELECTOR, ".text.reject"))
        body().send_keys("u")
        until(lambda: decided()[-1] == ("undo", 1))
        body().send_keys("j")
        until(lambda: "p1" in browser.find_element(By.ID, "title").text)
        body().send_keys("e")
        area = browser.find_element(By.TAG_NAME, "textarea")
        area.clear()
        area.send_keys("Turn right into the kitchen and stop next to the table.")
        problems = browser.find_element(By.CSS_SELECTOR, ".text.current .problems")
        until(lambda: "turn right" in problems.text)  # while typing
        area.clear()
        area.send_keys("Turn left into the kitchen and stop next to the table.", Keys.ENTER)
        until(lambda: decided()[-1] == ("edit", 0))
        picture = tmp_path / "page.png"
        assert browser.save_screenshot(str(picture)) and picture.stat().st_size > 10_000
        errors = [e for e in browser.get_log("browser") if e["level"] == "SEVERE"]
        assert [e for e in errors if "favicon" not in e["message"]] == []


def test_a_decision_exports_only_its_own_path_again(review, tmp_path):
    from vlnpe.pipeline.stages.datasets.export_items import review_digests

    (tmp_path / "episodes").mkdir()
    write_episodes(tmp_path / "episodes" / "train.json.gz", list(review.paths.values()))
    before = {name: review_digests(tmp_path)(name) for name in ("p0", "p1", "elsewhere")}
    text = review.paths["p0"].extra["instructions"][0]
    review.file.add(Decision("ann", "p0", 0, "reject", text))
    after = {name: review_digests(tmp_path)(name) for name in before}
    assert after["p0"] != before["p0"] and after["p1"] == before["p1"]
    assert after["elsewhere"] != before["elsewhere"]  # a path that no episode file knows
    review.file.add(Decision("ann", "p0", 0, "undo", text))
    assert {name: review_digests(tmp_path)(name) for name in before} == before

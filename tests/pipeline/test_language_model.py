"""A run whose instructions a language model writes: what is kept of it, and what never is."""

import gzip
import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.support.misbehaving_server import Server, completion, texts
from tests.support.runs import tiny_run
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.instruction_gen.llm.brief import prompts_sha256
from vlnpe.pipeline.engine.ledger import MANIFEST_NAME, QUARANTINE_NAME, Ledger

pytestmark = [pytest.mark.slow, pytest.mark.chain]

KEY = "sk-sentinel-2b81d4"
TOKENS = 100  # of each request, and as many of its answer


def true_text(request):
    """Tell the way of a request about two rooms without labels."""
    facts = json.loads(request["messages"][1]["content"].split("\n")[0].removeprefix("Facts: "))
    turns = "".join(f" turn {turn['side']}," for turn in facts["turns"])
    rest_m = round(facts["length_m"] - facts["doorways"][0]["after_m"])
    return f"Go forward,{turns} continue into the next room, and stop after about {rest_m} metres."


def environment(url):
    prices = {"VLNPE_LLM_PRICE_IN": "1.0", "VLNPE_LLM_PRICE_OUT": "2.0"}
    server = {"VLNPE_LLM_BASE_URL": url, "VLNPE_LLM_MODEL": "scripted", "VLNPE_LLM_API_KEY": KEY}
    return {**server, **prices, "no_proxy": "127.0.0.1", "NO_PROXY": "127.0.0.1"}


def contents(path):
    """Return the bytes of a file, also as they are before compression."""
    data = path.read_bytes()
    if path.suffix == ".gz":
        return data + gzip.decompress(data)
    if path.suffix == ".parquet":
        return data + repr(pq.read_table(path).to_pylist()).encode()
    return data


def test_provenance_names_the_model_and_no_file_has_its_key(tmp_path: Path) -> None:
    scan, out = tiny_run.write_scan(tmp_path / "scan.glb"), tmp_path / "run"
    command = tiny_run.command(scan, out, "--workers", 1, "--writer", "llm", "--count", 1)
    told = {"error": {"message": f"bad key {KEY}"}}
    with Server(lambda number, request: (401, {}, told)).running() as server:
        refused = tiny_run.run(command, **environment(server.url))
        assert refused.returncode != 0 and "VLNPE_LLM_API_KEY" in refused.stderr
        assert server.authorizations == [f"Bearer {KEY}"] * len(server.requests) != []
    shutil.copytree(out, tmp_path / "refused")

    def script(number, request):
        return (500, {}, told) if number == 1 else completion(texts(true_text(request)), TOKENS)

    with Server(script).running() as server:
        done = tiny_run.run(command, **environment(server.url))
        assert done.returncode == 0, done.stderr[-3000:]
        answers = len(server.requests) - 1

    episodes = read_episodes(out / "episodes" / "train.json.gz")
    made = [episode.extra["instruction"] for episode in episodes]
    assert {(m["model"], m["prompt_sha256"], m["temperature"]) for m in made} == {
        ("scripted", prompts_sha256(), 0.7)
    }
    assert {text["writer"] for m in made for text in m["texts"]} == {"llm"}
    used = {
        "requests": answers,
        "tokens_in": answers * TOKENS,
        "tokens_out": answers * TOKENS,
        "cost": pytest.approx(answers * TOKENS * 3e-6),
    }
    (row,) = Ledger(out).rows("instruct")
    assert row.facts["language_model"] == used
    (path,) = out.glob("**/meta/provenance.json")
    provenance = json.loads(path.read_text())
    count = len(episodes)
    assert provenance["instructions"] == {
        "composer": {"llm": count},
        "model": {"scripted": count},
        "prompt_sha256": {prompts_sha256(): count},
        "temperature": {"0.7": count},
    }
    assert provenance["language_model"] == used

    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {MANIFEST_NAME, QUARANTINE_NAME, "usage.json"} <= {path.name for path in files}
    assert {".gz", ".parquet", ".html", ".mcap", ".md"} <= {path.suffix for path in files}
    assert [path for path in files if KEY.encode() in contents(path)] == []
    assert KEY not in refused.stdout + refused.stderr + done.stdout + done.stderr

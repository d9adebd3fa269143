"""`collect --vision`: a model names things and rooms of a scene without labels, once."""

import gzip
import json
import os
import signal
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from tests.support.misbehaving_server import Server, completion
from tests.support.runs import tiny_run
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.instruction_gen.facts.named import read_named
from vlnpe.pipeline.commands.review import review_of
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.options.instructions import Review
from vlnpe.pipeline.stages.instructions.instruct_job import read_facts

pytestmark = [pytest.mark.slow, pytest.mark.chain]

KEY = "sk-sentinel-90aa3e"
EPISODES = "6"  # so that each room has two frames


def script(number, request):
    """See a sofa in the middle of each frame, in an office."""
    if request["response_format"]["json_schema"]["name"] == "roomsight":
        return completion({"room": "office"})
    return completion({"things": [{"name": "sofa", "box": [80, 60, 240, 180]}]})


def environment(url):
    server = {"VLNPE_LLM_BASE_URL": url, "VLNPE_LLM_MODEL": "eyes", "VLNPE_LLM_API_KEY": KEY}
    return {**server, "no_proxy": "127.0.0.1", "NO_PROXY": "127.0.0.1"}


def command(tmp_path: Path, *options: object) -> list[str]:
    scan, out = tmp_path / "scan.glb", tmp_path / "run"
    if not scan.exists():
        tiny_run.write_scan(scan)
    return tiny_run.command(scan, out, "--workers", 1, "--episodes", EPISODES, *options)


def test_a_killed_run_goes_on_and_pays_nothing_twice(tmp_path: Path) -> None:
    out = tmp_path / "run"
    killed = []

    def kill(number, request):
        if number == 4:
            os.killpg(killed[0].pid, signal.SIGKILL)
            killed[0].wait()
            killed.append(json.dumps(request["messages"]))
        return script(number, request)

    asked = []
    with Server(kill).running() as server:
        killed.append(
            subprocess.Popen(
                command(tmp_path, "--vision"),
                env=tiny_run.environment(**environment(server.url)),
                stderr=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
        )
        assert killed[0].wait(500) == -signal.SIGKILL
        asked += server.requests
    with Server(script).running() as server:
        done = tiny_run.run(command(tmp_path, "--vision"), **environment(server.url))
        assert done.returncode == 0, done.stderr[-3000:]
        asked += server.requests
    times = Counter(json.dumps(request["messages"]) for request in asked)
    assert {text for text, count in times.items() if count > 1} <= {killed[1]}
    assert len(times) > 4

    (named,) = read_named([*(out / "facts").glob("*.named.json")]).values()
    assert {room.name for room in named.rooms} == {"office"} and named.objects
    (row,) = Ledger(out).rows("name")
    assert "rooms named by the vision-language model" in done.stderr
    (path,) = out.glob("**/meta/provenance.json")
    provenance = json.loads(path.read_text())
    assert set(provenance["instructions"]["vision_model"]) == {"eyes"}
    assert provenance["language_model"] == row.facts["language_model"]
    assert provenance["language_model"]["requests"] == len(times)
    review = review_of(Review(out))
    (facts,) = (read_facts(p) for p in (out / "facts").glob("*.json.gz"))
    assert {v["room"] for one in facts.values() for v in one["visits"]} == {"office"}
    for name in review.names:
        assert [v.room for v in review.ground(name).facts.visits] == [
            v["room"] for v in facts[name]["visits"]
        ]
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    unzipped = [gzip.decompress(p.read_bytes()) for p in files if p.suffix == ".gz"]
    assert not any(KEY.encode() in data for data in [*unzipped, *map(Path.read_bytes, files)])
    assert KEY not in done.stdout + done.stderr

    without = tiny_run.run(command(tmp_path, "--only-episodes"))
    assert without.returncode == 0, without.stderr[-3000:]
    assert not [*(out / "facts").glob("*.named.json")] and Ledger(out).rows("name") == []
    made = read_episodes(out / "episodes" / "train.json.gz")
    assert all("vision_model" not in one.extra["instruction"] for one in made)


def test_a_scene_with_labels_costs_nothing_and_changes_nothing(tmp_path: Path) -> None:
    out = tmp_path / "run"
    boxes = {  # the file's y is the world's z
        "sofa": ([0.1, 0.0, -0.4], [0.4, 1.0, -0.1]),
        "room:office": ([0.0, 0.0, -4.0], [4.05, 2.6, 0.0]),
        "room:bedroom": ([4.05, 0.0, -4.0], [8.0, 2.6, 0.0]),
    }
    labels = [{"name": c, "category": c, "lower": a, "upper": b} for c, (a, b) in boxes.items()]
    (tmp_path / "scan.labels.json").write_text(json.dumps({"frame": "source", "objects": labels}))
    bare = tiny_run.run(command(tmp_path, "--only-episodes"))
    assert bare.returncode == 0, bare.stderr[-3000:]
    before = (out / "episodes" / "train.json.gz").read_bytes()
    with Server(script).running() as server:
        asked = command(tmp_path, "--only-episodes", "--vision")
        done = tiny_run.run(asked, **environment(server.url))
        assert done.returncode == 0, done.stderr[-3000:]
        assert server.requests == []
    assert "has labels of its own; the vision-language model was not asked" in done.stderr
    assert (out / "episodes" / "train.json.gz").read_bytes() == before
    missing = tiny_run.run(command(tmp_path, "--only-episodes", "--vision"))
    assert missing.returncode == 2 and "--vision needs VLNPE_LLM_BASE_URL" in missing.stderr

"""`vlnpe evaluate` and `vlnpe compare`, as a user calls them."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from mcap.reader import make_reader

from tests.collectors.test_replay import make_episode
from tests.support.misbehaving_server import Server, completion
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.evaluation.results import COLUMNS
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.flags import FlagFile
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.pipeline.cli import main


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with a scene and three episodes, of which one starts in the table."""
    run = tmp_path_factory.mktemp("evaluate") / "run"
    bundle = write_two_rooms(run / "scenes" / "two_rooms")
    good = [make_episode(bundle, (2.6, 2.0), (5.4, 2.0), name=f"e{k}") for k in range(2)]
    seen = [replace(e, split="val_seen", instruction="Go through the door.") for e in good]
    (run / "episodes").mkdir()
    write_episodes(run / "episodes" / "val.json.gz", seen)
    return run


@pytest.mark.usefixtures("inline")
@pytest.mark.parametrize("camera", ["ego:64x48:90", "rig:125cm_30deg:level:64x48:79"])
def test_the_viewer_opens_an_evaluation_outside_its_run(run, tmp_path, camera) -> None:
    pytest.importorskip("viser", reason="the extra `view` is not installed")
    from vlnpe.pipeline.inputs.walks import entries_of, scenes_beside
    from vlnpe.viewer.library import flagged_in

    out = tmp_path / "apart"
    evaluated(run, "--policy", "oracle", "--out", str(out), "--camera", camera, "--mcap")
    scenes = scenes_beside(out)
    assert scenes == (run / "scenes").resolve()
    for frames in (True, False):
        first, second = entries_of(out, scenes)
        walk = first.load()
        assert walk.shots is not None
        kind, *_, fov = camera.split(":")
        assert (walk.shots.camera.width_px, walk.shots.camera.hfov_deg) == (64, float(fov))
        picture = walk.shots.picture(len(walk.shots.samples) - 1)
        assert picture.shape == (48, 64, 3) and picture.std() > 5
        height_m = (walk.shots.position_world_m[:, 2] - walk.rollout.floor_z_m[0]).mean()
        assert kind == "ego" or height_m == pytest.approx(1.25, abs=0.05)
        if frames:
            shutil.rmtree(out / "frames")  # drawn then
    FlagFile(first.folder).set(first.item, True)
    assert set(flagged_in([first, second])) == {first.name}
    with pytest.raises(InputError, match="--scenes"):
        scenes_beside(out, tmp_path / "nowhere")


@pytest.mark.usefixtures("inline")
def test_an_evaluations_flagged_walks_are_left_out_of_its_export(run, tmp_path, caplog) -> None:
    out, scenes = tmp_path / "flagged", str(run / "scenes")
    evaluated(run, "--policy", "oracle", "--out", str(out), "--camera", "ego:64x48:90", "--mcap")
    for name, count in (("", 2), ("aliengo/speed/e0", 1)):
        if name:
            FlagFile(out).set(name, True)
        data = tmp_path / f"data{count}"
        words = ["export", str(out), "--scenes", scenes, "--without-flagged", "--out", str(data)]
        assert main([*words, "--workers", "1"]) == 0
        assert len(list(data.glob("mcap/*/*.mcap"))) == count
    assert caplog.text.count("no walk of it is flagged") == 1


@contextmanager
def served(source: str) -> Iterator[str]:
    """Run a policy server's source in a process of its own; the address."""
    process = subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split()[-1]
    finally:
        process.kill()
        process.wait()


def evaluated(run: Path, *options: str) -> dict:
    assert main(["evaluate", str(run), "--workers", "1", *options]) == 0
    out = Path(options[options.index("--out") + 1])
    return json.loads((out / "results.json").read_text())


@pytest.mark.usefixtures("inline")
def test_the_oracle_arrives_an_idle_policy_does_not_and_compare_says_so(
    run, tmp_path, capsys
) -> None:
    a, b = tmp_path / "oracle", tmp_path / "stop"
    oracle = evaluated(run, "--policy", "oracle", "--out", str(a))
    idle = evaluated(run, "--policy", "stop", "--out", str(b), "--split", "val_seen")
    assert oracle["summary"]["SR"]["mean"] == 100.0 and idle["summary"]["OS"]["mean"] == 100.0
    assert idle["summary"]["TL"]["mean"] == pytest.approx(0.0, abs=0.05)
    assert [e["episode"] for e in oracle["episodes"]] == ["e0", "e1"]
    rollout = read_rollout(a / "aliengo" / "speed" / "e0.mcap")
    assert rollout.facts["policy"] == "oracle"
    taken = oracle["episodes"][0]["taken"]
    assert taken == [int(span.action) for span in rollout.actions] and taken[-1] == 0
    printed = advised = capsys.readouterr().out
    assert "policy stop drives aliengo (speed)" in printed
    assert "SPL [%]" in printed and "val_seen" in printed
    assert all(f"{name}: " in printed for name in COLUMNS)  # the legend says what each means
    assert max(map(len, printed.split("results:")[0].splitlines())) <= 120
    assert main(["compare", str(a), str(b), "--json"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["common"] == 2 and found["differences"]["TL"]["mean"] < -1.0
    assert found["differences"]["TL"]["low"] is None  # two paths say nothing of others
    assert main(["compare", str(a), str(b)]) == 0
    printed = capsys.readouterr().out
    assert "no interval of fewer than 6 paths" in printed and "nan" not in printed
    assert "warning" not in printed
    # The same names on both sides, but another gait and other instructions.
    for key in ("gait_sha256", "code_sha256", "instructions_sha256"):
        assert len(oracle["setting"][key]) == 64
        oracle["setting"][key] = "0" * 64
    (tmp_path / "results.json").write_text(json.dumps(oracle))
    assert main(["compare", str(a), str(tmp_path)]) == 0
    warned = capsys.readouterr().out
    assert "warning: the robots walked with two gaits" in warned
    assert "warning: the episodes were walked by two versions of vlnpe" in warned
    assert "warning: the episodes have the same names but other instructions" in warned
    # What it advises works, where no environment is active.
    (advice,) = (line for line in advised.splitlines() if " render " in line and str(b) in line)
    program, *words = shlex.split(advice)
    assert shutil.which(program)
    smaller = ["chase:64x48" if word == "chase" else word for word in words]
    assert main([*smaller, "--workers", "1"]) == 0
    assert len(list((b / "films").rglob("*.mp4"))) == 2


TALKER = """
from vlnpe.evaluation.server import serve

class Policy:
    version, said = "v1", ""
    def reset(self, episode):
        assert episode["actions"] == "discrete"
        self.straight = episode["episode_id"] == "e0"
    def act(self, observation):
        assert observation["rgb"].shape == (48, 64, 3)
        self.said = f"step {observation['step']}"
        return 1 if self.straight and observation["step"] < 9 else 0

serve(Policy, port=0)
"""


@pytest.mark.usefixtures("inline")
def test_the_report_has_films_of_each_ending_and_mcap_what_was_seen_and_said(
    run, tmp_path, capsys
) -> None:
    out = tmp_path / "talker"
    with served(TALKER) as url:
        found = evaluated(run, "--policy", url, "--controller", "flash", "--out", str(out),
                          "--camera", "ego:64x48", "--films", "1", "--mcap")  # fmt: skip
    assert found["summary"]["SR"]["mean"] == 100.0
    assert "report.html" in capsys.readouterr().out
    page = (out / "report.html").read_text()
    assert "Successes" in page and "Go through the door." in page
    assert page.count("data:video/mp4;base64,") == 1  # one kind of ending, one film asked for
    (film,) = (out / "films").glob("*.mp4")
    frames = []
    with av.open(str(film)) as container:
        frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
    assert len(frames) >= 3
    height = frames[0].shape[0]
    band = [frame[height - 36 :] for frame in frames]
    assert band[0].max() > 150 and not np.array_equal(band[0], band[-1])  # the action is drawn in
    rollout = read_rollout(out / "aliengo" / "flash" / "e0.mcap")
    said = [event.detail for event in rollout.events if event.kind == "said"]
    assert said == [f"step {k}" for k in range(10)]
    (shown,) = (out / "mcap").rglob("e0.mcap")
    with shown.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        topics = {c.topic for c in summary.channels.values()}
    assert any("rgb" in topic for topic in topics), topics


@pytest.mark.usefixtures("inline")
def test_missing_the_goal_is_a_result_and_no_failure(run, tmp_path, capsys) -> None:
    found = evaluated(run, "--policy", "forward", "--controller", "flash", "--out", str(tmp_path))
    assert found["summary"]["SR"]["mean"] == 0.0
    # It went through the wall and 4 m on; NE is the way back, so that there is a mean.
    assert found["summary"]["NE"]["mean"] > 3.0
    last = capsys.readouterr().err.splitlines()[-1]
    assert "100%" in last and "failed" not in last and "quarantined" not in last


@pytest.mark.usefixtures("inline")
def test_a_second_call_reuses_and_a_seed_does_not(run, tmp_path, capsys) -> None:
    out = ("--policy", "random", "--controller", "flash", "--out", str(tmp_path))
    first = evaluated(run, *out)
    second = evaluated(run, *out)
    assert first == second and "reused 2" in capsys.readouterr().err
    other = evaluated(run, *out, "--seed", "1")
    assert [e["taken"] for e in other["episodes"]] != [e["taken"] for e in first["episodes"]]


@pytest.mark.usefixtures("inline")
def test_the_same_id_in_two_splits_is_two_episodes(run, tmp_path) -> None:
    shutil.copytree(run, tmp_path / "run")
    seen = read_episodes(run / "episodes" / "val.json.gz")
    unseen = [replace(e, split="val_unseen") for e in seen]
    write_episodes(tmp_path / "run" / "episodes" / "unseen.json.gz", unseen)
    out = ("--policy", "stop", "--controller", "flash", "--out", str(tmp_path / "out"))
    found = evaluated(tmp_path / "run", *out)["episodes"]
    assert sorted((e["split"], e["episode"]) for e in found) == [
        (split, name) for split in ("val_seen", "val_unseen") for name in ("e0", "e1")
    ]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--policy", "genius"], "policy 'genius'.*valid: .*random.*ws://"),
        (["--policy", "ramdom"], "policy 'ramdom' .did you mean random.*; valid: "),
        (["--controller", "path"], "'path' does not support discrete.*valid: speed, flash"),
        (["--actions", "waypoints"], "policy random outputs discrete actions"),
        (["--split", "train"], "split 'train'.*valid: .*val_seen"),
        (["--camera", "chase"], "one camera"),
        (["--robot", "h1,g1"], "one robot"),
        (["--policy", "ws://127.0.0.1:9"], "ws://127.0.0.1:9 cannot be reached"),
    ],
)
def test_bad_input_is_refused_in_one_line(run, tmp_path, capsys, options, message) -> None:
    assert main(["evaluate", str(run), "--out", str(tmp_path / "o"), *options]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error) and "Traceback" not in error
    assert not (tmp_path / "o").exists()


SERVER = """
import os
from vlnpe.evaluation.server import serve

class Policy:
    images, version = False, "v1"
    def reset(self, episode):
        self.id = episode["episode_id"]
    def act(self, observation):
        if self.id == "e0" and observation["step"] == 2:
            FAIL
        return 1 if observation["step"] < 4 else 0

serve(Policy, port=0)
"""


@pytest.mark.parametrize(
    ("fail", "lost", "reason"),
    [("raise ValueError('no idea')", 1, "no idea"), ("os._exit(1)", 2, "is gone")],
)
def test_a_server_that_fails_costs_its_episodes_and_no_more(
    run, tmp_path, capsys, fail, lost, reason
) -> None:
    with served(SERVER.replace("FAIL", fail)) as url:
        command = ["evaluate", str(run), "--policy", url, "--controller", "flash"]
        assert main([*command, "--out", str(tmp_path), "--workers", "1"]) == 1
    results = json.loads((tmp_path / "results.json").read_text())
    assert sorted(results["quarantined"]) == [f"aliengo/flash/e{k}" for k in range(lost)]
    assert reason in results["quarantined"]["aliengo/flash/e0"]
    assert [e["taken"] for e in results["episodes"]] == [[1, 1, 1, 1, 0]] * (2 - lost)
    printed = capsys.readouterr().out
    assert f"{lost} episodes without a result" in printed and reason in printed


@pytest.mark.usefixtures("inline")
def test_a_vision_language_model_drives(run, tmp_path, capsys, monkeypatch) -> None:
    answers = ["move forward 50 cm", "Hm.", "stop"]
    monkeypatch.setenv("VLNPE_LLM_MODEL", "scripted")
    with Server(lambda n, request: completion(answers[(n - 1) % 3])).running() as server:
        monkeypatch.setenv("VLNPE_LLM_BASE_URL", server.url)
        found = evaluated(run, "--policy", "vlm", "--controller", "flash", "--camera", "ego:64x48",
                          "--out", str(tmp_path))  # fmt: skip
    assert [e["taken"] for e in found["episodes"]] == [[1, 1, 0]] * 2
    assert "Go through the door." in server.requests[0]["messages"][0]["content"][0]["text"]
    assert "2 answers of the model could not be read" in capsys.readouterr().out
    assert found["setting"]["policy_version"].startswith("vlm scripted t=")


@pytest.mark.usefixtures("inline")
def test_a_vision_language_model_labels_the_map(run, tmp_path, capsys, monkeypatch) -> None:
    things = {"things": [{"name": "flurb", "box": [0, 0, 9, 9]}]}
    monkeypatch.setenv("VLNPE_LLM_MODEL", "scripted")
    call = ("--policy", "map-vlm", "--controller", "flash", "--robot", "vlnce", "--limit", "1",
            "--camera", "ego:64x48", "--out", str(tmp_path))  # fmt: skip
    with Server(lambda n, request: completion("Hm." if n == 1 else things)).running() as server:
        monkeypatch.setenv("VLNPE_LLM_BASE_URL", server.url)
        (episode,) = evaluated(run, *call)["episodes"]
        asked = len(server.requests)
        # One thing in each image; some of them are alike, and answered from the cache.
        assert asked >= 8 and episode["unclear"] == 1 and episode["left_out"] >= asked - 1
        printed = capsys.readouterr().out
        assert "1 answers of the model could not be read" in printed
        left_out = episode["left_out"]
        assert f"{left_out} things that the model named have no known name" in printed
        evaluated(run, *call)
        assert len(server.requests) == asked
        assert main(["evaluate", str(run), *call[:-1], str(tmp_path / "less"), "--workers", "1",
                     "--max-tokens", "600"]) == 1  # fmt: skip
        assert "--max-tokens 600 is reached (600 used)" in capsys.readouterr().out
    used = json.loads((tmp_path / "llm_cache" / "usage.json").read_text())
    assert used["requests"] == asked
    assert main(["verify", str(tmp_path)]) == 0


def test_an_episode_file_needs_its_scenes_and_results_must_be_results(run, tmp_path, capsys):
    file = shutil.copy(run / "episodes" / "val.json.gz", tmp_path / "val.json.gz")
    assert main(["evaluate", str(file)]) == 2
    assert "--scenes" in capsys.readouterr().err
    assert main(["compare", str(tmp_path), str(tmp_path)]) == 2
    assert "no such file; valid: the folder of a `vlnpe evaluate`" in capsys.readouterr().err
    (tmp_path / "results.json").write_text("{}")
    assert main(["compare", str(tmp_path), str(tmp_path)]) == 2
    assert "not results of `vlnpe evaluate`" in capsys.readouterr().err


def test_a_missing_folder_is_reported_before_any_library_is_loaded(tmp_path) -> None:
    code = (
        "import sys; from vlnpe.pipeline.cli import main; code = main(sys.argv[1:])\n"
        "assert code == 2 and 'mujoco' not in sys.modules and 'numpy' not in sys.modules"
    )
    for verb in (["evaluate", "gone"], ["compare", "gone", "too"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *verb], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0 and "gone: no such file or folder" in done.stderr

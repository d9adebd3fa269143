"""`vlnpe dagger`: a policy walks, the expert labels, and the result is a run like any other."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.collectors.test_replay import make_episode
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.core.rollout import Action, EndReason
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.pipeline.cli import main

pytestmark = pytest.mark.usefixtures("inline")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with a scene and two episodes through its door."""
    run = tmp_path_factory.mktemp("dagger") / "run"
    bundle = write_two_rooms(run / "scenes" / "two_rooms")
    paths = [make_episode(bundle, (2.6, 2.0), (5.4, 2.0), name=f"e{k}") for k in range(2)]
    (run / "episodes").mkdir()
    write_episodes(
        run / "episodes" / "train.json.gz",
        [replace(e, split="train", instruction="Go through the door.") for e in paths],
    )
    return run


def walked(run: Path, out: Path, *options: str) -> int:
    robot = ("--robot", "jetbot", "--camera", "ego:32x32", "--workers", "1")
    return main(["dagger", str(run), *robot, "--out", str(out), *options])


def test_labels_are_the_experts_and_actions_the_mixtures(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mixed"
    assert walked(run, out, "--policy", "random", "--beta", "0.6", "--json") == 0
    stages = json.loads(capsys.readouterr().out.splitlines()[-1])["stages"]
    assert stages["replay"]["done"] == stages["export"]["done"] == 2
    for number in range(2):
        rollout = read_rollout(out / "jetbot" / "dagger" / f"e{number}.mcap")
        taken = [span.action for span in rollout.actions]
        assert len(taken) == len(rollout.labels)
        assert taken != list(rollout.labels)
        share = np.mean([a is b for a, b in zip(taken, rollout.labels, strict=True)])
        assert 0.6 < share < 0.95  # the random policy agrees by chance, too
        assert Action.STOP not in rollout.labels[:-1]
        assert rollout.controller == "dagger"
    (data,) = out.glob("lerobot/jetbot-dagger-*/data/**/*.parquet")
    rows = pq.read_table(data, columns=["action.discrete", "episode_index"]).to_pylist()
    first = [row["action.discrete"] for row in rows if row["episode_index"] == 0]
    rollout = read_rollout(out / "jetbot" / "dagger" / "e0.mcap")
    # One frame each 0.25 s, as long as an action takes.
    assert first[: len(rollout.labels) - 1] == [int(a) for a in rollout.labels[:-1]]
    assert main(["verify", str(out)]) in (0, 3)
    capsys.readouterr()
    dataset = data.parents[2]
    pytest.importorskip("torch", reason="the loaders are PyTorch's")
    from vlnpe.datasets.selection import select_all
    from vlnpe.datasets.sequences import EpisodeSequences
    from vlnpe.datasets.tokens import training_tokens

    loaded = EpisodeSequences(select_all([dataset]), training_tokens(["Go through the door."]))[0]
    assert loaded["action"].tolist() == first
    taken = [int(span.action) for span in rollout.actions]
    executed = loaded["previous_action"].tolist()
    assert executed[0] == 0 and executed[1 : len(taken)] == [1 + a for a in taken[:-1]]
    converted = tmp_path / "converted"
    assert main(["convert", str(dataset), "--to", "streamvln", "--out", str(converted)]) == 0
    (records,) = converted.rglob("annotations.json")
    record = json.loads(records.read_text())[0]
    assert record["actions"][1:] == first[:-1]  # of the frames, not of the motion
    # What was done and what was advised survive MCAP and the way back.
    there, back = tmp_path / "mcap", tmp_path / "back"
    assert main(["convert", str(dataset), "--to", "mcap", "--out", str(there)]) == 0
    (files,) = {path.parent for path in there.rglob("*.mcap")}
    assert main(["convert", str(files), "--to", "lerobot", "--out", str(back)]) == 0
    (again,) = back.glob("lerobot/*/data/**/*.parquet")
    columns = ["action.discrete", "action.executed"]
    assert pq.read_table(again, columns=columns) == pq.read_table(data, columns=columns)


def test_an_expert_alone_arrives_and_a_run_is_resumed(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "expert"
    assert walked(run, out, "--policy", "stop", "--beta", "1", "--limit", "1") == 0
    rollout = read_rollout(out / "jetbot" / "dagger" / "e0.mcap")
    assert rollout.end_reason is EndReason.SUCCESS
    assert [span.action for span in rollout.actions] == list(rollout.labels)
    capsys.readouterr()
    assert walked(run, out, "--policy", "stop", "--beta", "1", "--json") == 0
    stages = json.loads(capsys.readouterr().out.splitlines()[-1])["stages"]
    assert stages["replay"]["reused"] == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--beta", "1.5"], "--beta 1.5; valid: 0 to 1"),
        (["--policy", "oracle"], "--policy oracle: valid are"),
        (["--policy", "http://127.0.0.1:9"], "cannot be reached"),
        (["--controller", "path", "--policy", "random"], "does not support discrete actions"),
    ],
)
def test_mistakes_are_one_line(
    run: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    message: str,
) -> None:
    assert walked(run, tmp_path / "none", *options) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "none").exists()

"""Publishing an environment, and running it as LeRobot does with one from the hub."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.collectors.test_replay import make_episode
from tests.pipeline.commands.test_hub import environment, last_json, run
from tests.pipeline.commands.test_push import FakeHub
from tests.support.hub import TOKEN, running_hub
from tests.support.lerobot_data import write_units
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.core.errors import InputError, VlnpeError
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.formats.scene.bundle import SceneBundle, save_bundle
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.pipeline.commands.push import Push, run_push

REPO = "someone/rooms-env"
VIEW = "ego-96x64-90deg-baked"


class KeepingHub(FakeHub):
    """Keeps what is uploaded, as the hub would: links become files."""

    def __init__(self, folder: Path):
        super().__init__()
        self.folder = folder

    def upload_folder(self, **options: Any) -> Any:
        assert options["repo_type"] == "model"
        for name in options["allow_patterns"]:
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(Path(options["folder_path"]) / name, self.folder / name)
        return super().upload_folder(**options)


def write_run(run: Path, licence: str) -> Path:
    """Write a run with a scene, two splits and a dataset; return the dataset."""
    bundle: SceneBundle = write_two_rooms(run / "scenes" / "two_rooms")
    bundle = replace(bundle, source={**bundle.source, "licence": licence})
    save_bundle(
        bundle, bundle.visual(), [(bundle.floor(0), bundle.obstacles(0), bundle.freemap(0))]
    )
    (run / "episodes").mkdir()
    for split in ("train", "val_unseen"):
        episode = make_episode(bundle, (5.0, 2.0), (6.6, 2.6), name=split)
        named = replace(episode, split=split, instruction=f"Go, {split}.")
        write_episodes(run / "episodes" / f"{split}.json.gz", [named])
    (run / "units").mkdir()
    dataset = run / "lerobot" / f"aliengo-path-{VIEW}"
    provenance = {"scenes": {"two_rooms": {"licence": licence}}, "encoding": {"view": VIEW}}
    units = write_units(run / "units", (0.5,))
    assemble_dataset(units, dataset, provenance=provenance, licence="mit", title="Rooms")
    return dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("env") / "run", "MIT")


def test_a_dry_run_shows_the_environment(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hub = FakeHub()
    assert run_push(Push(dataset, REPO, env="val_unseen"), hub) == 0
    shown = capsys.readouterr().out
    assert f"repository  {REPO}\n" in shown and hub.calls == []
    for word in ("env.py", "episodes.json.gz", "scenes/two_rooms/scene.json", 'license: "mit"'):
        assert word in shown
    assert "observation.images" not in shown


def test_the_hubs_copy_runs_in_lerobot(dataset: Path, tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip("lerobot")
    from lerobot.envs import factory

    snapshot = tmp_path / "cache" / "c0ffee"
    hub = KeepingHub(snapshot)
    assert run_push(Push(dataset, REPO, env="val_unseen", tag="one", yes=True), hub) == 0
    assert hub.names() == ["create_repo", "upload_folder", "create_tag"]
    assert not any(path.is_symlink() for path in snapshot.rglob("*"))
    code = snapshot.with_name("alone") / "env.py"
    code.parent.mkdir()
    shutil.copyfile(snapshot / "env.py", code)
    asked = []

    def snapshot_download(repo: str, revision: str) -> str:
        asked.append((repo, revision))
        return str(snapshot)

    # LeRobot downloads env.py alone; the environment fetches the rest of the same commit.
    monkeypatch.setattr("huggingface_hub.snapshot_download", snapshot_download)
    for file in (snapshot / "env.py", code):
        monkeypatch.setattr(factory, "_download_hub_file", lambda *_, f=file: (REPO, f.name, f, ""))
        environments = factory.make_env(REPO, n_envs=2, trust_remote_code=True)
        vector: Any = environments["vlnpe"][0]
        seen, _ = vector.reset(seed=[0, 1])
        assert seen["pixels"]["rgb"].shape == (2, 64, 96, 3)
        assert vector.call("task_description") == ("Go, val_unseen.",) * 2
        vector.step(np.zeros((2, 3), np.float32))
        _, _, over, _, info = vector.step(np.zeros((2, 3), np.float32))
        assert over.all() and info["final_info"]["is_success"].all()
        vector.close()
    assert asked == [(REPO, "alone")]


STEP = """
import json
import numpy as np
from lerobot.envs import make_env

(vector,) = make_env("someone/rooms-env", n_envs=2, trust_remote_code=True)["vlnpe"].values()
vector.reset(seed=[0, 1])
for _ in range(2):
    _, _, over, _, info = vector.step(np.zeros((2, 3), np.float32))
vector.close()
print(json.dumps({"over": over.tolist(), "success": info["final_info"]["is_success"].tolist()}))
"""


@pytest.mark.slow
def test_it_is_published_and_run_over_http(dataset: Path, tmp_path: Path) -> None:
    pytest.importorskip("lerobot")
    with running_hub() as hub:
        push = ["push", str(dataset), "--repo", REPO, "--env", "val_unseen", "--yes", "--json"]
        given = environment(hub, tmp_path / "a", TOKEN)
        release = last_json(run(["-m", "vlnpe.pipeline.cli", *push], given))
        assert release["url"] == f"{hub.url}/{REPO}/tree/{release['tag']}"
        assert set(hub.repos[REPO].tags) == {release["tag"]}
        done = last_json(run(["-c", STEP], environment(hub, tmp_path / "b", None)))
        assert done == {"over": [True, True], "success": [True, True]}
        assert hub.unknown == []


@pytest.mark.parametrize(
    ("split", "change", "message"),
    [
        ("val", {}, "split 'val'.*val_unseen"),
        ("train", {"view": "top-96x64-50deg-baked"}, "or of a rig"),
        ("train", {"view": "chase-96x64-75deg-baked"}, "robot's own camera"),
    ],
)
def test_what_is_no_environment_is_said(
    dataset: Path, split: str, change: dict[str, str], message: str
) -> None:
    path = dataset / "meta" / "provenance.json"
    before = path.read_text()
    value = json.loads(before)
    path.write_text(json.dumps(value | {"encoding": value["encoding"] | change}))
    try:
        with pytest.raises(VlnpeError, match=message):
            run_push(Push(dataset, REPO, env=split), FakeHub())
    finally:
        path.write_text(before)


def test_a_scenes_licence_forbids_it(tmp_path: Path) -> None:
    dataset, hub = write_run(tmp_path / "run", "CC-BY-ND-4.0"), FakeHub()
    with pytest.raises(InputError, match="licence"):
        run_push(Push(dataset, REPO, env="train", yes=True), hub)
    assert hub.calls == []

"""`sample`, `align` and `filter` as a user calls them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike
from PIL import Image

from tests.pipeline.commands.test_bad_input import room, write_mesh
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.frames import world_to_habitat_position
from vlnpe.formats.core.geometry import point_along
from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.formats.vlnce.files import (
    VlnceEpisode,
    VlnceFile,
    VlnceGoal,
    read_episodes,
    read_vlnce,
    write_vlnce,
)
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.inputs.sampling_plan import sample_config
from vlnpe.pipeline.stages.rollouts.replay_items import item_names

pytestmark = pytest.mark.usefixtures("inline")

COMMON = ("--min-length-m", "4", "--min-gap-m", "0.8", "--family-gap-m", "1.0")


@pytest.fixture(scope="module")
def scenes(two_rooms, tmp_path_factory) -> Path:
    """Three scenes that are alike."""
    root = tmp_path_factory.mktemp("scenes")
    for name in ("a", "b", "c"):
        shutil.copytree(two_rooms.root, root / name)
        index = root / name / "scene.json"
        index.write_text(index.read_text().replace('"two_rooms"', f'"{name}"'))
    return root


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict]:
    code = main([str(a) for a in (*arguments, "--json")])
    return code, json.loads(capsys.readouterr().out.splitlines()[-1])


def test_splits_over_several_scenes_are_exact_and_reused(scenes, tmp_path, capsys):
    call = ("sample", scenes, "--splits", "train=5,val_seen=2,val_unseen=3", *COMMON)
    out = tmp_path / "mine"
    code, result = run(capsys, *call, "--out", out)
    assert code == 0
    assert result["splits"] == {"train": 5, "val_seen": 2, "val_unseen": 3}
    found = {path.name: read_episodes(path) for path in out.glob("*.json.gz")}
    assert {name: len(episodes) for name, episodes in found.items()} == {
        "train.json.gz": 5, "val_seen.json.gz": 2, "val_unseen.json.gz": 3,
    }  # fmt: skip
    rooms = {name: {e.scene_id for e in episodes} for name, episodes in found.items()}
    assert rooms["val_seen.json.gz"] <= rooms["train.json.gz"]
    assert not rooms["val_unseen.json.gz"] & rooms["train.json.gz"]
    before = {path: path.read_bytes() for path in out.glob("*.json.gz")}
    run(capsys, *call, "--out", out)
    assert {path: path.read_bytes() for path in out.glob("*.json.gz")} == before


def test_scenes_go_by_the_names_of_their_folders(two_rooms, tmp_path, capsys):
    """As later stages look them up; every generated building's file is called scan.glb."""
    for name in ("flat-1", "flat-2"):
        shutil.copytree(two_rooms.root, tmp_path / "scenes" / name)
    out = tmp_path / "episodes.json.gz"
    call = ("sample", tmp_path / "scenes", "--count", 2, "--min-length-m", 4, "--out", out)
    assert run(capsys, *call)[0] == 0
    episodes = read_episodes(out)
    assert {e.scene_id for e in episodes} == {"flat-1", "flat-2"}
    assert all(e.episode_id.startswith(e.scene_id) for e in episodes)
    assert all(e.extra["similarity_group"].startswith(e.scene_id) for e in episodes)


def test_pictures_show_every_path_on_free_floor(scenes, tmp_path, capsys):
    out, pictures = tmp_path / "one.json.gz", tmp_path / "pictures"
    call = ("sample", scenes / "a", "--count", 4, *COMMON, "--out", out, "--pictures", pictures)
    code, result = run(capsys, *call)
    assert code == 0
    assert result["pictures"] == [str(pictures / "a-0.png")]
    freemap = load_bundle(scenes / "a").freemap(0)
    image = np.asarray(Image.open(pictures / "a-0.png").convert("RGB")).astype(int)
    px_per_m = image.shape[1] / (freemap.grid.columns * freemap.grid.cell_m)
    left_m, low_m = freemap.grid.origin_xy_m
    colored = np.ptp(image, axis=2) > 60  # the map is grey
    for episode in read_episodes(out):
        along = np.linspace(0, episode.reference_length_m, 50)
        xy = point_along(episode.reference_path_world_m, along)[:, :2]
        column = ((xy[:, 0] - left_m) * px_per_m).astype(int)
        row = (image.shape[0] - (xy[:, 1] - low_m) * px_per_m).astype(int)
        assert colored[row, column].mean() > 0.9
    # Nothing is drawn off the walkable floor.
    rows, columns = np.nonzero(colored)
    xy = np.stack([columns / px_per_m + left_m, (image.shape[0] - rows) / px_per_m + low_m], -1)
    assert freemap.traversable[tuple(freemap.grid.cell_of(xy).T)].mean() > 0.99


@pytest.mark.chain
def test_a_repaired_scene_has_its_folder_s_name(tmp_path, capsys):
    write_mesh(tmp_path / "scan.glb", room(1.0))
    run(capsys, "repair", tmp_path / "scan.glb", "--out", tmp_path / "flat-1")
    assert load_bundle(tmp_path / "flat-1").scene_id == "flat-1"


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the search for paths end after fewer tries: a shortage costs as many as it has."""

    def config(*arguments, **options):
        return replace(sample_config(*arguments, **options), patience=4)

    monkeypatch.setattr("vlnpe.pipeline.commands.episodes.sample_config", config)


@pytest.mark.chain
@pytest.mark.usefixtures("impatient")
def test_fewer_paths_can_be_allowed(scenes, tmp_path, capsys, caplog):
    sizes = ("--splits", "train=8,val_unseen=2", "--train-scenes", "1", "--min-length-m", "4")
    call = ("sample", scenes / "a", scenes / "b", *sizes, "--min-gap-m", "2", "--allow-fewer")
    code, result = run(capsys, *call, "--out", tmp_path / "mine")
    assert code == 0
    assert 0 < result["splits"]["train"] < 8
    assert result["splits"]["val_unseen"] == 2
    assert "of 8 paths" in caplog.text
    (path, _) = sorted((tmp_path / "mine").glob("*.json.gz"))
    assert {e.scene_id for e in read_episodes(path)} == {"a"}
    assert main([str(a) for a in ("sample", scenes / "a", "--allow-fewer")]) == 2
    assert "needs --splits" in capsys.readouterr().err


@pytest.mark.chain
@pytest.mark.usefixtures("impatient")
def test_a_shortage_of_paths_is_reported_with_advice_that_works(scenes, tmp_path, capsys):
    call = ["sample", scenes / "a", "--splits", "train=8", "--min-length-m", "4"]
    out = tmp_path / "mine"
    assert main([str(a) for a in (*call, "--min-gap-m", "2", "--out", out)]) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert "a holds" in error
    assert "of 8 paths that differ by 2 m" in error
    assert not list(out.glob("*.json.gz"))
    gap = error.split("--min-gap-m ")[1].split()[0].rstrip(".;")
    code, result = run(capsys, *call, "--min-gap-m", gap, "--out", out)
    assert (code, result["splits"]) == (0, {"train": 8})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--preset", "gru_vln10"], "needs 10 scenes, not 3"),
        (["--preset", "gru"], "lab_3dgs"),
        (["--quota", "a=3"], "needs --splits"),
        (["--splits", "train=4", "--quota", "z=3"], "'z'"),
        (["--similarity", "cosine"], "dtw"),
        (["--splits", "train=4", "--out", "x.json.gz"], "valid: a folder"),
        (["--storeys", "up"], "valid: cross, mixed, no"),
        (["--storeys", "mixed", "--robot", "aliengo,h1"], "h1 cannot climb stairs; valid: aliengo"),
        (["--storeys", "cross", "--robot", "aliengo"], "needs a staircase; the scene has 1 level"),
    ],
)
def test_bad_options_are_refused(scenes, options, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["sample", str(scenes), *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


PATH = np.array([(1.0, 1.0, 0.0), (2.0, 2.0, 0.0), (4.0, 2.0, 0.0), (6.5, 2.0, 0.0)])


def vlnce_episode(scene: str, number: int, points: ArrayLike = PATH) -> VlnceEpisode:
    path = world_to_habitat_position(np.asarray(points, dtype=float))
    return VlnceEpisode(
        episode_id=number,
        trajectory_id=number // 3,
        scene_id=f"mp3d/{scene}/{scene}.glb",
        start_position_habitat_m=path[0],
        start_rotation_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        instruction_text=f"Text {number}.",
        instruction_tokens=None,
        goals=(VlnceGoal(path[-1], 3.0),),
        reference_path_habitat_m=path,
    )


def test_files_of_several_splits_are_filtered_and_aligned(scenes, tmp_path, capsys):
    climbing = [(1.0, 1.0, 0.0), (2.0, 1.0, 0.5), (6.5, 2.0, 0.5)]
    for split, scene in (("train", "a"), ("val_unseen", "b")):
        episodes = (*(vlnce_episode(scene, k) for k in range(3)), vlnce_episode(scene, 4, climbing))
        write_vlnce(tmp_path / f"{split}.json.gz", VlnceFile(Path("x"), episodes))
    files = [tmp_path / f"{split}.json.gz" for split in ("train", "val_unseen")]
    code, filtered = run(capsys, "filter", *files, "--out", tmp_path / "kept")
    assert (code, filtered["kept"], filtered["dropped"]) == (0, 6, 2)
    assert filtered["splits"]["train"]["counts"]["dropped"] == [1, 1]
    assert filtered["splits"]["train"]["counts"]["kept"] == [3, 1]
    kept = sorted((tmp_path / "kept").glob("*.json.gz"))
    assert [len(read_vlnce(path).episodes) for path in kept] == [3, 3]
    call = ("align", *kept, "--scenes", scenes, "--robot", "aliengo", "--out", tmp_path / "al")
    code, aligned = run(capsys, *call)
    assert code == 0
    assert (aligned["episodes"], aligned["paths"], aligned["instructions"]) == (6, 2, 6)
    assert aligned["robot_radius_m"] > 0.2
    found = read_episodes(tmp_path / "al" / "val_unseen.json.gz")
    assert [(e.episode_id, e.split) for e in found] == [
        (str(k), "val_unseen") for k in range(3)
    ]  # fmt: skip
    # Ids that two splits use name different walks.
    train = read_episodes(tmp_path / "al" / "train.json.gz")
    assert item_names([train[0], found[0], replace(train[1], episode_id="x")]) == [
        "train-0", "val_unseen-0", "x",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--keep-climbable"], "name them with --robot"),
        (["--keep-climbable", "--robot", "jetbot"], "jetbot cannot climb stairs; valid: aliengo"),
        (["--keep-climbable", "--robot", "aliengo"], "needs repaired scenes (--scenes)"),
        (["--robot", "aliengo"], "--keep-climbable keeps"),
    ],
)
def test_what_cannot_be_kept_for_climbers_is_refused(options, words, capsys, tmp_path):
    source = tmp_path / "val.json.gz"
    write_vlnce(source, VlnceFile(source, (vlnce_episode("a", 1),)))
    assert main(["filter", str(source), "--out", str(tmp_path / "kept.json.gz"), *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "kept.json.gz").exists()


@pytest.mark.parametrize("given", [".", "a"], ids=["folder of scenes", "scene itself"])
def test_a_bad_episode_is_counted_as_rejected(scenes, given, tmp_path, capsys):
    file = VlnceFile(Path("x"), (vlnce_episode("a", 0), vlnce_episode("a", 1)))
    write_vlnce(tmp_path / "val.json", file)
    document = json.loads((tmp_path / "val.json").read_text())
    del document["episodes"][1]["start_rotation"]
    (tmp_path / "val.json").write_text(json.dumps(document))
    out = tmp_path / "out.json"
    call = ("align", tmp_path / "val.json", "--scenes", scenes / given, "--out", out)
    code, aligned = run(capsys, *call)
    assert (code, aligned["episodes"]) == (1, 1)
    assert [episode.scene_id for episode in read_episodes(out)] == ["a"]
    assert aligned["rejected"] == [
        ["1 (number 1)", "start_rotation must be 4 finite numbers, is None"]
    ]
    assert run(capsys, *call, "--max-failed", 1)[0] == 0


def test_no_scene_is_an_error():
    from vlnpe.pipeline.commands.episodes import run_sample
    from vlnpe.pipeline.options.episodes import Sample

    with pytest.raises(InputError, match="no scene"):
        run_sample(Sample())

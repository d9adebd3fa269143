"""`vlnpe convert` into the layouts of trainers."""

import errno
import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.formats.trainers.scene import FALLEN, make_unit
from tests.support.runs.tiny_run import TINY, write_scan
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.formats.trainers import subset as subset_module
from vlnpe.formats.trainers.registry import LAYOUTS
from vlnpe.formats.trainers.subset import SIDECAR_NAME
from vlnpe.pipeline import cli


def make_run(root: Path) -> Path:
    """A run of two robots: three walks in two scenes each, one of which validates, and a fall."""
    for robot in ("dog", "man"):
        units = []
        for number in range(4):
            place = {"scene_id": f"home-{number // 2}", "trajectory_id": f"path-{number}"}
            changes: dict[str, Any] = FALLEN if number == 1 else {}
            made = make_unit(
                root / robot, number, seconds=6.0 + number, robot=robot, episode=place, **changes
            )
            units.append(made)
        assemble_dataset(
            units,
            root / "run" / "lerobot" / f"{robot}-path-front",
            provenance={"held_out_scenes": ["home-1"]},
            licence="cc-by-4.0",
            title=robot,
        )
    return root / "run"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("run")
    for robot in ("dog", "man"):
        (root / robot).mkdir()
    return make_run(root)


def convert(source: Path, name: str, out: Path, *more: str) -> int:
    return cli.main(["convert", str(source), "--to", name, "--out", str(out), *more])


def read(path: Path) -> list[dict[str, Any]]:
    return json.loads(path.read_text())


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_run_becomes_subsets_by_robot_and_split(
    name: str, run: Path, tmp_path: Path, inline: None, capfd: pytest.CaptureFixture[str]
) -> None:
    assert convert(run, name, tmp_path) == 0
    made = sorted(str(path.relative_to(tmp_path / name)) for path in tmp_path.glob(f"{name}/*/*"))
    assert made == [f"{s}/{r}-path-front" for s in ("train", "val") for r in ("dog", "man")]
    lines = [
        json.loads(line)
        for path in (tmp_path / name).rglob(SIDECAR_NAME)
        for line in path.read_text().splitlines()
    ]
    assert len(lines) == 6 and {line["end_reason"] for line in lines} == {"success"}
    assert {(x["split"], x["scene_id"]) for x in lines} == {("train", "home-0"), ("val", "home-1")}
    assert len({line["key"] for line in lines}) == 6
    readme = next((tmp_path / name / "train" / "dog-path-front").rglob("README.md")).read_text()
    assert "left out: 1 fall" in readme and "cc-by-4.0" in readme
    said = capfd.readouterr().out
    assert (f"{name} train/dog-path-front, answers:" in said) == (name != "navdp")
    assert cli.main(["verify", str(tmp_path)]) == 0
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / name).rglob("*") if p.is_file()}
    assert convert(run, name, tmp_path) == 0  # nothing is written again
    assert before == {p: p.stat().st_mtime_ns for p in (tmp_path / name).rglob("*") if p.is_file()}


def test_the_rigs_of_a_walk_share_a_tree_where_the_layout_has_rigs(
    tmp_path: Path, inline: None, capfd: pytest.CaptureFixture[str]
) -> None:
    """An episode that a rig lacks is left out; one robot's own camera stays apart."""
    out = tmp_path / "out"
    for camera, count in (("ego", 3), ("rig:125cm_0deg", 3), ("rig:125cm_30deg", 2)):
        name = camera.replace(":", "-")
        (tmp_path / name).mkdir()
        units = [
            make_unit(
                tmp_path / name,
                number,
                camera_name=camera,
                episode={"episode_id": str(number), "trajectory_id": f"path-{number}"},
            )
            for number in range(count)
        ]
        folder = tmp_path / "run" / "lerobot" / f"dog-path-{name}-96x64-90deg-baked"
        assemble_dataset(units, folder, provenance={}, licence="mit", title=name)
    assert convert(tmp_path / "run", "internvla-n1", out) == 0
    train = out / "internvla-n1" / "train"
    names = ["dog-path-ego-96x64-90deg-baked", "dog-path-rigs-96x64-90deg-baked"]
    assert sorted(path.name for path in train.iterdir()) == names
    (scene,) = (train / names[1]).iterdir()
    videos = sorted(path.name[19:] for path in (scene / "videos" / "chunk-000").iterdir())
    settings = ["125cm_0deg", "125cm_30deg"]
    assert videos == [f"{kind}.{s}" for kind in ("depth", "rgb") for s in settings]
    lines = (scene / SIDECAR_NAME).read_text().splitlines()
    assert len(lines) == 2
    assert json.loads(lines[0])["camera_name"] == "rig:125cm_0deg,rig:125cm_30deg"
    assert "left out: 1 without all 2 rigs" in (scene / "README.md").read_text()
    assert convert(tmp_path / "run", "navdp", out) == 0
    assert len(list((out / "navdp" / "train").iterdir())) == 3
    assert cli.main(["verify", str(out)]) == 0


def test_balance_is_for_training_and_can_be_chosen(run: Path, tmp_path: Path, inline: None) -> None:
    counts = {}
    for balance in ("natural", "navila", "forward=1,left=1,right=1,stop=3"):
        assert convert(run, "navila", tmp_path, "--balance", balance) == 0
        folders = (tmp_path / "navila" / split / "dog-path-front" for split in ("train", "val"))
        counts[balance] = [len(read(folder / "annotations.json")) for folder in folders]
    train, held_out = zip(*counts.values(), strict=True)
    assert train[0] < train[1] < train[2] and len(set(held_out)) == 1
    records = read(tmp_path / "navila" / "train" / "dog-path-front" / "annotations.json")
    assert len({r["video_id"] for r in records}) == len(records)


@pytest.mark.parametrize("name", [n for n, layout in LAYOUTS.items() if layout.endings])
def test_failures_are_written_where_their_end_is_said(
    name: str, run: Path, tmp_path: Path, inline: None
) -> None:
    assert convert(run, name, tmp_path, "--keep-failures") == 0
    lines = [
        json.loads(line)["end_reason"]
        for path in (tmp_path / name).rglob("episodes.jsonl")
        for line in path.read_text().splitlines()
    ]
    assert sorted(lines) == ["fall"] * 2 + ["success"] * 6


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (["--to", "navilla"], "did you mean navila?"),
        (["--to", "navila", "--balance", "even"], "unknown balance 'even'"),
        (["--to", "streamvln", "--balance", "navila"], "valid: natural, or one of the layouts nav"),
        (["--to", "mcap", "--balance", "navila"], "records of mcap are whole episodes"),
        (["--to", "navila", "--keep-failures"], "valid: internvla-n1, navdp"),
        (["--to", "mcap", "--keep-failures"], "mcap has no field"),
        (["--to", "lerobot", "--from", "streamvln"], "lacks the robot's poses"),
        (["--to", "lerobot", "--from", "navdp"], "cannot be converted back"),
        (["--to", "mcap", "--from", "n1"], "has the format lerobot"),
        (["--to", "mcap", "--from", "bag"], "unknown --from 'bag'"),
    ],
)
def test_mistakes_are_one_line(
    call: list[str], said: str, run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["convert", str(run), *call, "--out", str(tmp_path / "out")]) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert said in line and not (tmp_path / "out").exists()


def test_what_was_written_is_not_converted_back(
    run: Path, tmp_path: Path, inline: None, capfd: pytest.CaptureFixture[str]
) -> None:
    assert convert(run, "navila", tmp_path) == 0
    capfd.readouterr()
    assert convert(tmp_path / "navila" / "train" / "dog-path-front", "mcap", tmp_path / "back") == 2
    assert "lacks the robot's poses" in capfd.readouterr().err


def test_a_full_disk_leaves_nothing_that_looks_finished(
    run: Path,
    tmp_path: Path,
    inline: None,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(subset_module, "write_array", full)
        assert convert(run, "navila", tmp_path) != 0
    assert not [path for path in (tmp_path / "navila").rglob("*") if path.is_file()]
    assert "written to" not in capfd.readouterr().out
    assert convert(run, "navila", tmp_path) == 0
    assert (tmp_path / "navila" / "train" / "dog-path-front" / "README.md").is_file()


def test_what_a_layout_needs_is_named_with_the_command(
    tmp_path: Path, inline: None, capfd: pytest.CaptureFixture[str]
) -> None:
    unit = make_unit(tmp_path, rate=2)
    assemble_dataset([unit], tmp_path / "slow", provenance={}, licence="mit", title="Slow")
    assert convert(tmp_path / "slow", "navila", tmp_path / "out") == 2
    assert "2 frames/s, too few" in (said := capfd.readouterr().err)
    assert "vlnpe collect … --frames-per-second 4" in said
    info = tmp_path / "slow" / "meta" / "info.json"
    facts = json.loads(info.read_text())
    del facts["features"]["observation.images.depth"]
    info.write_text(json.dumps(facts))
    assert convert(tmp_path / "slow", "navdp", tmp_path / "more") == 2
    said = capfd.readouterr().err
    assert "lacks observation.images.depth" in said and "vlnpe export" in said


def test_a_path_in_two_splits_is_refused(
    tmp_path: Path, inline: None, capfd: pytest.CaptureFixture[str]
) -> None:
    units = [
        make_unit(tmp_path, number, episode={"trajectory_id": "one", "split": split})
        for number, split in enumerate(("train", "val_unseen"))
    ]
    assemble_dataset(units, tmp_path / "set", provenance={}, licence="mit", title="Set")
    assert convert(tmp_path / "set", "streamvln", tmp_path / "out") == 2
    assert "is in the splits train and val_unseen" in capfd.readouterr().err


def test_failures_alone_give_nothing(tmp_path: Path, inline: None) -> None:
    unit = make_unit(tmp_path, **FALLEN)
    assemble_dataset([unit], tmp_path / "set", provenance={}, licence="mit", title="Set")
    assert convert(tmp_path / "set", "streamvln", tmp_path / "out") == 1
    assert not (tmp_path / "out" / "streamvln").exists()


@pytest.mark.chain
def test_collect_writes_layouts_and_shows_their_answers(tmp_path: Path, inline: None) -> None:
    scan, run, out = write_scan(tmp_path / "scan.glb"), tmp_path / "run", tmp_path / "out"
    call = ["collect", "--scene", str(scan), *TINY, "--out", str(run), "--no-mcap"]
    assert cli.main([*call, "--also", "navila,streamvln"]) == 0
    page = (run / "report" / "index.html").read_text()
    for name in ("navila", "streamvln"):
        assert convert(run, name, out) == 0
        (own,) = run.glob(f"{name}/train/*")
        assert {p.name for p in own.iterdir()} == {
            p.name for p in (out / own.relative_to(run)).iterdir()
        }
        readme = (own / "README.md").read_text()
        assert readme == (out / own.relative_to(run) / "README.md").read_text()
        rows = re.findall(r"\| (\w+) \| (\d+) \| (\d+) \|", readme)
        assert rows and all(f'data-label="{k}">{a} → {b}<' in page for k, a, b in rows)
    assert cli.main(["verify", str(run)]) == 0
    assert cli.main(call) == 0  # without the option the report leaves them out
    assert "Layouts of trainers" in page
    assert "Layouts of trainers" not in (run / "report" / "index.html").read_text()


def test_an_unknown_layout_of_collect_is_refused(capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["collect", "--also", "navila,stream"]) == 2
    assert "unknown layout 'stream'" in capfd.readouterr().err

"""`vlnpe verify`: whatever happens to a file of a run is found and named."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.runs import tiny_run
from tests.support.runs.flips import flipped
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.engine.ledger import JOURNAL_NAME, MANIFEST_NAME, Ledger, Row
from vlnpe.pipeline.verify.dataset import check_dataset, check_splits
from vlnpe.pipeline.verify.integrity import Check
from vlnpe.pipeline.verify.outputs import READERS, check_output
from vlnpe.pipeline.verify.run import remedy, verify_run

pytestmark = pytest.mark.chain

QUICK = pytest.mark.usefixtures("quick")


def problems(root: Path) -> dict[str, str]:
    return {check.what: check.problem for check in verify_run(root) if check.problem}


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what probes the floor of a scene for seconds."""
    monkeypatch.setitem(READERS, "repair", load_bundle)


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    """A copy of the run that may be damaged."""
    return shutil.copytree(finished, tmp_path / "run")


def test_a_sound_run_passes_and_the_command_reports_it(run: Path, capsys) -> None:
    assert main(["verify", str(run)]) == 0
    assert "bad: 0" in capsys.readouterr().out


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_flipped_byte_in_any_file_is_found_and_named(run: Path, seed: int, capsys):
    # Of a damaged manifest nothing in it can be believed: it is damaged below, alone.
    with flipped(run, np.random.default_rng(seed), spare=(MANIFEST_NAME,)) as damaged:
        names = {path.relative_to(run).as_posix() for path in damaged}
        assert len(names) > 45 and "quarantine.json" in names
        assert main(["verify", str(run)]) == 1
        output = capsys.readouterr().out
    assert {name for name in names if f"BAD  {name}: " not in output} == set()


def test_a_flipped_byte_in_the_manifest_is_found(finished: Path, tmp_path: Path):
    sound = (finished / MANIFEST_NAME).read_bytes()
    rng = np.random.default_rng(4)
    # Its first bytes tell where the rest is.
    for place in [*range(100), *rng.integers(len(sound), size=200)]:
        content = bytearray(sound)
        content[int(place)] ^= int(rng.integers(1, 256))
        (tmp_path / MANIFEST_NAME).write_bytes(content)
        assert list(problems(tmp_path)) == [MANIFEST_NAME]
        with pytest.raises(FileFormatError, match=MANIFEST_NAME):
            Ledger(tmp_path)


@QUICK
def test_the_advice_for_an_edited_manifest_works(run: Path):
    path = run / MANIFEST_NAME
    path.write_text(path.read_text().replace('"seconds"', '"seconds" ', 1))
    assert "delete its second line" in problems(run)[MANIFEST_NAME]
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:1] + lines[2:]))
    assert problems(run) == {}


@QUICK
def test_missing_and_unknown_files_and_those_of_killed_processes_are_named(run: Path):
    gone = next((run / "units").rglob("rows.parquet"))
    gone.unlink()
    (run / "notes.txt").write_text("mine")
    left = run / "rollouts" / ".vlnpe-tmp-e.abcdefgh.mcap"
    left.write_bytes(b"half")
    found = problems(run)
    assert found.pop(str(gone.relative_to(run))) == "missing"
    assert "not in the manifest" in found.pop("notes.txt")
    assert "killed" in found.pop(str(left.relative_to(run)))
    assert found == {}


@QUICK
def test_the_advice_for_damaged_files_works(run: Path, scan: Path, capsys):
    def one(pattern: str) -> Path:
        return next(run.glob(pattern))

    one("lerobot/*/meta/stats.json").write_text("{}")  # a later stage reads none of these
    one("lerobot/*/videos/*depth/*/*.mp4").unlink()
    one("models/*.mjb").unlink()
    changed = one("frames/*/*/*/*/frames.npz")
    content = bytearray(changed.read_bytes())
    content[len(content) // 2] ^= 1
    changed.write_bytes(content)
    assert main(["verify", str(run)]) == 1
    assert "to repair the run: delete the damaged files, then run the command that made them" in (
        capsys.readouterr().out
    )
    assert main(["verify", str(run), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["remedy"].startswith("to repair the run: delete") and len(found["problems"]) == 4
    changed.unlink()
    done = tiny_run.collect(scan, run)  # a changed size is noticed, a flipped byte is not
    assert done.returncode == 0, done.stderr[-2000:]
    assert main(["verify", str(run)]) == 0
    assert "to repair the run" not in capsys.readouterr().out


@QUICK
def test_a_run_of_an_older_version_is_explained_and_does_not_pass(run: Path, capsys):
    path = run / MANIFEST_NAME
    old = {"rows": json.loads(path.read_text())["rows"]}
    path.write_text(json.dumps(old, indent=2, sort_keys=True) + "\n")
    assert main(["verify", str(run)]) == 1
    output = capsys.readouterr().out
    assert "written by a version that kept no hashes" in output and "bad: 1\n" in output
    # Whatever its readers make of damage, they never end the command.
    for seed in range(3):
        with flipped(run, np.random.default_rng(seed), spare=(MANIFEST_NAME,)):
            assert main(["verify", str(run)]) == 1
            assert "outputs checked" in capsys.readouterr().out


@QUICK
def test_a_damaged_line_of_the_journal_is_named_and_its_item_runs_again(run: Path):
    ledger = Ledger(run)
    ledger.add(Row("extra", "one", "k", "done"))
    ledger.add(Row("extra", "two", "k", "done"))
    assert problems(run) == {}
    journal = run / JOURNAL_NAME
    content = bytearray(journal.read_bytes())
    content[content.index(b"one")] ^= 1
    journal.write_bytes(content)
    assert list(problems(run)) == [f"{JOURNAL_NAME}, line 1"]
    again = Ledger(run)
    assert again.row("extra", "one") is None and again.row("extra", "two") is not None


def test_every_stage_with_outputs_has_a_reader_or_needs_none(finished: Path):
    without = {row.stage for row in Ledger(finished).rows() if row.outputs} - set(READERS)
    assert without == {"soundness", "pictures", "report"}  # hashed only


@pytest.mark.parametrize("name", ["visual", "levels/0/floor", "levels/0/obstacles",
                                  "levels/0/freemap"])  # fmt: skip
def test_damaged_arrays_of_a_scene_are_named_in_a_typed_error(tmp_path: Path, name: str):
    bundle = write_two_rooms(tmp_path)
    path = tmp_path / f"{name}.npz"
    sound = path.read_bytes()
    rng = np.random.default_rng(5)
    read: Callable[[], object] = {
        "visual": bundle.visual,
        "levels/0/floor": lambda: bundle.floor(0),
        "levels/0/obstacles": lambda: bundle.obstacles(0),
        "levels/0/freemap": lambda: bundle.freemap(0),
    }[name]
    refused = 0
    for _ in range(60):
        content = bytearray(sound)
        content[int(rng.integers(len(content)))] ^= int(rng.integers(1, 256))
        path.write_bytes(content)
        try:
            read()
        except FileFormatError as error:
            refused += 1
            assert error.path == path
    assert refused > 30
    path.write_bytes(sound[: len(sound) // 2])
    with pytest.raises(FileFormatError, match=path.name):
        read()
    # Nor does a damaged index raise anything else.
    (tmp_path / "scene.json").write_bytes(b"[1]")
    with pytest.raises(FileFormatError, match="not a JSON object"):
        load_bundle(tmp_path)


def dataset(run: Path) -> Path:
    (found,) = (run / "lerobot").iterdir()
    return found


def edit(path: Path, column: str, change: Callable[[list], list]) -> None:
    table = pq.read_table(path)
    k = table.column_names.index(column)
    values = change(table[column].to_pylist())
    field = table.schema.field(k)
    pq.write_table(table.set_column(k, field, pa.array(values, field.type)), path)


@pytest.mark.parametrize(
    ("column", "change", "says"),
    [
        ("timestamp", lambda v: [*v[:3], v[3] + 0.1, *v[4:]], "timestamps at 4 frames/s: row 3"),
        ("frame_index", lambda v: v[::-1], "column frame_index"),
        ("task_index", lambda v: [99, *v[1:]], "column task_index: row 0"),
        ("index", lambda v: [n + 1 for n in v], "column index"),
    ],
)
def test_rows_of_a_dataset_that_contradict_its_index_are_found(run: Path, column, change, says):
    check_dataset(dataset(run))
    edit(next(dataset(run).glob("data/*/*.parquet")), column, change)
    with pytest.raises(ValueError, match=says):
        check_dataset(dataset(run))


def test_videos_that_are_shorter_or_elsewhere_than_the_index_says_are_found(run: Path):
    root = dataset(run)
    episodes = next(root.glob("meta/episodes/*/*.parquet"))
    column = "videos/observation.images.rgb/from_timestamp"
    sound = episodes.read_bytes()
    edit(episodes, column, lambda v: [t + 0.25 for t in v])
    with pytest.raises(ValueError, match="episode 0 is not at 0 s"):
        check_dataset(root)
    episodes.write_bytes(sound)
    unit = next((run / "units").rglob("observation.images.rgb.mp4"))
    shutil.copy(unit, next(root.glob("videos/observation.images.rgb/*/*.mp4")))
    with pytest.raises(ValueError, match="numbers of frames differ"):
        check_dataset(root)


def rows(*episodes: tuple[str, str]) -> list[dict[str, str]]:
    return [{"scene_id": scene, "trajectory_id": path} for scene, path in episodes]


def test_splits_share_no_path_and_no_scene_but_for_seen_ones():
    some = rows(("a", "1"), ("a", "2"), ("b", "3"))
    check_splits({"train": [0], "val_seen": [1], "val_unseen": [2]}, some)
    with pytest.raises(ValueError, match="scene a is in splits train and val_unseen"):
        check_splits({"train": [0], "val_unseen": [1, 2]}, some)
    with pytest.raises(ValueError, match="path 1 of a is in splits train and val_seen"):
        check_splits({"train": [0], "val_seen": [1, 2]}, rows(("a", "1"), ("a", "1"), ("b", "3")))
    with pytest.raises(ValueError, match="does not name each of 3 episodes once"):
        check_splits({"train": [0, 1]}, some)


@QUICK
def test_an_episode_that_got_lost_between_two_stages_is_found(run: Path):
    ledger = Ledger(run)
    exported = ledger.rows("export")[0].item
    ledger.forget("export", [exported])
    ledger.save()
    found = problems(run)
    assert "neither in stage export nor quarantined" in found[f"render {exported}"]
    assert any("has 2 episodes" in text and "units 1 episodes" in text for text in found.values())
    ledger.add(Row("export", exported, "k", "quarantined", error={"type": "E", "reason": "r"}))
    ledger.save()
    assert f"render {exported}" not in problems(run)
    ledger.forget("render", [exported])
    ledger.save()
    assert any("neither rendered in" in text for text in problems(run).values())


@QUICK
def test_mcap_times_and_counts_are_checked(run: Path):
    check_output("mcap", next((run / "mcap").rglob("*.mcap")))
    cut = next((run / "mcap").rglob("*.mcap"))
    cut.write_bytes(cut.read_bytes()[:-40])
    assert any(cut.name in what for what in problems(run))


def test_filtered_episodes_of_others_are_read_as_they_are(tmp_path: Path):
    point = [0.0, 0.0, 0.0]
    episode = {
        "episode_id": "1",
        "trajectory_id": "1",
        "scene_id": "house",
        "start_position": point,
        "start_rotation": [0.0, 0.0, 0.0, 1.0],
        "goals": [{"position": [1.0, 0.0, 0.0], "radius": 3.0}],
        "reference_path": [point, [1.0, 0.0, 0.0]],
        "instruction": {"instruction_text": "Go."},
    }
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"episodes": [episode]}))
    check_output("filter", file)
    file.write_text(json.dumps({"episodes": [episode, episode]}))
    with pytest.raises(FileFormatError, match="occurs twice"):
        check_output("filter", file)


@pytest.mark.parametrize(
    ("last", "damaged", "advised"),
    [
        ("collect --robot jetbot --seed 3", ["frames/aliengo/path/x"], "--robot aliengo --seed 3"),
        ("collect --robot jetbot", ["lerobot/jetbot-path-v/x"], "collect --robot jetbot"),
        ("collect", ["rollouts/jetbot/path/x", "units/aliengo-path-v/x"], "--robot aliengo,jetbot"),
        ("collect --controller speed", ["frames/aliengo/path/v/x"], "collect --controller path"),
        ("collect --robot ./own", ["facts/aliengo-home.json.gz"], "collect --robot ./own"),
        ("collect --robot jetbot", ["scenes/x/visual.npz"], "collect --robot jetbot"),
        ("collect --robot all", ["frames/aliengo/path/x"], "collect --robot all"),
    ],
)  # fmt: skip
def test_the_advice_names_the_robots_whose_files_are_damaged(
    tmp_path: Path, last: str, damaged: list[str], advised: str
) -> None:
    ledger = Ledger(tmp_path)
    ledger.finished = f"cd '/a b' && vlnpe {last}"
    for robot in ("aliengo", "jetbot"):
        facts = {"robot": robot, "controller": "path"}
        ledger.add(Row("replay", f"{robot}/path/e", "k", "done", facts=facts))
    for name in damaged:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
        ledger.record([path])
        path.unlink()
    ledger.save()
    advice = remedy(tmp_path, [Check(name, "missing") for name in damaged])
    assert advice.endswith(advised) and "cd '/a b' && vlnpe collect" in advice

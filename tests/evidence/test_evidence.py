"""`make evidence`: cells are made once, and the page says what they hold and what is missing."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.evidence import __main__ as command
from benchmarks.evidence import cells, digest
from benchmarks.evidence.figures import figures
from benchmarks.evidence.judge import METRICS
from benchmarks.evidence.page import page
from benchmarks.evidence.plan import tables
from benchmarks.evidence.records import FULL, Claim, Row, Table, Test, Training
from tests.collectors.test_replay import make_episode
from vlnpe.datasets.mixture.recipe import recipe_of
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.learning.config import train_config

RESULTS = sorted((cells.SETTINGS.parent / "results").glob("*.json"))
DATA = Path(__file__).resolve().parents[2] / "docs" / "results" / "data.md"


@pytest.fixture
def run(tmp_path: Path, two_rooms: SceneBundle) -> Path:
    """A run with training and unseen episodes, and a dataset of the bodyless agent by name."""
    episodes = [
        replace(make_episode(two_rooms, (0.9, 2.3), goal, name=str(k)), scene_id=f"home-{k % 3}")
        for k, goal in enumerate([(2.6, 2.0), (1.0, 0.6), (2.4, 0.8)] * 2)
    ]
    folder = tmp_path / "run"
    (folder / "episodes").mkdir(parents=True)
    write_episodes(folder / "episodes" / "train.json.gz", episodes)
    unseen = [replace(e, split="val_unseen") for e in episodes]
    write_episodes(folder / "episodes" / "val_unseen.json.gz", unseen)
    info = folder / "lerobot" / "vlnce-flash-ego" / "meta" / "info.json"
    info.parent.mkdir(parents=True)
    info.write_text("{}")
    return folder


class Commands:
    """Stands for `vlnpe`: writes what the commands write, and counts the calls."""

    def __init__(self, fails: str = "") -> None:
        self.calls: list[list[str]] = []
        self.fails = fails

    def __call__(self, arguments: Sequence[str]) -> int:
        self.calls.append(list(arguments))
        if self.fails and self.fails in " ".join(arguments):
            return 1
        out = Path(arguments[arguments.index("--out") + 1])
        out.mkdir(parents=True, exist_ok=True)
        if arguments[0] == "train":
            name = "rdp" if "rdp" in out.name else "seq2seq" if "seq" in out.name else "cma"
            (out / f"{name}.safetensors").write_bytes(b"weights")
            return 0
        good = "random" not in arguments
        asked = cells.read_episodes(Path(arguments[1]))
        metrics = {
            "trajectory_length_m": 5.0,
            "navigation_error_m": 1.0,
            "fall": False,
            "stuck": False,
            "oracle_success": good,
            "success": good,
            "spl": float(good),
            "ndtw": 0.5,
            "duration_s": 9.0,
        }
        rows = [
            {
                "split": e.split,
                "scene": e.scene_id,
                "episode": e.episode_id,
                "trajectory": e.trajectory_id,
                "metrics": metrics,
                "contacts": [],
            }
            for e in asked
        ]
        value = {"format": "vlnpe-results/1", "setting": {"policy": "random"}, "episodes": rows}
        (out / "results.json").write_text(json.dumps(value))
        return 0


def call(run: Path, out: Path, *more: str) -> list[str]:
    names = ["--data", str(run), "--run", str(run), "--out", str(out / "e"), "--docs", str(out)]
    return [*names, "--tables", "1", "--seeds", "0,1", *more]


def test_cells_are_made_once_and_the_page_says_what_is_missing(run: Path, tmp_path: Path) -> None:
    commands = Commands()
    (tmp_path / "docs").mkdir()
    arguments = call(run, tmp_path / "docs")
    assert command.main(arguments, commands) == 0
    trainings = [c for c in commands.calls if c[0] == "train"]
    assert len(trainings) == 7 * 2 and len({c[c.index("--out") + 1] for c in trainings}) == 14
    evaluations = len(commands.calls) - len(trainings)
    assert evaluations == 8 * 2 + 2  # forward and oracle do not vary
    text = (tmp_path / "docs" / "evidence.md").read_text()
    assert (
        "| CMA uses vision; its rival is weak, it leaves the building through walls (CMA − CMA, "
        "vision-blind) | SR +0.0 (+0.0 … +0.0) points | not shown |" in text
    )
    assert "CMA is better than chance (CMA − random) | SR +100.0" in text and "reproduced" in text
    assert "not measured (no data of h1/speed" in text and "not measured (the data has 3" in text
    # What was measured comes first, all that was not is one line, and no table is empty.
    assert "| not measured" not in text and "| 0 |" not in text
    assert re.search(r"^Rows not measured.*: .*h1 → vlnce.*aliengo → vlnce", text, re.MULTILINE)
    assert re.search("^Claims not measured: .*the humanoid falls", text, re.MULTILINE)
    commands.calls.clear()
    assert command.main(arguments, commands) == 0 and not commands.calls
    again = (tmp_path / "docs" / "evidence.md").read_text()
    assert again == text
    # A note stays, and data that measured cells were trained on is not said to be missing.
    file = tmp_path / "docs" / "evidence.json"
    value = json.loads(file.read_text())
    value["notes"] = ["Measured on a Sunday."]
    value["missing"]["cma-s0--h1-flash-baked"] = "no data of vlnce/flash"
    file.write_text(json.dumps(value))
    assert command.main([*arguments, "--only-page"]) == 0
    noted = (tmp_path / "docs" / "evidence.md").read_text()
    assert "Measured on a Sunday." in noted and "no data of vlnce/flash" not in noted
    assert "## 2. Trained on flash data" in noted and "## 3. " not in noted
    assert "\nTables not measured: 3. Training and testing" in noted
    assert command.main(arguments, commands) == 0
    assert json.loads(file.read_text())["notes"] == ["Measured on a Sunday."]
    value["notes"] = []
    file.write_text(json.dumps(value))
    assert command.main(arguments, commands) == 0
    assert command.main([*arguments, "--only-page"]) == 0
    assert (tmp_path / "docs" / "evidence.md").read_text() == text


@pytest.mark.parametrize("label", ["CMA", "flash, bodyless", "VLN-CE style → vlnce"])
def test_a_cell_of_several_tables_is_chosen_by_any_of_its_labels(
    run: Path, tmp_path: Path, label: str
) -> None:
    commands = Commands()
    arguments = [*call(run, tmp_path), "--tables", "1,2,4,7", "--rows", label]
    assert command.main(arguments, commands) == 0
    assert set(digest.read(tmp_path / "evidence.json")["cells"]) == {
        f"cma-s{seed}--vlnce-flash-baked" for seed in (0, 1)
    }


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rows", "randm"], "unknown row 'randm' (did you mean random?); valid: CMA, CMA, RGB"),
        (["--rows", "random;H1, physics"], "unknown row 'H1, physics'"),  # of table 2
        (["--tables", "1,10"], "unknown table '10'; valid: 1, 2, 3, 4, 5, 6, 7, 8, 9"),
    ],
)
def test_unknown_rows_and_tables_are_refused(
    run: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    said: str,
) -> None:
    commands = Commands()
    assert command.main([*call(run, tmp_path), *options], commands) == 2
    assert said in capsys.readouterr().err
    assert not commands.calls and not (tmp_path / "evidence.json").exists()


def test_a_cell_that_fails_leaves_the_others(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(call(run, tmp_path), Commands(fails="seq2seq-s1")) == 1
    assert "seq2seq-s1--vlnce-flash-baked" in capsys.readouterr().err
    value = digest.read(tmp_path / "evidence.json")
    assert "seq2seq-s0--vlnce-flash-baked" in value["cells"]
    assert "seq2seq-s1--vlnce-flash-baked" not in value["cells"]
    assert "with one seed" in (tmp_path / "evidence.md").read_text()


def test_published_cells_of_the_same_bench_stay(run: Path, tmp_path: Path) -> None:
    """Rows measured elsewhere are kept, those of another bench are not."""
    docs = tmp_path / "docs"
    docs.mkdir()
    assert command.main([*call(run, docs), "--rows", "random"], Commands()) == 0
    first = digest.read(docs / "evidence.json")
    elsewhere = [*call(run, docs), "--rows", "forward", "--out", str(tmp_path / "elsewhere")]
    assert command.main(elsewhere, Commands()) == 0
    both = digest.read(docs / "evidence.json")
    assert first["cells"].items() < both["cells"].items()
    assert set(both["cells"]) - set(first["cells"]) == {"forward-s0--vlnce-flash-baked"}
    fewer = tmp_path / "settings.yaml"
    fewer.write_text(cells.SETTINGS.read_text().replace("episodes: 204", "episodes: 3"))
    other = [*elsewhere[:-1], str(tmp_path / "other"), "--settings", str(fewer)]
    assert command.main(other, Commands()) == 0
    assert set(digest.read(docs / "evidence.json")["cells"]) == {"forward-s0--vlnce-flash-baked"}


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"data_sha": ["b"]}, "cma-s1--vlnce-flash-baked"),
        ({"data_sha": ["b"]}, "cma-s0--h1-speed-baked"),
        ({"data_sha": ["b"]}, "cma-depth-only-s0--vlnce-flash-baked"),
        (
            {"checkpoint_sha256": "2", "curve": [{"step": 600, "loss": 0.72}]},
            "cma-s0--h1-speed-baked",
        ),
        ({"checkpoint_sha256": "2", "curve": []}, "cma-s0--h1-speed-baked"),
    ],
)
def test_cells_of_one_training_are_of_the_same_data_and_losses(
    run: Path, tmp_path: Path, change: dict[str, Any], name: str
) -> None:
    bench = cells.Bench(run, run, "val_unseen", tmp_path, cells.read_settings(), ())
    value = digest.collect(bench, tables(3), {})
    cell = {
        "values": [],
        "data_sha": ["a"],
        "checkpoint_sha256": "1",
        "curve": [{"step": 600, "loss": 0.7}],
    }
    again = {"checkpoint_sha256": "2", "curve": [{"step": 600, "loss": 0.7002}]}
    first = "cma-s0--vlnce-flash-baked"
    same = {first: cell, "cma-s0--h1-speed-baked": cell | again}
    kept = digest.collect(bench, tables(3), {}, {**value, "cells": same})
    assert kept["cells"] == same
    assert digest.retrained(kept, tables(3)) == ["cma-s0"]
    with pytest.raises(InputError, match="measure them again"):
        published = {first: cell, name: cell | change}
        digest.collect(bench, tables(3), {}, {**value, "cells": published})


@pytest.mark.parametrize("other", [{"gait_sha256": "2"}, {}], ids=["another gait", "unknown gait"])
def test_a_robot_walks_all_its_tests_with_one_gait(
    run: Path, tmp_path: Path, other: dict[str, Any]
) -> None:
    bench = cells.Bench(run, run, "val_unseen", tmp_path, cells.read_settings(), ())
    value = digest.collect(bench, tables(3), {})
    cell = {"values": [], "gait_sha256": "1"}
    names = ("random-s0--h1-speed-baked", "forward-s0--h1-speed-baked")
    same = dict.fromkeys(names, cell)
    assert digest.collect(bench, tables(3), {}, {**value, "cells": same})["cells"] == same
    with pytest.raises(InputError, match=r"another gait than in further cells.*--name"):
        mixed = {names[0]: cell, names[1]: {"values": [], **other}}
        digest.collect(bench, tables(3), {}, {**value, "cells": mixed})
    # Texts that changed make other tests of the same paths.
    changed = {**value, "cells": same, "instructions_sha256": "former"}
    assert not digest.collect(bench, tables(3), {}, changed)["cells"]


def test_results_of_other_instructions_are_refused(run: Path, tmp_path: Path) -> None:
    """Those of earlier versions say nothing about theirs; those of more episodes, of all these."""
    bench = cells.Bench(run, run, "val_unseen", tmp_path, cells.read_settings(), ())
    row = tables(3)[1].row("random")
    path = cells.results_of(bench, row, 0)
    asked = digest.collect(bench, tables(3), {})["instructions_sha256"]

    def cells_of(sha256: str, episodes: Sequence[dict[str, Any]]) -> dict[str, Any]:
        setting = {**value["setting"], "instructions_sha256": sha256}
        path.write_text(json.dumps({**value, "setting": setting, "episodes": episodes}))
        return digest.collect(bench, tables(3), {})["cells"]

    cells.measure(replace(bench, call=Commands()), row, 0)
    value = json.loads(path.read_text())
    episodes = value["episodes"]
    assert cells_of(asked, episodes).keys() == {row.cell(0)}
    with pytest.raises(InputError, match="made with other instructions") as raised:
        cells_of("0" * 64, episodes)
    assert str(raised.value).startswith(f"{path}: ")
    assert cells_of("0" * 64, [*episodes, {**episodes[0], "episode": "of another"}])
    path.write_text(json.dumps(value))
    assert digest.collect(bench, tables(3), {})["cells"].keys() == {row.cell(0)}


def test_a_page_may_have_another_name(run: Path, tmp_path: Path) -> None:
    arguments = [*call(run, tmp_path), "--rows", "random", "--name", "evidence-of-mine"]
    assert command.main(arguments, Commands()) == 0
    assert "from `evidence-of-mine.json`" in (tmp_path / "evidence-of-mine.md").read_text()
    assert not (tmp_path / "evidence.json").exists()


def test_a_table_of_another_collection_says_so(run: Path, tmp_path: Path) -> None:
    bench = cells.Bench(run, run, "val_unseen", tmp_path, cells.read_settings(), ())
    value = digest.collect(bench, tables(3), {})
    walks = len(value["episodes"])
    cell = {
        "results_sha256": "0",
        "values": [[0.0] * len(value["metrics"])] * walks,
        "checkpoint_sha256": "1",
        "curve": [],
    }
    both = {
        "cma-s0--vlnce-flash-baked": cell | {"data_sha": ["a"]},
        "cma-s0--vlnce-flash-DL300": cell | {"data_sha": ["b"], "checkpoint_sha256": "2"},
    }
    kept = digest.collect(bench, tables(3), {}, {**value, "cells": both})
    assert kept["cells"] == both
    assert digest.other_collections(kept, tables(3)) == {5: ["vlnce/flash"]}
    assert digest.retrained(kept, tables(3)) == []
    shown = page(kept, tables(3), ())
    assert "| cma-s0--vlnce-flash-baked | vlnce/flash a |" in shown
    assert "| cma-s0--vlnce-flash-DL300 | vlnce/flash b |" in shown
    assert shown.count("Trained on another collection of vlnce/flash") == 1


def test_data_of_all_scenes_is_one_training() -> None:
    amount = tables(20)[7]
    assert amount.row("20 scenes").policy == amount.row("all scenes and paths").policy
    assert amount.row("10 scenes").policy == Training(scenes=10)


def test_every_training_is_a_valid_recipe_of_its_data(run: Path, tmp_path: Path) -> None:
    scenes = tuple(f"home-{k}" for k in range(80))
    bench = cells.Bench(run, run, "val_unseen", tmp_path, cells.read_settings(), scenes)
    trainings = {
        row.policy
        for t in tables(20).values()
        for row in t.rows
        if isinstance(row.policy, Training)
    }
    names = {training.name for training in trainings}
    assert len(names) == len(trainings)
    steps = cells.read_settings().train["steps"]
    for training in trainings:
        recipe = recipe_of(cells.recipe(bench, training))
        config = train_config(recipe.train)
        assert (config.model.name, config.model.inputs) == (training.model, training.inputs)
        assert len(recipe.sources) == len(training.robots) and recipe.holdout == "split"
        for source in recipe.sources.values():
            assert len(source.scenes) == training.scenes
            assert source.fraction == training.fraction
        if training.model != "rdp":
            more = training.longer * (len(training.robots) if training.passes else 1)
            assert config.steps == steps * more


def test_a_test_moves_the_camera_and_names_light_and_robot(run: Path, tmp_path: Path) -> None:
    commands = Commands()
    bench = cells.Bench(
        run, run, "val_unseen", tmp_path, cells.read_settings(), (), 1, call=commands
    )
    test = Test("h1", "speed", "DL300", camera_height_m=0.5)
    cells.measure(bench, Row("x", FULL, test), 3)
    training, evaluation = commands.calls
    assert training[0] == "train" and training[training.index("--seed") + 1] == "3"
    told = " ".join(evaluation)
    assert "--robot h1 --controller speed --light DL300 --camera-height 0.5" in told
    assert "--camera-pitch" not in told and str(tmp_path / "trainings" / "cma-s3") in told


def test_claims_name_rows() -> None:
    with pytest.raises(InputError, match="no row"):
        Table(1, "?", (Row("a", "random"),), (Claim("", "SR", "a", "b"),), "")


def texts(svg: bytes) -> list[str]:
    """Return the labels of a figure; positions may differ by rounding."""
    return [node.text for node in ElementTree.fromstring(svg).iter() if node.text]


def test_the_amount_is_drawn_by_the_paths_trained_on() -> None:
    """Two amounts of scenes are a line; one of them alone says nothing of the amount."""
    rng = np.random.default_rng(0)
    cells_of_rows = {}
    for label, paths in (("10 scenes", 271), ("20 scenes", 548)):
        for seed in (0, 1):
            cells_of_rows[tables(20)[7].row(label).cell(seed)] = {
                "episodes": paths,
                "checkpoint_sha256": f"{paths}-{seed}",
                "values": rng.choice([0.0, 100.0], (6, len(METRICS))).tolist(),
                "curve": [{"step": 300.0, "train action": 0.7, "held action": 0.6}],
            }
    value = {
        "metrics": METRICS,
        "seeds": [0, 1],
        "cells": cells_of_rows,
        "episodes": [["val_unseen", f"home-{k // 2}", str(k), str(k)] for k in range(6)],
    }
    drawn = figures(value, tables(20))
    assert set(drawn) == {"rates", "amount", "curves"}
    text = texts(drawn["amount"])
    assert {"271", "548", "paths trained on", "more scenes"} <= set(text)
    assert "more paths in the same scenes" not in text
    fewer = {name: cell for name, cell in cells_of_rows.items() if cell["episodes"] == 548}
    assert set(figures({**value, "cells": fewer}, tables(20))) == {"rates", "curves"}


def test_the_page_of_results_says_what_the_files_hold() -> None:
    pages: dict[str, str] = {}
    for source in RESULTS:
        value = digest.read(source)
        every = tables(len(value["training_scenes"]))
        pages[source.stem] = page(value, every, ())
        for cell in value["cells"].values():
            shape = len(value["episodes"]), len(value["metrics"])
            assert np.array(cell["values"]).shape == shape
        for figure in DATA.parent.glob(f"{source.stem}-*.svg"):
            drawn = figures(value, every)[figure.stem.removeprefix(f"{source.stem}-")]
            assert texts(figure.read_bytes()) == texts(drawn)
    said = DATA.read_text()
    assert set(re.findall(r"!\[.*\]\((\w+)-\w+\.svg\)", said)) <= pages.keys()
    numbers = re.findall(r"[+−]?[\d.]+ \([^()]* … [^()]*\)", said.replace("\n", " "))
    assert len(numbers) > 60
    every_page = "".join(pages.values())
    assert [number for number in numbers if number.replace("−", "-") not in every_page] == []


def test_a_row_can_be_trained_in_the_scenes_of_one_name(run: Path, tmp_path: Path) -> None:
    scenes = ("exact-apartment-0", "exact-apartment-1", "apartment-0", "apartment-1")
    bench = cells.Bench(run, run, "val_unseen", tmp_path, cells.read_settings(), scenes)
    rows = {row.label: row for row in tables(4)[9].rows}
    for label, chosen in (("exact", scenes[:2]), ("scanned", scenes[2:])):
        row = rows[f"trained in {label} homes"]
        assert isinstance(row.policy, Training) and not cells.missing(bench, row)
        assert recipe_of(cells.recipe(bench, row.policy)).sources["vlnce"].scenes == chosen
    # Walks of other scenes are other data; the page takes both.
    value = digest.collect(bench, tables(4), {})
    made = {
        rows[f"trained in {label} homes"].cell(0): {
            "values": [],
            "data_sha": [label],
            "checkpoint_sha256": label,
            "curve": [],
        }
        for label in ("exact", "scanned")
    }
    assert digest.collect(bench, tables(4), {}, {**value, "cells": made})["cells"] == made
    exact_alone = replace(bench, scenes=scenes[:2])
    assert "apartment-" in cells.missing(exact_alone, rows["trained in scanned homes"])
    assert cells.training_scenes(run) == ("home-0", "home-1", "home-2")
    with pytest.raises(InputError, match="collect one first"):
        cells.training_scenes(tmp_path / "docs")

"""The stage runner on real worker processes."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.support.runs import work
from vlnpe.formats.core.errors import InputError, VlnpeError
from vlnpe.pipeline.engine.ledger import JOURNAL_NAME, MANIFEST_NAME, Ledger
from vlnpe.pipeline.engine.run_folder import file_names, safe_name
from vlnpe.pipeline.engine.work import WorkItem, work_item
from vlnpe.pipeline.execution.attempts import WorkerDiedError, run_items
from vlnpe.pipeline.execution.processes import Workers
from vlnpe.pipeline.execution.runner import Context, StageFailedError, run_stage
from vlnpe.trajectory_sampler.vlnce.stairs import StairRules

pytestmark = pytest.mark.chain


@pytest.fixture(scope="module")
def workers():
    with Workers(2) as pool:
        yield pool


def context(root: Path, workers: Workers) -> Context:
    return Context(Ledger(root), workers, progress=False)


def item(root: Path, name: str, text: str = "hello", key: str = "k") -> WorkItem:
    path = root / f"{name}.txt"
    return WorkItem(name, key, (path,), work.Call(work.write, (path, text)))


def test_idle_workers_import_what_is_expected_while_the_first_item_runs(tmp_path):
    with Workers(2) as pool:
        pool.expect(2, ["colorsys"])
        first = pool.submit(work.imported, "colorsys", tmp_path / "go on")
        assert pool.submit(work.imported, "colorsys").result(timeout=60)
        (tmp_path / "go on").touch()
        assert not first.result(timeout=60)


def test_second_run_reuses_everything_and_a_changed_key_redoes_one(tmp_path, workers):
    first = run_stage(context(tmp_path, workers), "s", [item(tmp_path, "a"), item(tmp_path, "b")])
    assert (first.done, first.reused) == (2, 0)
    stamp = (tmp_path / "a.txt").stat().st_mtime_ns
    changed = [item(tmp_path, "a"), item(tmp_path, "b", "bye", key="other")]
    second = run_stage(context(tmp_path, workers), "s", changed)
    assert (second.done, second.reused) == (1, 1)
    assert (tmp_path / "a.txt").stat().st_mtime_ns == stamp
    assert (tmp_path / "b.txt").read_text() == "bye"


def test_rows_and_summary_say_how_long_kernels_were_compiled(tmp_path, workers):
    path = tmp_path / "b.txt"
    compiling = WorkItem("b", "k", (path,), work.Call(work.compiled, (path,)))
    summary = run_stage(context(tmp_path, workers), "s", [item(tmp_path, "a"), compiling])
    seconds = {row.item: row.compile_seconds for row in Ledger(tmp_path).rows("s")}
    assert seconds["a"] == 0 < seconds["b"] == summary.compile_seconds


def test_a_deleted_output_is_made_again(tmp_path, workers):
    items = [item(tmp_path, "a")]
    run_stage(context(tmp_path, workers), "s", items)
    (tmp_path / "a.txt").unlink()
    assert run_stage(context(tmp_path, workers), "s", items).done == 1
    assert (tmp_path / "a.txt").exists()


def test_bad_items_are_quarantined_with_their_reason_and_counted(tmp_path, workers):
    bad = tmp_path / "bad.txt"
    items = [
        item(tmp_path, "good"),
        item(tmp_path, "fell", "fell"),
        WorkItem("no_floor", "k", (bad,), work.Call(work.refuse, (bad,))),
        WorkItem("no_mesh", "k", (bad,), work.Call(work.misread, (bad,))),
        WorkItem("bug", "k", (bad,), work.Call(work.crash, (bad,))),
        WorkItem("stubborn", "k", (bad,), work.Call(work.refuse_stubbornly, (bad,))),
        WorkItem("half", "k", (bad,), work.Call(work.write_half, (bad,))),
    ]
    summary = run_stage(context(tmp_path, workers), "s", items)
    assert (summary.done, summary.failed, summary.quarantined) == (2, 1, 5)
    listed = json.loads((tmp_path / "quarantine.json").read_text())
    reasons = {i["item"]: i["reason"] for i in listed["items"]}
    assert listed["count"] == 5
    assert reasons["no_mesh"] == f"{bad}: no mesh"
    assert "not portable" in reasons["stubborn"]
    assert "has no floor" in reasons["no_floor"]
    assert "ZeroDivisionError" in reasons["bug"]
    files = {p.name for p in tmp_path.iterdir()}
    assert files == {"good.txt", "fell.txt", MANIFEST_NAME, "quarantine.json", "quarantine"}
    crash = (tmp_path / "quarantine" / "s" / "bug.txt").read_text()
    assert "in crash\n" in crash and "ZeroDivisionError: a bug" in crash
    # They would fail again: nothing runs them but being asked to, or being needed.
    again = run_stage(context(tmp_path, workers), "s", items)
    assert (again.done, again.reused, again.quarantined) == (0, 2, 5)
    asked = Context(Ledger(tmp_path), workers, progress=False, retry_quarantined=True)
    fixed = [item(tmp_path, "bug") if i.name == "bug" else i for i in items]
    assert run_stage(asked, "s", fixed).done == 1
    assert not (tmp_path / "quarantine" / "s" / "bug.txt").exists()


def test_items_that_failed_for_lack_of_memory_run_again_by_default(tmp_path, workers):
    path = tmp_path / "x.txt"
    poor = WorkItem("x", "k", (path,), work.Call(work.run_out_of_memory, (path,)))
    assert run_stage(context(tmp_path, workers), "s", [poor]).quarantined == 1
    assert run_stage(context(tmp_path, workers), "s", [item(tmp_path, "x")]).done == 1


def test_two_items_of_one_file_name_are_refused_not_dropped(tmp_path, workers):
    items = [item(tmp_path, "a"), item(tmp_path, "A")]
    with pytest.raises(VlnpeError, match="A and a share one file name"):
        run_stage(context(tmp_path, workers), "s", items)


def test_explanations_name_what_changed(tmp_path, workers, capsys):
    def items(config: StairRules, seed: int) -> list[WorkItem]:
        path = tmp_path / "a.txt"
        job = work.Call(work.write, (path, "hello"))
        return [work_item("s", "a", job, (path,), config, seed=seed)]

    explaining = Context(Ledger(tmp_path), workers, progress=False, explain=True)

    def explained(config: StairRules, seed: int) -> str:
        run_stage(explaining, "s", items(config, seed))
        return capsys.readouterr().err

    rules = StairRules()
    assert "s a runs: it has not been finished" in explained(rules, 0)
    assert "s a is reused (unchanged)" in explained(rules, 0)
    assert "s a runs: seed: 0 → 1\n" in explained(rules, 1)
    assert Ledger(tmp_path).values()  # kept for the next run
    explaining = Context(Ledger(tmp_path), workers, progress=False, explain=True)
    changed = explained(replace(rules, max_step_m=0.5), 1)
    assert f"StairRules.max_step_m: {rules.max_step_m} → 0.5\n" in changed
    (tmp_path / "a.txt").unlink()
    assert "a.txt is missing" in explained(replace(rules, max_step_m=0.5), 1)


@pytest.mark.parametrize(
    ("texts", "names"),
    [
        (["apartment-0-0003", "e.2", "A_b"], ["apartment-0-0003", "e.2", "A_b"]),
        (["a/b", "a-b", "a b", "a%2Fb"], ["a%2Fb", "a-b", "a%20b", "a%252Fb"]),
        (["Kitchen", "kitchen"], ["%4Bitchen", "kitchen"]),
        (["..", ".", "", "-x"], ["%2E%2E", "%2E", "~", "%2Dx"]),
        (["é", "e\u0301"], ["%C3%A9", "e%CC%81"]),
    ],
)
def test_different_texts_get_different_file_names(texts, names):
    assert file_names(texts) == names


@given(st.lists(st.text(max_size=300), unique=True, max_size=30))
@example(["x" * 200 + "a", "x" * 200 + "b"])
def test_file_names_are_distinct_legal_and_stable(texts):
    names = file_names(texts)
    assert len({name.casefold() for name in names}) == len(texts)
    for text, name in zip(texts, names, strict=True):
        assert len(name.encode()) < 200 and not set(name) & set('/\\:*?"<>|\0')
        assert not name.startswith((".", "-")) and not name.endswith(".")
        if text == name:
            assert safe_name(text) == text


def test_a_dying_worker_takes_only_its_own_item(tmp_path):
    path = tmp_path / "dead.txt"
    items = [item(tmp_path, n) for n in "abcd"]
    items.insert(1, WorkItem("dead", "k", (path,), work.Call(work.die, (path,))))
    with Workers(2) as pool:
        summary = run_stage(context(tmp_path, pool), "s", items)
    assert sorted(summary.good()) == ["a", "b", "c", "d"]
    assert summary.quarantined == 1


class Machines(work.InlineWorkers):
    """Loses everything that runs, a number of times; sometimes with the machine it ran on."""

    def __init__(self, machines: int, workers: int = 0):
        super().__init__(1)
        self.losses = [True] * machines + [False] * workers

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        if self.losses:
            lost: Future[Any] = Future()
            lost.set_exception(BrokenExecutor())
            return lost
        return super().submit(function, *arguments)

    def restart(self) -> bool:
        return self.losses.pop(0)


@pytest.mark.parametrize(("machines", "workers"), [(4, 0), (4, 2), (0, 2)])
def test_items_lost_with_their_machine_are_not_to_blame(tmp_path, machines, workers):
    items = [item(tmp_path, n) for n in "ab"]
    outcomes = list(run_items(Machines(machines, workers), items))
    assert [outcome.error for _, outcome in outcomes] == [None, None]


def test_an_item_that_loses_every_machine_is_quarantined(tmp_path):
    ((_, outcome),) = run_items(Machines(100), [item(tmp_path, "a")])
    assert isinstance(outcome.error, WorkerDiedError)


@pytest.mark.parametrize(
    ("process", "error", "says"),
    [
        (work.refuse, InputError, "has no floor"),
        (work.crash, StageFailedError, "a bug"),
        (work.fill_disk, InputError, "No space left"),
    ],
)
def test_nothing_left_to_work_on_ends_the_run(tmp_path, workers, process, error, says):
    path = tmp_path / "x.txt"
    items = [WorkItem("x", "k", (path,), work.Call(process, (path,)))]
    with pytest.raises(error, match=says):
        run_stage(context(tmp_path, workers), "s", items, required=True)
    assert not path.exists()


def test_a_full_disk_ends_the_run_although_others_are_done(tmp_path, workers):
    path = tmp_path / "x.txt"
    items = [item(tmp_path, "a"), WorkItem("x", "k", (path,), work.Call(work.fill_disk, (path,)))]
    with pytest.raises(InputError, match="No space left"):
        run_stage(context(tmp_path, workers), "s", items)


def test_journal_of_a_killed_run_counts_and_a_cut_last_line_does_not(tmp_path, workers):
    run_stage(context(tmp_path, workers), "s", [item(tmp_path, "a"), item(tmp_path, "b")])
    rows = json.loads((tmp_path / MANIFEST_NAME).read_text())["rows"]
    (tmp_path / MANIFEST_NAME).unlink()
    lines = [json.dumps(row) for row in rows]
    (tmp_path / JOURNAL_NAME).write_text(lines[0] + "\n" + lines[1][:40])
    ledger = Ledger(tmp_path)
    assert ledger.is_done("s", "a", "k")
    assert not ledger.is_done("s", "b", "k")


def test_items_of_earlier_options_are_kept_but_not_current(tmp_path, workers):
    both = [item(tmp_path, "r/a"), item(tmp_path, "r/b")]
    run_stage(context(tmp_path, workers), "s", both, "r/")
    run_stage(context(tmp_path, workers), "s", [item(tmp_path, "q/a")], "q/")
    fewer = run_stage(context(tmp_path, workers), "s", both[:1], "r/")
    assert fewer.reused == 1
    assert [r.item for r in Ledger(tmp_path).rows("s")] == ["q/a", "r/a"]
    assert run_stage(context(tmp_path, workers), "s", both, "r/").reused == 2


def test_a_stage_that_is_not_required_may_lose_all_its_items(tmp_path, workers):
    path = tmp_path / "x.txt"
    items = [WorkItem("x", "k", (path,), work.Call(work.crash, (path,)))]
    assert run_stage(context(tmp_path, workers), "s", items).quarantined == 1


def test_a_killed_change_of_options_never_passes_for_the_old_ones(tmp_path, workers):
    """New output, no row yet: going back to the old key must make the old output again."""
    run_stage(context(tmp_path, workers), "s", [item(tmp_path, "a", "old", key="4 fps")])
    ledger = Ledger(tmp_path)
    ledger.forget("s", ["a"])  # what the runner does before it starts the item, …
    (tmp_path / "a.txt").write_text("new")  # … which then writes, and is killed
    again = [item(tmp_path, "a", "old", key="4 fps")]
    assert run_stage(context(tmp_path, workers), "s", again).done == 1
    assert (tmp_path / "a.txt").read_text() == "old"


def test_rows_after_a_cut_line_survive_the_next_kill(tmp_path, workers):
    run_stage(context(tmp_path, workers), "s", [item(tmp_path, n) for n in "abc"])
    rows = Ledger(tmp_path).rows("s")
    (tmp_path / MANIFEST_NAME).unlink()
    (tmp_path / JOURNAL_NAME).write_text('{"stage": "s", "item": "cut')
    second = Ledger(tmp_path)
    for row in rows:
        second.add(row)  # and killed again before it could save
    assert [r.item for r in Ledger(tmp_path).rows("s")] == ["a", "b", "c"]


def test_a_ledger_that_cannot_be_written_does_not_hide_why(tmp_path, workers, monkeypatch):
    path = tmp_path / "x.txt"
    items = [WorkItem("x", "k", (path,), work.Call(work.fill_disk, (path,)))]
    full = context(tmp_path, workers)

    def refuse() -> None:
        raise OSError(28, "No space left on device", "manifest.json")

    monkeypatch.setattr(full.ledger, "save", refuse)
    with pytest.raises(InputError, match=r"x\.txt: No space left"):
        run_stage(full, "s", items)


def test_a_piped_run_prints_few_lines_per_stage(tmp_path: Path) -> None:
    code = f"""
from pathlib import Path
from tests.support.runs import work
from vlnpe.formats.process import progress
from vlnpe.pipeline.execution.processes import Workers
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.execution.runner import Context, run_stage
from vlnpe.pipeline.engine.work import WorkItem

if __name__ == "__main__":
    progress.SHORT_S = 0.0  # on a fast machine both are short
    root = Path({str(tmp_path / "run")!r})
    root.mkdir()
    paths = [root / f"{{n}}.txt" for n in range(200)]
    calls = [work.Call(work.write, (p, "fell" if n < 9 else "hello")) for n, p in enumerate(paths)]
    items = [WorkItem(p.stem, "k", (p,), c) for p, c in zip(paths, calls)]
    with Workers(1) as pool:
        for _ in range(2):
            run_stage(Context(Ledger(root), pool), "write", items)
"""
    script = tmp_path / "piped.py"
    script.write_text(code)
    top = str(Path(__file__).parents[3])
    done = subprocess.run(
        [sys.executable, str(script)],
        check=True,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": top},
    )
    lines = done.stderr.splitlines()
    assert len(lines) == 12 and "\r" not in done.stderr, done.stderr
    assert lines[10].endswith("], failed 9")
    assert "200/200" in lines[11] and lines[11].endswith("], failed 9, reused 200")
    # `verify` reads the same run with the same helper.
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", "verify", str(tmp_path / "run")]
    verified = subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
    output = [line for line in verified.stderr.splitlines() if line.startswith("verify")]
    assert 1 <= len(output) <= 11 and "200/200" in output[-1]


UNSTABLE = """
import os
import mujoco
from vlnpe.pipeline.execution.attempts import attempt

class Fall:
    def run(self):
        ball = "<worldbody><body><freejoint/><geom size='.1'/></body></worldbody>"
        model = mujoco.MjModel.from_xml_string(f"<mujoco>{ball}</mujoco>")
        data = mujoco.MjData(model)
        data.qpos[2] = float("nan")
        mujoco.mj_step(model, data)

attempt(Fall(), [], 1)
print(os.listdir())
"""


def test_a_job_whose_physics_is_unstable_leaves_no_log_in_the_users_folder(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(
        [sys.executable, "-c", UNSTABLE],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "The simulation is unstable" in done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "[]"

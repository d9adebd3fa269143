"""`vlnpe verify`: hash every file of a run, open every output, and compare what they say."""

import shlex
from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path

from ...collectors.robots.registry import ROBOTS
from ...formats.core.errors import FileFormatError
from ...formats.process.progress import progress_bar
from ...formats.scene.bundle import INDEX_NAME
from ..context import LEDGERS
from ..engine.ledger import MANIFEST_NAME, Ledger
from ..engine.lock import refuse_if_locked
from ..inputs.crews import ALL, AUTO
from ..options.collect import Collect
from .coverage import check_coverage
from .integrity import Check, check_files, check_ledger, nested_runs, problem_of
from .outputs import check_output, check_scene

# Folders of a run that have a folder for each robot and controller.
PER_ROBOT = {"rollouts", "frames", "units", "lerobot", "mcap"}
UNRECORDED_RUN = (
    "was written by a version that kept no hashes of files. Its outputs were opened, but damage "
    "inside them may go unnoticed; hashes are kept of what `vlnpe collect` makes from now on"
)
UNRECORDED_SCENE = (
    "no record of its files lies beside it, so that damage inside them may go unnoticed"
)


def verify_run(root: Path) -> list[Check]:
    """Check every file and every current output of a run, or the one repaired scene in `root`.

    Args:
        root: Run folder, a folder in one, or the folder of a scene.

    Returns:
        One check per file and per output.
    """
    if (root / INDEX_NAME).is_file():
        return _verify_scene(root)
    try:
        ledger = Ledger.existing(root)
    except FileFormatError as error:
        if error.path.name != MANIFEST_NAME:
            raise
        return [Check(MANIFEST_NAME, error.reason)]
    refuse_if_locked(ledger.root)
    checks = [*_verify_ledger(ledger), *check_coverage(ledger)]
    if not ledger.unfinished:  # then nothing is on its way
        checks = [replace(check, unfinished=False) for check in checks]
    for folder in nested_runs(ledger.root):
        name = folder.relative_to(ledger.root)
        checks += [replace(c, what=f"{name}: {c.what}") for c in verify_run(folder)]
    return checks


def remedy(root: Path, checks: Iterable[Check]) -> str:
    """Return how to restore damaged files; empty if no check names one or no command is known."""
    bad = {check.what for check in checks if check.problem}
    if not bad:
        return ""
    try:
        ledger = Ledger.existing(root)
    except FileFormatError:
        return ""
    bad &= ledger.files().keys()
    command = ledger.unfinished or ledger.finished
    if not bad or not command:
        return ""
    there = any((ledger.root / name).exists() for name in bad)
    first = "delete the damaged files, then " if there else ""
    changed = _with_robots(command, _walks_of(ledger, bad))
    what = "the last one was" if changed == command else "the last one, for what is damaged, is"
    return f"to repair the run: {first}run the command that made them; {what}: {changed}"


def _walks_of(ledger: Ledger, names: Collection[str]) -> set[tuple[str, str]]:
    """Return the robots and controllers whose walks, frames or datasets have files in `names`."""
    paths = [Path(name).parts for name in names]
    folders = {"-".join(parts[1:3]) for parts in paths if parts[0] in PER_ROBOT}
    walks = {
        (row.facts.get("robot"), row.facts.get("controller")) for row in ledger.all_rows("replay")
    }
    return {
        (str(r), str(c)) for r, c in walks if any(f"{f}-".startswith(f"{r}-{c}-") for f in folders)
    }


def _with_robots(command: str, walks: Collection[tuple[str, str]]) -> str:
    """Return a command line of `collect` that also makes these walks: robots and controllers."""
    words = shlex.split(command)
    robots, controllers = ({walk[k] for walk in walks} for k in (0, 1))
    if "collect" not in words or not walks or not robots <= ROBOTS.keys():
        return command
    for option, needed, default in (
        ("--robot", robots, Collect.robot),
        ("--controller", controllers, Collect.controller),
    ):
        at = words.index(option) + 1 if option in words else 0
        given = words[at] if at else default
        present = {AUTO: {"path", "flash"}, ALL: needed}.get(given, set(given.split(",")))
        if needed <= present:
            continue
        if at:
            words[at] = ",".join(sorted(needed))
        else:
            words += [option, ",".join(sorted(needed))]
    return shlex.join(words).replace(" '&&' ", " && ", 1)


def _verify_ledger(ledger: Ledger) -> list[Check]:
    checks = check_ledger(ledger)
    if ledger.hashed:
        checks += check_files(ledger)
    else:
        checks.append(Check(MANIFEST_NAME, UNRECORDED_RUN))
    # A reader need not survive a damaged file, and would only say less about it.
    damaged = {check.what for check in checks if check.problem}
    rows = ledger.done()
    for row in progress_bar("verify", len(rows), items=rows):
        for output in row.outputs:
            if any(Path(name).is_relative_to(output) for name in damaged):
                continue
            path, stage = ledger.root / output, row.stage
            problem = problem_of(lambda path=path, stage=stage: check_output(stage, path))
            named = f"{output}: {problem}" if problem else ""
            checks.append(Check(f"{row.stage} {row.item}", named))
    return checks


def _verify_scene(root: Path) -> list[Check]:
    beside = root.absolute().parent / LEDGERS / root.absolute().name
    run = root.absolute().parent.parent
    checks: list[Check] = []
    if (beside / MANIFEST_NAME).is_file():
        checks = check_files(Ledger(beside), f"../../{root.absolute().name}")
    elif (run / MANIFEST_NAME).is_file() and Ledger(run).hashed:
        checks = check_files(Ledger(run), root.absolute().relative_to(run).as_posix())
    else:
        checks = [Check(f"scene {root.name}", UNRECORDED_SCENE)]
    if not any(check.problem for check in checks if check.problem != UNRECORDED_SCENE):
        checks.append(Check(f"scene {root.name}", problem_of(lambda: check_scene(root))))
    return checks

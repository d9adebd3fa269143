"""The whole chain in the smallest case: a scan of two rooms, two episodes, 64 × 48 pixels."""

import io
import json
import logging
import os
import shlex
import shutil
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from unittest.mock import patch

from tests.support.runs.work import InlineWorkers
from tests.support.scenes import scans
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.engine.ledger import MANIFEST_NAME, Ledger

STAGES = (
    "repair", "soundness", "sample", "look", "instruct", "replay", "render", "export", "mcap",
    "dataset", "pictures", "report",
)  # fmt: skip
VLNPE = (sys.executable, "-m", "vlnpe.pipeline.cli")
TINY = (
    *("--episodes", "2", "--min-length-m", "2", "--min-crossings", "0"),
    *("--robot", "vlnce", "--camera", "ego:64x48:90"),
)


def write_scan(path: Path) -> Path:
    """Write the scan of two rooms."""
    return scans.write_glb(scans.two_rooms(1.0), path)


def command(scan: Path, out: Path, *options: object) -> list[str]:
    """Return the command that collects the run."""
    given = ("collect", "--scene", scan, *TINY, "--out", out, *options)
    return [*VLNPE, *map(str, given)]


def environment(**changes: str) -> dict[str, str]:
    """Return the environment of a command."""
    return {**os.environ, "OMP_NUM_THREADS": "1", **changes}


def collect(scan: Path, out: Path, *options: object) -> subprocess.CompletedProcess[str]:
    """Collect in this process."""
    return vlnpe(*command(scan, out, "--workers", 1, *options)[len(VLNPE) :])


def run(arguments: list[str], **changes: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, and return what it printed."""
    return subprocess.run(
        arguments,
        capture_output=True,
        text=True,
        check=False,
        env=environment(**changes),
        timeout=600,
    )


def process(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run any command of vlnpe in a process of its own."""
    return run([*VLNPE, *map(str, arguments)])


def vlnpe(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run any command of vlnpe in this process, whose imports and kernels it uses."""
    out, err = io.StringIO(), io.StringIO()
    words, log = [str(word) for word in arguments], logging.getLogger()
    with (
        patch("vlnpe.pipeline.execution.settings.Workers", InlineWorkers),
        patch.object(log, "handlers", []),  # the command logs to stderr
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        code = main(words)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def printed(command_line: str) -> subprocess.CompletedProcess[str]:
    """Run in this process a command that vlnpe printed for a shell: `cd FOLDER && vlnpe …`."""
    step, folder, then, program, *words = shlex.split(command_line)
    assert (step, then, Path(program).name) == ("cd", "&&", "vlnpe"), command_line
    with chdir(folder):
        return vlnpe(*words)


def prepare(finished: Path, out: Path) -> Path:
    """Copy of a run all that its repair left."""
    (out / "scenes").parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(finished / "scenes", out / "scenes")
    shutil.copy(finished / MANIFEST_NAME, out / MANIFEST_NAME)
    ledger = Ledger(out)
    for stage in STAGES[2:]:
        ledger.forget(stage, [row.item for row in ledger.rows(stage)])
    ledger.save()
    manifest = json.loads((out / MANIFEST_NAME).read_text())
    assert {row["stage"] for row in manifest["rows"]} == {"repair", "soundness"}
    return out

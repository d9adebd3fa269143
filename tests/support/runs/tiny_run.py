"""The whole chain in the smallest case: a scan of two rooms, two episodes, 64 × 48 pixels."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.support.scenes import scans
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
    """Run the command to its end."""
    return run(command(scan, out, "--workers", 1, *options))


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


def vlnpe(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run any command of vlnpe to its end."""
    return run([*VLNPE, *map(str, arguments)])


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

"""Commands that inspect a run or this machine: `verify`, `report`, `doctor`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ..doctor import examine, remedy
from ..engine.executors import Workers
from ..engine.ledger import Ledger
from ..engine.run_folder import RunFolder
from ..engine.runner import Context
from ..stages import report
from ..verify import verify_run

Json = Annotated[bool, tyro.conf.arg(name="json")]


@dataclass(frozen=True)
class Verify:
    """Verify a run's outputs: files open, counts and checksums match, floors have no leaks."""

    run: tyro.conf.Positional[Path]
    """Run folder, or the folder of a single repaired scene."""
    json: Json = False
    """Print one JSON object with the findings as the last line."""


@dataclass(frozen=True)
class Report:
    """Regenerate the report page of a run."""

    run: tyro.conf.Positional[Path]
    """Run folder."""
    json: Json = False
    """Print one JSON object with the path of the page as the last line."""


@dataclass(frozen=True)
class Doctor:
    """Check what this machine supports, and print the command that installs what is missing."""

    out: Path = Path("runs")
    """Folder that runs would be written to."""
    json: Json = False
    """Print one JSON object with the findings as the last line."""


def run_verify(options: Verify) -> int:
    """Verify a run; return 1 if any check fails.

    Raises:
        InputError: If the folder contains no run.
    """
    checks = verify_run(options.run)
    bad = [c for c in checks if c.problem]
    if options.json:
        value = {"checked": len(checks), "problems": [asdict(c) for c in bad]}
        sys.stdout.write(json.dumps(value) + "\n")
    else:
        for check in bad:
            sys.stdout.write(f"BAD  {check.what}: {check.problem}\n")
        sys.stdout.write(f"outputs checked: {len(checks)}, bad: {len(bad)}\n")
    return int(bool(bad))


def run_report(options: Report) -> int:
    """Write the report of a run.

    Raises:
        InputError: If the folder contains no run.
    """
    folder = RunFolder(options.run.resolve())
    with Workers(1) as workers:
        page = report.write(folder, Context(Ledger.existing(folder.root), workers), [])
    sys.stdout.write((json.dumps({"report": str(page)}) if options.json else str(page)) + "\n")
    return 0


def run_doctor(options: Doctor) -> int:
    """Print the findings."""
    findings = examine(options.out)
    command = remedy(findings)
    if options.json:
        value = {"findings": [asdict(f) for f in findings], "remedy": command}
        sys.stdout.write(json.dumps(value) + "\n")
        return 0
    for f in findings:
        sys.stdout.write(f"{'ok  ' if f.good else '--  '}{f.subject:<17} {f.seen}\n")
    if command:
        sys.stdout.write(f"\nto install what is missing:\n  {command}\n")
    return 0

"""Commands that inspect a run or this machine: `verify`, `report`, `doctor`."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from dataclasses import asdict

from ..doctor import examine, remedy
from ..engine.executors.base import Workers
from ..engine.ledger import Ledger
from ..engine.run_folder import RunFolder
from ..engine.runner import Context
from ..options.results import Doctor, Report, Verify
from ..stages import report
from ..store.address import store_url
from ..store.mirror import local_copy
from ..verify.run import verify_run


def run_verify(options: Verify) -> int:
    """Verify a run; return 1 if any check fails.

    Raises:
        InputError: If the folder contains no run.
    """
    url = store_url(options.run)
    with local_copy(url) if url else nullcontext(options.run) as run:
        checks = verify_run(run)
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

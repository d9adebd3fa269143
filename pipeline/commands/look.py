"""Commands that inspect a run or this machine: `verify`, `report`, `doctor`."""

import json
import sys
from contextlib import nullcontext
from dataclasses import asdict

from .. import doctor
from ..engine.ledger import Ledger
from ..engine.run_folder import RunFolder
from ..execution.processes import Workers
from ..execution.runner import Context
from ..options.results import Doctor, Report, Verify
from ..report import items as report
from ..store.address import store_url
from ..store.mirror import local_copy
from ..summary import print_result
from ..verify.run import remedy, verify_run

# Exit code of `verify` where nothing is wrong but that the run has not ended.
UNFINISHED = 3
SHOWN = 10  # lines of what is not finished: after a kill it is every file of the items in flight


def run_verify(options: Verify) -> int:
    """Verify a run; return 1 if anything is wrong, else 3 if the run has not ended.

    Raises:
        InputError: If the folder contains no run.
    """
    url = store_url(options.run)
    with local_copy(url) if url else nullcontext(options.run) as run:
        checks = verify_run(run)
        advice = remedy(run, checks)
    bad = [c for c in checks if c.problem and not c.unfinished]
    open_ends = [c for c in checks if c.problem and c.unfinished]
    if options.json:
        kinds = {"problems": bad, "unfinished": open_ends}
        found = {kind: [asdict(c) for c in checked] for kind, checked in kinds.items()}
        sys.stdout.write(json.dumps({"checked": len(checks), **found, "remedy": advice}) + "\n")
    else:
        lines = [f"BAD  {check.what}: {check.problem}" for check in bad]
        lines += [f"NOT FINISHED  {c.what}: {c.problem}" for c in open_ends[:SHOWN]]
        if len(open_ends) > SHOWN:
            lines.append(f"NOT FINISHED  … and {len(open_ends) - SHOWN} more; --json lists them")
        sys.stdout.writelines(f"{line}\n" for line in lines)
        unfinished = f", not finished: {len(open_ends)}" if open_ends else ""
        sys.stdout.write(f"outputs checked: {len(checks)}, bad: {len(bad)}{unfinished}\n")
        if advice:
            sys.stdout.write(f"{advice}\n")
    return 1 if bad else UNFINISHED if open_ends else 0


def run_report(options: Report) -> int:
    """Write the report of a run.

    Raises:
        InputError: If the folder contains no run.
    """
    folder = RunFolder(options.run.resolve())
    with Workers(1) as workers:
        page = report.write(folder, Context(Ledger.existing(folder.root), workers), [])
    return print_result(options, {"report": str(page)}, str(page))


def run_doctor(options: Doctor) -> int:
    """Print the findings."""
    findings = doctor.examine(options.out)
    command = doctor.remedy(findings)
    if options.json:
        value = {"findings": [asdict(f) for f in findings], "remedy": command}
        sys.stdout.write(json.dumps(value) + "\n")
        return 0
    for f in findings:
        sys.stdout.write(f"{'ok  ' if f.good else '--  '}{f.subject:<17} {f.seen}\n")
    if command:
        sys.stdout.write(f"\nto install what is missing:\n  {command}\n")
    return 0

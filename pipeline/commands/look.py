"""Commands that inspect a run or this machine: `verify`, `report`, `doctor`."""

import webbrowser
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
    """Verify a run; return 1 if anything is wrong, else 3 if the run has not ended."""
    url = store_url(options.run)
    with local_copy(url) if url else nullcontext(options.run) as run:
        checks = verify_run(run)
        advice = remedy(run, checks)
    bad = [c for c in checks if c.problem and not c.unfinished]
    open_ends = [c for c in checks if c.problem and c.unfinished]
    lines = [f"BAD  {check.what}: {check.problem}" for check in bad]
    lines += [f"NOT FINISHED  {c.what}: {c.problem}" for c in open_ends[:SHOWN]]
    if len(open_ends) > SHOWN:
        lines.append(f"NOT FINISHED  … and {len(open_ends) - SHOWN} more; --json lists them")
    unfinished = f", not finished: {len(open_ends)}" if open_ends else ""
    lines.append(f"outputs checked: {len(checks)}, bad: {len(bad)}{unfinished}")
    lines += [advice] if advice else []
    kinds = {"problems": bad, "unfinished": open_ends}
    listed = {kind: [asdict(check) for check in some] for kind, some in kinds.items()}
    print_result(options, {"checked": len(checks), **listed, "remedy": advice}, "\n".join(lines))
    return 1 if bad else UNFINISHED if open_ends else 0


def run_report(options: Report) -> int:
    """Write the report of a run."""
    folder = RunFolder(options.run.resolve())
    with Workers(1) as workers:
        page = report.write(folder, Context(Ledger.existing(folder.root), workers), [])
    if options.open:
        webbrowser.open(page.as_uri())
    return print_result(options, {"report": str(page)}, str(page))


def run_doctor(options: Doctor) -> int:
    """Print the findings."""
    findings = doctor.examine(options.out)
    command = doctor.remedy(findings)
    lines = [f"{'ok  ' if f.good else '--  '}{f.subject:<17} {f.seen}" for f in findings]
    if command:
        lines.append(f"\nto install what is missing:\n  {command}")
    facts = {"findings": [asdict(f) for f in findings], "remedy": command}
    return print_result(options, facts, "\n".join(lines))

"""`python -m benchmarks.fuzz [MINUTES [TARGET …]]`: fuzz all readers, by default for an hour."""

import sys
import tempfile
from pathlib import Path

from benchmarks.fuzz.report import fuzz_all, table


def main(arguments: list[str]) -> int:
    minutes = float(arguments[0]) if arguments else None
    out = Path(tempfile.mkdtemp(prefix="vlnpe-fuzz-findings-"))
    summaries = fuzz_all(out, minutes, arguments[1:])
    sys.stdout.write(f"{table(summaries)}\n")
    findings = sum(len(s.findings) for s in summaries)
    sys.stdout.write(f"{findings} findings in {out}\n")
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

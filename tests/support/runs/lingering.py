"""A command whose items take a given time: `python -m tests.support.runs.lingering`."""

import sys
from pathlib import Path

from tests.support.runs import work
from vlnpe.pipeline.context import open_context
from vlnpe.pipeline.execution.runner import run_stage
from vlnpe.pipeline.engine.signals import Interrupted, interruptible
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.options.running import Running


def main(root: Path, seconds: float, wait: bool) -> int:
    try:
        with interruptible(), open_context(root, Running(workers=2, wait=wait)) as context:
            paths = [root / f"{name}.txt" for name in "abcd"]
            calls = [work.Call(work.linger, (path, seconds)) for path in paths]
            items = [WorkItem(p.stem, "k", (p,), c) for p, c in zip(paths, calls, strict=True)]
            return run_stage(context, "linger", items).quarantined
    except Interrupted as stop:
        return stop.exit_code


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), float(sys.argv[2]), "--wait" in sys.argv))

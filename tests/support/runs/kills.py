"""Kill a command in the middle of a stage."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from tests.support.runs import tiny_run
from vlnpe.formats.core.atomic import TEMPORARY_PREFIX

# One worker takes an episode through these stages; each begins when the one before it has written.
EPISODE_STAGES = {"replay": "", "render": "rollouts", "export": "frames", "mcap": "units"}
EPISODES = "episodes"  # the name of their common progress
# In a pipe, a stage's first line is written after `SHORT_S`; here, when the stage begins.
PROMPT = """
import sys
from vlnpe.formats.process import progress
from vlnpe.pipeline.cli import main

progress.SHORT_S = 0.0
sys.exit(main())
"""


def kill_in(command: Sequence[str], run: Path, stage: str, delay_s: float) -> bool:
    """Start a command and SIGKILL it some time after a stage has begun.

    Args:
        command: One of `tiny_run.command`.
        run: Folder it works in.
        stage: Name of the stage.
        delay_s: How long after its beginning [s].

    Returns:
        Whether the command was killed; it may have ended before.
    """
    assert command[: len(tiny_run.VLNPE)] == list(tiny_run.VLNPE)
    process = subprocess.Popen(
        [sys.executable, "-c", PROMPT, *command[len(tiny_run.VLNPE) :]],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        env=tiny_run.environment(),
    )  # fmt: skip
    assert process.stderr is not None
    line_start = f"{EPISODES if stage in EPISODE_STAGES else stage} "
    for line in process.stderr:
        if line.startswith(line_start):
            break
    # Its pipe must not fill up meanwhile.
    threading.Thread(target=process.stderr.read, daemon=True).start()
    if before := EPISODE_STAGES.get(stage):
        known = _written(run / before)
        while process.poll() is None and _written(run / before) <= known:
            time.sleep(0.005)
    time.sleep(delay_s)
    process.send_signal(signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


def _written(folder: Path) -> set[tuple[str, int]]:
    """Return the outputs of episodes below a folder, each with when it was written."""
    found = set()
    for path in folder.glob("*/**/*"):
        if any(part.startswith(TEMPORARY_PREFIX) for part in path.parts):
            continue
        try:
            found.add((str(path), path.stat().st_mtime_ns))
        except FileNotFoundError:  # replaced meanwhile
            continue
    return found

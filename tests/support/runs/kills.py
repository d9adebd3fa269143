"""Kill a command in the middle of a stage."""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from collections.abc import Sequence

from tests.support.runs import tiny_run


def kill_in(command: Sequence[str], stage: str, delay_s: float) -> bool:
    """Start a command and SIGKILL it some time after a stage has begun.

    Args:
        command: The command.
        stage: Name of the stage, whose progress the command prints.
        delay_s: How long after its first line [s].

    Returns:
        Whether the command was killed; it may have ended before.
    """
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        env=tiny_run.environment(),
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith(f"{stage} "):
            break
    # Its pipe must not fill up meanwhile.
    threading.Thread(target=process.stderr.read, daemon=True).start()
    time.sleep(delay_s)
    process.send_signal(signal.SIGKILL)
    return process.wait() == -signal.SIGKILL

"""Encoding leaves every thread of the process as ordinary as it was."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from vlnpe.formats.video.mp4 import write_rgb_video
from vlnpe.formats.video.scheduling import ordinary_threads

TASKS = Path("/proc/self/task")
pytestmark = pytest.mark.skipif(not TASKS.is_dir(), reason="threads are listed on Linux only")


def policies() -> set[int]:
    found = set()
    for task in TASKS.iterdir():
        with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
            found.add(os.sched_getscheduler(int(task.name)))
    return found


@pytest.mark.parametrize("codec", ["h264", "av1"])
def test_no_encoder_makes_this_process_real_time(tmp_path, codec):
    seen: list[set[int]] = []

    def frames() -> Iterator[np.ndarray]:
        for shade in range(5):
            seen.append(policies())
            yield np.full((64, 64, 3), 40 * shade, np.uint8)

    write_rgb_video(tmp_path / "a.mp4", frames(), 4, codec)
    # Also while it encodes: frames are made by processes and threads that start meanwhile.
    assert not set.union(*seen, policies()) & {os.SCHED_FIFO, os.SCHED_RR}


def test_a_thread_that_becomes_real_time_is_made_ordinary():
    try:
        with ordinary_threads() as restore:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
            restore()
            assert os.sched_getscheduler(0) == os.SCHED_OTHER
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        pytest.skip("only the administrator may ask for real-time priority")
    assert os.sched_getscheduler(0) == os.SCHED_OTHER

"""`vlnpe drive` in real time on one core: pictures per second, response, memory.

    python -m benchmarks.viewing.drive RUN ROBOT [SECONDS]

The drive runs on one core, this client on another one. A real page adds what its browser takes.
"""

import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

from tests.support.driver import AHEAD, LEFT, NOTHING, Page, start

BACK = (-1.0, 0.0, 0.0)


def main(run: str, robot: str, seconds: float = 60.0) -> None:
    """Drive to and fro, and print what was measured."""
    with tempfile.TemporaryDirectory() as folder:
        os.sched_setaffinity(0, {0})  # the drive inherits it
        process, url = start(run, "--robot", robot, "--out", Path(folder) / "out")
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
        page = Page(url)
        page.until("waits")
        commands, responses, paces, memory = [], [], [], []
        first_s, first = time.monotonic(), _cpu_s(process.pid)
        page.pictures.clear()
        while (past_s := time.monotonic() - first_s) < seconds:
            for sticks in (AHEAD, LEFT, BACK, LEFT):
                sent_s = time.monotonic()
                number = page.state["number"] + 1
                page.send({"sticks": sticks, "number": number})
                while page.state["number"] != number and time.monotonic() - sent_s < 2.0:
                    page.watch(0.002)
                commands.append(page.state["answer_ms"])
                responses.append(1e3 * (time.monotonic() - sent_s))
                page.hold(sticks, 1.5)
                if page.state["pace"]:
                    paces.append(page.state["pace"])
                if page.state["state"] == "ended":
                    page.do("undo")
            memory.append((past_s, _rss_mib(process.pid)))
        spent_s = time.monotonic() - first_s
        cpu = (_cpu_s(process.pid) - first) / spent_s
        rate = len(page.pictures) / spent_s
        page.send({"sticks": NOTHING, "number": 1})
        process.terminate()
        process.communicate()
    stages = [memory[k] for k in (0, len(memory) // 2, -1)]
    lines = [
        f"{robot}: {rate:.1f} pictures/s, {cpu:.2f} of a core",
        f"real time: {min(paces):.2f} × at least, {statistics.median(paces):.2f} × median",
        f"message to command: {_spread(commands)}",
        f"message to picture: {_spread(responses)}",
        "memory: " + ", ".join(f"{mib:.0f} MiB after {at:.0f} s" for at, mib in stages),
    ]
    sys.stdout.write("\n".join(lines) + "\n")


def _spread(times_ms: list[float]) -> str:
    ordered = sorted(times_ms)
    late = ordered[int(0.95 * len(ordered))]
    return f"{statistics.median(ordered):.0f} ms median, {late:.0f} ms p95 of {len(ordered)}"


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _rss_mib(pid: int) -> float:
    return (
        int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
    )


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], *map(float, sys.argv[3:]))

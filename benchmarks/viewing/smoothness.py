"""`vlnpe view` in headless Chromium: time to open, frames per second, and who spends the CPU.

    python -m benchmarks.viewing.smoothness RUN [SECONDS]

Chromium draws on the CPU here, as it does where there is no graphics card.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.support.devtools import Page, chromium
from tests.support.runs.tiny_run import VLNPE, environment

RENDERED = "window.__viserTestpoints?.rendererInfo.render"
FRAMES = f"{RENDERED}?.frame ?? 0"
INFO = f"`${{{RENDERED}.triangles}} triangles in ${{{RENDERED}.calls}} calls`"
SIZE = "(c => `${c.width} x ${c.height} px`)(document.querySelector('canvas'))"
# Poses: how often the robot's place differs from the one a frame before.
COUNT_POSES = """(() => { let last = ''; window.poses = 0; (function count() {
  const at = window.__viserMutable?.nodePoseData?.[window.robotNode];
  const text = at ? JSON.stringify(at) : '';
  if (text && text !== last) { last = text; window.poses++ }
  requestAnimationFrame(count) })() })()"""
KINDS = {"--type=gpu-process": "drawing", "--type=renderer": "page", "benchmark-view": "browser"}


def main(run: str, seconds: float = 10.0) -> None:
    """Open the run's first walk, play it, and print what was measured."""
    began_s = time.monotonic()
    process = subprocess.Popen(
        [*VLNPE, "view", run, "--no-open"], stdout=subprocess.PIPE, text=True, env=environment()
    )
    assert process.stdout is not None
    address = re.search(r"http://\S+", process.stdout.readline())
    assert address is not None
    say(f"opens: {time.monotonic() - began_s:.1f} s, {cpu_s(process.pid):.1f} CPU-s")
    with (
        tempfile.TemporaryDirectory(prefix="benchmark-view") as folder,
        chromium(Path(folder)) as page,
    ):
        began_s, before = time.monotonic(), chromium_cpu(folder)
        page.open(address[0])
        page.wait(f"{RENDERED}?.triangles > 10000 && document.body.innerText.includes('Play')")
        passed_s = time.monotonic() - began_s
        say(f"first frame: {passed_s:.1f} s, {spent(before, chromium_cpu(folder))}")
        settle(page)
        say(f"a frame: {page.evaluate(INFO)}")
        played(page, process.pid, folder, seconds)
    process.terminate()
    process.wait()


def say(line: str) -> None:
    """Print a line."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def settle(page: Page) -> None:
    """Wait until the page draws no more than its one frame a second."""
    frames = page.evaluate(FRAMES)
    for _ in range(60):
        time.sleep(2.0)
        frames, before = page.evaluate(FRAMES), frames
        if frames - before <= 4:
            return


def played(page: Page, pid: int, folder: str, seconds: float) -> None:
    """Play for some seconds and print frames and CPU."""
    page.evaluate(
        "window.robotNode = Object.keys(__viserMutable.nodePoseData ?? {})"
        ".find(name => name.startsWith('/robot/'))"
    )
    page.evaluate(COUNT_POSES)
    page.key(" ", "Space")
    time.sleep(3.0)  # for the page to choose its resolution
    first, poses, start_s = page.evaluate(FRAMES), page.evaluate("poses"), time.monotonic()
    before = {**chromium_cpu(folder), "Python": cpu_s(pid)}
    time.sleep(seconds)
    after = {**chromium_cpu(folder), "Python": cpu_s(pid)}
    wall_s = time.monotonic() - start_s
    frames, poses = page.evaluate(FRAMES) - first, page.evaluate("poses") - poses
    rates = f"{frames / wall_s:.1f} frames/s, {poses / wall_s:.1f} poses/s"
    say(f"plays: {rates}; of {wall_s:.0f} s {spent(before, after)}")
    say(f"the picture: {page.evaluate(SIZE)}")
    page.key(" ", "Space")


def spent(before: dict[str, float], after: dict[str, float]) -> str:
    """Return the CPU time of each kind of process."""
    kinds = sorted(after)
    return ", ".join(f"{kind} {after[kind] - before.get(kind, 0.0):.1f} CPU-s" for kind in kinds)


def chromium_cpu(folder: str) -> dict[str, float]:
    """Return the CPU time of Chromium's processes with a profile in `folder`, by kind [s]."""
    result: dict[str, float] = {}
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().decode(errors="replace")
            if "chrom" not in words or folder not in words:
                continue
            kind = next((name for word, name in KINDS.items() if word in words), "browser")
            result[kind] = result.get(kind, 0.0) + cpu_s(int(entry.name))
        except (OSError, ValueError):
            continue
    return result


def cpu_s(pid: int) -> float:
    """Return the CPU time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:]))

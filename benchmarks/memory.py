"""Peak memory of `collect` with few and with many short episodes: driver and workers apart."""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COUNTS = (100, 1000)
LOOKED_S = 0.5  # between looks at the processes, whose peaks the kernel keeps
# Short walks without a body, tiny pictures: what grows with episodes alone.
OPTIONS = (
    "--scene", "builtin-exact:apartment", "--robot", "vlnce", "--camera", "ego:32x32",
    "--min-length-m", "1", "--min-crossings", "0", "--min-gap-m", "0.3", "--allow-fewer",
)  # fmt: skip


def report(_: Path) -> str:
    """Collect some numbers of episodes; return a Markdown section."""
    lines = []
    with tempfile.TemporaryDirectory(prefix="vlnpe-memory-") as folder:
        prepared = Path(folder) / "prepared"
        # Repairing the scene takes more memory than walking in it.
        subprocess.run(_command(prepared, 2), cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
        for count in COUNTS:
            driver, worker, episodes_made = measure(prepared, count)
            lines.append(f"| {episodes_made:,} | {driver:,.0f} | {worker:,.0f} |")
    return "\n".join(
        [
            "## Memory and the number of episodes",
            "",
            "`vlnpe collect` of short walks without a body in an apartment, 32 × 32 pixels:",
            "peak resident memory of the started process, and of its largest worker.",
            "",
            "| episodes | driver MiB | worker MiB |",
            "| ---: | ---: | ---: |",
            *lines,
            "",
        ]
    )


def measure(prepared: Path, episodes: int) -> tuple[float, float, int]:
    """Collect in a copy of a run folder.

    Returns:
        The peaks of driver and largest worker [MiB], and the number of episodes made.
    """
    run = prepared.with_name(f"run-{episodes}")
    shutil.copytree(prepared, run)
    shutil.rmtree(run / "rollouts")
    driver = worker = 0
    command = _command(run, episodes)
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            driver = max(driver, _peak_kib(process.pid))
            worker = max([worker, *map(_peak_kib, _children(process.pid))])
            time.sleep(LOOKED_S)
    # 1: an episode was quarantined, for want of a true text for example; the others were made.
    if process.returncode not in (0, 1):
        raise RuntimeError(f"collect ended with code {process.returncode}")
    episodes_made = sum(1 for _ in (run / "rollouts").rglob("*.mcap"))
    shutil.rmtree(run)
    return driver / 1024, worker / 1024, episodes_made


def _command(run: Path, episodes: int) -> list[str]:
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", "collect", *OPTIONS]
    return [*command, "--splits", f"train={episodes}", "--out", str(run)]


def _peak_kib(process: int) -> int:
    """Return the peak resident memory of a process [KiB]; 0 if it has ended."""
    try:
        status = Path(f"/proc/{process}/status").read_text().split()
    except OSError:
        return 0
    return int(status[status.index("VmHWM:") + 1]) if "VmHWM:" in status else 0


def _children(process: int) -> list[int]:
    try:
        tasks = list(Path(f"/proc/{process}/task").glob("*/children"))
        return [int(child) for task in tasks for child in task.read_text().split()]
    except OSError:
        return []

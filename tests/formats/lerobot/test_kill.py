"""Killed at any moment, nothing finished is lost, and nothing half-written is seen."""

import hashlib
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from vlnpe.formats.core.atomic import TEMPORARY_PREFIX
from vlnpe.formats.lerobot import read_episode_unit

pytestmark = pytest.mark.slow

EPISODES = 6
KILLS = 4

# As the export stage does: units that are there are left alone, then all are assembled.
EXPORT = """
import sys
from pathlib import Path
import tests.support.lerobot_data as data
from tests.support.rollouts import make_rollout
from vlnpe.formats.core.atomic import sweep
from vlnpe.formats.lerobot import assemble_dataset
root = Path(sys.argv[1])
sweep(root)
print("ready", flush=True)
for number in range(int(sys.argv[2])):
    if not (root / f"unit-{number}").is_dir():
        data.write_unit(root, make_rollout(2.0, number), number)
        print(f"unit-{number}", flush=True)
units = [root / f"unit-{number}" for number in range(int(sys.argv[2]))]
assemble_dataset(units, root / "set", provenance={}, licence="mit", title="Rooms")
print("done", flush=True)
"""


def start(root: Path) -> subprocess.Popen[str]:
    """Start a process that is about to write."""
    child = subprocess.Popen(
        [sys.executable, "-c", EXPORT, str(root), str(EPISODES)],
        cwd=Path(__file__).resolve().parents[3],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None and child.stdout.readline() == "ready\n"
    return child


def finish(child: subprocess.Popen[str]) -> list[str]:
    """Wait for a process; return its output in words."""
    output, _ = child.communicate()
    return output.split()


def digests(root: Path) -> dict[str, str]:
    files = [path for path in root.rglob("*") if path.is_file()]
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files
    }


@pytest.mark.parametrize("seed", [0])
def test_killed_at_any_moment_it_goes_on_to_the_same_dataset(tmp_path: Path, seed: int) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    whole.mkdir()
    broken.mkdir()
    started = time.perf_counter()
    assert finish(start(whole))[-1] == "done"
    seconds = time.perf_counter() - started
    rng = np.random.default_rng(seed)
    before: dict[str, str] = {}
    for wait in rng.uniform(0.0, 0.3 * seconds, KILLS):
        child = start(broken)
        time.sleep(wait)
        child.kill()
        finish(child)
        units = [p for p in broken.glob("unit-*") if p.is_dir()]
        for unit in units:
            assert read_episode_unit(unit).rows().num_rows == 9  # whole, or not there
        now = {unit.name: str(digests(unit)) for unit in units}
        assert before.items() <= now.items()
        before = now
        assert not (broken / "set").exists() or digests(broken / "set") == digests(whole / "set")
    output = finish(start(broken))
    assert output[-1] == "done" and not set(output) & before.keys()
    assert digests(broken / "set") == digests(whole / "set")
    left = list(broken.rglob(f"{TEMPORARY_PREFIX}*"))
    assert left == []

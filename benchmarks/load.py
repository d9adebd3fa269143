"""Our loaders against LeRobot's own dataset, on the same frames in the same process."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

FRAMES = 60  # single frames and windows per round
ROUNDS = 5
EPISODES = 3  # whole episodes per round
HISTORY = 4


def report(run: Path) -> str:
    """Load frames, windows and whole episodes of a dataset in `run`; a Markdown section."""
    os.environ["HF_HUB_OFFLINE"] = "1"
    import torch

    from vlnpe.datasets.local import open_dataset
    from vlnpe.datasets.navigation import NavigationConfig, NavigationDataset
    from vlnpe.datasets.selection import select_all
    from vlnpe.datasets.sequences import EpisodeSequences
    from vlnpe.datasets.tokens import training_tokens
    from vlnpe.formats.lerobot.layout import DEPTH_KEY, RGB_KEY

    torch.set_num_threads(1)
    root = next((run / "lerobot").iterdir())
    selection = select_all([root])
    tokens = training_tokens(words[0] for words in selection.labels("instructions"))
    options: dict[str, Any] = {"video_backend": "pyav", "return_uint8": True}
    back = [-k / selection.datasets[0].frames_per_second for k in range(HISTORY - 1, -1, -1)]
    bare = open_dataset(root, **options)
    bare_history = open_dataset(root, delta_timestamps={RGB_KEY: back, DEPTH_KEY: back}, **options)
    ours = NavigationDataset(selection)
    ours_history = NavigationDataset(selection, NavigationConfig(history=HISTORY))
    sequences = EpisodeSequences(selection, tokens)

    rng = np.random.default_rng(0)
    starts = np.concatenate([[0], np.cumsum(selection.lengths)])
    frames = [rng.integers(0, len(ours), FRAMES).tolist() for _ in range(ROUNDS)]
    chosen = [rng.integers(0, len(selection), EPISODES).tolist() for _ in range(ROUNDS)]

    def each(dataset: Any) -> Callable[[list[int]], int]:
        return lambda numbers: sum(dataset[n] is not None for n in numbers)

    def frame_by_frame(episodes: list[int]) -> int:
        numbers = [n for e in episodes for n in range(int(starts[e]), int(starts[e + 1]))]
        return each(bare)(numbers)

    def at_once(episodes: list[int]) -> int:
        return sum(int(sequences[e]["length"]) for e in episodes)

    rows = [
        _row("single frames", each(bare), each(ours), frames),
        _row(f"{HISTORY} frames of history", each(bare_history), each(ours_history), frames),
        _row("whole episodes, per frame", frame_by_frame, at_once, chosen),
    ]
    before = _resident_mb()
    for _ in range(2):
        for episode in range(len(selection)):
            sequences[episode]
    grown = _resident_mb() - before
    episode_mb = sum(v.nbytes for v in sequences[0].values() if torch.is_tensor(v)) / 1e6
    height, width, _ = selection.datasets[0].shapes[RGB_KEY][1]
    lines = [
        "## Loading",
        "",
        f"{root.name}: RGB and depth of {width} × {height}, random frames and whole episodes; both",
        "decode with PyAV in this process. Medians of the ratios of "
        f"{ROUNDS} rounds, in each of which both read the same.",
        "",
        "| | LeRobotDataset, samples/s | ours, samples/s | ratio | ratio of CPU time |",
        "| --- | ---: | ---: | ---: | ---: |",
        *rows,
        "",
        f"Two more passes over all {len(selection)} episodes grew the process by {grown:.0f} MB;",
        f"one decoded episode takes {episode_mb:.0f} MB.",
    ]
    return "\n".join(lines) + "\n"


def _row(
    name: str,
    theirs: Callable[[list[int]], int],
    ours: Callable[[list[int]], int],
    rounds: list[list[int]],
) -> str:
    theirs(rounds[0][:2])
    ours(rounds[0][:2])
    rates = [(_rates(theirs, numbers), _rates(ours, numbers)) for numbers in rounds]
    a, b = (median(pair[k][0] for pair in rates) for k in (0, 1))
    wall, cpu = (median(ours[k] / other[k] for other, ours in rates) for k in (0, 1))
    return f"| {name} | {a:,.0f} | {b:,.0f} | {wall:.1f} | {cpu:.1f} |"


def _rates(load: Callable[[list[int]], int], numbers: list[int]) -> tuple[float, float]:
    """Return samples per second of wall time and of CPU time."""
    wall, cpu = time.perf_counter(), time.process_time()
    count = load(numbers)
    return count / (time.perf_counter() - wall), count / (time.process_time() - cpu)


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

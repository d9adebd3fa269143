"""How long a training waits for its data: the recipe `starter` on decoded episodes, in one process.

The loader reads and joins the next batch in the process that trains, so all of its time is time in
which the model waits. Each model takes the same batches, once for the loader alone and once for
the steps.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vlnpe.learning.config import TrainConfig
    from vlnpe.learning.training.cache import CachedSequences

STEPS = 40
MODELS = ("cma", "seq2seq", "rdp")


def report(run: Path) -> str:
    """Train each model on a dataset in `run`; return a Markdown section."""
    import torch

    from vlnpe.datasets.mixture.recipe import read_recipe
    from vlnpe.datasets.mixture.shipped import recipe_path
    from vlnpe.datasets.selection import select_all
    from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig
    from vlnpe.datasets.tokens import training_tokens
    from vlnpe.learning.config import train_config
    from vlnpe.learning.models.heads import FUTURE
    from vlnpe.learning.training.cache import CachedSequences

    torch.set_num_threads(1)
    recipe = dict(read_recipe(recipe_path("starter")).train)
    configs = [
        train_config(
            recipe
            | {"steps": STEPS, "checkpoint_every": STEPS, "model": recipe["model"] | {"name": name}}
        )
        for name in MODELS
    ]
    selection = select_all([next((run / "lerobot").iterdir())])
    tokens = training_tokens(words[0] for words in selection.labels("instructions"))
    first = configs[0]
    how = SequenceConfig(first.size_px, first.max_steps, first.inflection, future=FUTURE)
    with tempfile.TemporaryDirectory(dir=run) as scratch:
        folder = Path(scratch)
        episodes = CachedSequences(EpisodeSequences(selection, tokens, how), folder / "cache")
        episodes.prepare(0)  # opens decoders and imports what they need
        decoding = _seconds(lambda: [episodes.prepare(n) for n in range(1, len(episodes))])
        rows = [_row(episodes, config, folder) for config in configs]
    lines = [
        "## Training",
        "",
        f"The recipe `starter`, {STEPS} steps on episodes that are decoded already "
        f"({1e3 * decoding / (len(episodes) - 1):.0f} ms per",
        "episode, once for all models), one thread, CPU time. The loader reads in the process that",
        "trains: its share is the time for which the model waits.",
        "",
        "| model | episodes/s | ms per step | of which loader |",
        "| --- | ---: | ---: | ---: |",
        *rows,
    ]
    return "\n".join(lines) + "\n"


def _row(episodes: CachedSequences, config: TrainConfig, folder: Path) -> str:
    from vlnpe.datasets.mixture.loader import MixtureLoader
    from vlnpe.datasets.mixture.sampler import MixtureSampler
    from vlnpe.datasets.sequences import collate_sequences
    from vlnpe.learning.training.train import train_model

    draws = STEPS * config.batch
    state = folder / f"{config.model.name}.pt"
    sampler = MixtureSampler([len(episodes)], [1.0], 0, draws)
    batches = MixtureLoader([episodes], sampler, config.batch, collate=collate_sequences)
    loading = _seconds(lambda: list(batches))
    whole = _seconds(
        lambda: train_model(
            [episodes], [1.0], episodes.sequences.tokens, config, seed=0, state=state
        )
    )
    return (
        f"| {config.model.name} | {draws / whole:.0f} | {1e3 * whole / STEPS:.0f} | "
        f"{100 * loading / whole:.1f} % |"
    )


def _seconds(work: Callable[[], object]) -> float:
    """Return the CPU seconds of this process that `work` takes."""
    start = time.process_time()
    work()
    return time.process_time() - start

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

STEPS = 40
MODELS = ("cma", "seq2seq", "rdp")


def report(run: Path) -> str:
    """Train each model on a dataset in `run`; return a Markdown section."""
    lines = [
        "## Training",
        "",
        f"The recipe `starter`, {STEPS} steps on episodes that are decoded already, one thread,",
        "CPU time. The loader reads in the process that trains: its share is the time for which",
        "the model waits.",
        "",
        "| model | episodes/s | ms per step | of which loader | decoding, ms per episode, once |",
        "| --- | ---: | ---: | ---: | ---: |",
        *(_row(run, model) for model in MODELS),
    ]
    return "\n".join(lines) + "\n"


def _row(run: Path, model: str) -> str:
    import torch

    from vlnpe.datasets.mixture.loader import MixtureLoader
    from vlnpe.datasets.mixture.recipe import read_recipe, recipe_path
    from vlnpe.datasets.mixture.sampler import MixtureSampler
    from vlnpe.datasets.selection import select_all
    from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig, collate_sequences
    from vlnpe.datasets.tokens import training_tokens
    from vlnpe.learning.config import train_config
    from vlnpe.learning.models.heads import FUTURE
    from vlnpe.learning.training.cache import CachedSequences
    from vlnpe.learning.training.train import train_model

    torch.set_num_threads(1)
    recipe = dict(read_recipe(recipe_path("starter")).train)
    config = train_config(
        recipe
        | {"steps": STEPS, "checkpoint_every": STEPS, "model": recipe["model"] | {"name": model}}
    )
    selection = select_all([next((run / "lerobot").iterdir())])
    tokens = training_tokens(words[0] for words in selection.labels("instructions"))
    how = SequenceConfig(config.size_px, config.max_steps, config.inflection, future=FUTURE)
    with tempfile.TemporaryDirectory(dir=run) as scratch:
        folder = Path(scratch)
        sequences = EpisodeSequences(selection, tokens, how)
        episodes = CachedSequences(sequences, folder / "cache", config.model.inputs)
        episodes.prepare(0)  # opens decoders and imports what they need
        decoding = _seconds(lambda: [episodes.prepare(n) for n in range(1, len(episodes))])
        sampler = MixtureSampler([len(episodes)], [1.0], 0, STEPS * config.batch)
        batches = MixtureLoader([episodes], sampler, config.batch, collate=collate_sequences)
        loading = _seconds(lambda: list(batches))
        whole = _seconds(
            lambda: train_model(
                [episodes], [1.0], tokens, config, seed=0, state=folder / "state.pt"
            )
        )
    return (
        f"| {model} | {STEPS * config.batch / whole:.0f} | {1e3 * whole / STEPS:.0f} | "
        f"{100 * loading / whole:.1f} % | {1e3 * decoding / (len(episodes) - 1):.0f} |"
    )


def _seconds(work: Callable[[], object]) -> float:
    """Return the CPU seconds of this process that `work` takes."""
    start = time.process_time()
    work()
    return time.process_time() - start

"""Time that a training waits for its data: the recipe `starter` on decoded episodes.

A thread reads and joins the next batch while the device works on this one. Each model takes the
same batches; the first steps, in which libraries warm up, are left out. On a machine with CUDA,
the models are trained there, too, and one that is large enough to keep it busy.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vlnpe.datasets.selection import Selection
    from vlnpe.datasets.tokens import Tokens
    from vlnpe.learning.config import TrainConfig
    from vlnpe.learning.training.cache import CachedSequences

STEPS, WARM_UP = 40, 8
MODELS = ("cma", "seq2seq", "rdp")
LARGER: dict[str, Any] = {"size_px": 64, "batch": 32}
LARGER_MODEL: dict[str, Any] = {"name": "cma", "channels": [32, 64, 128, 256], "hidden": 512}


def report(run: Path) -> str:
    """Train each model on a dataset in `run`; return a Markdown section."""
    import torch

    from vlnpe.datasets.mixture.recipe import read_recipe
    from vlnpe.datasets.mixture.shipped import recipe_path
    from vlnpe.datasets.selection import select_all
    from vlnpe.datasets.tokens import training_tokens
    from vlnpe.learning.config import train_config

    torch.set_num_threads(1)
    recipe = dict(read_recipe(recipe_path("starter")).train)
    recipe |= {"steps": STEPS, "checkpoint_every": STEPS, "device": "cpu"}
    settings = [recipe | {"model": recipe["model"] | {"name": name}} for name in MODELS]
    if torch.cuda.is_available():
        settings += [values | {"device": "cuda"} for values in settings]
        larger = {"device": "cuda", "model": recipe["model"] | LARGER_MODEL}
        settings.append(recipe | LARGER | larger)
    selection = select_all([next((run / "lerobot").iterdir())])
    tokens = training_tokens(words[0] for words in selection.labels("instructions"))
    with tempfile.TemporaryDirectory(dir=run) as scratch:
        rows = [
            _row(train_config(values), selection, tokens, Path(scratch) / str(number))
            for number, values in enumerate(settings)
        ]
    lines = [
        "## Training",
        "",
        f"The recipe `starter`, steps {WARM_UP} to {STEPS} on episodes that are decoded already,",
        "one thread of torch. A batch is read in another thread while the device works on the",
        "one before; what it still waits for is the column `waits`.",
        "",
        "| device | model | px | episodes per step | episodes/s | ms per step | waits | "
        "reading alone [ms] |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
        *rows,
    ]
    if torch.cuda.is_available():
        lines += ["", f"CUDA: {torch.cuda.get_device_name()}, torch {torch.__version__}."]
    return "\n".join(lines) + "\n"


def _row(config: TrainConfig, selection: Selection, tokens: Tokens, folder: Path) -> str:
    from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig
    from vlnpe.learning.models.heads import FUTURE
    from vlnpe.learning.training.cache import CachedSequences, decode_all
    from vlnpe.learning.training.train import Watcher, train_model

    how = SequenceConfig(config.size_px, config.max_steps, config.inflection, future=FUTURE)
    # Beside the folders of the rows, so that images of one size are decoded once.
    cache = folder.parent / "cache"
    episodes = CachedSequences(EpisodeSequences(selection, tokens, how), cache)
    decode_all([episodes], show=False)
    start = time.perf_counter()
    _read(episodes, config)
    reading = (time.perf_counter() - start) / STEPS
    folder.mkdir()
    ends: list[float] = []
    waits: list[float] = []
    # A step ends with its loss on the host, so that a GPU has done its work by then.
    watcher = Watcher(lambda done, loss: ends.append(time.perf_counter()), waited=waits.append)
    state = folder / "state.pt"
    train_model([episodes], [1.0], tokens, config, seed=0, state=state, watcher=watcher)
    steps = STEPS - WARM_UP
    whole, waited = ends[-1] - ends[WARM_UP - 1], sum(waits[WARM_UP:])
    return (
        f"| {config.device} | {config.model.name} | {config.size_px} | {config.batch} | "
        f"{steps * config.batch / whole:.0f} | {1e3 * whole / steps:.0f} | "
        f"{100 * waited / whole:.1f} % | {1e3 * reading:.0f} |"
    )


def _read(episodes: CachedSequences, config: TrainConfig) -> None:
    from vlnpe.datasets.mixture.loader import MixtureLoader
    from vlnpe.datasets.mixture.sampler import MixtureSampler
    from vlnpe.datasets.sequences import collate_sequences

    sampler = MixtureSampler([len(episodes)], [1.0], 0, STEPS * config.batch)
    for _ in MixtureLoader([episodes], sampler, config.batch, collate=collate_sequences):
        pass

"""How the composer's texts read: their words, their variety, and what the checker says of them."""

import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vlnpe.formats.core.episode import Episode
from vlnpe.formats.scene.visibility import read_visibility
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.composer import Usage, compose_texts
from vlnpe.instruction_gen.instruct import Levels, path_generator
from vlnpe.instruction_gen.records import STYLES
from vlnpe.instruction_gen.rivals import Rivals
from vlnpe.pipeline.engine.run_folder import RunFolder

from .diversity import table, words_of

Sample = tuple[Episode, Ground, Rivals]  # of one path


def load(folder: Path) -> list[Sample]:
    """Return the paths of a run, sampled or instructed, with their facts and rivals."""
    result: list[Sample] = []
    levels = Levels(folder / "scenes")
    for file in sorted((folder / "episodes" / "sampled").glob("*.json.gz")):
        scene = file.name.removesuffix(".json.gz")
        seen = RunFolder(folder).sights.seen(scene)
        sight = read_visibility(seen) if seen.is_file() else None
        for episode in read_episodes(file):
            facts = levels.facts(episode, sight)
            result.append((episode, Ground(facts), levels.rivals(episode, facts)))
    return result


def composed(paths: Sequence[Sample], seed: int = 0) -> dict[str, Any]:
    """Return figures of the three texts of each path, written scene by scene as `instruct` does."""
    usages: dict[str, Usage] = defaultdict(Usage)
    words: dict[str, list[int]] = {style: [] for style in STYLES}
    texts: list[str] = []
    left_out, first, true = [], 0, 0
    started = time.process_time()
    for episode, ground, rivals in paths:
        rng = path_generator(seed, f"{episode.scene_id}/{episode.trajectory_id}")
        written, reason = compose_texts(
            ground, 3, STYLES, rng, (), usages[episode.scene_id], rivals
        )
        left_out += [] if written else [f"{episode.trajectory_id}: {'; '.join(reason)}"]
        for text in written:
            texts.append(text.text)
            words[text.style].append(len(words_of(text.text)))
            first += text.attempts == 1
            true += check_text(text.text, ground).ok
    seconds = time.process_time() - started
    return {
        **table(texts),
        "paths": len(paths),
        "left out": left_out,
        "mean words by style": {k: round(sum(v) / max(1, len(v)), 1) for k, v in words.items()},
        "best draft accepted": round(first / max(1, len(texts)), 3),
        "accepted without the claims": round(true / max(1, len(texts)), 3),
        "CPU ms per path": round(1e3 * seconds / max(1, len(paths))),
    }

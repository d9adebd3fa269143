"""Run it: python -m benchmarks.instructions --scenes FOLDER [--scans FOLDER]
    [RUN…] [--out result.json]

The corpus (`corpus/*.json`) is measured by parts on the scenes in FOLDER; generated buildings that
are missing there need no scan. Each RUN is a folder with scenes/<scene>,
episodes/<scene>.json.gz and facts/<scene>.seen.json, as `vlnpe collect` writes them; the composer
is measured on it.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.formats.scene.visibility import read_visibility
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.instruction_gen.checker import Ground
from vlnpe.instruction_gen.composer import compose_texts
from vlnpe.instruction_gen.composer.compose import STYLES
from vlnpe.instruction_gen.facts import LevelFacts, path_facts
from vlnpe.pipeline.engine.run_folder import RunFolder

from .corpus import PARTS, measure, read_corpus
from .diversity import table


def load(folder: Path) -> list[Ground]:
    """Return the facts of the paths of a folder's scenes."""
    result = []
    for file in sorted(folder.glob("episodes/*.json.gz")):
        scene = file.name.removesuffix(".json.gz")
        bundle = load_bundle(folder / "scenes" / scene)
        seen = RunFolder(folder).sights.seen(scene)
        sight = read_visibility(seen) if seen.is_file() else None
        levels: dict[int, LevelFacts] = {}
        for episode in read_episodes(file):
            if episode.level not in levels:
                levels[episode.level] = LevelFacts.of(bundle, episode.level)
            result.append(Ground(path_facts(episode, levels[episode.level], sight)))
    return result


def composer(paths: list[Ground]) -> dict[str, Any]:
    """Return diversity, skeletons and speed of the composer."""
    rng = np.random.default_rng(0)
    texts: list[str] = []
    skeletons: set[str] = set()
    started = time.process_time()
    for ground in paths:
        for sample in compose_texts(ground, 3, STYLES, rng)[0]:
            texts.append(sample.text)
            skeletons.update(sample.skeletons)
    seconds = time.process_time() - started
    return {
        **table(texts),
        "skeletons": len(skeletons),
        "paths": len(paths),
        "ms per path (3 texts composed and checked)": round(1e3 * seconds / max(1, len(paths)), 1),
    }


def main() -> None:
    """Print the results as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", type=Path)
    parser.add_argument("--scenes", type=Path)
    parser.add_argument("--scans", type=Path)
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    result: dict[str, Any] = {}
    for part in (options.part or PARTS) if options.scenes else ():
        result[part] = measure(read_corpus(options.scenes, options.scans, (part,)))
    paths = [sample for run in options.runs for sample in load(run)]
    if paths:
        result["composer"] = composer(paths)
    text = json.dumps(result, indent=1, ensure_ascii=False)
    if options.out:
        options.out.write_text(text + "\n")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()

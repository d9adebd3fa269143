"""Inventions that no table lists: python -m benchmarks.instructions.unlisted [--part PART]…

Fifty nouns that are in no table of the language are planted into true texts of the composer about
paths of the corpus: `Pass the …` before the last sentence, `Stop by the …` in place of its stop,
`… by the …` and `… near the little …` after its stop, `With the … on your left` before all, and
`turn left at the …`. Prints how many are refused, and how many of the corpus' true texts are.
"""

import argparse
import json
import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from vlnpe.instruction_gen.checker import check_text
from vlnpe.instruction_gen.composer import compose_texts
from vlnpe.instruction_gen.records import STYLES

from .corpus import PARTS, read_corpus

_NOUNS = """abacus amphora apiary armillary bagpipe ballista bassoon bathysphere birdhouse brazier
    breadbox butterchurn cabana chaise cistern clepsydra davenport dulcimer escritoire firepit
    footbath galvanometer gantry hovercraft humidor hutch incinerator jardiniere kiln kimono
    kneeler lightbox mainframe mandolin manikin metronome minibar moped orrery periscope pinwheel
    popsicle rotisserie seismograph sousaphone spittoon telex theremin tuffet zither"""
_STOP = re.compile(r"\b(?:stop|wait|halt)\b[^.]*\.$", re.IGNORECASE)
_TURN = re.compile(r"\b(?:turn|bear|go) (?:left|right)\b")
_LAST = re.compile(r"[^.]*\.$")


def planted(text: str, noun: str) -> dict[str, str]:
    """Return texts that name a thing which does not exist, by how they do."""
    last = _LAST.search(text)
    result = {"passed": f"{text[: last.start()]} Pass the {noun}.{last[0]}"} if last else {}
    if stop := _STOP.search(text):
        result["stopped at"] = f"{text[: stop.start()]}stop by the {noun}."
        result["stopped at, too"] = f"{text[:-1]}, by the {noun}."
        result["stopped at, behind a word"] = f"{text[:-1]}, near the little {noun}."
    result["seen"] = f"With the {noun} on your left, {text[0].lower()}{text[1:]}"
    if _TURN.search(text):
        result["turned at"] = _TURN.sub(rf"\g<0> at the {noun}", text, count=1)
    return {kind: re.sub(r"\s+", " ", lie).strip() for kind, lie in result.items()}


def main() -> None:
    """Print the counts as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--scenes", type=Path, default=Path("none"))
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    caught: dict[str, Counter[bool]] = {}
    refused = composed = judged = 0
    false: list[list[str]] = []
    for entry in read_corpus(options.scenes, None, tuple(options.part or ("sealed5",))):
        for text in entry.texts:
            judged += 1
            verdict = check_text(text, entry.ground)
            refused += not verdict.ok
            false += [[entry.name, text, *verdict.problems]] * (not verdict.ok)
        texts = compose_texts(entry.ground, 3, STYLES, rng)[0]
        composed += len(texts)
        for sample in texts:
            for noun in rng.permutation(_NOUNS.split())[:5]:
                for kind, lie in planted(sample.text, str(noun)).items():
                    caught.setdefault(kind, Counter())[not check_text(lie, entry.ground).ok] += 1
    counts = {kind: [counter[True], sum(counter.values())] for kind, counter in caught.items()}
    result = {"composed": composed, "caught": counts, "true": judged, "refused": refused}
    sys.stdout.write(json.dumps({**result, "refused texts": false}, indent=1) + "\n")


if __name__ == "__main__":
    main()

"""Truths and lies written one by one: python -m benchmarks.instructions.blind [--half sealed]

Texts in three voices. The parts `unseen_open` and `unseen_sealed` of the corpus were written from
facts and maps by three writers who had seen none of the code, and come with claims; `blind` and
`blind2` by one who knew the checker. Half of each was sealed while the checker was worked on
(`blind` was corrected after it was opened; `blind2`, the half `second`, was written after that).
Printed are the lies caught and the truths refused, with 95 % intervals, of texts alone and of texts
with claims:

- `alone`: claims are read from the text.
- `with claims`: each sentence comes with what it claims, as one who lies in both would deliver it.
- `true claims`: the words lie beside true claims.
"""

import argparse
import hashlib
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vlnpe.instruction_gen.checker import check_text
from vlnpe.instruction_gen.language.claims import Step
from vlnpe.instruction_gen.language.reader import read_text

from .corpus import Entry, read_corpus
from .lies import KINDS

HALVES = ("open", "sealed", "second", "unseen_open", "unseen_sealed")
TRUE = "true"
_SENTENCE = re.compile(r"[^.!?]+[.!?]+")
_Z = 1.96


def half_of(entry: Entry, text: str) -> str:
    """Return the half that a text of a path belongs to."""
    if entry.part.startswith("unseen"):
        return entry.part
    if entry.part == "blind2":
        return "second"
    return HALVES[hashlib.sha256(text.encode()).digest()[0] % 2]


def written(entries: Sequence[Entry], half: str) -> Iterator[tuple[Entry, str, str]]:
    """Yield path, kind and text of all texts of a half; the kind of a truth is `TRUE`."""
    for entry in entries:
        texts = [(TRUE, text) for text in entry.texts]
        texts += [(lie["kind"], lie["text"]) for lie in entry.lies]
        yield from ((entry, kind, text) for kind, text in texts if half_of(entry, text) == half)


def delivered(entry: Entry, text: str) -> Sequence[Step]:
    """Return the sentences of a text with its writer's claims, else with those that are read."""
    if text in entry.claims:
        return entry.claims[text]
    read = read_text(text)
    result = []
    for found in _SENTENCE.finditer(text):
        steps = [step for step in read if found.start() <= step.start < found.end()]
        result.append(Step(found[0].strip(), tuple(c for step in steps for c in step.claims)))
    return result


def share(refused: int, total: int) -> str:
    """Return `refused of total (percent, low … high)`, with Wilson's 95 % interval."""
    if not total:
        return "none"
    p, z2 = refused / total, _Z**2 / total
    middle = (p + z2 / 2) / (1 + z2)
    half = _Z * np.sqrt(p * (1 - p) / total + z2 / (4 * total)) / (1 + z2)
    low, high = 100 * max(0.0, middle - half), 100 * min(1.0, middle + half)
    return f"{refused} of {total} ({100 * p:.1f} %, {low:.0f} … {high:.0f})"


def tables(entries: Sequence[Entry], half: str) -> dict[str, Any]:
    """Return the counts of one half."""
    counts: dict[str, Counter[str]] = {"alone": Counter(), "with claims": Counter()}
    total: Counter[str] = Counter()
    wrong: list[list[Any]] = []
    for entry, kind, text in written(entries, half):
        total[kind] += 1
        for way, steps in (("alone", []), ("with claims", delivered(entry, text))):
            verdict = check_text(text, entry.ground, steps)
            counts[way][kind] += not verdict.ok
            if verdict.ok == (kind != TRUE):
                wrong.append([way, kind, entry.name, text, *verdict.problems])
    result: dict[str, Any] = {}
    for way, refused in counts.items():
        lies = [kind for kind in total if kind != TRUE]
        result[way] = {
            "truths refused": share(refused[TRUE], total[TRUE]),
            "lies caught": share(sum(refused[k] for k in lies), sum(total[k] for k in lies)),
            **{kind: share(refused[kind], total[kind]) for kind in sorted(lies)},
        }
    result["true claims"] = _planted(entries, half)
    return {**result, "wrong": wrong}


def _planted(entries: Sequence[Entry], half: str) -> dict[str, str]:
    """Return how often a lie in the words is caught where the claims stay those of the truth."""
    rng = np.random.default_rng(0)
    caught, total = Counter[str](), Counter[str]()
    for entry, kind, text in written(entries, half):
        if text in entry.true_claims:
            total[kind] += 1
            caught[kind] += not check_text(text, entry.ground, entry.true_claims[text]).ok
        steps = delivered(entry, text)
        if entry.claims or kind != TRUE or not check_text(text, entry.ground, steps).ok:
            continue
        for name, lie in KINDS.items():
            false = lie(text, entry.ground.facts, rng) or text
            words = [sentence[0].strip() for sentence in _SENTENCE.finditer(false)]
            if false == text or len(words) != len(steps):
                continue
            told = [replace(step, words=said) for step, said in zip(steps, words, strict=True)]
            total[name] += 1
            caught[name] += not check_text(false, entry.ground, told).ok
    every = share(sum(caught.values()), sum(total.values()))
    return {"lies caught": every, **{k: share(caught[k], total[k]) for k in total}}


def main() -> None:
    """Print the tables as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--half", choices=HALVES, action="append")
    options = parser.parse_args()
    entries = read_corpus(Path("none"), None, ("blind", "blind2", "unseen_open", "unseen_sealed"))
    result = {half: tables(entries, half) for half in options.half or HALVES}
    sys.stdout.write(json.dumps(result, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()

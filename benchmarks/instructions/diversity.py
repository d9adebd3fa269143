"""Diversity of texts: the measures of NavInstrCritic, from their published definitions."""

import math
import re
import zlib
from collections import Counter
from collections.abc import Sequence


def words_of(text: str) -> list[str]:
    """Return the lower-case words."""
    return re.findall(r"[a-z']+", text.lower())


def mattr(texts: Sequence[str], window: int = 50) -> float:
    """Return the moving-average type-token ratio over all texts (Covington and McFall, 2010)."""
    words = [w for t in texts for w in words_of(t)]
    if len(words) <= window:
        return len(set(words)) / max(1, len(words))
    ratios = [len(set(words[k : k + window])) / window for k in range(len(words) - window + 1)]
    return sum(ratios) / len(ratios)


def distinct(texts: Sequence[str], n: int) -> float:
    """Return the share of different n-grams among all n-grams (Li et al., 2016)."""
    grams = [g for t in texts for g in ngrams(words_of(t), n)]
    return len(set(grams)) / max(1, len(grams))


def compression_ratio(texts: Sequence[str]) -> float:
    """Return bytes before over bytes after zlib; larger is more repetitive."""
    data = "\n".join(texts).encode()
    return len(data) / len(zlib.compress(data, 9))


def self_bleu(texts: Sequence[str], most: int = 200) -> float:
    """Return the mean BLEU-4 of each of the first `most` texts against the others (Zhu, 2018)."""
    split = [words_of(t) for t in texts[:most]]
    counts = [[Counter(ngrams(w, n)) for n in range(1, 5)] for w in split]
    scores = []
    for k, own in enumerate(counts):
        logs = 0.0
        for n in range(4):
            best: Counter[tuple[str, ...]] = Counter()
            for j, other in enumerate(counts):
                if j != k:
                    for gram in own[n]:
                        best[gram] = max(best[gram], other[n][gram])
            matched = sum(min(c, best[g]) for g, c in own[n].items())
            total = max(1, sum(own[n].values()))
            logs += math.log(max(matched, 0.1) / total) / 4
        scores.append(math.exp(logs))
    return sum(scores) / max(1, len(scores))


def ngrams(words: Sequence[str], n: int) -> list[tuple[str, ...]]:
    """Return all runs of n words."""
    return [tuple(words[k : k + n]) for k in range(len(words) - n + 1)]


def table(texts: Sequence[str]) -> dict[str, float]:
    """Return all measures of some texts."""
    lengths = [len(words_of(t)) for t in texts]
    return {
        "texts": len(texts),
        "mean words": round(sum(lengths) / max(1, len(lengths)), 1),
        "vocabulary": len({w for t in texts for w in words_of(t)}),
        "MATTR": round(mattr(texts), 3),
        "distinct-1": round(distinct(texts, 1), 4),
        "distinct-2": round(distinct(texts, 2), 4),
        "distinct-3": round(distinct(texts, 3), 4),
        "self-BLEU": round(self_bleu(texts), 3),
        "compression": round(compression_ratio(texts), 2),
    }

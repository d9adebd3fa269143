"""Splits of episodes for training and validation: no scene is in both."""

import hashlib
from collections.abc import Collection, Iterable

TRAIN, VALIDATION = "train", "val"
HELD_OUT_SHARE = 0.1


def is_published_holdout(split: str) -> bool:
    """Return whether the publisher of an episode file holds its split out from training.

    `val_seen`, `val_unseen`, `test`, … are; `val` is made by vlnpe, of training episodes.
    """
    return split.startswith((f"{VALIDATION}_", "test"))


def held_out_scenes(scenes: Iterable[str]) -> frozenset[str]:
    """Return the scenes whose training episodes validate instead: a tenth, at least one of several.

    Chosen by the digest of their names, so that all datasets of the same scenes hold out the same.
    A single scene holds out nothing.
    """
    ranked = sorted(set(scenes), key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    if len(ranked) < 2:
        return frozenset()
    return frozenset(ranked[: max(1, round(HELD_OUT_SHARE * len(ranked)))])


def published_split(split: str, scene: str, held_out: Collection[str]) -> str:
    """Return the split that an episode is published in.

    Args:
        split: of the episode's source; only `train` is divided, others (`val_unseen`, …) stay.
        held_out: scenes that validate.
    """
    return VALIDATION if split == TRAIN and scene in held_out else split

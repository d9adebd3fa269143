"""What a model is to answer at a step: kinds, runs of equal steps, class balance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, did_you_mean
from ..core.rollout import Action

KINDS = ("forward", "left", "right", "stop")
KIND_OF = {
    int(Action.FORWARD): "forward",
    int(Action.LEFT): "left",
    int(Action.RIGHT): "right",
    int(Action.STOP): "stop",
}
# Shares of the answers' kinds that authors have published; `natural` repeats nothing.
BALANCES: dict[str, tuple[float, ...]] = {
    "natural": (),
    "navila": (1.0, 1.0, 1.0, 1.0),
    "uni-navid": (3.5, 2.0, 2.0, 1.5),
}


@dataclass(frozen=True)
class Answer:
    """An answer.

    Attributes:
        step: The discrete step before which it is given.
        kind: One of `KINDS`: that of the (first) action.
        text: What the model is to say.
    """

    step: int
    kind: str
    text: str


def runs(actions: NDArray[np.int64], longest: int) -> list[tuple[int, int, int]]:
    """Return consecutive equal steps merged: first step, action and count (≤ `longest`) of each."""
    result: list[tuple[int, int, int]] = []
    for step, action in enumerate(actions.tolist()):
        if result and result[-1][1] == action and result[-1][2] < longest and action:
            first, _, count = result[-1]
            result[-1] = (first, action, count + 1)
        else:
            result.append((step, action, 1))
    return result


def parse_balance(text: str) -> tuple[float, ...]:
    """Return the shares of `KINDS` that a balance means: a name, or `forward=2,left=1,…`.

    Raises:
        InputError: If it is neither; the message lists what is valid.
    """
    if text in BALANCES:
        return BALANCES[text]
    try:
        shares = {k.strip(): float(v) for k, v in (p.split("=") for p in text.split(","))}
        if set(shares) == set(KINDS) and all(0 < v < 1e6 for v in shares.values()):
            return tuple(shares[kind] for kind in KINDS)
    except ValueError:
        pass
    raise InputError(
        f"unknown balance {text!r}{did_you_mean(text, BALANCES)}; valid: {', '.join(BALANCES)}, "
        "or a share above 0 of every kind: forward=3.5,left=2,right=2,stop=1.5"
    )


def copies(
    kinds: Sequence[str], shares: tuple[float, ...], rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return how often to write each of N records so that their kinds have the given shares.

    No record is dropped: the kind that is the most frequent for its share keeps one copy of each.
    """
    times = np.ones(len(kinds), np.int64)
    if not shares or not kinds:
        return times
    of_kind = np.array([KINDS.index(kind) for kind in kinds])
    counts = np.bincount(of_kind, minlength=len(KINDS))
    scale = max(count / share for count, share in zip(counts, shares, strict=True))
    for kind, (count, share) in enumerate(zip(counts.tolist(), shares, strict=True)):
        if count:
            whole, rest = divmod(max(round(scale * share), count), count)
            times[of_kind == kind] = whole
            times[rng.choice(np.flatnonzero(of_kind == kind), rest, replace=False)] += 1
    return times

"""Runs of equal steps, and how often each record is written."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vlnpe.formats.core.errors import InputError
from vlnpe.formats.trainers.answers import BALANCES, KINDS, copies, parse_balance, runs


@given(st.lists(st.sampled_from([1, 2, 3]), max_size=60), st.integers(1, 4))
def test_runs_say_the_same_steps(moves: list[int], longest: int) -> None:
    actions = [*moves, 0]
    merged = runs(np.array(actions), longest)
    assert [a for _, action, count in merged for a in [action] * count] == actions
    assert all(count <= longest for _, _, count in merged)
    for (step, action, count), (later, after, _) in pairwise(merged):
        assert later == step + count
        assert action != after or count == longest


@given(
    st.lists(st.sampled_from(KINDS), min_size=1, max_size=300),
    st.sampled_from([*BALANCES, "forward=1,left=4,right=0.5,stop=9"]),
)
def test_balance_repeats_and_drops_nothing(kinds: list[str], balance: str) -> None:
    shares = parse_balance(balance)
    times = copies(kinds, shares, np.random.default_rng(0))
    assert (times >= 1).all()
    if not shares:
        assert (times == 1).all()
        return
    count = Counter(np.repeat(np.array(kinds, object), times).tolist())
    scale = max(Counter(kinds)[k] / s for k, s in zip(KINDS, shares, strict=True))
    for kind, share in zip(KINDS, shares, strict=True):
        if kind in count:
            assert abs(count[kind] - scale * share) <= 0.5
            own = times[np.array([k == kind for k in kinds])]
            assert own.max() - own.min() <= 1  # spread evenly
    again = copies(kinds, shares, np.random.default_rng(0))
    np.testing.assert_array_equal(times, again)


@pytest.mark.parametrize(
    "text",
    [
        "navilla",
        "forward",
        "forward=1",
        "forward=1,left=1,right=1,stop=0",
        "a=b",
        "",
        "forward=1,left=1,right=nan,stop=2",
    ],
)
def test_other_balances_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(InputError, match="valid: natural, navila, uni-navid, or a share") as error:
        parse_balance(text)
    assert "\n" not in str(error.value)

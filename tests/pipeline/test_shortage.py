"""What is said when the scenes of a plan do not hold their paths."""

import pytest

from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.engine.ledger import Row
from vlnpe.pipeline.stages.episodes.sample_items import check_complete

PLAN = {"a": {"train": 4, "val_seen": 1}, "b": {"val_unseen": 5}}
FULL = Row("sample", "a", "k", "done", facts={"missing": {}, "episodes": 5, "gap_m": 1.5})


def quarantined(stage, reason):
    return Row(stage, "b", "k", "quarantined", error={"type": "SceneError", "reason": reason})


def test_a_scene_that_was_never_sampled_says_what_became_of_it():
    before = [quarantined("soundness", "b is not sound: floor too thin; --allow-unsound")]
    with pytest.raises(InputError, match=r"b holds none of 5 paths: soundness .*too thin"):
        check_complete([FULL], PLAN, before=before)


def test_a_scene_without_a_single_path_says_why():
    row = quarantined("sample", "the longest way on it is 3 m")
    with pytest.raises(InputError, match=r"b holds none of 5 paths: sample .*longest way"):
        check_complete([FULL, row], PLAN)


@pytest.mark.parametrize("enough_at_m", [1.1, None])
def test_a_scene_that_holds_fewer_says_how_many_and_what_would_help(enough_at_m):
    facts = {"missing": {"val_unseen": 2}, "episodes": 3, "gap_m": 1.5, "enough_at_m": enough_at_m}
    row = Row("sample", "b", "k", "done", facts=facts)
    with pytest.raises(InputError) as raised:
        check_complete([FULL, row], PLAN)
    message = str(raised.value)
    assert "b holds 3 of 5 paths that differ by 1.5 m (missing 2 of 5 val_unseen)" in message
    assert ("--min-gap-m 1.1" in message) == (enough_at_m is not None)
    assert "a holds" not in message

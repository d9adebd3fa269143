"""Tests of mirrored episodes."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support.training_data import write_dataset
from vlnpe.datasets.mirror import mirror_item, mirror_text
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig
from vlnpe.datasets.tokens import training_tokens
from vlnpe.learning.training.cache import CachedSequences


def test_a_mirrored_walk_turns_and_sees_the_other_way(tmp_path: Path) -> None:
    write_dataset(tmp_path, "vlnce", [1.5, 2.0])
    how = SequenceConfig(size_px=16, future=2)
    selection = select_all([tmp_path / "lerobot" / "vlnce"])
    item = EpisodeSequences(selection, training_tokens(["walk"], 4), how)[0]
    item["action"][1:4] = torch.tensor([2, 3, 1])
    item["previous_action"][2:5] = torch.tensor([3, 4, 2])
    item["motion"][1] = torch.tensor([0.2, 0.1, 0.3])
    mirrored = mirror_item(item)
    assert mirrored["action"][1:4].tolist() == [3, 2, 1]
    assert mirrored["previous_action"][2:5].tolist() == [4, 3, 2]
    torch.testing.assert_close(mirrored["motion"][1], torch.tensor([0.2, -0.1, -0.3]))
    for key in ("rgb", "depth"):
        assert torch.equal(mirrored[key], item[key].flip(-1)) and item[key].float().std() > 0
    for key in ("pose", "waypoints"):
        assert torch.equal(mirrored[key], item[key] * torch.tensor([1.0, -1.0, -1.0]))
    again = mirror_item(mirrored)
    for key, value in item.items():
        if torch.is_tensor(value):
            assert torch.equal(again[key], value), key


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Turn left, then right into the hall.", "Turn right, then left into the hall."),
        ("Left. Stop with the bed on your right.", "Right. Stop with the bed on your left."),
        ("Bear slightly right at the sofa.", "Bear slightly left at the sofa."),
        ("Leave, turning right outside.", "Leave, turning left outside."),
        ("Make a right into the hall.", "Make a left into the hall."),
        ("Take the leftmost door.", "Take the rightmost door."),
        ("Take the left-hand door.", "Take the right-hand door."),
        ("Turn clockwise.", "Turn anticlockwise."),
        ("Turn counter-clockwise.", "Turn clockwise."),
        ("The door is right in front of you.", None),
        ("Turn left right after the sofa.", None),
        ("Go left right away.", None),
        ("Pause right inside.", None),
        ("Go right through the hall.", None),
        ("Return to the room you just left.", None),
        ("You left the hall.", None),
        ("左转，然后停在沙发旁。", None),
    ],
)
def test_the_sides_of_a_text_are_swapped(text: str, expected: str | None) -> None:
    assert mirror_text(text) == expected


def test_every_pass_mirrors_other_walks(tmp_path: Path) -> None:
    write_dataset(tmp_path, "vlnce", [1.5] * 12)
    selection = select_all([tmp_path / "lerobot" / "vlnce"])
    sequences = EpisodeSequences(selection, training_tokens(["walk"], 4), SequenceConfig(16))
    plain = CachedSequences(sequences, tmp_path / "cache")
    drawn = CachedSequences(sequences, tmp_path / "cache", mirror=True)
    passes = []
    for epoch in range(3):
        drawn.begin_pass(epoch)
        passes.append(
            [torch.equal(drawn[n]["rgb"], plain[n]["rgb"].flip(-1)) for n in range(len(plain))]
        )
    assert len(set(map(tuple, passes))) == 3
    assert 0.2 < np.mean(passes) < 0.8

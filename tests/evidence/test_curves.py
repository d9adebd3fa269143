"""The figure of training curves: panels titled in words, none of them empty."""

from typing import Any

import pytest

from benchmarks.evidence.figures import figures
from benchmarks.evidence.judge import METRICS
from benchmarks.evidence.plan import tables
from benchmarks.evidence.records import FULL, H1_DATA, Training
from tests.evidence.test_evidence import texts

PAIR = ("h1/speed", "aliengo/speed")
ACTIONS = {"step": 300.0, "train action": 0.7, "held action": 0.6, "held constant": 0.5}
LOSSES = {"step": 300.0, "train loss": 0.2, "held loss": 0.3}


def drawn(curves: dict[Training, dict[str, float]]) -> dict[str, bytes]:
    """Figures of one cell per training, each with a curve of one point."""
    cells: dict[str, Any] = {
        f"{training.name}-s0--h1-speed-baked": {
            "checkpoint_sha256": training.name,
            "values": [[0.0] * len(METRICS)] * 2,
            "curve": [point],
        }
        for training, point in curves.items()
    }
    episodes = [["val_unseen", f"home-{k}", str(k), str(k)] for k in range(2)]
    value = {"metrics": METRICS, "seeds": [0], "cells": cells, "episodes": episodes}
    return figures(value, tables(20))


@pytest.mark.parametrize(
    ("training", "label"),
    [
        (FULL, "CMA on bodyless walks"),
        (Training(PAIR, passes=True), "CMA on H1 + Aliengo, equal passes"),
        (Training(H1_DATA, longer=2), "CMA on H1, 2 times the steps"),
        (Training(H1_DATA, inputs=("rgb", "depth")), "CMA on H1, language-blind"),
        (
            Training(inputs=("rgb", "instruction"), scenes=10),
            "CMA on bodyless walks, RGB only, 10 scenes",
        ),
        (Training(("h1/flash",), "rdp", fraction=0.25), "RDP on H1 (flash), 0.25 of the paths"),
    ],
)
def test_a_training_is_called_in_words(training: Training, label: str) -> None:
    assert training.label == label


def test_labels_tell_all_trainings_apart() -> None:
    rows = (row.policy for table in tables(20).values() for row in table.rows)
    trainings = {policy for policy in rows if isinstance(policy, Training)}
    assert len({training.label for training in trainings}) == len(trainings)


def test_panels_have_words_and_something_to_show() -> None:
    rdp, seq2seq = Training(H1_DATA, "rdp"), Training(H1_DATA, "seq2seq")
    both = Training(PAIR, passes=True)
    svg = drawn({both: ACTIONS, rdp: LOSSES, seq2seq: {"step": 300.0, "loss": 1.0}})["curves"]
    shown = " ".join(texts(svg))
    assert "CMA on H1 + Aliengo, equal passes" in shown and "-passes" not in shown
    # What has no score of actions shows its loss, and what has neither is left out.
    assert "RDP on H1" in shown and "loss of motions" in shown
    assert "Seq2Seq" not in shown and "seq2seq" not in shown
    assert "loss of motions" not in " ".join(texts(drawn({both: ACTIONS})["curves"]))
    assert "curves" not in drawn({seq2seq: {"step": 300.0, "loss": 1.0}})

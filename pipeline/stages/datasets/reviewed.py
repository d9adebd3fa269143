"""Apply the decisions of `vlnpe review` to a rollout before it is exported."""

from dataclasses import replace
from pathlib import Path

from ....formats.core.errors import VlnpeError
from ....formats.core.rollout import Rollout
from ....instruction_gen.review.decisions import DecisionFile, apply_decisions
from ..rollouts.handover import rollout_at

REVIEW_NAME = "review.jsonl"  # in the run folder


def reviewed_rollout(rollout: Path, review: Path) -> Rollout:
    """Return a rollout whose episode has the checked instructions that reviewers left.

    Raises:
        VlnpeError: there are none.
    """
    recorded = rollout_at(rollout)
    accepted, lost = apply_decisions([recorded.episode], DecisionFile(review))
    if lost:
        reason = lost[recorded.episode.episode_id]
        raise VlnpeError(f"no text is left after review: {reason}")
    return replace(recorded, episode=accepted[0])

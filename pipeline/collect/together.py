"""Stages `replay` to `mcap` of one robot and view, an episode at a time; see `execution.ahead`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from ...formats.core.episode import Episode
from ...formats.vlnce.groups import per_instruction
from ..engine.ledger import Row
from ..engine.work import WorkItem
from ..execution.ahead import expected_row, run_ahead
from ..execution.attempts import Link
from ..execution.runner import Context
from ..stages.datasets.export_job import UnitJob
from ..stages.datasets.mcap_job import McapJob
from ..stages.rollouts import render_items as render
from ..stages.rollouts import replay_items as replay
from ..stages.rollouts.handover import DepthKeeper
from ..stages.rollouts.render_job import RenderJob


def run(
    context: Context,
    episodes: Sequence[Episode],
    walks: Sequence[WorkItem],
    renders: Callable[[Mapping[str, Row]], list[WorkItem]],
    exports: Callable[[Mapping[str, Row]], Mapping[str, list[WorkItem]]],
    *,
    only_success: bool,
    label: str,
) -> None:
    """Do what is left to do for each episode in one worker, ahead of the stages.

    Args:
        walks: Items of the replay stage, one of each episode.
        renders: Returns the items of the render stage, one of each row of the replay stage.
        exports: Returns the items that rows of the render stage give, by stage.
    """
    chains: dict[str, list[Link]] = {}
    rollouts: dict[str, Row] = {}
    episode_facts: list[dict[str, Any]] = []
    for episode, item in zip(episodes, walks, strict=True):
        row = expected_row(context, replay.STAGE, item, lambda e=episode: {"scene": e.scene_id})
        if row is None:
            continue
        rollouts[item.name] = row
        chains[row.outputs[0]] = [Link(replay.STAGE, item, needed=True)]
        texts = len(per_instruction(episode))
        episode_facts.append({"split": episode.split, "texts": texts, "scene": episode.scene_id})
    frames: dict[str, Row] = {}
    depths = {path: DepthKeeper() for path in chains}
    for (path, chain), facts, item in zip(
        chains.items(), episode_facts, renders(rollouts), strict=True
    ):
        row = expected_row(context, render.STAGE, item, lambda f=facts, p=path: {**f, "rollout": p})
        if row is not None:
            chain.append(Link(render.STAGE, sharing(item, depths[path]), needed=True))
            frames[item.name] = row
    for stage, items in exports(frames).items():
        for item in items:
            rollout = context.ledger.relative(cast(UnitJob | McapJob, item.job).rollout)
            shared = sharing(item, depths[rollout])
            chains[rollout].append(Link(stage, shared, wants_success=only_success))
    run_ahead(context, list(chains.values()), label)


def sharing(item: WorkItem, depth: DepthKeeper) -> WorkItem:
    """Return an item whose job leaves depth in `depth`, or takes it from there, if it needs any."""
    if not isinstance(item.job, RenderJob | McapJob):
        return item
    return replace(item, job=replace(item.job, depth=depth))

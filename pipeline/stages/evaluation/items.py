"""Stage `evaluate`: episodes in closed loop, in a folder of their own."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ....evaluation.policies.registry import PolicyChoice
from ....formats.core.episode import Episode
from ....formats.core.rollout import DAGGER
from ....formats.process.source import source_digest
from ....rendering.camera.views import View
from ....rendering.registry import scene_renderer_name
from ...engine.ledger import Row
from ...engine.work import WorkItem, work_item
from ..rollouts.replay_items import (
    STAGE as STAGE,  # its rollouts are rendered and exported like any others
)
from ..rollouts.replay_items import identity as walker_identity
from ..rollouts.replay_items import walk_names
from ..rollouts.replay_job import Walker
from .job import EvaluateJob


def items(
    episodes: Sequence[Episode],
    scenes: Mapping[str, Row],
    scenes_folder: Path,
    root: Path,
    *,
    walker: Walker,
    policy: PolicyChoice,
    identity: str,
    view: View,
    actions: str,
    expert_share: float | None = None,
) -> list[WorkItem]:
    """Return one item per episode.

    Args:
        identity: what the policy is now; see `PolicyChoice.identity`.
        expert_share: see `EvaluateJob`; walks with one are labelled `dagger`.
    """
    who, result = walker_identity(walker), []
    label = walker.config.controller if expert_share is None else DAGGER
    drawn_by = renderers(episodes, scenes_folder, view.renderer)
    for episode, name in zip(episodes, walk_names(episodes, walker, label), strict=True):
        out = root / f"{name}.mcap"
        scene = scenes_folder / episode.scene_id
        seen = replace(view, renderer=drawn_by[episode.scene_id])
        models = root / "models"
        job = EvaluateJob(
            scene=scene,
            episode=episode,
            walker=walker,
            policy=policy,
            view=seen,
            actions=actions,
            models=models,
            out=out,
            expert_share=expert_share,
        )
        inputs = (episode, scenes[episode.scene_id].key, *who, identity, seen, actions)
        if expert_share is not None:
            inputs = (*inputs, expert_share)
        result.append(work_item("evaluate", name, job, (out,), *inputs))
    return result


def code_digest() -> str:
    """Return a digest of the code that walks: another version of it may draw or step otherwise."""
    return source_digest(EvaluateJob.__module__)


def renderers(episodes: Sequence[Episode], scenes_folder: Path, renderer: str) -> dict[str, str]:
    """Return the renderer of each scene of the episodes by scene id; see `scene_renderer_name`."""
    names = sorted({episode.scene_id for episode in episodes})
    return {name: scene_renderer_name(scenes_folder / name, renderer) for name in names}

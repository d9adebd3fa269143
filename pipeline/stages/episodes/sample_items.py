"""Stage `sample`, and the joining of episode files: what the robots will be asked to do."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from ....formats.core.episode import Episode
from ....formats.core.errors import InputError
from ....formats.vlnce.files import read_episodes, write_episodes
from ....formats.vlnce.groups import group_by_path, per_instruction
from ....trajectory_sampler.config import SampleConfig
from ...engine.ledger import Ledger, Row
from ...engine.work import WorkItem, work_item
from .jobs import SampleJob

log = logging.getLogger(__name__)

STAGE = "sample"


def sample_item(
    scene: Row,
    scenes: Path,
    out: Path,
    config: SampleConfig,
    seed: int,
    quotas: Mapping[str, int] | None = None,
) -> WorkItem:
    """Sample trajectories in one repaired scene into the episode file `out`.

    Args:
        quotas: paths by split; by default the count and split of `config`.
    """
    job = SampleJob(scenes / scene.item, out, config, seed, dict(quotas or {}))
    how = {"seed": seed, "quotas": dict(quotas or {})}
    return work_item(STAGE, scene.item, job, (out,), scene.key, config, **how)


def items(
    ledger: Ledger,
    scenes: Iterable[str],
    radius_m: float,
    item_for: Callable[[str, float], WorkItem],
) -> list[WorkItem]:
    """Return one item per scene, for a robot of radius `radius_m` [m].

    Paths that the folder has for a narrower robot stay where they leave room for this one, too.

    Args:
        radius_m: of the widest robot [m].
        item_for: returns the item of a scene for a radius [m].
    """
    result = []
    tight: dict[str, float] = {}
    for scene in scenes:
        item, row = item_for(scene, radius_m), ledger.row(STAGE, scene)
        earlier_m = row.facts.get("robot_radius_m", radius_m) if row else radius_m
        if row and earlier_m < radius_m:
            earlier = item_for(scene, earlier_m)
            if ledger.is_done(STAGE, scene, earlier.key):
                if row.facts["clear_for_m"] >= radius_m:
                    item = earlier
                else:
                    tight[scene] = row.facts["clear_for_m"]
        result.append(item)
    if tight:
        log.warning(
            "the widest robot needs %.2f m of clearance, but the existing episodes have %.2f m: "
            "sampling new episodes in %s. Results of other robots on the old episodes are dropped "
            "from the report; add these robots to --robot to run them on the new episodes",
            radius_m,
            min(tight.values()),
            ", ".join(tight),
        )
    return result


def check_complete(
    rows: Iterable[Row],
    planned: Mapping[str, Mapping[str, int]],
    *,
    exact: bool = True,
    before: Iterable[Row] = (),
) -> None:
    """Raise, or warn, unless every scene holds the paths that were planned for it.

    Args:
        planned: paths by split, by scene.
        exact: a shortage is an error; otherwise it is logged.
        before: of earlier stages, which say why a scene was not sampled.
    """
    lost = {row.item: row for row in before if row.status == "quarantined"}
    outcomes = lost | {row.item: row for row in rows}
    problems = []
    for scene, quotas in planned.items():
        total = sum(quotas.values())
        row = outcomes.get(scene)
        if row is None or row.status != "done":
            reason = f"{row.stage} failed: {row.error['reason']}" if row else "it was not sampled"
            problems.append(f"{scene} holds none of {total} paths: {reason}")
        elif row.facts["missing"]:
            problems.append(_shortage(row, quotas))
    if problems and not exact:
        for problem in problems:
            log.warning("%s", problem)
    elif problems:
        raise InputError(
            "; ".join(problems) + ". Alternatively, move paths to other scenes with --quota "
            "SCENE=N, lower --min-length-m or --min-crossings, or add larger scenes"
        )


def warn_if_fewer(before: Iterable[Row], after: Iterable[Row]) -> None:
    """Log a warning of scenes of which the run's episode files now hold fewer paths than before."""
    earlier = {row.item: row.facts.get("episodes", 0) for row in before}
    for row in after:
        now = row.facts.get("episodes", 0)
        if row.status == "done" and now < earlier.get(row.item, 0):
            log.warning(
                "the episode files now hold %d of the %d paths that they held in %s; robots that "
                "walked more of them stay in the table and the report, and `mix` prints commands "
                "for the paths that are left",
                now,
                earlier[row.item],
                row.item,
            )


def _shortage(row: Row, quotas: Mapping[str, int]) -> str:
    facts, total = row.facts, sum(quotas.values())
    missing = ", ".join(f"{n} of {quotas[s]} {s}" for s, n in facts["missing"].items())
    enough = facts["enough_at_m"]
    help_text = (
        f"it holds them at --min-gap-m {enough:g}"
        if enough
        else "it does not hold them at any gap; fewer or shorter paths are needed"
    )
    return (
        f"{row.item} holds {facts['episodes']} of {total} paths that differ by "
        f"{facts['gap_m']:g} m (missing {missing}): {help_text}"
    )


def merge(
    parts: Sequence[Path], out: Callable[[str], Path], expand: bool = False
) -> tuple[list[Episode], dict[str, Path]]:
    """Join episode files into one per split; episodes of one path become one record in memory.

    Args:
        out: the file of a split.
        expand: write one episode per instruction; otherwise the files have the parts' own
            episodes.

    Returns:
        The paths of all splits, each to be walked once, and the files by split.
    """
    by_split: dict[str, list[Episode]] = {}
    for part in parts:
        for episode in read_episodes(part):
            by_split.setdefault(episode.split, []).append(episode)
    files = {split: out(split) for split in by_split}
    for split, episodes in by_split.items():
        written = (
            [single for e in episodes for single in per_instruction(e)] if expand else episodes
        )
        write_episodes(files[split], written)
    return [path for episodes in by_split.values() for path in group_by_path(episodes)], files

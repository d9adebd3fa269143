"""The trajectories that are held out of all trainings."""

import hashlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from ...datasets.mixture.recipe import NO_HOLDOUT, Recipe
from ...datasets.selection import Selection
from ...formats.core.errors import InputError
from ...formats.lerobot.splits import is_published_holdout


@dataclass(frozen=True)
class Holdout:
    """Trajectories to hold out.

    Attributes:
        by: `split`, `scene`, `trajectory`, or `none`.
        scenes: whole scenes held out; empty if trajectories are held out instead.
        trajectories: all that are held out, as `scene/trajectory`.
    """

    by: str
    scenes: tuple[str, ...]
    trajectories: frozenset[str]


def hold_out(
    recipe: Recipe, trajectories: Iterable[str], published: Collection[str] = ()
) -> Holdout:
    """Hold out published splits; without them whole scenes if there are several, else paths.

    No trajectory is on both sides.

    A trajectory is held out for every robot, controller and light. The choice depends on names and
    seed alone.

    Args:
        trajectories: `scene/trajectory` of all episodes of the recipe's sources.
        published: those of them that lie in a published `val_seen`, `val_unseen` or `test`.

    Raises:
        InputError: too few scenes or trajectories to hold any out.
    """
    if recipe.holdout == NO_HOLDOUT:
        return Holdout(NO_HOLDOUT, (), frozenset())
    everything = sorted(set(trajectories))
    scenes = sorted({scene_of(t) for t in everything})
    by = recipe.holdout
    if by == "split" or (by == "auto" and published):
        if not published:
            raise InputError("holdout by split: no episode has a published val_… or test split")
        return Holdout(
            "split", tuple(sorted({scene_of(t) for t in published})), frozenset(published)
        )
    if by == "auto":
        by = "scene" if len(scenes) > 1 else "trajectory"
    names = scenes if by == "scene" else everything
    if len(names) < 2:
        raise InputError(f"holdout by {by}: only {len(names)} found; valid: 2 or more")
    count = min(max(round(recipe.holdout_fraction * len(names)), 1), len(names) - 1)
    chosen = set(sorted(names, key=lambda name: _order(recipe.seed, name))[:count])
    if by == "trajectory":
        return Holdout(by, (), frozenset(chosen))
    held = frozenset(t for t in everything if scene_of(t) in chosen)
    return Holdout(by, tuple(sorted(chosen)), held)


def rooms_aside(paths: Mapping[str, int], seed: int) -> tuple[str, ...]:
    """Return rooms, drawn by their names and the seed, in which a third to half of the paths end.

    A room with which it would be more than half stays out.

    Args:
        paths: number of paths that end in each room.
    """
    total, held, chosen = sum(paths.values()), 0, []
    for room in sorted(paths, key=lambda name: _order(seed, name)):
        if 3 * held < total and 2 * (held + paths[room]) <= total:
            chosen.append(room)
            held += paths[room]
    return tuple(sorted(chosen))


def published_holdout(selections: Iterable[Selection]) -> frozenset[str]:
    """Return the trajectories of splits that their publisher holds out."""
    return frozenset(
        trajectory
        for chosen in selections
        for trajectory, split in zip(chosen.trajectories(), chosen.labels("split"), strict=True)
        if is_published_holdout(split)
    )


def scene_of(trajectory: str) -> str:
    """Return the scene in `scene/trajectory`; scene ids may hold slashes."""
    return trajectory.rsplit("/", 1)[0]


def _order(seed: int, name: str) -> bytes:
    return hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=8).digest()

"""Episodes of one path as one: it is walked once and carries the instructions of all of them.

R2R describes each path three times, in three episodes. `group_by_path` joins them into one record
with the id of the first; `ungroup` restores the original episodes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from ..core.episode import Episode

TEXTS = "instructions"  # in `extra`: all texts of the path
MEMBERS = "members"  # in `extra`: what distinguishes the joined episodes


def group_by_path(episodes: Iterable[Episode]) -> list[Episode]:
    """Join the episodes that share scene, split, trajectory, start, heading, goal and path.

    Of each path the first episode remains. Its `extra["instructions"]` has the texts of all, and
    `extra["members"]` what `ungroup` needs. Paths stay in order of their first episode; grouping
    twice changes nothing.
    """
    groups: dict[tuple[Any, ...], list[Episode]] = {}
    for episode in episodes:
        groups.setdefault(_path_key(episode), []).append(episode)
    return [_joined(group) for group in groups.values()]


def ungroup(episode: Episode) -> list[Episode]:
    """Return the episodes that a record was joined from; one that was not joined is its own."""
    members = episode.extra.get(MEMBERS)
    if not members:
        return [episode]
    shared = {key: value for key, value in episode.extra.items() if key != MEMBERS}
    return [
        replace(
            episode,
            episode_id=member["episode_id"],
            instruction=member["instruction"],
            extra={k: v for k, v in shared.items() if k not in member["without"]} | member["with"],
        )
        for member in members
    ]


def per_instruction(episode: Episode) -> list[Episode]:
    """Return one episode per instruction, for tools that know one text per episode.

    Joined episodes are separated again; of one that has several texts, the second gets the id
    `<id>-2`, and so on.
    """
    texts = episode.extra.get(TEXTS, [])
    originals = ungroup(episode)
    found = [t for one in originals for t in one.extra.get(TEXTS) or [one.instruction] if t]
    if texts and found != texts:  # people edited or rejected some in review
        extra = {key: value for key, value in episode.extra.items() if key != MEMBERS}
        originals = [replace(episode, extra=extra)]
    result = []
    for one in originals:
        texts = one.extra.get(TEXTS) or [one.instruction]
        made = one.extra.get("instruction", {})
        for number, text in enumerate(texts):
            name = one.episode_id if number == 0 else f"{one.episode_id}-{number + 1}"
            extra = one.extra | {TEXTS: [text]} if TEXTS in one.extra else one.extra
            if len(made.get("texts", ())) == len(texts):
                facts = made | {"texts": [made["texts"][number]]}
                extra = extra | {"instruction": facts}
            result.append(replace(one, episode_id=name, instruction=text, extra=extra))
    return result


def instruction_ids(episode: Episode) -> list[str]:
    """Return, for each of a record's texts, the id of the episode that it belongs to."""
    texts = episode.extra.get(TEXTS) or [episode.instruction]
    ids = [name for member in ungroup(episode) for name in [member.episode_id] * _count(member)]
    return ids if len(ids) == len(texts) else [episode.episode_id] * len(texts)


def instruction_count(episodes: Iterable[Episode]) -> int:
    """Return how many instructions the episodes carry; an empty text is none."""
    return sum(
        len(episode.extra.get(TEXTS) or [t for t in [episode.instruction] if t])
        for episode in episodes
    )


def _path_key(episode: Episode) -> tuple[Any, ...]:
    return (
        episode.scene_id,
        episode.split,
        episode.trajectory_id,
        episode.level,
        episode.start_position_world_m.tobytes(),
        episode.start_yaw_rad,
        episode.goal_position_world_m.tobytes(),
        episode.reference_path_world_m.tobytes(),
    )


def _joined(group: Sequence[Episode]) -> Episode:
    if len(group) == 1:
        return group[0]
    originals = [one for episode in group for one in ungroup(episode)]
    first = originals[0]
    texts = [t for one in originals for t in one.extra.get(TEXTS) or [one.instruction] if t]
    extra = {key: value for key, value in first.extra.items() if key != TEXTS}
    if texts:
        extra[TEXTS] = texts
    members = [
        {
            "episode_id": one.episode_id,
            "instruction": one.instruction,
            "with": {k: v for k, v in one.extra.items() if k not in extra or extra[k] != v},
            "without": [k for k in extra if k not in one.extra],
        }
        for one in originals
    ]
    return replace(first, extra={**extra, MEMBERS: members})


def _count(episode: Episode) -> int:
    return len(episode.extra.get(TEXTS) or [episode.instruction])

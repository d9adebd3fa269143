"""Join the episodes of a path: it is walked once and carries the instructions of all of them.

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

    The first episode of each path remains. Its `extra["instructions"]` has the texts of all, and
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
    if texts and _texts_of(originals) != texts:  # people edited or rejected some in review
        extra = {key: value for key, value in episode.extra.items() if key != MEMBERS}
        originals = [replace(episode, extra=extra)]
    result = []
    for original in originals:
        texts = original.extra.get(TEXTS) or [original.instruction]
        facts = original.extra.get("instruction", {})
        for number, text in enumerate(texts):
            name = f"{original.episode_id}-{number + 1}" if number else original.episode_id
            extra = dict(original.extra)
            if TEXTS in extra:
                extra[TEXTS] = [text]
            if len(facts.get("texts", ())) == len(texts):
                extra["instruction"] = facts | {"texts": [facts["texts"][number]]}
            result.append(replace(original, episode_id=name, instruction=text, extra=extra))
    return result


def _texts_of(episodes: Iterable[Episode]) -> list[str]:
    """Return the texts of all episodes, without empty ones."""
    texts = (e.extra.get(TEXTS) or [e.instruction] for e in episodes)
    return [text for several in texts for text in several if text]


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
    originals = [original for episode in group for original in ungroup(episode)]
    first, texts = originals[0], _texts_of(originals)
    extra = {key: value for key, value in first.extra.items() if key != TEXTS}
    if texts:
        extra[TEXTS] = texts
    members = [
        {
            "episode_id": original.episode_id,
            "instruction": original.instruction,
            "with": {k: v for k, v in original.extra.items() if k not in extra or extra[k] != v},
            "without": [k for k in extra if k not in original.extra],
        }
        for original in originals
    ]
    return replace(first, extra={**extra, MEMBERS: members})


def _count(episode: Episode) -> int:
    return len(episode.extra.get(TEXTS) or [episode.instruction])

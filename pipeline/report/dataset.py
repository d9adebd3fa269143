"""The dataset in figures, split by split: lengths, words, actions, rooms."""

from collections import Counter
from collections.abc import Sequence
from statistics import fmean
from typing import Any

from ...formats.core.episode import Episode
from ...formats.core.rollout import Action
from ...formats.vlnce.groups import TEXTS
from ...trajectory_sampler.ideal import ideal_actions
from .plots import Plot, bars, step_histogram, svg_uri

# R2R's paths (Anderson et al., "Vision-and-language navigation", 2018) are 10 m long on average.
R2R_MEAN_M = 10.0


def dataset_plots(episodes: Sequence[Episode]) -> list[Plot]:
    """Return the figures of the paths that were walked, one curve per split."""
    splits = sorted({e.split for e in episodes})
    by_split = {split: [e for e in episodes if e.split == split] for split in splits}
    texts = {
        split: [t for e in members for t in texts_of(e)] for split, members in by_split.items()
    }
    lengths = {
        split: [e.reference_length_m for e in members] for split, members in by_split.items()
    }
    words = {split: [len(text.split()) for text in listed] for split, listed in texts.items()}
    rooms = {split: _rooms_crossed(members) for split, members in by_split.items()}
    marks = {"R2R mean": R2R_MEAN_M}
    figures = {
        f"Length of the reference paths. {_means(lengths, 'm')}": step_histogram(
            lengths, "reference path [m]", "paths", marks
        ),
        f"Length of the instructions. {_means(words, 'words')}": step_histogram(
            words, "words", "instructions"
        ),
        _actions_note(by_split): bars(_actions(by_split), "share of steps"),
    }
    if any(rooms.values()):
        caption = f"Passages from room to room per path. {_means(rooms, '')}"
        figures[caption] = step_histogram(rooms, "rooms crossed", "paths")
    return [Plot(svg_uri(figure), caption) for caption, figure in figures.items()]


def dataset_rows(episodes: Sequence[Episode]) -> list[dict[str, Any]]:
    """Return one row per split: how many paths, instructions, scenes and similarity groups."""
    rows = []
    for split in sorted({e.split for e in episodes}):
        members = [e for e in episodes if e.split == split]
        groups = {e.extra["similarity_group"] for e in members if "similarity_group" in e.extra}
        rows.append(
            {
                "split": split,
                "paths": len(members),
                "instructions": sum(len(texts_of(e)) for e in members),
                "scenes": len({e.scene_id for e in members}),
                "groups": len(groups) or None,
                "length": fmean(e.reference_length_m for e in members),
            }
        )
    return rows


def texts_of(episode: Episode) -> list[str]:
    """Return all instructions of a path."""
    return episode.extra.get(TEXTS) or [text for text in [episode.instruction] if text]


def _rooms_crossed(episodes: Sequence[Episode]) -> list[float]:
    return [len(e.extra["crossings"]) for e in episodes if "crossings" in e.extra]


def _actions(by_split: dict[str, list[Episode]]) -> dict[str, dict[str, float]]:
    result = {}
    for split, episodes in by_split.items():
        counted = Counter(a for e in episodes for a in _steps(e))
        total = max(1, counted.total())
        result[split] = {a.name: counted[int(a)] / total for a in Action}
    return result


def _steps(episode: Episode) -> Sequence[int]:
    given = episode.extra.get("actions")
    if given:
        return given
    return ideal_actions(episode.reference_path_world_m, episode.start_yaw_rad)


def _actions_note(by_split: dict[str, list[Episode]]) -> str:
    steps = {split: [len(_steps(e)) for e in members] for split, members in by_split.items()}
    return f"Actions of an ideal agent (0.25 m, 15°). {_means(steps, 'steps per path')}"


def _means(values: dict[str, list[Any]], unit: str) -> str:
    means = [f"{s} {fmean(v):.1f}" for s, v in values.items() if v]
    return f"Mean: {', '.join(means)}{f' {unit}' if unit else ''}." if means else ""

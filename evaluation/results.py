"""Results of an evaluation: the table of metrics with intervals, the file, the comparison."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.core.errors import FileFormatError, InputError, brief
from ..formats.untrusted.documents import read_json_object
from .statistics import Interval, clustered_interval, mcnemar

RESULTS_NAME = "results.json"
FORMAT = "vlnpe-results/1"
TABLE_WIDTH = 120  # characters
# Column, unit, and the value of an episode; rates are percentages of episodes.
COLUMNS: dict[str, tuple[str, Callable[[Mapping[str, Any]], float]]] = {
    "TL": ("m", lambda e: _number(e["metrics"]["trajectory_length_m"])),
    "NE": ("m", lambda e: _number(e["metrics"]["navigation_error_m"])),
    "FR": ("%", lambda e: _percent(e["metrics"]["fall"])),
    "StR": ("%", lambda e: _percent(e["metrics"]["stuck"])),
    "OS": ("%", lambda e: _percent(e["metrics"]["oracle_success"])),
    "SR": ("%", lambda e: _percent(e["metrics"]["success"])),
    "SPL": ("%", lambda e: _percent(e["metrics"]["spl"])),
    "nDTW": ("%", lambda e: 100.0 * _number(e["metrics"]["ndtw"])),
    "CR": ("%", lambda e: 100.0 * bool(e["contacts"])),
    "time": ("s", lambda e: _number(e["metrics"]["duration_s"])),
}
LEGEND = (
    "TL: mean length walked; NE: mean distance to the goal at the end; FR: fell; StR: got stuck;\n"
    "OS: passed within 3 m of the goal; SR: stopped within 3 m of it; SPL: SR weighted by path\n"
    "length; nDTW: likeness of path and walk; CR: touched an obstacle; time: mean duration.\n"
    "(low..high): 95 % interval. With few episodes it is wide: an SR of 0 or 100 may be chance."
)
# What is counted of a model behind a server, by the key in an episode's results.
COUNTS = {
    "unclear": "answers of the model could not be read and were asked for again",
    "left_out": "things that the model named have no known name or no surface and were left out",
}
# 0 or 100 in each episode; SPL is so wherever all are failures, or all are perfect.
RATES = frozenset({"FR", "StR", "OS", "SR", "SPL", "CR"})


def _number(value: float | None) -> float:
    if value is not None and not isinstance(value, int | float):
        raise TypeError(f"{brief(value)} is no number")
    return math.nan if value is None else float(value)


def _percent(value: float) -> float:
    if not 0 <= _number(value) <= 1:
        raise ValueError(f"{brief(value)}; valid: 0 to 1")
    return 100.0 * value


def summarise(episodes: Sequence[Mapping[str, Any]]) -> dict[str, Interval]:
    """Return each column's mean and interval over some episodes.

    An infinite NE, of a goal that cannot be reached from where the robot ended, is left out.
    """
    scenes = [e["scene"] for e in episodes]
    paths = [e["trajectory"] for e in episodes]
    return {
        name: clustered_interval(
            [value(e) for e in episodes],
            scenes,
            paths,
            np.random.default_rng(0),
            rate=name in RATES,
        )
        for name, (_, value) in COLUMNS.items()
    }


def grouped(episodes: Sequence[Mapping[str, Any]], key: str) -> dict[str, list[Mapping[str, Any]]]:
    """Return the episodes by their value of `key` (`split`, `scene`), in its order."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for episode in sorted(episodes, key=lambda e: str(e[key])):
        groups.setdefault(str(episode[key]), []).append(episode)
    return groups


def table(groups: Mapping[str, Sequence[Mapping[str, Any]]], width: int = TABLE_WIDTH) -> str:
    """Return a text table with one column per group of episodes: mean and 95 % interval.

    Groups that do not fit into `width` characters follow in further blocks.
    """
    heads = ["", "episodes", *(f"{name} [{unit}]" for name, (unit, _) in COLUMNS.items())]
    columns = [
        [
            label,
            str(len(episodes)),
            *(cell_text(n, v, "..") for n, v in summarise(episodes).items()),
        ]
        for label, episodes in groups.items()
    ]
    blocks: list[list[list[str]]] = []
    left = 0
    for column in columns:
        needed = 2 + max(map(len, column))
        if not blocks or needed > left:
            blocks.append([heads])
            left = width - max(map(len, heads))
        blocks[-1].append(column)
        left -= needed
    return "\n\n".join(map(_block, blocks))


def _block(columns: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in columns]
    rows = []
    for line in zip(*columns, strict=True):
        cells = [cell.rjust(size) for cell, size in zip(line[1:], widths[1:], strict=True)]
        rows.append("  ".join([line[0].ljust(widths[0]), *cells]).rstrip())
    return "\n".join(rows)


def decimals(column: str) -> int:
    """Return how many decimals a column of `COLUMNS` is shown with in every table."""
    return 2 if COLUMNS[column][0] == "m" else 1


def cell_text(column: str, value: Interval, to: str = " … ", sign: str = "") -> str:
    """Return a mean with its interval as a table shows it; `–` for a mean of nothing.

    With the `sign` "+", as of a difference, positive numbers have one, too.
    """
    if math.isnan(value.mean):
        return "–"
    form = f"{sign}.{decimals(column)}f"
    if math.isnan(value.low):
        return f"{value.mean:{form}}"
    return f"{value.mean:{form}} ({value.low:{form}}{to}{value.high:{form}})"


def results_json(
    setting: Mapping[str, Any],
    episodes: Sequence[Mapping[str, Any]],
    quarantined: Mapping[str, str],
) -> dict[str, Any]:
    """Return the results file's content.

    It holds the settings, the summary of all episodes, of each split and of each scene, the
    episodes, and those without a result.
    """

    def plain(some: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float | None]]:
        return {name: interval_json(value) for name, value in summarise(some).items()}

    return {
        "format": FORMAT,
        "setting": dict(setting),
        "summary": plain(episodes),
        **{
            f"{key}s": {name: plain(some) for name, some in grouped(episodes, key).items()}
            for key in ("split", "scene")
        },
        "quarantined": dict(quarantined),
        "episodes": list(episodes),
    }


def interval_json(value: Interval) -> dict[str, float | None]:
    """Return mean, low and high; null where there is none."""
    return {k: None if math.isnan(v) else v for k, v in vars(value).items()}


def interval_of(value: Mapping[str, float | None]) -> Interval:
    """Return what `interval_json` was given."""
    return Interval(**{k: math.nan if v is None else v for k, v in value.items()})


def read_results(path: Path) -> dict[str, Any]:
    """Read a results file, or that of an evaluation's folder.

    Raises:
        InputError: there is no such file.
        FileFormatError: it is no results file, or a value in it is missing or invalid.
    """
    file = path / RESULTS_NAME if path.is_dir() else path
    if not file.is_file():
        raise InputError(
            f"{file}: no such file; valid: the folder of a `vlnpe evaluate`, or its {RESULTS_NAME}"
        )
    value = read_json_object(file)
    episodes, setting = value.get("episodes"), value.get("setting", {})
    if value.get("format") != FORMAT or not isinstance(episodes, list):
        raise FileFormatError(file, "not results of `vlnpe evaluate`")
    if not isinstance(setting, dict):
        raise FileFormatError(file, f"setting is {brief(setting)}; valid: an object")
    uids = set[str]()
    for number, episode in enumerate(episodes):
        uid = _check_episode(file, number, episode)
        if uid in uids:
            raise FileFormatError(file, f"episode {uid} occurs twice")
        uids.add(uid)
    return value


def _check_episode(file: Path, number: int, episode: Any) -> str:
    """Return the uid of an episode whose columns and names can be read.

    Raises:
        FileFormatError: names the episode and the column.
    """
    what = f"episode number {number}"
    if not isinstance(episode, dict):
        raise FileFormatError(file, f"{what} is {brief(episode)}; valid: an object")
    for name in ("split", "scene", "episode", "trajectory"):
        if not isinstance(episode.get(name), str | int):
            raise FileFormatError(file, f"{what}: {name} is {brief(episode.get(name))}")
    for name, (_, column) in COLUMNS.items():
        try:
            column(episode)
        except KeyError as error:
            raise FileFormatError(file, f"{what} lacks {error}, which {name} needs") from error
        except (TypeError, ValueError, OverflowError) as error:
            raise FileFormatError(file, f"{what}: {name} cannot be read ({error})") from error
    return uid_of(episode["split"], episode["scene"], episode["episode"])


@dataclass(frozen=True)
class Comparison:
    """Two evaluations on the episodes that both have.

    Attributes:
        common: number of episodes that both have.
        apart: number of episodes that only one has.
        lost, won: uids of episodes that only the first, only the second succeeded in.
        p_value: exact McNemar test on success; it takes episodes for independent.
        differences: second minus first, per column, with the interval of the paired difference.
        warnings: what else differs than the policies.
    """

    names: tuple[str, str]
    common: int
    apart: int
    lost: tuple[str, ...]
    won: tuple[str, ...]
    p_value: float
    differences: dict[str, Interval]
    warnings: tuple[str, ...]


def compare(
    first: Mapping[str, Any], second: Mapping[str, Any], names: tuple[str, str]
) -> Comparison:
    """Compare two results files, paired by episode.

    Raises:
        InputError: they have no episode in common.
    """
    a, b = (by_uid(r["episodes"]) for r in (first, second))
    uids = sorted(a.keys() & b.keys())
    if not uids:
        raise InputError(f"{names[0]} and {names[1]} have no episode in common")
    scenes = [a[u]["scene"] for u in uids]
    paths = [a[u]["trajectory"] for u in uids]
    flips = mcnemar(*([e[u]["metrics"]["success"] for u in uids] for e in (a, b)))
    differences = {
        name: clustered_interval(
            [value(b[u]) - value(a[u]) for u in uids], scenes, paths, np.random.default_rng(0)
        )
        for name, (_, value) in COLUMNS.items()
    }
    return Comparison(
        names,
        len(uids),
        len(a.keys() ^ b.keys()),
        tuple(uids[k] for k in flips.lost),
        tuple(uids[k] for k in flips.won),
        flips.p_value,
        differences,
        _warnings(first, second, same_episodes=a.keys() == b.keys()),
    )


def _warnings(
    first: Mapping[str, Any], second: Mapping[str, Any], *, same_episodes: bool
) -> tuple[str, ...]:
    """Return what makes the walks of two results differ beside their policies.

    Results of earlier versions lack the digests, about which nothing is said then.
    """
    texts = {
        "gait_sha256": "the robots walked with two gaits",
        "code_sha256": "the episodes were walked by two versions of vlnpe or its libraries",
    }
    if same_episodes:
        texts["instructions_sha256"] = "the episodes have the same names but other instructions"
    a, b = (results.get("setting", {}) for results in (first, second))
    return tuple(
        text for key, text in texts.items() if a.get(key) and b.get(key) and a[key] != b[key]
    )


def uid_of(split: str, scene: str, episode: str) -> str:
    """Return the name that no other episode of an evaluation has."""
    return f"{split}/{scene}/{episode}"


def by_uid(episodes: Iterable[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Return the episodes of a results file by `uid_of`."""
    return {uid_of(e["split"], e["scene"], e["episode"]): e for e in episodes}

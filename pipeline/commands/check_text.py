"""`vlnpe check-text`: check texts of any origin against the facts of their paths."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...formats.core.errors import FileFormatError, InputError, UnknownNameError, brief
from ...formats.vlnce.files import read_episodes
from ...instruction_gen.checker import Ground, Verdict, check_text
from ...instruction_gen.facts.named import read_named
from ...instruction_gen.instruct import Levels
from ...instruction_gen.language.claims import Step, read_steps
from ..engine.run_folder import RunFolder
from ..inputs.episode_file import episode_files, scenes_of
from ..options.instructions import CheckText
from ..stages.instructions.instruct_job import read_sights
from ..summary import print_result

LONGEST_LINE = 100_000  # characters
FORM = '{"path": trajectory id, "text": …, "claims": […]}, claims are optional'


def run(options: CheckText) -> int:
    """Check every text; return 1 if any is refused.

    Raises:
        InputError: the texts, the episodes or their scenes cannot be read.
    """
    texts = list(read_texts(options.texts))
    if not texts:
        raise FileFormatError(options.texts, f"no texts; valid: on each line {FORM}")
    episodes = {
        episode.trajectory_id: episode
        for file in episode_files(options.episodes)
        for episode in read_episodes(file)
    }
    for number, path, _, _ in texts:
        if path not in episodes:
            error = UnknownNameError("path", path, episodes)
            raise FileFormatError(options.texts, f"line {number}: {error}")
    # In a run the facts say what the robot's camera saw; elsewhere walls alone decide.
    records = RunFolder(options.episodes).sights if options.episodes.is_dir() else None
    levels = Levels(
        scenes_of(options.episodes, options.scenes),
        read_named(records.all_named()) if records else {},
    )
    seen = read_sights(records.all_seen()) if records else None
    grounds: dict[str, Ground] = {}
    result: list[dict[str, Any]] = []
    for _, path, text, steps in texts:
        if path not in grounds:
            grounds[path] = Ground(levels.facts(episodes[path], seen))
        verdict = check_text(text, grounds[path], steps)
        result.append(record(path, text, verdict))
        if not options.json:
            lines = list(verdict.problems)
            if verdict.unchecked:
                lines.append(f"unchecked: {', '.join(verdict.unchecked)}")
            sys.stdout.writelines(f"{path}: {line}: {text!r}\n" for line in lines)
    refused = sum(entry["refused"] for entry in result)
    unchecked = sum(bool(entry["unchecked"]) for entry in result)
    line = f"{len(result)} texts: {refused} refused, {unchecked} with unchecked words"
    print_result(options, {"texts": result}, line)
    return int(refused > 0)


def record(path: str, text: str, verdict: Verdict) -> dict[str, Any]:
    """Return the verdict about one text as it is printed."""
    return {
        "path": path,
        "text": text,
        "refused": not verdict.ok,
        "problems": list(verdict.problems),
        "unchecked": list(verdict.unchecked),
    }


def read_texts(file: Path) -> Iterator[tuple[int, str, str, tuple[Step, ...]]]:
    """Return number, path, text and steps of each line of a JSONL file that is not blank.

    There are no steps where a line has no claims.

    Raises:
        FileFormatError: the file or a line cannot be read; the message names the line.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8"
        raise FileFormatError(file, f"{reason}; valid: on each line {FORM}") from error
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            yield number, *_read_line(line)
        except InputError as error:
            raise FileFormatError(file, f"line {number}: {error}") from error


def _read_line(line: str) -> tuple[str, str, tuple[Step, ...]]:
    if len(line) > LONGEST_LINE:
        raise InputError(f"{len(line)} characters; at most {LONGEST_LINE}")
    try:
        value = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{brief(line)} is not JSON; valid: {FORM}") from error
    if not isinstance(value, dict) or set(value) - {"path", "text", "claims"}:
        raise InputError(f"{line!r:.80}; valid: {FORM}")
    for key in ("path", "text"):
        if not isinstance(value.get(key), str):
            raise InputError(f"{key} is {value.get(key)!r:.40}; valid: a text")
    claims = value.get("claims")
    return value["path"], value["text"], () if claims is None else read_steps(claims)

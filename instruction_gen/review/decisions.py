"""Decisions of annotators: an append-only file, so that none is lost and all can be undone."""

import fcntl
import json
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...formats.core.episode import Episode
from ...formats.core.errors import FileFormatError, InputError

UNCHECKED = "words that no claim covers and no reviewer vouches for"
ACTIONS = ("accept", "edit", "reject", "undo")
# What is recorded of the words of a text, and does not hold after an edit.
OF_THE_WORDS = ("landmarks", "claims", "from_m", "unchecked")


@dataclass(frozen=True)
class Decision:
    """What one annotator decided about one text.

    Attributes:
        path: trajectory id.
        number: of the text among the path's texts.
        action: one of `ACTIONS`; `undo` takes back the annotator's last decision on this text.
        before: the text that was judged.
        text: the new text of an `edit`, "" otherwise.
        reason: of a `reject`.
        at: seconds since 1970.
    """

    annotator: str
    path: str
    number: int
    action: str
    before: str
    text: str = ""
    reason: str = ""
    at: float = 0.0


# The last decision about a text, by path and number, then annotator.
Current = dict[tuple[str, int], dict[str, Decision]]


class DecisionFile:
    """One JSON object a line; a line is on disk before `add` returns."""

    def __init__(self, path: Path):
        """Use the file `path`, which need not exist."""
        self.path = path

    def add(self, decision: Decision) -> None:
        """Append a decision durably.

        Raises:
            InputError: unknown action, or no annotator.
        """
        if decision.action not in ACTIONS or not decision.annotator.strip():
            raise InputError(f"decision {decision.action!r}; valid: {', '.join(ACTIONS)}")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        stamped = {**asdict(decision), "at": decision.at or time.time()}
        line = json.dumps(stamped, ensure_ascii=False) + "\n"
        with self.path.open("a", encoding="utf-8") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX)
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())

    def read(self) -> list[Decision]:
        """Return all decisions, in order; a last line that a crash cut short is left out.

        Raises:
            FileFormatError: another line is damaged.
        """
        if not self.path.is_file():
            return []
        lines = self.path.read_text(encoding="utf-8").split("\n")
        result = []
        for k, line in enumerate(lines[:-1]):
            try:
                result.append(Decision(**json.loads(line)))
            except (ValueError, TypeError) as error:
                raise FileFormatError(self.path, f"line {k + 1}: {error}") from error
        return result

    def current(self) -> Current:
        """Return the last decision that is not undone by path and text, then annotator."""
        stacks: dict[tuple[str, int, str], list[Decision]] = {}
        for one in self.read():
            stack = stacks.setdefault((one.path, one.number, one.annotator), [])
            if one.action != "undo":
                stack.append(one)
            elif stack:
                stack.pop()
        result: Current = {}
        for (path, number, annotator), stack in stacks.items():
            if stack:
                result.setdefault((path, number), {})[annotator] = stack[-1]
        return result


def agreement(current: Current) -> dict[str, int]:
    """Return how many texts two or more annotators judged, and on how many they agree to keep."""
    shared = [d for d in current.values() if len(d) > 1]
    same = [len({one.action == "reject" for one in d.values()}) == 1 for d in shared]
    return {"judged_twice": len(shared), "agreed": sum(same), "judged": len(current)}


def apply_decisions(
    episodes: Sequence[Episode], file: DecisionFile
) -> tuple[list[Episode], dict[str, str]]:
    """Return the episodes after review, and why others lost all their texts, by episode id.

    A text rejected by any reviewer is dropped, and so is one with unchecked words that nobody
    accepted or edited; the last of several edits holds. A decision about a text that has been
    rewritten since is left out. The records of how texts were made follow.
    """
    current = file.current()
    kept: list[Episode] = []
    lost: dict[str, str] = {}
    for episode in episodes:
        texts = list(episode.extra.get("instructions") or [episode.instruction])
        made = dict(episode.extra.get("instruction") or {})
        record_of = {record["text"]: record for record in made.get("texts", ())}
        result: list[str] = []
        records: list[dict[str, Any]] = []
        reasons: list[str] = []
        for number, text in enumerate(texts):
            record = record_of.get(text, {})
            decided = [
                d
                for d in current.get((episode.trajectory_id, number), {}).values()
                if d.before == text
            ]
            rejected = [d for d in decided if d.action == "reject"]
            edits = sorted((d for d in decided if d.action == "edit"), key=lambda d: d.at)
            if rejected:
                reasons += [d.reason or "rejected" for d in rejected]
            elif record.get("unchecked") and not decided:
                reasons.append(f"{UNCHECKED}: {', '.join(record['unchecked'])}")
            else:
                result.append(edits[-1].text if edits else text)
                if record:
                    records.append(_judged(record, result[-1], bool(decided)))
        if not result:
            lost[episode.episode_id] = "; ".join(reasons) or "no text"
            continue
        if result == texts and records == made.get("texts", []):
            kept.append(episode)
            continue
        if "texts" in made:
            made["texts"] = records
        made["reviewed"] = any(path == episode.trajectory_id for path, _ in current)
        extra = {**episode.extra, "instructions": result, "instruction": made}
        kept.append(replace(episode, instruction=result[0], extra=extra))
    return kept, lost


def _judged(record: dict[str, Any], text: str, vouched: bool) -> dict[str, Any]:
    """Return the record of a text after review; an edit may claim other things."""
    if vouched and record.get("unchecked"):
        record = {**record, "vouched": True}
    if record["text"] == text:
        return record
    kept = {key: v for key, v in record.items() if key not in OF_THE_WORDS}
    return {**kept, "text": text, "edited": True}

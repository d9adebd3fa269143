"""The journal of a drive: every decision of the person, on disk before the robot obeys.

Physics gives the same bits for the same decisions, so these are the record of the drive: from them
its rollout is made, and an interrupted drive goes on. A second apart, and where something was taken
back, the journal has a digest of the simulation's state, against which a replay of it is checked.
"""

import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...formats.core.errors import FileFormatError
from ...formats.core.journal import journal_line, parse_journal_line
from ...formats.core.rollout import Action
from ..controllers import Decision

FORMAT = "vlnpe drive 1"
FSYNC_S = 1.0  # a kill of the process loses nothing; a power cut loses what is newer


@dataclass
class Recording:
    """The content of a journal.

    Attributes:
        header: settings of the drive.
        decisions: by tick, without those that were taken back.
        digests: of the simulation's state, by tick.
        undone: ticks (from, back to) of everything that was taken back, in order.
        kept: the closing line of a drive that the person kept; None while it goes on.
    """

    header: dict[str, Any]
    decisions: dict[int, Decision] = field(default_factory=dict)
    digests: dict[int, str] = field(default_factory=dict)
    undone: list[tuple[int, int]] = field(default_factory=list)
    kept: dict[str, Any] | None = None

    def take(self, line: Mapping[str, Any]) -> None:
        """Take a line of the journal after its first; raise ValueError if it is of no kind."""
        match line:
            case {"at": [tick, command, action, done]}:
                chosen = None if action is None else Action(action)
                self.decisions[tick] = Decision(tuple(command), chosen, done)
            case {"tick": tick, "state": digest}:
                self.digests[tick] = digest
            case {"undo": [tick, to]}:
                self._undo(tick, to)
            case {"kept": dict() as closing}:
                self.kept = closing
            case _:
                raise ValueError(f"{sorted(line)}")

    def _undo(self, tick: int, to: int) -> None:
        self.undone.append((tick, to))
        self.decisions = {t: d for t, d in self.decisions.items() if t < to}
        self.digests = {t: d for t, d in self.digests.items() if t <= to}


def read_journal(path: Path) -> Recording:
    """Read a journal; a last line that a kill cut short is left out.

    Raises:
        FileFormatError: it is no journal of a drive, or damaged before its last line.
    """
    recording: Recording | None = None
    for number, line in _lines(path):
        if recording is None:
            if line.get("format") != FORMAT:
                raise FileFormatError(path, f"not a journal of `vlnpe drive`; valid: {FORMAT!r}")
            recording = Recording(line)
            continue
        try:
            recording.take(line)
        except (KeyError, TypeError, ValueError) as error:
            raise FileFormatError(path, f"line {number} is of no known kind: {error!r}") from error
    if recording is None:
        raise FileFormatError(path, "empty; a journal begins with the settings of its drive")
    return recording


def _lines(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    lines = path.read_bytes().split(b"\n")
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        try:
            yield number, parse_journal_line(line)
        except ValueError as error:
            if number == len(lines):  # no line break follows: cut short by a kill
                return
            raise FileFormatError(path, f"line {number} is damaged: {error}") from error


class Journal:
    """Appends to the journal of a drive."""

    def __init__(self, path: Path, header: Mapping[str, Any] | None = None) -> None:
        """Begin a journal with a header, or go on with the one in `path`."""
        self.path = path
        if header is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("xb", buffering=0)
            self._synced_s = 0.0
            self._append({"format": FORMAT, **header})
        else:
            content = path.read_bytes()
            whole = content.rfind(b"\n") + 1
            self._file = path.open("r+b", buffering=0)
            self._file.truncate(whole)
            self._file.seek(whole)
            self._synced_s = 0.0

    def decided(self, tick: int, decision: Decision) -> None:
        """Note a decision, which begins at `tick`."""
        action = None if decision.action is None else int(decision.action)
        self._append({"at": [tick, decision.command, action, decision.done]})

    def state(self, tick: int, digest: str) -> None:
        """Note the digest of the state at `tick`."""
        self._append({"tick": tick, "state": digest})

    def undo(self, tick: int, to: int) -> None:
        """Note that what was decided from tick `to` on is taken back."""
        self._append({"undo": [tick, to]})

    def keep(self, closing: dict[str, Any]) -> None:
        """Close the journal of a drive that is kept."""
        self._append({"kept": closing})
        self.close()

    def close(self) -> None:
        """Close the file; the drive can go on later."""
        if not self._file.closed:
            os.fsync(self._file.fileno())
            self._file.close()

    def _append(self, line: dict[str, Any]) -> None:
        self._file.write(journal_line(line))
        now_s = time.monotonic()
        if now_s - self._synced_s > FSYNC_S:
            os.fsync(self._file.fileno())
            self._synced_s = now_s

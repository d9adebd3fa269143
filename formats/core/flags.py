"""Walks of a run that a person set aside: an append-only file in the run's folder."""

import json
import os
import time
from pathlib import Path

from .errors import FileFormatError

FLAGS_NAME = "flags.jsonl"


class FlagFile:
    """One JSON object a line, `{"walk", "flagged", "note", "at"}`; a walk's last line counts.

    A walk's name is `<robot>/<controller>/<episode>`, as its rollout lies in the run's folder.
    """

    def __init__(self, run: Path):
        """Use the file in a run's folder; it need not exist."""
        self.path = run / FLAGS_NAME

    def set(self, walk: str, flagged: bool, note: str = "") -> None:
        """Flag a walk, or take its flag back; the line is on disk when this returns."""
        entry = {"walk": walk, "flagged": flagged, "note": note, "at": round(time.time(), 3)}
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(entry, ensure_ascii=False) + "\n")
            stream.flush()
            os.fsync(stream.fileno())

    def flagged(self) -> dict[str, str]:
        """Return the note of each flagged walk.

        Raises:
            FileFormatError: a line cannot be read.
        """
        if not self.path.is_file():
            return {}
        result: dict[str, str] = {}
        for number, line in enumerate(self.path.read_text(encoding="utf-8").splitlines(), 1):
            try:
                entry = json.loads(line)
                walk, flagged, note = str(entry["walk"]), bool(entry["flagged"]), entry["note"]
            except (ValueError, KeyError, TypeError) as error:
                raise FileFormatError(self.path, f"line {number} is not a flag: {error}") from error
            result.pop(walk, None)
            if flagged:
                result[walk] = str(note)
        return result

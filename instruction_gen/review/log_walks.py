"""Walks of a robot's log, for which people write texts: there are films, and no map to check by."""

import json
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.core.atomic import atomic_file
from ...formats.core.errors import FileFormatError, InputError
from ...formats.lerobot import EpisodeUnit
from ...formats.lerobot.layout import RGB_KEY
from ...formats.lerobot.units.rows import row_arrays
from ...formats.untrusted.documents import read_json_object

_NO_GRID = {"origin": [0.0, 0.0], "cell": 0.1, "rows": []}
_LONGEST = 2000  # characters of a text


class LogWalks:
    """Walks of a robot's log and the file with their texts, which `vlnpe convert` reads.

    Attributes:
        names: Names of the walks, in order.
        films: What the robot's camera saw (MP4), by name.
        texts: The JSON file, {"walk-000": "Go past …"}, which need not exist.
    """

    def __init__(self, units: Sequence[EpisodeUnit], texts: Path):
        self._units = {unit.folder.name: unit for unit in units}
        self.names = list(self._units)
        self.films = {name: unit.video(RGB_KEY) for name, unit in self._units.items()}
        self.texts = texts
        self._lock = threading.Lock()

    def path(self, name: str, annotator: str) -> dict[str, Any]:
        """Return all that the page shows of a walk; who asks does not matter."""
        unit, written, number = self._units[name], self._read(), self.names.index(name)
        text = written.get(name, unit.task)
        told = [n for n in self.names if written.get(n, self._units[n].task)]
        later = (*self.names[number + 1 :], *self.names[: number + 1])
        walked_m = row_arrays(unit.rows())["observation.state"][:, [1, 0]] * [-1, 1]  # ahead is up
        metres = float(np.linalg.norm(np.diff(walked_m, axis=0), axis=1).sum())
        seconds = unit.length / unit.frames_per_second
        shown = {
            "original": unit.task,
            "text": text,
            "verdict": self.check(name, 0, text),
            "own": "edit" if name in written else "",
            "reason": "",
            "others": [],
        }
        return {
            "name": name,
            "number": number,
            "paths": len(self.names),
            "scene": "",
            "path": np.round(walked_m, 2).tolist(),
            "things": [],
            "rooms": [],
            "walls": _NO_GRID,
            "facts": [f"{metres:.1f} m in {seconds:.0f} s; at first the robot faces up"],
            "texts": [shown],
            "film": True,
            "agreement": {"judged": len(told), "judged_twice": 0, "agreed": 0},
            "texts_in_all": len(self.names),
            "next_unjudged": next((self.names.index(n) for n in later if n not in told), -1),
            "written": True,
        }

    def check(self, name: str, number: int, text: str) -> dict[str, Any]:
        """Return the verdict on a text: nothing is known of the place, so any text may be true."""
        problems = [] if text.strip() else ["no text yet"]
        return {"problems": problems, "clauses": [], "unchecked": []}

    def decide(self, annotator: str, body: dict[str, Any]) -> None:
        """Write the text of an `edit`, or take back what was written with `undo`.

        Raises:
            InputError: Another action, or an empty text.
            KeyError, TypeError: The request is malformed.
        """
        name, action = self._units[str(body["path"])].folder.name, str(body["action"])
        text = " ".join(str(body.get("text", "")).split())[:_LONGEST]
        if action not in ("edit", "undo") or (action == "edit" and not text):
            raise InputError("walks of a log are told with edit, in some words, or undo")
        with self._lock:
            written = self._read()
            written.pop(name, None)
            if action == "edit":
                written[name] = text
            in_order = {n: written[n] for n in sorted(written)}
            self.texts.parent.mkdir(parents=True, exist_ok=True)
            with atomic_file(self.texts) as temporary:
                temporary.write_text(json.dumps(in_order, ensure_ascii=False, indent=1) + "\n")

    def _read(self) -> dict[str, str]:
        if not self.texts.is_file():
            return {}
        texts = read_json_object(self.texts)
        if not all(isinstance(text, str) for text in texts.values()):
            raise FileFormatError(self.texts, "valid: a text for each episode")
        return texts

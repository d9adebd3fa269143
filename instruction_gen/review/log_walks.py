"""Walks of a robot's log, for which people write texts: there are films, and no map to check by."""

import contextlib
import fcntl
import json
from collections.abc import Iterator, Sequence
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

    def path(self, name: str, annotator: str) -> dict[str, Any]:
        """Return all that the page shows of a walk; who asks does not matter."""
        unit, texts, number = self._units[name], self._read(), self.names.index(name)
        text = texts.get(name, unit.task)
        complete = [n for n in self.names if texts.get(n, self._units[n].task)]
        later = (*self.names[number + 1 :], *self.names[: number + 1])
        walked_m = row_arrays(unit.rows())["observation.state"][:, [1, 0]] * [-1, 1]  # ahead is up
        metres = float(np.linalg.norm(np.diff(walked_m, axis=0), axis=1).sum())
        seconds = unit.length / unit.frames_per_second
        shown = {
            "original": unit.task,
            "text": text,
            "verdict": self.check(name, 0, text),
            "own": "edit" if name in texts else "",
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
            "agreement": {"judged": len(complete), "judged_twice": 0, "agreed": 0},
            "texts_in_all": len(self.names),
            "next_unjudged": next((self.names.index(n) for n in later if n not in complete), -1),
            "written": True,
        }

    def check(self, name: str, number: int, text: str) -> dict[str, Any]:
        """Return the verdict on a text: nothing is known of the place, so any text may be true."""
        fault = "" if text.strip() else "no text yet"
        if len(text) > _LONGEST:
            fault = f"{len(text):,} characters; valid: up to {_LONGEST:,}"
        return {"problems": [fault] if fault else [], "clauses": [], "unchecked": []}

    def decide(self, annotator: str, body: dict[str, Any]) -> None:
        """Write the text of an `edit`, or take back what was written with `undo`.

        Raises:
            InputError: Another action, or a text that is empty or too long.
            KeyError, TypeError: The request is malformed.
        """
        name, action = self._units[str(body["path"])].folder.name, str(body["action"])
        text = " ".join(str(body.get("text", "")).split())
        if action not in ("edit", "undo"):
            raise InputError("a walk of a log takes `edit` with a text, or `undo`")
        if action == "edit" and (problems := self.check(name, 0, text)["problems"]):
            raise InputError(problems[0])
        with self._alone():
            texts = self._read()
            texts.pop(name, None)
            if action == "edit":
                texts[name] = text
            in_order = {n: texts[n] for n in sorted(texts)}
            content = json.dumps(in_order, ensure_ascii=False, indent=1) + "\n"
            with atomic_file(self.texts) as temporary:
                temporary.write_text(content, encoding="utf-8")

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other threads and servers from the texts, which are replaced as a whole."""
        self.texts.parent.mkdir(parents=True, exist_ok=True)
        with self.texts.with_name(f".{self.texts.name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _read(self) -> dict[str, str]:
        if not self.texts.is_file():
            return {}
        texts = read_json_object(self.texts)
        if not all(isinstance(text, str) for text in texts.values()):
            raise FileFormatError(self.texts, "valid: a text for each episode")
        return texts

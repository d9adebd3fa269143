"""The paths to review: their maps, facts and texts, and what was decided about them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.core.episode import Episode
from ...formats.core.errors import VlnpeError
from ...formats.scene.visibility import Visibility
from ...formats.vlnce.files import scene_stem
from ...formats.vlnce.groups import group_by_path, ungroup
from ...wayfinding.regions import RegionMap
from ..checker import Ground, Verdict, check_text
from ..checker.form import script_problems
from ..facts import LevelFacts
from ..facts.named import Named
from ..facts.records import PathFacts
from ..instruct import Levels
from ..language.claims import read_steps
from .decisions import Current, Decision, DecisionFile, agreement


class Review:
    """Paths to review, with their maps and facts, and the decisions about them."""

    def __init__(
        self,
        episodes: Sequence[Episode],
        scenes: Path,
        decisions: Path,
        films: dict[str, Path] | None = None,
        seen: Visibility | None = None,
        named: Mapping[str, Named] | None = None,
    ):
        """Review the episodes that have texts; one path's episodes are shown once, as one.

        Args:
            episodes: instructed.
            scenes: folder of repaired scenes.
            decisions: append-only file.
            films: ego film (MP4) of a path, by trajectory id.
            seen: what the robot's camera sees along the paths.
            named: things and rooms, by scene, where a scan has no labels.
        """
        instructed = group_by_path(e for e in episodes if e.instruction)
        self.paths = {e.trajectory_id: e for e in reversed(instructed)}
        self.paths = dict(reversed(self.paths.items()))
        self.names = list(self.paths)
        self.file = DecisionFile(decisions)
        self.films = films or {}
        self._seen = seen
        self._levels = Levels(scenes, named)
        self._grounds: dict[str, Ground] = {}

    def ground(self, name: str) -> Ground:
        """Return the facts of a path."""
        if name not in self._grounds:
            self._grounds[name] = Ground(self._levels.facts(self.paths[name], self._seen))
        return self._grounds[name]

    def path(self, name: str, annotator: str) -> dict[str, Any]:
        """Return all that the page shows of a path."""
        episode = self.paths[name]
        level = self._levels.of(episode)
        facts = self.ground(name).facts
        current = self.file.current()
        texts = []
        for number, text in enumerate(_texts(episode)):
            decided = current.get((name, number), {})
            own = decided.get(annotator)
            shown = own.text if own is not None and own.action == "edit" else text
            texts.append(
                {
                    "original": text,
                    "text": shown,
                    "verdict": self.check(name, number, shown),
                    "own": own.action if own else "",
                    "reason": own.reason if own else "",
                    "others": sorted(d.action for a, d in decided.items() if a != annotator),
                }
            )
        things = [
            {"noun": n, "low": low.tolist(), "high": high.tolist()}
            for n, low, high in zip(level.nouns, level.low_m, level.high_m, strict=True)
        ]
        return {
            "name": name,
            "number": self.names.index(name),
            "paths": len(self.names),
            "scene": scene_stem(episode.scene_id),
            "path": np.round(episode.reference_path_world_m[:, :2], 2).tolist(),
            "things": things,
            "rooms": _rooms(level),
            "walls": _walls(level.regions),
            "facts": _along(facts),
            "texts": texts,
            "film": name in self.films,
            "agreement": agreement(current),
            "texts_in_all": sum(len(_texts(one)) for one in self.paths.values()),
            "next_unjudged": self._next_unjudged(name, annotator, current),
            "written": False,
        }

    def _next_unjudged(self, name: str, annotator: str, current: Current) -> int:
        """Return the number of the next path with a text that someone has yet to judge; −1: none.

        It is looked for after `name`, then from the first path on.
        """
        here = self.names.index(name)
        for number in (*range(here + 1, len(self.names)), *range(here + 1)):
            path = self.names[number]
            for k in range(len(_texts(self.paths[path]))):
                if annotator not in current.get((path, k), {}):
                    return number
        return -1

    def check(self, name: str, number: int, text: str) -> dict[str, Any]:
        """Return the verdict on a text in place of a path's text `number`, with its clauses.

        The text as it was written has the claims of its writer. What a person changes in another
        language than English is unchecked: who accepts it vouches for it.
        """
        original, text = _texts(self.paths[name])[number], text[:2000]
        record = self._record(name, original)
        same = text == original
        if (language := record.get("language", "en")) != "en":
            problems = tuple(script_problems(text, language))
            unchecked = tuple(record.get("unchecked", ())) if same else (text,)
            verdict = Verdict(problems, ((0, len(text), problems),), unchecked)
        else:
            steps = read_steps(record.get("claims", [])) if same else ()
            verdict = check_text(text, self.ground(name), steps)
        return {
            "problems": list(verdict.problems),
            "clauses": [list(clause) for clause in verdict.clauses],
            "unchecked": list(verdict.unchecked),
        }

    def _record(self, name: str, text: str) -> dict[str, Any]:
        """Return how a text of a path was made; empty where nothing says so."""
        made = [one.extra.get("instruction") or {} for one in ungroup(self.paths[name])]
        records = [record for one in made for record in one.get("texts") or ()]
        return next((one for one in records if one["text"] == text), {})

    def decide(self, annotator: str, body: dict[str, Any]) -> None:
        """Write a decision; an edit that the checker refuses is not accepted.

        Raises:
            VlnpeError: the edit is not true.
            KeyError, IndexError, ValueError: the request is malformed.
        """
        name, number, action = str(body["path"]), int(body["number"]), str(body["action"])
        texts = _texts(self.paths[name])
        if number < 0:
            raise IndexError(number)
        text = str(body.get("text", ""))
        if action == "edit":
            problems = self.check(name, number, text)["problems"]
            if problems:
                raise VlnpeError("; ".join(problems))
        reason = str(body.get("reason", ""))[:500]
        edited = text if action == "edit" else ""
        self.file.add(Decision(annotator, name, number, action, texts[number], edited, reason))


def _texts(episode: Episode) -> list[str]:
    return episode.extra.get("instructions") or [episode.instruction]


def _along(facts: PathFacts) -> list[str]:
    """Return what is where along a path, in the order in which it comes."""
    lines = [(t.along_m, f"{t.side} {abs(t.angle_deg):.0f}°") for t in facts.turns]
    lines += [(p.along_m, f"into {p.to_room or 'the next room'}") for p in facts.doors]
    lines += [(c.along_m, f"{c.way} the stairs") for c in facts.climbs]
    lines += [
        (m.along_m, f"{m.noun} {m.side} {m.distance_m:.1f} m")
        for m in facts.landmarks
        if m.nameable and m.distance_m <= 2.5
    ]
    lines.append((facts.length_m, f"goal, in {facts.goal_room or 'a room without a name'}"))
    return [f"{along_m:.1f} m: {line}" for along_m, line in sorted(lines)]


def _rooms(level: LevelFacts) -> list[dict[str, Any]]:
    """Return the names of the rooms, each with a place inside it."""
    result = []
    for number, name in enumerate(level.names):
        cells = np.argwhere(level.regions.region == number)
        if name and len(cells):
            inside = cells[np.argmin(np.linalg.norm(cells - cells.mean(axis=0), axis=1))]
            xy_m = level.regions.grid.center_of(inside)
            result.append({"name": name, "at": np.round(xy_m, 2).tolist()})
    return result


def _walls(regions: RegionMap) -> dict[str, Any]:
    """Return where there is floor, as rows of 0 and 1 on a grid of 10 cm, for the map."""
    step = max(1, round(0.1 / regions.grid.cell_m))
    floor = (regions.width_m > 0)[::step, ::step]
    return {
        "origin": list(regions.grid.origin_xy_m),
        "cell": regions.grid.cell_m * step,
        "rows": ["".join("1" if cell else "0" for cell in row) for row in floor],
    }

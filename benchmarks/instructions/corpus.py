"""The corpus: true texts written by hand about paths of some scenes.

Parts, in the order in which they were written:

- `earlier`, `tuning`: read while the checker was written.
- `held_out`: set aside until the checker was finished.
- `later`: written afterwards about two more apartments.
- `fresh`: from maps and boxes alone, about four more apartments and a villa, before the checker was
  worked on again.
- `last`: about one more apartment, after the failures of `fresh` were corrected.
- `voices`: about two more and a villa, in eight manners of speaking, named beside the texts, by a
  writer who had not seen the checker.
- `sealed`: about three more apartments by another such writer, measured after the last change of
  the checker; its paths were sampled in the exact buildings (`vlnpe scan --exact`).
- `sealed2`: likewise about three more apartments and a villa, measured after the checker had been
  worked on with `voices` and `sealed`.
- `sealed3`: about three more apartments and a villa by two further writers in eight voices,
  measured once after work with most parts before it.
- `announced`: by the author of the checker's corrections, about one more apartment and a villa, two
  thirds of it with the goal said first; three causes of its refusals were corrected.
- `sealed4`: about three more apartments and a villa by two writers who had seen neither parser nor
  checker, half of it with the goal said first, measured once after that work.
- `sealed5`: likewise by two more writers in eight voices about three more apartments and a villa.
- `sealed6`: likewise by two more writers about four more apartments; its paths were sampled on the
  plans of the buildings.
- `blind`: truths and lies in three voices about two apartments and two villas, see `blind.py`;
  `blind2` likewise about paths of three older buildings, after the corrections to `blind`.
- `unseen_open`, `unseen_sealed`: truths and lies with their claims in three voices about an
  apartment, a villa, a house and an office, by three writers who had seen none of the code. The
  checker was corrected with the first half; the second was measured once, after that.
- `model`, `sealed_model`: by a large language model that answered the requests of `--writer llm`
  about six apartments and two villas, those that passed at the first try. The checker and the
  facts that are sent were worked on with what was refused of the first half.
"""

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.formats.scene.visibility import Visibility
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.facts import LevelFacts, path_facts
from vlnpe.instruction_gen.language.claims import Step, read_steps
from vlnpe.pipeline.stages.instructions.visibility import StandingEye, look

from .buildings import building
from .lies import KINDS
from .rewording import reworded

FOLDER = Path(__file__).parent / "corpus"
PARTS = (
    *("earlier", "tuning", "held_out", "later"),
    *("fresh", "last", "voices", "sealed", "sealed2", "sealed3", "announced", "sealed4"),
    *("sealed5", "sealed6", "blind", "blind2", "unseen_open", "unseen_sealed"),
    *("model", "sealed_model"),
)
KIND_NAMES = ("apartment", "villa", "house", "office")


@dataclass(frozen=True)
class Entry:
    """A path of the corpus.

    Attributes:
        name: scene and number.
        part: of `PARTS`.
        ground: its facts.
        texts: true ones.
        lies: false ones, each with its `kind`, `voice` and `text`.
        claims: by text, the steps that its writer delivered, if he did.
        true_claims: by lie, the same words with claims as they would be without the lie.
    """

    name: str
    part: str
    ground: Ground
    texts: tuple[str, ...]
    lies: tuple[dict[str, str], ...] = ()
    claims: Mapping[str, tuple[Step, ...]] = field(default_factory=dict)
    true_claims: Mapping[str, tuple[Step, ...]] = field(default_factory=dict)


def read_corpus(scenes: Path, scans: Path | None, parts: tuple[str, ...]) -> list[Entry]:
    """Return the entries of some parts.

    Args:
        scenes: folder of repaired scenes; real scenes that it lacks are made there if their scan is
            in `scans`, else left out. Generated buildings that it lacks need no scan; what the
            robot's camera sees of them is not in their facts.
        scans: folder of scans, e.g. `small_house.glb`.
        parts: of `PARTS`.
    """
    result = []
    for file in sorted(FOLDER.glob("*.json")):
        document = json.loads(file.read_text())
        paths = [p for p in document["paths"] if p["half"] in parts]
        if not paths:
            continue
        scene, source = scenes / file.stem, document["scene"]
        kind = next((kind for kind in KIND_NAMES if kind in source), "")
        present = (scene / "scene.json").is_file()
        if kind and not present:
            ground_floor = [p for p in paths if p["level"] == 0]
            if len(ground_floor) < len(paths):
                sys.stderr.write(f"{file.stem}: paths upstairs need the scene, left out\n")
            result += _entries(scene.name, ground_floor, {0: building(kind, source[kind])})
        elif present or _build(scene, source, scans):
            bundle = load_bundle(scene)
            levels = {n: LevelFacts.of(bundle, n) for n in {p["level"] for p in paths}}
            result += _entries(scene.name, paths, levels, bundle)
        else:
            sys.stderr.write(f"{file.stem}: no scan, left out\n")
    return result


def _build(scene: Path, source: dict[str, Any], scans: Path | None) -> bool:
    if scans is None or not (scans / source["scan"]).is_file():
        return False
    scan = str(scans / source["scan"])
    vlnpe = [sys.executable, "-m", "vlnpe.pipeline.cli"]
    subprocess.run([*vlnpe, "repair", scan, "--out", str(scene)], check=True)
    return True


def _entries(
    scene_id: str,
    paths: list[dict[str, Any]],
    levels: Mapping[int, LevelFacts],
    bundle: SceneBundle | None = None,
) -> list[Entry]:
    episodes = [episode_of_record(path, scene_id) for path in paths]
    sight = None
    if bundle:
        eye = StandingEye(get_robot("aliengo"))
        sight = Visibility(eye.described(), dict(look(bundle, episodes, eye)))
    return [
        Entry(
            path["id"],
            path["half"],
            Ground(path_facts(episode, levels[episode.level], sight)),
            tuple(path["texts"]),
            tuple(path.get("lies", ())),
            *(
                {text: read_steps(steps) for text, steps in path.get(key, {}).items()}
                for key in ("claims", "true_claims")
            ),
        )
        for path, episode in zip(paths, episodes, strict=True)
    ]


def episode_of_record(path: dict[str, Any], scene: str) -> Episode:
    """Return a path of the corpus as an episode."""
    points = np.array(path["path_world_m"], dtype=np.float64)
    return Episode(
        episode_id=path["id"],
        trajectory_id=path["id"],
        scene_id=scene,
        split="val",
        level=path["level"],
        start_position_world_m=points[0],
        start_yaw_rad=path["start_yaw_rad"],
        goal_position_world_m=points[-1],
        reference_path_world_m=points,
        geodesic_distance_m=float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
    )


def measure(entries: list[Entry]) -> dict[str, Any]:
    """Return lies caught per kind, and true texts refused, as written and reworded."""
    rng, other = np.random.default_rng(0), np.random.default_rng(1)
    changed: list[Any] = []
    kinds: dict[str, Counter[bool]] = {kind: Counter() for kind in KINDS}
    refused: list[Any] = []
    missed: list[Any] = []
    judged = 0
    for entry in entries:
        for text in entry.texts:
            judged += 1
            verdict = check_text(text, entry.ground)
            if not verdict.ok:
                refused.append([entry.name, text, list(verdict.problems)])
            elif not check_text(changed_text := reworded(text, other), entry.ground).ok:
                changed.append([entry.name, changed_text])
            for kind, lie in KINDS.items():
                false = lie(text, entry.ground.facts, rng)
                if not false or false == text:
                    continue
                caught = not check_text(false, entry.ground).ok
                kinds[kind][caught] += 1
                if not caught:
                    missed.append([kind, entry.name, false])
    return {
        "paths": len(entries),
        "true texts": judged,
        "refused": refused,
        "refused reworded": changed,
        "lies caught": {k: [c[True], sum(c.values())] for k, c in kinds.items()},
        "all lies": [
            sum(c[True] for c in kinds.values()),
            sum(sum(c.values()) for c in kinds.values()),
        ],
        "missed": missed,
    }

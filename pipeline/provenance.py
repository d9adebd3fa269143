"""The provenance of a dataset: the values of meta/provenance.json."""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from ..formats.core.atomic import file_digest
from ..formats.core.rollout import Rollout
from ..formats.lerobot.splits import held_out_scenes
from ..formats.process.source import ROOT
from ..formats.scene.bundle import SceneBundle
from ..formats.video.codecs import DEPTH_CODEC, RGB_CODECS
from .engine.work import digest

# Facts of a rollout that say how it was made, not what happened in it.
MAKING = (
    "seed", "policy_sha256", "policy_state", "robot_physics", "timestep_s", "policy_rate_hz",
    "mujoco",
)  # fmt: skip
# Facts of an instruction; model and prompts are those of a language model, if one wrote it.
WRITING = ("composer", "model", "prompt_sha256", "temperature")
# Facts of the vision-language model that named things for an instruction, if one did.
SEEING = ("vision_model", "vision_prompt_sha256")


def episode_facts(rollout: Rollout) -> dict[str, Any]:
    """Return how one episode was made, for `provenance`: JSON values."""
    written = rollout.episode.extra.get("instruction") or {}
    return {
        "rollout": {key: rollout.facts.get(key) for key in MAKING}
        # Settings are many numbers, and the same for all episodes of a run.
        | {"controller_sha256": digest(rollout.facts.get("controller_config"))},
        "instruction": {key: written.get(key) for key in WRITING}
        | {key: written[key] for key in SEEING if key in written},
    }


def provenance(
    episodes: Sequence[Mapping[str, Any]],
    bundles: Sequence[SceneBundle],
    scenes: Iterable[str],
    encoding: Mapping[str, Any],
    facts: Mapping[str, Any],
    code_sha256: str,
) -> dict[str, Any]:
    """Return JSON values that depend on nothing but the arguments.

    Args:
        episodes: `episode_facts` of each episode.
        bundles: the scenes they lie in.
        scenes: Names of all scenes of the run; some are held out for validation.
        encoding: frame rate, light, codecs, … of the pixels.
        facts: `options`, as the user chose them.
        code_sha256: digest of the code that made the episodes and their pixels.
    """
    rollouts = [episode["rollout"] for episode in episodes]
    written = [episode["instruction"] for episode in episodes]
    recorded = (*WRITING, *(key for key in SEEING if any(key in entry for entry in written)))
    creation = {
        key: _distinct(rollout[key] for rollout in rollouts)
        for key in (*MAKING, "controller_sha256")
    }
    options = dict(facts.get("options") or {})
    return {
        **versions(code_sha256),
        "config_sha256": digest(options, creation, dict(encoding)),
        "scenes": {bundle.scene_id: bundle.source for bundle in bundles},
        "held_out_scenes": sorted(held_out_scenes(scenes)),
        "seeds": {"run": options.get("seed"), "replay": creation.pop("seed")},
        "policy_sha256": creation.pop("policy_sha256"),
        "replay": creation,
        "instructions": {key: _counted(entry.get(key) for entry in written) for key in recorded},
        "encoding": dict(encoding),
        **facts,
    }


def scene_provenance(
    bundle: SceneBundle, held_out: Sequence[str], encoding: Mapping[str, Any], code_sha256: str
) -> dict[str, Any]:
    """Return how an episode's own file was made, beside its rollout's facts.

    The same for all episodes of a scene and a view, so that files of one dataset can be joined.

    Args:
        held_out: scenes of the run that validate.
        encoding: frame rate, light, codecs, … of the pixels.
        code_sha256: digest of the code that made the episode and its pixels.
    """
    return {
        **versions(code_sha256),
        "scenes": {bundle.scene_id: bundle.source},
        "held_out_scenes": list(held_out),
        "encoding": dict(encoding),
    }


def versions(code_sha256: str) -> dict[str, str | None]:
    """Return what was run: vlnpe's version, its code, and the lock of the libraries, if any."""
    lock = ROOT / "uv.lock"
    return {
        "vlnpe": version("vlnpe"),
        "code_sha256": code_sha256,
        "lock_sha256": file_digest(lock) if lock.is_file() else None,
    }


def encoding_facts(meta: Mapping[str, Any], depth_storage: str) -> dict[str, Any]:
    """Return how the pixels of a rendered view are encoded; `meta` is its meta.json."""
    depth = {key: meta["depth"][key] for key in ("near_m", "far_m")}
    stored = asdict(DEPTH_CODEC) if depth_storage == "video" else {"image": "tiff, uint16 mm"}
    return {
        "frames_per_second": meta["frames_per_second"],
        **{key: meta.get(key) for key in ("view", "renderer", "light")},
        "rgb": asdict(RGB_CODECS[meta["rgb"]["codec"]]),
        "depth": depth | stored,
    }


def _distinct(values: Iterable[Any]) -> list[Any]:
    """Return the distinct values other than None, sorted by their JSON."""
    texts = {json.dumps(value, sort_keys=True) for value in values if value is not None}
    return [json.loads(text) for text in sorted(texts)]


def _counted(values: Iterable[Any]) -> dict[str, int]:
    """Return how many episodes have each value other than None."""
    return dict(sorted(Counter(str(value) for value in values if value is not None).items()))

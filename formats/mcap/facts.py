"""A rollout's records apart from its arrays, as text for an MCAP metadata record."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..core.episode import Episode
from ..core.errors import FileFormatError
from ..core.rollout import Action, ActionSpan, EndReason, Event, Metrics, Rollout
from ..untrusted.documents import parse_json

METADATA_NAME = "vlnpe.rollout"
JSON_KEY = "json"
FORMAT_VERSION = 1


def episode_to_json(episode: Episode) -> dict[str, Any]:
    """Convert the episode to JSON values; floats are exact."""
    return {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in vars(episode).items()
    }


def episode_from_json(values: dict[str, Any]) -> Episode:
    """Return the inverse of `episode_to_json`."""
    arguments = dict(values)
    for key in ("start_position_world_m", "goal_position_world_m", "reference_path_world_m"):
        arguments[key] = np.array(values[key], dtype=np.float64)
    return Episode(**arguments)


def rollout_facts(rollout: Rollout) -> dict[str, str]:
    """Return everything but the arrays, as a metadata record."""
    facts = {
        "format_version": FORMAT_VERSION,
        "samples": len(rollout.time_s),
        "episode": episode_to_json(rollout.episode),
        "robot": rollout.robot,
        "controller": rollout.controller,
        "joint_names": rollout.joint_names,
        "foot_names": rollout.foot_names,
        "actions": [[int(a.action), a.start_sample, a.stop_sample] for a in rollout.actions],
        "labels": [int(a) for a in rollout.labels],
        "events": [[e.time_s, e.kind, e.detail] for e in rollout.events],
        "end_reason": rollout.end_reason.value,
        "metrics": asdict(rollout.metrics),
        "facts": rollout.facts,
    }
    # One key: the writer's order of several keys is random, and files should repeat exactly.
    return {JSON_KEY: json.dumps(facts, ensure_ascii=False)}


def rollout_fields(metadata: dict[str, str], path: Path) -> dict[str, Any]:
    """Return arguments of `Rollout` but the arrays, and `samples`: inverse of `rollout_facts`."""
    try:
        facts = parse_json(path, metadata[JSON_KEY].encode())
        version = facts["format_version"]
        if version != FORMAT_VERSION:
            reason = f"rollout version {version}; this code reads {FORMAT_VERSION}"
            raise FileFormatError(path, reason)
        samples = facts["samples"]
        for _, start, stop in facts["actions"]:
            if not 0 <= start <= stop <= samples:
                raise ValueError(f"an action from sample {start} to {stop} of {samples}")
        return {
            "samples": samples,
            "episode": episode_from_json(facts["episode"]),
            "robot": facts["robot"],
            "controller": facts["controller"],
            "joint_names": tuple(facts["joint_names"]),
            "foot_names": tuple(facts["foot_names"]),
            "actions": tuple(ActionSpan(Action(a), b, c) for a, b, c in facts["actions"]),
            "labels": tuple(Action(a) for a in facts.get("labels", ())),
            "events": tuple(Event(*event) for event in facts["events"]),
            "end_reason": EndReason(facts["end_reason"]),
            "metrics": Metrics(**facts["metrics"]),
            "facts": facts["facts"],
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(path, f"not the facts of a rollout: {error!r}") from error

"""Options of `vlnpe benchmark`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from . import Json
from .running import Running


@dataclass(frozen=True)
class Benchmark(Running):
    """Evaluate several policies with several robots on the same episodes, in one table.

    Example: vlnpe benchmark vlnpe-10, or vlnpe benchmark runs/r2r --split val_unseen
    """

    episodes: tyro.conf.Positional[Path] = Path("vlnpe-10")
    """vlnpe-10 (ten generated scenes, made at the first call), or the run folder of a `collect`."""
    policy: str = "stop,forward,random,oracle"
    """Policies, comma-separated; see `vlnpe evaluate`."""
    robot: str = "h1,g1,aliengo,jetbot,vlnce"
    """Robots, comma-separated; vlnce is the bodyless agent."""
    controller: str = "flash,speed"
    """Controllers, comma-separated; the bodyless agent takes part under flash alone."""
    split: str = ""
    """Splits to evaluate, comma-separated; by default those that the benchmark reports, or all."""
    limit: int | None = None
    """Evaluate only so many episodes of each split, evenly spread over it."""
    camera: str = "ego"
    """Camera of the policies, with an optional size and field of view (ego:224x224:79)."""
    seed: int = 0
    """Random seed of policies and physics."""
    out: Path | None = None
    """Run folder of vlnpe-10, runs/vlnpe-10 by default. The results go to its benchmark/."""
    json: Json = False
    """Print one JSON object with the results as the last line."""

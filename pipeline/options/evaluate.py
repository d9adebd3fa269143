"""Options of the commands for closed loop."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...formats.core.errors import InputError
from . import check_numbers, check_port, must_exist
from .running import Running
from .shared import DiscreteActions, Mounting, Printing


@dataclass(frozen=True)
class Evaluate(DiscreteActions, Mounting, Running):
    """Evaluate a policy in closed loop: success, falls, distance to the goal, path length.

    Example: vlnpe evaluate runs/apartment-0 --policy random --robot h1
    """

    episodes: tyro.conf.Positional[Path]
    """Run folder of `collect`, or an episode file (.json.gz), with --scenes if it is not part of a
    run."""
    policy: str = "random"
    """Policy: random (R2R's action proportions), forward, stop, oracle (the expert, which knows the
    path); trained and shipped: cma-robots (for h1, aliengo and jetbot), cma-robots-32px (for these,
    from scratch), cma-h1 (for h1), cma (for vlnce); map (an online semantic map, without training;
    map-llm, map-vlm and map-vlm-llm ask a model for sub-goals, labels, or both), vlm (a
    vision-language model, see docs/guides/evaluation.md), a checkpoint of `vlnpe train`
    (FILE.safetensors), or the address of a policy server (ws://HOST:PORT, or http://HOST:PORT for
    models served by /eval_dual)."""
    scenes: Path | None = None
    """Folder of repaired scenes; defaults to the run's own."""
    robot: str = "aliengo"
    """Robot: a name (see `vlnpe robots`), or the folder of your own robot."""
    controller: str = "auto"
    """Controller that executes the actions: speed (physics), flash (placed without physics), path
    for --actions waypoints, or auto: the first of these that suits robot and actions."""
    actions: str = "discrete"
    """Actions of a policy server: discrete (controller speed or flash), velocity (speed) or
    waypoints (path; the policy map and those that begin with map- support them, too)."""
    split: str | None = None
    """Evaluate only this split, for example val_unseen; all by default."""
    limit: int | None = None
    """Maximum number of episodes; the first ones are evaluated."""
    camera: str = "ego"
    """Camera of the policy: ego, or a rig (rig:125cm_30deg), with an optional size and field of
    view (ego:224x224:79); a learned policy defaults to the camera of its training data."""
    light: str = "baked"
    """Lighting: baked, DL5000, DL300 or CL."""
    renderer: str = "auto"
    """Renderer: embree, gl, splat, splat_depth, or auto."""
    timeout_s: float = 30.0
    """Maximum time that a policy server may take for one action [s]; physics waits meanwhile."""
    max_tokens: int = 0
    """Stop querying a model behind an OpenAI-compatible server (vlm, map-llm, map-vlm, map-vlm-llm)
    after this many tokens; 0 means no limit. Episodes that need more are quarantined."""
    max_cost: float = 0.0
    """Stop querying such a model after this cost, at the prices set in the environment; 0 means no
    limit."""
    seed: int = 0
    """Random seed."""
    films: int = 0
    """Write report.html with this many films of successes and of each kind of failure: the policy's
    view and one from behind, with the instruction and the chosen actions."""
    mcap: bool = False
    """Also write one MCAP file per episode with the images that the policy saw, for Foxglove."""
    out: Path | None = None
    """Output folder; defaults to <run>/evaluations/<policy>-<robot>-<controller>-<light>, for an
    episode file in runs/evaluations."""

    def check(self) -> None:
        """Raise InputError if a file or folder is missing, or `limit` is below 1."""
        must_exist(self.episodes, self.scenes)
        check_numbers(self, 1, "limit")


@dataclass(frozen=True)
class Compare(Printing):
    """Compare two evaluations episode by episode: changed outcomes and metrics."""

    first: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FIRST")]
    """Folder of `evaluate`, or its results.json."""
    second: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SECOND")]
    """Folder or results.json of the evaluation that is compared with it."""

    def check(self) -> None:
        """Raise InputError if a file or folder is missing."""
        must_exist(self.first, self.second)


@dataclass(frozen=True)
class Dagger(DiscreteActions, Mounting, Running):
    """Let a policy walk, and record what the expert would have done at each step (DAgger).

    The result is a run like any other: rollouts, frames, LeRobot and MCAP, with the expert's
    actions as `action.discrete` and the controller `dagger`.
    Example: vlnpe dagger runs/homes --policy cma --robot h1 --beta 0.75 --out runs/homes-dagger
    """

    episodes: tyro.conf.Positional[Path]
    """Run folder of `collect`, or an episode file (.json.gz), with --scenes if it is not part of a
    run."""
    policy: str = "cma"
    """Policy with discrete actions, as of `vlnpe evaluate`; a server, too."""
    beta: float = 0.5
    """Probability that the expert takes an action instead of the policy, 0 to 1."""
    scenes: Path | None = None
    """Folder of repaired scenes; defaults to the run's own."""
    robot: str = "aliengo"
    """Robot: a name (see `vlnpe robots`), or the folder of your own robot."""
    controller: str = "auto"
    """Controller that executes the actions: speed (physics), flash (placed without physics), or
    auto: the first of these that suits the robot."""
    split: str | None = "train"
    """Walk only this split; `all` walks every one."""
    limit: int | None = None
    """Maximum number of episodes; the first ones are walked."""
    camera: str = "ego"
    """Camera of policy and data: ego, or a rig (rig:125cm_30deg), with an optional size and field
    of view (ego:224x224:79); a learned policy defaults to the camera of its training data."""
    light: str = "baked"
    """Lighting: baked, DL5000, DL300 or CL."""
    renderer: str = "auto"
    """Renderer: embree, gl, splat, splat_depth, or auto."""
    timeout_s: float = 30.0
    """Maximum time that a policy server may take for one action [s]; physics waits meanwhile."""
    seed: int = 0
    """Random seed; of which actions are the expert's, too."""
    out: Path = Path("runs/dagger")
    """Output folder."""

    def check(self) -> None:
        """Raise InputError if a file or folder is missing, or a number is out of range."""
        must_exist(self.episodes, self.scenes)
        check_numbers(self, 1, "limit")
        if not 0 <= self.beta <= 1:
            raise InputError(f"--beta {self.beta:g}; valid: 0 to 1")


@dataclass(frozen=True)
class Serve:
    """Serve a policy to a robot or another program over HTTP, in the form of InternNav's models.

    POST /eval_dual takes an image, depth and JSON, and answers {"discrete_action": [1]}.
    Example: vlnpe serve cma --port 5801
    """

    policy: tyro.conf.Positional[str]
    """Policy: a learned one (cma, cma-h1, cma-robots, FILE.safetensors), random, forward, stop."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets other machines connect. There is no password."""
    port: int = 5801
    """Port to listen on; 0 takes a free one."""
    instruction: str = ""
    """Instruction for requests that have none (InternNav's own client sends none)."""
    seed: int = 0
    """Random seed."""

    def check(self) -> None:
        """Raise InputError if there is no such port."""
        check_port(self.port)


@dataclass(frozen=True)
class Benchmark(Running):
    """Evaluate several policies with several robots on the same episodes, in one table.

    Example: vlnpe benchmark vlnpe-10, or vlnpe benchmark runs/r2r --split val_unseen
    """

    episodes: tyro.conf.Positional[Path] = Path("vlnpe-10")
    """vlnpe-10 (ten scenes, generated by the first call), or the run folder of a `collect`."""
    policy: str = "stop,forward,random,oracle"
    """Policies, comma-separated; see `vlnpe evaluate`."""
    robot: str = "h1,g1,aliengo,jetbot,vlnce"
    """Robots, comma-separated; vlnce is the bodyless agent."""
    controller: str = "flash,speed"
    """Controllers, comma-separated; the bodyless agent only runs under flash."""
    split: str = ""
    """Splits to evaluate, comma-separated; defaults to the benchmark's own, or all."""
    limit: int | None = None
    """Maximum number of episodes per split, evenly spread over it."""
    camera: str = "ego"
    """Camera of the policies, with an optional size and field of view (ego:224x224:79)."""
    seed: int = 0
    """Random seed of policies and physics."""
    out: Path | None = None
    """Run folder of vlnpe-10, runs/vlnpe-10 by default. The results go to its benchmark/."""

    def check(self) -> None:
        """Raise InputError if `limit` is below 1."""
        check_numbers(self, 1, "limit")

"""Policies: what chooses actions from observations, by one small protocol and one registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from uuid import uuid4

import numpy as np

from ..formats.core.atomic import file_digest
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError, MissingExtraError, UnknownNameError, VlnpeError
from ..formats.core.rollout import Action
from .observation import Observation

if TYPE_CHECKING:
    from .learned import LearnedPolicy
    from .map_policy.policy import MapPolicy
    from .remote import RemotePolicy


class PolicyError(VlnpeError):
    """A policy gave no valid action in time: it was late or wrong, or its server is gone."""


@dataclass(frozen=True)
class Assignment:
    """What a policy knows when an episode starts: neither the goal nor the path.

    Attributes:
        robot, controller: names of what carries the actions out.
        actions: kind of actions to give, see `motions.ACTION_KINDS`.
    """

    episode_id: str
    scene_id: str
    instruction: str
    robot: str
    controller: str
    actions: str = "discrete"

    @classmethod
    def of(
        cls, episode: Episode, robot: str, controller: str, actions: str = "discrete"
    ) -> Assignment:
        """Return the assignment of an episode."""
        names = (episode.episode_id, episode.scene_id, episode.instruction)
        return cls(*names, robot, controller, actions)


@dataclass(frozen=True)
class ModelUse:
    """How much of a model behind a server a policy may use, and where its answers are kept.

    Attributes:
        cache: folder of answers, and of the count of what was used.
        max_tokens: that may be used in all; 0 = any.
        max_cost: that may be spent in all, see `LlmSettings`; 0 = any.
    """

    cache: Path = Path("llm_cache")
    max_tokens: int = 0
    max_cost: float = 0.0


class Policy(Protocol):
    """Chooses one action after another.

    A policy may have a list `said`: texts in it are taken out after each action and kept among the
    rollout's events. Its counts `unclear` and `left_out`, see `Labeller`, go to the results. One
    with a true `wants_lens` or `wants_labels` gets those fields of
    `Observation`.

    Attributes:
        blind: it uses no images, so none need to be rendered.
    """

    blind: bool

    def reset(self, assignment: Assignment) -> None:
        """Begin an episode."""
        ...

    def act(self, observation: Observation) -> Any:
        """Return the next action: 0–3 or a name, see `checked_action`.

        Where the assignment asks for velocities or waypoints, numbers: see `checked_motion`.
        """
        ...


class Stop:
    """Stops at once: what standing still is worth."""

    blind = True

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        return Action.STOP


class Forward:
    """Walks straight ahead for `steps` actions, then stops; 37 in VLN-CE's hand-crafted agent."""

    blind = True

    def __init__(self, steps: int = 37) -> None:
        self._steps = steps

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        return Action.FORWARD if observation.step < self._steps else Action.STOP


class Random:
    """Draws actions in the proportions of R2R's training paths in VLN-CE.

    68 % FORWARD, 15 % LEFT, 15 % RIGHT, 2 % STOP: Krantz et al., "Beyond the Nav-Graph", ECCV 2020.
    """

    blind = True
    actions = (Action.FORWARD, Action.LEFT, Action.RIGHT, Action.STOP)
    proportions = (0.68, 0.15, 0.15, 0.02)

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._rng = np.random.default_rng(seed)

    def reset(self, assignment: Assignment) -> None:
        """Draw as the seed and the episode's id say, whatever ran before."""
        text = f"{self._seed}/{assignment.scene_id}/{assignment.episode_id}".encode()
        self._rng = np.random.default_rng(np.frombuffer(sha256(text).digest(), dtype=np.uint32))

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        return self.actions[self._rng.choice(len(self.actions), p=self.proportions)]


ORACLE = "oracle"
VLM = "vlm"  # a vision-language model; the environment says where
MAP = "map"  # an online semantic map; labels are the renderer's
MAP_LLM = "map-llm"  # the same with sub-goals by a language model; the environment says where
MAP_VLM = "map-vlm"  # the same with labels by a vision-language model
MAP_VLM_LLM = "map-vlm-llm"  # both
MAPS = (MAP, MAP_LLM, MAP_VLM, MAP_VLM_LLM)
MODEL_POLICIES = (VLM, MAP_LLM, MAP_VLM, MAP_VLM_LLM)
SERVER_SCHEMES = ("ws://", "wss://")
CHECKPOINT_SUFFIX = ".safetensors"
# By name, made from the seed. The oracle is not among them: it is the expert, which knows the path.
POLICIES: dict[str, Callable[[int], Policy]] = {
    "stop": lambda seed: Stop(),
    "forward": lambda seed: Forward(),
    "random": Random,
    MAP: lambda seed: _map(),
}


def valid_policies() -> list[str]:
    """Return what `check_policy` takes."""
    checkpoint = f"a checkpoint of `vlnpe train` (FILE{CHECKPOINT_SUFFIX})"
    return [*POLICIES, *MODEL_POLICIES, ORACLE, *shipped_policies(), checkpoint, "ws://HOST:PORT"]


def shipped_policies() -> dict[str, Path]:
    """Return the checkpoints that come with vlnpe, by name."""
    folder = Path(__file__).resolve().parents[1] / "learning" / "policies"
    return {path.stem: path for path in sorted(folder.glob(f"*{CHECKPOINT_SUFFIX}"))}


def checkpoint_path(name: str) -> Path | None:
    """Return the file of a learned policy, or None if `name` is that of another policy.

    Raises:
        InputError: there is no such file.
    """
    if name in shipped_policies():
        return shipped_policies()[name]
    if not name.endswith(CHECKPOINT_SUFFIX):
        return None
    path = Path(name).resolve()
    for part in (path, path.with_suffix(".json")):
        if not part.is_file():
            raise InputError(
                f"{part}: no such file. `vlnpe train` writes a checkpoint as two files, "
                f"NAME{CHECKPOINT_SUFFIX} and NAME.json; valid: {', '.join(valid_policies())}"
            )
    return path


def check_policy(name: str) -> None:
    """Raise unless `name` is that of a policy or the address of a policy server.

    Raises:
        UnknownNameError: it is neither; the message lists the valid names.
    """
    if checkpoint_path(name) is not None or name.startswith(SERVER_SCHEMES):
        return
    if name not in (*POLICIES, *MODEL_POLICIES, ORACLE):
        raise UnknownNameError("policy", name, valid_policies())


def policy_identity(name: str, timeout_s: float, use: ModelUse | None = None) -> str:
    """Return a text that identifies a policy: results are reused for the same policy only.

    For a policy server it is the `version` that the server states; without one nothing is reused.

    Raises:
        InputError: the server cannot be reached, its client's libraries are missing, or the
            environment does not say where the model is, or a limit in `use` is invalid.
    """
    if name in MODEL_POLICIES:
        from .llm.policies import model_identity

        return model_identity(name, use or ModelUse())
    if (path := checkpoint_path(name)) is not None:
        if find_spec("torch") is None:
            raise MissingExtraError(f"{path.name}: a learned policy", "train")
        card = file_digest(path.with_suffix(".json"))
        return f"{path.stem} {file_digest(path)} {card}"
    if not name.startswith(SERVER_SCHEMES):
        return name
    server = _server(name, timeout_s)
    try:
        server.connect()
    except PolicyError as error:
        raise InputError(str(error)) from error
    server.close()
    return f"{name} {server.version or uuid4().hex}"


def make_policy(name: str, seed: int, timeout_s: float, use: ModelUse | None = None) -> Policy:
    """Return a policy by name, or a client of the policy server at that address.

    Args:
        name: key of `POLICIES`, name or file of a checkpoint, or `ws://host:port`.
        seed: of policies that draw.
        timeout_s: how long a server may take for one action.
        use: limits of a model behind an OpenAI-compatible server, and its answers' folder.

    Raises:
        UnknownNameError: there is no such policy.
        InputError: it is the oracle, which is no policy, the server's libraries are missing, or the
            environment does not say where the model is.
    """
    check_policy(name)
    if name == ORACLE:
        raise InputError("the oracle knows the path and is run by the replay itself")
    if name in MODEL_POLICIES:
        from .llm.policies import make_model_policy

        return make_model_policy(name, use or ModelUse())
    if (path := checkpoint_path(name)) is not None:
        return _learned(path, seed)
    if name.startswith(SERVER_SCHEMES):
        return _server(name, timeout_s)
    return POLICIES[name](seed)


def _server(url: str, timeout_s: float) -> RemotePolicy:
    try:
        from .remote import RemotePolicy
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"{url}: a policy server", "evaluate") from error
    return RemotePolicy(url, timeout_s)


def _learned(path: Path, seed: int) -> LearnedPolicy:
    try:
        from ..learning.stepper import Choice
        from .learned import LearnedPolicy
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"{path.name}: a learned policy", "train") from error
    return LearnedPolicy.load(path, Choice(seed=seed))


def _map() -> MapPolicy:
    from .map_policy.policy import MapPolicy

    return MapPolicy()

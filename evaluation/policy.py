"""The protocol of policies, which choose actions from observations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ..formats.core.episode import Episode
from ..formats.core.errors import VlnpeError
from ..instruction_gen.llm.settings import CACHE_NAME
from .observation import Observation


class PolicyError(VlnpeError):
    """A policy gave no valid action in time: it was late or wrong, or its server is gone."""


@dataclass(frozen=True)
class Assignment:
    """The facts that a policy gets when an episode starts: neither the goal nor the path.

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
    """Limits of a model behind a server, and the folder of its answers.

    Attributes:
        cache: folder of answers, and of the count of what was used.
        max_tokens: that may be used in all; 0 = any.
        max_cost: that may be spent in all, see `LlmSettings`; 0 = any.
    """

    cache: Path = Path(CACHE_NAME)
    max_tokens: int = 0
    max_cost: float = 0.0


class Policy(Protocol):
    """Chooses one action after another.

    A policy may have a list `said`: texts in it are taken out after each action and kept among the
    rollout's events. Its counts `unclear` and `left_out`, see `Labeller`, go to the results. One
    with a true `wants_lens` or `wants_labels` gets those fields of
    `Observation`. One with a side `reads_px` shrinks what it sees to a square of that side, and
    gets pictures drawn no larger than that needs; see `Renderer.render_for`.

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

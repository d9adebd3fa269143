"""The heads of the models that choose discrete actions."""

from torch import Tensor, nn

from ...datasets.sequences import ACTIONS

FUTURE = 8  # poses ahead
PREVIOUS_WIDTH = 32  # of the embedded previous action


class PreviousAction(nn.Embedding):
    """Embedding of the action before: 0 before the first one, else 1 + the action."""

    def __init__(self) -> None:
        super().__init__(ACTIONS + 1, PREVIOUS_WIDTH)


class Heads(nn.Module):
    """Action, waypoints, whether the end is near, and progress, from a recurrent state."""

    def __init__(self, hidden: int):
        """Build them for states of `hidden` numbers."""
        super().__init__()
        self.act = nn.Linear(hidden, ACTIONS)
        self.walk = nn.Linear(hidden, FUTURE * 3)
        self.end = nn.Linear(hidden, 2)

    def forward(self, state: Tensor) -> dict[str, Tensor]:
        """Predict from states (B, T, H).

        Returns:
            `action` (B, T, 4) logits, `waypoints` (B, T, 8, 3) [m, m, rad], `stop` (B, T) logit,
            `progress` (B, T).
        """
        end = self.end(state)
        return {
            "action": self.act(state),
            "waypoints": self.walk(state).unflatten(-1, (FUTURE, 3)),
            "stop": end[..., 0],
            "progress": end[..., 1],
        }

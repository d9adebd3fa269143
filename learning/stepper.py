"""A model in closed loop: one observation in, one action out, the recurrent state kept."""

import hashlib
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ..formats.core.arrays import F32, U8, Array
from ..formats.core.errors import InputError
from ..formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from ..formats.rendered.discrete_steps import discrete_steps
from .checkpoint import Checkpoint
from .images import depth_input, rgb_input
from .language import encode_text, language_of
from .models.cma import Memory
from .models.rdp import EXECUTED, PAST, STOP_PROGRESS, Rdp, seen_from, still
from .models.registry import Model
from .models.senses import Read
from .pretrained import encoder_of


@dataclass(frozen=True)
class Sight:
    """One step's observation.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) float32 planar z [m], 0 = invalid.
        previous_action: the action before, −1 at the first step.
        pose: (3,) x, y [m], yaw [rad] relative to the first step's pose.
    """

    rgb: U8
    depth_m: F32
    previous_action: int
    pose: Array


@dataclass(frozen=True)
class Choice:
    """Choice of actions from a model's predictions.

    Attributes:
        sample: draw from the predicted probabilities instead of taking the likeliest action.
        seed: seed of the draws, and of a diffusion policy's noise.
    """

    sample: bool = False
    seed: int = 0


LIKELIEST = Choice()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Compute in one thread of torch, and leave its number as it was.

    A compact model's step takes a millisecond; threads that wait for each other beside the
    physics and the drawing take it many times as long.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class _Advance(nn.Module):
    """A model's `advance` as a module, the one form that PyTorch traces."""

    def __init__(self, model: Model):
        super().__init__()
        self.model = model

    def forward(
        self, read: tuple[Tensor, ...], batch: Mapping[str, Tensor], memory: Memory
    ) -> tuple[dict[str, Tensor], Memory]:
        return self.model.advance(Read(*read), batch, memory)


def _traced(model: Model, arguments: tuple[Any, ...]) -> Any:
    """Return a function like `advance` for single steps: half the time, the same numbers.

    Instructions may have other lengths than the one among `arguments`.
    """
    with warnings.catch_warnings():
        # It warns of sizes that Python looks at; those of the recurrent layers never change.
        warnings.simplefilter("ignore")
        return torch.jit.trace(_Advance(model), arguments, strict=False, check_trace=False)


class Stepper:
    """Lets a checkpoint's model act."""

    def __init__(self, checkpoint: Checkpoint, choice: Choice = LIKELIEST):
        """Prepare the model; `begin` starts an episode.

        Raises:
            InputError: A diffusion policy is to be sampled by `choice`; it always is. A pretrained
                encoder that the model needs is not here.
        """
        if choice.sample and isinstance(checkpoint.model, Rdp):
            raise InputError("sample: a diffusion policy always draws; only its seed can be chosen")
        self._checkpoint, self._choice = checkpoint, choice
        self._encoder = encoder_of(checkpoint.card)
        self._language = language_of(checkpoint.card)
        self._read: Read | None = None
        self._traced: Any = None

    @property
    def reads_px(self) -> int | None:
        """The side to which it shrinks images; None where RGB and depth have different ones."""
        size = self._checkpoint.card.config.size_px
        return size if self._encoder is None or self._encoder.size_px == size else None

    @torch.inference_mode()
    def begin(self, instruction: str, name: str) -> None:
        """Begin an episode; `name` and the seed determine its draws."""
        with _one_thread():
            tokens = encode_text(instruction, self._checkpoint.card.tokens, self._language)
        self._read = self._checkpoint.model.reader(tokens[None])
        self._memory: Memory | None = None
        self._poses: list[Array] = []
        self._plan: list[Action] = []
        digest = hashlib.blake2b(f"{self._choice.seed}/{name}".encode(), digest_size=7).digest()
        self._rng = torch.Generator().manual_seed(int.from_bytes(digest))

    @torch.inference_mode()
    def predict(self, sight: Sight) -> dict[str, Tensor]:
        """Take in one observation and return the model's predictions for it, (1, 1, …)."""
        if self._read is None:
            raise RuntimeError("begin() comes before predict()")
        card = self._checkpoint.card
        size = card.config.size_px
        self._poses.append(np.asarray(sight.pose, np.float64))
        batch = {
            "rgb": self._rgb(sight.rgb)[None, None],
            "depth": depth_input(sight.depth_m, size, card.view.depth_far_m)[None, None],
            "previous_action": torch.tensor([[sight.previous_action + 1]]),
            "mask": torch.ones(1, 1, dtype=torch.bool),
            "pose": _floats(self._poses[-1])[None, None],
        }
        model = self._checkpoint.model
        if isinstance(model, Rdp):
            batch["past"] = self._past()[None, None]
        small = self._encoder is not None or card.config.model.encoder == "compact"
        with _one_thread() if small else nullcontext():
            if self._memory is None or isinstance(model, Rdp):
                predicted, self._memory = model.advance(self._read, batch, self._memory)
            else:
                arguments = tuple(self._read), batch, self._memory
                self._traced = self._traced or _traced(model, arguments)
                predicted, self._memory = self._traced(*arguments)
        return predicted

    def _rgb(self, rgb: U8) -> Tensor:
        """Return an image (3, size, size), or a pretrained encoder's features of it (C, 4, 4)."""
        if self._encoder is None:
            return rgb_input(rgb, self._checkpoint.card.config.size_px)
        with _one_thread():
            return self._encoder.features(rgb_input(rgb, self._encoder.size_px)[None])[0]

    @torch.inference_mode()
    def act(self, sight: Sight) -> Action:
        """Take in one observation and return the action to take."""
        predicted = self.predict(sight)
        if isinstance(self._checkpoint.model, Rdp):
            return self._follow(self._checkpoint.model, predicted)
        logits = predicted["action"][0, 0]
        if self._choice.sample:
            drawn = torch.multinomial(logits.softmax(-1), 1, generator=self._rng)
            return Action(int(drawn))
        return Action(int(logits.argmax()))

    def _follow(self, model: Rdp, predicted: dict[str, Tensor]) -> Action:
        """Carry out the plan; make a new one every `EXECUTED` steps; stop as the paper does."""
        if float(predicted["progress"]) > STOP_PROGRESS:
            return Action.STOP
        if not self._plan:
            motions = model.sample(predicted["condition"][0], self._rng)
            if still(motions)[0]:
                return Action.STOP
            self._plan = discrete_plan(motions[0].numpy())
        return self._plan.pop(0)

    def _past(self) -> Tensor:
        """Return the last poses (PAST, 3), seen from the present one.

        Those before the start are the first pose.
        """
        last = len(self._poses) - 1
        before = [self._poses[max(last - k, 0)] for k in range(1, PAST + 1)]
        return seen_from(_floats(np.stack(before)), _floats(self._poses[-1]))


def discrete_plan(motions: F32) -> list[Action]:
    """Return at most `EXECUTED` discrete actions that follow predicted motions (8, 3).

    A predicted step is one of the discrete actions with an error; the search of
    `formats.rendered.discrete_steps` finds the sequence that stays closest to all of them.
    """
    pose: Array = np.zeros(3)
    poses: list[Array] = [pose]
    for x, y, turn in motions.astype(np.float64):
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        pose = pose + np.array([cos * x - sin * y, sin * x + cos * y, turn])
        poses.append(pose)
    actions = [Action(int(a)) for a in discrete_steps(np.stack(poses)).action[:-1]]
    # Less than half an action is none: whatever the plan comes nearest to.
    return actions[:EXECUTED] or [_nearest(poses[-1])]


def _nearest(pose: Array) -> Action:
    if abs(pose[2]) / TURN_STEP_RAD > np.hypot(pose[0], pose[1]) / FORWARD_STEP_M:
        return Action.LEFT if pose[2] > 0 else Action.RIGHT
    return Action.FORWARD


def _floats(values: Array) -> Tensor:
    return torch.from_numpy(np.asarray(values, np.float32))

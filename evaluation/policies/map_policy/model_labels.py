"""Labels of images by a vision-language model behind an OpenAI-compatible server.

The model names things and gives their boxes; `SeenMap` finds by depth what in a box is the thing.
Walls come from depth alone. The model's answers are data: a name that is no noun of the
lexicon, or a box without a surface, is counted and left out, and nothing is guessed in its place.
"""

import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ....formats.core.frames import wrap_angle
from ....formats.core.images import image_file
from ....instruction_gen.language.nouns import noun_of
from ....instruction_gen.llm.brief import prompt
from ....instruction_gen.llm.client import Backend, Client, ModelError, openai_backend
from ....instruction_gen.llm.settings import LlmSettings
from ....instruction_gen.llm.sight import Sight, Sights, box_pixels, sight_messages
from ...observation import Observation
from ...policy import PolicyError
from ..llm.ask import UNCLEAR, model_version
from .labels import SILENT, STRUCTURE
from .seen_map import FARTHEST_M, Detection

PROMPT = "sight"
# An image is labelled when the robot has turned or moved so far since the last one: with 90° of
# view each direction of a full turn is seen twice.
_TURNED_RAD, _MOVED_M = math.radians(40.0), 0.7
_SMALLEST = 12  # pixels with a surface


def label_settings(settings: LlmSettings) -> LlmSettings:
    """Return settings for labels: the likeliest ones, and a server may fail for one episode only.

    A client gives its server up for good after `failures` requests that failed; here
    `ModelLabeller` gives up the episode, and the next one tries again.
    """
    return replace(settings, temperature=0.0, failures=sys.maxsize)


def labels_version(settings: LlmSettings) -> str:
    """Return a text that identifies the model and its prompt; see `model_version`."""
    return model_version(label_settings(settings), prompt(PROMPT).encode())


class ModelLabeller:
    """Asks a model what is in an image, wherever the robot has turned or moved enough.

    Answers are cached by the request. One that is no list of names and boxes is asked for again, up
    to `settings.attempts` times; then the image stays without labels. After three such images in a
    row the episode is given up.

    Attributes:
        unclear: number of answers in this episode that could not be used.
        left_out: number of things in its other answers that have no known name, or no surface.
    """

    def __init__(
        self,
        settings: LlmSettings,
        cache: Path,
        backend: Backend | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Get ready; nothing is sent yet.

        Args:
            cache: folder of its answers, and of the count of what was used.
            backend: sends one request; by default the OpenAI SDK.
            sleep: waits [s].
        """
        settings = label_settings(settings)
        backend = backend or openai_backend(settings, form=Sights)
        self._client = Client(settings, cache, backend, sleep)
        self.reset()

    def reset(self) -> None:
        """See `Labeller.reset`."""
        self.left_out, self._failed = 0, 0
        self._unclear_before = self._client.unusable
        self._labelled: NDArray[np.float64] | None = None

    @property
    def unclear(self) -> int:
        """See the class."""
        return self._client.unusable - self._unclear_before

    def detect(self, observation: Observation) -> Sequence[Detection]:
        """See `Labeller.detect`."""
        if not self._is_due(observation.pose):
            return []
        self._labelled = observation.pose
        try:
            png = image_file(Image.fromarray(observation.rgb), "PNG")
            answer = self._client.ask_for(sight_messages(png), Sights)
        except ModelError as error:
            self._failed += 1
            if self._failed >= UNCLEAR:
                model = self._client.settings.model
                what = f"{model} gave no usable labels for {UNCLEAR} images in a row"
                raise PolicyError(f"{what}: {error}") from error
            return []
        self._failed = 0
        detections = [_detection(sight, observation.depth_m) for sight in answer.things]
        self.left_out += detections.count(None)
        return [detection for detection in detections if detection is not None]

    def _is_due(self, pose: NDArray[np.float64]) -> bool:
        before = self._labelled
        if before is None:
            return True
        turned = abs(float(wrap_angle(pose[2] - before[2])))
        return turned >= _TURNED_RAD or float(np.linalg.norm((pose - before)[:2])) >= _MOVED_M


def _detection(sight: Sight, depth_m: NDArray[np.float32]) -> Detection | None:
    """Return a named box as pixels with a surface; None without a known name, or any surface."""
    noun = noun_of(sight.name)
    pixels = np.zeros(depth_m.shape, bool)
    pixels[box_pixels(sight, depth_m.shape)] = True
    pixels &= (depth_m > 0.0) & (depth_m < FARTHEST_M)
    if not noun or noun in SILENT | STRUCTURE or pixels.sum() < _SMALLEST:
        return None
    return Detection(noun, None, pixels)

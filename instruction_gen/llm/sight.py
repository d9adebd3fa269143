"""Names of things by a vision-language model, for scans without labels; `rooms.py` has rooms.

A model gets frames of the robot's camera, one at a time, and answers with boxes in the image; the
depth image says where they are. Its names are data like any label: one that is no noun of the
lexicon names nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from ...formats.core.images import data_uri
from ...formats.scene.bundle import LabeledObject
from ..language.nouns import noun_of
from .brief import prompt
from .client import Client, ModelDownError, ModelError

_MIN_POINTS = 12
_TRIM = (10.0, 90.0)  # percentiles of a box's points: edges see what is behind
_SAME_M = 0.8  # two sights of one kind, this near to each other, are one thing
_MIN_SIGHTS = 2


class Sight(BaseModel):
    """One thing in a frame; its box is in pixels: left, top, right, bottom."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    name: str = Field(max_length=40)
    box: tuple[float, float, float, float]


class Sights(BaseModel):
    """All things in a frame."""

    model_config = ConfigDict(extra="ignore")

    things: list[Sight] = Field(max_length=40)


@dataclass(frozen=True)
class View:
    """A frame to look at.

    Attributes:
        points_m: (H, W, 3) where each pixel's surface is in the world [m]; NaN = unknown.
        eye_m: (3,) where the camera is [m].
        level: of the floor under it.
    """

    png: bytes
    points_m: NDArray[np.float64]
    eye_m: NDArray[np.float64]
    level: int


@dataclass(frozen=True)
class Tally:
    """What became of the frames that a model was asked about.

    Attributes:
        unanswered: frames without a usable answer.
        unknown: names in the other answers that are in no table of the lexicon.
    """

    frames: int = 0
    unanswered: int = 0
    unknown: int = 0


def name_things(client: Client, views: Sequence[View]) -> tuple[list[LabeledObject], Tally]:
    """Return objects that a model sees in at least two frames, as boxes in the world.

    A frame that the model gives no usable answer to is left out. The client's backend asks for
    `Sights`: `openai_backend(settings, form=Sights)`.

    Raises:
        ModelDownError: the model fails again and again.
        BudgetError: no more may be spent.
    """
    found: list[tuple[str, int, NDArray[np.float64]]] = []
    unanswered = unknown = 0
    for view in views:
        answer = answer_to(client, view.png, Sights)
        unanswered += answer is None
        for sight in answer.things if answer else ():
            noun = noun_of(sight.name)
            unknown += not noun
            box = _box_m(sight, view.points_m)
            if noun and box is not None:
                found.append((noun, view.level, box))
    return _merged(found), Tally(len(views), unanswered, unknown)


def answer_to[Form: BaseModel](
    client: Client, png: bytes, form: type[Form], name: str = "sight"
) -> Form | None:
    """Return what a model says about a picture, None when it gives no usable answer.

    Args:
        client: asks for `form`.
        png: the picture.
        form: of the answer.
        name: of the prompt.

    Raises:
        ModelDownError: the model fails again and again.
        BudgetError: no more may be spent.
    """
    try:
        return client.ask_for(sight_messages(png, name), form)
    except ModelDownError:
        raise
    except ModelError:
        return None


def sight_messages(png: bytes, name: str = "sight") -> list[dict[str, Any]]:
    """Return a prompt's request about a picture; the answer to `sight` is `Sights`."""
    picture = {"type": "image_url", "image_url": {"url": data_uri(png, "image/png")}}
    return [{"role": "system", "content": prompt(name)}, {"role": "user", "content": [picture]}]


def box_pixels(sight: Sight, shape: Sequence[int]) -> tuple[slice, slice]:
    """Return rows and columns of a thing's box in an image of `shape` (H, W, …); may be empty."""
    high, wide = shape[:2]
    left, top, right, bottom = sight.box
    rows = slice(int(np.clip(top, 0, high)), int(np.clip(bottom, 0, high)))
    columns = slice(int(np.clip(left, 0, wide)), int(np.clip(right, 0, wide)))
    return rows, columns


def _box_m(sight: Sight, points_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the corners (2, 3) [m] of what a box in the image shows; None when that is nothing."""
    rows, columns = box_pixels(sight, points_m.shape)
    points = points_m[rows, columns].reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < _MIN_POINTS:
        return None
    return np.percentile(points, _TRIM, axis=0)


def _merged(found: Sequence[tuple[str, int, NDArray[np.float64]]]) -> list[LabeledObject]:
    groups: list[tuple[str, int, list[NDArray[np.float64]]]] = []
    for noun, level, box in found:
        for name, where, boxes in groups:
            near = np.linalg.norm(box.mean(axis=0) - np.mean(boxes, axis=(0, 1))) <= _SAME_M
            if name == noun and where == level and near:
                boxes.append(box)
                break
        else:
            groups.append((noun, level, [box]))
    result = []
    for noun, level, boxes in groups:
        if len(boxes) < _MIN_SIGHTS:
            continue
        low, high = np.median(boxes, axis=0)
        name = f"seen-{len(result) + 1}"
        result.append(LabeledObject(name, noun, tuple(low.tolist()), tuple(high.tolist()), level))
    return result

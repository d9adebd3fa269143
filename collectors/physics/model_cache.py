"""Compiled models on disk: verified when read, rebuilt when damaged."""

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from ...formats.core.atomic import atomic_file

log = logging.getLogger(__name__)

_DIGEST_BYTES = hashlib.sha256().digest_size


def model_bytes(model: mujoco.MjModel) -> bytes:
    """Return a compiled model as MuJoCo stores it; equal models give equal bytes."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def cached_model(path: Path, build: Callable[[], mujoco.MjModel]) -> mujoco.MjModel:
    """Return the model in `path`, or build it and keep it there.

    A damaged file is replaced. MuJoCo may crash on a damaged model, so a digest in front of the
    model is checked before it is read.
    """
    model = _read(path)
    if model is None:
        model = build()
        content = model_bytes(model)
        with atomic_file(path) as temporary:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
    return model


def _read(path: Path) -> mujoco.MjModel | None:
    if not path.is_file():
        return None
    stored = path.read_bytes()
    digest, content = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        log.warning("%s is damaged; the model is compiled again", path)
        return None
    return mujoco.MjModel.from_binary_path("model.mjb", assets={"model.mjb": content})

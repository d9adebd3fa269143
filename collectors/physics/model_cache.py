"""Compiled models on disk: verified when read, rebuilt when damaged."""

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from ...formats.core.atomic import write_bytes

log = logging.getLogger(__name__)


def model_bytes(model: mujoco.MjModel) -> bytes:
    """Return a compiled model as MuJoCo stores it; equal models give equal bytes."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def cached_model(path: Path, build: Callable[[], mujoco.MjModel]) -> mujoco.MjModel:
    """Return the model in `path`, or build it and keep it there.

    A damaged file is replaced. MuJoCo may crash on a damaged model, so the digest beside it, as
    `sha256sum` writes it, is checked before it is read.
    """
    model = _read(path)
    if model is None:
        model = build()
        content = model_bytes(model)
        write_bytes(_digest_path(path), _digest_line(path, content))
        write_bytes(path, content)
    return model


def _read(path: Path) -> mujoco.MjModel | None:
    if not path.is_file():
        return None
    content, beside = path.read_bytes(), _digest_path(path)
    if not beside.is_file() or beside.read_bytes() != _digest_line(path, content):
        log.warning("%s is damaged; the model is compiled again", path)
        return None
    return mujoco.MjModel.from_binary_path("model.mjb", assets={"model.mjb": content})


def _digest_path(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")


def _digest_line(path: Path, content: bytes) -> bytes:
    return f"{hashlib.sha256(content).hexdigest()}  {path.name}\n".encode()

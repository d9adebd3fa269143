"""Optional dependencies that a command line needs: what is missing is told at once."""

from collections.abc import Iterator
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..formats.core.errors import InputError, MissingExtraError
from .options.training import Ablate, Train
from .store.address import store_url

if TYPE_CHECKING:
    from ..learning.config import ModelConfig


class Need(NamedTuple):
    """What needs a module, as the start of a sentence, and the extra that installs it."""

    user: str
    extra: str
    module: str


# Of every call of a command.
COMMANDS = {
    "train": ("train", "torch"),
    "ablate": ("train", "torch"),
    "adapt": ("train", "torch"),
    "view": ("view", "viser"),
    "drive": ("view", "viser"),
    "serve": ("evaluate", "werkzeug"),
}
EXECUTORS = {"ray": "ray", "slurm": "submitit"}


def check_extras(command: str, options: Any) -> None:
    """Raise MissingExtraError, which names all extras that a call needs and lacks.

    What shows only once a file is open (a cloud of points, the bag of a robot, an ONNX policy) is
    not among them.
    """
    lacking = [need for need in _needs(command, options) if find_spec(need.module) is None]
    if lacking:
        users = dict.fromkeys(need.user for need in lacking)
        raise MissingExtraError(", ".join(users), *dict.fromkeys(need.extra for need in lacking))


def _needs(command: str, options: Any) -> Iterator[Need]:
    given = {field.name: getattr(options, field.name) for field in fields(options)}
    if command in COMMANDS:
        yield Need(f"vlnpe {command}", *COMMANDS[command])
    if (executor := given.get("executor")) in EXECUTORS:
        yield Need(f"--executor {executor}", "cluster", EXECUTORS[executor])
    for path in given.values():
        if isinstance(path, Path) and (url := store_url(path) or "").startswith(("s3:", "s3a:")):
            yield Need(url, "s3", "s3fs")
    if given.get("writer") == "llm":
        yield Need("--writer llm", "llm", "openai")
    if given.get("vision"):
        yield Need("--vision", "llm", "openai")
    if given.get("to") == "ros2":
        yield Need("--to ros2", "ros2", "rosbags")
    if command == "push" and given["yes"]:
        yield Need("publishing on the hub", "train", "huggingface_hub")
    if command in ("train", "ablate"):
        yield from _of_recipe(options)
    for policy in (*str(given.get("policy") or "").split(","), str(given.get("start") or "")):
        yield from _of_policy(policy.strip())


def _of_policy(name: str) -> Iterator[Need]:
    from ..evaluation.policies.names import (
        CHECKPOINT_SUFFIX,
        MODEL_POLICIES,
        SERVER_SCHEMES,
        shipped_policies,
    )

    if name in MODEL_POLICIES:
        yield Need(f"--policy {name}", "llm", "openai")
    elif name.startswith(SERVER_SCHEMES):
        http = not name.startswith("ws")
        yield Need(f"{name}: a policy server", "evaluate", "httpx2" if http else "websockets")
    elif name.endswith(CHECKPOINT_SUFFIX) or name in shipped_policies():
        from ..evaluation.policies.registry import resolve_policy
        from ..learning.card import read_card

        try:
            checkpoint = resolve_policy(name).checkpoint
            card = checkpoint and read_card(checkpoint)[0]
        except InputError:  # the command says what is wrong with it
            return
        if card:
            yield Need(f"{name}: a learned policy", "train", "torch")
            yield from _of_model(card.config.model)


def _of_recipe(options: Train | Ablate) -> Iterator[Need]:
    from ..datasets.mixture.recipe import read_recipe
    from ..datasets.mixture.shipped import recipe_path
    from ..learning.config import train_config

    try:
        recipe = read_recipe(recipe_path(options.recipe))
        if isinstance(options, Train):
            trained = [options.changes(recipe.train)]
        else:
            rows = recipe.comparison.rows.items() if recipe.comparison else ()
            chosen = options.chosen_rows or dict(rows)
            trained = [
                row.changes(recipe.train) for name, row in rows if row.mixture and name in chosen
            ]
        models = [train_config({**recipe.train, **changes}).model for changes in trained]
    except InputError:  # the command says what is wrong with it
        return
    for model in models:
        yield from _of_model(model)


def _of_model(model: "ModelConfig") -> Iterator[Need]:
    if model.frozen:
        yield Need(f"encoder {model.encoder}", "pretrained", "timm")
    if model.frozen_language:
        yield Need(f"language {model.language}", "pretrained", "tokenizers")

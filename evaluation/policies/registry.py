"""Resolve the name of a policy once to a value, which travels to the jobs that walk with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

from ...formats.core.atomic import file_digest
from ...formats.core.errors import InputError, MissingExtraError, UnknownNameError
from ..policy import ModelUse, Policy, PolicyError
from .baselines import Forward, Random, Stop
from .names import (
    CHECKPOINT_SUFFIX,
    HTTP_SCHEMES,
    MAP,
    MODEL_POLICIES,
    ORACLE,
    SERVER_FORMS,
    SERVER_SCHEMES,
    shipped_policies,
)

if TYPE_CHECKING:
    from ..http.client import HttpPolicy
    from .remote import RemotePolicy


def _map_policy(_seed: int) -> Policy:
    from .map_policy.policy import MapPolicy

    return MapPolicy()


# Functions that make a policy from a seed, by name.
POLICIES: dict[str, Callable[[int], Policy]] = {
    "stop": lambda seed: Stop(),
    "forward": lambda seed: Forward(),
    "random": Random,
    MAP: _map_policy,
}


@dataclass(frozen=True)
class PolicyChoice:
    """A policy that a user has chosen.

    Attributes:
        name: as the user gave it; for a policy server its address.
        checkpoint: file of a learned policy; None for all others.
        timeout_s: how long a policy server may take for one action.
        use: limits of a model behind an OpenAI-compatible server, and its answers' folder.
    """

    name: str
    checkpoint: Path | None = None
    timeout_s: float = 30.0
    use: ModelUse = field(default_factory=ModelUse)

    @property
    def is_server(self) -> bool:
        """True if the policy runs behind a policy server."""
        return self.name.startswith(SERVER_SCHEMES)

    def identity(self) -> str:
        """Return a text that identifies the policy: results are reused for the same policy only.

        For a policy server it is the `version` that the server states; without one nothing is
        reused.

        Raises:
            InputError: the server cannot be reached, its client's libraries are missing, the
                environment does not say where the model is, a limit in `use` is invalid, or a
                checkpoint is damaged.
        """
        if self.name in MODEL_POLICIES:
            from .model_policies import model_identity

            return model_identity(self.name, self.use)
        if (path := self.checkpoint) is not None:
            if find_spec("torch") is None:
                raise MissingExtraError(f"{path.name}: a learned policy", "train")
            from ...learning.card import read_card
            from ...learning.weights import at_hand

            card, sha256 = read_card(path)
            # Ours need no other look than at their bytes; PyTorch takes seconds to import.
            whole = path in shipped_policies().values() and file_digest(path) == sha256
            if not (whole and at_hand([card.encoder, card.language])):
                from ...learning.checkpoint import load_checkpoint
                from ...learning.language import language_of
                from ...learning.pretrained import encoder_of

                checkpoint = load_checkpoint(path)  # before any episode would fail on damage
                encoder_of(checkpoint.card)
                language_of(checkpoint.card)
            return f"{path.stem} {sha256} {file_digest(path.with_suffix('.json'))}"
        if not self.is_server:
            return self.name
        server = self._server()
        try:
            server.connect()
        except PolicyError as error:
            raise InputError(str(error)) from error
        server.close()
        return f"{self.name} {server.version or uuid4().hex}"

    def make(self, seed: int) -> Policy:
        """Return the policy, or a client of its server.

        Raises:
            InputError: it is the oracle, which is no policy, the server's libraries are missing, or
                the environment does not say where the model is.
        """
        if self.name == ORACLE:
            raise InputError("the oracle knows the path and is run by the replay itself")
        if self.name in MODEL_POLICIES:
            from .model_policies import make_model_policy

            return make_model_policy(self.name, self.use)
        if self.checkpoint is not None:
            return _learned(self.checkpoint, seed)
        return self._server() if self.is_server else POLICIES[self.name](seed)

    def _server(self) -> RemotePolicy | HttpPolicy:
        try:
            if self.name.startswith(HTTP_SCHEMES):
                from ..http.client import HttpPolicy

                return HttpPolicy(self.name, self.timeout_s)
            from .remote import RemotePolicy
        except ModuleNotFoundError as error:
            raise MissingExtraError(f"{self.name}: a policy server", "evaluate") from error
        return RemotePolicy(self.name, self.timeout_s)


def resolve_policy(name: str, timeout_s: float = PolicyChoice.timeout_s) -> PolicyChoice:
    """Return the policy with a name, in a checkpoint file, or at a server's address.

    Nothing is loaded, and no server is asked.

    Raises:
        UnknownNameError: there is none; the message lists the valid names.
        InputError: a checkpoint's file is missing.
    """
    if name in shipped_policies():
        return PolicyChoice(name, shipped_policies()[name])
    if name.endswith(CHECKPOINT_SUFFIX):
        return PolicyChoice(name, _checkpoint(Path(name).resolve()))
    if not name.startswith(SERVER_SCHEMES) and name not in (*POLICIES, *MODEL_POLICIES, ORACLE):
        raise UnknownNameError("policy", name, _valid_policies())
    return PolicyChoice(name, timeout_s=timeout_s)


def _valid_policies() -> list[str]:
    checkpoint = f"a checkpoint of `vlnpe train` (FILE{CHECKPOINT_SUFFIX})"
    return [*POLICIES, *MODEL_POLICIES, ORACLE, *shipped_policies(), checkpoint, *SERVER_FORMS]


def _checkpoint(path: Path) -> Path:
    for part in (path, path.with_suffix(".json")):
        if not part.is_file():
            raise InputError(
                f"{part}: no such file. `vlnpe train` writes a checkpoint as two files, "
                f"NAME{CHECKPOINT_SUFFIX} and NAME.json; valid: {', '.join(_valid_policies())}"
            )
    return path


def _learned(path: Path, seed: int) -> Policy:
    try:
        from ...learning.stepper import Choice
        from .learned import LearnedPolicy
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"{path.name}: a learned policy", "train") from error
    return LearnedPolicy.load(path, Choice(seed=seed))

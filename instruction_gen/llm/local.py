"""A small model on disk (GGUF) through llama-cpp-python, which the user installs.

It runs in a process of its own: what makes the library crash is an error here.
"""

import json
import signal
import subprocess
import sys
import tempfile
import weakref
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ...formats.core.checkout import install_command
from ...formats.core.errors import InputError
from ...formats.process.threads import available_cores
from .answers import answer_schema
from .budget import Usage
from .client import Backend, Messages, Reply, RetryableError
from .settings import LlmSettings

CONTEXT_TOKENS = 8192
TEXT_TOKENS = 1600  # that one text with its claims may have
# llama.cpp nests a rule this deep for a bound, and crashes on thousands.
LARGEST_BOUND = 64
_ERRORS = ("error loading model: ", "gguf_init_from", "GGML_ASSERT")  # in lines of its log
_BOUNDS = ("minLength", "maxLength", "minItems", "maxItems")


def local_backend(settings: LlmSettings, texts: int) -> Backend:
    """Return a backend that runs a model on half of the cores.

    A crash while it writes is a try that failed; the next one starts it again.

    Args:
        texts: how many instructions are wanted at most.

    Raises:
        InputError: llama-cpp-python is not installed, or cannot open the file.
    """
    if find_spec("llama_cpp") is None:
        raise InputError(
            f"--writer local needs llama-cpp-python: {install_command(['llama-cpp-python'])}; or "
            "serve the model with llama-server and use --writer llm"
        )
    model = _Model(settings.model)
    schema = grammar_schema(answer_schema(texts=texts)["schema"])

    def send(messages: Messages) -> Reply:
        done = model.ask(
            {
                "messages": list(messages),
                "temperature": settings.temperature,
                "max_tokens": TEXT_TOKENS * texts,
                "response_format": {"type": "json_object", "schema": schema},
            }
        )
        return Reply(done["content"], Usage(1, done["prompt_tokens"], done["completion_tokens"]))

    return send


def grammar_schema(schema: Any) -> Any:
    """Return a JSON Schema without large bounds; the answer is held to those once it is read."""
    if isinstance(schema, list):
        return [grammar_schema(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        name: grammar_schema(value)
        for name, value in schema.items()
        if not (name in _BOUNDS and isinstance(value, int) and value > LARGEST_BOUND)
    }


class _Model:
    """A model in a process of its own, see `local_model`."""

    def __init__(self, path: str):
        """Open a file.

        Raises:
            InputError: it cannot be opened.
        """
        with Path(path).open("rb") as file:
            if file.read(4) != b"GGUF":
                raise InputError(f"{path}: not a GGUF file")
        self._path = path
        self._start()

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the reply to a request.

        Raises:
            RetryableError: the library refused it, or crashed.
        """
        if self._process.poll() is not None:
            self._start()
        done = self._exchange(request)
        if "error" in done:
            raise RetryableError(f"llama-cpp-python: {done['error']}")
        return done

    def _start(self) -> None:
        opened = {"model_path": self._path, "n_ctx": CONTEXT_TOKENS, **_threads()}
        # A file never fills up, as a pipe that nobody reads does.
        self._log = tempfile.TemporaryFile("w+b")  # noqa: SIM115
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", f"{__package__}.local_model"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True,
        )  # fmt: skip
        weakref.finalize(self, _end, self._process)
        done = self._exchange(opened)
        if "error" in done:
            reason = self._reason() or done["error"]
            raise InputError(f"{self._path}: llama-cpp-python cannot open it ({reason})")

    def _exchange(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return what the process answers; `error` says why there is none."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass
        line = self._process.stdout.readline()
        return json.loads(line) if line else {"error": _crash(self._process.wait())}

    def _reason(self) -> str:
        """Return the first error that the library logged, in one line; "" without any."""
        self._log.seek(0)
        for line in self._log.read().decode(errors="replace").splitlines():
            if any(word in line for word in _ERRORS):
                return line.rpartition(_ERRORS[0])[2].strip()[:300]
        return ""


def _threads() -> dict[str, int]:
    """Return half of the cores, for prompts too; the library would take all of them for those."""
    half = max(1, available_cores() // 2)
    return {"n_threads": half, "n_threads_batch": half}


def _crash(status: int) -> str:
    if status < 0:
        return f"it crashed with {signal.Signals(-status).name}"
    return f"it ended with status {status}"


def _end(process: subprocess.Popen[str]) -> None:
    with process:
        process.kill()

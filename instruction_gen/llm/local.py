"""A small model on disk (GGUF) through llama-cpp-python, which the user installs."""

from typing import Any

from ...formats.core.checkout import install_command
from ...formats.core.errors import InputError
from .answers import answer_schema
from .budget import Usage
from .client import Backend, Messages, Reply
from .settings import LlmSettings

CONTEXT_TOKENS = 8192


def local_backend(settings: LlmSettings, texts: int) -> Backend:
    """Return a backend that runs a model in this process.

    Args:
        texts: how many instructions are wanted at most.

    Raises:
        InputError: llama-cpp-python is not installed, or cannot open the file.
    """
    try:
        import llama_cpp  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise InputError(
            f"--writer local needs llama-cpp-python: {install_command(['llama-cpp-python'])}; or "
            "serve the model with llama-server and use --writer llm"
        ) from error
    try:
        model: Any = llama_cpp.Llama(settings.model, n_ctx=CONTEXT_TOKENS, verbose=False)
    except Exception as error:
        raise InputError(f"{settings.model}: llama-cpp-python cannot open it ({error})") from error

    def send(messages: Messages) -> Reply:
        form = {"type": "json_object", "schema": answer_schema(texts=texts)["schema"]}
        done = model.create_chat_completion(
            messages=list(messages), temperature=settings.temperature, response_format=form
        )
        used = done.get("usage", {})
        usage = Usage(1, used.get("prompt_tokens", 0), used.get("completion_tokens", 0))
        return Reply(done["choices"][0]["message"]["content"] or "", usage)

    return send

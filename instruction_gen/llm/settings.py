"""Settings of a language model. The API key is not among them: it stays in the environment."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

from ...formats.core.errors import InputError, MissingExtraError

BASE_URL, API_KEY, MODEL = "VLNPE_LLM_BASE_URL", "VLNPE_LLM_API_KEY", "VLNPE_LLM_MODEL"
GGUF = "VLNPE_GGUF"
CACHE_NAME = "llm_cache"  # folder of a model's answers, which were paid for
TIMEOUT_S = "VLNPE_LLM_TIMEOUT_S"
PRICE_IN, PRICE_OUT = "VLNPE_LLM_PRICE_IN", "VLNPE_LLM_PRICE_OUT"


@dataclass(frozen=True)
class LlmSettings:
    """Where the model is, and how it is treated.

    Attributes:
        base_url: of an OpenAI-compatible server; "" for a local model.
        model: its name, or the path of a GGUF file.
        workers: requests at a time.
        timeout_s: of one request [s].
        attempts: tries of one request before it counts as failed.
        backoff_s: wait before the second try [s]; doubles with each.
        longest_wait_s: no wait is longer, whatever the server asks for [s].
        failures: requests that fail in a row before the writer gives up.
        max_tokens: that may be used in all; 0 = any.
        max_cost: that may be spent in all [the currency of the prices]; 0 = any.
        price_in, price_out: per million tokens; a server's own cost is believed first.
    """

    base_url: str = ""
    model: str = ""
    temperature: float = 0.7
    workers: int = 4
    timeout_s: float = 60.0
    attempts: int = 4
    backoff_s: float = 0.5
    longest_wait_s: float = 60.0
    failures: int = 5
    max_tokens: int = 0
    max_cost: float = 0.0
    price_in: float = 0.0
    price_out: float = 0.0


def settings_from(
    environment: Mapping[str, str] = os.environ,
    *,
    local: bool = False,
    asked_by: str = "--writer llm",
    max_tokens: int = 0,
    max_cost: float = 0.0,
) -> LlmSettings:
    """Read the settings from the environment.

    Args:
        environment: variables.
        local: a GGUF file instead of a server.
        asked_by: option that asks for a model, for the message.
        max_tokens: that may be used in all; 0 = any.
        max_cost: that may be spent in all; 0 = any.

    Raises:
        InputError: something is missing or cannot be used; the message names the variable.
        MissingExtraError: the library that asks servers is not installed.
    """
    if max_tokens < 0 or max_cost < 0:
        raise InputError(
            "--max-tokens and --max-cost must not be negative; valid: 0 (no limit) and above"
        )
    if local:
        path = environment.get(GGUF, "")
        if not path or not Path(path).is_file():
            raise InputError(f"--writer local needs {GGUF}=<a GGUF file on disk>; it is {path!r}")
        return LlmSettings(model=path, workers=1, max_tokens=max_tokens)
    if find_spec("openai") is None:
        raise MissingExtraError(asked_by, "llm")
    missing = [name for name in (BASE_URL, MODEL) if not environment.get(name)]
    if missing:
        raise InputError(f"{asked_by} needs {' and '.join(missing)} in the environment")
    url = environment[BASE_URL]
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise InputError(f"{BASE_URL}: not an http(s) address")
    if parts.username or parts.password or parts.query:
        raise InputError(f"{BASE_URL}: no user, password or query in it; the key goes to {API_KEY}")
    prices = [_number(environment, name, 0.0) for name in (PRICE_IN, PRICE_OUT)]
    timeout_s = _number(environment, TIMEOUT_S, LlmSettings.timeout_s)
    if timeout_s <= 0:
        raise InputError(f"{TIMEOUT_S}={environment[TIMEOUT_S]!r}: valid: seconds above 0")
    if max_cost and not any(prices):
        raise InputError(f"--max-cost needs {PRICE_IN} and {PRICE_OUT} (per million tokens)")
    return LlmSettings(
        base_url=url, model=environment[MODEL], timeout_s=timeout_s, max_tokens=max_tokens,
        max_cost=max_cost, price_in=prices[0], price_out=prices[1],
    )  # fmt: skip


def _number(environment: Mapping[str, str], name: str, default: float) -> float:
    try:
        return float(environment.get(name) or default)
    except ValueError as error:
        raise InputError(f"{name}={environment[name]!r}: not a number") from error

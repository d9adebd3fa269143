"""Replies of a model's server, which may be of any size, length and type: bounded and typed."""

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any

from .budget import Usage
from .settings import LlmSettings

if TYPE_CHECKING:
    import httpx2

MAX_REPLY_BYTES = 4 << 20  # an answer has 40,000 characters at most; some servers add thoughts
MAX_TOKENS = 10**9  # of one request
_CHARACTERS_PER_TOKEN = 3


class ReplyError(Exception):
    """A reply is too large, too slow, or of another type; the message is one short line."""


def bound_body(response: "httpx2.Response") -> None:
    """Let a response's body raise ReplyError beyond `MAX_REPLY_BYTES`; a hook of httpx2."""
    import httpx2

    # A few kilobytes may unpack to gigabytes; none of this was asked for.
    if response.headers.get("content-encoding", "identity") != "identity":
        raise ReplyError("the server's reply is compressed")
    body = response.stream
    assert isinstance(body, httpx2.SyncByteStream)

    class Bounded(httpx2.SyncByteStream):
        def __iter__(self) -> Iterator[bytes]:
            total = 0
            for part in body:
                total += len(part)
                if total > MAX_REPLY_BYTES:
                    raise ReplyError(f"the server's reply has more than {MAX_REPLY_BYTES:,} bytes")
                yield part

        def close(self) -> None:
            body.close()

    response.stream = Bounded()


def within[T](seconds: float, call: Callable[[], T]) -> T:
    """Return what `call` returns; the time-outs of sockets begin again with every byte.

    Raises:
        ReplyError: If it takes longer. It then goes on in its thread, which ends with the process.
    """
    result: Future[T] = Future()

    def work() -> None:
        try:
            result.set_result(call())
        except BaseException as error:
            result.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        return result.result(timeout=seconds)
    except TimeoutError as error:
        raise ReplyError(f"no answer within {seconds:g} s") from error


def content_of(completion: Any) -> str:
    """Return the text of a chat completion.

    Raises:
        ReplyError: If it has no text.
    """
    try:
        content = completion.choices[0].message.content
    except (AttributeError, IndexError, KeyError, TypeError) as error:
        raise ReplyError("the server's reply is no chat completion") from error
    if content is not None and not isinstance(content, str):
        raise ReplyError(f"the server's reply is {type(content).__name__}; valid: text")
    return content or ""


def usage_of(
    completion: Any, settings: LlmSettings, messages: Sequence[Mapping[str, Any]]
) -> Usage:
    """Return what a request used, as its server states it.

    Numbers of tokens that are missing or impossible are estimated from the texts, so that limits
    hold with any server.
    """
    usage = getattr(completion, "usage", None)

    def number(name: str) -> float | None:
        value: Any = getattr(usage, name, None)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        return float(value) if 0 <= value <= MAX_TOKENS else None

    def tokens(name: str, characters: int) -> int:
        stated = number(name)
        return math.ceil(characters / _CHARACTERS_PER_TOKEN if stated is None else stated)

    tokens_in = tokens("prompt_tokens", sum(len(_text(message)) for message in messages))
    tokens_out = tokens("completion_tokens", len(content_of(completion)))
    cost = number("cost")
    if cost is None:
        cost = (tokens_in * settings.price_in + tokens_out * settings.price_out) / 1e6
    return Usage(1, tokens_in, tokens_out, cost)


def retry_after(headers: Mapping[str, str]) -> float | None:
    """Return seconds to wait, from seconds or an HTTP date; None if the server does not say."""
    value = headers.get("retry-after", "")
    try:
        seconds = float(value)
    except ValueError:
        try:
            seconds = parsedate_to_datetime(value).timestamp() - time.time()
        except (TypeError, ValueError, OverflowError):
            return None
    return None if math.isnan(seconds) else max(0.0, seconds)


def _text(message: Mapping[str, Any]) -> str:
    """Return the words of a message; of images nothing is known."""
    content = message.get("content")
    if isinstance(content, str):
        return content
    return "".join(str(part.get("text", "")) for part in content or ())

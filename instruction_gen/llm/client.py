"""One request to a model: cached by content, retried, counted; the key appears nowhere."""

import hashlib
import json
import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ...formats.core.atomic import write_bytes
from ...formats.core.errors import InputError, VlnpeError
from .answers import Answer, AnswerError, answer_schema, read_answer
from .budget import Budget, Usage
from .reply import ReplyError, bound_body, content_of, retry_after, usage_of, within
from .settings import API_KEY, LlmSettings

Messages = Sequence[dict[str, Any]]

_SHORTEST_KEY = 8  # characters; a shorter value of the variable may occur in any text


class ModelError(VlnpeError):
    """All tries failed: the model was not reached, or gave no usable answer."""


class ModelDownError(ModelError):
    """Too many requests failed in a row."""


@dataclass(frozen=True)
class Reply:
    """What a backend returns."""

    content: str
    usage: Usage


class RetryableError(Exception):
    """A try failed in a way that may pass.

    Attributes:
        wait_s: how long the server asks to wait [s], None = it does not say.
    """

    def __init__(self, reason: str, wait_s: float | None = None):
        self.wait_s = wait_s
        super().__init__(reason)


Backend = Callable[[Messages], Reply]


class Client:
    """Asks a backend; safe to use from several threads.

    Attributes:
        unusable: number of answers so far that had another form, or none.
    """

    def __init__(
        self,
        settings: LlmSettings,
        cache: Path,
        backend: Backend | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ):
        """Get ready; nothing is sent yet.

        Args:
            cache: folder of answers and of the usage count.
            backend: sends one request; by default the OpenAI SDK.
            sleep: waits [s].
        """
        self.settings = settings
        self.budget = Budget(cache / "usage.json", settings)
        self._cache, self._sleep = cache, sleep
        self._backend = backend or openai_backend(settings)
        self._failed = 0
        self.unusable = 0
        self._lock = threading.Lock()

    def ask(self, messages: Messages) -> Answer:
        """Return the instructions that answer some messages; raises what `ask_for` raises."""
        return self.ask_for(messages, Answer)

    def ask_for[Form: BaseModel](self, messages: Messages, form: type[Form]) -> Form:
        """Return the answer to some messages, from the cache if it is there.

        Args:
            form: what the answer must be; the backend asks for it.

        Raises:
            ModelError: no usable answer after all tries.
            ModelDownError: so did too many requests in a row before.
            BudgetError: no more may be spent.
            InputError: the server refuses the request permanently (wrong key, unknown model, …).
        """
        path = self._cache / f"{self.key(messages, form)}.json"
        if path.is_file():
            try:
                return read_answer(json.loads(path.read_text())["content"], form)
            except (AnswerError, ValueError, KeyError):
                path.unlink(missing_ok=True)
        reason = ""
        for attempt in range(self.settings.attempts):
            self._check_up()
            self.budget.check()
            try:
                reply = self._backend(messages)
                answer = self._kept(path, reply, form)
            except RetryableError as error:
                reason = str(error)
                wait_to_retry(self.settings, attempt, error, self._sleep)
            except AnswerError as error:
                reason = str(error)
                with self._lock:
                    self.unusable += 1
            else:
                with self._lock:
                    self._failed = 0
                return answer
        with self._lock:
            self._failed += 1
        self._check_up(reason)
        raise ModelError(
            f"no usable answer in {self.settings.attempts} tries; the last error: {reason}"
        )

    def _kept[Form: BaseModel](self, path: Path, reply: Reply, form: type[Form]) -> Form:
        """Return the answer in a reply, cached before it is counted: a kill costs nothing twice.

        Raises:
            AnswerError: there is none; the reply is counted nevertheless.
        """
        try:
            key = os.environ.get(API_KEY, "")
            if len(key) >= _SHORTEST_KEY and key in reply.content:
                raise AnswerError("an answer that contains the API key")
            answer = read_answer(reply.content, form)
            record = {"content": reply.content, "usage": asdict(reply.usage)}
            write_bytes(path, json.dumps(record).encode())
        finally:
            self.budget.add(reply.usage)
        return answer

    def key(self, messages: Messages, form: type[BaseModel] = Answer) -> str:
        """Return what an answer is cached under."""
        model, heat = self.settings.model, self.settings.temperature
        parts = [model, heat, list(messages), answer_schema(form)]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def _check_up(self, reason: str = "") -> None:
        if self._failed >= self.settings.failures:
            last = f" The last error: {reason}." if reason else ""
            raise ModelDownError(
                f"{self._failed} requests to the language model failed in a row; giving "
                f"up.{last} Its answers are kept; run the same command to continue, or use "
                "--writer composer, which needs no server"
            )


def wait_to_retry(
    settings: LlmSettings, attempt: int, error: RetryableError, sleep: Callable[[float], None]
) -> None:
    """Wait before the next try, unless this was the last.

    Args:
        settings: number of tries, and how long to wait between them.
        attempt: number of the try that failed, from 0.
        error: its error, with the time that the server asks for, if any.
        sleep: waits [s].
    """
    if attempt + 1 >= settings.attempts:
        return
    wait_s = settings.backoff_s * 2**attempt if error.wait_s is None else error.wait_s
    sleep(min(wait_s, settings.longest_wait_s))


def openai_backend(
    settings: LlmSettings,
    *,
    structured: bool = True,
    form: type[BaseModel] = Answer,
    texts: int = 0,
) -> Backend:
    """Return requests through the OpenAI SDK; it reads the key from the environment and keeps it.

    Args:
        structured: ask for JSON, if the server can; else for text.
        form: of the JSON.
        texts: how many instructions are wanted at most, 0 = any number.
    """
    import openai

    sdk = openai.OpenAI(
        base_url=settings.base_url,
        api_key=os.environ.get(API_KEY) or "none",
        timeout=settings.timeout_s,
        max_retries=0,
        default_headers={"Accept-Encoding": "identity"},
        http_client=openai.DefaultHttpxClient(event_hooks={"response": [bound_body]}),
    )
    forms: list[dict[str, Any]] = [{}]
    if structured:
        schema = {"type": "json_schema", "json_schema": answer_schema(form, texts)}
        forms = [{"response_format": schema}, {"response_format": {"type": "json_object"}}, {}]

    def send(messages: Messages) -> Reply:
        def create() -> Any:
            return sdk.chat.completions.create(
                model=settings.model,
                messages=list(messages),  # type: ignore[arg-type]
                temperature=settings.temperature,
                **forms[0],
            )

        try:
            done = within(settings.timeout_s, create)
            return Reply(content_of(done), usage_of(done, settings, messages))
        except openai.APIStatusError as error:
            raise _status(error, forms) from None
        except ReplyError as error:
            raise RetryableError(str(error)) from None
        except openai.APITimeoutError:
            raise RetryableError(f"no answer within {settings.timeout_s:g} s") from None
        except openai.APIConnectionError as error:
            known = isinstance(error.__cause__, ReplyError)
            reason = str(error.__cause__) if known else "the connection failed or was cut"
            raise RetryableError(reason) from None
        except (openai.OpenAIError, ValueError, TypeError, AttributeError, RecursionError):
            raise RetryableError("the server's reply is no chat completion") from None

    return send


def _status(error: Any, forms: list[dict[str, Any]]) -> Exception:
    """Return what to raise for a bad status.

    Never the server's own words, which may repeat the key.
    """
    status = error.status_code
    if status in (408, 409, 429) or status >= 500:
        return RetryableError(f"status {status}", retry_after(error.response.headers))
    if status in (400, 422) and len(forms) > 1:
        forms.pop(0)  # a server without structured output
        return RetryableError(f"status {status}", 0.0)
    hints = {401: f"check {API_KEY}", 403: f"check {API_KEY}", 404: "check the address and model"}
    return InputError(
        f"the language model's server refuses: status {status} ({hints.get(status, 'bad request')})"
    )

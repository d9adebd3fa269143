"""An OpenAI-compatible server that misbehaves on request, over real HTTP."""

import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

# What a script returns: (status, headers, body), what to do with the connection, or a function of
# the connection's `write` and the event of the test's end.
HANG, CUT = "hang", "cut"


class Server:
    """Answers each request by `script(number, request)`.

    Attributes:
        url: base URL.
        requests: bodies received.
        most: most requests at a time.
    """

    def __init__(self, script: Callable[[int, dict[str, Any]], Any]):
        self.requests: list[dict[str, Any]] = []
        self.authorizations: list[str] = []
        self.most = 0
        self.release = threading.Event()
        busy = 0
        lock = threading.Lock()
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                nonlocal busy
                size = int(self.headers["Content-Length"])
                request = json.loads(self.rfile.read(size))
                with lock:
                    busy += 1
                    server.most = max(server.most, busy)
                    server.requests.append(request)
                    server.authorizations.append(self.headers.get("Authorization", ""))
                    number = len(server.requests)
                try:
                    self.answer(script(number, request))
                finally:
                    with lock:
                        busy -= 1

            def answer(self, what: Any) -> None:
                if what == HANG:
                    server.release.wait(20)
                    return
                if callable(what):
                    with contextlib.suppress(OSError):  # the client has left
                        what(self.wfile.write, server.release)
                    return
                status, headers, body = (200, {}, "") if what == CUT else what
                data = (body if isinstance(body, str) else json.dumps(body)).encode()
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name, value)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(500 if what == CUT else len(data)))
                self.end_headers()
                self.wfile.write(b'{"choices": [' if what == CUT else data)

            def log_message(self, format: str, *args: Any) -> None:
                pass

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._http.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._http.server_address[1]}/v1"
        self._thread = threading.Thread(target=self._http.serve_forever, daemon=True)

    @contextmanager
    def running(self) -> "Iterator[Server]":
        """Serve until the block ends."""
        self._thread.start()
        try:
            yield self
        finally:
            self.release.set()
            self._http.shutdown()
            self._http.server_close()


def completion(content: Any, tokens: int = 100) -> tuple[int, dict[str, str], dict[str, Any]]:
    """A good reply with some content, JSON unless it is text already."""
    text = content if isinstance(content, str) else json.dumps(content, ensure_ascii=False)
    body = {
        "id": "x",
        "object": "chat.completion",
        "created": 0,
        "model": "scripted",
        "choices": [
            {
                "index": 0,
                "finish_reason": "stop",
                "message": {"role": "assistant", "content": text},
            }
        ],
        "usage": {
            "prompt_tokens": tokens,
            "completion_tokens": tokens,
            "total_tokens": 2 * tokens,
        },
    }
    return 200, {}, body


def texts(*lines: str | list[dict[str, Any]]) -> dict[str, Any]:
    """Content with some instructions, each as a text or as steps with claims."""
    keys = ("text" if isinstance(line, str) else "steps" for line in lines)
    written = zip(keys, lines, strict=True)
    return {"instructions": [{"style": "natural", key: line} for key, line in written]}

"""Serve one of our policies as InternNav serves its models; see `wire`."""

import io
import json
import logging
import math
import threading
from contextlib import redirect_stderr
from typing import Any

import numpy as np
from werkzeug.exceptions import BadRequest, HTTPException
from werkzeug.serving import BaseWSGIServer, make_server
from werkzeug.wrappers import Request, Response

from ...formats.core.rollout import Action
from ..observation import NO_ACTION, Observation
from ..policy import Assignment, Policy
from .wire import PATH, images_in

log = logging.getLogger(__name__)

LARGEST_FORM_BYTES = 1 << 25


class DualServer:
    """Answers one robot after another; a reset begins an episode, whoever sends it."""

    def __init__(self, policy: Policy, instruction: str = "", *, needs_pose: bool = False) -> None:
        """Get ready.

        Args:
            instruction: the text to follow if a request has none, as InternNav's client's have.
            needs_pose: refuse requests without `pose`, which the policy uses.
        """
        self._policy, self._instruction, self._needs_pose = policy, instruction, needs_pose
        self._turn = threading.Lock()  # requests are answered one at a time
        self._previous, self._count = NO_ACTION, -1
        self._text = instruction

    def __call__(self, environ: dict[str, Any], start_response: Any) -> Any:
        """Answer one request (WSGI)."""
        request = Request(environ)
        request.max_content_length = LARGEST_FORM_BYTES
        try:
            reply, status = self._answer(request), 200
        except HTTPException as error:
            reply, status = {"error": error.description}, error.code or 500
        except Exception as error:  # a policy is foreign code
            log.exception("the policy failed")
            reply, status = {"error": f"{type(error).__name__}: {error}"}, 500
        body = Response(json.dumps(reply), status, mimetype="application/json")
        return body(environ, start_response)

    def _answer(self, request: Request) -> dict[str, Any]:
        if request.path != PATH:
            raise BadRequest(f"{request.path}; valid: POST {PATH}")
        if request.method != "POST":
            raise BadRequest(f"{request.method}; valid: POST")
        for name in ("image", "depth"):
            if name not in request.files:
                raise BadRequest(f"the form has no file {name}; valid: image, depth, and json")
        try:
            words = json.loads(request.form.get("json", ""))
            rgb, depth_m = images_in(*(request.files[n].read() for n in ("image", "depth")))
            if self._needs_pose and "pose" not in words:
                raise ValueError("no pose, which this policy needs: x, y [m], yaw [rad]")
            pose = np.array(words.get("pose", (0.0, 0.0, 0.0)), np.float64)
            if pose.shape != (3,) or not all(map(math.isfinite, pose)):
                raise ValueError("pose: valid are three numbers, x, y [m] and yaw [rad]")
            reset, text = words.get("reset", False), words.get("instruction", self._instruction)
            if type(reset) is not bool or not isinstance(text, str):
                raise ValueError("reset: valid are true and false; instruction: a text")
        except (ValueError, AttributeError, TypeError, RecursionError) as error:
            raise BadRequest(f"{error}") from error
        with self._turn:
            if reset or self._count < 0:
                self._begin(text)
            observation = Observation(
                rgb, depth_m, self._text, pose, np.zeros(0), self._previous, self._count
            )
            action = Action(int(self._policy.act(observation)))
            self._previous, self._count = int(action), self._count + 1
        return {"discrete_action": [int(action)]}

    def _begin(self, text: str) -> None:
        if not text:
            raise BadRequest("no instruction; valid: in json, or the server's --instruction")
        self._text, self._previous, self._count = text, NO_ACTION, 0
        self._policy.reset(Assignment("http", "robot", text, "robot", "robot"))


def listen(server: DualServer, host: str, port: int) -> BaseWSGIServer:
    """Return a server that listens; `serve_forever` runs it.

    Args:
        port: port to listen on; 0 takes a free one.

    Raises:
        OSError: the address is in use, or is not this machine's.
    """
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            return make_server(host, port, server, threaded=True)
    except SystemExit as ended:  # werkzeug says why and ends the process
        raise OSError(said.getvalue().partition("\n")[0]) from ended

"""The client of a model that is served as InternNav serves its own; see `wire`."""

import json
import math
from contextlib import suppress
from typing import Any, NoReturn

import httpx2
import numpy as np
from numpy.typing import NDArray

from ...formats.core.rollout import STEPS, Action
from ...instruction_gen.llm.reply import ReplyError, bound_body, within
from ..motions import DISCRETE, MOST_WAYPOINTS, WAYPOINTS
from ..observation import Observation
from ..policy import Assignment, PolicyError
from .wire import PATH, form_of

# InternNav's client plans again three times a second; this is what a robot walks meanwhile.
HORIZON_M = 0.5


class HttpPolicy:
    """Asks a model over HTTP; satisfies `Policy`.

    Where actions are discrete, a reply with several is carried out one by one before the next
    request. Where they are waypoints, both kinds of replies are: of a trajectory its first
    `HORIZON_M`.

    Attributes:
        version: always empty, since the form has none, so that results are not reused.
    """

    blind = False
    version = ""

    def __init__(self, url: str, timeout_s: float = 30.0) -> None:
        """Name the server.

        Args:
            url: `http://host:port`, with or without `/eval_dual`.
            timeout_s: how long one answer may take in all.
        """
        self.url = url.rstrip("/").removesuffix(PATH) + PATH
        self._timeout_s = timeout_s
        # Proxies of the environment are for the internet, not for a model.
        self._client = httpx2.Client(
            timeout=timeout_s, trust_env=False, event_hooks={"response": [bound_body]}
        )
        self._kind, self._first = DISCRETE, True
        self._plan: list[Action] = []

    def connect(self) -> None:
        """Raise if nothing listens at the address.

        Raises:
            PolicyError: the server cannot be reached.
        """
        try:
            self._client.get(self.url)  # any answer, such as 405, is one
        except (httpx2.HTTPError, httpx2.InvalidURL, ReplyError) as error:
            self._fail(f"cannot be reached ({type(error).__name__}: {error})", error)

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    def reset(self, assignment: Assignment) -> None:
        """Begin an episode; the first request of it says so to the server.

        Raises:
            PolicyError: velocities are asked for, which the form does not have.
        """
        if assignment.actions not in (DISCRETE, WAYPOINTS):
            self._fail(f"has no {assignment.actions} actions; valid: {DISCRETE}, {WAYPOINTS}")
        self._kind, self._first, self._plan = assignment.actions, True, []

    def act(self, observation: Observation) -> Action | NDArray[np.float64]:
        """Return the next action, or the next waypoints.

        Raises:
            PolicyError: the server fails, is late, or its reply is neither actions nor points.
        """
        if not self._plan:
            reply = self._reply(observation)
            if "discrete_action" in reply:
                self._plan = self._actions(reply["discrete_action"])
            elif "trajectory" not in reply:
                keys = ", ".join(sorted(map(str, reply)))
                self._fail(f"answered {keys or 'nothing':.200}; valid: discrete_action, trajectory")
            elif self._kind == DISCRETE:
                self._fail(f"answered a trajectory; carry it out with --actions {WAYPOINTS}")
            else:
                return self._waypoints(reply["trajectory"])
        if self._kind == DISCRETE:
            return self._plan.pop(0)
        plan, self._plan = self._plan, []
        steps = [STEPS[action] for action in plan[:MOST_WAYPOINTS] if action in STEPS]
        return np.array(steps) if steps else Action.STOP

    def _reply(self, observation: Observation) -> dict[str, Any]:
        words = {
            "reset": self._first,
            "idx": observation.step,
            "instruction": observation.instruction,
            "pose": observation.pose.tolist(),
        }
        files = form_of(observation.rgb, observation.depth_m)
        data = {"json": json.dumps(words)}
        try:
            response = within(
                self._timeout_s, lambda: self._client.post(self.url, files=files, data=data)
            )
        except httpx2.TimeoutException as error:
            self._fail(f"gave no answer within {self._timeout_s:g} s", error)
        except ReplyError as error:
            self._fail(str(error), error)
        except httpx2.HTTPError as error:
            self._fail(f"is gone ({type(error).__name__}: {error})", error)
        if response.status_code != httpx2.codes.OK:
            self._fail(f"answered HTTP {response.status_code}: {response.text:.300}")
        self._first = False
        try:
            reply = response.json()
        except (ValueError, RecursionError) as error:
            self._fail(f"answered no JSON: {response.text:.200}", error)
        if not isinstance(reply, dict):
            self._fail(f"answered {type(reply).__name__}; valid: an object")
        return reply

    def _actions(self, answer: Any) -> list[Action]:
        valid = isinstance(answer, list) and 0 < len(answer) <= MOST_WAYPOINTS
        if not valid or not all(type(n) is int and n in set(Action) for n in answer):
            names = ", ".join(f"{a.value} {a.name}" for a in Action)
            self._fail(f"answered discrete_action {answer!r:.200}; valid: a list of {names}")
        return [Action(n) for n in answer]

    def _waypoints(self, answer: Any) -> NDArray[np.float64]:
        """Return the first part of a trajectory as `checked_motion` takes waypoints, (K, 3)."""
        points: NDArray[np.float64] | None = None
        with suppress(TypeError, ValueError):
            points = np.asarray(answer, np.float64)
        if points is None or points.ndim != 2 or points.shape[1] < 2 or not _finite(points):
            self._fail(f"answered trajectory {answer!r:.200}; valid: finite points [x, y, …]")
        return steps_along(points[:, :2])

    def _fail(self, what: str, cause: BaseException | None = None) -> NoReturn:
        raise PolicyError(f"policy server {self.url} {what}") from cause


def _finite(points: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(points[:, :2]).all())


def steps_along(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the waypoints (K, 3) Δx, Δy [m], Δyaw [rad] that follow a trajectory's beginning.

    Each is seen from the one before and heads along the last segment. Points closer together than
    5 cm are passed over. A trajectory that goes nowhere gives one waypoint that stays.

    Args:
        points_m: (N, 2) x forward, y left [m], seen from the robot.
    """
    steps: list[tuple[float, float, float]] = []
    here, yaw, walked_m = np.zeros(2), 0.0, 0.0
    for point in points_m:
        ahead = point - here
        length_m = float(np.hypot(*ahead))
        if length_m < 0.05:
            continue
        if walked_m + length_m > HORIZON_M:
            ahead *= (HORIZON_M - walked_m) / length_m
            length_m = HORIZON_M - walked_m
        turn = math.remainder(math.atan2(ahead[1], ahead[0]) - yaw, math.tau)
        steps.append((length_m * math.cos(turn), length_m * math.sin(turn), turn))
        here, yaw, walked_m = here + ahead, yaw + turn, walked_m + length_m
        if walked_m >= HORIZON_M - 1e-9:
            break
    return np.array(steps or [(0.0, 0.0, 0.0)])

"""The train-free policy `map`, after VLN-PE's improved VLMaps."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ....collectors.robots import get_robot
from ....formats.core.frames import Array
from ....formats.core.rollout import STEPS, Action
from ...motions import DISCRETE, WAYPOINTS
from ...observation import Observation
from ...policy import Assignment, PolicyError
from ..follower.goals import EITHER, Part, UnfollowableError
from .climb import Climb, LostError
from .inference import Target, choose_target, parts_of_text
from .labels import Labeller, OracleLabeller
from .routes import Routes, blocked, next_action, waypoints
from .seen_map import SeenMap

_ALL_AROUND = 24  # turns of 15°
_AGAIN = 6  # actions after which the target is chosen again
_AT_END_M, _AT_FRONTIER_M = 0.3, 0.5
_PENDING_RAD = math.radians(11.0)  # a walking body turns about 0.2 s late, at 60°/s
_PATIENT = 120  # actions after which known stairs are gone to, whatever the text says of the way
_LAST_SEARCH = 420  # actions after which nothing new is looked for; 500 end an episode
_BUMP_ACTIONS, _BUMP_M = 4, 0.1  # so many steps ahead that move the robot less hit something
_SIGNS = {"up": (1.0,), "down": (-1.0,), EITHER: (1.0, -1.0)}


class MapPolicy:
    """Maps what it sees, follows the instruction on the map, and explores where the map ends.

    It first turns once around. Then it reads the whole instruction on the map seen so far (see
    `inference`), walks to the end that it finds, or to the frontier that fits best, and stops
    when the end it stands at is still the end. Where the text takes stairs, it does so then
    (see `climb`), and goes on with the rest of the text on a new map.

    Attributes:
        said: what was decided, for the record.
        target: where it is going.
    """

    blind = False
    wants_lens = True

    def __init__(
        self,
        labeller: Labeller | None = None,
        read: Callable[[str], Sequence[Part]] = parts_of_text,
    ) -> None:
        """Get ready.

        Args:
            labeller: finds things in images; the renderer's labels, an oracle, by default.
            read: makes parts of an instruction; by default the grammar of `instruction_gen`.
                Its attributes `said` and `unclear`, if it has them, go to the record.
        """
        self._labeller = labeller or OracleLabeller()
        self.wants_labels = labeller is None
        self._read = read
        self.said: list[str] = []
        self.seen = SeenMap()
        self.target: Target | None = None

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""
        if assignment.actions not in (DISCRETE, WAYPOINTS):
            raise PolicyError(f"actions {assignment.actions}; valid: {DISCRETE}, {WAYPOINTS}")
        try:
            self._parts = list(self._read(assignment.instruction))
        except UnfollowableError as error:
            raise PolicyError(f"instruction {assignment.instruction!r:.80}: {error}") from error
        self._labeller.reset()
        self._is_placed = assignment.controller == "flash"
        self._discrete = assignment.actions == DISCRETE
        self._radius_m = get_robot(assignment.robot).footprint_radius_m
        self.said = list(getattr(self._read, "said", ()))
        self._camera_m: float | None = None  # height of the camera at the start
        self._climb: Climb | None = None
        self._rng = np.random.default_rng(0)
        self._enter(np.zeros(3), 0.0, 0)

    def _enter(self, pose: Array, floor_m: float, step: int) -> None:
        """Begin a level with a new map, after a number of actions."""
        self.seen, self.target = SeenMap(floor_m), None
        self._begin, self._entered = pose.copy(), step
        self._turns = _ALL_AROUND if self._discrete else 4
        self._path: Array = np.zeros((0, 2))
        self._age = 0
        self._exhausted: list[Array] = []
        self._track: list[Array] = []
        self._ahead = 0  # FORWARD actions in a row

    @property
    def unclear(self) -> int:
        """Number of a model's answers in this episode that could not be used."""
        return self._labeller.unclear + int(getattr(self._read, "unclear", 0))

    @property
    def left_out(self) -> int:
        """Number of things that a model named in this episode and that are not on the map."""
        return self._labeller.left_out

    def act(self, observation: Observation) -> Any:
        """See `Policy.act`.

        Raises:
            ValueError: If the observation has no camera pose or no labels.
        """
        if observation.lens is None:
            raise ValueError("the observation has no camera pose")
        pose = observation.pose
        detections = self._labeller.detect(observation)
        self.seen.add(observation.depth_m, observation.lens, pose[:2], detections)
        if self._camera_m is None:
            self._camera_m = float(observation.lens.position_m[2])
        height_m = float(observation.lens.position_m[2]) - self._camera_m
        if self._climb is not None:
            return self._climbed(self._climb, observation, height_m)
        if self._turns:
            return self._turn()
        self._notice_bump(pose)
        if self._to_choose(pose):
            climb = self._climb_ahead()
            if climb is not None and self._sees_stairs(climb, observation):
                self._climb = climb
            elif self._chosen(observation):
                if climb is None:
                    return Action.STOP
                self._climb = climb
            if self._climb is not None:
                return self._climbed(self._climb, observation, height_m)
        if not self._discrete:
            return waypoints(self._path, pose)
        action = next_action(self._path, pose)
        self._ahead = self._ahead + 1 if action is Action.FORWARD else 0
        return action

    def _turn(self) -> Any:
        self._turns -= 1
        return Action.LEFT if self._discrete else np.array([[0.0, 0.0, math.pi / 2]])

    def _climb_ahead(self) -> Climb | None:
        """Return the climb that the present part of the text ends with."""
        signs = _SIGNS.get(self._parts[0].way)
        if signs is None:
            return None
        pending = 0.0 if self._is_placed else _PENDING_RAD
        return Climb(signs, self._radius_m, self._rng, self.said, pending)

    def _sees_stairs(self, climb: Climb, observation: Observation) -> bool:
        """Return whether to take the stairs: a flight is seen, or where one is after a while."""
        if climb.sees_flight(self.seen, observation.pose):
            return True
        late = observation.step - self._entered > _PATIENT
        return late and climb.knows_stairs(self.seen, observation.pose[:2])

    def _climbed(self, climb: Climb, observation: Observation, height_m: float) -> Any:
        """Return the next action on the way to another storey, or the first one there."""
        try:
            action = climb.act(self.seen, observation.pose, height_m - self.seen.floor_m)
        except LostError:
            self.said.append("no stairs lead on from here")
            return Action.STOP
        if action is None:
            self._climb, self._parts = None, self._parts[1:]
            self._enter(observation.pose, height_m, observation.step)
            return self._turn()
        return action if self._discrete else np.array([STEPS[action]])

    def _to_choose(self, pose: Array) -> bool:
        self._age += 1
        if self.target is None or self._age >= _AGAIN or blocked(self.seen, self._path):
            return True
        near = _AT_END_M if self.target.is_end else _AT_FRONTIER_M
        return bool(np.linalg.norm(self._path[-1] - pose[:2]) < near)

    def _chosen(self, observation: Observation) -> bool:
        """Choose a target and the way to it; return whether the robot stands at the end."""
        pose, self._age = observation.pose, 0
        routes = Routes.spread(self.seen, pose[:2], self._radius_m)
        target, path = None, self._path
        for _ in range(3):
            target = choose_target(
                self._parts[0].goals,
                self.seen,
                routes,
                pose,
                self._exhausted,
                begin=self._begin,
                current=self.target,
                step=observation.step - self._entered,
                explore=observation.step < _LAST_SEARCH,
            )
            if target is None:
                return True
            path = routes.path_to(target.xy_m)
            there = np.linalg.norm(path[-1] - pose[:2])
            if target.is_end and there < _AT_END_M:
                self._note(target, pose)
                return True
            if target.is_end or there >= _AT_FRONTIER_M:
                break
            self._exhausted.append(target.xy_m)  # standing at it, and it still looks unexplored
        if target is not None:
            self._note(target, pose)
            self.target, self._path = target, path
        return False

    def _note(self, target: Target, pose: Array) -> None:
        if self.target is None or target.why != self.target.why:
            self.said.append(f"({target.xy_m[0]:.1f}, {target.xy_m[1]:.1f}) m: {target.why}")

    def _notice_bump(self, pose: Array) -> None:
        """Put an obstacle ahead if steps ahead lead nowhere: something unseen is in the way."""
        self._track = [*self._track[-_BUMP_ACTIONS:], pose[:2].copy()]
        if self._discrete and self._ahead < _BUMP_ACTIONS:
            return
        if len(self._track) <= _BUMP_ACTIONS:
            return
        if np.linalg.norm(self._track[-1] - self._track[0]) < _BUMP_M:
            heading = np.array([math.cos(pose[2]), math.sin(pose[2])])
            for reach in (0.1, 0.2):
                place = pose[:2] + (self._radius_m + reach) * heading
                self.seen.bump(place)
            self._age, self._ahead, self._track = _AGAIN, 0, []

"""Takes stairs as a robot sees them: finds their flights by depth, lines up, and walks them.

A flight is walked along its middle to about half a metre beyond its end. There, on a landing, the
robot turns until it sees the next flight in the same direction.
"""

from dataclasses import dataclass, field

import numpy as np

from ....collectors.controllers import Pose
from ....collectors.controllers.flight import DISCRETE, FlightLine, step_along
from ....formats.core.frames import Array, wrap_angle
from ....formats.core.rollout import TURN_STEP_RAD, Action
from ....instruction_gen.language.nouns import called
from .flights import TELLING_RISE_M, Flight, find_flight, same_flight, with_most_room
from .frontiers import find_frontiers
from .routes import Routes, bearing, next_action
from .seen_map import SeenMap, behind_walls

_STOREY_M = 2.0  # one that has gone so far up or down, and sees no further flight, has arrived
_LEAST_M = 0.4  # and one that has not gone even so far took something else for stairs
_AROUND = 24  # turns
_ON_LANDING_RISE_M = 0.28  # of a flight: two steps, as nothing else begins there
_NUDGES = 2  # steps ahead on a landing from which nothing is seen
_AGAIN = 4  # actions after which it looks again where the flight is
_LOOK_M = 7.0
_BEFORE_M, _BEFORE_ON_LANDING_M = 0.9, 0.45  # of a flight's foot, where it lines up
_BEYOND_M = 0.1  # as far as floor still looks like a tread, and this
_HELD_ACTIONS, _HELD_M = 10, 0.08  # less displacement in so many actions: something is in the way
_AT_M = 0.25
_BESIDE_M = 1.2  # of stairs of which no flight is seen yet, where it looks for one
_NAMED_M = 0.8  # the first flight lies so near to a thing that is called stairs
_SAME_PLACE_M = 1.0


class LostError(Exception):
    """No flight was found."""


@dataclass
class Climb:
    """One way up or down a staircase; one object for each.

    Attributes:
        signs: 1 up, −1 down; of both, the flight that is nearer is taken.
        radius_m: of the robot.
        pending_rad: how much of a turn a walking body has still to do when the next action is
            chosen.
        flights: taken so far.
        said: what was decided, for the record.
    """

    signs: tuple[float, ...]
    radius_m: float
    rng: np.random.Generator
    said: list[str]
    pending_rad: float = 0.0
    flights: list[Flight] = field(default_factory=list)
    _flight: Flight | None = None
    _line: FlightLine | None = None
    _crossing: FlightLine | None = None  # over a landing, to before the next flight
    _path: Array | None = None
    _base_m: float | None = None
    _floor_m: float = 0.0
    _turns: int = _AROUND
    _nudges: int = _NUDGES
    _face: Array | None = None
    _age: int = _AGAIN
    _wrong: list[Flight] = field(default_factory=list)
    _tried: list[Array] = field(default_factory=list)
    _last: Action = Action.FORWARD
    _track: list[Array] = field(default_factory=list)

    def sees_flight(self, seen: SeenMap, pose: Array) -> bool:
        """Return whether a flight is seen from a pose (3,)."""
        self._look(seen, pose)
        return self._flight is not None

    def knows_stairs(self, seen: SeenMap, xy_m: Array) -> bool:
        """Return whether something called stairs is on the map."""
        return self._nearest_stairs(seen, xy_m) is not None

    def act(self, seen: SeenMap, pose: Array, height_m: float) -> Action | None:
        """Return the next action; None once the robot has arrived on the other storey.

        Args:
            pose: (3,) x, y [m], yaw [rad].
            height_m: of the floor under the robot above the map's floor, true where it is level.

        Raises:
            LostError: no flight is found.
        """
        sense = {Action.LEFT: 1.0, Action.RIGHT: -1.0}.get(self._last, 0.0)
        pose = pose + np.array([0.0, 0.0, sense * self.pending_rad])
        action = self._next(seen, pose, height_m)
        self._last = self._last if action is None else action
        return action

    def _next(self, seen: SeenMap, pose: Array, height_m: float) -> Action | None:
        if self._base_m is None:
            self._base_m = self._floor_m = height_m
        self._age += 1
        if self._age >= _AGAIN:
            self._age = 0
            self._look(seen, pose)
        if self._line is not None:
            action = self._along(pose)
            if action is None and self._age:  # it may have come to see that the flight goes on
                self._age = 0
                self._look(seen, pose)
                action = self._along(pose)
            if action is not None:
                return action
            self._land(height_m)
            climbed_m = self.flights[-1].sign * (height_m - self._base_m)
            if climbed_m >= _STOREY_M:
                return None
            if climbed_m < _LEAST_M:
                self._reject()
                return self._search(seen, pose)
            self._look(seen, pose)
            if self._line is not None:
                return self._next(seen, pose, height_m)
        if self.flights or self._flight is None:
            return self._search(seen, pose)
        return self._approach(seen, self._flight, pose)

    def _look(self, seen: SeenMap, pose: Array) -> None:
        """Look for the flight, or for how far it goes on."""
        if self._crossing is not None:
            return
        flight, line = self._flight, self._line
        from_m = pose[:2] if line is None or flight is None else flight.at(0.0)
        places = seen.heights.steps(from_m, self._floor_m, _LOOK_M)
        least_m = _ON_LANDING_RISE_M if self.flights else TELLING_RISE_M
        first = self.flights[-1] if self.flights else flight if line is not None else None
        signs = self.signs if first is None else (first.sign,)
        sights = [
            sight
            for sign in signs
            if (sight := find_flight(places, self._floor_m, sign, self.rng, least_rise_m=least_m))
            and not any(same_flight(sight, wrong) for wrong in self._wrong)
            and (self.flights or self._is_named(seen, sight))
            and (line is None or flight is None or same_flight(sight, flight))
        ]
        if not sights:
            return
        nearest = min(sights, key=lambda s: float(np.linalg.norm(s.foot_m - pose[:2])))
        flight = self._flight = with_most_room(nearest, seen.heights, self._floor_m)
        if line is not None:
            self._line = FlightLine(self._points(flight), DISCRETE)
            self._line.lined_up = line.lined_up
            return
        self._note(f"stairs begin here, {flight.length_m:.1f} m seen", flight.foot_m)
        if self.flights:
            before = flight.at(-_BEFORE_ON_LANDING_M)
            if np.linalg.norm(before - pose[:2]) > _AT_M:
                self._crossing = FlightLine(np.array([pose[:2], before]), DISCRETE)
            self._line = FlightLine(self._points(flight), DISCRETE)

    def _points(self, flight: Flight) -> Array:
        before = _BEFORE_ON_LANDING_M if self.flights else _BEFORE_M
        return np.array([flight.at(-before), flight.at(flight.length_m + _BEYOND_M)])

    def _along(self, pose: Array) -> Action | None:
        assert self._line is not None
        self._track = [*self._track[-_HELD_ACTIONS:], pose.copy()]
        line = self._crossing or self._line
        line.look(Pose(*(float(v) for v in pose)))
        if self._crossing is not None and (line.done or self._is_held()):
            self._crossing, self._track = None, []
            return self._along(pose)
        if line.done or self._is_held():
            return None
        return step_along(line, self._last)

    def _is_held(self) -> bool:
        first, last = self._track[0], self._track[-1]
        turned = abs(wrap_angle(last[2] - first[2])) > TURN_STEP_RAD
        moved = float(np.linalg.norm(last[:2] - first[:2])) > _HELD_M
        return len(self._track) > _HELD_ACTIONS and not (turned or moved)

    def _land(self, height_m: float) -> None:
        assert self._flight is not None
        self.flights.append(self._flight)
        self._floor_m, self._turns, self._nudges = height_m, _AROUND, _NUDGES
        self._flight = self._line = None
        self._age, self._track = 0, []

    def _reject(self) -> None:
        """Forget what looked like a flight, and led nowhere."""
        self._wrong.append(self.flights.pop())
        self._path = None

    def _approach(self, seen: SeenMap, flight: Flight, pose: Array) -> Action:
        """Go to before the flight."""
        target = flight.at(-_BEFORE_M)
        if self._age == 0 or self._path is None:
            self._path = Routes.spread(seen, pose[:2], self.radius_m).path_to(target)
        path = self._path
        if np.linalg.norm(path[-1] - pose[:2]) > _AT_M:
            return next_action(path, pose)
        self._line = FlightLine(self._points(flight), DISCRETE)
        action = self._along(pose)
        assert action is not None  # the line ends beyond the flight
        return action

    def _search(self, seen: SeenMap, pose: Array) -> Action:
        """Turn on a landing; before the first flight, look at the stairs from around them."""
        if self.flights:
            if not self._turns:
                if not self._nudges:
                    raise LostError
                self._nudges, self._turns = self._nudges - 1, _AROUND
                return Action.FORWARD  # it looks along the flight that it took again
            self._turns -= 1
            self._age = _AGAIN if self._turns % 2 == 0 else self._age
            return Action.LEFT
        if self._face is not None:
            turn = bearing(pose, self._face)
            if abs(turn) > TURN_STEP_RAD:
                return Action.LEFT if turn > 0 else Action.RIGHT
            self._face, self._path = None, None
        if self._path is None:
            self._tried.append(pose[:2].copy())
            self._path = self._next_place(seen, pose)
        if np.linalg.norm(self._path[-1] - pose[:2]) < 2 * _AT_M:
            self._face = self._nearest_stairs(seen, pose[:2])
            self._path, self._age = None, _AGAIN
            return self._search(seen, pose)
        if self._age == 0:
            routes = Routes.spread(seen, pose[:2], self.radius_m)
            self._path = routes.path_to(self._path[-1])
        return next_action(self._path, pose)

    def _is_named(self, seen: SeenMap, flight: Flight) -> bool:
        """Return whether a thing called stairs is at a flight, or nothing has a name here."""
        things = seen.objects()
        middle = flight.at(0.5 * flight.length_m)
        gaps = [
            float(np.linalg.norm(np.clip(middle, thing.lower_m[:2], thing.upper_m[:2]) - middle))
            for thing in things
            if called(thing.category, "stairs")
        ]
        return not things or min(gaps, default=np.inf) < _NAMED_M

    def _nearest_stairs(self, seen: SeenMap, xy_m: Array) -> Array | None:
        """Return the middle (2,) [m] of the nearest thing that is called stairs."""
        middles = [
            0.5 * (np.array(thing.lower_m[:2]) + thing.upper_m[:2])
            for thing in seen.objects()
            if called(thing.category, "stairs")
        ]
        return min(middles, key=lambda m: float(np.linalg.norm(m - xy_m)), default=None)

    def _next_place(self, seen: SeenMap, pose: Array) -> Array:
        """Return the way (P, 2) [m] to a place beside the stairs, or to a frontier."""
        routes = Routes.spread(seen, pose[:2], self.radius_m)
        cells = np.argwhere(routes.reachable() & seen.free)
        places = seen.grid.center_of(cells)
        gap = np.full(len(places), np.inf)
        for thing in seen.objects():
            if called(thing.category, "stairs"):
                low, high = np.array(thing.lower_m[:2]), np.array(thing.upper_m[:2])
                edge = np.clip(places, low, high)
                away = np.linalg.norm(places - edge, axis=1)
                away[behind_walls(seen, places, edge)] = np.inf
                gap = np.minimum(gap, away)
        places = self._untried(places[(gap > self.radius_m) & (gap < _BESIDE_M)])
        if not len(places):
            frontiers = [f.xy_m for f in find_frontiers(seen, routes.reachable())]
            places = self._untried(np.array(frontiers).reshape(-1, 2))
        if not len(places):
            raise LostError
        costs = np.array([routes.cost_to(place) for place in places])
        costs += 0.25 * np.abs([bearing(pose, place) for place in places])
        place = places[int(np.argmin(costs))]
        self._note("looks for the stairs from here", place)
        return routes.path_to(place)

    def _untried(self, places: Array) -> Array:
        for old in self._tried:
            places = places[np.linalg.norm(places - old, axis=1) > _SAME_PLACE_M]
        return places

    def _note(self, why: str, xy_m: Array) -> None:
        self.said.append(f"({xy_m[0]:.1f}, {xy_m[1]:.1f}) m: {why}")

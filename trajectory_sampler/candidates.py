"""Draw candidate paths on one ground, and say why one is dropped."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.core.frames import Array, wrap_angle
from ..formats.core.geometry import path_length
from ..wayfinding.crossings import Crossing
from ..wayfinding.distance import AGENT_RADIUS_M
from .config import ALONG_PATH, FRECHET, SampleConfig
from .ground import Ground, Reach, dimensions
from .similarity import PathIndex, stations

LENGTH_BIN_M = 2.0


@dataclass(frozen=True)
class Candidate:
    """A path that could become an episode.

    Attributes:
        ground: number of the ground that it was drawn on.
        levels, staircases: what it takes, in order.
        stairs_m: length of the staircase among it [m].
        split: the split that it was drawn for.
        reference_m: (P, 3) waypoints; every straight segment between them is safe [m].
        geodesic_m: length of the shortest way of VLN-CE's agent [m].
        turning_deg: sum of its turns [deg].
        crossed: its steps from room to room, in order.
        steps: see `Visits`.
        rooms: names of the rooms it visits, in order; "" if unknown.
        ends: room indices of its start and goal.
        open_ends: whether cameras at its ends were required to see far enough.
    """

    ground: int
    levels: tuple[int, ...]
    staircases: tuple[int, ...]
    stairs_m: float
    split: str
    reference_m: Array
    geodesic_m: float
    turning_deg: float
    crossed: tuple[Crossing, ...]
    steps: int
    rooms: tuple[str, ...]
    ends: tuple[int, int]
    open_ends: bool

    @property
    def stations(self) -> Array:
        """(S, D) the path as it is compared with others: changes of level count."""
        return stations(self.reference_m, 3 if self.staircases else 2)


@dataclass
class AcceptedPaths:
    """The paths accepted on one ground, as drawing the next one needs them.

    Attributes:
        index: their stations, by number.
        splits: split of each number.
        visits: number of paths from one room to another, by (room, room).
        lengths: number of paths by split and bin of length, `LENGTH_BIN_M` wide.
        crossed: number of paths by split and number of steps between rooms.
    """

    index: PathIndex
    splits: list[str] = field(default_factory=list)
    visits: Counter[tuple[int, int]] = field(default_factory=Counter)
    lengths: Counter[tuple[str, int]] = field(default_factory=Counter)
    crossed: Counter[tuple[str, int]] = field(default_factory=Counter)

    def avoid(self, path: Array, split: str = "") -> None:
        """Remember the stations of a path that new ones of other splits keep away from."""
        self.index.add(path)
        self.splits.append(split)

    def add(self, candidate: Candidate) -> None:
        """Remember an accepted path."""
        self.avoid(candidate.stations, candidate.split)
        self.visits[candidate.ends] += 1
        length = int((path_length(candidate.reference_m) - candidate.stairs_m) / LENGTH_BIN_M)
        self.lengths[(candidate.split, length)] += 1
        self.crossed[(candidate.split, candidate.steps)] += 1


def from_one_start(
    ground: Ground,
    accepted: AcceptedPaths,
    split: str,
    gap_m: float,
    config: SampleConfig,
    rng: np.random.Generator,
) -> Iterator[Candidate | str]:
    """Draw one start and try goals from it: candidates, or the reason why one is dropped.

    The start lies in a room that few accepted paths start from. The goal's distance is the one
    that the split lacks most, measured by the target of `config`; of the places that far away,
    those behind as many doors as few accepted paths have passed are taken, in a room that few go to
    from here.

    Args:
        gap_m: least distance from every other path [m].
    """
    left = Counter(from_room for from_room, _ in accepted.visits.elements())
    room = _least(np.unique(ground.rooms), left, rng)
    start = ground.cells_m[rng.choice(np.flatnonzero(ground.rooms == room))]
    near, agent = ground.reach(start, ground.radius_m), ground.reach(start, AGENT_RADIUS_M)
    distance_m = near.to_cells_m - ground.stairs_m
    least = agent.to_cells_m - ground.stairs_m
    fits = (least >= config.min_length_m) & (distance_m <= config.max_length_m)
    if ground.min_crossings:
        fits &= ground.rooms != room
    if not fits.any():
        yield "no_goal_in_range"
        return
    fits &= ~_taken(ground, accepted, split, start, gap_m, config)
    tight = near
    if config.robot_radius_m != ground.radius_m and fits.any():
        tight = ground.reach(start, config.robot_radius_m)
    for _ in range(config.goals_per_start):
        if not fits.any():
            yield "too_similar"
            return
        pool = _of_missing_length(distance_m, fits, accepted, split, config)
        hops = ground.hops[room, ground.rooms]
        hop_count = _least(
            np.unique(hops[pool]),
            Counter({n: accepted.crossed[(split, n)] for n in range(99)}),
            rng,
        )
        pool &= hops == hop_count
        goal_rooms = np.unique(ground.rooms[pool])
        used = Counter(
            {r: accepted.visits[room, r] + accepted.visits[r, room] for r in goal_rooms.tolist()}
        )
        goal_room = _least(goal_rooms, used, rng)
        pool &= ground.rooms == goal_room
        goal = ground.cells_m[rng.choice(np.flatnonzero(pool))]
        yield _judge(ground, accepted, split, goal, gap_m, (tight, agent), config)
        # Another try goes elsewhere.
        fits &= np.linalg.norm(ground.cells_m - goal, axis=1) > 0.5 * gap_m


def turning_deg(path_m: Array) -> float:
    """Return the sum of the turns along a path (P, 2 or 3) [m], left and right alike [deg]."""
    steps = np.diff(np.asarray(path_m)[:, :2], axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > 1e-9]
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    return float(np.rad2deg(np.abs(wrap_angle(np.diff(headings))).sum()))


def _taken(
    ground: Ground,
    accepted: AcceptedPaths,
    split: str,
    start: Array,
    gap_m: float,
    config: SampleConfig,
) -> NDArray[np.bool_]:
    """Return which cells (N,) make goals of paths that would be too near to an accepted one.

    The Fréchet distance of two paths is at least that of their starts and of their goals, and
    between the same ends there is mostly one way only: planning such a path would be wasted.
    """
    taken = np.zeros(len(ground.cells_m), dtype=bool)
    if config.similarity != FRECHET:
        return taken

    def block(paths: Sequence[int], own_end: int, far_end: int) -> None:
        nonlocal taken
        for number in paths:
            path = accepted.index.paths[number]
            same = accepted.splits[number] == split
            if same and own_end != 0:
                continue  # the way back is another path of the same split
            within = gap_m if same else max(gap_m, config.family_gap_m)
            if np.linalg.norm(path[own_end] - start) < within:
                taken |= np.linalg.norm(ground.cells_m - path[far_end], axis=1) < within

    block(accepted.index.starting_near(start), 0, -1)
    block(accepted.index.ending_near(start), -1, 0)
    return taken


def _of_missing_length(
    distance_m: Array,
    fits: NDArray[np.bool_],
    accepted: AcceptedPaths,
    split: str,
    config: SampleConfig,
) -> NDArray[np.bool_]:
    """Return those of `fits` (N,) whose distance (N,) [m] the split lacks most."""
    bins = np.where(fits, distance_m, 0.0) // LENGTH_BIN_M
    there = np.unique(bins[fits]).astype(int)
    middle = (there + 0.5) * LENGTH_BIN_M
    target = np.exp(-0.5 * ((middle - config.typical_length_m) / config.length_spread_m) ** 2)
    have = np.array([accepted.lengths[(split, int(b))] for b in there])
    missing = there[int(np.argmin((have + 1) / np.maximum(target, 1e-6)))]
    return fits & (bins == missing)


def _judge(
    ground: Ground,
    accepted: AcceptedPaths,
    split: str,
    goal: Array,
    gap_m: float,
    shortest: Sequence[Reach],
    config: SampleConfig,
) -> Candidate | str:
    """Return a candidate from the start of the fields `shortest` (robot's, agent's), or why not."""
    tight, agent = shortest
    start = tight.start_m
    reference = ground.reference(start, goal, config)
    if reference is None:
        return "unreachable"
    shape = dimensions(ground)
    if config.min_view_m and path_length(reference) - ground.stairs_m >= config.min_length_m:
        both = config.heading == ALONG_PATH
        trimmed = ground.view.trimmed(reference, config.min_view_m, both=both)
        if trimmed is None or not all(ground.may_end_at(end) for end in trimmed[[0, -1]]):
            return "end_at_wall"
        reference, goal = trimmed, trimmed[-1, :shape]
    length = path_length(reference)
    if length - ground.stairs_m < config.min_length_m:
        return "too_short"
    if length - ground.stairs_m > config.max_length_m:
        return "too_long"
    if not np.array_equal(reference[0, :2], start[:2]):
        start = reference[0, :shape]
        tight = ground.reach(start, config.robot_radius_m)
        agent = ground.reach(start, AGENT_RADIUS_M)
    # Compare with what the robot could have done, not with the roomier way.
    if length > config.max_detour * tight.to(goal):
        return "detour"
    geodesic = agent.to(goal)
    if geodesic - ground.stairs_m < config.min_length_m:
        return "too_short"
    turned = turning_deg(reference)
    if config.max_turning_deg is not None and turned > config.max_turning_deg:
        return "turning"
    visits = ground.visits(reference)
    if visits.steps < ground.min_crossings:
        return "same_room"
    own = stations(reference, shape)
    near = accepted.index.near(own)
    if any(gap < gap_m for gap in near.values()):
        return "too_similar"
    family = [*near.items(), *accepted.index.near(own[::-1].copy()).items()]
    if any(gap < config.family_gap_m and accepted.splits[k] != split for k, gap in family):
        return "family_of_another_split"
    if not ground.is_free(reference):
        return "unsafe"
    return Candidate(
        ground.index,
        *ground.route(reference),
        ground.stairs_m,
        split,
        reference,
        geodesic,
        turned,
        visits.crossed,
        visits.steps,
        tuple(ground.room_names[room] for room in visits.rooms),
        visits.ends,
        config.min_view_m > 0,
    )


def _least(rooms: NDArray[np.integer[Any]], used: Counter[int], rng: np.random.Generator) -> int:
    """Return one of the values used least so far, at random."""
    counts = np.array([used[int(r)] for r in rooms])
    return int(rng.choice(rooms[counts == counts.min()]))

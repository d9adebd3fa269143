"""Whether claims hold in their order, with no clear turn of the path left out.

A state is a number of turns made and the set of places where the walker may be after the claims
so far. Each claim moves the states on; one that leaves none is false where it stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..language.claims import Claim, Step
from .ground import Ground
from .things import Mask, Place, spread
from .turns import Turns

States = dict[int, Mask]

_EARLY_M = 1.0  # a claim about a place already holds so far before it
_ORDER_M = 1.0  # things this near to each other may be passed in either order
_SLACK_M = {"pass": 2.0, "see": 4.0, "reach": 1.5, "in": 0.4, "enter": 0.4, "leave": 0.4,
            "door": 0.4}  # fmt: skip


@dataclass(frozen=True)
class Problem:
    """A claim that does not hold, by its place in the list, and why."""

    index: int
    reason: str


def check_order(claims: Sequence[Claim], owners: Sequence[int], ground: Ground) -> list[Problem]:
    """Return what does not hold, in order; `owners` are the numbers of the claims' steps."""
    return _Walk(ground, claims, owners).run()


def step_starts_m(steps: Sequence[Step], ground: Ground) -> tuple[float, ...]:
    """Return how far along the path each step begins: where all before it can be done [m]."""
    owners = [k for k, step in enumerate(steps) for _ in step.claims]
    walk = _Walk(ground, [claim for step in steps for claim in step.claims], owners)
    walk.run()
    starts_m, done_m = [], 0.0
    for number in range(len(steps)):
        starts_m.append(round(done_m, 2))
        own = (m for m, owner in zip(walk.done_m, owners, strict=True) if owner == number)
        done_m = max(done_m, *own, 0.0)
    return tuple(starts_m)


class _Walk:
    def __init__(self, ground: Ground, claims: Sequence[Claim], owners: Sequence[int]):
        self.ground, self.claims, self.owners = ground, claims, owners
        self.room: tuple[int, Claim, Mask] | None = None  # the last room that was entered
        self.within = ""  # the room that the text is in
        self.inside = ("", -np.inf)  # the last room that is walked in, and from where [m]
        self.along, self.turns = ground.along_m, Turns(ground, claims)
        start = np.zeros(len(self.along), dtype=bool)
        start[0] = True
        self.states: States = {0: start}
        self.tight: States | None = None  # after a distance: where it led
        self.paced = -1  # the step that says the distance
        self.last: list[Mask] = []  # where the last place that is named may be
        self.index = 0
        self.done_m: list[float] = []  # how far along each claim is done

    def run(self) -> list[Problem]:
        """Return the problems of all claims."""
        problems: list[Problem] = []
        passed_m = -np.inf
        for index, claim in enumerate(self.claims):
            self.index = index
            if claim.kind == "stop":
                reason = self._stop(claim)
            elif claim.kind == "walk":
                reason = self._distance(claim)
            elif claim.kind == "turn":
                reason = self._turn(claim)
            elif claim.kind == "avoid":
                reason = self._avoid(claim)
            else:
                reason = self._place(claim)
                if claim.kind == "pass" and claim.what != "room" and not reason + claim.place:
                    since_m = min(float(self.along[np.argmax(m)]) for m in self.states.values())
                    first_m, last_m = self.ground.abeam_m(claim, since_m) or (passed_m, np.inf)
                    if last_m < passed_m - _ORDER_M:
                        reason = f"the {claim.text or 'doorway'} is passed earlier"
                    passed_m = max(passed_m, first_m)
            if reason:
                problems.append(Problem(index, reason))
            self.done_m.append(min(self._middle_m(mask) for mask in self.states.values()))
        if not problems and self.claims and (left := self._left_out()):
            problems.append(Problem(len(self.claims) - 1, left))
        return problems

    def _middle_m(self, mask: Mask) -> float:
        """Return the middle of the first places where the walker may be, which begin too early."""
        first = int(np.argmax(mask))
        left = np.flatnonzero(~mask[first:])
        last = first + int(left[0]) - 1 if len(left) else len(mask) - 1
        return float(
            min(0.5 * (self.along[first] + self.along[last]), self.along[first] + _EARLY_M)
        )

    # claims -----------------------------------------------------------------------------------

    def _find(self, claim: Claim) -> Place:
        ground = self.ground
        turned = self.index > 0 and self.claims[self.index - 1].kind == "turn"
        if turned and claim.side == "ahead" and claim.kind in ("enter", "door"):
            # "Turn right and go straight into the hall": straight on after the turn.
            mask, reason = self._find(replace(claim, side=""))
            mask = mask & ground.straight_on(max(self.states))
            return mask, reason or ("" if mask.any() else f"the {claim.text} is not ahead")
        if claim.what == "room":
            return {
                "leave": ground.left, "enter": ground.entered, "in": ground.inside,
                "reach": ground.room_in_view if claim.side else ground.inside,
                "pass": ground.room_passed, "see": ground.room_in_view, "door": ground.entered,
            }[claim.kind](claim)  # fmt: skip
        if claim.kind in ("door", "enter", "leave", "in"):
            return ground.through_door(claim) if claim.what == "door" else ground.left(claim)
        # Who has gone through a door does not mean what is on this side of it.
        before = self.claims[self.index - 1]
        through = before.kind in ("enter", "door")
        apart = self.index and self.owners[self.index - 1] != self.owners[self.index]
        first_m = min(float(self.along[np.argmax(here)]) for here in self.states.values())
        beyond_m = 0.9 * (apart and through) + 0.4 * (before.kind == "turn")
        since = int(np.searchsorted(self.along, first_m + beyond_m - 0.1))
        return {"pass": ground.passed, "see": ground.seen_at, "reach": ground.reached}[claim.kind](
            claim, since
        )

    def _place(self, claim: Claim) -> str:
        mask, reason = self._find(claim)
        fault = reason
        if claim.ordinal > 0 and (passed := self._doors_passed()):
            # "Pass the kitchen door and take the next one": counted from there.
            more, reason = self._find(replace(claim, ordinal=claim.ordinal + passed))
            mask, reason = mask | more, reason and fault
        if reason:
            return reason
        before = self.claims[self.index - 1] if self.index else claim
        if claim.kind == "enter" and before.kind == "door" and self._one_step():
            # "Through the door into the kitchen" enters no other room between.
            through = np.any(list(self.states.values()), axis=0)
            mask = mask & spread(through, self.along, 0.3)
            if not mask.any():
                return f"the {claim.text} is not behind that doorway"
        if self._is_pair() and not self.ground.flank(before, claim):
            return f"one does not pass between the {before.name} and the {claim.name}"
        if claim.kind in ("in", "leave") and claim.name and self._starts_outside(claim):
            return f"the path does not start in the {claim.name}"
        if claim.kind in ("enter", "door") and self.within:
            mask = mask & self.ground.out_of(self.within)
            if not mask.any():
                return f"one does not come to the {claim.text} from the {self.within}"
        if claim.what in ("door", "room") and self.index:
            self.within = (
                claim.name if claim.kind in ("enter", "in") and claim.what == "room" else ""
            )
        if claim.kind == "see" and any(c.kind == "stop" for c in self.claims[: self.index]):
            mask = mask & (self.along >= self.ground.length_m - 1.0)
            if not mask.any():
                return f"the {claim.text or 'doorway'} is not in view where the path ends"
        self.last = [mask] if claim.kind in ("pass", "see") else []
        owner = self.owners[self.index]
        if self.room is not None and self.room[0] != owner:
            if (
                claim.kind == "door"
                and self.claims[self.index - 1] is self.room[1]
                and (self.room[1].kind == "enter" and self.room[1].name)
            ):
                mask = mask & ~self.room[2]  # "go into the hall and take the door": the next one
            elif claim.kind in ("pass", "reach") and self.room[1].name:
                first = float(self.along[np.argmax(self.room[2])])
                mask = mask & (self.along >= first + 0.5)  # not what stands in the room before
            if not mask.any():
                return f"the {claim.text or 'doorway'} is not in the room that the text has entered"
        at_m = min(self._middle_m(here) for here in self.states.values())
        if claim.kind == "pass" and claim.what == "door" and claim.count > 1 and (
            self.ground.doors_passed(claim, at_m) < claim.count
        ):  # fmt: skip
            return f"there are not {claim.count} doorways to pass"
        if claim.kind == "in" and claim.name:
            if self.inside[0] != claim.name:
                mask = mask & (self.along >= self.inside[1] + 0.6)
            visits = [
                v for v in self.ground.facts.visits if v.room in self.ground.rooms(claim.name)
            ]
            first = min(float(self.along[np.argmax(here)]) for here in self.states.values())
            from_m = min((v.from_m for v in visits if v.to_m > first + 0.5), default=self.inside[1])
            self.inside = (claim.name, from_m)
            if not mask.any():
                return f"the {claim.name} comes earlier on the path than the text says"
        slack, still = _SLACK_M[claim.kind], claim.kind == "see" or claim.kind == "pass"
        turned = before.kind == "turn" and claim.kind in ("enter", "door")
        if before.kind == "turn":  # "turn left in the hall", "right out of the hall"
            slack = {"enter": 0.9, "leave": 1.0, "door": 0.0}.get(claim.kind, slack)
        states = self.states
        if self.tight is not None and claim.kind in ("door", "enter", "leave"):
            near = {k: spread(m, self.along, 0.1) for k, m in self.tight.items()}
            onward = {k: m for k, m in near.items() if (m & ~spread(~mask, self.along, 0.4)).any()}
            # "Walk nine metres, out of the room and down the hall."
            if not onward and (owner != self.paced or all(
                not (m & (self.along > self.along[mask][-1])).any() for m in near.values()
            )):  # fmt: skip
                return f"the {claim.text or 'doorway'} is farther than the distance before it"
            states = onward or states
            self.tight = None
        result: States = {}
        ground = self.ground
        for made, here in states.items():
            first = float(self.along[np.argmax(here)])
            reach = mask & (self.along >= first - slack) & (self.along <= self._limit(made, first))
            if claim.kind == "door" and not (claim.side or claim.room or claim.ordinal):
                reach &= self.along <= ground.next_door_m(first + 1.0) + 0.9
            if turned and self._one_step():  # "left into the kitchen" goes through no other room
                turn_m = float(self.along[here][-1]) - 0.6
                next_m = ground.next_room_m(turn_m - 0.9)
                next_m = ground.next_room_m(next_m) if next_m < turn_m + 0.6 else next_m
                reach &= self.along <= next_m + 0.9
            if not reach.any():
                continue
            ahead = reach & (self.along >= first - 0.3)
            if claim.kind == "see":
                result[made] = here
            elif claim.kind == "in" and (here & mask).any():
                result[made] = here & mask
            elif still:
                result[made] = ahead if ahead.any() else here
            else:
                result[made] = ahead if ahead.any() else reach
        if result:
            self.states = result
            if claim.kind in ("enter", "door"):
                entered = np.any([mask & m for m in result.values()], axis=0)
                self.room = (owner, claim, entered) if entered.any() else self.room
            return ""
        return self._missing(claim, mask)

    def _starts_outside(self, claim: Claim) -> bool:
        """Return whether a text is in a room that it has neither started in nor moved to."""
        facts, before = self.ground.facts, self.claims[: self.index]
        moved = any(c.kind in ("enter", "door", "leave", "in", "turn", "reach") for c in before)
        rooms = {v.room for v in facts.visits[: 1 + (claim.kind == "in")]} | {*facts.start_rooms}
        return (
            not moved and bool(facts.visits[0].room) and not rooms & self.ground.rooms(claim.name)
        )

    def _is_pair(self) -> bool:
        """Return whether a claim is the second of two things that one is between."""
        claim, row = self.claims[self.index], 0
        for before in self.claims[: self.index][::-1]:
            if before.place != "between" or (before.kind, before.what) != (claim.kind, "thing"):
                break
            row += 1
        return claim.place == "between" and row % 2 == 1

    def _one_step(self) -> bool:
        """Return whether a claim and the one before belong to one step."""
        return self.index > 0 and self.owners[self.index - 1] == self.owners[self.index]

    def _doors_passed(self) -> int:
        """Return how many doorways of the room the text has passed."""
        passed, own = 0, self.owners[self.index]
        for before, owner in zip(
            self.claims[: self.index][::-1], self.owners[: self.index][::-1], strict=True
        ):
            if before.kind in ("leave", "enter", "door") and owner != own:
                break
            passed += before.kind == "pass" and before.what == "door"
        return passed

    def _missing(self, claim: Claim, mask: Mask) -> str:
        what = f"the {claim.text or 'doorway'}"
        first = min(float(self.along[np.argmax(m)]) for m in self.states.values())
        if self._limit(max(self.states), first) < self.along[np.flatnonzero(mask)[0]]:
            turn = self.turns.unclaimed(max(self.states), self.index, first)
            return f"the turn to the {turn.side if turn else ''} before {what} is not mentioned"
        return f"{what} comes earlier on the path than the text says"

    def _turn(self, claim: Claim) -> str:
        result: States = {}
        for made, here in self.states.items():
            tight = None if self.tight is None else self.tight.get(made)
            after = self.turns.after(claim, self.index, made, here, tight)
            for count, mask in after.items():
                result[count] = result.get(count, mask) | mask
        if not result:
            side = "around" if claim.side == "around" else f"to the {claim.side}"
            return f"there is no turn {side} here"
        self.states, self.tight = result, None
        return ""

    def _distance(self, claim: Claim) -> str:
        d = claim.metres
        if not d and not claim.vague:  # to walk on
            return ""
        low, high = (0.2, max(4.5, 2 * d)) if claim.vague else (0.8 * d - 0.3, 1.25 * d + 0.3)
        result: States = {}
        for made, here in self.states.items():
            far = np.zeros_like(here)
            # The state reaches beyond a door on both sides.
            cores = (here & ~spread(~here, self.along, by_m) for by_m in (0.8, 0.4))
            for at in self.along[next((core for core in cores if core.any()), here)]:
                # A few steps may be fewer where the path ends.
                end_m = self.along[-1] - 0.05 if claim.vague else np.inf
                far |= self.ground.between(min(at + low, end_m), at + high)
            far &= self.along <= self._limit(made, float(self.along[np.argmax(here)]))
            if far.any():
                result[made] = far
        if not result:
            return f"the path does not go on for {d:g} metres"
        self.tight, self.paced = result, self.owners[self.index]
        return ""

    def _avoid(self, claim: Claim) -> str:
        names = self.ground.rooms(claim.name)  # not the children's bedroom
        first = min(float(self.along[np.argmax(m)]) for m in self.states.values())
        later = [v for v in self.ground.facts.visits if v.room in names and v.from_m > first - 0.6]
        twins = self.ground.facts.level_rooms.count(claim.name) > 1
        return f"the path does enter the {claim.name}" if later and not twins else ""

    def _stop(self, claim: Claim) -> str:
        ground = self.ground
        if claim.what == "room":
            reason = ground.stopped_in(claim)
        elif claim.what == "door":
            reason = ground.stopped_at_door(claim)
        else:
            reason = ground.stopped_at(claim) if claim.what == "thing" else ""
        before = self.claims[self.index - 1]
        if not reason and self._is_pair():
            parted = ground.flank(before, claim, at_end=True)
            reason = (
                "" if parted else f"the path does not end between {before.name} and {claim.name}"
            )
        if reason := reason or self._elsewhere(claim):
            return reason
        end = ground.between(ground.length_m - 0.3, ground.length_m)
        if self.tight is not None and not any(
            (spread(m, self.along, 0.4) & end).any() for m in self.tight.values()
        ):
            return "the path goes on farther than the distance before the stop"
        if self.tight is not None:
            self.tight = None
            return ""
        named = [*self.states.values(), *self.last]
        if not claim.what and not any((spread(m, self.along, 2.2) & end).any() for m in named):
            return "the path goes on farther than what is named before the stop"
        return ""

    def _elsewhere(self, claim: Claim) -> str:
        """Return why a thing to stop at must be one in a room that the path only goes through."""
        since = min(int(np.median(np.flatnonzero(here))) for here in self.states.values())
        told = claim.room or any(c.kind == "stop" and c.what == "room" for c in self.claims)
        if claim.what == "thing" and not told and self.ground.met_before_end(claim, since):
            return f"the first {claim.name} on the way is not where the path ends"
        return ""

    def _limit(self, made: int, first_m: float) -> float:
        return self.turns.limit_m(made, self.index, first_m)

    def _left_out(self) -> str:
        """Return that a turn is not mentioned at all, "" where none is left out."""
        left = [self.turns.unclaimed(made, self.index, -np.inf) for made in self.states]
        turn = left[-1] if all(left) else None
        return f"the turn to the {turn.side} is not mentioned" if turn else ""

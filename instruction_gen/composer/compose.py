"""Write several texts for one path, each of them checked."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..checker import Ground, check_text
from ..facts.records import PathFacts
from ..language.claims import Claim
from ..records import COMPOSER, WrittenText
from ..rivals import Rivals
from .along import (
    FEW_STEPS_M,
    bent,
    goal_events,
    not_entered,
    passed_events,
    start_events,
    with_distances,
    with_neighbours,
)
from .grammar import Phrase, is_hall, pick
from .names import Names
from .realize import Usage, realize
from .records import PLANS, TASTES, Event, Taste, explicit
from .steps import move_events
from .stop import stop_events

DRAFTS = 8  # written at once for each text, the best is taken
_ROUNDS = (False, True, True)  # of drafts, as long as none will do, and whether they tell all
WORDS = {"terse": (5, 8), "natural": (18, 23), "rich": (36, 48)}
_LONG = 4  # drafts that are far too long are tried at most, as long ways take long to compare
_NEAR_M = 1.5
# A stop that is told with the room that one enters.
_INTO = {"stop_here": "stop_inside", "stop_into": "stop_into", "stop_beside": "enter_stop"}
_ENTERS, _STOPS_INTO = ("enter", "enter_door", "enter_ahead"), 0.6
_OFF_LENGTH = 25.0  # what a text costs that is twice as long as it may be
_PACED, _PACED_M = ("stop_front", "stop_beside", "stop_close", "stop_side", "stop_view"), 1.8  # [m]
_BY_PACES = ("stop_after", "stop_facing")  # how far one walks to the stop is told
# How bad it is, the text, what it goes by with the kinds of its events, their phrases.
_Draft = tuple[float, WrittenText, tuple[str, ...], tuple[Phrase, ...]]


def compose_texts(
    ground: Ground,
    count: int,
    styles: Sequence[str],
    rng: np.random.Generator,
    taken: Collection[str] = (),
    usage: Usage | None = None,
    rivals: Rivals | None = None,
) -> tuple[list[WrittenText], list[str]]:
    """Write `count` different texts in turn in the given styles.

    Args:
        styles: of `STYLES`.
        taken: texts that other paths have already.
        usage: what was written for other paths; the texts repeat little of it.
        rivals: of the path; a text that leads to one of them as well is not taken, unless the
            path has no other and nothing on its levels has a name.

    Returns:
        The texts that pass their check, as many as could be had, and, where that is none, why.
        Their attempts are how many drafts were checked.
    """
    usage = Usage() if usage is None else usage
    chosen: list[_Draft] = []
    doubtful: list[_Draft] = []
    bare = _is_bare(ground.facts)
    problems: Sequence[str] = ()
    misleads: set[tuple[Claim, ...]] = set()
    for number in range(count):
        style = styles[number % len(styles)]
        others = [*chosen, *doubtful]
        said = {*taken, *(text.text for _, text, *_ in others)}
        spare: _Draft | None = None
        drafts = _drafts(ground.facts, style, rng, usage, others, said)
        for attempt, (score, text, kinds, phrases) in enumerate(drafts, start=1):
            claims = tuple(claim for step in text.steps for claim in step.claims)
            if claims in misleads and (spare or not bare):
                continue
            if problems := check_text(text.text, ground, text.steps).problems:
                continue
            text = replace(text, attempts=attempt)
            if rivals and (led_to := rivals.led_to(text.steps)):
                misleads.add(claims)
                problems = (led_to,)
                spare = spare or (score, replace(text, leads_elsewhere=led_to), kinds, phrases)
                continue
            chosen.append((score, text, kinds, phrases))
            usage.add(text.text, phrases)
            break
        else:
            doubtful += [spare] if spare and bare else []
    if not chosen:
        chosen = doubtful
        for _, text, _, phrases in chosen:
            usage.add(text.text, phrases)
    return [text for _, text, *_ in chosen], ([] if chosen else list(problems))


def plan(facts: PathFacts, taste: Taste, rng: np.random.Generator) -> list[Event]:
    """Choose what to mention, in order, the stop last."""
    names = Names(facts, rng, taste.looks)
    stop = stop_events(facts, names, taste)
    start = start_events(facts, names, taste)
    if stop[0].kind in _BY_PACES:  # only what is passed shows where
        taste = replace(taste, passed=taste.passed + (taste.voice != "terse"), gap_m=_NEAR_M)
    events = move_events(facts, names, taste)
    events += passed_events(events, stop[0], facts, names, taste)
    events += not_entered(facts, names)
    events.sort(key=lambda e: e.along_m)
    events = with_distances(events, stop[0], facts, names, taste)
    if not events:
        events = [Event("walk", 0.0, far_m=facts.length_m)]
    if stop[0].kind in _BY_PACES:
        rest = facts.length_m - events[-1].done_m
        if events[-1].kind == "walk":
            rest = events[-1].far_m if len(events) > 1 else facts.length_m
            events = events[:-1]
        entered = events[-1].B if events and events[-1].kind.startswith("enter") else ""
        few = {"stop_facing": "stop_steps_facing"}.get(stop[0].kind, "stop_steps")
        few = "stop_into" if entered and not is_hall(entered) else few
        kind = stop[0].kind if rest > FEW_STEPS_M else few
        faced = stop[0].X if kind != "stop_into" else None
        stop[0] = replace(stop[0], kind=kind, far_m=rest, B=entered, X=faced)
    if stop[0].kind == "stop_doorway" and events and (events[-1].C or events[-1].B) == stop[0].C:
        if events[-1].kind in _ENTERS:
            events = events[:-1]
        else:
            stop[0] = replace(stop[0], kind="stop_here", B=stop[0].C)
    thing = stop[0].X
    there = thing is None or thing.mark.room in ("", facts.goal_room)
    kind = _INTO.get(stop[0].kind) if there else None
    if kind and len(events) > 1 and events[-1].kind in _ENTERS and rng.random() < _STOPS_INTO:
        stop[0] = replace(stop[0], kind=kind, B=events[-1].B)
        events = events[:-1]
    events = with_neighbours(
        [*goal_events(facts, stop[0], names, taste), *start, *events, *stop], names
    )
    return bent(_paced(events, facts, names, taste), facts)


def _paced(events: list[Event], facts: PathFacts, names: Names, taste: Taste) -> list[Event]:
    """Tell how far it is to a stop at a thing or door, which may not be the first such one."""
    at = max(k for k, event in enumerate(events) if "stop" in event.kind)
    since_m = max((event.done_m for event in events[:at]), default=0.0)
    far_m = facts.length_m - since_m
    if events[at].kind not in _PACED or far_m < _PACED_M or names.rng.random() >= taste.paced:
        return events
    return [*events[:at], Event("walk", since_m, far_m=far_m), *events[at:]]


def _is_bare(facts: PathFacts) -> bool:
    """Return whether no label of the scan tells places of a path's levels apart."""
    return not facts.level_rooms and {*facts.level_nouns} <= {"stairs"}


def _drafts(
    facts: PathFacts, style: str, rng: np.random.Generator, usage: Usage,
    others: Sequence[_Draft], said: Collection[str],
) -> Iterator[_Draft]:  # fmt: skip
    """Yield new drafts: the best of each round, and in the end those far too long."""
    long: list[tuple[int, _Draft]] = []
    for every in _ROUNDS:
        taste = explicit(TASTES[style]) if every else TASTES[style]
        drafts = [_draft(facts, taste, rng, usage, others) for _ in range(DRAFTS)]
        for draft in sorted(drafts, key=lambda d: d[0]):
            text = draft[1].text
            words = len(text.split())
            if words > 2.5 * WORDS[style][1]:  # as one that tells all may be
                long.append((words, draft))
            elif text not in said:
                yield draft
    new = [d for _, d in sorted(long, key=lambda d: d[0]) if d[1].text not in said]
    yield from new[:_LONG]


def _draft(
    facts: PathFacts, taste: Taste, rng: np.random.Generator, usage: Usage,
    others: Sequence[_Draft],
) -> _Draft:  # fmt: skip
    """Return a draft and how bad it is: its repetitions, its length, what other texts share."""
    style = taste.voice
    spread = float(rng.uniform(0.5, 1.3))
    used = {kinds[0] for _, _, kinds, _ in others}
    told = frozenset(phrase for *_, phrases in others for phrase in phrases)
    plans = [name for name in PLANS if name not in used] or list(PLANS)
    goes_by = "" if style == "terse" else pick(plans, rng)
    some = int(rng.integers(taste.passed > 2, taste.passed + 1)) if taste.passed else 0
    taste = replace(taste, marks=taste.marks * spread, passed=some)
    if goes_by:
        taste = replace(taste, **PLANS[goes_by])
    events = plan(facts, taste, rng)
    steps, phrases = realize(events, style, rng, usage, told)
    text = " ".join(step.words for step in steps)
    named = [r for e in events for r in (e.X, e.Y, e.Z, e.X and e.X.beside) if r is not None]
    marks = tuple(r.mark.name for r in named)
    kinds = (goes_by, *(e.kind for e in events))
    low, high = WORDS[style]
    words = len(text.split())
    outside = max(low - words, words - high, 0) / high
    shared = sum(mark in other.landmarks for mark in marks for _, other, *_ in others)
    same = sum(kind in other for kind in kinds for _, _, other, _ in others) / max(1, len(kinds))
    score = 2.0 * usage.repetition(text) + _OFF_LENGTH * outside + 0.15 * shared + 0.3 * same
    return score, WrittenText(text, "en", style, COMPOSER, marks, steps=steps), kinds, phrases

"""What a text claims about its end."""

import re
from dataclasses import replace

import numpy as np

from ..language.clauses import Clause, Noun, Parse
from ..language.ending import STATIC
from .claim import Claim, found_at, unknown
from .ground import Found, Ground, Mask, room_names

_SHORT_OF_M = 4.5  # one stops this far at most "before" a door
MOVING = frozenset({"turn", "move", "enter", "leave", "pass"})


def stop_claims(index: int, clause: Clause, parse: Parse, ground: Ground) -> list[Claim]:
    """Return the claims of the clause that says where to stop."""
    everywhere = np.ones(len(ground.along_m), dtype=bool)
    result: list[Claim] = []
    if clause.distance_m:
        result.append(
            Claim(index, "walk", everywhere, distance_m=clause.distance_m, vague=clause.vague)
        )
    mask = ground.at_goal()
    view: Mask | None = None
    named = bool(clause.distance_m)
    alone = all(n.kind == "unknown" for n in clause.nouns) and not clause.distance_m
    for noun in clause.nouns:
        passed = clause.verb == "pass" and noun.kind == "object"
        found = ground.stopped_after(noun) if passed else _stop_noun(noun, ground)
        if noun.kind == "unknown" and alone:
            found = unknown(noun, ground, needed=True)
        if found is None:
            continue
        if found.reason and clause.unparsed and noun.prep == "past":
            # Where the verb is not known, "by the bed" may be next to it.
            found = _stop_noun(replace(noun, prep="near"), ground) or found
        visited = len(ground.facts.visits) > 1 and noun.prep not in ("before", "at")
        if noun.kind == "room" and not found.reason and visited:
            # "Stop inside the kitchen" implies entering it.
            entered = ground.entered(noun)
            if not entered.reason:
                phrase = f"the {noun.text}"
                rooms = room_names(noun.head)
                result.append(
                    Claim(index, "door", entered.mask, phrase, optional=True, rooms=rooms)
                )
        named = True
        if not found.reason:
            mask = mask & found.mask
            if found.view is not None:
                view = found.view if view is None else view | found.view
        elif not clause.unparsed or noun.kind != "room":
            result.append(Claim(index, "false", everywhere, found.reason, strength=found.strength))
    # "Stop when you reach the bed": what comes next says where.
    nexts = parse.clauses[index + 1 : index + 2]
    named = named or any(c.until or c.verb in ("see", "reach", "") for c in nexts)
    result.append(Claim(index, "stop", mask, "stop", bare=not named, slack_m=2.4, view=view))
    return result


def _stop_noun(noun: Noun, ground: Ground) -> Found | None:
    if noun.kind == "object" and noun.prep in ("after", "past"):
        return ground.stopped_after(noun)
    if noun.kind == "object" and noun.prep == "with":
        found = ground.seen_at(noun)
        last = found.mask & ground.at_goal(0.6)
        if found.reason or last.any():
            return replace(found, mask=ground.at_goal() if last.any() else found.mask)
        return Found(last, f"the {noun.text} is not so at the end of the path")
    if noun.kind == "object":
        return ground.stopped_at(noun)
    if noun.kind == "room":
        if noun.part in ("entrance", "threshold", "mouth") or noun.prep in ("before", "at"):
            return ground.stopped_before(noun)
        return ground.stopped_in(noun)
    if noun.kind == "door":
        return ground.stopped_at_door()
    if noun.kind == "unknown":
        return unknown(noun, ground, needed=noun.prep in ("at", "near"))
    return None


def after_stop_claims(index: int, clause: Clause, parse: Parse, ground: Ground) -> list[Claim]:
    """Check that the text after the last stop describes the place, and does not walk on."""
    said = parse.text[clause.start : clause.stop].strip(" ,.;")
    everywhere = np.ones(len(ground.along_m), dtype=bool)
    if clause.verb in MOVING and not clause.until and not clause.meanwhile:
        if _goes_on(clause, said):
            return [Claim(index, "false", everywhere, "the text goes on after its stop")]
        clause = replace(
            clause, verb="", nouns=tuple(replace(n, prep="near") for n in clause.nouns)
        )
    result = []
    for noun in clause.nouns:
        found: Found | None
        seen = clause.verb == "see" or noun.prep == "with" or not clause.until
        behind = clause.until and noun.prep == "past" and noun.side
        if noun.kind == "object" and (clause.verb == "pass" or behind):
            found = ground.stopped_after(noun)
        elif clause.until and clause.verb == "see" and noun.side and noun.kind == "object":
            found = ground.beside(noun)
        elif seen and not clause.before:
            found = found_at(noun, ground, "see")
        elif clause.before and noun.kind == "room":
            found = ground.stopped_before(noun)
        elif clause.before and noun.kind == "door":
            found = ground.stopped_at_door(_SHORT_OF_M)
        else:
            found = _stop_noun(noun, ground)
        if found is None:
            continue
        # A side is that of the very end.
        near = found.mask & ground.at_goal(0.6 if noun.side else 2.6)
        if found.reason or not near.any():
            reason = found.reason or f"the {noun.text} is not so at the end of the path"
            result.append(Claim(index, "false", everywhere, reason))
    return result


def _goes_on(clause: Clause, said: str) -> bool:
    """Return whether a clause after the stop walks on; `(stop) walking by the bed` does not."""
    if clause.side:
        return True
    if re.match(r"\w+ing\b", said):
        return any(n.prep in ("into", "through", "from") for n in clause.nouns)
    if not said:
        return False
    return not clause.nouns or any(n.prep not in STATIC for n in clause.nouns)

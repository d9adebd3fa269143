"""The sentences' parts: ways to say one step.

`{s}` is a side, `{B}` the room entered, `{A}` the room left, `{X}` and `{Y}` things, `{n}` metres.
"""

TURN = (
    "turn {s}", "take a {s}", "turn to the {s}", "make a {s}", "go {s}", "turn {s} and keep going",
    "make a {s} turn", "turn to your {s}",
)  # fmt: skip
SLIGHT = (
    "bear {s}", "veer {s}", "take a slight {s}", "turn slightly {s}",
    "bear slightly {s}", "veer to the {s}", "turn a little to the {s}",
)  # fmt: skip
SHARP = ("make a sharp {s}", "turn sharply {s}", "take a sharp {s}", "turn hard {s}")
AROUND = ("turn around", "turn all the way around")

TURN_AT = (
    "{turn} at {X}", "{turn} when you reach {X}", "at {X}, {turn}", "{turn} by {X}",
    "go up to {X} and {turn}", "when you get to {X}, {turn}", "walk as far as {X} and {turn}",
    "{turn} once you are at {X}",
)  # fmt: skip

LEAVE = (
    "leave {A} and go into {B}", "walk out of {A} into {B}", "exit {A} into {B}",
    "head out of {A} and into {B}", "step out of {A} into {B}", "go from {A} into {B}",
    "leave {A} and enter {B}", "walk from {A} into {B}", "come out of {A} into {B}",
    "exit {A} and walk into {B}",
)  # fmt: skip
LEAVE_DOOR = (
    "go through the doorway into {B}", "leave {A} through the doorway and enter {B}",
    "take the doorway out of {A} into {B}", "walk through the doorway into {B}",
)  # fmt: skip
LEAVE_UNKNOWN = (
    "leave {A}", "walk out of {A}", "exit {A}", "head out of {A}", "go out of {A}",
    "step out of {A}",
)  # fmt: skip
ENTER = (
    "go into {B}", "enter {B}", "walk into {B}", "step into {B}", "head into {B}",
    "continue into {B}", "keep going into {B}", "move on into {B}", "carry on into {B}",
)  # fmt: skip
ENTER_DOOR = (
    "go through the doorway into {B}", "walk through the doorway into {B}",
    "pass through the doorway into {B}", "go through the door into {B}",
    "continue through the doorway into {B}", "head through the door into {B}",
)  # fmt: skip
TURN_ENTER = (
    "turn {s} into {B}", "turn {s} and go into {B}", "take a {s} into {B}",
    "turn {s} and enter {B}", "make a {s} into {B}", "go {s} into {B}",
    "turn {s} and walk into {B}",
)  # fmt: skip
SLIGHT_ENTER = (
    "bear {s} into {B}", "veer {s} into {B}", "bear {s} and enter {B}",
)  # fmt: skip
TURN_ENTER_DOOR = (
    "go through the doorway on your {s} into {B}", "take the doorway on the {s} into {B}",
    "turn {s} through the doorway into {B}", "take the door on your {s} into {B}",
    "turn {s} and go through the door into {B}", "enter {B} through the doorway on your {s}",
)  # fmt: skip
LEAVE_TURN_ENTER = ("walk out of {A} and turn {s} into {B}", "turn {s} out of {A} into {B}")
ENTER_THEN = (
    "step into {B} and {turn}", "go into {B} and {turn}", "enter {B} and {turn}",
    "walk into {B} and {turn}", "once you are in {B}, {turn}", "as soon as you enter {B}, {turn}",
    "go through the doorway into {B} and {turn}",
)  # fmt: skip
LEAVE_THEN = (
    "leave {A} and {turn} in {B}", "walk out of {A} and {turn}", "leave {A} and {turn}",
    "exit {A} and {turn}", "go out into {B} and {turn}", "step out into {B} and {turn}",
    "walk out of {A} into {B} and {turn}", "head out of {A} and {turn} in {B}",
)  # fmt: skip
PASS = (
    "walk past {X}{side}", "pass {X}{side}", "go past {X}{side}", "continue past {X}{side}",
    "keep going past {X}{side}", "head past {X}{side}", "walk by {X}{side}", "go by {X}{side}",
    "make your way past {X}{side}", "move past {X}{side}",
)  # fmt: skip
PASS_SIDE = (
    "walk on with {X} on your {s}", "go straight with {X} on your {s}",
    "keep going with {X} to your {s}", "walk along with {X} on the {s}",
    "go on, passing {X} on the {s}",
)  # fmt: skip
BETWEEN = (
    "walk between {X} and {Y}", "go between {X} and {Y}", "pass between {X} and {Y}",
    "continue between {X} and {Y}", "keep straight between {X} and {Y}",
)  # fmt: skip
FOLLOW = (
    "follow {B}", "go down {B}", "walk along {B}", "head down {B}", "walk down {B}",
    "continue along {B}",
)  # fmt: skip
WALK = (
    "walk straight for about {n}", "go forward about {n}", "continue straight for roughly {n}",
    "keep straight for about {n}", "walk ahead for around {n}", "go straight ahead about {n}",
    "move forward roughly {n}",
)  # fmt: skip
WALK_SHORT = (
    "walk forward a few steps", "go straight for a few steps", "take a few steps forward",
    "walk ahead a couple of metres", "go on for a couple of metres",
)  # fmt: skip
STOP = ("stop",) * 7 + ("wait",) * 3 + ("come to a stop",)
FRONT = (
    "in front of {X}", "just before {X}", "right in front of {X}", "before you reach {X}",
    "at {X}", "facing {X}", "when you reach {X}", "once you get to {X}",
)  # fmt: skip
BESIDE = (
    "next to {X}", "beside {X}", "by {X}", "right beside {X}", "right next to {X}",
    "alongside {X}", "when you are next to {X}", "once you are beside {X}", "at {X}",
)  # fmt: skip
NEAR = ("near {X}", "close to {X}", "by {X}")
STOP_SIDE = (
    "with {X} on your {s}", "when {X} is on your {s}", "with {X} to your {s}",
    "once {X} is on your {s}",
)  # fmt: skip
REACH_STOP = (
    "walk up to {X} and stop", "go to {X} and stop there", "continue to {X} and stop",
    "keep going until you reach {X} and stop there", "head for {X} and stop in front of it",
    "walk over to {X} and wait there", "go on until you reach {X}, and stop",
)  # fmt: skip
INSIDE = ("just inside {B}", "just inside the doorway", "inside {B}")
PAST = ("just past {X}", "right after {X}", "once you have passed {X}", "just after you pass {X}")
OUTSIDE = ("just outside {B}", "outside {B}", "just before {B}", "at the entrance of {B}")
AFTER = (
    "walk about {n} further and stop", "go on for about {n} and stop there",
    "continue for roughly {n} and stop", "stop after about {n}", "walk another {n} and stop there",
    "keep straight for about {n} and stop",
)  # fmt: skip
AFTER_SHORT = (
    "walk one more metre and stop", "take one or two more steps and stop",
    "stop after about a metre", "go on for a metre and stop there", "walk another metre and stop",
)  # fmt: skip
AHEAD = ("go straight ahead", "walk straight", "head straight on", "walk forward", "go straight")
THEN = ("then ", "next, ", "after that, ", "from there, ")

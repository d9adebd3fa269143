"""Verbs, prepositions, joints and other small words of route instructions, as plain tables."""

VERBS = {
    "turn": """turn turning bearing veering veer bear angle swing rotate pivot curve bend hook hang
        spin face bends curves drift slant swerve lean""",
    "move": """walk go head move continue proceed step keep follow cross travel advance come carry
        stay get march stroll start begin set make take traverse cut run return heading walking
        wander amble saunter stride trek squeeze slip duck nip pop thread navigate wend venture push
        going moving continuing keeping following leads lead round jog""",
    "enter": "enter entering entered",
    "leave": "leave exit leaving exiting depart quit",
    "pass": "pass passing passed skirt skirting",
    "stop": """stop wait halt stand pause finish park rest stopping waiting done end ends arrived
        halting pausing finishing finished finishes stops freeze linger conclude cease""",
    "see": "see observe notice find spot seeing look looking is are stands lies sits hangs",
    "reach": "reach reached approach reaching approaching arrive arriving meet hit",
}
VERB_OF = {word: verb for verb, words in VERBS.items() for word in words.split()}
NOUNLIKE = frozenset(
    """face end ends step turn pass rest stand stop start bend bends curve hook head set walk run
    round lead park cut finish""".split()
)
PREPOSITIONS = {
    **dict.fromkeys("past by beyond alongside along".split(), "past"),
    **dict.fromkeys("through across over".split(), "through"),
    **dict.fromkeys("into inside onto".split(), "into"),
    **dict.fromkeys("from off".split(), "from"),
    **dict.fromkeys("to toward towards for".split(), "to"),
    **dict.fromkeys("at".split(), "at"),
    **dict.fromkeys("near beside against".split(), "near"),
    "facing": "with",
    **dict.fromkeys("behind opposite under beneath below underneath".split(), "near"),
    "before": "before",
    "outside": "before",
    "between": "between",
    "around": "around",
    "round": "around",
    "in": "in",
    "with": "with",
    "after": "after",
    "on": "on",
    "via": "through",
    "down": "along",
    "up": "along",
    "within": "near",
    "without": "near",
    "of": "of",
}
PHRASES = (
    (("next", "to"), "near"),
    (("close", "to"), "near"),
    (("in", "front", "of"), "before"),
    (("short", "of"), "before"),
    (("out", "of"), "from"),
    (("up", "to"), "to"),
    (("across", "from"), "near"),
    (("away", "from"), "away"),
    (("as", "far", "as"), "to"),
    (("ahead", "of"), "before"),
    (("all", "the", "way"), ""),
    (("part", "way"), ""),
)
UNTIL = frozenset("until till once when as if where".split())
JOINTS = frozenset("and then but so while".split())
SLIGHT = frozenset("diagonally slight slightly gentle gently little soft bit".split())
SHARP = frozenset("sharp sharply hard".split())
THERE = frozenset("there here now done immediately".split())
SECOND = frozenset("going walking moving heading straight following".split())
BY_YOU = {
    ("behind", "you"): "behind",
    ("in", "front", "of", "you"): "ahead",
    ("ahead", "of", "you"): "ahead",
    ("next", "to", "you"): "beside",
    ("beside", "you"): "beside",
}
KEEP = frozenset("keep stay keeping staying".split())
BEND_WORDS = frozenset(
    "bear bearing veer veering curve curves bend bends angle keep drift slant lean".split()
)
TURN_PLACE = frozenset("at in into through by past between along out".split())
SEVERAL = frozenset("both all which each also".split())
OPENERS = frozenset("there here then next that".split())
RIGHT_ADVERB = frozenset(
    """there here next in by beside before after away where past behind between at through up
    outside inside opposite across""".split()
)
FILLERS = frozenset(
    """the a an you your will be it its that which who this these those to straight ahead forward
    forwards on about roughly approximately around just only again then next further more directly
    immediately first finally now soon almost nearly slowly carefully please all way right left over
    back down up out so can should have has come they them there here also still along under away
    for of one where first well another off until and or some is are little bit once inside through
    behind at in by within from other same far close long short past with side do does need want
    facing let yourself into opposite both after before very too even half upon continuing onward
    onwards itself whose until while past keep exactly eventually instead clockwise counterclockwise
    anticlockwise wide diagonally okay alright always standing starting comes stays lies got
    carrying takes than nor level begins starts ends""".split()
)

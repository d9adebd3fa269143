"""Verbs, prepositions, phrases and other small words of route instructions, as plain tables."""

from functools import cache

# kind of verb: its forms. Of two verbs in a clause the first that is not `go` decides.
_VERBS = {
    "turn": """turn turning turns turned bear bearing veer veering swing swinging rotate pivot curve
        curving bend bending bends angle hook hang slant swerve lean drift curl curling""",
    "go": """walk walking go going head heading move moving continue continuing proceed proceeding
        step stepping follow following travel advance come coming carry make making take taking get
        getting march stroll strolling start starting begin beginning set wander wandering amble
        saunter stride squeeze slip duck nip pop thread navigate wend venture push run jog cut
        cutting return returning leads leading lead progress wind use using choose pick cover trek
        edge skirt skirting hug hugging circle circling round rounding traverse hop crawl climb
        ease pursue retrace goes comes takes follows runs continues heads opens open keep
        keeping stay staying remain hold walked""",
    "cross": "cross crossing crosses traverse traversing",
    "enter": "enter entering entered enters",
    "leave": "leave leaving exit exiting exits depart quit leaves left_behind",
    "pass": "pass passing passes passed clear clearing",
    "stop": """stop stopping stops stopped wait waiting halt halting pause stand finish finishing
        finished park rest sit seated end ends ending arrived done freeze stay_there conclude cease
        destination goal target finishes kneel lie bring fetch clean water open_up wipe dust grab
        collect""",
    "see": """see seeing sees notice spot find finding look looking looks is are stands lies sits
        hangs appears was be observe face faces shows seen watch has have having""",
    "reach": """reach reaching reached reaches bump approach approaching arrive arriving meet meets
        hit""",
}
VERB_OF = {form: kind for kind, forms in _VERBS.items() for form in forms.split()}

# Prepositions by what they say of the place that follows.
PREPOSITIONS = {
    "past": "past by beyond alongside passing",
    "along": "along down up",
    "through": "through via",
    "across": "across over",
    "into": "into inside_to onto",
    "from": "from off",
    "to": "to",
    "toward": "toward towards for",
    "at": "at near beside against on alongside next_to opposite under beneath below underneath",
    "before": "before",
    "behind": "behind",
    "after": "after",
    "outside": "outside",
    "in": "in inside within",
    "with": "with facing",
    "between": "between amid",
    "around": "around round",
    "of": "of",
    "than": "than",
}
PREP_OF = {word: prep for prep, words in PREPOSITIONS.items() for word in words.split()}

# What is read as if it were other words; a line that ends with a bar goes on in the next. Words in
# capitals are marks.
_PHRASES = """
next to|right next to|just next to|close to|close by|hard by|adjacent to|level with|abreast of|
in line with=at
at the level of|at the side of|by the side of|in the vicinity of=at
in front of|just short of|short of|ahead of|right in front of|just ahead of=before
just inside=in
out of|out from|away from|clear of|off of=from
out to|out into|out onto|back to|back into|through to|through into|through onto|over to|on to|
on into|up into=into
out in|back in|into in=into
as far as|all the way to|right up to|up to|down to|along to|across to|all the way down to=to
all the way into|straight into|directly into|on through to|on through into=into
across from|facing toward=at
out through|out by|out via|back through|out of by|straight through|all the way through=through
in through=through
on through=through
straight past|just past|on past|on by|all the way past|out past|back past=past
all the way down|all the way along|straight down|straight along|straight up=along
just by=at
just before|immediately before=before
just after|immediately after|just beyond|shortly after=after
in between=between
just outside=outside
straight across|all the way across=across
turn around|turning around|turn round|turn back|u turn|u-turn|about face|about turn|
do a 180|turn yourself around|turn right around|turn right round=TURN_AROUND
make your way|making your way|carry on|carrying on|keep on|keep going|keep walking|
keep straight|keep moving|keep heading|keep straight on|move on|press on|set off|set out|
start off|start out|head off|get going|go on|walk on|find your way|work your way|pick your way|
take yourself|head on|moving on|going on|walking on|continue on|go ahead|walk ahead=go
make a u turn|make a u-turn|do a u turn|do a u-turn=TURN_AROUND
come to a stop|come to a halt|come to rest|coming to a stop|bring yourself to a stop|
you are there|you are done|you have arrived|you have reached your destination|you arrive|
that is it|that is where you stop|that is your stop|that is your spot|take a seat|sit down|
take up position|end up|end your walk|ending up|this is it|that is the spot|that is the place|
have a seat|you have made it=stop
where you stop|where you should stop|where we stop|where you want to stop|where you finish|
where you end|where you should end up|where you want to be|where you need to be|where to stop|
where you are headed|where you are going|where you wait=stop
you want|you need|you are looking for|we want|head for|heading for|make for|making for|
aim for|aiming for=TOWARD
get to|come to|gets to|come up to|arrive at|arriving at|you meet|walk up to|go up to|
getting to|come upon|come across|go as far as|go all the way to|walk as far as|
walk all the way to=reach
comes into view|come into view|comes up|come up|coming up|appears|you will find|you find|
you can see=see
there is|there are|there will be|here is=see
get in|go in|walk in|head in|step in|come in|nip in|pop in|going in|in you go|go inside|
walk inside|step inside|head inside|in there=GO_IN
go out|walk out|head out|step out|come out|get out|going out|walking out|out you go|
exit out|coming out=GO_OUT
go through|walk through|step through|head through|pass through|going through|
walking through|passing through=GO_THROUGH
so that|such that|until|till|once|when|as soon as|by the time|the moment|as you|as|where|
after you|after passing|if=UNTIL
both sides|either side|each side|side by side|right away|right now|straight away|all right|
all the way|the rest of the way|right angle|at right angles|of course|by now|the other way|
on your way|along the way|on the way|in a straight line|straight on|straight ahead|dead ahead|
straight forward|at once|at all|at last|in turn|for now=
on your feet|in your path|in your way|at the same time|as well|so far|a little way|a bit further|
a short way|a short distance|a little further|a little=
right there|just there|over there|right here=there
never mind that|never mind|mind you=
in the middle of|in the centre of|in the center of|at the foot of|at the head of|
at the corner of|at the end of|at the far end of|by the end of|by the corner of|
at the edge of=PLACE_OF
in the corner|in the far corner|at the far end|at the end|at the back|in the middle=
"""

# Words that deny or forbid.
NEGATIONS = frozenset(
    "not no never without nor neither ignore ignoring skip skipping avoid avoiding except unless "
    "rather cannot nothing none alone".split()
)
JOINTS = frozenset("and then but so while or".split())
UNTIL = frozenset("UNTIL".split())
SLIGHT = frozenset(
    "slight slightly gentle gently bit little soft softly diagonally somewhat easy".split()
)
SHARP = frozenset("sharp sharply hard".split())
# Verbs that turn only gently.
BENDS = frozenset(
    "bear bearing veer veering curve curving bend bending bends angle slant drift lean curl".split()
)
# After these, `right` is an adverb: "right past the sofa".
RIGHT_ADVERB = frozenset(
    "past by beside before after behind between next where outside inside opposite when once until "
    "as".split()
)
DETERMINERS = frozenset(
    "the a an your this that these those another its his her their each every any some both all "
    "our one's".split()
)
PRONOUNS = frozenset("it them one ones".split())
UNITS_M = {
    **dict.fromkeys("metre metres meter meters m".split(), 1.0),
    **dict.fromkeys("foot feet ft".split(), 0.305),
    **dict.fromkeys("yard yards".split(), 0.914),
    **dict.fromkeys("step steps pace paces stride strides".split(), 0.72),
    **dict.fromkeys("mile miles".split(), 1609.0),
    **dict.fromkeys("kilometre kilometres kilometer kilometers km".split(), 1000.0),
    **dict.fromkeys("centimetre centimetres centimeter centimeters cm".split(), 0.01),
    **dict.fromkeys("inch inches".split(), 0.0254),
    **dict.fromkeys("minute minutes".split(), 50.0),
    **dict.fromkeys("block blocks".split(), 80.0),
}  # fmt: skip
_SMALL = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen "
    "sixteen seventeen eighteen nineteen"
).split()
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety".split()
NUMBERS: dict[str, float] = {
    **{word: float(n) for n, word in enumerate(_SMALL)},
    **{word: 10.0 * n for n, word in enumerate(_TENS, start=2)},
    **{f"{t}-{w}": 10.0 * n + m for n, t in enumerate(_TENS, start=2)
       for m, w in enumerate(_SMALL[1:10], start=1)},
    "hundred": 100.0, "thousand": 1000.0, "dozen": 12.0, "half": 0.5, "quarter": 0.25,
    "double": 2.0, "couple": 2.0, "pair": 2.0,
}  # fmt: skip
_ORDINALS = (
    "first second third fourth fifth sixth seventh eighth ninth tenth eleventh twelfth thirteenth "
    "fourteenth fifteenth sixteenth seventeenth eighteenth nineteenth twentieth"
).split()
ORDINALS = {
    **{word: n for n, word in enumerate(_ORDINALS, start=1)},
    **{f"{n}{e}": n for n in range(1, 31) for e in ("st", "nd", "rd", "th")},
    "last": -1,
    "final": -1,
}
VAGUE_COUNTS = frozenset("few couple several some little short".split())
# Parts of a thing or room, which stand for it: "past the end of the table".
PARTS = frozenset(
    """end ends side corner edge foot head middle center centre back front rest length far start top
    bottom half mouth threshold direction finish beginning face width side's corners sides edges
    legs arm""".split()
)
# Nouns without a place, and small words that claim nothing.
FILLERS = frozenset(
    """i you we us they he she yourself your our me will would should can could may might must shall
    do does did let please just only about roughly around approximately almost nearly exactly around
    straight ahead forward forwards on further farther again also too still even soon now here there
    immediately directly slowly carefully quickly simply quite very really right left first finally
    next eventually instead already always well okay ok alright yes so good fine easy lovely nice
    off away back out over down up in through along across onward onwards backwards more enough bit
    little moment time way ways path route line course heading distance space place spot point area
    room rooms floor wall walls furniture house apartment flat home building hand side sides left
    right front end ends middle far other same opposite long short whole entire main wide narrow
    open closed close near nearby big small large tiny tall low high round square empty single
    double new old final immediate once twice one ones another both all each few couple several some
    any bit stretch leg journey trip walk turn turns corner bend gap sight view reach position
    destination goal target heading degree degrees ninety clockwise counterclockwise anticlockwise
    diagonal diagonally slight slightly sharp sharply gentle gently soft hard full half quick brief
    today course that this which who whose what it its them their his her than own beyond want wants
    need needs going get gets got getting be being been am was were has have had having do doing
    until past between arms length arm touch nose eye eyes face foot feet level before after behind
    beside under above below against towards toward from by with of for to into inside outside the a
    an at as if when while where because like then and but or everything something anything thing
    things part parts directions direction halfway part-way midway centre center edge start
    beginning begin finish ready set mind try sure without hello hey oh look notice remember note
    standing sitting lying hanging located placed positioned visible mounted running leading
    attached connected joined separate adjoining adjacent neighbouring neighboring nearest closest
    farthest furthest larger smaller latter former following remaining leftmost rightmost
    double-door instruction instructions location facing toward squarely gradually smoothly
    cautiously gently briefly continuously sideways ninety-degree right-angle two-seat upright alone
    kind sort type pair set group row rows line lines bunch shoulder shoulders knee elbow hip
    passage-way anyway however maybe perhaps probably actually basically honestly thanks thank
    welcome careful watch your yours mine ours later u turn""".split()
)


def _table() -> dict[tuple[str, ...], tuple[str, ...]]:
    result = {}
    for line in _PHRASES.strip().replace("|\n", "|").splitlines():
        phrases, _, meaning = line.partition("=")
        for phrase in phrases.split("|"):
            result[tuple(phrase.split())] = tuple(meaning.split())
    return result


@cache
def phrases() -> dict[tuple[str, ...], tuple[str, ...]]:
    """Return the phrases that are read as other words."""
    return _table()


LONGEST_PHRASE = 6

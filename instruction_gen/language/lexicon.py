"""Words of indoor routes, as plain tables.

A label of a scan reaches a text only through these tables: a label with a word that is in none of
them names no landmark. So labels stay data, whatever they say.
"""

from functools import lru_cache

# canonical noun = synonyms < kinds it may also be called; a comma goes on in the next line.
_OBJECTS = """
sofa=sectional,divan,chesterfield,futon,three-seater,
couch,settee,loveseat<seat,seating
armchair=club chair,wing chair,reading chair,accent chair,comfy chair,comfortable chair,cosy chair,
easy chair,lounge chair,recliner,sofa chair,arm chair<chair,seat
chair=dining chair,office chair,desk chair,swivel chair,computer chair,kitchen chair<seat
stool=bar stool,barstool<seat
pouf=hassock,beanbag,bean bag,
ottoman,footstool,puff,footrest,foot stool<seat
bench=<seat
coffee table=cocktail table,centre table,center table,
low table<table
dining table=eating table,
dinner table<table
kitchen table=<table,dining table
side table=end table<table
nightstand=bedside unit,bedside stand,bedside drawers,
bedside table,night stand,night table,bedside cabinet<table,cabinet
table=
desk=computer desk,study desk,computer table,workstation,
reading desk,writing desk,work desk,work table,study table<table
bed=
bunk bed=<bed
crib=cot<bed
wardrobe=clothes cabinet,clothes cupboard,clothes closet,
closet,armoire<cabinet,cupboard
dresser=tallboy,highboy,set of drawers,drawer unit,chest,
chest of drawers,drawers,bureau<cabinet
sideboard=credenza,buffet,console,console table<cabinet,cupboard
cabinet=cupboard
kitchen cabinet=<cabinet,cupboard
wall cupboard=wall cabinet<cupboard,cabinet
shoe cabinet=shoe unit,shoe dresser,shoe locker,
shoe cupboard,shoe storage,shoe closet,shoe chest,shoes<cabinet,cupboard
shoe rack=<rack,shelf
tv stand=television stand,tv unit,media console,tv console,tv table,tv bench,
entertainment center,media unit,television unit<stand,cabinet
tv cabinet=television cabinet<cabinet,tv stand
television=flatscreen,tv screen,big screen,flat-screen tv,flat screen tv,flat-screen,
tv,tv set,flat screen,screen,telly,television set
monitor=computer screen,display<screen
bookshelf=bookrack,book rack,wall of books,
bookcase,book shelf,shelf of books,shelf with books,book case,bookshelves<shelf,shelves
shelf=shelves,shelving,shelving unit
rack=
coat rack=coat hooks,coat hangers,coats,jackets,clothes stand,clothes hanger,
coat pegs,hat rack,coat rail,hanger stand,
coat stand,clothes rack,hat stand,coat hanger,coat hook,coat tree,garment rack,
hall tree<rack,stand
kitchen counter=kitchen worktop,kitchen countertop,work surface,kitchen work surface,kitchen top,
counter,countertop,worktop,kitchen unit,kitchen units,kitchen cabinets
counter=
refrigerator=fridge-freezer,fridge freezer,
fridge,freezer
stove=cooker,hob,range
oven=
cooking bench=cooking counter<bench,counter,stove
microwave=
dishwasher=
range hood=rangehood,extractor hood,hood
sink=
washbasin=hand basin,handbasin,bathroom sink,wash-basin,wash bowl,
wash basin,basin<sink
toilet=lavatory,toilet seat,toilet bowl,
commode,toilet bowl,loo
bathtub=bath,tub,bath tub
shower=shower cabin
washing machine=washer,laundry machine,clothes washer<machine
dryer=<machine
towel rail=towel rack,towel bar,towel holder,towel hanger<rail
radiator=heat radiator,central heating,
heater,heating
fireplace=
piano=grand piano
guitar=
drum=drums
fitness equipment=exercise machine,exercise equipment,gym equipment,workout machine<machine
treadmill=<machine
dumbbell=dumbbells,weights
plant=indoor plant,planter,greenery,flowerpot,flower pot,potted tree,
potted plant,houseplant,pot plant,house plant,plant pot
flower=flowers
tree=
vase=
lamp=light
floor lamp=upright lamp,reading lamp,lampstand,light stand,floor light,standing light,
standing lamp,tall lamp,lamp stand<lamp,light
table lamp=<lamp,light
ceiling lamp=ceiling light,pendant lamp<lamp,light
chandelier=<lamp,light
clock=wall clock
mirror=looking glass,wall mirror,standing mirror
picture=wall art,framed picture,
painting,photo,photograph,poster,artwork
window=
curtain=curtains,drape,drapes
curtain rod=
rug=floor covering,runner,
carpet,mat,area rug,floor mat,floor rug
carpet=rug,mat
bin=garbage bin,paper bin,waste basket,
trash can,trash bin,garbage can,waste bin,wastebasket,dustbin,rubbish bin,garbage bin,trash,
rubbish,litter bin
trash can=trash bin,garbage can,bin,waste bin,wastebasket
box=
seasoning box=<box
basket=laundry basket,hamper,laundry hamper,wicker basket
computer=laptop,pc
tablet=
printer=
whiteboard=board
airconditioner=air conditioner,air conditioning unit
fan=
security camera=camera
kitchen utensils=utensils
tableware=dishes
handle=
balcony table=<table
stairs=staircase,stairway,steps
statue=sculpture
pillar=column
column=pillar
railing=rail
door=doors
elevator=lift
vending machine=<machine
water dispenser=water cooler
aquarium=fish tank
billiard table=pool table<table
bicycle=bike
car=
suitcase=
dog=
cat=
pillow=cushion
blanket=
hammock=
island=kitchen island
wheelchair=<chair
hospital bed=<bed
trolley=cart
locker=lockers
reception desk=front desk,reception counter,reception,nurses station,nurse station,
nursing station<desk,counter
fire extinguisher=
sign=
partition=screen
stand=
machine=
storage=storage unit
speaker=
"""

_ROOMS = """
living room=lounge room,tv room,sitting area,lounge area,
lounge,sitting room,family room,living area,front room
kitchen=kitchenette,
kitchen area
bedroom=sleeping room,master bedroom,guest bedroom,guest room,
bed room
children's room=childs room,kids area,
childrens room,kids room,kid's room,child's room,children room,child room,
kid room,kids bedroom,kids' room,kids' bedroom,kid's bedroom,children's bedroom<bedroom
bathroom=powder room,shower area,
restroom,washroom,bath room,wc,shower room
hallway=passage way,hall area,corridor area,
hall,corridor,passage,passageway,landing,hall way
dining room=eating area,dining corner,
dining area,dining hall,dining space
exercise room=workout area,training room,fitness area,
gym,fitness room,workout room,exercise area
laundry room=utility room
music room=
office=workroom,study area,office room,
study,home office,study room,den,work room
entrance hall=entryway,foyer,entrance way,vestibule<hallway
closet room=walk-in closet,dressing room
garage=
balcony=terrace,patio
basement=cellar
attic=
library=
garden=yard
meeting room=conference room
lobby=
nursery=
storeroom=storage room,pantry
stairwell=
ward=
"""

DOORS = frozenset(
    "door doors doorway doorways archway arch opening entrance exit gap passage doorframe".split()
)
_COLOURS = """black white grey=gray,silver red=maroon orange yellow=golden green=teal,olive
    blue=navy,turquoise purple=violet pink brown beige=cream,tan"""
COLOURS = {
    word: name
    for name, _, more in (entry.partition("=") for entry in _COLOURS.split())
    for word in (name, *more.split(",")) if word
}  # fmt: skip
# Colours that people confuse.
_NEIGHBOURS = """black=grey white=grey,beige grey=white,black,beige,blue,green red=orange,pink,brown
    orange=red,brown,yellow,beige yellow=orange,beige,green green=yellow,blue,grey
    blue=purple,green,grey purple=blue,pink pink=red,purple,beige brown=orange,beige,red,black
    beige=brown,white,yellow,grey,orange"""
COLOUR_NEIGHBOURS = {
    name: set(near.split(","))
    for name, _, near in (entry.partition("=") for entry in _NEIGHBOURS.split())
}
# Colours that things have, whatever a picture or a label says of them.
INNATE_COLOURS = {"plant": "green", "tree": "green"}
MATERIALS = {
    "wooden": "wooden", "wood": "wooden", "metal": "metal", "steel": "metal", "leather": "leather",
    "glass": "glass", "marble": "marble", "stone": "stone", "plastic": "plastic",
    "fabric": "fabric", "brick": "brick",
}  # fmt: skip
# Adjectives that nothing in a scene can refute.
ADJECTIVES = frozenset(
    """large small big little long tall short wide narrow low high round square open closed nearby
    next last final adjacent adjoining far near main empty single nearest closest whole entire
    immediate very same other only left right lefthand righthand left-hand right-hand left-side
    right-side two-seat potted nice old new furnished bright dark quick slight sharp hard full
    gentle short brief couple first straight double soft wide-open opposite facing""".split()
)
_IRREGULAR = {
    "shelves": "shelf", "bookshelves": "bookshelf", "benches": "bench", "couches": "couch",
    "dishes": "dishes", "boxes": "box", "steps": "steps", "stairs": "stairs",
}  # fmt: skip


def _table(text: str) -> dict[str, tuple[frozenset[str], frozenset[str]]]:
    result = {}
    for line in text.strip().replace(",\n", ",").splitlines():
        name, _, rest = line.partition("=")
        same, _, kinds = rest.partition("<")
        words = frozenset(w.strip() for w in same.split(",") if w.strip()) | {name}
        result[name] = (words, frozenset(w.strip() for w in kinds.split(",") if w.strip()))
    return result


OBJECTS = _table(_OBJECTS)
ROOMS = _table(_ROOMS)


@lru_cache(maxsize=4096)
def singular(word: str) -> str:
    """Return the singular: `chairs` → `chair`; a word that only looks like a plural stays."""
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    for end, cut, add in (("ies", 3, "y"), ("sses", 2, ""), ("xes", 2, ""), ("ches", 2, "")):
        if word.endswith(end):
            return word[:-cut] + add
    if word.endswith("s") and not word.endswith(("ss", "us", "is")):
        return word[:-1]
    return word


def _phrases(table: dict[str, tuple[frozenset[str], frozenset[str]]]) -> dict[str, frozenset[str]]:
    found: dict[str, set[str]] = {}
    for name, (same, kinds) in table.items():
        for phrase in same | kinds:
            found.setdefault(phrase, set()).add(name)
    return {phrase: frozenset(names) for phrase, names in found.items()}


# Phrase → the canonical nouns or rooms that may be called so.
OBJECT_PHRASES = _phrases(OBJECTS)
ROOM_PHRASES = _phrases(ROOMS)

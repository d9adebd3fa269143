"""Object labels: which name an object, and which a person would use as a landmark."""

# Last words of labels of what is certainly not floor. Any other word (`apartment`, `ground truth`)
# may be the name of a node that holds the floor too.
_THINGS = """
airconditioner appliance armchair bag ball banister banisters bar barrel basin basket bath
bathtub beam bed bench bicycle bidet bin blanket blind blinds board boiler bookcase books
bookshelf bottle bowl box bucket cabinet cabinets camera can candle cart carton ceiling chair
chairs chandelier chest chimney clock closet clothes coat column computer conditioner container
cooker couch counter countertop cradle crate crib cup cupboard curtain curtains cushion desk
dishwasher door doorframe drawer drawers dresser dryer dumbbell dumbbells equipment fan faucet
fence fireplace flower frame freezer fridge furniture globe guitar handle heater hood island
kettle keyboard knickknack ladder lamp laptop ledge light lighting lights lintel locker machine
magazine mantle mattress microwave mirror mixer monitor nightstand ornament ottoman oven paper
partition pedestal phone piano picture pictures pillar pillow pipe plant plants plate poster pot
pouf printer rack radiator rail railing rangehood refrigerator rod roof sconce screen sculpture
seat shade shelf shelves shelving shoe shoes showcase shower shutter shutters sideboard sign
sink sofa speaker speakers stair staircase stairs stand statue stool stove suitcase switch table
tables tablet tableware tank television toilet towel towels toy trash tray treadmill tree trim
tub tv utensils vase vent wall wallpaper walls wardrobe washbasin washer whiteboard window
windows windowsill
"""
THINGS = frozenset(_THINGS.split())
# Those of them that are parts of the building, which a walker would not look for.
_STRUCTURE_WORDS = """
beam ceiling column frame lintel partition pillar rail railing roof trim wall wallpaper walls window
windows windowsill
"""
STRUCTURE = frozenset(_STRUCTURE_WORDS.split())
# What people steer by although it may be a place to walk on, or is rarely scanned.
_MORE_WORDS = """
altar aquarium blackboard bunk chalkboard cot easel elevator elevators escalator firewood fountain
gurney hammock hydrant jukebox lectern lift mailbox piano podium punchbag refrigerators sewing
statues storage stretcher tent throne trampoline trolley wheelchair workbench
"""
_MORE = frozenset(_MORE_WORDS.split())
# Longer labels are descriptions.
MAX_WORDS = 3


def nameable(category: str) -> bool:
    """Return whether a label names an object, so that an instruction may use it.

    Labels often are raw names of nodes (`wall standard case`, `nursesstation`, `chunk b`); only
    those that end in a known thing, which is no part of the building, are taken.
    """
    words = category.lower().replace("_", " ").split()
    if not words or len(words) > MAX_WORDS or not all(word.isalpha() for word in words):
        return False
    return words[-1] in (THINGS | _MORE) - STRUCTURE

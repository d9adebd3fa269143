"""Labels that name an object, and not a whole scene or its floor."""

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

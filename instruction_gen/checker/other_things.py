"""Kinds of things that are never landmarks: to name one is to claim that it exists.

A noun in none of the tables claims nothing, because people call places by more words than a table
holds (`the gap`, `the open stretch`). A noun of this table is a thing that can be seen, and as no
landmark of a scene answers to it, a text that names it invents it.
"""

OTHER_THINGS = frozenset(
    """accordion airplane altar anchor antelope anvil apple aquarium arcade armadillo arrow atm
    baby backpack ball balloon banana banjo banner barbecue barbell barrel baseball bathrobe
    bathmat battery bear beehive beer bell bidet bird birdcage blackboard blender boat bomb bonfire
    book books boot boots bottle bottles boulder bowl bread brick bridge briefcase broom bucket
    buffalo bulldozer bus bust butterfly cactus cage cake calendar campfire candelabra candle
    candles candlestick cannon canoe carousel cash cello chalkboard chandelier chessboard chicken
    chimney chipmunk church cigar clarinet coat coats coffin coffee coin compass computer concrete
    cooler copier couch cow crane crate crates cross crown crutch crystal cup cups cymbal cymbals
    dartboard deer desktop diploma dog doghouse doll dollhouse dolphin donkey doormat dragon drone
    duck dumpster dungeon easel eagle elephant engine espresso escalator
    fax fence ferret ferris figurine fireplace fish flag flagpole flamingo flashlight flute
    foosball football fountain fox foxes frog gargoyle gazebo generator giraffe globe goat
    gong gorilla gramophone grandfather grill guillotine guitar gun hammer hammock harmonica harp
    harpsichord hat hats hearth hedge helicopter helmet hippo hookah horse hydrant
    ironing jacuzzi jar jukebox kangaroo kayak keg kettle keyboard kitten knight ladder lantern
    lawnmower lectern lighthouse lion lizard llama locomotive loom loudspeaker lounger
    magazine magazines mannequin mantel mantelpiece mask mattress megaphone microphone microscope
    monkey monument moose mop motorbike motorcycle mower mural musket newspaper oboe
    octopus orchid organ ostrich owl palm panda parachute parrot pedestal pelican penguin
    phone photocopier piano pig pillar pinball pingpong pizza plane playpen podium
    polar pond pony pool popcorn porcupine portrait projector pulpit pumpkin puppet
    pyramid rabbit radio raft reindeer robot rocket rooster rowboat safe sailboat samovar
    sandbox sarcophagus saxophone scale scales scarecrow scooter sculpture seesaw sewing shark
    sheep shield ship shoe shoes shotgun shovel skateboard skeleton ski skis slide slippers
    snake snowman snowmobile sofabed spaceship spinet spear squirrel stag statue stereo
    stroller submarine surfboard swan swing sword synthesizer table-tennis tambourine tank
    tapestry taxi teapot telephone telescope tent throne tiger toaster toboggan tombstone torch
    totem toy toys tractor train trampoline treadmill tricycle trolley trombone trophy truck
    trumpet tuba turntable turtle typewriter ukulele umbrella unicorn unicycle urn vacuum van
    vault viola violin walrus warhammer watermelon whale wheelbarrow windmill wolf
    workbench xylophone yacht zebra
    bookcases cabinetry cockpit conveyor crib crucifix dispenser drawbridge
    birdbath foosball fishbowl gumball hourglass icebox incubator jail kiosk
    lavatory lifeboat mailbox manger menorah mousetrap nativity oven
    parasol pew playhouse pram pulley punchbag quilt rickshaw saddle sauna scaffold scaffolding
    shrine signpost sled sleigh slot speedboat spinning stethoscope stretcher sundial
    tepee terrarium tiki tombola tripod trough turnstile waterfall waterwheel wigwam
    wreath x-ray yurt""".split()
)

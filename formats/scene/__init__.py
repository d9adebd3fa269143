"""The repaired scene on disk: bundle, grids and planning maps.

All readers raise `FileFormatError` for a file that is missing, damaged or of another version.
"""

# Free height [m] above every traversable cell: no robot is taller. Here, because settings and
# options need it without the numerical libraries that the modules below load.
FULL_HEIGHT_M = 2.0
UNSOUND = "unsound"  # key of `SceneBundle.source` under which the faults of an unsound scene stand

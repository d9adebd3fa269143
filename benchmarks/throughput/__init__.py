"""Time of a collection: per stage of whole runs, per part of a frame."""

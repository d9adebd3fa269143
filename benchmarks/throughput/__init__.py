"""Where the time of a collection goes: per stage of whole runs, per part of a frame."""

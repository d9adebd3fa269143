"""RGB, depth and id videos: codecs, reading, writing and copying of streams."""

"""MCAP files: rollouts (physics truth) and episodes with images, both open in Foxglove.

All readers raise `FileFormatError` for a file that is missing, truncated, corrupt, of another
version, or without what is read. Where they take its `Contents`, `path` is for errors alone.
"""

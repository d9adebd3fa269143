"""RGB, depth and id videos: codecs, reading, writing and copying of streams.

All readers raise `FileFormatError` for a file that is missing, truncated, corrupt or another kind
of video.
"""

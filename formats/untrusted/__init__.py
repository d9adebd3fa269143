"""Files that others made: opened and parsed within limits, or refused with the reason.

All readers raise `FileFormatError` for a file that is missing, not a regular one, a Git LFS
pointer, not in the format, damaged, or beyond one of the `limits`. Where they take a `root`, the
file must lie in that folder after links are followed.
"""

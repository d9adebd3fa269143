"""Command line, engine, stages, comparison of mixtures, report.

Functions raise `InputError`, or a class derived from it, where the user's input is at fault; their
docstrings name other errors only.
"""

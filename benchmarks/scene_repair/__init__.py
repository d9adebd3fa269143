"""Repair of scans against known truth: holes are cut into sound floors.

`python -m benchmarks.scene_repair` runs everything and writes this folder's README.md.
"""

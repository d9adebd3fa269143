"""How well scans are repaired, with known truth: holes are cut into floors that are known.

`python -m benchmarks.scene_repair` runs everything and writes this folder's README.md.
"""

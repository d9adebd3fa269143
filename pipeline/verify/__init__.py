"""Find every damaged, missing or unknown file of a run, and outputs that contradict each other."""

"""Speed, measured as ratios against a named reference in the same process: `make bench`."""

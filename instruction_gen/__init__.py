"""Reference path and landmarks in, checked navigation instructions out (floor 2)."""

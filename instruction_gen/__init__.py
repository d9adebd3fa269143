"""Reference path and landmarks in, checked navigation instructions out (layer 2)."""

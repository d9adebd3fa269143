"""The policies that `vlnpe evaluate` offers, by name."""

"""Robots driven by a person: their wishes, and the journal of what they decided."""

"""Where cameras are, what rays they cast, and what they record."""

"""Levels, their floors, and the repair of a floor's holes."""

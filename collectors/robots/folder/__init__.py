"""A user's own robot, from a folder."""

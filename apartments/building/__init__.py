"""Plan, walls and furniture of a building, as exact triangles."""

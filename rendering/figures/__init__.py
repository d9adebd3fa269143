"""Pictures for people: film strips, portraits of robots, maps."""

"""Pictures for people: film strips, portraits, maps."""

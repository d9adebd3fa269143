"""Categories of objects and faces, from names and label files."""

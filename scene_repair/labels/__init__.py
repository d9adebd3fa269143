"""Categories of things and faces, from names and label files."""

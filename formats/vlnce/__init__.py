"""VLN-CE's episode files, in Habitat's coordinates."""

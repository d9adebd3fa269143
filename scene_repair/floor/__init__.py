"""The repair of a floor: its holes, bumps and patches."""

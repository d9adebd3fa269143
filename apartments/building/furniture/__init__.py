"""Furniture: every piece stands in its own frame, back at y = 0, front towards +y, x centred."""

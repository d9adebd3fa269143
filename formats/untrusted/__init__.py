"""Files that others made: opened and parsed within limits, or refused with the reason."""

"""Files of a repaired scene."""

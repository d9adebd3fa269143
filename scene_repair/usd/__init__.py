"""Reading USD stages, and writing the repaired scene as one."""

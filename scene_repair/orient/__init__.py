"""Up axis, unit, tilt and extent of a scan."""

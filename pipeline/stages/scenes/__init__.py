"""Work items that make scenes: scan a generated building, repair a scan."""

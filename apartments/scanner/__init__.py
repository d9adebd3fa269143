"""The virtual scanner: depth views, fusion, texture."""

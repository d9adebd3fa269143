"""A local page on which people review paths and texts; every decision is kept."""

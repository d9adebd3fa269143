"""People refine: a local page that shows paths and texts and remembers every decision."""

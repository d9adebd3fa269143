"""The viewer in the browser: scenes, robots and runs as nodes of a viser server."""

"""Values of command line options: scenes, robots, views, folders, sets of episodes."""

"""What the words of a command line stand for: scenes, robots, views, folders, sets of episodes."""

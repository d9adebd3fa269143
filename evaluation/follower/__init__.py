"""Where a text leads on a map: sub-goals, ways, and what meeting the ones along the others costs."""

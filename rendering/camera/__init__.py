"""Camera poses, the rays of their pixels, and the videos that they record."""

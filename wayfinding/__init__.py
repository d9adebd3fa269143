"""Planning, geodesic distances, rooms and doorways over a freemap (layer 1.5: imports formats)."""

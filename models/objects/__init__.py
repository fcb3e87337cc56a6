"""Objects to work on: their meshes, symmetries, tool paths, collision shapes, and what the sea does to them."""

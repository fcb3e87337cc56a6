"""Objects to work on: meshes, symmetries, tool paths, collision shapes, growth and dents."""

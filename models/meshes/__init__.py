"""Triangle meshes: files, closed surfaces, convex parts, nearest points, first hits of rays."""

"""Triangle meshes: files, closed shells, convex decomposition, nearest points, ray casting."""

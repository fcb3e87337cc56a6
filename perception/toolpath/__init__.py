"""Tool paths on the surface that was scanned, and where that surface differs from the model."""

"""Tool paths on the scanned surface, and deviations of that surface from the model."""

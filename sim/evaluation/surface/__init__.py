"""Work on a surface: forces by level, and errors of the tool from its path and the true surface."""
